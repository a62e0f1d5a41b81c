"""Balls: what a program can be evaluated in beside floats and residues."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from operator import methodcaller, neg
from typing import Any

import flint
import numpy as np
import numpy.typing as npt

from echelon.algebra.exact.expressions import parse, pi_generators
from echelon.algebra.exact.polynomial import Number, parts_of
from echelon.algebra.program.operations import FUNCTIONS, Op
from echelon.algebra.program.schedule import Array

BALL_BITS = 512
"""Usual precision of balls; comparisons and exchanges, which lose digits, take twice as many bits."""

Balls = npt.NDArray[Any]
"""Array of ``arb``."""

_RADICANDS = (1, 2, 3, 6)


def ball(value: Number | float) -> Any:
    """The ball of an exact number; floats are taken as the dyadic fractions that they are."""
    if isinstance(value, float):
        return flint.arb(value)
    total = flint.arb(0)
    for part, radicand in zip(parts_of(value), _RADICANDS, strict=True):
        if part:
            total += (
                flint.arb(flint.fmpq(part.numerator, part.denominator))
                * flint.arb(radicand).sqrt()
            )
    return total


_ARC = "atan(sqrt(", "))"
_TWICE = "2*atan(", ")"


def arc_text(tangent_squared: Fraction) -> str:
    """The value of an angle by the square of its tangent, as text for :func:`stated_ball`."""
    return f"{_ARC[0]}{tangent_squared}{_ARC[1]}"


def twice_arc_text(half_tangent: Fraction) -> str:
    """The value of an angle by the tangent of its half, as text for :func:`stated_ball`."""
    return f"{_TWICE[0]}{half_tangent}{_TWICE[1]}"


def stated_ball(text: str) -> Any:
    """The ball of a stated value, at the precision of FLINT's context."""
    if text.startswith(_TWICE[0]):
        return (
            2
            * ball(
                Fraction(text.removeprefix(_TWICE[0]).removesuffix(_TWICE[1]))
            ).atan()
        )
    if text.startswith(_ARC[0]):
        square = Fraction(text.removeprefix(_ARC[0]).removesuffix(_ARC[1]))
        return flint.arb(flint.fmpq(square.numerator, square.denominator)).sqrt().atan()
    return parse(text).evaluate(pi_generators(flint.arb.pi()), ball)


_METHODS: dict[Op, Callable[[Any], Any]] = {
    op: methodcaller(op.name.lower()) for op in FUNCTIONS
}
_METHODS |= {Op.NEG: neg, Op.ABS: abs, Op.SIGN: methodcaller("sgn")}
_UNARY = {op: np.frompyfunc(function, 1, 1) for op, function in _METHODS.items()}


class BallArithmetic:
    """Arrays of balls, or of power series with balls as coefficients, at the precision of FLINT's context.

    That is the precision at the first use, for constants are kept.  A ball surely holds the true number, and knows
    every function, also those whose algebraic relations are not known.  Balls prove that something is not zero; that
    something is zero they can only bound.
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
        return np.asarray(_UNARY[Op(op)](a))
