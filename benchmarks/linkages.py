"""Mechanisms with loops: the examples and a growing chain, beside a rank by floating point at closed states."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import echelon as ec
from echelon.dynamics.evaluate import evaluate_floats
from echelon.dynamics.linear_forms import virtual_power_form
from echelon.formats.robot_file import RobotFile
from echelon.loops.assembly import Assembly
from echelon.robot.mechanism import Mechanism
from numeric import states_of
from timing import interleaved

LOOPS = Path(__file__).parents[1] / "examples" / "loops"
_EXAMPLES = (
    "four_bar.yaml",
    "parallelogram.yaml",
    "sr400.yaml",
    "bennett.yaml",
    "delta.yaml",
    "three_rps.yaml",
    "gough_stewart.yaml",
    "biped.xml",
)
_CHAINS = range(1, 7)
_LONGEST_WITH_FORMS = 2  # four-bar linkages in a row

Job = Callable[[], Any]


@dataclass(frozen=True)
class Linkage:
    """One row of the comparison.

    Attributes
    ----------
    name : str
    mechanism : Mechanism
    forms : bool
        Closed forms are derived, not the structure alone.
    """

    name: str
    mechanism: Mechanism
    forms: bool = True


def chosen_linkages(quick: bool) -> list[Linkage]:
    """The linkages of a run."""
    examples = [
        Linkage(Path(f).stem, ec.load(LOOPS / f))
        for f in (_EXAMPLES[:1] if quick else _EXAMPLES)
    ]
    if quick:
        return examples
    return examples + [
        Linkage(f"chain of {n}", four_bars(n), n <= _LONGEST_WITH_FORMS)
        for n in _CHAINS
    ]


def four_bars(count: int) -> Mechanism:
    """Four-bar linkages in a row, the rocker of each being the crank of the next: 5·count + 3 base parameters."""
    lengths, rows, loops = {"h0": 0.15}, ["{name: r0, joint: revolute}"], []
    pose = {"r0": 1.0}
    for k in range(1, count + 1):
        lengths |= {
            f"g{k}": 0.4,
            f"c{k}": round(0.35 + 0.01 * k, 2),
            f"h{k}": round(0.3 + 0.01 * k, 2),
        }
        feet = " + ".join(f"g{i}" for i in range(1, k + 1))
        rows += [f"{{name: c{k}, joint: revolute, parent: r{k - 1}, a: h{k - 1}}}"]
        rows += [f"{{name: r{k}, joint: revolute, parent: base, a: {feet}}}"]
        ends = f"at: {{xyz: [c{k}, 0, 0]}}, on_second: {{xyz: [h{k}, 0, 0]}}"
        loops += [f"{{joint: revolute, connects: [c{k}, r{k}], {ends}}}"]
        pose |= {f"c{k}": -0.48 if k == 1 else -1.5, f"r{k}": 1.6}
    head = f"echelon: 1\nname: chain of {count}\ngravity: [0, -9.81, 0]\nsymbols: {lengths}\n"
    text = f"{head}modified_dh: [{', '.join(rows)}]\nloops: [{', '.join(loops)}]\nindependent: [r0]\nassembly: {pose}\n"
    return RobotFile.of(text.replace("'", "").encode(), "chain.yaml").mechanism()


def rank_by_svd(mechanism: Mechanism, seed: int = 1) -> int:
    """Singular values, with NumPy's own tolerance, of the regressor stacked at random closed states."""
    form = virtual_power_form(mechanism)
    columns = len(mechanism.parameters)
    count = states_of(columns, len(mechanism.independent_velocities))
    rng = np.random.default_rng(seed)
    stacked = evaluate_floats(
        form, mechanism, *Assembly(mechanism).random_closed_states(rng, count)
    )
    return int(np.linalg.matrix_rank(stacked.reshape(-1, columns)))


def measured(
    chosen: Iterable[Linkage], repeats: int, report: Callable[[str], None]
) -> list[dict[str, Any]]:
    """Every linkage, exactly and numerically; reading the file is left out."""
    rows = []
    for linkage in chosen:
        report(linkage.name)
        rows.append(_row(linkage, repeats))
    return rows


def _row(linkage: Linkage, repeats: int) -> dict[str, Any]:
    mechanism = linkage.mechanism
    times, results = interleaved(_jobs(linkage), repeats)
    peer = times["numeric_svd"].median
    return {
        "linkage": linkage.name,
        "bodies": len(mechanism.bodies),
        "degrees_of_freedom": len(mechanism.independent_velocities),
        "parameters": len(mechanism.parameters),
        "rank": results["structure"].rank,
        "rank_numeric_svd": results["numeric_svd"],
        "seconds": {name: t.as_dict() for name, t in times.items()},
        "per_numeric_svd": {
            name: round(t.median / peer, 3) for name, t in times.items()
        },
    }


def _jobs(linkage: Linkage) -> dict[str, Job]:
    mechanism = linkage.mechanism
    jobs: dict[str, Job] = {
        "structure": lambda: ec.base_structure(mechanism),
        "numeric_svd": lambda: rank_by_svd(mechanism),
    }
    return (
        jobs | {"closed_forms": lambda: ec.base_parameters(mechanism)}
        if linkage.forms
        else jobs
    )
