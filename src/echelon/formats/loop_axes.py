"""Loops in rounded numbers: axes that nearly are parallel or perpendicular, or nearly meet, do so exactly.

Frames of links are arbitrary: how a loop moves depends on its axes and points alone.  Where links are turned by general
angles, each rounded on its own, no single number says that two axes are parallel, and none can be mended.  So all axes
of a loop are looked at in one frame, where all coordinates are zero, or else where the loops are closed: coordinates
count from that pose meanwhile.  If rounding has broken a relation on a link, each direction gets a rational frame next
to it, built on those of other directions that it is parallel or perpendicular to; each point gets the shortest decimals
within the rounding.  Links stay where they are, to fifteen digits.

Files have four digits or seventeen, so what counts as rounding follows what most axes miss, and the last decimal of
lengths: 1e-4 is chance in the one and noise in the other.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import cached_property
from itertools import combinations, pairwise, product

import numpy as np

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.exact.field import CERTIFICATE_BITS, DEFAULT_SEED, PrimeField, Residues, random_generator
from echelon.exact.polynomial import as_polynomial, multiple_of, parts_of, symbol_of
from echelon.formats.closure_frames import rational_frame
from echelon.formats.exact_frames import NEAR, ExactFrames, is_number
from echelon.formats.exact_gravity import exact_gravity
from echelon.formats.exact_places import DIGITS
from echelon.formats.snapping import LENGTH_TOLERANCE, PRECISION, Snapping
from echelon.formats.station import NOISE, Station, cross, dot
from echelon.mechanism.closed_pose import ExactPose, counted_from, parted, rational_pose, shown_loops
from echelon.mechanism.closure import Closure, ClosureKind
from echelon.mechanism.joint import GROUND, Body, MotionKind, Placement, Step, Vector, merge
from echelon.mechanism.mechanism import RESTORED, Mechanism, Snap
from echelon.mechanism.stated import has_values, known_values, placement_matrix, stated_values

_TIMES, _LENGTHS = 10, 4  # what most axes miss, some directions and lengths may miss
_UNITS = 2  # of the last decimal, lengths may miss
_FEW = 3  # relations that are not all missed by chance
_LEAST_SLACK = 2.0  # of the line between two points: by how much it is less exact than other axes
_MOVED = 40  # times the largest miss that is seen, axes and points may move
_TURNS = (MotionKind.ROTATION, MotionKind.SCREW)
_LINES = (ClosureKind.REVOLUTE, ClosureKind.CYLINDRICAL, ClosureKind.POINT_ON_AXIS)
_BASE = (GROUND, GROUND)  # what gravity is fixed in
_POINTS = (ClosureKind.WELD, ClosureKind.SPHERICAL, ClosureKind.UNIVERSAL, *_LINES[2:], ClosureKind.POINT_ON_PLANE)


def with_exact_axes(mechanism: Mechanism, snapping: Snapping, *, needed: bool = True) -> Mechanism:
    """A mechanism whose loops keep the relations between axes that rounding of their numbers has broken.

    Where they cannot all be restored at zero, it is refused if that is needed, as in robot files.
    """
    if not snapping.options.snap_tolerance or not has_values(mechanism):
        return mechanism
    found = _AtZero(mechanism, snapping)
    if found.meets:
        if (mended := _mended(found)) is None and needed:
            raise InputError(_broken(found))
        return mended or mechanism
    if (pose := _closed_pose(mechanism, max(found.near, found.within))) is None:
        return mechanism
    from_pose = counted_from(mechanism, pose)
    known = len(snapping.snaps)
    there = _AtZero(from_pose, snapping, at_pose=True, like=found)
    mended = _mended(there)
    # the pose adds digits of doubles, which are no reason to restore some relations and not others
    left = there.noise < PRECISION and mended is not None and _AtZero(mended, snapping, like=there).noise
    if left or mended is None or mended is from_pose:
        del snapping.snaps[known:]
        return mechanism
    return counted_from(mended, pose, back=True)


def _closed_pose(mechanism: Mechanism, near: float) -> ExactPose | None:
    """Where loops that are open at zero are closed, to rounding; None if nowhere near the assembly pose."""
    from echelon.regressor.loops.assembly import Assembly, OpenLoopsError

    try:
        pose = Assembly(mechanism).pose
    except OpenLoopsError as error:
        if error.size > near:
            return None
        pose = error.pose
    try:
        return rational_pose(mechanism, pose)
    except ValueError:  # ratios of couplings that are no numbers, or long ones
        return None


def _mended(found: _AtZero) -> Mechanism | None:
    """The mechanism as it is where it needs no mending; None where it cannot be mended."""
    mechanism, snapping = found.mechanism, found.snapping
    if not (found.meets and found.noise > (0.0 if found.is_general else PRECISION)):
        return mechanism
    for base_first in (False, True):
        mended = found.mended(base_first)
        if not found.kept_by(left := _AtZero(mended, snapping, found.at_pose, found)):
            continue
        snapping.snaps.append(found.snap)
        if unequal := left.unequal:
            doubt = "different: if they are meant to be equal, fewer parameters may show than are counted"
            snapping.snaps.append(Snap(found.snap.element, "lengths nearly equal", doubt, unequal))
        return mended
    # digits of doubles, equal lengths alone, or numbers that are taken as they stand
    as_it_is = found.broken < PRECISION or not found.is_general or snapping.literal
    return mechanism if as_it_is else None


def _broken(found: _AtZero) -> str:
    return (
        f"rounding has broken relations between axes of {shown_loops(found.mechanism)} (nearly parallel, perpendicular "
        f"or meeting, to {found.noise:.1g}), which cannot all be restored: state them with more digits, or in frames "
        "that are turned by multiples of 15 degrees"
    )


@dataclass(frozen=True)
class _Pose:
    """A frame in the base frame: in doubles, modulo a prime, and exactly where symbols cancel."""

    floats: Floats = field(default_factory=lambda: np.eye(4))
    residues: Sequence[Sequence[int]] = field(
        default_factory=lambda: [[int(i == j) for j in range(4)] for i in range(4)]
    )
    exact: Placement | None = None


class _AtZero:
    """All axes and points of a mechanism, in the base frame, where all coordinates are zero."""

    near: float  # how far axes may be from relations that are meant, and closures from meeting, rad
    within: float  # how far lengths may be from others, of the largest offset

    def __init__(
        self, mechanism: Mechanism, snapping: Snapping, at_pose: bool = False, like: _AtZero | None = None
    ) -> None:
        self.mechanism, self.snapping, self.at_pose = mechanism, snapping, at_pose
        self._known, self._values = known_values(mechanism), stated_values(mechanism)
        self.poses: dict[int, _Pose] = {GROUND: _Pose(exact=Placement())}
        self.motions: dict[str, Station] = {}
        self._links = dict[Station, tuple[object, ...]]()  # between which axes of motions are; some are in one joint
        for body in range(len(mechanism.bodies)):
            self._follow(body)
        self.near, self.within = (like.near, like.within) if like else self._tolerances()
        self._open = set[str]()  # closures
        self._gap = 0.0  # by how much closures that meet are open by rounding, rad or lengths
        self.ends = {closure.name: tuple(self._ends(closure)) for closure in mechanism.closures}
        self._join_points()

    def _coarseness(self) -> float:
        """How coarse numbers are, by what axes miss, most of which no chance has put so near to one another."""
        most, ends = self.snapping.angle_tolerance(""), (s for c in self.mechanism.closures for s in self._own_ends(c))
        stations = (*self.motions.values(), *ends, *([self.gravity] if self.gravity else []))
        axes = [station for station in stations if station.axis is not None]
        pairs = [(a, b) for a, b in combinations(axes, 2) if not set(a.bodies).isdisjoint(b.bodies)]
        missed = sorted(miss for a, b in pairs for miss in a.missed(b, most, most, self._scale, self._field.p))
        if len(missed) >= _FEW:
            return missed[len(missed) // 2]
        sines = (float(np.linalg.norm(np.cross(a.direction, b.direction))) for a, b in pairs)
        return max((sine for sine in sines if sine < most), default=0.0)

    def _own_ends(self, closure: Closure) -> Iterator[Station]:
        """The axes of a closure on its two bodies."""
        for body, frame in ((closure.first, closure.first_frame), (closure.second, closure.second_frame)):
            if closure.kind in _LINES:
                yield self._station(self._moved(self.poses[body], frame), 2, True, False, (body, body))

    def _tolerances(self) -> tuple[float, float]:
        """How far directions and lengths may be from what is meant, by what rounding of the file is seen to do."""
        coarse, most = self._coarseness(), self.snapping.angle_tolerance("")
        near, digit = min(max(NEAR, _TIMES * coarse), most), self._last_digit() / self._scale
        if coarse < PRECISION or digit > most:  # lengths have few digits because they need no more
            digit = 0.0
        return near, max(LENGTH_TOLERANCE, min(_LENGTHS * coarse, near), _UNITS * digit)

    def _last_digit(self) -> float:
        """What the last decimal of offsets of joints stands for; closures may have been computed from them."""
        placements = (s for body in self.mechanism.bodies for s in body.joint.steps if isinstance(s, Placement))
        numbers = (n for p in placements for entry in p.translation for n in entry.terms.values())
        parts = [Fraction(part) for number in numbers for part in parts_of(number)]
        return next((10.0**-d for d in range(DIGITS) if all((part * 10**d).denominator == 1 for part in parts)), 0.0)

    @cached_property
    def is_general(self) -> bool:
        """Whether frames are turned by angles that are no multiples of 15°."""
        return any(entry.generators() for placement in self._placements for entry in placement.entries())

    @property
    def meets(self) -> bool:
        """Whether the loops are closed there."""
        return not self._open

    @cached_property
    def stations(self) -> list[Station]:
        """All axes and points."""
        ends = [station for ends in self.ends.values() for station in ends]
        return [*self.motions.values(), *ends, *([self.gravity] if self.gravity else [])]

    @cached_property
    def gravity(self) -> Station | None:
        """Its direction, if that is known: a coordinate axis, or the z axis of a frame."""
        base, parts = self.poses[GROUND], self.mechanism.gravity or ()
        if len(axes := [k for k, part in enumerate(parts) if part]) == 1:
            return self._station(base, axes[0], False, False, _BASE)
        if not axes or not self._known.keys() >= {s for part in parts for s in part.symbols()}:
            return None
        down = np.array([part.at(self._known) for part in parts])
        residues = [part.evaluate(self._residues, self._field.embed) for part in parts]
        return Station(*_pointing(base.floats, base.residues, down, residues), 2, False, False, _BASE, None)

    def _join_points(self) -> None:
        """Two points at which the same bodies are joined are a hinge: the axis through them takes their place."""
        joined = dict[frozenset[int], list[Closure]]()
        for closure in self.mechanism.closures:
            joined.setdefault(frozenset((closure.first, closure.second)), []).append(closure)
        for pair in joined.values():
            if [closure.kind for closure in pair] != [ClosureKind.SPHERICAL] * 2:
                continue
            start, end = (self.ends[closure.name][0] for closure in pair)
            if (apart := end.place - start.place).any():
                residues = [b - a for a, b in zip(start.modulo(3), end.modulo(3), strict=True)]
                pose = _pointing(start.pose, start.residues, apart, residues)
                slack = max(_LEAST_SLACK, self._scale / float(np.linalg.norm(apart)))
                hinge = Station(*pose, 2, True, False, start.bodies, None, slack)
                self.ends |= {pair[0].name: (hinge,), pair[1].name: ()}

    @property
    def noise(self) -> float:
        """By how much relations in loops are missed that are nearly true; 0 if all are exact, rad or lengths."""
        return max(self.broken, self._gap if self._gap_matters else 0.0)

    @property
    def _gap_matters(self) -> bool:
        """Whether loops that miss may not close: by digits of doubles redundant ones do not where lengths are equal."""
        equal = (u == v for (_, u), (_, v) in pairwise(sorted(self._lengths())))
        return self.is_general and (self._gap > PRECISION or (self._gap > 0 and any(equal)))

    @cached_property
    def broken(self) -> float:
        """The same of relations beside those that close the loops."""
        return max(self.misses[0], self.unequal) or self.misses[1]

    @cached_property
    def unequal(self) -> float:
        """By how much lengths differ that are nearly equal; 0 if these are exactly so."""
        near = ((b - a, u != v) for (a, u), (b, v) in pairwise(sorted(self._lengths())))
        return max((max(apart, NOISE) for apart, differ in near if apart < self.within and differ), default=0.0)

    @cached_property
    def misses(self) -> tuple[float, float]:
        """By how much relations between axes are missed at most, without those between two points and with them."""
        found = [0.0, 0.0]
        for a, b in self._pairs:
            for k in range(a.is_between or b.is_between, 2):
                found[k] = max((found[k], *a.missed(b, self.near, self.within, self._scale, self._field.p)))
        beside = self._beside
        return max(found[0], beside), max(found[1], beside)

    @property
    def _beside(self) -> float:
        """By how much points of joints miss axes on the same link at most."""
        on = {s: set(self._links.get(s, s.bodies)) for s in self._looped}
        points = [s for s in on if s.is_point]
        lines = [s for s in on if s.is_line and not s.is_point and not s.is_between]
        pairs = ((a, b) for a, b in product(points, lines) if not on[a].isdisjoint(on[b]))
        return max((a.beside(b, self.within, self._scale, self._field.p) for a, b in pairs), default=0.0)

    def kept_by(self, other: _AtZero) -> bool:
        """Whether another reading has exact relations, and its axes and points are where they are here."""
        near = _MOVED * max(self.noise, NOISE)
        for one, two in zip(self.stations, other.stations, strict=True):
            if not (one.axis is None or one.is_between) and np.linalg.norm(one.direction - two.direction) > near:
                return False
            apart = two.place - one.place
            if one.is_line and not one.is_point:
                apart = np.cross(apart, one.direction)
            if (one.is_line or one.is_point) and np.linalg.norm(apart) > near * self.extent:
                return False
        return not any(other.misses)

    @property
    def extent(self) -> float:
        """How far axes and points are away, m."""
        return max(self._scale, *(float(np.linalg.norm(s.place)) for s in self.stations))

    @property
    def snap(self) -> Snap:
        """What is said of it."""
        what = f"axes of {shown_loops(self.mechanism)}"
        return Snap(what, RESTORED, "exactly so", self.noise)

    # -- at zero ---------------------------------------------------------------------------------------------------

    @cached_property
    def _placements(self) -> list[Placement]:
        steps = [step for body in self.mechanism.bodies for step in body.joint.steps]
        return [s for s in steps if isinstance(s, Placement)] + [
            p for c in self.mechanism.closures for p in c.placements
        ]

    @cached_property
    def _looped(self) -> list[Station]:
        """Those on bodies of loops, and on what carries these."""
        parents = [body.parent for body in self.mechanism.bodies]
        ways = [parted(c.first, c.second, parents.__getitem__) for c in self.mechanism.closures]
        bodies = {member for way in ways for chain in way for body in chain for member in (body, parents[body])}
        return [s for s in self.stations if not bodies.isdisjoint(s.bodies)]

    @property
    def _pairs(self) -> Iterator[tuple[Station, Station]]:
        """Axes on one link; what others are to one another changes with the pose."""
        axes = [(s, set(self._links.get(s, s.bodies))) for s in self._looped if s.axis is not None]
        return ((a, b) for (a, on), (b, other) in combinations(axes, 2) if not on.isdisjoint(other))

    @cached_property
    def _field(self) -> PrimeField:
        return PrimeField.random(random_generator(DEFAULT_SEED), CERTIFICATE_BITS)

    @cached_property
    def _residues(self) -> dict[str, int]:
        entries = [entry for placement in self._placements for entry in placement.entries()]
        generators = {g for entry in (*entries, *(self.mechanism.gravity or ())) for g in entry.generators()}
        rng, exact = random_generator(DEFAULT_SEED), set(self._values.names)
        found = self._values.residues(sorted(g for g in generators if symbol_of(g) in exact), self._field, rng)
        points = dict[str, tuple[Residues, Residues]]()
        for generator in sorted(generators - found.keys()):  # of symbols whose values are floats only
            count, name = multiple_of(generator)
            point = points.setdefault(name, self._field.circle(self._field.draw(rng, (1,))))
            found[generator] = int(self._field.multiply_angle(point, count)[0 if generator.startswith("cos") else 1][0])
        return found

    def _moved(self, pose: _Pose, placement: Placement) -> _Pose:
        p, embed = self._field.p, self._field.embed
        entries = [entry.evaluate(self._residues, embed) % p for entry in placement.entries()]
        own = [[*entries[3 * k : 3 * k + 3], entries[9 + k]] for k in range(3)] + [[0, 0, 0, 1]]
        product = [[sum(a * own[k][j] for k, a in enumerate(row)) % p for j in range(4)] for row in pose.residues]
        exact = None if pose.exact is None else pose.exact @ placement
        return _Pose(pose.floats @ placement_matrix(placement, self._known), product, exact)

    def _follow(self, body: int) -> None:
        """The stations of a joint, and where it leads to."""
        pose, held = self.poses[self.mechanism.bodies[body].parent], (self.mechanism.bodies[body].parent, body)
        joint = self.mechanism.bodies[body].joint
        links = pairwise((held[0], *((body, motion.name) for motion in joint.motions[1:]), body))
        for step in joint.steps:
            if isinstance(step, Placement):
                pose = self._moved(pose, step)
                continue
            is_ball = step.kind is MotionKind.BALL
            axis = None if is_ball else step.axis
            station = self._station(pose, axis, step.kind in _TURNS, is_ball, held)
            self.motions[step.name], self._links[station] = station, next(links)
        self.poses[body] = pose if pose.exact is None or is_number(pose.exact) else replace(pose, exact=None)

    def _station(self, pose: _Pose, axis: int | None, is_line: bool, is_point: bool, held: tuple[int, int]) -> Station:
        return Station(pose.floats, pose.residues, axis, is_line, is_point, held, pose.exact)

    def _ends(self, closure: Closure) -> Iterator[Station]:
        """The frames of a closure: one if they meet, except for a universal joint, whose axes are not parallel."""
        kind = closure.kind
        axis = None if kind in (ClosureKind.WELD, ClosureKind.SPHERICAL) else 2
        one = self._moved(self.poses[closure.first], closure.first_frame)
        two = self._moved(self.poses[closure.second], closure.second_frame)
        apart = np.linalg.inv(one.floats) @ two.floats
        missed = [apart[k, 3] / self._scale for k in kind.positions]
        missed += [apart[i, j] - value for i, j, value in kind.directions]
        meets = max(map(abs, missed)) < max(self.near, self.within)
        axes = (0, 1) if kind is ClosureKind.UNIVERSAL else (axis,) if meets else (axis, axis)
        if not meets:
            self._open.add(closure.name)
        else:
            if not self.at_pose and self._is_open(kind, one, two):  # a pose in doubles closes nothing exactly
                self._gap = max(self._gap, NOISE, *map(abs, missed))
            one = _with_place(one, two)  # along what is free the first frame may be moved
        for pose, which in zip((one, two), axes, strict=False):
            yield self._station(pose, which, kind in _LINES, kind in _POINTS, (closure.first, closure.second))

    def _is_open(self, kind: ClosureKind, one: _Pose, two: _Pose) -> bool:
        """Whether frames do not meet exactly."""
        (x, y), p = (list(zip(*pose.residues, strict=True)) for pose in (one, two)), self._field.p
        way = [b - a for a, b in zip(x[3], y[3], strict=True)]
        missed = [dot(x[k], way, p) for k in kind.positions]
        return any(missed) or any((dot(x[i], y[j], p) - value) % p for i, j, value in kind.directions)

    @cached_property
    def _scale(self) -> float:
        """The largest offset, m."""
        offsets = [abs(entry.at(self._known)) for p in self._placements for entry in p.translation]
        return max(offsets, default=0.0) or 1.0

    def _lengths(self) -> Iterator[tuple[float, int]]:
        """Distances on links between points, or between parallel axes, with their squares modulo the prime."""
        p = self._field.p
        for one, two in combinations([s for s in self._looped if s.is_line or s.is_point], 2):
            apart = (two.place - one.place) / self._scale
            way = one.way(two, p)
            if set(one.bodies).isdisjoint(two.bodies) or np.linalg.norm(apart) < self.within:
                continue
            if one.is_point and two.is_point:
                yield float(np.linalg.norm(apart)), dot(way, way, p)
            elif one.is_line and two.is_line and np.linalg.norm(np.cross(one.direction, two.direction)) < self.near:
                across = cross(way, one.along, p)
                yield float(np.linalg.norm(np.cross(apart, one.direction))), dot(across, across, p)

    # -- mended ----------------------------------------------------------------------------------------------------

    def mended(self, base_first: bool) -> Mechanism:
        """The mechanism with exact axes and points, by directions of the base or of the most relations first."""
        noise = self.misses[0] or self.broken or self._gap
        stations = [s for s in self.stations if s is not self.gravity or s.exact]
        apart, most = max(self._gap, self.unequal), (self.near, self.within)
        exact = ExactFrames(stations, noise, apart, self.extent, most, base_first)
        bodies, closures = list[Body](), list[Closure]()
        at = {body: pose.exact or rational_frame(pose.floats) for body, pose in self.poses.items()}
        for k, body in enumerate(self.mechanism.bodies):
            here, steps = at[body.parent], list[Step]()
            for motion in body.joint.motions:
                there = exact.frame(self.motions[motion.name])
                steps += [here.inverse() @ there, motion]
                here = there
            joint = replace(body.joint, steps=merge((*steps, here.inverse() @ at[k])))
            bodies.append(replace(body, joint=joint))
        for closure in self.mechanism.closures:
            if not (ends := self.ends[closure.name]):
                continue
            one, two = exact.frame(ends[0]), exact.frame(ends[-1])
            first, second = at[closure.first].inverse() @ one, at[closure.second].inverse() @ two
            kind = ClosureKind.REVOLUTE if ends[0].is_between else closure.kind
            closures.append(Closure(closure.name, kind, closure.first, closure.second, first, second))
        gravity = self._fallen(exact)
        return replace(self.mechanism, bodies=tuple(bodies), closures=tuple(closures), gravity=gravity)

    def _fallen(self, exact: ExactFrames) -> Vector | None:
        """Gravity beside the exact axes of the base."""
        parts = self.mechanism.gravity
        if parts is None or self.gravity is None or self.gravity.exact:
            return parts
        axes = list[tuple[Vector, float]]()
        for s in sorted(self.stations, key=lambda s: s.slack):
            if s.axis is not None and GROUND in s.bodies and s is not self.gravity:
                x, y, z = (row[s.axis] for row in exact.frame(s).rotation)
                axes.append(((x, y, z), self.near * s.slack))
        x, y, z = (as_polynomial(Fraction(f"{part.at(self._known):.12g}")) for part in parts)
        return exact_gravity((x, y, z), axes)


def _pointing(
    pose: Floats, residues: Sequence[Sequence[int]], along: Floats, exact: Sequence[int]
) -> tuple[Floats, list[list[int]]]:
    """A pose whose z axis has another direction, in doubles and modulo a prime."""
    floats = pose.copy()
    floats[:3, 2] = along / np.linalg.norm(along)
    rows = zip(residues, (*exact, 0), strict=True)
    return floats, [[x, y, z, place] for (x, y, _, place), z in rows]


def _with_place(pose: _Pose, other: _Pose) -> _Pose:
    """A pose at the place of another one."""
    floats = pose.floats.copy()
    floats[:3, 3] = other.floats[:3, 3]
    residues = [[*row[:3], moved[3]] for row, moved in zip(pose.residues, other.residues, strict=True)]
    if pose.exact is None or other.exact is None:
        return _Pose(floats, residues)
    return _Pose(floats, residues, Placement(pose.exact.rotation, other.exact.translation))
