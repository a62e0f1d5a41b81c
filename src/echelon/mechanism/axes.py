"""Joint axes in numbers: where they are, how far apart, and how a joint brings the next one into place."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from math import cos, pi, sin

import numpy as np

from echelon.arrays import Floats
from echelon.exact.angle import STEPS_PER_HALF_TURN, Angle
from echelon.exact.numbers import Rational
from echelon.exact.polynomial import Polynomial
from echelon.mechanism.joint import Motion, MotionKind
from echelon.mechanism.placement import Placement, as_matrix, shift, turn

_SNAP = 1e-9
"""Rotations this near to exact ones, and lengths this near to nine decimals, are those."""
_PARALLEL = 1e-6


@dataclass(frozen=True)
class Axis:
    """A joint axis in the second's base frame."""

    kind: MotionKind
    point: Floats
    direction: Floats

    @staticmethod
    def of(frame: Placement, motion: Motion) -> Axis:
        """The axis of a motion in a frame whose placement is constant."""
        matrix = as_floats(frame)
        return Axis(motion.kind, matrix[:3, 3], matrix[:3, motion.axis] * motion.sign)


def as_floats(placement: Placement) -> Floats:
    """A constant placement as a homogeneous matrix, shape (4, 4)."""
    matrix = np.eye(4)
    for i in range(3):
        matrix[i, :3] = [number_of(entry) for entry in placement.rotation[i]]
        matrix[i, 3] = number_of(placement.translation[i])
    return matrix


def number_of(entry: Polynomial) -> float:
    """Value of a polynomial without symbols."""
    value = entry.number
    assert value is not None, "the caller puts numbers in for symbols"
    return float(value)


def moved(motion: Motion, value: float) -> Placement:
    """What a motion does at a value of its coordinate; exact at multiples of 15° and nine decimals."""
    amount = value * motion.sign
    if motion.kind is MotionKind.TRANSLATION:
        offset = [Polynomial({})] * 3
        offset[motion.axis] = Polynomial.constant(_rational(amount))
        return shift(*offset)
    steps = amount * STEPS_PER_HALF_TURN / pi
    if abs(steps - round(steps)) < _SNAP * STEPS_PER_HALF_TURN:
        return turn(motion.axis, Angle(Fraction(round(steps), STEPS_PER_HALF_TURN)))
    matrix = np.eye(3)
    i, j = (motion.axis + 1) % 3, (motion.axis + 2) % 3
    matrix[i, i] = matrix[j, j] = cos(amount)
    matrix[j, i], matrix[i, j] = sin(amount), -sin(amount)
    return constant_placement(matrix, np.zeros(3))


def _rational(value: float) -> Rational:
    """A float as the decimal that is meant, if it is one."""
    near = Fraction(f"{value:.9f}")
    exact = near if abs(float(near) - value) < 1e-3 * _SNAP else Fraction(value)
    return exact.numerator if exact.denominator == 1 else exact


def constant_placement(rotation: Floats, translation: Floats) -> Placement:
    """A placement with numbers for entries: the decimals that the floats mean."""
    entries = [[Polynomial.constant(_rational(float(v))) for v in row] for row in rotation]
    x, y, z = (Polynomial.constant(_rational(float(v))) for v in translation)
    return Placement(as_matrix(entries), (x, y, z))


def line_distance(a: Axis, b: Axis) -> float:
    """Distance between two nearly parallel axes, m."""
    return float(np.linalg.norm(np.cross(a.point - b.point, b.direction)))


def settling(parent: Axis, child: Axis, wanted: Axis) -> list[float]:
    """How far a joint may have to move to bring the next axis where it is wanted."""
    across = np.linalg.norm(np.cross(parent.direction, wanted.direction)) > _PARALLEL
    if parent.kind is MotionKind.TRANSLATION:
        if wanted.kind is MotionKind.TRANSLATION or not across:
            return []
        step = parent.direction - (parent.direction @ wanted.direction) * wanted.direction
        return [float((wanted.point - child.point) @ step / (step @ step))]
    if not across:  # parallel axes: turn one to the other
        here, there = (_offset(parent, axis) for axis in (child, wanted))
        if wanted.kind is MotionKind.TRANSLATION or min(np.linalg.norm(here), np.linalg.norm(there)) < _PARALLEL:
            return []
        return [angle_about(parent.direction, here, there)]
    angles = [angle_about(parent.direction, sign * child.direction, wanted.direction) for sign in (1, -1)]
    misfits = [_misfit(parent, child, wanted, angle) for angle in angles]
    fitting = [angle for angle, misfit in zip(angles, misfits, strict=True) if misfit < min(misfits) + _PARALLEL]
    return sorted(fitting, key=abs)


def _misfit(parent: Axis, child: Axis, wanted: Axis, angle: float) -> float:
    """Distance of the next axis from where it is wanted after a turn, m."""
    if wanted.kind is MotionKind.TRANSLATION:
        return 0.0
    rotation = turn_about(parent.direction, angle)
    point = parent.point + rotation @ (child.point - parent.point)
    return line_distance(Axis(child.kind, point, rotation @ child.direction), wanted)


def _offset(parent: Axis, axis: Axis) -> Floats:
    """From a joint's axis straight to a parallel one."""
    gap = axis.point - parent.point
    straight: Floats = gap - (gap @ parent.direction) * parent.direction
    return straight


def angle_about(axis: Floats, here: Floats, there: Floats) -> float:
    """The turn about an axis that takes one direction towards another; 0 if one of them is along the axis."""
    here, there = (v - (v @ axis) * axis for v in (here, there))
    if min(np.linalg.norm(here), np.linalg.norm(there)) < 1e-9:
        return 0.0
    return float(np.arctan2(axis @ np.cross(here, there), here @ there))


def turn_about(axis: Floats, angle: float) -> Floats:
    """Rodrigues' formula."""
    x, y, z = axis
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    rotation: Floats = np.eye(3) + sin(angle) * skew + (1 - cos(angle)) * skew @ skew
    return rotation


def shortest_turn(here: Floats, there: Floats) -> Floats:
    """The rotation that takes a line to another by less than a quarter turn."""
    there = there if here @ there >= 0 else -there
    normal = np.cross(here, there)
    size = float(np.linalg.norm(normal))
    return np.eye(3) if size < 1e-12 else turn_about(normal / size, float(np.arctan2(size, here @ there)))
