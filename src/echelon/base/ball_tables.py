"""Tables of balls: columns as combinations of others, what counts as zero, and balls as decimals."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import flint
import numpy as np

from echelon.arrays import Floats, pivoted_qr
from echelon.base.ball_rows import Balls
from echelon.exact.polynomial import Number, simplest

_DIGITS = 40
_LARGEST_DENOMINATOR = 10**9
_SURELY = 1e-15  # how rarely chance may put a short fraction into a ball


def doubles(table: Balls) -> Floats:
    """The middles of balls."""
    return np.array([float(x.mid()) for x in table.flat]).reshape(table.shape)


def independent_rows(table: Balls) -> tuple[list[int], list[int]]:
    """As many rows as there are columns, the most independent ones, and the others."""
    order = pivoted_qr(doubles(table).T)[1]
    return [int(k) for k in order[: table.shape[1]]], [int(k) for k in order[table.shape[1] :]]


def combinations_of(
    table: Balls, pivots: Sequence[int], others: Sequence[int], most: int | None = None
) -> tuple[Balls, Balls] | None:
    """Columns as combinations of others, (pivots, others), and what is left of them in further rows, perhaps few.

    None if the precision does not show the pivots to be independent.
    """
    if not pivots:
        return table[:0, others], table[:most, others]
    square, further = independent_rows(table[:, pivots])
    if not others and _matrix(table[np.ix_(square, pivots)]).det().contains(
        0
    ):  # FLINT solves for nothing without a look
        return None
    try:
        solution = _array(_matrix(table[np.ix_(square, pivots)]).solve(_matrix(table[np.ix_(square, others)])))
    except ZeroDivisionError:
        return None
    return solution, left_of(table[further[:most]], pivots, others, solution)


def left_of(table: Balls, pivots: Sequence[int], others: Sequence[int], solution: Balls) -> Balls:
    """What is left of columns beside combinations of others."""
    if not pivots:
        return table[:, others]
    return _array(_matrix(table[:, others]) - _matrix(table[:, pivots]) * _matrix(solution))


def _matrix(table: Balls) -> Any:
    return flint.arb_mat(table.shape[0], table.shape[1], table.ravel().tolist())


def _array(matrix: Any) -> Balls:
    return np.array(matrix.entries(), dtype=object).reshape(matrix.nrows(), matrix.ncols())


def vanishes(x: Any, bits: int) -> bool | None:
    """Whether a ball holds zero and little else; None if it holds much else, too."""
    if not x.contains(0):
        return False
    return True if float(x.abs_upper()) < 2.0 ** (-bits / 4) else None


def ball_error(x: Any) -> float:
    """The radius of a ball."""
    return float(x.rad())


def rounded(values: Sequence[Any]) -> tuple[list[Number], float]:
    """Values to a fixed number of digits, as short fractions where these are next to them, and the largest error."""
    rounded: list[Number] = []
    radius = 0.0
    for value in values:
        fraction = _short_fraction(value)
        if fraction is None:
            fraction = Fraction(value.mid().str(_DIGITS, radius=False))
        rounded.append(simplest(fraction))
        radius = max(radius, abs(float(fraction)) * 10.0 ** (1 - _DIGITS) + 2 * ball_error(value))
    return rounded, radius


def _short_fraction(value: Any) -> Fraction | None:
    """The short fraction in a ball that is so small that none is there by chance."""
    if value.contains(0):  # it is smaller than the error allowed before
        return Fraction(0)
    middle, power = value.mid().man_exp()
    found = (int(middle) * Fraction(2) ** int(power)).limit_denominator(_LARGEST_DENOMINATOR)
    small = ball_error(value) < _SURELY / _LARGEST_DENOMINATOR**2
    return found if small and value.contains(flint.fmpq(found.numerator, found.denominator)) else None
