"""Limits of mechanisms with loops at every time: bounds of all coordinates while the independent ones move on.

From a closed configuration the dependent coordinates move at rates D q̇, D = −J_D⁻¹ J_I, with q̇ of the independent ones.
A box about it is large enough for a while if the rates that are possible in it do not lead out of it: the first
configuration that left it would have got there within it.  With P a left inverse of J_D in the middle, P J_D stays near
the identity there, which bounds all that follows from J: D, velocities, accelerations and virtual velocities.  Where it
is regular all over the box, no second way of assembly lies in it.

Intervals are a middle and a radius here, because most of this is products of matrices.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from echelon.arrays import Flags, Floats
from echelon.errors import EchelonError
from echelon.excite.problem.clearance import Clearance
from echelon.excite.problem.closed_loops import FULL_WEIGHT, LoopEfforts, LoopLimits, LoopPart, loop_limits
from echelon.excite.problem.loop_motion import Closed, LoopMotion
from echelon.excite.problem.state_limits import Bounded, Enclosed
from echelon.excite.problem.trajectory import Trajectory
from echelon.excite.verify.clearance_bounds import clearance_margins
from echelon.excite.verify.margins import PER_PERIOD, Margin, ranges, reach, state_margins
from echelon.program.intervals import Interval

Around = tuple[Floats, Floats]
"""Middle and radius, of one shape."""

_TRIES = 6  # for a box that is large enough
_WIDER = 1.25  # than what would do at the least
_REGULAR = 0.9  # largest deviation of P J_D from the identity, in the norm of row sums
_ROUNDING = 1e-10  # of closed configurations, rad or characteristic lengths; relative to their size elsewhere
_WITHIN = 1e-8  # by which a configuration may leave a box, rad or characteristic lengths
_HALVINGS = 10
_SAMPLES = 500  # that tell how sharp bounds of dependent rates have to be


@dataclass(frozen=True, eq=False)
class Located:
    """Boxes about closed configurations."""

    closed: Closed  # in the middle
    found: Flags  # shape (cells,); where the box is known to hold all configurations; elsewhere nothing is known
    q: Interval  # Least and largest positions, shape (cells, positions)
    inverse: Floats  # shape (cells, dependent, equations); P; zero where the loops are not closed
    product: Around  # P J, shape (cells, dependent, velocities)


class LoopEnclosures:
    """Bounds of whole states."""

    def __init__(self, motion: LoopMotion) -> None:
        self.motion = motion

    def located(self, ranges: Mapping[str, Interval]) -> Located:
        """Positions."""
        motion, free = self.motion, self.motion.columns[0]
        begin, end = ranges["t"]
        half, (centre, way), given = (end - begin) / 2, _around(ranges["q"]), self._given(ranges["qd"])
        closed = motion.positioned(centre)
        inverse, jacobian = self._inverse(closed)
        rates = _times(inverse @ jacobian[:, :, free], given[0])
        size = _WIDER * half * np.abs(rates) + _ROUNDING
        found = np.zeros(len(way), dtype=bool)
        for _ in range(_TRIES):
            q = self._box(closed, way / motion.independent_units, size)
            product = self._product(inverse, q)
            (rates, wide), regular = self._rates(product, given)
            needed = half * (np.abs(rates) + wide) + _ROUNDING
            found = closed.done & regular & np.all(needed <= size, axis=1)
            if np.all(found | ~closed.done):
                break
            size = np.where(found[:, None], size, np.minimum(_WIDER * np.maximum(needed, size), 1.0))
        return Located(closed, found, q, inverse, product)

    def states(self, located: Located, ranges: Mapping[str, Interval]) -> dict[str, Interval]:
        """Positions, velocities and accelerations of all coordinates."""
        speeds, inverse = _ends(self._completed(located, ranges["qd"], None)), located.inverse
        middle, radius = _around(self.motion.bounds.bias_enclosures(located.q, speeds))
        opening = _times(inverse, middle), _times(np.abs(inverse), radius)
        return {"q": located.q, "qd": speeds, "qdd": _ends(self._completed(located, ranges["qdd"], opening))}

    def virtual(self, located: Located, given: Floats) -> Interval:
        """Virtual velocities of all coordinates, shape (cells, velocities, outputs), rad/s or m/s.

        Given are those that outputs determine, (velocities, outputs), in units of speeds; zero for the others.
        """
        units, (_, dependent) = self.motion.speed_units, self.motion.columns
        opened = located.product[0] @ given, located.product[1] @ np.abs(given)
        (middle, radius), _ = _solved(located.product, dependent, opened)
        found = np.repeat(given[None], len(middle), axis=0)
        wide = np.zeros_like(found)
        found[:, dependent] -= middle
        wide[:, dependent] += radius
        return _ends((found * units[:, None], wide * units[:, None]))

    def openness(self, located: Located) -> Interval:
        """Bounds of :attr:`Closed.openness`, each of shape (cells,).

        Of all left inverses of J_D the one that openness is made of is the least, and (P J_D)⁻¹ P is another one.
        """
        inverse, (_, dependent) = located.inverse, self.motion.columns
        away = _deviation(located.product, dependent)
        bound = np.linalg.solve(_nearby(away), np.abs(inverse))
        with np.errstate(divide="ignore"):
            low = 1 / np.linalg.norm(bound, axis=(1, 2))
        high = (1 + np.linalg.norm(away, axis=(1, 2))) * located.closed.openness
        return low, high

    # -- parts -----------------------------------------------------------------------------------------------------

    def _box(self, closed: Closed, way: Floats, size: Floats) -> Interval:
        """Positions that are that far away, in units of speeds."""
        motion, (free, dependent) = self.motion, self.motion.columns
        moved = np.zeros((len(way), len(motion.speed_units)))
        moved[:, free], moved[:, dependent] = way, size
        radius = motion.position_reach(moved * motion.speed_units)
        return closed.q - radius, closed.q + radius

    def _inverse(self, closed: Closed) -> tuple[Floats, Floats]:
        """P, the left inverse of J_D, and J."""
        jacobian = self.motion.bounds.jacobian(closed.q)
        found = np.zeros((len(jacobian), len(self.motion.columns[1]), jacobian.shape[1]))
        found[closed.done] = np.linalg.pinv(jacobian[closed.done][:, :, self.motion.columns[1]])
        return found, jacobian

    def _product(self, inverse: Floats, q: Interval) -> Around:
        middle, radius = _around(self.motion.bounds.jacobian_enclosures(q))
        found = inverse @ middle
        return found, np.abs(inverse) @ radius + _ROUNDING * np.abs(found)

    def _given(self, independent: Interval) -> Around:
        middle, radius = _around(independent)
        units = self.motion.speed_units[self.motion.columns[0]]
        return middle / units, radius / units

    def _rates(self, product: Around, given: Around, opening: Around | None = None) -> tuple[Around, Flags]:
        """Rates of the dependent coordinates, from those of the independent ones and P times what opens the loops."""
        free, dependent = self.motion.columns
        middle = _times(product[0][:, :, free], given[0])
        radius = _times(np.abs(product[0][:, :, free]), given[1])
        radius += _times(product[1][:, :, free], np.abs(given[0]) + given[1])
        if opening is not None:
            middle, radius = middle + opening[0], radius + opening[1]
        (found, wide), regular = _solved(product, dependent, (middle[:, :, None], radius[:, :, None]))
        return (-found[:, :, 0], wide[:, :, 0]), regular

    def _completed(self, located: Located, independent: Interval, opening: Around | None) -> Around:
        """Rates of all coordinates, SI units."""
        units, (free, dependent) = self.motion.speed_units, self.motion.columns
        given = self._given(independent)
        solved, _ = self._rates(located.product, given, opening)
        found = np.zeros((len(given[0]), len(units))), np.zeros((len(given[0]), len(units)))
        for whole, part, own in zip(found, given, solved, strict=True):
            whole[:, free], whole[:, dependent] = part, own
        return found[0] * units, found[1] * units


def _solved(product: Around, dependent: list[int], right: Around) -> tuple[Around, Flags]:
    """Bounds of (P J_D)⁻¹ R, and where P J_D is regular.

    With E = P J_D − 1, z = R − E z, and |z| ≤ (1 − |E|)⁻¹ |R|.
    """
    away = _deviation(product, dependent)
    most = np.linalg.solve(_nearby(away), np.abs(right[0]) + right[1])
    return (right[0], right[1] + away @ most), _regular(away)


def _deviation(product: Around, dependent: list[int]) -> Floats:
    """|P J_D − 1|, at the most."""
    found: Floats = np.abs(product[0][:, :, dependent] - np.eye(len(dependent))) + product[1][:, :, dependent]
    return found


def _regular(away: Floats) -> Flags:
    found: Flags = np.all(away.sum(axis=2) < _REGULAR, axis=1)
    return found


def _nearby(away: Floats) -> Floats:
    """1 − |E| where that is regular, else 1: what follows from it is of no use there."""
    found: Floats = np.eye(away.shape[1]) - np.where(_regular(away)[:, None, None], away, 0.0)
    return found


def _times(matrix: Floats, vector: Floats) -> Floats:
    found: Floats = (matrix @ vector[:, :, None])[:, :, 0]
    return found


def _around(ends: Interval) -> Around:
    low, high = ends
    middle = (low + high) / 2
    return middle, (high - low) / 2 + _ROUNDING * 1e-4 * np.abs(middle)


def _ends(found: Around) -> Interval:
    return found[0] - found[1], found[0] + found[1]


def connected(motion: LoopMotion, trajectory: Trajectory) -> bool:
    """Whether the loops stay closed from the start to the end, in one way of assembly.

    A box about the configuration in the middle of a short time holds the only configurations of this way of assembly
    then; those that are found at its ends, also by the neighbours, have to lie in it.
    """
    count = max(int(np.ceil(PER_PERIOD * trajectory.basis.frequency * trajectory.duration)), 1)
    times = np.linspace(0.0, trajectory.duration, count + 1)
    at = motion.positioned(trajectory(times)).q  # what neighbours have in common is found once
    begins, ends, first, last = times[:-1], times[1:], at[:-1], at[1:]
    enclosures = LoopEnclosures(motion)
    for _ in range(_HALVINGS):
        middles, halves = (begins + ends) / 2, (ends - begins) / 2
        located = enclosures.located(ranges(trajectory, middles, halves))
        if not located.closed.done.all():
            return False
        open_ = ~(located.found & _within(first, located.q) & _within(last, located.q))
        if not open_.any():
            return True
        middle, between = middles[open_], located.closed.q[open_]
        begins, ends = np.concatenate([begins[open_], middle]), np.concatenate([middle, ends[open_]])
        first, last = np.concatenate([first[open_], between]), np.concatenate([between, last[open_]])
    return False


def _within(q: Floats, box: Interval) -> Flags:
    found: Flags = np.all((q > box[0] - _WITHIN) & (q < box[1] + _WITHIN), axis=1)
    return found


class WholeMotion:
    """All coordinates as functions of time; what :func:`least_clearances` asks of a trajectory."""

    def __init__(self, motion: LoopMotion, trajectory: Trajectory) -> None:
        self._motion, self._trajectory = motion, trajectory
        self.coordinates, self.duration = motion.mechanism.positions, trajectory.duration
        least, largest = reach(trajectory, _rates(motion, trajectory))
        most = np.maximum(np.abs(least), np.abs(largest))
        if not np.isfinite(most).all():
            raise EchelonError("nothing bounds the velocities of the dependent coordinates")
        self._bounds = np.split(most, 3)

    def __call__(self, t: npt.ArrayLike, order: int = 0) -> Floats:
        """Positions at times, or velocities (order 1): shape (N, positions) or (N, velocities)."""
        closed = self._motion.at(*self._trajectory.states(t))
        return closed.qd if order else closed.q

    def bounds(self, order: int) -> Floats:
        """Upper bounds of |q| of single coordinates (order 0), |q̇| or |q̈|, shape (velocities,)."""
        return self._bounds[order]


@dataclass(frozen=True, eq=False)
class _Rates(Bounded):
    """Single positions, velocities and accelerations."""

    motion: LoopMotion

    def enclosures(self, ranges: Mapping[str, Interval]) -> Interval:
        """Bounds of the rates while independent states stay in intervals."""
        enclosures = LoopEnclosures(self.motion)
        located = enclosures.located(ranges)
        states = enclosures.states(located, ranges)
        single = tuple(self.motion.single(end) for end in states["q"])
        least, largest = (np.hstack([single[k], states["qd"][k], states["qdd"][k]]) for k in (0, 1))
        unknown = ~located.found[:, None]
        return np.where(unknown, -np.inf, least), np.where(unknown, np.inf, largest)


def _rates(motion: LoopMotion, trajectory: Trajectory) -> _Rates:
    """Between limits far beyond what they reach."""
    closed = motion.at(*trajectory.states(np.linspace(0.0, trajectory.duration, _SAMPLES)))
    high = 2.0 * np.abs(np.hstack([motion.single(closed.q), closed.qd, closed.qdd])).max(axis=0) + 1e-3
    labels = ("",) * len(high)
    return _Rates(labels, labels, -high, high, motion)


def loop_margins(trajectory: Trajectory, limits: LoopLimits) -> list[Margin]:
    """How far a trajectory stays from the limits, in their order.

    Where the loops cannot be closed, or another way of assembly turns up, no margin is left to singular poses, and all
    others count as broken.
    """
    parts = limits.parts
    if not connected(limits.motion, trajectory):
        fields = zip(limits.labels, limits.units, limits.low.tolist(), limits.high.tolist(), strict=True)
        return [Margin(*field, -np.inf if k else 0.0, np.inf) for k, field in enumerate(fields)]
    bounded = [part for part in parts if isinstance(part, LoopEfforts) or isinstance(part.constraint, Enclosed)]
    found = iter(state_margins(trajectory, _whole(limits, bounded)))
    margins = [next(found)]
    for part in parts:
        if isinstance(part, LoopPart) and isinstance(part.constraint, Clearance):
            margins += clearance_margins(WholeMotion(limits.motion, trajectory), part.constraint)
        else:
            margins += [next(found) for _ in part.constraint.labels]
    return margins


@dataclass(frozen=True, eq=False)
class _Whole(Bounded):
    """Openness and all parts that are functions of the state; what :func:`state_margins` bounds."""

    limits: LoopLimits

    def enclosures(self, ranges: Mapping[str, Interval]) -> Interval:
        """Bounds of the functions while independent states stay in intervals."""
        limits, enclosures = self.limits, LoopEnclosures(self.limits.motion)
        located = enclosures.located(ranges)
        states = enclosures.states(located, ranges)
        first = tuple(end[:, None] / limits.motion.reference for end in enclosures.openness(located))
        found = [first, *(_bounded(part, enclosures, located, states) for part in limits.parts)]
        unknown = ~located.found[:, None]
        least, largest = (np.hstack([ends[k] for ends in found]) for k in (0, 1))
        return np.where(unknown, -np.inf, least), np.where(unknown, np.inf, largest)


def _whole(limits: LoopLimits, parts: Sequence[LoopPart | LoopEfforts]) -> _Whole:
    found = loop_limits(limits.motion, parts, FULL_WEIGHT)
    return _Whole(found.labels, found.units, found.low, found.high, found)


def _bounded(
    part: LoopPart | LoopEfforts, enclosures: LoopEnclosures, located: Located, states: Mapping[str, Interval]
) -> Interval:
    """Bounds of functions while the whole state stays in intervals, without smoothing, each of shape (cells, m)."""
    if isinstance(part, LoopPart):
        assert isinstance(part.constraint, Enclosed)
        return part.constraint.enclosures(states)
    names, units = enclosures.motion.mechanism.velocities, enclosures.motion.speed_units
    given = np.array([[chosen.get(name, 0.0) for chosen in part.chosen_speeds] for name in names]) / units[:, None]
    free = enclosures.motion.columns[0]
    low, high = enclosures.virtual(located, given)
    whole = {**states, **{f"v{k}": (low[:, :, k], high[:, :, k]) for k in range(low.shape[2])}}
    ranges = {"q": states["q"], **{kind: _columns(states[kind], free) for kind in ("qd", "qdd")}}
    for kind, places, argument in part.bounded_nodes:
        low, high = _columns(whole[kind], places)
        ranges[argument.name] = np.hstack([low, -high]), np.hstack([high, -low])
    return part.constraint.enclosures(ranges, [argument for _, _, argument in part.bounded_nodes])


def _columns(ends: Interval, places: Sequence[int]) -> Interval:
    return ends[0][:, places], ends[1][:, places]
