"""Programs in ball arithmetic: every number is an interval that surely holds the true one (FLINT's ``arb``).

Balls know every function, also those whose algebraic relations are not known.  They prove that something is not zero;
that something is zero they can only bound.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import flint
import numpy as np
import numpy.typing as npt

from echelon.exact.numbers import Number, parts_of
from echelon.program.operations import Op
from echelon.program.schedule import Array

_RADICANDS = (1, 2, 3, 6)


def ball(value: Number | float) -> Any:
    """The ball of an exact number; floats are taken as the dyadic fractions that they are."""
    if isinstance(value, float):
        return flint.arb(value)
    total = flint.arb(0)
    for part, radicand in zip(parts_of(value), _RADICANDS, strict=True):
        if part:
            total += flint.arb(flint.fmpq(part.numerator, part.denominator)) * flint.arb(radicand).sqrt()
    return total


_UNARY: dict[Op, Callable[[Any], Any]] = {
    Op.NEG: lambda x: -x,
    Op.SIN: lambda x: x.sin(),
    Op.COS: lambda x: x.cos(),
    Op.TAN: lambda x: x.tan(),
    Op.EXP: lambda x: x.exp(),
    Op.LOG: lambda x: x.log(),
    Op.TANH: lambda x: x.tanh(),
    Op.SQRT: lambda x: x.sqrt(),
    Op.ABS: abs,
    Op.SIGN: lambda x: x.sgn(),
    Op.ATAN: lambda x: x.atan(),
}


class BallArithmetic:
    """Arrays of balls, or of power series with balls as coefficients, at the precision of FLINT's context.

    That is the precision at the first use, for constants are kept.
    """

    dtype: npt.DTypeLike = object
    shape: tuple[int, ...] = ()

    def __init__(self) -> None:
        self._constants: dict[Number, Any] = {}

    def constant(self, value: Number) -> Any:
        """The ball of an exact number."""
        if value not in self._constants:
            self._constants[value] = ball(value)
        return self._constants[value]

    def binary(self, op: int, a: Array, b: Array) -> Array:
        """Elementwise operation."""
        if op == Op.ADD:
            return np.asarray(a + b)
        if op == Op.SUB:
            return np.asarray(a - b)
        return np.asarray(a * b if op == Op.MUL else a / b)

    def unary(self, op: int, a: Array) -> Array:
        """Elementwise function."""
        result = np.empty(a.shape, dtype=object)
        for place in np.ndindex(a.shape):  # one by one, because power series would be taken for sequences
            result[place] = _UNARY[Op(op)](a[place])
        return result
