"""Elimination on matrices of balls: what is surely not zero is a pivot, what may be zero is bounded.

The pivots are proved.  Columns without one are dependent up to a bound that shrinks with the precision.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from math import log2
from typing import Any

_DECIDED = 3
"""A ball that may be zero is taken as zero when it is below 2^-(precision / 3)."""


@dataclass(frozen=True)
class BallEchelon:
    """Reduced echelon form of a matrix of balls."""

    pivots: list[int]
    rows: list[list[Any]]  # one per pivot
    residual: float  # binary logarithm of the largest bound among what was taken as zero


def ball_echelon(matrix: list[list[Any]], bits: int) -> BallEchelon | None:
    """Reduced echelon form with pivots as far left as they can be, or None if the precision does not decide it."""
    rows, columns = [list(row) for row in matrix], len(matrix[0])
    pivots: list[int] = []
    residual = -float(bits)
    for column in range(columns):
        top = len(pivots)
        best = max(range(top, len(rows)), key=lambda i: float(rows[i][column].abs_lower()), default=None)
        if best is None or not float(rows[best][column].abs_lower()) > 0:
            largest = max((float(rows[i][column].abs_upper()) for i in range(top, len(rows))), default=0.0)
            if not largest < 2.0 ** (-bits / _DECIDED):
                return None
            residual = max(residual, _log2(largest))
            continue
        rows[top], rows[best] = rows[best], rows[top]
        lead = rows[top][column]
        rows[top] = [x / lead for x in rows[top]]
        for i, row in enumerate(rows):
            if i != top:
                factor = row[column]
                rows[i] = [a - factor * b for a, b in zip(row, rows[top], strict=True)]
        pivots.append(column)
    return BallEchelon(pivots, rows[: len(pivots)], residual)


def recognised(value: Any, bits: int) -> Fraction | None:
    """The one rational number of small height in a ball, or None.

    Its numerator and denominator together are several times shorter than the precision of the ball, so that another
    number would fall into it by chance with a probability below 2^-(bits / 6).
    """
    middle = _exact(value.mid())
    if middle == 0 or (value.contains(0) and float(value.abs_upper()) < 2.0 ** (-bits / _DECIDED)):
        return Fraction(0)
    candidate = middle.limit_denominator(1 << (bits // 12))
    height = candidate.numerator.bit_length() + candidate.denominator.bit_length()
    near = abs(candidate - middle) <= _exact(value.rad()) + Fraction(1, 1 << (bits // 3))
    return candidate if near and height < bits // 6 else None


def _exact(x: Any) -> Fraction:
    mantissa, exponent = x.man_exp()
    return Fraction(int(mantissa)) * Fraction(2) ** int(exponent)


def _log2(x: float) -> float:
    return log2(x) if x > 0 else -1000.0  # below what a float can say
