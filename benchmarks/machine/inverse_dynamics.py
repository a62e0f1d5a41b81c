"""Inverse dynamics: generated C beside Pinocchio's RNEA, one call at a time, and the operations of the program."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import echelon as ec
from anchors.build import UnavailableError
from anchors.generated_c import CompiledC, compiled
from echelon.codegen import generate
from echelon.dynamics.functions import robot_function
from machine.cases import Case, States, arms
from ratios import Timer, interleaved_rounds

EXAMPLES = Path(__file__).parents[2] / "examples"
FUNCTION = "inverse_dynamics"

# Few enough states to stay in the cache: a controller's call finds its state there.
_STATES = 500
_CALLS = 200_000

# additions (with subtractions) and multiplications of inverse dynamics with base parameters
LABELS = {"rx90": "RX90", "puma560": "PUMA 560", "ur10": "UR10"}
PUBLISHED = {
    "rx90": {
        "SymPyBotics": (228, 298),
        "OpenSYMORO": (256, 310),
        "literature": (238, 253),
    },
    "puma560": {"SymPyBotics": (325, 431)},
    "ur10": {"SymPyBotics": (338, 444)},
}


def calls(
    quick: bool, repeats: int, report: Callable[[str], None]
) -> list[dict[str, Any]]:
    """One row for each arm."""
    rows = []
    for case in arms():
        report(f"inverse dynamics of {case.label}")
        rows.append(_row(case, _CALLS // (20 if quick else 1) // _STATES, repeats))
    return rows


def _row(case: Case, turns: int, repeats: int) -> dict[str, Any]:
    states = case.states(_STATES)
    timers = _ours(case, states, turns) | _theirs(case, states, turns)
    rounds = interleaved_rounds(
        {name: (turns * _STATES, timer) for name, timer in timers.items()}, repeats
    )
    both = len(timers) == len(("ours", "theirs"))
    return {
        "robot": case.label,
        "name": case.name,
        "ns": {name: rounds.per_sample(name).as_dict() for name in timers},
        "ratio": rounds.ratio("rnea", "generated").as_dict() if both else None,
        "skipped": case.skipped,
    }


def _ours(case: Case, states: States, turns: int) -> dict[str, Timer]:
    try:
        function = generated(case.base)
    except UnavailableError as error:
        case.skipped.append(f"generated C: {error}")
        return {}
    values = np.random.default_rng(2).uniform(-1, 1, case.base.rank)
    given = dict(zip(("q", "qd", "qdd"), states, strict=True)) | {"parameters": values}
    torques = np.zeros((_STATES, case.outputs))
    function.calls(given, torques)
    expected = np.einsum("nij,j->ni", case.base.regressor(*states), values)
    np.testing.assert_allclose(
        torques, expected, rtol=0, atol=1e-11 * np.abs(expected).max()
    )
    return {"generated": lambda: function.calls(given, torques, turns)}


def _theirs(case: Case, states: States, turns: int) -> dict[str, Timer]:
    robot = case.cpp
    if robot is None:
        return {}
    theirs, torques = case.theirs(states), np.zeros((_STATES, case.outputs))
    return {"rnea": lambda: robot.rnea(theirs, torques, turns)}


def generated(base: Any) -> CompiledC:
    """Inverse dynamics with base parameters in C, compiled."""
    return compiled(generate(base, "c", functions=(FUNCTION,)), FUNCTION)


def operations(report: Callable[[str], None]) -> list[dict[str, Any]]:
    """Counted operations of three arms of the examples, beside what others published."""
    rows = []
    for name, published in PUBLISHED.items():
        report(f"operations of {name}")
        mechanism = ec.load(EXAMPLES / f"{name}.yaml")
        structure = ec.base_structure(mechanism)
        counts = robot_function(FUNCTION, mechanism, structure.pivots).operations()
        rows.append(
            {
                "robot": name,
                "label": LABELS[name],
                "additions": sum(counts.get(op, 0) for op in ("ADD", "SUB")),
                "multiplications": counts.get("MUL", 0),
                "others": {
                    op.lower(): n
                    for op, n in counts.items()
                    if op not in ("ADD", "SUB", "MUL")
                },
                "published": {tool: list(pair) for tool, pair in published.items()},
            }
        )
    return rows
