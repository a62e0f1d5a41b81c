"""Margins: how far a trajectory stays from each limit, at every time and not only at samples.

Limits of the motion: between samples a function exceeds the larger one by at most h²/8 times the bound of its second
derivative, which follows from the coefficients.  Limits of the state: q, q̇ and q̈ stay in intervals around the middle
of a short cell of time, and interval arithmetic over the recorded function bounds what it does there; cells are halved
where that bound says too little.

With closed loops interval arithmetic says nothing useful of dependent coordinates: quotients of intervals grow.  There
a motion is looked at so often that a parabola through three samples gives its extremes, and margins say so.

Distances: between two bodies whose points move against each other with at most some speed, a distance can fall from
its value at a time no faster than that.  So a measured distance vouches for an interval about its time; where the
interval is too long for what is to be shown, it is halved (conservative advancement: B. Mirtich, PhD thesis, Berkeley,
1996).  Speeds are bounded by those of the joints times :class:`MotionBounds`, which hold at any pose; those of the
joints by the bounds of the trajectory's family, and near a time by the speed there and the bound of accelerations.
Measured distances count only as far as a pair of parallel planes between the shapes confirms them, so apart from the
rounding of single sums the bounds are rigorous.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from math import inf, isfinite, isnan
from typing import Any

import numpy as np
import numpy.typing as npt

from echelon.algebra import Interval, Polynomial
from echelon.excite.problem.clearance import Clearance
from echelon.excite.problem.closed_loops import (
    FULL_WEIGHT,
    Closed,
    LoopLimits,
    LoopMotion,
)
from echelon.excite.problem.shapes import Shape, extent, plane_gaps
from echelon.excite.problem.state_limits import Enclosed, MotionLimit, StateConstraint
from echelon.excite.problem.task import Task
from echelon.excite.problem.trajectory import Trajectory
from echelon.loops import LARGEST_CORRECTION, largest, position_rates
from echelon.robot import (
    GROUND,
    Mechanism,
    Motion,
    MotionKind,
    Placement,
    Step,
    placement_matrix,
    symbol_values,
)
from echelon.shared import EchelonError, Floats, InputError, Integers

ACTIVE = 0.02
"""Share of a limit's range within which it counts as active."""


@dataclass(frozen=True)
class Margin:
    """One limit and how far a trajectory stays from it."""

    label: str  # ``"velocity of j3"``
    unit: str
    low: float  # the limit, SI units; infinite for none
    high: float
    least: float  # bounds of what the trajectory reaches at any time: it goes neither below nor above
    largest: float
    sampled: bool = (
        False  # whether they are those of samples only, as with closed loops
    )

    @property
    def margin(self) -> float:
        """Distance to the nearer end, negative if the limit is broken."""
        if isnan(self.least) or isnan(self.largest):
            return -inf  # an unknown value counts as broken
        below = inf if self.low == -inf else self.least - self.low
        return min(below, inf if self.high == inf else self.high - self.largest)

    @property
    def relative(self) -> float:
        """The margin as a share of the limit's range, or of its size where it has one end only."""
        span = self.high - self.low
        size = (
            span
            if abs(span) < inf
            else abs(self.low if abs(self.low) < inf else self.high)
        )
        return self.margin / size if size else self.margin

    @property
    def used(self) -> float | None:
        """Share of the way from the middle of the range to its ends that is used; None for limits with one end."""
        return 1 - 2 * self.relative if isfinite(self.high - self.low) else None

    @property
    def kept(self) -> bool:
        """Whether the limit holds, at every time unless margins are :attr:`sampled`."""
        return self.margin >= 0

    @property
    def active(self) -> bool:
        """Whether the trajectory comes near the limit."""
        return self.kept and self.relative < ACTIVE


def used_limits(margins: Iterable[Margin]) -> str:
    """The largest share that is used of each kind of limit, in words.

    >>> used_limits([Margin("velocity of j1", "rad/s", -2.0, 2.0, -1.0, 1.5)])
    'velocity 75 % (j1)'
    """
    most: dict[str, tuple[float, str]] = {}
    for margin in margins:
        kind, _, name = margin.label.partition(" of ")
        if margin.used is not None:
            most[kind] = max(most.get(kind, (-inf, "")), (margin.used, name))
    return ", ".join(
        f"{kind} {100 * share:.3g} % ({name})" for kind, (share, name) in most.items()
    )


def when_kept(margins: Iterable[Margin]) -> str:
    """Where limits are known to hold, in words."""
    if any(margin.sampled for margin in margins):
        return (
            "at samples only: with closed loops nothing bounds the motion between them"
        )
    return "at every time"


SHARP = 1e-3
"""Share of a limit's range by which bounds may be wider than what is reached."""
SPARE = 0.25
"""Share of the distance to a limit by which bounds may be wider than what is reached, where that is more."""
CELLS_PER_PERIOD = 10
"""Cells of time per period of the highest frequency, at first."""
HALVINGS = 12
"""Halvings of a cell until what intervals still allow counts as reached, as where a function jumps."""


def margins_between(
    limits: StateConstraint, least: Floats, largest: Floats, **known: Any
) -> list[Margin]:
    """Margins of functions of the state, from what they reach, each of shape (m,)."""
    ends = (
        part.tolist()
        for part in (known.pop("low", limits.low), limits.high, least, largest)
    )
    return [
        Margin(*fields, **known)
        for fields in zip(limits.labels, limits.units, *ends, strict=True)
    ]


def reach(trajectory: Trajectory, limits: Enclosed) -> tuple[Floats, Floats]:
    """Bounds of functions of the state at any time, each of shape (m,)."""
    count = _per_period(CELLS_PER_PERIOD, trajectory)
    edges = np.linspace(0.0, trajectory.duration, count + 1)
    middles, halves = (edges[1:] + edges[:-1]) / 2, np.diff(edges) / 2
    m = len(limits.labels)
    least, largest = (
        np.full(m, np.inf),
        np.full(m, -np.inf),
    )  # of cells that need not be halved
    met = np.full(m, np.inf), np.full(m, -np.inf)
    for halving in range(HALVINGS + 1):
        points = limits.enclosures(ranges(trajectory, middles, 0 * halves))
        met = (
            np.minimum(met[0], points[0].min(axis=0)),
            np.maximum(met[1], points[1].max(axis=0)),
        )
        low, high = limits.enclosures(ranges(trajectory, middles, halves))
        below, above = _tolerances(limits, *met)
        vague = np.any((high > met[1] + above) | (low < met[0] - below), axis=1)
        vague &= halving < HALVINGS
        least = np.minimum(least, low[~vague].min(axis=0, initial=np.inf))
        largest = np.maximum(largest, high[~vague].max(axis=0, initial=-np.inf))
        if not vague.any():
            break
        halves = np.repeat(halves[vague] / 2, 2)
        middles = np.repeat(middles[vague], 2) + halves * np.tile(
            [-1.0, 1.0], len(halves) // 2
        )
    return least, largest


def _per_period(count: int, trajectory: Trajectory) -> int:
    """Number of parts of a trajectory, a number for each period of its highest frequency."""
    periods = trajectory.basis.frequency * trajectory.duration
    return max(int(np.ceil(count * periods)), 2)


def _tolerances(limits: Enclosed, low: Floats, high: Floats) -> tuple[Floats, Floats]:
    """By how much bounds may be wider than what was met: far from a limit, kept or broken, by much."""
    span = limits.high - limits.low
    sharp = SHARP * np.where(
        np.isfinite(span),
        span,
        np.maximum(np.abs(np.nan_to_num(limits.low, neginf=0.0)), 1.0),
    )
    room = (
        np.nan_to_num(low - limits.low, posinf=np.inf),
        np.nan_to_num(limits.high - high, posinf=np.inf),
    )
    return np.maximum(sharp, SPARE * np.abs(room[0])), np.maximum(
        sharp, SPARE * np.abs(room[1])
    )


def ranges(
    trajectory: Trajectory, middles: Floats, halves: Floats
) -> dict[str, Interval]:
    """Intervals of q, q̇ and q̈ in cells of time, by Taylor's theorem."""
    h = halves[:, None]
    found: dict[str, Interval] = {}
    for order, name in enumerate(("q", "qd", "qdd")):
        centre = trajectory(middles, order)
        reach = h * np.abs(
            trajectory(middles, order + 1)
        ) + h**2 / 2 * trajectory.bounds(order + 2)
        found[name] = (centre - reach, centre + reach)
    return found


_SHARPER = (SHARP, SHARP / 100, SHARP / 10_000)
"""Share of a limit's range by which bounds may be wider than what is reached: one after the other where that decides
whether a limit is kept."""
SAMPLES_PER_PERIOD = 200
"""Samples per period of the highest frequency: between them a sine rises by 0.01 % of its amplitude."""
MOST_SAMPLES = 1_000_000
"""Samples of a limit of the motion: bounds of motions with more periods are wider than they need be."""


def motion_margins(
    trajectory: Trajectory, limits: Iterable[MotionLimit]
) -> list[Margin]:
    """Margins of positions and their derivatives."""
    return [_motion_margin(trajectory, limit) for limit in limits]


def _motion_margin(trajectory: Trajectory, limit: MotionLimit) -> Margin:
    combined = trajectory.coefficients @ limit.weights[:, None]
    curvature = float(trajectory.basis.bounds(combined, limit.order + 2)[0])
    span = limit.high - limit.low
    size = (
        span
        if np.isfinite(span)
        else max(abs(x) for x in (limit.low, limit.high) if np.isfinite(x))
    )
    coarse = min(_per_period(SAMPLES_PER_PERIOD, trajectory), MOST_SAMPLES)
    for sharp in _SHARPER:
        step = (
            np.sqrt(8 * sharp * size / curvature)
            if curvature > 0 and size > 0
            else np.inf
        )
        count = int(np.clip(trajectory.duration / step, coarse, MOST_SAMPLES))
        times = np.linspace(0.0, trajectory.duration, count + 1)
        values = trajectory.basis.motion(times, combined, limit.order)
        more = curvature * (trajectory.duration / count) ** 2 / 8
        least, largest = float(values.min()), float(values.max())
        # where the bound breaks a limit that the samples keep, more samples decide
        if (
            least < limit.low
            or largest > limit.high
            or (least - more >= limit.low and largest + more <= limit.high)
        ):
            break
    return Margin(
        limit.label, limit.unit, limit.low, limit.high, least - more, largest + more
    )


def loop_margins(trajectory: Trajectory, limits: LoopLimits) -> list[Margin]:
    """Margins of a trajectory with closed loops, at samples, in the order of the limits.

    Where the loops cannot be closed, or another way of assembly turns up, no margin is left to singular poses, and all
    others count as broken.
    """
    count = _per_period(SAMPLES_PER_PERIOD, trajectory)
    times = np.linspace(0.0, trajectory.duration, count + 1)
    states = trajectory.states(times)
    low = np.array([FULL_WEIGHT, *limits.low[1:]])
    closed = limits.motion.positioned(states[0])
    if not connected(limits.motion, closed, states[1], times[1]):
        nothing = np.full(len(low), -np.inf)
        nothing[0] = 0.0
        return margins_between(
            limits, nothing, np.full(len(low), np.inf), low=low, sampled=True
        )
    values = limits.values(*states)
    return margins_between(
        limits, -_peaks(-values), _peaks(values), low=low, sampled=True
    )


def connected(motion: LoopMotion, closed: Closed, qd: Floats, step: float) -> bool:
    """Whether loops stay closed in one way of assembly: each sample is where the velocities about it lead."""
    if not closed.done.all():
        return False
    rates = motion.velocities(closed, qd)
    middle, mean = (closed.q[1:] + closed.q[:-1]) / 2, (rates[1:] + rates[:-1]) / 2
    moved = position_rates(motion.mechanism, middle, step * mean)
    away = largest((np.diff(closed.q, axis=0) - moved) / motion.position_units)
    return bool(np.all(away < LARGEST_CORRECTION))


def _peaks(values: Floats) -> Floats:
    """Largest value of each column: of the samples, and of parabolas through samples and their neighbours."""
    before, here, after = values[:-2], values[1:-1], values[2:]
    bend = 2 * here - before - after
    top = (here >= before) & (here >= after) & (bend > 0)
    rise = np.where(top, (after - before) ** 2 / (8 * np.where(top, bend, 1.0)), 0.0)
    found: Floats = np.maximum(values.max(axis=0), (here + rise).max(axis=0))
    return found


# -- distances ---------------------------------------------------------------------------------------------------------


class MotionBounds:
    """Bounds of the speed of points against each other per speed of each coordinate, at any pose.

    A rigid motion of both shapes changes no distance, so only joints between their bodies and the nearest body that
    carries both count.  A joint moves a point by its distance from the axis: at most the lengths of all placements
    behind it along the chain, the travel of sliding joints, and the extent of the shape about its body's origin.
    """

    def __init__(self, mechanism: Mechanism, positions: Floats) -> None:
        self.mechanism = mechanism
        self._column = {name: k for k, name in enumerate(mechanism.velocities)}
        used = {s for body in mechanism.bodies for s in body.joint.symbols()}
        functions = [
            function
            for coupling in mechanism.couplings
            for _, function in coupling.terms
        ]
        used |= {
            s
            for function in functions
            for value in function.expressions
            for s in value.symbols()
        }
        self._symbols = symbol_values(mechanism, sorted(used))
        self._weights = {
            m.name: self._weighted(m.name, positions) for m in mechanism.motions
        }
        self._most = {
            name: float(weights @ positions) for name, weights in self._weights.items()
        }

    def between(self, first: Shape, second: Shape) -> Floats:
        """Bounds of the speed of points of one shape against those of another per |q̇_k|, shape (n,), m per rad or m."""
        carried = set(self._up(first.body)) & set(self._up(second.body))
        return self._along(first, carried) + self._along(second, carried)

    def _along(self, shape: Shape, carried: set[int]) -> Floats:
        """Bounds for the joints between a shape and the bodies that carry both."""
        total = np.zeros(len(self._column))
        path = [body for body in self._up(shape.body) if body not in carried]
        length = extent(shape) if path else 0.0
        for step in (
            step
            for body in path
            for step in reversed(self.mechanism.bodies[body].joint.steps)
        ):
            if isinstance(step, Motion):
                # of points at most a length away from the moved frame's origin, per speed of the coordinate
                slides = step.kind is MotionKind.TRANSLATION
                speed = (
                    1.0 if slides else float(np.hypot(length, self._number(step.pitch)))
                )
                total += speed * self._weights[step.name]
            length += self._length(step)
        return total

    def _length(self, step: Step) -> float:
        """The largest distance by which a step moves the frame, m."""
        if isinstance(step, Placement):
            return float(np.linalg.norm(placement_matrix(step, self._symbols)[:3, 3]))
        if step.kind is MotionKind.TRANSLATION:
            return self._most[step.name]
        return abs(self._number(step.pitch)) * self._most[step.name]

    def _weighted(self, name: str, positions: Floats) -> Floats:
        """Upper bounds of |dq/dq_k| of a coordinate by the independent ones."""
        weights = np.zeros(len(self._column))
        coupling = next(
            (c for c in self.mechanism.couplings if c.coordinate == name), None
        )
        if coupling is None:
            motion = next(m for m in self.mechanism.motions if m.name == name)
            weights[[self._column[velocity] for velocity in motion.velocities]] = 1.0
            return weights
        for leader, function in coupling.terms:
            column = self._column[leader]
            weights[column] += function.steepest(
                float(positions[column]), self._symbols
            )
        return weights

    def _number(self, value: Polynomial) -> float:
        return value.at(self._symbols) if value else 0.0

    def _up(self, body: int) -> Iterator[int]:
        while body != GROUND:
            yield body
            body = self.mechanism.bodies[body].parent


BATCH = 4096
"""Intervals that are looked at together, so that tables of their shapes stay small."""
TOLERANCE = 0.05
"""Share of the clearance, or without one of a metre, by which a distance may be larger than its bound."""
FINEST = 0.02
"""Share of the tolerance that a bound may give away however little room there is."""


class LeastClearances:
    """Lower bounds of all distances over all times of a trajectory.

    Intervals of time, each for a pair of shapes, are halved until a bound is within a quarter of what lies between the
    smallest distance and the clearance that is required, or, where this is broken, within the tolerance: exact where it
    matters, quick where it does not.
    """

    def __init__(
        self, clearance: Clearance, trajectory: Trajectory, tolerance: float
    ) -> None:
        if trajectory.coordinates != clearance.mechanism.positions:
            wanted = ", ".join(clearance.mechanism.positions)
            got = ", ".join(trajectory.coordinates)
            raise InputError(
                f"the trajectory must move the positions {wanted}, in this order; it moves {got}"
            )
        self.clearance = clearance
        self.trajectory = trajectory
        self.tolerance = tolerance
        self.most = [trajectory.bounds(order) for order in range(3)]
        bounds = MotionBounds(clearance.mechanism, self.most[0])
        shapes, pairs = clearance.shapes, clearance.pairs.tolist()
        n = len(clearance.mechanism.velocities)
        self.motion_bounds = np.array(
            [bounds.between(shapes[i], shapes[j]) for i, j in pairs]
        ).reshape(-1, n)
        count = len(clearance.owners)
        self.bounds = np.full(
            count, clearance.reach
        )  # no distance is smaller at any time, m; at most the reach
        self.found = self.bounds.copy()  # the smallest distances that were measured, m
        self.times = np.zeros(count)  # when, s; 0 where none was smaller than the reach
        self._run()

    def _run(self) -> None:
        """Halve intervals until none is left."""
        half = self.trajectory.duration / 2
        pair = np.arange(len(self.motion_bounds))
        middle = np.full(len(pair), half)
        while len(middle):
            parts = [slice(k, k + BATCH) for k in range(0, len(middle), BATCH)]
            left = np.concatenate(
                [self._examined(middle[part], pair[part], half) for part in parts]
            )
            half /= 2
            middle = np.concatenate([middle[left] - half, middle[left] + half])
            order = np.argsort(middle, kind="stable")
            middle, pair = middle[order], np.tile(pair[left], 2)[order]

    def _examined(
        self, middle: Floats, pair: Integers, half: float
    ) -> npt.NDArray[np.bool_]:
        """Bound distances over intervals about some times; True for those that have to be halved."""
        times, at = np.unique(middle, return_inverse=True)
        places = self.clearance.places(self.trajectory(times))
        falls = half * np.einsum(
            "kn,kn->k", self.motion_bounds[pair], self._speeds(times, half)[at]
        )
        lower = self.clearance.spheres.gaps(places, self.clearance.pairs)[at, pair]
        group = self.clearance.groups[pair]
        asked = np.flatnonzero(lower - falls < self._goals()[group])
        lower[asked] = np.maximum(
            lower[asked], self._measured(places, times, at[asked], pair[asked])
        )
        # half of the tolerance ends every search, also where a distance could not be confirmed
        good = (lower - falls >= self._goals()[group]) | (
            falls <= self._slack()[group] / 2
        )
        np.minimum.at(self.bounds, group[good], (lower - falls)[good])
        return np.asarray(~good)

    def _speeds(self, times: Floats, half: float) -> Floats:
        """Upper bounds of |q̇| in intervals about some times, shape (times, n)."""
        near = np.abs(self.trajectory(times, 1)) + half * self.most[2]
        return np.minimum(near, self.most[1])

    def _goals(self) -> Floats:
        """Bounds that are good enough, by what was found so far; they never rise."""
        return np.asarray(self.found - self._slack())

    def _slack(self) -> Floats:
        """By how much bounds may be below the distances that were found, m: little where that decides."""
        room = self.found - self.clearance.low
        least = np.where(room > 0, FINEST * self.tolerance, self.tolerance)
        return np.asarray(np.maximum(least, SPARE * np.abs(room)))

    def _measured(
        self, places: Floats, times: Floats, at: Integers, pair: Integers
    ) -> Floats:
        """Confirmed distances of pairs of shapes at some of the times; smallest ones are kept."""
        ends, shapes = self.clearance.pairs[pair], self.clearance.shapes
        # nothing is further away than this
        far = (
            2 * float(np.abs(places[..., 3]).max() + self.clearance.spheres.size)
            + self.clearance.reach
        )
        measured = self.clearance.engine.measure(
            places, np.column_stack([at, ends]), far
        )
        self._keep(measured.distances, times[at], self.clearance.groups[pair])
        lower = np.empty(len(pair))
        for one in np.unique(pair).tolist():
            i, j = self.clearance.pairs[one]
            some = np.flatnonzero(pair == one)
            both = places[at[some], i], places[at[some], j]
            lower[some] = plane_gaps(shapes[i], shapes[j], both, measured.points[some])
        return lower

    def _keep(self, distances: Floats, times: Floats, groups: Integers) -> None:
        order = np.argsort(distances, kind="stable")
        group, first = np.unique(groups[order], return_index=True)
        least, when = distances[order][first], times[order][first]
        better = least < self.found[group]
        self.found[group[better]], self.times[group[better]] = (
            least[better],
            when[better],
        )


# -- all limits --------------------------------------------------------------------------------------------------------


def margins_of(trajectory: Trajectory, task: Task) -> list[Margin]:
    """Margins of a trajectory to all limits, first those of the motion, then those of the state in their order."""
    found = motion_margins(trajectory, task.limits.motion)
    for constraint in task.constraints:
        if isinstance(constraint, Enclosed):
            found += margins_between(constraint, *reach(trajectory, constraint))
        elif isinstance(constraint, Clearance):
            tolerance = TOLERANCE * constraint.low.max(initial=0.0) or TOLERANCE
            least = LeastClearances(constraint, trajectory, tolerance).bounds
            found += margins_between(constraint, least, np.full(len(least), np.inf))
        elif isinstance(constraint, LoopLimits):
            found += loop_margins(trajectory, constraint)
        else:
            raise EchelonError(
                f"nothing bounds {', '.join(constraint.labels[:3])} between samples"
            )
    return found
