"""Points and directions whose coordinates are balls of 420 bits, as object arrays of shape (3,)."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from flint import arb, fmpq

BITS = 420

Vec = npt.NDArray[Any]
Mat = npt.NDArray[Any]


def exactly(value: float | str | arb) -> arb:
    """A decimal number without the error of its binary form."""
    if isinstance(value, arb):
        return value
    digits, _, power = str(value).partition("e")
    whole, _, part = digits.partition(".")
    return arb(fmpq(int(whole + part), 10 ** len(part)) * fmpq(10) ** int(power or 0))


def vec(x: float | arb, y: float | arb, z: float | arb) -> Vec:
    return np.array([exactly(value) for value in (x, y, z)], dtype=object)


def flat(*pairs: tuple[float | arb, float | arb]) -> list[Vec]:
    """Points (x, z) of the plane y = 0."""
    return [vec(x, 0, z) for x, z in pairs]


X, Y, Z = (
    np.array([arb(int(i == j)) for j in range(3)], dtype=object) for i in range(3)
)


def length(v: Vec) -> arb:
    return (v @ v).sqrt()


def unit(v: Vec) -> Vec:
    return v / length(v)


def cross(a: Vec, b: Vec) -> Vec:
    (ax, ay, az), (bx, by, bz) = a, b
    return np.array(
        [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], dtype=object
    )


def middle(a: Vec, b: Vec) -> Vec:
    return (a + b) / 2


def rotation(axis: Vec, angle: float | arb) -> Mat:
    """Rodrigues' formula, for an axis of any length."""
    x, y, z = unit(axis)
    zero, angle = arb(0), exactly(angle)
    skew = np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]], dtype=object)
    one = np.array([X, Y, Z], dtype=object)
    return one + angle.sin() * skew + (1 - angle.cos()) * (skew @ skew)


def degrees(angle: float) -> arb:
    return exactly(angle) * arb.pi() / 180


def about(axis: Vec, angle: float, v: Vec, center: Vec | None = None) -> Vec:
    """A vector, or a point about a center, turned by degrees."""
    start = center if center is not None else v * 0
    return start + rotation(axis, degrees(angle)) @ (v - start)


def half_turned(v: Vec, axis: Vec) -> Vec:
    """A vector turned by 180 degrees about an axis through the origin."""
    return unit(axis) * (2 * (v @ unit(axis))) - v


def meeting(a: Vec, ra: float | arb, b: Vec, rb: float | arb, side: int = 1) -> Vec:
    """The point of the plane y = 0 at distance ra from a and rb from b; `side` chooses among the two."""
    ra, rb, apart = exactly(ra), exactly(rb), length(b - a)
    along = (ra * ra - rb * rb + apart * apart) / (2 * apart)
    ex = unit(b - a)
    return a + ex * along + cross(ex, Y) * ((ra * ra - along * along).sqrt() * side)


def beyond(a: Vec, b: Vec, distance: float | arb) -> Vec:
    """The point on the line from a through b at a distance from a."""
    return a + unit(b - a) * exactly(distance)
