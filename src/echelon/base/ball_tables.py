"""Tables of balls: columns as combinations of others, what counts as zero, and balls as exact numbers or decimals."""

from __future__ import annotations

import copyreg
from collections.abc import Sequence
from fractions import Fraction
from functools import cache
from math import floor, log10
from typing import Any

import flint
import numpy as np
import numpy.typing as npt

from echelon.algebra import Number, Rational, simplest, surd
from echelon.shared import Floats, pivoted_qr

Balls = npt.NDArray[Any]
"""Array of ``arb``."""

COEFFICIENT_DIGITS = 40
"""Significant digits of coefficients that are no short exact numbers."""
SURPLUS_BITS = 40
"""Bits by which an exact number is shorter than its ball: chance finds one with a probability below 2^-40."""
LARGEST_DENOMINATOR = 4
"""Largest denominator of the fractions that rounded coefficients are read as."""
_RADICANDS = (1, 2, 3, 6)


def doubles(table: Balls) -> Floats:
    """The middles of balls."""
    return np.array([float(x.mid()) for x in table.flat]).reshape(table.shape)


def independent_rows(table: Balls) -> tuple[list[int], list[int]]:
    """As many rows as there are columns, the most independent ones, and the others."""
    order = pivoted_qr(doubles(table).T)[1]
    return [int(k) for k in order[: table.shape[1]]], [
        int(k) for k in order[table.shape[1] :]
    ]


def combinations_of(
    table: Balls, pivots: Sequence[int], others: Sequence[int], most: int | None = None
) -> tuple[Balls, Balls] | None:
    """Columns as combinations of others, (pivots, others), and what is left of them in further rows, perhaps few.

    None if the precision does not show the pivots to be independent.
    """
    if not pivots:
        return table[:0, others], table[:most, others]
    square, further = independent_rows(table[:, pivots])
    solution = solved(table, square, pivots, others)
    if solution is None:
        return None
    return solution, left_of(table[further[:most]], pivots, others, solution)


def solved(
    table: Balls, rows: Sequence[int], pivots: Sequence[int], others: Sequence[int]
) -> Balls | None:
    """Columns as combinations of as many others as there are rows, by these; None if precision does not show them."""
    square = _matrix(table[np.ix_(rows, pivots)])
    try:
        if not others:  # FLINT solves for nothing without a look
            square.solve(_matrix(table[np.ix_(rows, pivots[:1])]))
        return _array(square.solve(_matrix(table[np.ix_(rows, others)])))
    except ZeroDivisionError:
        return None


def left_of(
    table: Balls, pivots: Sequence[int], others: Sequence[int], solution: Balls
) -> Balls:
    """Residuals of columns after subtracting combinations of the pivot columns."""
    if not pivots:
        return table[:, others]
    return _array(
        _matrix(table[:, others]) - _matrix(table[:, pivots]) * _matrix(solution)
    )


def solved_for(basis: Balls, columns: Sequence[int]) -> Balls | None:
    """Rows that span the same, with the identity in some columns; None if the precision does not show it to be one."""
    if not columns:
        return basis
    try:
        found = _array(_matrix(basis[:, list(columns)]).solve(_matrix(basis)))
    except ZeroDivisionError:
        return None
    found[:, list(columns)] = flint.arb(0)
    found[range(len(columns)), list(columns)] = flint.arb(1)
    return found


def _matrix(table: Balls) -> Any:
    return flint.arb_mat(table.shape[0], table.shape[1], table.ravel().tolist())


def _array(matrix: Any) -> Balls:
    return np.array(matrix.entries(), dtype=object).reshape(
        matrix.nrows(), matrix.ncols()
    )


def vanishes(x: Any, bits: int) -> bool | None:
    """Whether a ball holds zero and little else; None if it holds much else, too."""
    if not x.contains(0):
        return False
    return True if x.abs_upper() < _zero_below(bits) else None


@cache
def _zero_below(bits: int) -> Any:
    return flint.arb(2) ** -(bits // 4)


def exponent(x: Any) -> int:
    """Binary exponent of a number that is not zero."""
    mantissa, power = x.mid().man_exp()
    return int(power) + int(mantissa).bit_length()


def ball_error(x: Any) -> float:
    """The radius of a ball."""
    return float(x.rad())


def exact_number(
    x: Any, irrational: tuple[bool, bool] = (False, False)
) -> Number | None:
    """The one number a + b√2 + c√3 + d√6 with short rational parts in a ball; None if none is short enough.

    ``irrational`` says whether √2 and √3 may occur.  An integer relation between the number and the roots is looked for
    by lattice reduction (Lenstra, Lenstra and Lovász, 1982).
    """
    if x.contains(0):  # it was shown to vanish before
        return 0
    bits = _accuracy(x)
    found: Number | None = _fraction(x, bits)
    if found is None and any(irrational):
        found = _short_surd(x, bits, irrational)
    return found


def _accuracy(x: Any) -> int:
    """Binary digits behind the point that a ball holds."""
    radius = x.rad()
    if not radius > 0:
        return int(flint.ctx.prec)
    mantissa, exponent = radius.man_exp()
    return min(int(flint.ctx.prec), -(int(exponent) + int(mantissa).bit_length()))


def _fraction(x: Any, bits: int) -> Number | None:
    longest = (bits - SURPLUS_BITS) // 2
    if longest < 1:
        return None
    middle, power = x.mid().man_exp()
    value = int(middle) * Fraction(2) ** int(power)
    found = value.limit_denominator(1 << longest)
    short = (
        abs(found.numerator) * found.denominator
    ).bit_length() + SURPLUS_BITS < bits
    if short and x.contains(flint.fmpq(found.numerator, found.denominator)):
        return simplest(found)
    return None


def _short_surd(x: Any, bits: int, irrational: tuple[bool, bool]) -> Number | None:
    possible = (True, irrational[0], irrational[1], all(irrational))
    radicands = [n for n, here in zip(_RADICANDS, possible, strict=True) if here]
    roots = [flint.arb(n).sqrt() for n in radicands]
    values = [x, *roots]
    count = len(values)
    scale = (
        bits * count // (count + 1)
    )  # so that a relation as short as can be told from chance has the shortest row
    rows = [
        [int(i == j) for j in range(count)] + [_scaled_integer(value, scale)]
        for i, value in enumerate(values)
    ]
    shortest, *parts = [int(n) for n in flint.fmpz_mat(rows).lll().tolist()[0][:count]]
    height = max(abs(n).bit_length() for n in (shortest, *parts))
    if not shortest or height * count + SURPLUS_BITS > bits:
        return None
    relation = shortest * x + sum(
        (n * root for n, root in zip(parts, roots, strict=True)), flint.arb(0)
    )
    if not relation.contains(0):
        return None
    known = {
        n: simplest(Fraction(-part, shortest))
        for n, part in zip(radicands, parts, strict=True)
    }
    return surd(*(known.get(n, 0) for n in _RADICANDS))


def _scaled_integer(x: Any, bits: int) -> int:
    middle, power = x.mid().man_exp()
    return int(int(middle) * Fraction(2) ** (int(power) + bits))


def in_decimals(x: Any) -> tuple[Rational, float]:
    """A ball rounded to a fixed number of significant digits, and a bound on the error."""
    number = simplest(Fraction(x.mid().str(COEFFICIENT_DIGITS, radius=False)))
    return number, abs(float(number)) * 10.0 ** (
        1 - COEFFICIENT_DIGITS
    ) + 2 * ball_error(x)


def supported(value: float, error: float) -> Rational:
    """A number with the digits that an error leaves, as a short fraction where it is next to one."""
    for denominator in range(1, LARGEST_DENOMINATOR + 1):
        fraction = Fraction(round(value * denominator), denominator)
        if abs(float(fraction) - value) <= error:
            return simplest(fraction)
    digits = max(0, -floor(log10(error)))
    return simplest(round(Fraction(value), digits))


def rounded(values: Sequence[Any]) -> tuple[list[Number], float]:
    """Balls as short fractions where they are such, else in decimals, and the largest error."""
    found, radius = list[Number](), 0.0
    for value in values:
        exact = exact_number(value)
        number, error = (exact, 0.0) if exact is not None else in_decimals(value)
        found.append(number)
        radius = max(radius, error)
    return found, radius


def _parts(x: Any) -> tuple[int, int]:
    mantissa, exponent = x.man_exp()
    return int(mantissa), int(exponent)


def _sent(x: Any) -> tuple[Any, tuple[tuple[int, int], tuple[int, int]]]:
    """A ball as its exact middle and radius, for copies and other processes; python-flint has no form for these."""
    return flint.arb, (_parts(x.mid()), _parts(x.rad()))


copyreg.pickle(flint.arb, _sent)
