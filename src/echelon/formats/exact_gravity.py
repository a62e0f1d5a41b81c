"""Gravity beside axes that became exact: along or across them as it was, but for rounding.

Only its direction matters, which needs no rational length: what is along an axis that it is meant to be perpendicular
to is taken out of it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from echelon.arrays import Floats
from echelon.exact.polynomial import Polynomial, inverse
from echelon.mechanism.joint import Vector


def exact_gravity(stated: Vector, axes: Sequence[tuple[Vector, float]]) -> Vector:
    """Gravity from what is stated, in numbers, and exact axes of the base with how near relations to them are."""
    found, across = stated, list[Vector]()
    for axis, near in axes:
        down, direction = _floats(found), _floats(axis)
        cosine = float(down @ direction / (np.linalg.norm(down) * np.linalg.norm(direction)))
        if 1 - abs(cosine) < near**2 / 2:
            x, y, z = axis
            factor = _dot(stated, axis) * inverse(_dot(axis, axis).number or 0)
            return (x * factor, y * factor, z * factor)
        if abs(cosine) < near:
            for known in across:
                axis = _without(axis, known)
            if np.linalg.norm(_floats(axis)) > near:  # it is in the plane of two others
                found, across = _without(found, axis), [*across, axis]
    return found


def _without(vector: Vector, axis: Vector) -> Vector:
    """What is perpendicular to an axis."""
    share = _dot(vector, axis) * inverse(_dot(axis, axis).number or 0)
    x, y, z = (a - b * share for a, b in zip(vector, axis, strict=True))
    return (x, y, z)


def _dot(one: Vector, two: Vector) -> Polynomial:
    return Polynomial.sum(a * b for a, b in zip(one, two, strict=True))


def _floats(vector: Vector) -> Floats:
    return np.array([entry.at({}) for entry in vector])
