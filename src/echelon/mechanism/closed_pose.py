"""Exact poses at which the loops of a mechanism are closed because the second frames were made to follow there.

A turning coordinate has a point of the circle: cosine and sine of its angle, or of the part of it that couplings count
in; and the angle itself, a decimal, where something travels in proportion.  A sliding coordinate has a displacement,
and a ball a unit quaternion (w, x, y, z).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import reduce
from math import lcm
from operator import matmul

import numpy as np

from echelon.exact.expressions import Point, added, multiple_of_point
from echelon.exact.polynomial import Polynomial, Rational, as_polynomial, simple_fraction
from echelon.mechanism.closure import Closure, ClosureKind
from echelon.mechanism.joint import GROUND, Motion, MotionKind, Placement, Step, merge, moved_by
from echelon.mechanism.mechanism import ClosedAt, Mechanism
from echelon.mechanism.stated import known_values, placement_matrix

_SHOWN = 4  # closures that a message names
_ROUNDING = 1e-15


def angle_parts(mechanism: Mechanism) -> dict[str, int]:
    """In how many parts angles count, so that couplings take whole multiples of one; 1 where absent."""
    parts: dict[str, int] = {}
    for coupling in mechanism.couplings:
        for name, function in coupling.terms:
            parts[name] = lcm(parts.get(name, 1), _rational(function.ratio, coupling.coordinate).denominator)
    return parts


def largest_multiple(mechanism: Mechanism) -> int:
    """The most parts of an angle that couplings take."""
    parts, terms = angle_parts(mechanism), ((c, *term) for c in mechanism.couplings for term in c.terms)
    multiples = [_rational(function.ratio, c.coordinate) * parts[name] for c, name, function in terms]
    return int(max(map(abs, multiples), default=1))


def travelling(mechanism: Mechanism) -> set[str]:
    """Names of the motions that turn while something travels in proportion: screws, and what racks follow."""
    kinds = {motion.name: motion.kind for motion in mechanism.motions}
    found = {name for name, kind in kinds.items() if kind is MotionKind.SCREW}
    for coupling in mechanism.couplings:
        if kinds[coupling.coordinate] in (MotionKind.TRANSLATION, MotionKind.SCREW):
            found |= {name for name, _ in coupling.terms if kinds[name] is not MotionKind.TRANSLATION}
    return found


def loop_motions(mechanism: Mechanism, closures: Sequence[Closure] | None = None) -> set[str]:
    """Names of the motions that all loops or those of some closures involve, of leaders instead of coupled ones."""
    closures = mechanism.closures if closures is None else closures
    bodies = {body for closure in closures for chain in ends_of(mechanism, closure) for body in chain}
    names = {motion.name for body in bodies for motion in mechanism.bodies[body].joint.motions}
    leaders = {c.coordinate: {name for name, _ in c.terms} for c in mechanism.couplings}
    return {leader for name in names for leader in leaders.get(name, {name})}


def shown_loops(mechanism: Mechanism, coordinate: str | None = None) -> str:
    """The loops, or those that a coordinate moves in, by their closures and bodies; of many, the first ones."""
    motion = next((m.name for m in mechanism.motions if coordinate in m.velocities), None)
    through = [c for c in mechanism.closures if motion in loop_motions(mechanism, [c])] or mechanism.closures
    shown = "the loops closed by " + ", ".join(f"'{c.name}' ({mechanism.ends(c.name)})" for c in through[:_SHOWN])
    return shown if len(through) <= _SHOWN else f"{shown} and {len(through) - _SHOWN} others"


def follow(mechanism: Mechanism, pose: ClosedAt) -> Mechanism:
    """A mechanism whose loops are closed at a pose: the second frames are where the first ones are."""
    placed = _Placed(mechanism, pose)
    closures = tuple(placed.followed(closure) for closure in mechanism.closures)
    return replace(mechanism, closures=closures, closed_at=pose, stated_closures=mechanism.closures)


def counted_from(mechanism: Mechanism, pose: ClosedAt, *, back: bool = False) -> Mechanism:
    """The mechanism with coordinates of loops that are zero at a pose; with ``back`` as before."""
    placed = _Placed(mechanism, pose)
    bodies = (replace(b, joint=replace(b.joint, steps=placed.counted(b.joint.steps, back))) for b in mechanism.bodies)
    return replace(mechanism, bodies=tuple(bodies))


def as_stated(mechanism: Mechanism) -> Mechanism:
    """The mechanism with the frames of its loops as they were before some were made to follow."""
    return replace(mechanism, closures=mechanism.stated_closures, closed_at={}, stated_closures=())


class _Placed:
    """Placements of bodies at a pose."""

    def __init__(self, mechanism: Mechanism, pose: ClosedAt) -> None:
        self.mechanism, self.pose = mechanism, pose
        self._parts = angle_parts(mechanism)

    def followed(self, closure: Closure) -> Closure:
        """The closure with its second frame where the first one is."""
        inward, outward = ends_of(self.mechanism, closure)
        back = [step.inverse() for body in outward for step in reversed(self._steps(body))]
        there = [step for body in reversed(inward) for step in self._steps(body)]
        mount = tuple(step for step in (*back, *there) if not step.is_identity)
        if not any(x.generators() for step in (*mount, *closure.placements) for x in step.entries()):
            met = reduce(matmul, mount, Placement()) @ closure.first_frame
            if closure.is_closed(met.inverse() @ reduce(matmul, closure.placements[1:])):
                return closure  # there already, with a second axis or a place along the first of its own
        frame = closure.first_frame
        if closure.kind is ClosureKind.UNIVERSAL:
            frame @= self._second_axis(closure, mount)
        return replace(closure, second_mount=mount, second_frame=frame)

    def _second_axis(self, closure: Closure, mount: Sequence[Placement]) -> Placement:
        """The turn about x, the first axis, that brings y to the second axis, next to where it is stated."""
        known = known_values(self.mechanism)
        met, stated = (
            reduce(np.matmul, (placement_matrix(step, known) for step in steps))
            for steps in ((*mount, closure.first_frame), closure.placements[1:])
        )
        y = (met.T @ stated)[:3, 1]
        return rational_rotation((1 + y[1], y[2], 0.0, 0.0) if y[1] > 0 else (y[2], 1 - y[1], 0.0, 0.0), _ROUNDING)

    def counted(self, steps: Sequence[Step], back: bool) -> tuple[Step, ...]:
        """Steps with the pose before their motions, or taken out of them."""
        found = list[Step]()
        for step in steps:
            if isinstance(step, Motion) and all(name in self.pose for name, _ in self._leaders(step.name)):
                moved = self._moved(step)
                found.append(moved.inverse() if back else moved)
            found.append(step)
        return merge(tuple(found))

    def _steps(self, body: int) -> list[Placement]:
        steps = self.mechanism.bodies[body].joint.steps
        return [step if isinstance(step, Placement) else self._moved(step) for step in steps]

    def _moved(self, motion: Motion) -> Placement:
        if motion.kind is MotionKind.BALL:
            return turned_by(*self.pose[motion.name])
        slides = motion.kind is MotionKind.TRANSLATION
        point = (Polynomial.constant(1), Polynomial({})) if slides else self._point(motion.name)
        return moved_by(motion, *point, self._travel(motion.name))

    def _leaders(self, name: str) -> list[tuple[str, Fraction]]:
        """The motions that one follows, and ratios; itself if it follows none."""
        coupling = next((c for c in self.mechanism.couplings if c.coordinate == name), None)
        return [(name, Fraction(1))] if coupling is None else [(n, _rational(f.ratio, name)) for n, f in coupling.terms]

    def _travel(self, name: str) -> Polynomial:
        """A displacement, or an angle as such."""
        return Polynomial.sum(self.pose[leader][-1] * ratio for leader, ratio in self._leaders(name))

    def _point(self, name: str) -> Point:
        """Cosine and sine."""
        points = [
            multiple_of_point((self.pose[leader][0], self.pose[leader][1]), int(ratio * self._parts.get(leader, 1)))
            for leader, ratio in self._leaders(name)
        ]
        return reduce(added, points)


def ends_of(mechanism: Mechanism, closure: Closure) -> tuple[list[int], list[int]]:
    """The bodies between each end of a closure and what carries both, the outermost first."""
    return parted(closure.first, closure.second, lambda body: mechanism.bodies[body].parent)


def parted(first: int, second: int, parent: Callable[[int], int]) -> tuple[list[int], list[int]]:
    """Two members of a tree, each with those that carry it up to where they meet, outward."""
    chains: tuple[list[int], list[int]] = ([], [])
    for chain, member in zip(chains, (first, second), strict=True):
        while member != GROUND:
            chain.append(member)
            member = parent(member)
    while all(chains) and chains[0][-1] == chains[1][-1]:
        for chain in chains:
            chain.pop()
    return chains


def _rational(ratio: Polynomial | None, name: str) -> Fraction:
    number = None if ratio is None else ratio.number
    if not isinstance(number, (int, Fraction)):
        raise ValueError(f"the coupling of '{name}' has a ratio that is not a rational number")
    return Fraction(number)


def turned_by(w: Polynomial, x: Polynomial, y: Polynomial, z: Polynomial, *, twice: Rational = 2) -> Placement:
    """The rotation of a unit quaternion, or of another one with 2 by the square of its length."""
    one = Polynomial.constant(1)
    return Placement(
        (
            (one - (y * y + z * z) * twice, (x * y - w * z) * twice, (x * z + w * y) * twice),
            ((x * y + w * z) * twice, one - (x * x + z * z) * twice, (y * z - w * x) * twice),
            ((x * z - w * y) * twice, (y * z + w * x) * twice, one - (x * x + y * y) * twice),
        )
    )


def rational_rotation(quaternion: Sequence[float], tolerance: float) -> Placement:
    """The rotation by rational numbers next to that of a quaternion of any length."""
    lead = max(map(abs, quaternion))
    w, x, y, z = parts = [simple_fraction(float(part) / lead, tolerance) for part in quaternion]
    square = sum(part * part for part in parts)
    return turned_by(*map(as_polynomial, (w, x, y, z)), twice=Fraction(2) / square)
