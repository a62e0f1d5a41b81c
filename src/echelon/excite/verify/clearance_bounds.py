"""Lower bounds of clearances at every time, not only at samples.

Between two bodies whose points move against each other with at most some speed, a distance can fall from its value at a
time no faster than that.  So a measured distance vouches for an interval about its time; where the interval is too long
for what is to be shown, it is halved (conservative advancement: B. Mirtich, PhD thesis, Berkeley, 1996).  Speeds are
bounded by those of the joints times :class:`MotionBounds`, which hold at any pose; those of the joints by the bounds of
the trajectory's family, and near a time by the speed there and the bound of accelerations.  Measured distances count
only as far as a pair of parallel planes between the shapes confirms them, so apart from the rounding of single sums the
bounds are rigorous.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats, Integers
from echelon.errors import InputError
from echelon.exact.polynomial import Polynomial
from echelon.excite.problem.clearance import Clearance
from echelon.excite.problem.shapes import Shape, extent, plane_gaps
from echelon.excite.problem.trajectory import Trajectory
from echelon.excite.verify.margins import Margin
from echelon.mechanism.joint import GROUND, Motion, MotionKind, Placement, Step
from echelon.mechanism.mechanism import Mechanism
from echelon.mechanism.stated import placement_matrix, symbol_values


class MotionBounds:
    """How far points can move against each other per speed of each coordinate, at any pose.

    A rigid motion of both shapes changes no distance, so only joints between their bodies and the nearest body that
    carries both count.  A joint moves a point by its distance from the axis: at most the lengths of all placements
    behind it along the chain, the travel of sliding joints, and the extent of the shape about its body's origin.
    """

    def __init__(self, mechanism: Mechanism, positions: Floats) -> None:
        self.mechanism = mechanism
        self._column = {name: k for k, name in enumerate(mechanism.velocities)}
        used = {s for body in mechanism.bodies for s in body.joint.symbols()}
        functions = [function for coupling in mechanism.couplings for _, function in coupling.terms]
        used |= {s for function in functions for value in function.expressions for s in value.symbols()}
        self._symbols = symbol_values(mechanism, sorted(used))
        self._weights = {m.name: self._weighted(m.name, positions) for m in mechanism.motions}
        self._most = {name: float(weights @ positions) for name, weights in self._weights.items()}

    def between(self, first: Shape, second: Shape) -> Floats:
        """Bounds of the speed of points of one shape against those of another per |q̇_k|, shape (n,), m per rad or m."""
        carried = set(self._up(first.body)) & set(self._up(second.body))
        return self._along(first, carried) + self._along(second, carried)

    def _along(self, shape: Shape, carried: set[int]) -> Floats:
        """Bounds for the joints between a shape and the bodies that carry both."""
        total = np.zeros(len(self._column))
        path = [body for body in self._up(shape.body) if body not in carried]
        length = extent(shape) if path else 0.0
        for step in (step for body in path for step in reversed(self.mechanism.bodies[body].joint.steps)):
            if isinstance(step, Motion):
                total += self._speed(step, length) * self._weights[step.name]
            length += self._length(step)
        return total

    def _speed(self, motion: Motion, length: float) -> float:
        """Speed of points at most a length away from the moved frame's origin, per speed of the coordinate."""
        if motion.kind is MotionKind.TRANSLATION:
            return 1.0
        return float(np.hypot(length, self._number(motion.pitch)))

    def _length(self, step: Step) -> float:
        """How far a step can bring the frame."""
        if isinstance(step, Placement):
            return float(np.linalg.norm(placement_matrix(step, self._symbols)[:3, 3]))
        if step.kind is MotionKind.TRANSLATION:
            return self._most[step.name]
        return abs(self._number(step.pitch)) * self._most[step.name]

    def _weighted(self, name: str, positions: Floats) -> Floats:
        """Upper bounds of |dq/dq_k| of a coordinate by the independent ones."""
        weights = np.zeros(len(self._column))
        coupling = next((c for c in self.mechanism.couplings if c.coordinate == name), None)
        if coupling is None:
            motion = next(m for m in self.mechanism.motions if m.name == name)
            weights[[self._column[velocity] for velocity in motion.velocities]] = 1.0
            return weights
        for leader, function in coupling.terms:
            column = self._column[leader]
            weights[column] += function.steepest(float(positions[column]), self._symbols)
        return weights

    def _number(self, value: Polynomial) -> float:
        return value.at(self._symbols) if value else 0.0

    def _up(self, body: int) -> Iterator[int]:
        while body != GROUND:
            yield body
            body = self.mechanism.bodies[body].parent


_FIRST = 64  # intervals to begin with
_BATCH = 4096  # intervals that are looked at together
_TOUCH = 0.05
"""Share of the clearance by which a distance may be larger than its bound."""
_SPARE = 0.25  # share of the room above the clearance that a bound may give away


@dataclass(frozen=True)
class LeastClearances:
    """Bounds of the smallest distances of a trajectory."""

    labels: tuple[str, ...]  # ``"distance of link2 and link5"``
    bounds: Floats  # shape (m,); no distance is smaller at any time, m; at most the reach
    found: Floats  # shape (m,); the smallest distance that was measured, m; the reach where none was smaller
    times: Floats  # shape (m,); when, s; 0 where none was smaller than the reach


def least_clearances(clearance: Clearance, trajectory: Trajectory, tolerance: float = 1e-3) -> LeastClearances:
    """Lower bounds of all distances over all times of a trajectory.

    A bound is within the tolerance of the smallest distance, or within a quarter of what lies between this and the
    clearance that is required: exact where it matters, quick where it does not.
    """
    if trajectory.coordinates != clearance.mechanism.positions:
        wanted, got = ", ".join(clearance.mechanism.positions), ", ".join(trajectory.coordinates)
        raise InputError(f"the trajectory must move the positions {wanted}, in this order; it moves {got}")
    return _Search(clearance, trajectory, tolerance).run()


def clearance_margins(trajectory: Trajectory, clearance: Clearance) -> list[Margin]:
    """How near bodies come to each other."""
    least = least_clearances(clearance, trajectory, _TOUCH * clearance.low.max(initial=0.0) or _TOUCH)
    return [
        Margin(label, "m", low, np.inf, bound, np.inf)
        for label, low, bound in zip(least.labels, clearance.low.tolist(), least.bounds.tolist(), strict=True)
    ]


class _Search:
    """Intervals of time, each for a pair of shapes, that are halved until their bounds are good enough."""

    def __init__(self, clearance: Clearance, trajectory: Trajectory, tolerance: float) -> None:
        self.clearance, self.trajectory, self.tolerance = clearance, trajectory, tolerance
        self.most = [trajectory.bounds(order) for order in range(3)]
        bounds = MotionBounds(clearance.mechanism, self.most[0])
        shapes, pairs = clearance.shapes, clearance.pairs.tolist()
        n = len(clearance.mechanism.velocities)
        self.motion_bounds = np.array([bounds.between(shapes[i], shapes[j]) for i, j in pairs]).reshape(-1, n)
        count = len(clearance.owners)
        self.bounds, self.found = np.full(count, clearance.reach), np.full(count, clearance.reach)
        self.times = np.zeros(count)

    def run(self) -> LeastClearances:
        """Halve intervals until none is left."""
        half = self.trajectory.duration / (2 * _FIRST)
        middle = np.repeat(half * (1 + 2 * np.arange(_FIRST)), len(self.motion_bounds))
        pair = np.tile(np.arange(len(self.motion_bounds)), _FIRST)
        while len(middle):
            parts = [slice(k, k + _BATCH) for k in range(0, len(middle), _BATCH)]
            left = np.concatenate([self._examined(middle[part], pair[part], half) for part in parts])
            half /= 2
            middle = np.concatenate([middle[left] - half, middle[left] + half])
            order = np.argsort(middle, kind="stable")
            middle, pair = middle[order], np.tile(pair[left], 2)[order]
        return LeastClearances(self.clearance.labels, self.bounds, self.found, self.times)

    def _examined(self, middle: Floats, pair: Integers, half: float) -> npt.NDArray[np.bool_]:
        """Bound distances over intervals about some times; True for those that have to be halved."""
        times, at = np.unique(middle, return_inverse=True)
        places = self.clearance.places(self.trajectory(times))
        falls = half * np.einsum("kn,kn->k", self.motion_bounds[pair], self._speeds(times, half)[at])
        lower = self.clearance.spheres.gaps(places, self.clearance.pairs)[at, pair]
        group = self.clearance.groups[pair]
        asked = np.flatnonzero(lower - falls < self._goals()[group])
        lower[asked] = np.maximum(lower[asked], self._measured(places, times, at[asked], pair[asked]))
        # half of the tolerance ends every search, also where a distance could not be confirmed
        good = (lower - falls >= self._goals()[group]) | (falls <= self.tolerance / 2)
        np.minimum.at(self.bounds, group[good], (lower - falls)[good])
        return np.asarray(~good)

    def _speeds(self, times: Floats, half: float) -> Floats:
        """Upper bounds of |q̇| in intervals about some times, shape (times, n)."""
        near = np.abs(self.trajectory(times, 1)) + half * self.most[2]
        return np.minimum(near, self.most[1])

    def _goals(self) -> Floats:
        """Bounds that are good enough, by what was found so far; they never rise."""
        spare = np.abs(self.found - self.clearance.low)
        return np.asarray(self.found - np.maximum(self.tolerance, _SPARE * spare))

    def _measured(self, places: Floats, times: Floats, at: Integers, pair: Integers) -> Floats:
        """Confirmed distances of pairs of shapes at some of the times; smallest ones are kept."""
        ends, shapes = self.clearance.pairs[pair], self.clearance.shapes
        # nothing is further away than this
        far = 2 * float(np.abs(places[..., 3]).max() + self.clearance.spheres.size) + self.clearance.reach
        measured = self.clearance.engine.measure(places, np.column_stack([at, ends]), far)
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
        self.found[group[better]], self.times[group[better]] = least[better], when[better]
