"""Exact poses of what moves in loops, and which motions, bodies and closures belong together there.

A turning coordinate has a point of the circle: cosine and sine of its angle, or of the part of it that couplings count
in; and the angle itself, a decimal, where something travels in proportion.  A sliding coordinate has a displacement,
and a ball a unit quaternion (w, x, y, z).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import reduce
from math import cos, lcm, pi, sin

import numpy as np

from echelon.arrays import Floats
from echelon.exact.expressions import STEPS_PER_HALF_TURN, Angle, Point, added, multiple_of_point
from echelon.exact.polynomial import Polynomial, Rational, as_polynomial, simple_fraction
from echelon.mechanism.closure import Closure
from echelon.mechanism.joint import GROUND, Motion, MotionKind, Placement, Step, merge, moved_by
from echelon.mechanism.mechanism import Mechanism
from echelon.mechanism.stated import known_values, placement_matrix

_SHOWN = 4  # closures that a message names
_SAME = 1e-9  # angles that differ by less are the same, rad
_DIGITS = 15
_LARGEST_MULTIPLE = 200  # of a rational point of the circle, whose digits multiply too

ExactPose = Mapping[str, tuple[Polynomial, ...]]
"""Positions by motion."""


def rational_pose(mechanism: Mechanism, pose: Floats) -> ExactPose:
    """Positions of what moves in loops next to a pose, of angles rational points of the circle.

    Ratios of couplings without a value, or of so many digits that the points would not end, raise ValueError.
    """
    if _largest_multiple(mechanism) > _LARGEST_MULTIPLE:
        raise ValueError(f"angles that are turned by more than {_LARGEST_MULTIPLE} times a common part")
    return _exact_pose(mechanism, dict(zip(mechanism.positions, map(float, pose), strict=True)), _rational_angle)


def stated_exactly(mechanism: Mechanism) -> ExactPose:
    """Positions at the assembly pose, zero where it says nothing; empty if an angle there is no multiple of 15°."""
    upright = {m.positions[0]: 1.0 for m in mechanism.motions if m.kind is MotionKind.BALL}
    values = dict.fromkeys(mechanism.positions, 0.0) | upright | dict(mechanism.assembly)
    try:
        return _exact_pose(mechanism, values, _angle_on_the_grid)
    except ValueError:  # ratios of couplings that are no numbers, too
        return {}


def _exact_pose(
    mechanism: Mechanism, values: Mapping[str, float], turned: Callable[[float, int], tuple[Polynomial, ...]]
) -> ExactPose:
    """Positions at some values; ``turned`` gives cosine and sine of one of the parts of an angle, and the angle."""
    parts, involved, travels = angle_parts(mechanism), loop_motions(mechanism), travelling(mechanism)
    exact = dict[str, tuple[Polynomial, ...]]()
    for motion in mechanism.motions:
        if motion.name not in involved:
            continue
        if motion.kind is MotionKind.BALL:
            exact[motion.name] = tuple(map(as_polynomial, unit_quaternion([values[n] for n in motion.positions])))
        elif motion.kind is MotionKind.TRANSLATION:
            exact[motion.name] = (as_polynomial(Fraction(f"{values[motion.name]:.{_DIGITS}f}")),)
        else:
            exact[motion.name] = turned(values[motion.name], parts.get(motion.name, 1))[: 2 + (motion.name in travels)]
    return exact


def _rational_angle(value: float, parts: int) -> tuple[Polynomial, ...]:
    cosine, sine, *_ = unit_quaternion([cos(value / parts), sin(value / parts), 0.0, 0.0])
    return tuple(map(as_polynomial, (cosine, sine, Fraction(value))))


def _angle_on_the_grid(value: float, parts: int) -> tuple[Polynomial, ...]:
    turn = Fraction(round(value / parts / pi * STEPS_PER_HALF_TURN), STEPS_PER_HALF_TURN)
    if abs(value - parts * turn * pi) > _SAME:
        raise ValueError("an angle without an exact sine")
    angle = Angle(turn)
    return angle.cos(), angle.sin(), as_polynomial(parts * turn * Fraction(pi))


def unit_quaternion(parts: Sequence[float]) -> list[Fraction]:
    """The rational point of the unit sphere next to a quaternion, by stereographic projection from the far side."""
    lead = max(range(4), key=lambda k: abs(parts[k]))
    sign = 1 if parts[lead] >= 0 else -1
    t = [Fraction(x / (parts[lead] + sign)).limit_denominator(10**_DIGITS) for x in parts]
    square = sum((x * x for k, x in enumerate(t) if k != lead), Fraction(0))
    return [sign * (1 - square if k == lead else 2 * x) / (1 + square) for k, x in enumerate(t)]


def angle_parts(mechanism: Mechanism) -> dict[str, int]:
    """In how many parts angles count, so that couplings take whole multiples of one; 1 where absent."""
    parts: dict[str, int] = {}
    for coupling in mechanism.couplings:
        for name, function in coupling.terms:
            parts[name] = lcm(parts.get(name, 1), _rational(function.ratio, coupling.coordinate).denominator)
    return parts


def _largest_multiple(mechanism: Mechanism) -> int:
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


def counted_from(mechanism: Mechanism, pose: ExactPose, *, back: bool = False) -> Mechanism:
    """The mechanism with coordinates of loops that are zero at a pose; with ``back`` as before."""
    placed = _Placed(mechanism, pose)
    bodies = (replace(b, joint=replace(b.joint, steps=placed.counted(b.joint.steps, back))) for b in mechanism.bodies)
    return replace(mechanism, bodies=tuple(bodies))


def met_frame(mechanism: Mechanism, closure: Closure, pose: Floats) -> Floats:
    """The first frame of a closure in the frame of its second body at a pose (positions,), a homogeneous matrix."""
    known, values = known_values(mechanism), dict(zip(mechanism.positions, map(float, pose), strict=True))
    for coupling in mechanism.couplings:
        values[coupling.coordinate] = sum(f.floats(values[name], known)[0] for name, f in coupling.terms)

    def moved(motion: Motion) -> Placement:
        here = [as_polynomial(Fraction(values[name])) for name in motion.positions]
        if motion.kind is MotionKind.BALL:
            return turned_by(*here)
        angle = 0.0 if motion.kind is MotionKind.TRANSLATION else values[motion.name]
        cosine, sine = (as_polynomial(Fraction(f(angle))) for f in (cos, sin))
        return moved_by(motion, cosine, sine, here[0])

    def placed(bodies: Sequence[int]) -> Floats:
        steps = [step for body in reversed(bodies) for step in mechanism.bodies[body].joint.steps]
        placements = [step if isinstance(step, Placement) else moved(step) for step in steps]
        return reduce(np.matmul, (placement_matrix(step, known) for step in placements), np.eye(4))

    inward, outward = ends_of(mechanism, closure)
    met: Floats = np.linalg.inv(placed(outward)) @ placed(inward) @ placement_matrix(closure.first_frame, known)
    return met


class _Placed:
    """Placements of bodies at a pose."""

    def __init__(self, mechanism: Mechanism, pose: ExactPose) -> None:
        self.mechanism, self.pose = mechanism, pose
        self._parts = angle_parts(mechanism)

    def counted(self, steps: Sequence[Step], back: bool) -> tuple[Step, ...]:
        """Steps with the pose before their motions, or taken out of them."""
        found = list[Step]()
        for step in steps:
            if isinstance(step, Motion) and all(name in self.pose for name, _ in self._leaders(step.name)):
                moved = self._moved(step)
                found.append(moved.inverse() if back else moved)
            found.append(step)
        return merge(tuple(found))

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
