"""The design: the pose about which motions start, the family of motions, and the problem that the solver gets.

An optimised trajectory is made safe in the end: limits that hold at samples are made to hold at every time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations, islice
from math import isfinite

import numpy as np

from echelon.excite.problem.closed_loops import state_regressor
from echelon.excite.problem.information import (
    Information,
    OptimalityCriterion,
    sample_times,
)
from echelon.excite.problem.optimisation import Problem
from echelon.excite.problem.state_limits import StateConstraint
from echelon.excite.problem.task import ResolvedLimits, Task, names_of
from echelon.excite.problem.trajectory import (
    Basis,
    Combined,
    Fourier,
    Trajectory,
    resting_ends,
    uniform_splines,
)
from echelon.excite.solve.solver import Solution, constraint_generation
from echelon.excite.verify import Margin, margins_of, motion_margins
from echelon.formats import ExcitationEntry
from echelon.shared import (
    Flags,
    Floats,
    InputError,
    Integers,
    extra,
    locating,
    nearest_of,
)

_TRIED = 512  # poses
_REFINED = 24  # the best of them, from which broken limits are minimised
_KEPT = 1e-9  # what rounding may leave of a broken limit, relative to its size
_NEARBY = (
    0.1  # share of a coordinate's range to either side within which poses are nearby
)
_AROUND = 32  # poses nearby that are looked at
_NARROW = 0.1  # share of them that may break a limit before more room is looked for
_STEPS, _SWEEPS = 9, 3  # places that are tried for a coordinate, and how often


def start_pose(
    wanted: Floats,
    limits: ResolvedLimits,
    constraints: Sequence[StateConstraint],
    seed: int,
) -> Floats:
    """A pose at rest that keeps all limits: the middle of the ranges if that is one with room to move about it.

    Wanted coordinates of shape (n,) are NaN where the set-up leaves them open.
    """
    low, high = limits.low, limits.high
    pose: Floats = np.where(np.isnan(wanted), limits.middle, wanted)
    outside = np.flatnonzero((pose < low) | (pose > high))
    if len(outside):
        name = next(
            limit.name
            for limit in limits.motion
            if limit.order == 0 and limit.weights[outside[0]]
        )
        raise InputError(
            f"the centre of '{name}' is outside of its position limits",
            element="centre",
        )
    free, over = np.isnan(wanted), broken(pose[None], constraints)[0]
    if over.any() and not free.any():
        names = ", ".join(
            label
            for label, value in zip(_labels(constraints), over, strict=True)
            if value > 0
        )
        raise InputError(
            f"the pose at which motions start breaks the limits of {names}",
            element="centre",
        )
    low, high = (
        np.where(np.isfinite(low), low, pose - np.pi),
        np.where(np.isfinite(high), high, pose + np.pi),
    )
    search = _PoseSearch(free, low, high, constraints, seed)
    return search.roomier(search.feasible(pose) if over.any() else pose)


def broken(poses: Floats, constraints: Sequence[StateConstraint]) -> Floats:
    """How far each function is beyond its limits at rest, 0 if it is not: shape (poses, functions)."""
    still = np.zeros_like(poses)
    parts = [np.zeros((len(poses), 0))]
    for constraint in constraints:
        values = constraint.values(poses, still, still)
        over = np.maximum(
            np.maximum(constraint.low - values, values - constraint.high), 0.0
        )
        size = np.where(
            np.isfinite(constraint.high),
            np.abs(constraint.high),
            np.abs(constraint.low),
        )
        parts.append(np.where(over > _KEPT * np.maximum(size, 1.0), over, 0.0))
    return np.hstack(parts)


@dataclass(frozen=True)
class _PoseSearch:
    """Poses within position limits, some coordinates of which are free."""

    free: Flags  # shape (n,)
    low: Floats
    high: Floats
    constraints: Sequence[StateConstraint]
    seed: int

    def feasible(self, pose: Floats) -> Floats:
        """A pose that keeps all limits: of random ones the nearest, or one of the best ones moved."""
        unit = np.random.default_rng(self.seed).random((_TRIED, len(pose)))
        poses = np.where(self.free, self.low + (self.high - self.low) * unit, pose)
        over = broken(poses, self.constraints)
        good = np.flatnonzero(~over.any(axis=1))
        if len(good):
            away = np.linalg.norm(
                (poses[good] - pose) / np.maximum(self.high - self.low, 1e-300), axis=1
            )
            return np.asarray(poses[good[int(np.argmin(away))]])
        scale = np.maximum(over.max(axis=0), 1e-300)
        for k in np.argsort(np.sum(over / scale, axis=1))[:_REFINED]:
            found = self._refined(poses[k], scale)
            if not broken(found[None], self.constraints)[0].any():
                return found
        raise InputError(_conflict(over > 0, self.constraints), element="limits")

    def _refined(self, pose: Floats, scale: Floats) -> Floats:
        """The pose moved to where less is broken."""
        with extra("excite"):
            from scipy.optimize import least_squares

        free, low, high = self.free, self.low[self.free], self.high[self.free]

        def residuals(x: Floats) -> Floats:
            full = pose.copy()
            full[free] = x
            found: Floats = broken(full[None], self.constraints)[0] / scale
            return found

        found = least_squares(
            residuals, np.clip(pose[free], low, high), bounds=(low, high)
        )
        result = pose.copy()
        result[free] = found.x
        return result

    def roomier(self, pose: Floats) -> Floats:
        """The pose, or if it is in a narrow place another, each coordinate where fewer poses nearby break limits."""
        # about a pose beside a limit, a motion can hardly be made smaller, nor that limit tighter
        low, high, near = self.low, self.high, _NEARBY * (self.high - self.low)
        around = near * np.random.default_rng(self.seed).uniform(
            -1, 1, (_AROUND, len(pose))
        )

        def crowded(poses: Floats) -> Integers:
            """How many poses nearby break each limit, shape (poses, functions)."""
            found = (
                broken(
                    (poses[:, None] + around).reshape(-1, len(pose)), self.constraints
                )
                > 0
            )
            return np.asarray(found.reshape(len(poses), _AROUND, -1).sum(axis=1))

        if crowded(pose[None]).max(initial=0) <= _NARROW * _AROUND:
            return pose
        for _ in range(_SWEEPS):
            before = pose
            for j in np.flatnonzero(self.free):
                tried = np.tile(pose, (_STEPS + 1, 1))
                tried[1:, j] = np.linspace(low[j] + near[j], high[j] - near[j], _STEPS)
                good = tried[~broken(tried, self.constraints).any(axis=1)]
                pose = good[
                    np.lexsort((np.abs(good - pose)[:, j], crowded(good).sum(axis=1)))[
                        0
                    ]
                ]
            if np.array_equal(pose, before):
                break
        return pose


def _conflict(over: Flags, constraints: Sequence[StateConstraint]) -> str:
    """Which limits no pose keeps, alone or in pairs."""
    labels = _labels(constraints)
    start = f"none of {len(over)} poses within the position limits keeps"
    never = [labels[k] for k in np.flatnonzero(over.all(axis=0))]
    if never:
        return f"{start} the limits of {', '.join(never[:6])}"
    for i, j in combinations(np.flatnonzero(over.any(axis=0)).tolist(), 2):
        if np.all(over[:, i] | over[:, j]):
            return f"{start} the limits of {labels[i]} and of {labels[j]} together"
    some = [labels[k] for k in np.flatnonzero(over.any(axis=0))]
    return f"{start} all limits together: {', '.join(some[:8])}"


def _labels(constraints: Sequence[StateConstraint]) -> list[str]:
    return [label for constraint in constraints for label in constraint.labels]


DURATION = 8.0  # seconds, where none is stated
_FEWEST, _MOST, _FUNCTIONS = 3, 7, 56
"""Harmonics where none are stated: so many that all coordinates together have about that many, within these ends."""


@dataclass(frozen=True)
class Design:
    """A task with the pose about which motions start, and the problem that the solver gets."""

    task: Task
    centre: Floats  # shape (n,); where motions start
    problem: Problem

    def trajectory(self, x: Floats) -> Trajectory:
        """The trajectory with these coefficients."""
        names = self.task.mechanism.independent_velocities
        return Trajectory(
            names,
            self.task.limits.units,
            self.problem.basis,
            x.reshape(self.problem.shape),
        )


def designed(task: Task, prior: Floats | None = None) -> Design:
    """Decide what the solver needs; ``prior`` is information of shape (r, r) that there is already."""
    with locating(task.setup.source):
        entry, base, limits = task.entry, task.base, task.limits
        centre = start_pose(_stated_centre(task), limits, task.constraints, entry.seed)
        prior = np.zeros((base.rank, base.rank)) if prior is None else prior
        if prior.shape != (base.rank, base.rank):
            raise InputError(
                f"prior_information has shape {prior.shape}; the robot has {base.rank} base parameters"
            )
        n = base.mechanism.degrees_of_freedom
        basis = resting_ends(family(entry, n))
        regressor = state_regressor(base.mechanism, base.matrix.pivots, task.smooth)
        times = sample_times(basis.duration, entry.rate)
        information = Information(regressor, basis, times, task.weights, prior)
        criterion = OptimalityCriterion(entry.criterion, np.ones(base.rank))
        problem = Problem(
            basis, n, information, criterion, limits.motion, task.constraints, centre
        )
        if entry.criterion == "a_optimal":
            problem = replace(
                problem,
                criterion=OptimalityCriterion("a_optimal", _sizes(problem, entry.seed)),
            )
        return Design(task, centre, problem)


def _stated_centre(task: Task) -> Floats:
    names = list(task.mechanism.independent_velocities)
    for name in task.entry.centre:
        if name not in names and name not in names_of(task.setup.mechanism):
            problem = f"there is no coordinate '{name}'{nearest_of(name, names)}"
            raise InputError(problem, element="centre")
    return np.array([task.entry.centre.get(name, np.nan) for name in names])


def _sizes(problem: Problem, seed: int) -> Floats:
    """Units in which every parameter contributes alike to a random motion, so that variances can be added up."""
    seen = problem.information(
        problem.start(np.random.default_rng(seed)).reshape(problem.shape)
    )
    sizes = np.sqrt(np.diag(seen.F))
    return np.asarray(1 / np.where(sizes > 0, sizes, 1.0))


def family(entry: ExcitationEntry, count: int) -> Basis:
    """The family of motions that a set-up asks for, with any ends."""
    duration = DURATION if entry.duration is None else entry.duration
    harmonics = (
        min(max(_FUNCTIONS // count, _FEWEST), _MOST)
        if entry.harmonics is None
        else entry.harmonics
    )
    series, splines = (
        Fourier(duration, harmonics),
        uniform_splines(duration, entry.segments),
    )
    return {"fourier": series, "bspline": splines, "sum": Combined((series, splines))}[
        entry.family
    ]


_ROUNDS = 5
_MORE = 1.5  # times what a limit was broken by, by which it is tightened
_LITTLE = 1e-4  # of a motion that is given up to be on the safe side
_LITTLE_LESS = (0.998, 0.99)  # shares of a motion that are as good as the whole
_MUCH_LESS = (0.97, 0.9, 0.75, 0.5)  # shares that are better than nothing
_BACK = (
    0.98  # share of a motion that keeps tighter limits, from which the next one starts
)
_ITERATIONS = 100  # of a solver that starts next to its goal


def safe(design: Design, solutions: Sequence[Solution]) -> tuple[Floats, list[Margin]]:
    """The best solution, changed so that every limit holds at every time, and the margins."""
    # a slightly smaller motion makes up for what is missing between samples.  Where that costs too much, the broken
    # limits are tightened and the search goes on
    most = min(_ITERATIONS, design.task.entry.iterations)
    worst = ""
    for solution in sorted(
        (s for s in solutions if s.x is not None), key=lambda s: s.value
    ):
        problem, x = design.problem, solution.x
        for _ in range(_ROUNDS):
            if x is None:
                break
            found, margins = _smaller(design, x, _LITTLE_LESS)
            broken = [margin for margin in margins if not margin.kept]
            if not broken:
                return found, margins
            worst = ", ".join(margin.label for margin in broken[:6])
            problem = _tightened(problem, margins, design)
            x = constraint_generation(problem, problem.shrunk(x, _BACK), most, x).x
        assert solution.x is not None
        found, margins = _smaller(design, solution.x, _MUCH_LESS)
        if all(margin.kept for margin in margins):
            return found, margins
    reason = (
        f"the limits of {worst} are broken between samples"
        if worst
        else "no start found a motion that keeps them"
    )
    raise InputError(
        f"no trajectory keeps all limits: {reason}",
        source=design.task.setup.source,
        element="excitation",
    )


def _smaller(
    design: Design, x: Floats, shares: Sequence[float]
) -> tuple[Floats, list[Margin]]:
    """The largest of some shares of a motion about its centre that keeps all limits, or the whole, and the margins."""
    rest = design.problem.at_rest.ravel()
    whole = _within(design.problem, x, design)
    first = margins_of(design.trajectory(whole), design.task)
    if all(margin.kept for margin in first):
        return whole, first
    for share in shares:
        found = rest + share * (whole - rest)
        margins = margins_of(design.trajectory(found), design.task)
        if all(margin.kept for margin in margins):
            return found, margins
    return whole, first


def _within(problem: Problem, x: Floats, design: Design) -> Floats:
    """The motion made smaller by the little that limits of the motion are exceeded between samples."""
    rest = problem.at_rest.ravel()
    still = motion_margins(design.trajectory(rest), design.task.limits.motion)
    for _ in range(
        _ROUNDS
    ):  # bounds are wider than what is reached by less than what is added each time
        share = min(
            map(
                _share,
                still,
                motion_margins(design.trajectory(x), design.task.limits.motion),
            ),
            default=1.0,
        )
        if share >= 1:
            break
        x = rest + (share - _LITTLE) * (x - rest)
    return x


def _share(still: Margin, moving: Margin) -> float:
    """How much of a motion about a pose a limit leaves."""
    ends = (
        (still.high - still.largest, moving.largest - still.largest),
        (still.least - still.low, still.least - moving.least),
    )
    return min(
        (max(room, 0.0) / reached for room, reached in ends if reached > room),
        default=1.0,
    )


def _tightened(problem: Problem, margins: Sequence[Margin], design: Design) -> Problem:
    """The problem with tighter limits where they were broken."""
    states = iter(margins[len(design.task.limits.motion) :])
    below, above = [], []
    for constraint in problem.constraints:
        own = list(islice(states, len(constraint.labels)))
        below.append(_MORE * np.array([_broken_by(m.low - m.least) for m in own]))
        above.append(_MORE * np.array([_broken_by(m.largest - m.high) for m in own]))
    return problem.tightened(below, above)


def _broken_by(beyond: float) -> float:
    """How far a limit is broken; nothing where there is no limit, or where that is not known."""
    return max(beyond, 0.0) if isfinite(beyond) else 0.0
