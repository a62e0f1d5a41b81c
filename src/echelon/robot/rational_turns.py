"""Rotations by rational numbers."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

from echelon.algebra import (
    Polynomial,
    Rational,
    as_polynomial,
    simple_fraction,
)
from echelon.robot.joint import Placement


def turned_by(
    w: Polynomial, x: Polynomial, y: Polynomial, z: Polynomial, *, twice: Rational = 2
) -> Placement:
    """The rotation of a unit quaternion, or of another one with 2 by the square of its length."""
    one = Polynomial.constant(1)
    return Placement(
        (
            (
                one - (y * y + z * z) * twice,
                (x * y - w * z) * twice,
                (x * z + w * y) * twice,
            ),
            (
                (x * y + w * z) * twice,
                one - (x * x + z * z) * twice,
                (y * z - w * x) * twice,
            ),
            (
                (x * z - w * y) * twice,
                (y * z + w * x) * twice,
                one - (x * x + y * y) * twice,
            ),
        )
    )


def rational_rotation(quaternion: Sequence[float], tolerance: float) -> Placement:
    """The rotation by rational numbers next to that of a quaternion of any length."""
    lead = max(map(abs, quaternion))
    w, x, y, z = parts = [
        simple_fraction(float(part) / lead, tolerance) for part in quaternion
    ]
    square = sum(part * part for part in parts)
    return turned_by(*map(as_polynomial, (w, x, y, z)), twice=Fraction(2) / square)
