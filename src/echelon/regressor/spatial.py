"""Three-vectors over any scalar that knows + − ×."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from echelon.program.tape import Program, Scalar

Vec = tuple[Scalar, Scalar, Scalar]
Mat = tuple[Vec, Vec, Vec]


def add(a: Vec, b: Vec) -> Vec:
    """a + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def scale(a: Vec, factor: Scalar) -> Vec:
    """factor · a."""
    return (a[0] * factor, a[1] * factor, a[2] * factor)


def dot(a: Vec, b: Vec) -> Scalar:
    """a · b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vec, b: Vec) -> Vec:
    """a × b."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def apply(matrix: Mat, v: Vec) -> Vec:
    """Matrix times vector."""
    return (dot(matrix[0], v), dot(matrix[1], v), dot(matrix[2], v))


def product(left: Mat, right: Mat) -> Mat:
    """Matrix product."""
    columns = transposed(right)
    return transposed((apply(left, columns[0]), apply(left, columns[1]), apply(left, columns[2])))


def identity(program: Program) -> Mat:
    """The unit matrix."""
    zero, one = program.zero, program.one
    return ((one, zero, zero), (zero, one, zero), (zero, zero, one))


def transposed(matrix: Mat) -> Mat:
    """Transpose."""
    (a, b, c), (d, e, f), (g, h, i) = matrix
    return ((a, d, g), (b, e, h), (c, f, i))


def quaternion_times(quaternion: Iterable[Any], vector: Iterable[Any]) -> tuple[Any, Any, Any, Any]:
    """The product of a quaternion (w, x, y, z) and a vector, of any numbers; half of it with a velocity is its rate."""
    (w, x, y, z), (a, b, c) = quaternion, vector
    return (-x * a - y * b - z * c, w * a + y * c - z * b, w * b + z * a - x * c, w * c + x * b - y * a)
