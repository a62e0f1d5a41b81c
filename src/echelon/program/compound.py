"""Functions that are written with others when they are recorded, so that nothing else has to know them.

The half angle is taken for arc sines and angles of points, because its tangent is a quotient without jumps:
asin x = 2·atan(x/(1 + √(1 − x²))) and atan2(y, x) = 2·atan(y/(x + √(x² + y²))).  The sine and cosine of twice an arc
tangent are rational in its argument, so that sin(asin x) = x is found exactly.  Double precision keeps eight digits of
atan2 near the negative x-axis, where x + √(x² + y²) cancels.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import reduce

from echelon.program.scalar import Scalar, maximum, minimum


def heaviside(x: Scalar) -> Scalar:
    """0, ½ or 1 for negative, zero and positive values."""
    return (1 + x.sign()) / 2


COMPOUND: Mapping[str, tuple[int | None, Callable[[Sequence[Scalar]], Scalar]]] = {
    "sinh": (1, lambda a: a[0].sinh()),
    "cosh": (1, lambda a: a[0].cosh()),
    "asin": (1, lambda a: a[0].arcsin()),
    "acos": (1, lambda a: a[0].arccos()),
    "heaviside": (1, lambda a: heaviside(a[0])),
    "atan2": (2, lambda a: a[0].arctan2(a[1])),
    "max": (None, lambda a: reduce(maximum, a)),
    "min": (None, lambda a: reduce(minimum, a)),
}
"""By name: the number of arguments, None for any, and what is recorded."""
