"""The result of a design: a trajectory, its conditioning, and its margins to every limit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from echelon.arrays import Floats
from echelon.base.model import BaseModel
from echelon.excite.problem.closed_loops import state_regressor
from echelon.excite.problem.information import condition_number, log_det, sample_times
from echelon.excite.problem.task import Task
from echelon.excite.problem.trajectory import Trajectory
from echelon.excite.verify.margins import Margin
from echelon.logs.finding import Finding

_MOMENTS = 40  # at which conditioning is reported


@dataclass(frozen=True)
class Conditioning:
    """Conditioning of the base parameters, with friction that is not smoothed."""

    condition: float  # condition number of the observation matrix whose rows are divided by the outputs' noise
    scaled_condition: float  # the same with columns of norm 1
    log_det: float  # of the information matrix
    std: tuple[float, ...]  # standard deviation of each base parameter, SI units
    over_time: tuple[tuple[float, float], ...]  # time, s, and the scaled condition number of all samples up to it


def conditioning_of(task: Task, trajectory: Trajectory, prior: Floats | None = None) -> Conditioning:
    """Conditioning along a trajectory, with friction that is not smoothed; ``prior`` is information of shape (r, r)."""
    base = task.base
    regressor = state_regressor(base.mechanism, base.matrix.pivots)
    times = sample_times(trajectory.duration, task.entry.rate)
    entries = regressor.entries(dict(zip(("q", "qd", "qdd"), trajectory.states(times), strict=True)))
    F = np.zeros((base.rank, base.rank)) if prior is None else prior.copy()
    moments = []
    cuts = np.unique(np.linspace(0, len(times), _MOMENTS + 1).astype(int)[1:])
    for first, end in zip([0, *cuts[:-1].tolist()], cuts.tolist(), strict=True):
        for rows, weight in zip(regressor.rows, task.weights, strict=True):
            block = entries[first:end, rows.entries]
            F[np.ix_(rows.columns, rows.columns)] += weight * (block.T @ block)
        moments.append((float(times[end - 1]), _scaled_condition(F)))
    std = _deviations(F)
    return Conditioning(condition_number(F), _scaled_condition(F), log_det(F), tuple(std.tolist()), tuple(moments))


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


@dataclass(frozen=True)
class Start:
    """One start of the solver."""

    number: int  # from 0 on; with the seed it makes the starting point
    status: str
    value: float  # of the criterion, smoothed; infinite if no motion kept the limits
    iterations: int
    history: tuple[float, ...]  # the best value so far, each time it became better


@dataclass(frozen=True)
class ExcitingTrajectory:
    """A trajectory to be run, with all that is known about it.

    Attributes
    ----------
    trajectory : Trajectory
        Of the coordinates that move.
    base : BaseModel
        Base parameters of the robot with the others held.
    held : mapping of str to float
        Coordinates that are held, and where.
    criterion : str
    conditioning : Conditioning
    margins : tuple of Margin
        Of every limit.
    starts : tuple of Start
    findings : tuple of Finding
    settings : mapping
        Everything needed to repeat the design.
    """

    trajectory: Trajectory
    base: BaseModel
    held: Mapping[str, float]
    criterion: str
    conditioning: Conditioning
    margins: tuple[Margin, ...]
    starts: tuple[Start, ...]
    findings: tuple[Finding, ...]
    settings: Mapping[str, Any]

    @property
    def safe(self) -> bool:
        """Whether every limit is kept: at every time, or where a margin is ``sampled`` at samples."""
        return all(margin.kept for margin in self.margins)

    @property
    def active(self) -> tuple[Margin, ...]:
        """Limits that the trajectory comes near to."""
        return tuple(margin for margin in self.margins if margin.active)
