"""A design: the task, a family of motions, and the problem that a solver gets."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.excite.criteria import Criterion
from echelon.excite.families.basis import Basis, resting_ends
from echelon.excite.families.bsplines import uniform_splines
from echelon.excite.families.fourier import Fourier
from echelon.excite.families.sums import Sum
from echelon.excite.information import Information
from echelon.excite.loops.problem import LoopProblem
from echelon.excite.loops.regressor import state_regressor
from echelon.excite.poses import start_pose
from echelon.excite.problem import Problem
from echelon.excite.task import Task, names_of
from echelon.excite.trajectory import Trajectory
from echelon.formats.schema_excite import ExcitationEntry
from echelon.hints import nearest_of

DURATION = 8.0
"""Seconds, where none is stated."""
_FEWEST, _MOST, _FUNCTIONS = 3, 7, 56
"""Harmonics where none are stated: so many that all coordinates together have about that many, within these ends."""


@dataclass(frozen=True)
class Design:
    """What is to be optimised.

    Attributes
    ----------
    task : Task
    centre : array of shape (n,)
        Where motions start.
    problem : Problem
    """

    task: Task
    centre: Floats
    problem: Problem

    def trajectory(self, x: Floats) -> Trajectory:
        """The trajectory with these coefficients."""
        names = self.task.mechanism.independent_velocities
        return Trajectory(names, self.task.units, self.problem.basis, x.reshape(self.problem.shape))


def designed(task: Task, known: Floats | None = None) -> Design:
    """Decide what the solver needs.

    Parameters
    ----------
    task : Task
    known : array of shape (r, r), optional
        Information that there is already, from other logs.

    Raises
    ------
    InputError
        If limits are in each other's way, or effects need measured inputs.
    """
    entry, base, limits = task.entry, task.base, task.limits
    centre = start_pose(_stated_centre(task), limits, task.constraints, entry.seed)
    prior = np.zeros((base.rank, base.rank)) if known is None else known
    if prior.shape != (base.rank, base.rank):
        raise InputError(f"known has shape {prior.shape}; the robot has {base.rank} base parameters")
    n = len(base.mechanism.independent_velocities)
    basis = resting_ends(family(entry, n))
    regressor = state_regressor(base.mechanism, base.matrix.pivots, task.smooth)
    times = sample_times(basis.duration, entry.rate)
    information = Information(regressor, basis, times, task.weights, prior)
    criterion = Criterion(entry.criterion, np.ones(base.rank))
    made = LoopProblem if base.mechanism.closures else Problem
    problem = made(basis, n, information, criterion, limits.motion, task.constraints, centre)
    if entry.criterion == "a_optimal":
        problem = replace(problem, criterion=Criterion("a_optimal", _sizes(problem, entry.seed)))
    return Design(task, centre, problem)


def _stated_centre(task: Task) -> Floats:
    names = list(task.mechanism.independent_velocities)
    for name in task.entry.centre:
        if name not in names and name not in names_of(task.setup.mechanism):
            problem = f"there is no coordinate '{name}'{nearest_of(name, names)}"
            raise InputError(problem, source=task.setup.source, element="centre")
    return np.array([task.entry.centre.get(name, np.nan) for name in names])


def _sizes(problem: Problem, seed: int) -> Floats:
    """Units in which every parameter contributes alike to a random motion, so that variances can be added up."""
    seen = problem.information(problem.start(np.random.default_rng(seed)).reshape(problem.shape))
    sizes = np.sqrt(np.diag(seen.F))
    return np.asarray(1 / np.where(sizes > 0, sizes, 1.0))


def sample_times(duration: float, rate: float) -> Floats:
    """Samples that a criterion counts, from 0 on, the end left out."""
    return np.arange(max(round(duration * rate), 1)) / rate


def family(entry: ExcitationEntry, count: int) -> Basis:
    """The family of motions that a set-up asks for, with any ends.

    Parameters
    ----------
    entry : ExcitationEntry
    count : int
        Coordinates that move: many of them are different enough with fewer harmonics each.
    """
    duration = DURATION if entry.duration is None else entry.duration
    harmonics = min(max(_FUNCTIONS // count, _FEWEST), _MOST) if entry.harmonics is None else entry.harmonics
    series, splines = Fourier(duration, harmonics), uniform_splines(duration, entry.pieces)
    return {"fourier": series, "bspline": splines, "sum": Sum((series, splines))}[entry.family]
