"""Agreement with Pinocchio at random states, and of results on one thread and on several."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from machine.cases import Case, panda_case, urdf_case
from machine.throughput import THREADS

Floats = npt.NDArray[np.float64]

_STATES = 300
_THREADED = 20_000
_ROUNDING = 1e-12


def measured(report: Callable[[str], None]) -> list[dict[str, Any]]:
    """One row for each robot; decimals are read as they are, so that both programs see the same numbers."""
    rows = []
    cases = [
        urdf_case("ur10", "UR10", "ur10_robot.urdf", literal=True),
        panda_case(),
        urdf_case("talos", "Talos, 32 joints", "talos_reduced.urdf", literal=True),
    ]
    for case in cases:
        report(f"accuracy of {case.label}")
        rows.append(_row(case))
    return rows


def _row(case: Case) -> dict[str, Any]:
    base, states = case.base, case.states(_STATES)
    expected = _pinocchio(case)
    values = np.random.default_rng(3).uniform(-1, 1, base.rank)
    dense = base.regressor(*states)
    torques = np.einsum("nij,j->ni", expected[:, :, base.matrix.pivots], values)
    return {
        "robot": case.label,
        "name": case.name,
        "states": _STATES,
        "base": _difference(dense, expected[:, :, base.matrix.pivots]),
        "standard": _difference(base.standard_regressor(*states), expected),
        "predict": _difference(
            base.predict(*states, values)[:, :, None], torques[:, :, None]
        ),
        "same on all threads": _same_on_threads(case),
    }


def _pinocchio(case: Case) -> Floats:
    """Pinocchio's regressor with rows and columns in our order."""
    import pinocchio as pin

    data, theirs = case.model.createData(), case.theirs(case.states(_STATES))
    stacked = [
        pin.computeJointTorqueRegressor(case.model, data, *state).copy()
        for state in zip(*theirs, strict=True)
    ]
    rows = np.argsort(case.order)
    result: Floats = np.array(stacked)[:, rows][
        :, :, case.their_columns(range(len(case.base.parameters)))
    ]
    return result


def _difference(ours: Floats, theirs: Floats) -> float:
    """Largest difference of an entry, relative to the largest entry of its column.

    Columns that hold nothing but rounding are compared with the largest entry of all.
    """
    worst, scale = (
        np.abs(ours - theirs).max(axis=(0, 1)),
        np.abs(theirs).max(axis=(0, 1)),
    )
    scale[scale < _ROUNDING * scale.max()] = scale.max()
    return float((worst / scale).max())


def _same_on_threads(case: Case) -> bool:
    states, base = case.states(_THREADED // (1 if case.outputs < 10 else 20)), case.base
    one, several = (base.regressor(*states, threads=t) for t in (1, max(THREADS, 2)))
    return bool(np.array_equal(one, several))
