"""Exact places of axes and points whose directions are exact: relations between places are kept by solving for them.

Once directions are exact, that lines meet, points lie on lines, sides of parallelograms are equal, or a point divides
others in a simple ratio, are linear equations in coordinates.  That two lengths are equal is not; but one of the two is
the mirror image of the other, and in a mirror whose normal is exact it is linear, too.  So each relation that is nearly
true takes unknowns away, unless those before it leave no place for it.  What is left gets the shortest decimals within
the rounding.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import combinations, pairwise

import numpy as np

from echelon.arrays import Floats
from echelon.exact.field import DEFAULT_SEED, random_generator
from echelon.exact.polynomial import Polynomial, as_polynomial, circle_point, inverse, simple_fraction
from echelon.mechanism.joint import Placement, Vector, rotate, transpose
from echelon.mechanism.stated import placement_matrix

DIGITS = 15
_LEAST = 1e-3  # of the coefficient of an unknown that a relation takes away
_MOST_PAIRS = 3000  # of equal lengths
_NEARLY = 0.01  # of a length, what is small beside it
SPACE = -1  # where vectors are compared as they are, and not across an axis


class Unknowns:
    """Places as linear forms, without constants, of coordinates that are free."""

    def __init__(self, near: Sequence[Floats], length: float) -> None:
        self._near, self._length, new = np.array(near).ravel(), length, Polynomial.generator
        self.forms: list[Vector] = [(new(f"x{k}"), new(f"y{k}"), new(f"z{k}")) for k in range(len(near))]

    @property
    def _coordinates(self) -> list[Polynomial]:
        return [form for place in self.forms for form in place]

    @property
    def _free(self) -> list[str]:
        return sorted({name for form in self._coordinates for name in form.generators()})

    def require(self, rows: Sequence[Polynomial]) -> None:
        """Make linear forms zero, if those that were before leave a choice and places stay where they are."""
        given = dict[str, Polynomial]()
        for row in (_put_in(row, given) for row in rows):
            if not row:
                continue
            lead = max(row.terms, key=lambda monomial: abs(float(row.terms[monomial])))
            if abs(float(row.terms[lead])) < _LEAST:
                return
            pivot = lead[0][0]
            rest = Polynomial.generator(pivot) - row * inverse(row.terms[lead])
            given = {name: _put_in(form, {pivot: rest}) for name, form in given.items()} | {pivot: rest}
        free = self._free
        left = [name for name in free if name not in given]
        kept = _matrix([given.get(name) or Polynomial.generator(name) for name in free], left)
        matrix = _matrix(self._coordinates, free) @ kept  # doubles show what exact forms would take long for
        if given and self._nearest(matrix)[1] <= self._length:
            self.forms = [(_put_in(x, given), _put_in(y, given), _put_in(z, given)) for x, y, z in self.forms]

    def are_equal(self, one: Sequence[Polynomial], two: Sequence[Polynomial]) -> bool:
        """Whether vectors have the same length, by random values of what is free."""
        rng = random_generator(DEFAULT_SEED)
        values = {name: int(rng.integers(1, 10**6)) for name in self._free}
        squares = [Polynomial.sum(_put_in(x, values) ** 2 for x in vector) for vector in (one, two)]
        return squares[0] == squares[1]

    def places(self, shortest: Callable[[float], Polynomial]) -> list[Vector]:
        """The places next to those that were given."""
        free = self._free
        nearest = self._nearest(_matrix(self._coordinates, free))[0]
        values = {name: shortest(float(value)) for name, value in zip(free, nearest, strict=True)}
        return [(_put_in(x, values), _put_in(y, values), _put_in(z, values)) for x, y, z in self.forms]

    def _nearest(self, matrix: Floats) -> tuple[Floats, float]:
        """Values of what is free with which places are nearest to those that were given, and how far they are off."""
        values = np.linalg.lstsq(matrix, self._near, rcond=None)[0].astype(np.float64)
        return values, float(np.abs(matrix @ values - self._near).max())


def _matrix(forms: Sequence[Polynomial], names: Sequence[str]) -> Floats:
    """Coefficients of linear forms in doubles, (forms, names)."""
    columns = {name: k for k, name in enumerate(names)}
    matrix = np.zeros((len(forms), len(names)))
    for k, form in enumerate(forms):
        for monomial, factor in form.terms.items():
            matrix[k, columns[monomial[0][0]]] = float(factor)
    return matrix


@dataclass(frozen=True)
class Feature:
    """A point, or a line through it, that is fixed in bodies."""

    place: int
    along: int  # the axis of which frame the line is; none for a point
    bodies: tuple[int, ...]


@dataclass(frozen=True)
class Side:
    """A vector from one feature of a body to another, seen across an axis if one is a line."""

    ends: tuple[int, int]
    across: int
    vector: Floats

    @property
    def length(self) -> float:
        """How long it is, m."""
        return float(np.linalg.norm(self.vector))


class ExactPlaces:
    """Places that keep the relations between them."""

    def __init__(
        self,
        places: Sequence[Floats],
        frames: Sequence[Placement],
        features: Sequence[Feature],
        slides: Sequence[Feature],
        length: float,
        aligned: Callable[[Floats], Placement],
    ) -> None:
        self._places, self._length, self._aligned = np.array(places), length, aligned
        self._back = [transpose(frame.rotation) for frame in frames]
        self._axes = [placement_matrix(frame, {})[:3, :3].T for frame in frames]
        self._features, self._slides = features, slides
        self._points = sorted({f.place for f in features if f.along == SPACE})
        self._lines = list({(f.place, f.along): f for f in features if f.along != SPACE}.values())
        self._held = [{b for f in features if f.place == k for b in f.bodies} for k in range(len(places))]
        self._ratios, self._mirrors = list[Fraction](), dict[tuple[int, int], list[Fraction]]()
        self.unknowns = Unknowns(places, length)
        sides = list(self._sides())
        own = (self._on_lines(), self._met(True), self._beside(), self._parallel(sides), self._divided())
        for relations in (*own, self._met(False)):
            for rows in relations:
                self.unknowns.require(rows)
        self._equal(sides)

    # -- linear relations ------------------------------------------------------------------------------------------

    def _apart(self, one: int, two: int) -> Vector:
        (a, b, c), (x, y, z) = self.unknowns.forms[one], self.unknowns.forms[two]
        return (x - a, y - b, z - c)

    def _across(self, one: int, two: int, along: int) -> Sequence[Polynomial]:
        """The vector between places, or the part of it that is perpendicular to an axis."""
        apart = self._apart(one, two)
        return apart if along == SPACE else rotate(self._back[along], apart)[:2]

    def _seen(self, one: int, two: int, along: int) -> Floats:
        """The same in doubles."""
        apart: Floats = self._places[two] - self._places[one]
        return apart if along == SPACE else (self._axes[along] @ apart)[:2]

    def _is_small(self, one: int, two: int, along: int) -> bool:
        return float(np.linalg.norm(self._seen(one, two, along))) < self._length

    def _on_lines(self) -> Iterator[Sequence[Polynomial]]:
        """Points on lines, and lines that are one."""
        for line in self._lines:
            parallel = (f.place for f in self._lines if f.along == line.along)
            for place in dict.fromkeys((*self._points, *parallel)):
                if place != line.place and self._is_small(line.place, place, line.along):
                    yield self._across(line.place, place, line.along)

    def _met(self, on_one_body: bool) -> Iterator[Sequence[Polynomial]]:
        """Lines that meet; what those of different bodies do may be by chance."""
        for one, two in combinations(self._lines, 2):
            apart = self._held[one.place].isdisjoint(self._held[two.place])
            if one.place != two.place and apart != on_one_body:
                yield from self._in_plane(one.place, two.place, one.along, two.along)

    def _in_plane(self, one: int, two: int, *axes: int) -> Iterator[Sequence[Polynomial]]:
        """The vector between places is in the plane of two directions."""
        normal = np.cross(*(self._axes[k][2] for k in axes))
        size = float(np.linalg.norm(normal))
        if axes[0] != axes[1] and abs(self._seen(one, two, SPACE) @ normal) < self._length * size:
            (a, b, c), (x, y, z) = (self._back[k][2] for k in axes)
            exact = (b * z - c * y, c * x - a * z, a * y - b * x)
            yield [Polynomial.sum(n * v for n, v in zip(exact, self._apart(one, two), strict=True))]

    def _beside(self) -> Iterator[Sequence[Polynomial]]:
        """What is beside another along an axis on the same or the next body, or level with it."""
        for axis in (*(f for f in self._features if f.along != SPACE), *self._slides):
            for (one, along), (two, other) in combinations(self._on(*axis.bodies), 2):
                across = max(along, other)
                if across != SPACE and min(along, other) in (across, SPACE):
                    yield from self._in_plane(one, two, across, axis.along)
                elif across == SPACE and self._is_small(one, two, axis.along):
                    yield self._across(one, two, axis.along)
                elif across == SPACE and abs(self._seen(one, two, SPACE) @ self._axes[axis.along][2]) < self._length:
                    yield [rotate(self._back[axis.along], self._apart(one, two))[2]]

    def _on(self, *bodies: int) -> list[tuple[int, int]]:
        """Places of points on bodies, and of lines with their directions; crossing lines make a point."""
        found = dict[int, int]()
        for feature in self._features:
            if not set(bodies).isdisjoint(feature.bodies):
                known = found.setdefault(feature.place, feature.along)
                found[feature.place] = known if known == feature.along else SPACE
        return list(found.items())

    @property
    def _bodies(self) -> list[int]:
        return sorted({body for feature in self._features for body in feature.bodies})

    def _sides(self) -> Iterator[Side]:
        seen = set[tuple[int, int, int]]()
        for body in self._bodies:
            for (one, along), (two, other) in combinations(self._on(body), 2):
                across = max(along, other)
                if min(along, other) in (across, SPACE) and (one, two, across) not in seen:
                    seen.add((one, two, across))
                    if not self._is_small(one, two, across):
                        yield Side((one, two), across, self._seen(one, two, across))

    def _parallel(self, sides: Sequence[Side]) -> Iterator[Sequence[Polynomial]]:
        """Sides of parallelograms."""
        for across in {side.across for side in sides}:
            alike = [side for side in sides if side.across == across]
            vectors = np.array([side.vector for side in alike])
            for k, side in enumerate(alike):
                for sign in (1, -1):
                    same = np.flatnonzero(np.linalg.norm(vectors[:k] - sign * side.vector, axis=1) < self._length)
                    if same.size:
                        yield self._difference(side, alike[int(same[0])], sign)

    def _difference(self, one: Side, two: Side, sign: int) -> Sequence[Polynomial]:
        a, b = self._across(*one.ends, one.across), self._across(*two.ends, two.across)
        return [y - x * sign for x, y in zip(a, b, strict=True)]

    def _divided(self) -> Iterator[Sequence[Polynomial]]:
        """Three places on a line, of one body, the middle one in a simple ratio."""
        for body in self._bodies:
            on = self._on(body)
            for across in {along for _, along in on}:
                for a, b, c in combinations([place for place, along in on if along in (across, SPACE)], 3):
                    yield from self._on_one_line((a, b, c), across)

    def _on_one_line(self, places: tuple[int, int, int], across: int) -> Iterator[Sequence[Polynomial]]:
        ways = {(p, q): self._seen(p, q, across) for p, q in combinations(places, 2)}
        start, end = max(ways, key=lambda ends: float(np.linalg.norm(ways[ends])))
        (middle,) = set(places) - {start, end}
        if np.linalg.norm(self._seen(start, middle, across)) > np.linalg.norm(self._seen(middle, end, across)):
            start, end = end, start
        whole, part = self._seen(start, end, across), self._seen(start, middle, across)
        size = float(np.linalg.norm(whole))
        ratio = float(part @ whole) / size**2
        if np.linalg.norm(part - ratio * whole) < self._length < _NEARLY * size:
            exact = _shared(self._ratios, ratio, self._length / size)
            long, short = self._across(start, end, across), self._across(start, middle, across)
            yield [x - y * exact for x, y in zip(short, long, strict=True)]

    # -- equal lengths ---------------------------------------------------------------------------------------------

    def _equal(self, sides: Sequence[Side]) -> None:
        """Equal lengths by mirrors, the most common ones first."""
        pairs = [pair for flat in (True, False) for pair in self._pairs([s for s in sides if (s.across >= 0) == flat])]
        mirrors = [mirror for pair in pairs[:_MOST_PAIRS] for mirror in self._mirrored(*pair)]
        alike = _alike(mirrors)
        for mirror in sorted(mirrors, key=lambda m: (self._is_natural(m), alike[m]), reverse=True):
            one, two = (self._across(*side.ends, side.across) for side in mirror.sides)
            if not self.unknowns.are_equal(one, two):
                self.unknowns.require(self._image(mirror))

    def _pairs(self, sides: Sequence[Side]) -> Iterator[tuple[Side, Side]]:
        """Sides that have the same length."""
        rising = sorted(sides, key=lambda side: side.length)
        steps = [0, *(k for k, (a, b) in enumerate(pairwise(rising), 1) if b.length - a.length > self._length)]
        for start, end in pairwise([*steps, len(rising)]):
            yield from combinations(rising[start:end], 2)

    def _mirrored(self, *sides: Side) -> Iterator[Mirror]:
        one, two = sorted(sides, key=lambda side: side.across)
        v, w = one.vector, two.vector
        if one.across >= 0:
            angle = float(np.arctan2(v[1], v[0]) + np.arctan2(w[1], w[0])) / 2
            quarter = round(angle / (np.pi / 2))
            tangent = np.array([np.tan(angle - quarter * np.pi / 2)])
            yield Mirror((one, two), -1 if quarter % 2 else 1, tangent, self._length / one.length)
            return
        for sign in (1, -1):
            normal = v - sign * w
            size = float(np.linalg.norm(normal))
            if size > _NEARLY * one.length:
                lead = normal[np.argmax(np.abs(normal))]
                yield Mirror((one, two), sign, normal / size * np.sign(lead), self._length / size)

    def _image(self, mirror: Mirror) -> Sequence[Polynomial]:
        """What the first side of a mirror is more than the image of the second."""
        one, two = (self._across(*side.ends, side.across) for side in mirror.sides)
        if len(mirror.at) == 1:
            c, s = circle_point(_shared(self._known(mirror), float(mirror.at[0]), mirror.near))
            image = [two[0] * c + two[1] * s, two[0] * s - two[1] * c]
        else:
            normal = [row[2] for row in self._aligned(mirror.at).rotation]
            along = Polynomial.sum(n * x for n, x in zip(normal, two, strict=True)) * 2
            image = [x - n * along for n, x in zip(normal, two, strict=True)]
        return [x - y * mirror.sign for x, y in zip(one, image, strict=True)]

    def _known(self, mirror: Mirror) -> list[Fraction]:
        return self._mirrors.setdefault(mirror.key, list(self._natural(*mirror.key)))

    def _is_natural(self, mirror: Mirror) -> bool:
        return any(abs(float(f) - mirror.at[0]) < 2 * mirror.near for f in self._known(mirror) if len(mirror.at) == 1)

    def _natural(self, one: int, two: int) -> Iterator[Fraction]:
        """Mirrors for sides across two axes, or one, in which directions across two axes are their own images.

        So the legs of a platform may be alike, and the halves of a leg.
        """
        for other in [two] if one != two else range(len(self._back)):
            (a, b, c), (x, y, z) = (self._back[k][2] for k in (one, other))
            across = (b * z - c * y, c * x - a * z, a * y - b * x)
            (u, v), (w, t) = (rotate(self._back[k], across)[:2] for k in (one, two))
            sums = [(total.number or 0) for total in (u + w, v + t)]
            rise, run = sorted(sums, key=lambda x: abs(float(x)))
            if isinstance(rise, int | Fraction) and isinstance(run, int | Fraction) and run:
                yield Fraction(rise) / run * (1 if run == sums[0] else -1)


@dataclass(frozen=True, eq=False)
class Mirror:
    """A mirror in which a side is the image of another one, or of the opposite of it."""

    sides: tuple[Side, Side]
    sign: int
    at: Floats  # its normal in space; across axes the tangent of the angle of its trace
    near: float

    @property
    def key(self) -> tuple[int, int]:
        """In which planes the sides are."""
        one, two = self.sides
        return one.across, two.across


def _alike(mirrors: Sequence[Mirror]) -> dict[Mirror, int]:
    """How many mirrors are the same as each one, as far as rounding tells."""
    found = dict[Mirror, int]()
    for key in {mirror.key for mirror in mirrors}:
        same = [mirror for mirror in mirrors if mirror.key == key]
        at, near = np.array([mirror.at for mirror in same]), np.array([mirror.near for mirror in same])
        alike = np.abs(at[:, None] - at).max(axis=-1) < near[:, None] + near
        found |= dict(zip(same, alike.sum(axis=1).tolist(), strict=True))
    return found


def _shared(known: list[Fraction], value: float, tolerance: float) -> Fraction:
    """The fraction next to a number that was taken before, or else a simple one."""
    found = next((f for f in known if abs(float(f) - value) < 2 * tolerance), None)
    if found is None:
        found = simple_fraction(value, tolerance)
        known.append(found)
    return found


def _put_in(form: Polynomial, given: Mapping[str, Polynomial | int]) -> Polynomial:
    """A linear form with others put in for its unknowns."""
    if given.keys().isdisjoint(form.generators()):
        return form
    return Polynomial.sum(
        as_polynomial(given.get(monomial[0][0], Polynomial({monomial: 1}))) * factor
        for monomial, factor in form.terms.items()
    )
