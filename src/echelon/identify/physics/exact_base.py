"""B in exact numbers, for proofs: rationals where all geometry is rational, else balls that surely hold the truth.

Floats are what they are, dyadic fractions; numbers of files are the decimals that stand there.  Sines and cosines of
angles with no exact meaning, and roots, are balls of 256 bits; what is structurally zero stays an exact zero.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import flint
import numpy as np
import numpy.typing as npt

from echelon.base.model import BaseModel
from echelon.errors import InputError
from echelon.exact.expressions import parse
from echelon.exact.numbers import Number, Surd
from echelon.exact.polynomial import cosine, is_trigonometric, symbol_of
from echelon.program.balls import ball

Array = npt.NDArray[Any]

BITS = 256


@dataclass(frozen=True)
class ExactBase:
    """B by rows.

    Attributes
    ----------
    rows : tuple of dict of int to number
        Non-zero entries by column: FLINT rationals, or balls.
    pivots : tuple of int
    columns : int
    rational : bool
        Whether all entries are rational.
    """

    rows: tuple[dict[int, Any], ...]
    pivots: tuple[int, ...]
    columns: int
    rational: bool

    def combination(self, factors: list[Any]) -> list[Any]:
        """factorsᵀ B, a number per column; columns that no row touches are the integer 0."""
        total: list[Any] = [0] * self.columns
        for factor, row in zip(factors, self.rows, strict=True):
            for column, value in row.items():
                total[column] = total[column] + factor * value
        return total

    def completed(self, standard: list[Any], values: list[Any]) -> list[Any]:
        """Standard parameters with those pivots for which B ζ = values holds exactly."""
        found = list(standard)
        for pivot, row, value in zip(self.pivots, self.rows, values, strict=True):
            found[pivot] = value - sum((v * standard[c] for c, v in row.items() if c != pivot), flint.fmpq(0))
        return found


@contextmanager
def precision(bits: int = BITS) -> Iterator[None]:
    """Balls of so many bits inside."""
    before = flint.ctx.prec
    flint.ctx.prec = bits
    try:
        yield
    finally:
        flint.ctx.prec = before


def exact_base(base: BaseModel) -> ExactBase:
    """B of a model in exact numbers; call it, and use what it returns, inside :func:`precision`.

    Raises
    ------
    InputError
        If a symbol has no value.
    """
    numbers = {name: _symbol(base, name) for name in base.matrix.symbols}
    rational = all(isinstance(v, Fraction) for v in numbers.values()) and not any(
        is_trigonometric(g) for g in base.matrix.generators
    )
    if rational:
        rational = not any(
            isinstance(coefficient, Surd)
            for row in base.matrix.rows
            for entry in row.values()
            for polynomial in (entry.numerator, entry.denominator)
            for coefficient in polynomial.terms.values()
        )
    embed = rational_number if rational else ball
    values: dict[str, Any] = {}
    for generator in base.matrix.generators:
        number = embed(numbers[symbol_of(generator)])
        if is_trigonometric(generator):
            number = number.cos() if generator == cosine(symbol_of(generator)) else number.sin()
        values[generator] = number
    rows = tuple({c: entry.evaluate(values, embed) for c, entry in row.items()} for row in base.matrix.rows)
    return ExactBase(rows, base.matrix.pivots, len(base.parameters), rational)


def _symbol(base: BaseModel, name: str) -> Number:
    symbol = base.mechanism.symbols.get(name)
    if symbol is None or symbol.value is None:
        raise InputError(f"symbol '{name}' has no value, so base parameters cannot be tested")
    exact = parse(symbol.exact).number if symbol.exact else None
    if exact is None:
        return Fraction(repr(symbol.value))
    return exact if isinstance(exact, Surd) else Fraction(exact)


def rational_number(value: Any) -> Any:
    """A FLINT rational of a Python or NumPy number, exactly."""
    fraction = Fraction(float(value)) if isinstance(value, float | np.floating) else Fraction(value)
    return flint.fmpq(fraction.numerator, fraction.denominator)
