"""Exact angles: a rational multiple of π plus rational multiples of symbols."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

from echelon.exact.numbers import Rational, cosine_of_turn, sine_of_turn
from echelon.exact.polynomial import Polynomial, cosine, sine

STEPS_PER_HALF_TURN = 12
"""π is twelve steps of 15°, the angles with a sine and cosine in Q(√2, √3)."""

_LARGEST_MULTIPLE = 32  # cos(n x) is a polynomial of degree n


@dataclass(frozen=True)
class Angle:
    """half_turns·π + Σ coefficient·symbol + radians.

    Attributes
    ----------
    half_turns : Fraction
        Multiple of π.
    parts : tuple of (symbol, coefficient)
        Symbolic part.
    radians : Fraction
        A plain number of radians; it has no exact sine, so a reader must snap it or name it before use.
    """

    half_turns: Fraction = Fraction(0)
    parts: tuple[tuple[str, Rational], ...] = ()
    radians: Fraction = Fraction(0)

    @property
    def is_exact(self) -> bool:
        """Whether sine and cosine are polynomials in the symbols over Q(√2, √3)."""
        steps = self.half_turns * STEPS_PER_HALF_TURN
        whole = all(c.denominator == 1 and -_LARGEST_MULTIPLE <= c <= _LARGEST_MULTIPLE for _, c in self.parts)
        return not self.radians and steps.denominator == 1 and whole

    def cos(self) -> Polynomial:
        """Cosine as a polynomial in cos and sin of the symbols."""
        return self._circle()[0]

    def sin(self) -> Polynomial:
        """Sine as a polynomial in cos and sin of the symbols."""
        return self._circle()[1]

    def _circle(self) -> tuple[Polynomial, Polynomial]:
        if not self.is_exact:
            raise ValueError(
                f"the angle {self} has no exact sine: use a multiple of pi/12 (with at most "
                f"{_LARGEST_MULTIPLE} times a symbol), or a symbol with that value"
            )
        steps = int(self.half_turns * STEPS_PER_HALF_TURN)
        point = (Polynomial.constant(cosine_of_turn(steps)), Polynomial.constant(sine_of_turn(steps)))
        for symbol, count in self.parts:
            sign = 1 if count > 0 else -1
            step = (Polynomial.generator(cosine(symbol)), sign * Polynomial.generator(sine(symbol)))
            for _ in range(abs(int(count))):
                point = (point[0] * step[0] - point[1] * step[1], point[0] * step[1] + point[1] * step[0])
        return point

    def __str__(self) -> str:
        parts = [f"{self.half_turns}*pi"] if self.half_turns else []
        parts += [f"{count}*{symbol}" for symbol, count in self.parts]
        parts += [str(self.radians)] if self.radians else []
        return " + ".join(parts) or "0"
