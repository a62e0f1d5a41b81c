"""B in exact numbers, for proofs: rationals where geometry is rational, else balls that surely hold the truth.

Floats are what they are, dyadic fractions; numbers of files are the decimals that stand there.  Entries with roots, or
with sines and cosines of angles that have no exact ones, are balls of 256 bits; what is zero stays an exact zero.
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
    values: dict[str, Any] = {}
    for generator in base.matrix.generators:
        symbol = _symbol(base, symbol_of(generator))
        if is_trigonometric(generator):
            angle = ball(symbol)
            values[generator] = angle.cos() if generator == cosine(symbol_of(generator)) else angle.sin()
        else:
            values[generator] = _embedded(symbol)
    rows = tuple({c: entry.evaluate(values, _embedded) for c, entry in row.items()} for row in base.matrix.rows)
    rational = all(isinstance(entry, flint.fmpq) for row in rows for entry in row.values())
    return ExactBase(rows, base.matrix.pivots, len(base.parameters), rational)


def _embedded(value: Number) -> Any:
    """A FLINT rational, or a ball for a number with roots."""
    return ball(value) if isinstance(value, Surd) else rational_number(value)


def _symbol(base: BaseModel, name: str) -> Number:
    symbol = base.mechanism.symbols.get(name)
    if symbol is None or symbol.value is None:
        raise InputError(f"symbol '{name}' has no value, so base parameters cannot be tested")
    exact = symbol.number
    if exact is None:
        return Fraction(repr(symbol.value))
    return exact if isinstance(exact, Surd) else Fraction(exact)


def rational_number(value: Any) -> Any:
    """A FLINT rational of a Python or NumPy number, exactly."""
    fraction = Fraction(float(value)) if isinstance(value, float | np.floating) else Fraction(value)
    return flint.fmpq(fraction.numerator, fraction.denominator)
