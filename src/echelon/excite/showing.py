"""What a trajectory shows of the base parameters: conditioning, and how well each of them will be known."""

from __future__ import annotations

import numpy as np

from echelon.arrays import Floats
from echelon.excite.criteria import condition_number, log_det
from echelon.excite.design import sample_times
from echelon.excite.loops.regressor import state_regressor
from echelon.excite.result import Shown
from echelon.excite.task import Task
from echelon.excite.trajectory import Trajectory

_MOMENTS = 40  # at which conditioning is reported


def shown(task: Task, trajectory: Trajectory, known: Floats | None = None) -> Shown:
    """What a trajectory shows, with friction as it is and not smoothed.

    Parameters
    ----------
    task : Task
    trajectory : Trajectory
        Of the task's coordinates.
    known : array of shape (r, r), optional
        Information that there was before.
    """
    base = task.base
    regressor = state_regressor(base.mechanism, base.matrix.pivots)
    times = sample_times(trajectory.duration, task.entry.rate)
    entries = regressor.entries(dict(zip(("q", "qd", "qdd"), trajectory.states(times), strict=True)))
    F = np.zeros((base.rank, base.rank)) if known is None else known.copy()
    moments = []
    cuts = np.unique(np.linspace(0, len(times), _MOMENTS + 1).astype(int)[1:])
    for first, end in zip([0, *cuts[:-1].tolist()], cuts.tolist(), strict=True):
        for rows, weight in zip(regressor.rows, task.weights, strict=True):
            block = entries[first:end, rows.entries]
            F[np.ix_(rows.columns, rows.columns)] += weight * (block.T @ block)
        moments.append((float(times[end - 1]), _scaled_condition(F)))
    std = _deviations(F)
    return Shown(condition_number(F), _scaled_condition(F), log_det(F), tuple(std.tolist()), tuple(moments))


def _deviations(F: Floats) -> Floats:
    """Standard deviations of the parameters; infinite if some are not determined."""
    if not np.isfinite(_scaled_condition(F)):
        return np.full(len(F), np.inf)
    sizes = np.sqrt(np.diag(F))
    found: Floats = np.sqrt(np.diag(np.linalg.inv(F / np.outer(sizes, sizes)))) / sizes
    return found


def _scaled_condition(F: Floats) -> float:
    sizes = np.sqrt(np.diag(F))
    if np.any(sizes <= 0):
        return float("inf")
    return condition_number(F / np.outer(sizes, sizes))
