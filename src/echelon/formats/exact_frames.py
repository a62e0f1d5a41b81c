"""Exact frames next to rounded ones: rational directions, parallel or perpendicular as meant, and short decimals."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import combinations, product
from math import atan2, cos, hypot, pi, sin, tan

import numpy as np

from echelon.arrays import Floats
from echelon.exact.expressions import STEPS_PER_HALF_TURN, Angle
from echelon.exact.polynomial import Polynomial, as_polynomial, circle_point, parts_of
from echelon.formats.snapping import LENGTH_TOLERANCE, PRECISION
from echelon.inertia import rotation_quaternion
from echelon.mechanism.closed_pose import turned_by
from echelon.mechanism.joint import Placement, as_matrix, shift, turn, turn_by
from echelon.mechanism.stated import placement_matrix
from echelon.regressor.loops.exact_pose import unit_quaternion

NEAR = 1e-4  # of directions that are meant to be parallel or perpendicular, rad; of frames that meet
_STEP = pi / STEPS_PER_HALF_TURN
NOISE = 1e-13  # what is left of exact relations in doubles
_DIGITS = 15
_MORE = 16  # times the largest miss that is seen, others may miss
_FEW = 12  # places between which directions are tried
_QUARTER = Fraction(1, 2)
_FROM_AXIS = (turn(1, Angle(-_QUARTER)), turn(0, Angle(_QUARTER)), Placement())
"""Rotations that bring the x, y and z axis to z."""


@dataclass(frozen=True, eq=False)
class Station:
    """A frame in which something moves or is held, in the base frame."""

    pose: Floats  # homogeneous matrix
    residues: Sequence[Sequence[int]]  # the same modulo a prime
    axis: int | None  # the coordinate axis that counts
    is_line: bool  # whether the axis has a place
    is_point: bool  # whether the origin counts
    bodies: tuple[int, ...]  # in which its place is fixed
    exact: Placement | None  # the pose as far as numbers state it exactly: its rotation, its place or both

    @property
    def direction(self) -> Floats:
        """The axis, a unit vector."""
        return self.pose[:3, self.axis]

    @property
    def place(self) -> Floats:
        """The origin, m."""
        return self.pose[:3, 3]

    @property
    def along(self) -> list[int]:
        """The axis modulo the prime."""
        assert self.axis is not None
        return self.modulo(self.axis)

    def modulo(self, column: int) -> list[int]:
        """A column of the pose modulo the prime."""
        return [row[column] for row in self.residues[:3]]


class ExactFrames:
    """Exact frames of stations, in the base frame."""

    def __init__(self, stations: Sequence[Station], noise: float, scale: float) -> None:
        self._tolerance = min(NEAR, max(_MORE * noise, PRECISION))
        self._length = min(LENGTH_TOLERANCE, max(_MORE * noise, NOISE)) * scale
        self._noise, self._fine = NOISE * scale, min(NEAR, 4 * noise)
        self._frames = [Placement()]
        self._turned: dict[Station, Placement] = {}
        self._coarse = 0.1 / noise
        axes = sorted((s for s in stations if s.axis is not None), key=lambda s: -self._related(s, stations))
        for station in sorted(axes, key=lambda s: self._turns(s) is None):
            self._turned[station] = self._stated(station) or self._aligned(self._mean(station, axes))
        self._lines = [s for s in stations if s.is_line and not s.is_point]
        stated = sorted((s for s in stations if s.is_point), key=lambda s: self._stands(s) is None)
        self._points = list(dict.fromkeys(p for s in stated if (p := self._stands(s)) is not None))
        points = self._centres([(s.place, s.bodies) for s in stated])
        self._origin, self._best = self._simplest([place for place, _ in points] + [s.place for s in self._lines])
        self._between = [s.bodies for s in stated if self._stands(s) is not None][: len(self._points)]
        for point, bodies in points:
            if self._known(point) is None:
                self._points.append(self._point(point, bodies))
                self._between.append(bodies)
        self._through = {line: place for line in self._lines if (place := self._stands(line)) is not None}
        for line in self._lines:
            if line not in self._through:
                self._through[line] = self._on(line)

    def frame(self, station: Station) -> Placement:
        """Where a station is."""
        place = self._through.get(station) or self._stands(station) or self._known(station.place)
        place = self._decimals(station.place) if place is None else place
        if station.axis is None:
            return place @ (self._turns(station) or _rotation(station.pose))
        return place @ self._turned[station] @ _FROM_AXIS[station.axis]

    # -- directions ------------------------------------------------------------------------------------------------

    def _related(self, station: Station, stations: Sequence[Station]) -> int:
        """How many axes an axis is parallel or perpendicular to."""
        sines = (_sine(station.direction, s.direction) for s in stations if s.axis is not None)
        return sum(sine < self._tolerance or 1 - sine < self._tolerance**2 for sine in sines)

    def _turns(self, station: Station) -> Placement | None:
        """The rotation of a station, if numbers that are too coarse to be rounded state it."""
        return self._meant(None if station.exact is None else Placement(station.exact.rotation))

    def _stands(self, station: Station) -> Placement | None:
        """The place of a station, if such numbers state it."""
        return self._meant(None if station.exact is None else _shifted(station.exact))

    def _meant(self, placement: Placement | None) -> Placement | None:
        if placement is None or not is_number(placement):
            return None
        parts = [x for entry in placement.entries() for number in entry.terms.values() for x in parts_of(number)]
        return placement if max((Fraction(x).denominator for x in parts), default=1) <= self._coarse else None

    def _stated(self, station: Station) -> Placement | None:
        """The frame of an axis that is stated exactly."""
        found = self._turns(station)
        if found is None or station.axis is None:
            return None
        self._frames += [found] * (found not in self._frames)
        return found @ _FROM_AXIS[station.axis].inverse()

    def _mean(self, station: Station, axes: Sequence[Station]) -> Floats:
        """The mean direction of axes that are nearly parallel, in which rounding shows least."""
        parallel = [s.direction for s in axes if _sine(s.direction, station.direction) < self._tolerance]
        total = np.sum([d * np.sign(d @ station.direction) for d in parallel], axis=0)
        mean: Floats = total / np.linalg.norm(total)
        return mean

    def _aligned(self, direction: Floats) -> Placement:
        """An exact frame whose z axis is next to a direction."""
        for frame in self._frames:
            found = self._on_grid(frame, direction)
            if found is not None:
                return found
        seen = ((plane, _floats(plane).T @ direction) for plane in self._planes())
        turns = [
            (plane, _Turn.next_to(atan2(y, x), self._fine)) for plane, (x, y, z) in seen if abs(z) < self._tolerance
        ]
        if turns:
            plane, about = min(turns, key=lambda choice: choice[1].tangent.denominator)
            self._frames.append(plane @ about.placement(2))
            return self._frames[-1] @ turn(1, Angle(_QUARTER))
        if len(self._frames) == 1:
            self._frames.append(_turned_to(direction, self._fine))
            return self._frames[-1]
        x, y, z = _floats(self._frames[1]).T @ direction
        self._frames.append(self._frames[1] @ _Turn.next_to(atan2(y, x), self._fine).placement(2))
        return self._frames[-1] @ _Turn.next_to(atan2(hypot(x, y), z), self._fine).placement(1)

    def _planes(self) -> Iterator[Placement]:
        """The frames that directions were built on, with each of their axes as z."""
        for frame in self._frames:
            yield from (frame @ back.inverse() for back in _FROM_AXIS)

    def _on_grid(self, frame: Placement, direction: Floats) -> Placement | None:
        """A frame that is turned by multiples of 15° from another, if its z axis is next to a direction then."""
        x, y, z = _floats(frame).T @ direction
        azimuth = round(atan2(y, x) / _STEP) if hypot(x, y) > self._tolerance else 0
        inclination = round(atan2(hypot(x, y), z) / _STEP)
        one, two = azimuth * _STEP, inclination * _STEP
        off = np.array([cos(one) * sin(two), sin(one) * sin(two), cos(two)]) - (x, y, z)
        if np.linalg.norm(off) > self._tolerance:
            return None
        first, second = (Angle(Fraction(steps, STEPS_PER_HALF_TURN)) for steps in (azimuth, inclination))
        return frame @ turn(2, first) @ turn(1, second)

    def _along(self, line: Station) -> Floats:
        return _floats(self._turned[line])[:, 2]

    def _off(self, line: Station, place: Floats) -> float:
        """How far a point is from a line as it stands in the file."""
        return float(np.linalg.norm(np.cross(place - line.place, self._along(line))))

    # -- places ----------------------------------------------------------------------------------------------------

    def _centres(self, points: Sequence[tuple[Floats, tuple[int, ...]]]) -> list[tuple[Floats, tuple[int, ...]]]:
        """Points, and places where two axes on one link meet."""
        pairs = combinations(self._lines, 2)
        meet = [
            (a.place, ())
            for a, b in pairs
            if not self._are_parallel(a, b)
            and not set(a.bodies).isdisjoint(b.bodies)
            and np.linalg.norm(a.place - b.place) < self._length
        ]
        found = list[tuple[Floats, tuple[int, ...]]]()
        for place, bodies in (*points, *meet):
            if all(np.linalg.norm(place - other) > 2 * self._length for other, _ in found):
                found.append((place, bodies))
        return found

    def _are_parallel(self, one: Station, two: Station) -> bool:
        return float(np.linalg.norm(np.cross(self._along(one), self._along(two)))) < self._tolerance

    def _simplest(self, places: Sequence[Floats]) -> tuple[Floats, Placement]:
        """The origin and the frame in which places have the shortest decimals."""
        frames = [*self._frames]
        for plane in dict.fromkeys(self._planes()):
            for a, b in combinations(places[:: -(-len(places) // _FEW)], 2):
                x, y, _ = _floats(plane).T @ (b - a)
                if hypot(x, y) > NEAR:
                    frames.append(plane @ _Turn.next_to(atan2(y, x), self._fine).placement(2))
        starts, all_places = [np.zeros(3), *places[:1]], np.array(places)

        def digits(choice: tuple[Floats, Placement]) -> int:
            own = (np.array([*all_places - choice[0], choice[0]]) @ _floats(choice[1])).ravel()
            short = [np.abs(np.round(own, d) - own) <= self._length for d in range(_DIGITS)]
            return int((~np.logical_or.accumulate(short)).sum()) + _DIGITS * bool(choice[0].any())

        return min(((start, frame) for frame in frames for start in starts), key=digits)

    def _shortest(self, value: float) -> Polynomial:
        digits = next((d for d in range(_DIGITS) if abs(round(value, d) - value) <= self._length), _DIGITS)
        return as_polynomial(Fraction(f"{value:.{digits}f}"))

    def _decimals(self, place: Floats) -> Placement:
        """The place with the shortest decimals."""
        start = shift(*(as_polynomial(Fraction(f"{v:.{_DIGITS}f}")) for v in self._origin))
        x, y, z = _floats(self._best).T @ (place - self._origin)
        return _shifted(start @ self._best @ shift(self._shortest(x), self._shortest(y), self._shortest(z)))

    def _known(self, place: Floats) -> Placement | None:
        """The point that is next to a place."""
        return next((p for p in self._points if np.linalg.norm(_place(p) - place) < 2 * self._length), None)

    def _point(self, place: Floats, bodies: tuple[int, ...]) -> Placement:
        """An exact point: the fourth corner of a parallelogram, or beside another along an axis, if it is next to that.

        Two points between the same bodies make a hinge, so there the axis comes first.
        """
        found, hinged = self._decimals(place), zip(self._points, self._between, strict=True)
        beside = self._beside(place, found, [point for point, between in hinged if bodies and between == bodies])
        return (
            beside or self._corner(found, self._points, np.eye(3)) or self._beside(place, found, self._points) or found
        )

    def _beside(self, place: Floats, found: Placement, known: Sequence[Placement]) -> Placement | None:
        """A point that is beside a known one along an axis."""
        for other, axis in product(known, self._turned.values()):
            apart, along = place - _place(other), _floats(axis)[:, 2]
            if np.linalg.norm(np.cross(apart, along)) < self._length:
                if np.linalg.norm(np.cross(_place(found) - _place(other), along)) < self._noise:
                    return found
                return _shifted(other @ axis @ shift(0, 0, self._shortest(float(apart @ along))))
        return None

    def _on(self, line: Station) -> Placement:
        """An exact place on a line: a point that it passes through, or a place like those of parallel lines."""
        for point in self._points:
            if self._off(line, _place(point)) < self._length:
                return point
        along, found = self._along(line), self._decimals(line.place)
        across = np.eye(3) - np.outer(along, along)
        parallel = [place for other, place in self._through.items() if self._are_parallel(line, other)]
        for place in parallel:
            if np.linalg.norm(across @ (_place(place) - line.place)) < self._length:
                return place
        return self._corner(found, parallel, across) or self._meeting(line, _place(found)) or found

    def _meeting(self, line: Station, place: Floats) -> Placement | None:
        """A place where a line meets another one, if it nearly does."""
        for other, known in self._through.items():
            if not self._are_parallel(line, other):
                along, apart = self._along(other), place - _place(known)
                normal = np.cross(self._along(line), along)
                square = float(normal @ normal)
                if self._noise < abs(float(apart @ normal)) / square**0.5 < self._length:
                    far = float(np.cross(apart, self._along(line)) @ np.cross(along, self._along(line))) / square
                    return _shifted(known @ self._turned[other] @ shift(0, 0, self._shortest(far)))
        return None

    def _corner(self, found: Placement, known: Sequence[Placement], across: Floats) -> Placement | None:
        """The fourth corner of a parallelogram of known places, if the place is next to it and not there."""
        if len(known) < len("abc"):
            return None
        at = np.array([_place(place) for place in known]) @ across
        missed = at[:, None, None] - at[None, :, None] + at[None, None, :] - _place(found) @ across
        sizes = np.linalg.norm(missed, axis=-1)
        sizes[np.equal.outer(np.arange(len(at)), np.arange(len(at)))] = np.inf
        a, b, c = np.unravel_index(np.argmin(sizes), sizes.shape)
        if sizes[a, b, c] > self._length:
            return None
        if sizes[a, b, c] < self._noise:
            return found
        one, two, three = (known[int(k)].translation for k in (a, b, c))
        return shift(*(x - y + z for x, y, z in zip(one, two, three, strict=True)))


def _floats(placement: Placement) -> Floats:
    return placement_matrix(placement, {})[:3, :3]


def _place(placement: Placement) -> Floats:
    return placement_matrix(placement, {})[:3, 3]


def _shifted(placement: Placement) -> Placement:
    """Its translation alone."""
    return shift(*placement.translation)


def rational_frame(pose: Floats) -> Placement:
    """The frame next to a pose with rational numbers."""
    return shift(*(as_polynomial(Fraction(f"{v:.{_DIGITS}f}")) for v in pose[:3, 3])) @ _rotation(pose)


def _rotation(pose: Floats) -> Placement:
    """The rational rotation next to that of a pose, or the one by multiples of right angles that is."""
    rotation = pose[:3, :3]
    if np.abs(rotation - np.round(rotation)).max() < PRECISION:
        return Placement(as_matrix([[as_polynomial(round(float(v))) for v in row] for row in rotation]))
    return turned_by(*map(as_polynomial, unit_quaternion(rotation_quaternion(rotation).tolist())))


@dataclass(frozen=True)
class _Turn:
    """A rational turn: quarters, and the tangent of half of the rest."""

    quarters: int
    tangent: Fraction

    @classmethod
    def next_to(cls, angle: float, tolerance: float) -> _Turn:
        quarters = round(2 * angle / pi)
        return cls(quarters, _simple(tan((angle - quarters * pi / 2) / 2), tolerance))

    def placement(self, axis: int) -> Placement:
        """The turn about a coordinate axis."""
        cosine, sine = circle_point(self.tangent)
        rest = turn_by(axis, as_polynomial(cosine), as_polynomial(sine))
        return turn(axis, Angle(self.quarters * _QUARTER)) @ rest


def _turned_to(direction: Floats, tolerance: float) -> Placement:
    """A rational turn that takes z next to a direction, by the stereographic projection of the half space it is in."""
    sign = 1 if direction[2] > 0 else -1
    x, y = (_simple(sign * float(v) / (1 + abs(float(direction[2]))), tolerance) for v in direction[:2])
    size = 1 / (1 + x * x + y * y)
    rows = [
        [1 - 2 * x * x * size, -2 * x * y * size, 2 * x * size],
        [-2 * x * y * size, 1 - 2 * y * y * size, 2 * y * size],
        [-2 * x * size, -2 * y * size, (1 - x * x - y * y) * size],
    ]
    found = Placement(as_matrix([[as_polynomial(entry) for entry in row] for row in rows]))
    return found if sign > 0 else found @ turn(1, Angle(Fraction(1)))


def _simple(value: float, tolerance: float) -> Fraction:
    """A simple fraction next to a number."""
    exact = Fraction(value)
    found = (exact.limit_denominator(10**digits) for digits in range(_DIGITS))
    return next((f for f in found if abs(f - exact) <= tolerance), exact.limit_denominator(10**_DIGITS))


def is_number(placement: Placement) -> bool:
    """Whether no symbols are left."""
    return not any(entry.generators() for entry in placement.entries())


def _sine(one: Floats, two: Floats) -> float:
    return float(np.linalg.norm(np.cross(one, two)))
