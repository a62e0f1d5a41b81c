"""The design: the pose about which motions start, the family of motions, and the problem that the solver gets.

An optimised trajectory is made safe in the end: limits that hold at samples are made to hold at every time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from math import isfinite

import numpy as np

from echelon.excite.problem.allowances import POSES
from echelon.excite.problem.closed_loops import state_regressor
from echelon.excite.problem.information import (
    Information,
    OptimalityCriterion,
    sample_times,
)
from echelon.excite.problem.optimisation import Problem
from echelon.excite.problem.state_limits import Enclosed, StateConstraint
from echelon.excite.problem.task import ResolvedLimits, Task, names_of
from echelon.excite.problem.trajectory import (
    Basis,
    Combined,
    Fourier,
    Trajectory,
    resting_ends,
    uniform_splines,
)
from echelon.excite.solve.solver import METHOD, Search, SearchResult, Watch
from echelon.excite.verify import Margin, margins_of, motion_margins
from echelon.formats import ExcitationEntry
from echelon.shared import (
    Flags,
    Floats,
    InputError,
    Integers,
    extra,
    listed,
    locating,
    nearest_of,
)

REFINED = 4
"""Best random poses, from which broken limits are minimised, a tenth of a second each."""
ONSET_SPEED = 1e-9
"""Speed, rad/s or m/s, within which dry friction has both signs."""
ROUNDING = 1e-9
"""Excess over a limit, relative to its size, that rounding may leave."""
NEARBY = 0.1
"""Share of a coordinate's range to either side within which poses are nearby."""
NEARBY_POSES = 32
"""Poses nearby that are looked at."""
NARROW = 0.1
"""Share of them that may break a limit before more room is looked for."""
SWEEPS = 3
"""Times that all coordinates are moved to more room: one moves the next, and the third time hardly anything changes."""


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
    low = np.where(np.isfinite(low), low, pose - np.pi)
    high = np.where(np.isfinite(high), high, pose + np.pi)
    search = _PoseSearch(free, low, high, constraints, seed)
    return search.roomier(search.feasible(pose) if over.any() else pose)


def broken(poses: Floats, constraints: Sequence[StateConstraint]) -> Floats:
    """Excess of each function over its limits at rest, 0 where they are kept: shape (poses, functions)."""
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
        parts.append(np.where(over > ROUNDING * np.maximum(size, 1.0), over, 0.0))
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
        unit = np.random.default_rng(self.seed).random((POSES, len(pose)))
        poses = np.where(self.free, self.low + (self.high - self.low) * unit, pose)
        over = broken(poses, self.constraints)
        good = np.flatnonzero(~over.any(axis=1))
        if len(good):
            away = np.linalg.norm(
                (poses[good] - pose) / np.maximum(self.high - self.low, 1e-300), axis=1
            )
            return np.asarray(poses[good[int(np.argmin(away))]])
        scale = np.maximum(over.max(axis=0), 1e-300)
        # where all poses break one limit, more of them say no more
        most = 1 if (over > 0).all(axis=0).any() else REFINED
        for k in np.argsort(np.sum(over / scale, axis=1))[:most]:
            found = self._refined(poses[k], scale)
            left = broken(found[None], self.constraints)
            if not left.any():
                return found
            over = np.vstack([over, left])
        raise InputError(_conflict(over, self.constraints), element="limits")

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
        low, high, near = self.low, self.high, NEARBY * (self.high - self.low)
        around = near * np.random.default_rng(self.seed).uniform(
            -1, 1, (NEARBY_POSES, len(pose))
        )

        def crowded(poses: Floats) -> Integers:
            """How many poses nearby break each limit, shape (poses, functions)."""
            found = (
                broken(
                    (poses[:, None] + around).reshape(-1, len(pose)), self.constraints
                )
                > 0
            )
            return np.asarray(found.reshape(len(poses), NEARBY_POSES, -1).sum(axis=1))

        if crowded(pose[None]).max(initial=0) <= NARROW * NEARBY_POSES:
            return pose
        for _ in range(SWEEPS):
            before = pose
            for j in np.flatnonzero(self.free):
                places = np.arange(low[j] + near[j], high[j], near[j])
                tried = np.tile(pose, (len(places) + 1, 1))
                tried[1:, j] = places
                good = tried[~broken(tried, self.constraints).any(axis=1)]
                pose = good[
                    np.lexsort((np.abs(good - pose)[:, j], crowded(good).sum(axis=1)))[
                        0
                    ]
                ]
            if np.array_equal(pose, before):
                break
        return pose


def _conflict(over: Floats, constraints: Sequence[StateConstraint]) -> str:
    """A sentence about limits that no pose keeps, alone or in pairs, with what was reached and what to write."""
    labels = _labels(constraints)
    start = f"none of {POSES} poses within the position limits keeps"
    never = np.flatnonzero((over > 0).all(axis=0)).tolist()
    if never:
        units = [unit for constraint in constraints for unit in constraint.units]
        named = [
            f"{labels[k]} (by {over[:, k].min():.3g} {units[k]} at least)"
            for k in never
        ]
        return f"{start} the limits of {listed(named)}; {_advice([labels[k] for k in never])}"
    some = np.flatnonzero(over.any(axis=0)).tolist()
    for i, j in combinations(some, 2):
        if np.all((over[:, i] > 0) | (over[:, j] > 0)):
            both = [labels[i], labels[j]]
            return f"{start} the limits of {both[0]} and of {both[1]} together; {_advice(both)}"
    named = [labels[k] for k in some]
    return f"{start} all limits together: {listed(named)}; {_advice(named)}"


def _advice(labels: Sequence[str]) -> str:
    """Lines of a set-up that would make limits possible."""
    pairs = [
        label.removeprefix("distance of ")
        for label in labels
        if label.startswith("distance of ")
    ]
    if not pairs:
        return "widen one of them, or the position limits"
    first = ", ".join(pairs[0].split(" and ", 1))
    return f"write under collisions exclude: [[{first}]], a smaller clearance, or move the obstacle away"


def _labels(constraints: Sequence[StateConstraint]) -> list[str]:
    return [label for constraint in constraints for label in constraint.labels]


DURATION = 8.0
"""Duration, s, where none is stated."""
FEWEST, MOST, FUNCTIONS = 3, 7, 56
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
        prior = np.zeros((base.rank, base.rank)) if prior is None else prior
        if prior.shape != (base.rank, base.rank):
            raise InputError(
                f"prior_information has shape {prior.shape}; the robot has {base.rank} base parameters"
            )
        centre = start_pose(_stated_centre(task), limits, task.constraints, entry.seed)
        _check_friction(centre, task.constraints)
        n = base.mechanism.degrees_of_freedom
        regressor = state_regressor(base.mechanism, base.matrix.pivots, task.smooth)
        criterion = OptimalityCriterion(entry.criterion, np.ones(base.rank))

        basis = resting_ends(family(entry, n))
        times = sample_times(basis.duration, entry.rate)
        information = Information(regressor, basis, times, task.weights, prior)
        problem = Problem(
            basis, n, information, criterion, limits.motion, task.constraints, centre
        )
        if entry.criterion == "a_optimal":
            problem = replace(
                problem,
                criterion=OptimalityCriterion("a_optimal", _sizes(problem, entry.seed)),
            )
        return Design(task, centre, problem)


def _check_friction(centre: Floats, constraints: Sequence[StateConstraint]) -> None:
    """Refuse limits of efforts that dry friction alone exceeds, which every motion has in both directions."""
    still = np.zeros((1, len(centre)))
    turning = (still - ONSET_SPEED, still + ONSET_SPEED)
    ranges = {"q": (centre[None], centre[None]), "qd": turning, "qdd": (still, still)}
    for constraint in constraints:
        if not isinstance(constraint, Enclosed):
            continue
        low, high = constraint.enclosures(ranges)
        needed, allowed = (high - low)[0] / 2, (constraint.high - constraint.low) / 2
        for k in np.flatnonzero(needed > allowed).tolist():
            unit, label = constraint.units[k], constraint.labels[k]
            problem = (
                f"no motion keeps the limit of {label}: dry friction alone needs "
                f"{needed[k]:.3g} {unit}, and {allowed[k]:.3g} {unit} are allowed"
            )
            advice = (
                "raise it under limits: effort, lower effort_margin, or hold the joint"
            )
            raise InputError(f"{problem}; {advice}", element="limits")


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
        problem.random(np.random.default_rng(seed)).reshape(problem.shape)
    )
    sizes = np.sqrt(np.diag(seen.F))
    return np.asarray(1 / np.where(sizes > 0, sizes, 1.0))


def family(entry: ExcitationEntry, count: int) -> Basis:
    """The family of motions that a set-up asks for, with any ends."""
    duration = DURATION if entry.duration is None else entry.duration
    harmonics = (
        min(max(FUNCTIONS // count, FEWEST), MOST)
        if entry.harmonics is None
        else entry.harmonics
    )
    series = Fourier(duration, harmonics)
    splines = uniform_splines(duration, entry.segments)
    return {"fourier": series, "bspline": splines, "sum": Combined((series, splines))}[
        entry.family
    ]


# -- the search --------------------------------------------------------------------------------------------------------

RANDOM = 24
"""Random motions: the best ones start the search, and all show what no search would reach."""
ROOM_TO_START = 1e-3
"""Share of a limit's size that is left at a start, so that a step has somewhere to go."""
TRIAL_STEPS = 20
"""Steps of every start, after which the best one goes on: most of what can be gained is gained then."""
SEARCH_SHARE = 0.75
"""Share of the work for the search; the rest is for making its motion safe."""
LITTLE_LESS = (0.998, 0.99)
"""Shares of a motion that are as good as the whole."""
MUCH_LESS = (0.97, 0.9, 0.75, 0.5)
"""Shares of a motion that are better than nothing.  From the first of them a search goes on, because from a limit no
step is long."""


@dataclass(frozen=True)
class Chance:
    """The best that random motions within the limits reach, each figure by itself."""

    count: int
    scaled_condition: float
    worst_std: float  # the largest standard deviation of a base parameter, SI units


@dataclass(frozen=True)
class Searched:
    """Motions that keep their limits at samples, and how they were found."""

    starts: tuple[SearchResult, ...]
    motions: tuple[Floats, ...]  # random ones

    @property
    def best_first(self) -> list[SearchResult]:
        """The solutions by their criterion."""
        return sorted(self.starts, key=lambda solution: solution.value)


def searched(design: Design, watch: Watch) -> Searched:
    """Search from the best of random motions for a few steps each, then from the best of these to the end."""
    entry, problem = design.task.entry, design.problem
    watch.tell(f"{RANDOM} random motions")
    rng = np.random.default_rng(entry.seed)
    motions = [
        problem.inside(problem.random(rng), ROOM_TO_START)
        for _ in range(max(RANDOM, entry.starts))
    ]
    best = sorted(motions, key=problem.value)[: entry.starts]
    watch.seconds -= len(motions) * problem.seconds_per_step
    reserve = watch.seconds * (1 - SEARCH_SHARE)
    watch.seconds -= reserve
    searches = []
    for k, motion in enumerate(best, 1):
        search = Search.from_start(problem, motion)
        if search is not None:
            searches.append(
                search.run(
                    min(TRIAL_STEPS, entry.iterations),
                    watch,
                    f"start {k} of {len(best)}",
                )
            )
    solutions = [search.solution for search in searches]
    if searches:
        best_one = min(range(len(searches)), key=lambda k: solutions[k].value)
        solutions[best_one] = _finished(
            problem, searches[best_one], entry.iterations, watch
        )
    watch.seconds += reserve
    return Searched(tuple(solutions), tuple(motions))


def _finished(
    problem: Problem, search: Search, most: int, watch: Watch
) -> SearchResult:
    """The search to its end, and again from a little off its limits as long as that finds something better."""
    # where many limits are near, steps are short; a little off them the way along them is free
    found = search.run(most, watch, "the best start").solution
    while found.status in ("converged", "stalled"):
        again = Search.from_start(problem, problem.scaled(found.x, MUCH_LESS[0]))
        if again is None:
            break
        next_one = again.run(
            most - found.iterations, watch, "the best start again"
        ).solution
        better = found.value - next_one.value
        steps = found.iterations + next_one.iterations
        if better > 0:
            more = tuple(value for value in next_one.history if value < found.value)
            found = replace(next_one, iterations=steps, history=(*found.history, *more))
        if better < METHOD.tolerance:
            break
    return replace(
        found, status="converged" if found.status == "stalled" else found.status
    )


# -- a motion that is safe ---------------------------------------------------------------------------------------------

ROUNDS = 5
"""Times that a motion is made smaller, or its limits tighter, until it is given up."""
TIGHTENING = 1.5
"""Factor of what a limit was broken by, by which it is tightened."""
SAFETY = 1e-4
"""Share of a motion that is given up to be on the safe side."""


def safe(
    design: Design, solutions: Sequence[SearchResult], watch: Watch
) -> tuple[Floats, list[Margin]]:
    """The best solution, changed so that every limit holds at every time, and the margins."""
    # a slightly smaller motion makes up for what is missing between samples.  Where that costs too much, the broken
    # limits are tightened and the search goes on
    worst = ""
    for solution in solutions:
        problem, x = design.problem, solution.x
        for _ in range(ROUNDS):
            watch.tell("checking all limits at every time")
            found, margins = _smaller(design, x, LITTLE_LESS)
            broken = [margin for margin in margins if not margin.kept]
            if not broken:
                return found, margins
            worst = listed([margin.label for margin in broken])
            problem = _tightened(problem, margins, design)
            starts = (problem.scaled(x, share) for share in MUCH_LESS)
            search = next(
                filter(None, (Search.from_start(problem, start) for start in starts)),
                None,
            )
            if search is None or watch.ended:
                break
            x = search.run(TRIAL_STEPS, watch, "with tighter limits").best
        found, margins = _smaller(design, solution.x, MUCH_LESS)
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
    whole = _within(design, x)
    first = margins_of(design.trajectory(whole), design.task)
    if all(margin.kept for margin in first):
        return whole, first
    for share in shares:
        found = design.problem.scaled(whole, share)
        margins = margins_of(design.trajectory(found), design.task)
        if all(margin.kept for margin in margins):
            return found, margins
    return whole, first


def _within(design: Design, x: Floats) -> Floats:
    """The motion made smaller by the little that limits of the motion are exceeded between samples."""
    problem, limits = design.problem, design.task.limits.motion
    still = motion_margins(design.trajectory(problem.at_rest), limits)
    for _ in range(
        ROUNDS
    ):  # bounds are wider than what is reached by less than what is added each time
        share = min(
            map(_share, still, motion_margins(design.trajectory(x), limits)),
            default=1.0,
        )
        if share >= 1:
            break
        x = problem.scaled(x, share - SAFETY)
    return x


def _share(still: Margin, moving: Margin) -> float:
    """The share of a motion about a pose that a limit leaves."""
    ends = (
        (still.high - still.largest, moving.largest - still.largest),
        (still.least - still.low, still.least - moving.least),
    )
    return min(
        (max(room, 0.0) / reached for room, reached in ends if reached > room),
        default=1.0,
    )


def _tightened(problem: Problem, margins: Sequence[Margin], design: Design) -> Problem:
    """The problem with tighter limits of the state where they were broken."""
    first = len(design.task.limits.motion)
    below = np.array([_excess(margin.low - margin.least) for margin in margins])
    above = np.array([_excess(margin.largest - margin.high) for margin in margins])
    below[:first] = above[:first] = 0.0
    return problem.tightened(TIGHTENING * below, TIGHTENING * above)


def _excess(beyond: float) -> float:
    """The part of a value beyond its limit; nothing where there is no limit, or where that is not known."""
    return max(beyond, 0.0) if isfinite(beyond) else 0.0
