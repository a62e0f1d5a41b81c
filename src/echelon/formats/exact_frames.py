"""Exact frames next to rounded ones: rational directions, parallel or perpendicular as meant, and short decimals."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction
from functools import lru_cache
from itertools import combinations
from math import atan2, cos, hypot, pi, sin

import numpy as np

from echelon.arrays import Floats
from echelon.exact.expressions import STEPS_PER_HALF_TURN, Angle
from echelon.exact.polynomial import Polynomial, as_polynomial, parts_of
from echelon.formats.closure_frames import rational_frame
from echelon.formats.exact_places import DIGITS, SPACE, ExactPlaces, Feature
from echelon.formats.snapping import PRECISION
from echelon.formats.station import NOISE, Station
from echelon.mechanism.closed_pose import rational_rotation
from echelon.mechanism.joint import GROUND, Placement, shift, turn
from echelon.mechanism.stated import placement_matrix

NEAR = 1e-4  # of directions that are meant to be parallel or perpendicular, rad; of frames that meet
_STEP = pi / STEPS_PER_HALF_TURN
_MORE = 16  # times the largest miss that is seen, others may miss
_FEW, _MOST_TURNS = 12, 6000  # places between which directions are tried, and frames along these
_TENS = 10.0 ** np.arange(DIGITS)[:, None]
_QUARTER = Fraction(1, 2)
_FROM_AXIS = (turn(1, Angle(-_QUARTER)), turn(0, Angle(_QUARTER)), Placement())
"""Rotations that bring the x, y and z axis to z."""


class ExactFrames:
    """Exact frames of stations, in the base frame."""

    def __init__(
        self,
        stations: Sequence[Station],
        noise: float,
        apart: float,
        scale: float,
        most: tuple[float, float],
        base_first: bool,
    ) -> None:
        near, within = most  # of directions and of places
        self._tolerance = min(near, max(_MORE * noise, 2 * apart, PRECISION))
        self._length = min(within, max(_MORE * noise, 2 * apart, NOISE)) * scale
        self._fine = min(NEAR, noise)
        self._frames = [Placement()]
        self._turned: dict[Station, Placement] = {}
        self._coarse = 0.1 / noise
        axes = [s for s in stations if s.axis is not None]
        self._directions = np.array([s.direction for s in axes]).reshape(-1, 3)
        for station in self._ordered(axes, base_first):
            self._turned[station] = (
                self._stated(station)
                or self._known(station)
                or self._aligned(self._mean(station, axes), self._tolerance * station.slack)
            )
        self._stations = [s for s in stations if s.is_line or s.is_point]
        self._origin, self._best = self._simplest([s.place for s in self._stations])
        self._start = shift(*(as_polynomial(Fraction(f"{v:.{DIGITS}f}")) for v in self._origin)) @ self._best
        self._at = self._clusters()
        self._places = self._solved([s for s in axes if not s.is_line])

    def frame(self, station: Station) -> Placement:
        """Where a station is."""
        place = self._places.get(station) or self._decimals(station.place)
        if station.axis is None:
            return place @ (self._turns(station) or Placement(rational_frame(station.pose).rotation))
        return place @ self._turned[station] @ _FROM_AXIS[station.axis]

    # -- directions ------------------------------------------------------------------------------------------------

    def _ordered(self, axes: Sequence[Station], base_first: bool) -> Iterator[Station]:
        """What is stated exactly first, then always what is parallel or perpendicular to most of those before."""
        ways = self._directions
        parallel = np.linalg.norm(np.cross(ways[:, None], ways), axis=-1) < self._tolerance
        tied = parallel | (np.abs(ways @ ways.T) < self._tolerance)
        first = [(self._turns(s) is not None, not s.is_between, base_first and min(s.bodies) == GROUND) for s in axes]
        waiting, done = list(range(len(axes))), np.zeros(len(axes), dtype=bool)
        while waiting:
            k = max(waiting, key=lambda k: (first[k], (tied[k] & done).sum(), tied[k].sum()))
            waiting.remove(k)
            done[k] = True
            yield axes[k]

    def _turns(self, station: Station) -> Placement | None:
        """The rotation of a station, if numbers that are too coarse to be rounded state it."""
        return self._meant(None if station.exact is None else Placement(station.exact.rotation))

    def _meant(self, placement: Placement | None) -> Placement | None:
        if placement is None or not is_number(placement):
            return None
        return placement if _size([placement]) <= self._coarse else None

    def _stated(self, station: Station) -> Placement | None:
        """The frame of an axis that is stated exactly."""
        found = self._turns(station)
        if found is None or station.axis is None:
            return None
        self._frames += [found] * (found not in self._frames)
        return found @ _FROM_AXIS[station.axis].inverse()

    def _known(self, station: Station) -> Placement | None:
        """The frame of a parallel axis that has one."""
        for frame in self._turned.values():
            along = _floats(frame)[:, 2]
            if _sine(along, station.direction) < self._tolerance * station.slack:
                return frame if along @ station.direction > 0 else frame @ turn(0, Angle(Fraction(1)))
        return None

    def _mean(self, station: Station, axes: Sequence[Station]) -> Floats:
        """The mean direction of axes that are nearly parallel, in which rounding shows least."""
        parallel = [s for s in axes if _sine(s.direction, station.direction) < self._tolerance]
        firm = [s.direction for s in parallel if not s.is_between] or [station.direction]
        total = np.sum([d * np.sign(d @ station.direction) for d in firm], axis=0)
        mean: Floats = total / np.linalg.norm(total)
        return mean

    def _aligned(self, direction: Floats, near: float) -> Placement:
        """An exact frame whose z axis is next to a direction and breaks the fewest relations to others."""
        turned = np.array([_floats(frame)[:, 2] for frame in dict.fromkeys(self._turned.values())]).reshape(-1, 3)
        normals = np.array([np.cross(a, b) for a, b in combinations(turned, 2)]).reshape(-1, 3)

        def broken(found: Placement, others: Floats) -> int:
            square = others[np.abs(others @ direction) < near]
            return int((np.abs(square @ _floats(found)[:, 2]) > NOISE).sum())

        def worth(choice: tuple[Placement, list[Placement]]) -> tuple[int, int, int]:
            # it may be in the plane of two others, too
            return broken(choice[0], turned), broken(choice[0], normals), _size(choice[1])

        found, added = min(self._choices(direction, near), key=worth)
        self._frames += added
        return found

    def _choices(self, direction: Floats, near: float) -> Iterator[tuple[Placement, list[Placement]]]:
        """Exact frames whose z axis is next to a direction, with those that would be new; simple ones first."""
        on_grid = (self._on_grid(frame, direction, near) for frame in self._frames)
        choices = [(found, list[Placement]()) for found in on_grid if found is not None]
        for plane in self._planes():
            x, y, z = _floats(plane).T @ direction
            if abs(z) < near:
                frame = plane @ _about_z(atan2(y, x), self._fine)
                choices.append((frame @ turn(1, Angle(_QUARTER)), [frame]))
        yield from choices
        if not choices and len(self._frames) == 1:
            x, y, z = direction
            frame = rational_rotation((1 + z, -y, x, 0) if z > 0 else (-y, 1 - z, 0, x), self._fine)
            yield frame, [frame]
        elif not choices:
            base = max(self._turned.values(), key=lambda frame: self._in_plane(_floats(frame)[:, 2], direction))
            x, y, z = _floats(base).T @ direction
            frame = base @ _about_z(atan2(y, x), self._fine)
            found = frame @ rational_rotation((1 + z, 0, hypot(x, y), 0), self._fine)
            yield found, [frame, found]

    def _in_plane(self, one: Floats, two: Floats) -> int:
        """How many axes are in the plane of two directions, or perpendicular to it."""
        normal = np.cross(one, two)
        cosines = np.abs(self._directions @ normal) / np.linalg.norm(normal)
        return int(((cosines < self._tolerance) | (1 - cosines < self._tolerance**2)).sum())

    def _planes(self) -> Iterator[Placement]:
        """The frames that directions were built on, and their own, with each of their axes as z."""
        for frame in dict.fromkeys((*self._frames, *self._turned.values())):
            yield from (frame @ back.inverse() for back in _FROM_AXIS)

    def _on_grid(self, frame: Placement, direction: Floats, near: float) -> Placement | None:
        """A frame that is turned by multiples of 15° from another, if its z axis is next to a direction then."""
        x, y, z = _floats(frame).T @ direction
        azimuth = round(atan2(y, x) / _STEP) if hypot(x, y) > near else 0
        inclination = round(atan2(hypot(x, y), z) / _STEP)
        one, two = azimuth * _STEP, inclination * _STEP
        off = np.array([cos(one) * sin(two), sin(one) * sin(two), cos(two)]) - (x, y, z)
        if np.linalg.norm(off) > near:
            return None
        first, second = (Angle(Fraction(steps, STEPS_PER_HALF_TURN)) for steps in (azimuth, inclination))
        return frame @ turn(2, first) @ turn(1, second)

    # -- places ----------------------------------------------------------------------------------------------------

    def _clusters(self) -> dict[Station, int]:
        """Numbers of places, of which each holds what is at it; lines are at points that they pass through."""
        found, at = list[Floats](), dict[Station, int]()
        crossed = {a for a, b in combinations(self._stations, 2) for a in (a, b) if self._cross(a, b)}
        order = sorted(self._stations, key=lambda s: (s.is_line and not s.is_point, s not in crossed))
        for station in order:
            is_point = station.is_point or station in crossed
            off = [self._off(station, place, is_point) for place in found]
            near = [(float(np.linalg.norm(found[k] - station.place)), k) for k, o in enumerate(off) if o < self._length]
            at[station] = min(near)[1] if near else len(found)
            found += [] if near else [station.place]
        self._found = found
        return at

    def _cross(self, one: Station, two: Station) -> bool:
        """Whether two axes on one link meet where both are stated."""
        lines = one.is_line and two.is_line and not set(one.bodies).isdisjoint(two.bodies)
        return (
            lines
            and float(np.linalg.norm(one.place - two.place)) < self._length
            and _sine(self._along(one), self._along(two)) > self._tolerance
        )

    def _along(self, line: Station) -> Floats:
        return _floats(self._turned[line])[:, 2]

    def _off(self, station: Station, place: Floats, is_point: bool) -> float:
        """How far a place is from a point or from a line as it stands in the file."""
        apart = place - station.place
        return float(np.linalg.norm(apart if is_point else np.cross(apart, self._along(station)))) / (1 + is_point)

    def _solved(self, slides: Sequence[Station]) -> dict[Station, Placement]:
        """Exact places of points and lines."""
        back, turned = self._start.inverse(), _floats(self._best)
        planes = list[Placement]()
        axes = {s: self._plane(s, planes) for s in (*self._stations, *slides) if s.is_line or s in slides}
        features = [Feature(self._at[s], axes[s] if s.is_line else SPACE, s.bodies) for s in self._stations]
        features += [Feature(self._at[s], SPACE, s.bodies) for s in self._stations if s.is_line and s.is_point]
        solved = ExactPlaces(
            [turned.T @ (place - self._origin) for place in self._found],
            [back @ plane for plane in planes],
            features,
            [Feature(0, axes[s], s.bodies) for s in slides],
            self._length,
            lambda normal: self._best.inverse() @ self._aligned(turned @ normal, self._tolerance),
        )
        places = [_shifted(self._start @ shift(*place)) for place in solved.unknowns.places(self._shortest)]
        return {station: places[k] for station, k in self._at.items()}

    def _plane(self, station: Station, planes: list[Placement]) -> int:
        """The number of the frame whose z axis a direction is along."""
        here = self._turned[station]
        for k, plane in enumerate(planes):
            if _sine(_floats(plane)[:, 2], _floats(here)[:, 2]) < self._tolerance:
                return k
        planes.append(here)
        return len(planes) - 1

    def _simplest(self, places: Sequence[Floats]) -> tuple[Floats, Placement]:
        """The origin and the frame in which places have the shortest decimals."""
        turns = [(frame, 0.0) for frame in self._frames]
        for plane in dict.fromkeys(self._planes()):
            for a, b in combinations(places[:: -(-len(places) // _FEW)], 2):
                x, y, _ = _floats(plane).T @ (b - a)
                turns += [(plane, atan2(y, x))] * (hypot(x, y) > NEAR)
        turns = turns[:: 1 + len(turns) // _MOST_TURNS]
        starts, all_places = [np.zeros(3), *places[:1]], np.array(places)

        def digits(choice: tuple[Floats, tuple[Placement, float]]) -> int:
            start, (frame, angle) = choice
            own = (np.array([*all_places - start, start]) @ _floats(frame) @ _floats_about_z(angle)).ravel()
            short = np.abs(np.round(own * _TENS) - own * _TENS) <= self._length * _TENS
            return int((~np.logical_or.accumulate(short)).sum()) + DIGITS * bool(start.any())

        start, (frame, angle) = min(((start, turn) for turn in turns for start in starts), key=digits)
        return start, frame @ _about_z(angle, self._fine) if angle else frame

    def _shortest(self, value: float) -> Polynomial:
        digits = next((d for d in range(DIGITS) if abs(round(value, d) - value) <= self._length / 4), DIGITS)
        return as_polynomial(Fraction(f"{value:.{digits}f}"))

    def _decimals(self, place: Floats) -> Placement:
        """The place with the shortest decimals."""
        x, y, z = _floats(self._best).T @ (place - self._origin)
        return _shifted(self._start @ shift(self._shortest(x), self._shortest(y), self._shortest(z)))


@lru_cache(maxsize=1024)
def _floats(placement: Placement) -> Floats:
    return placement_matrix(placement, {})[:3, :3]


def _shifted(placement: Placement) -> Placement:
    """Its translation alone."""
    return shift(*placement.translation)


def _about_z(angle: float, tolerance: float) -> Placement:
    """A rational turn."""
    return rational_rotation((cos(angle / 2), 0, 0, sin(angle / 2)), tolerance)


def _floats_about_z(angle: float) -> Floats:
    c, s = cos(angle), sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _size(frames: Sequence[Placement]) -> int:
    entries = (entry for frame in frames for entry in frame.entries())
    parts = (part for entry in entries for number in entry.terms.values() for part in parts_of(number))
    return max((Fraction(part).denominator for part in parts), default=0)


def is_number(placement: Placement) -> bool:
    """Whether no symbols are left."""
    return not any(entry.generators() for entry in placement.entries())


def _sine(one: Floats, two: Floats) -> float:
    return float(np.linalg.norm(np.cross(one, two)))
