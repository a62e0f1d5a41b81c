"""Exact angles: a rational multiple of π plus rational multiples of symbols."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from math import pi

from echelon.exact.numbers import Rational, cosine_of_turn, sine_of_turn
from echelon.exact.polynomial import Polynomial, cosine, sine

STEPS_PER_HALF_TURN = 12
"""π is twelve steps of 15°, the angles with a sine and cosine in Q(√2, √3)."""

_LARGEST_EXPANSION = 8
"""cos(n x) is a polynomial of degree n in cos(x), with coefficients up to 2ⁿ that cost digits in floating point; beyond
this degree it stays a generator of its own."""


@dataclass(frozen=True)
class Angle:
    """half_turns·π + Σ coefficient·symbol + radians."""

    half_turns: Fraction = Fraction(0)  # multiple of π
    parts: tuple[tuple[str, Rational], ...] = ()  # symbolic part
    # A plain number of radians; it has no exact sine, so a reader must snap it or name it before use
    radians: Fraction = Fraction(0)

    @property
    def is_exact(self) -> bool:
        """Whether sine and cosine are polynomials in the symbols over Q(√2, √3)."""
        steps = self.half_turns * STEPS_PER_HALF_TURN
        return not self.radians and steps.denominator == 1 and all(c.denominator == 1 for _, c in self.parts)

    @property
    def value(self) -> float:
        """The numeric part, rad."""
        return float(self.half_turns) * pi + float(self.radians)

    def cos(self) -> Polynomial:
        """Cosine as a polynomial in cos and sin of the symbols."""
        return self._circle()[0]

    def sin(self) -> Polynomial:
        """Sine as a polynomial in cos and sin of the symbols."""
        return self._circle()[1]

    def _circle(self) -> tuple[Polynomial, Polynomial]:
        if not self.is_exact:
            raise ValueError(
                f"the angle {self} has no exact sine: use a multiple of pi/12 (and whole multiples of symbols), or a "
                "symbol with that value"
            )
        steps = int(self.half_turns * STEPS_PER_HALF_TURN)
        point = (Polynomial.constant(cosine_of_turn(steps)), Polynomial.constant(sine_of_turn(steps)))
        for symbol, count in self.parts:
            point = _added(point, _multiple(symbol, int(count)))
        return point

    def __str__(self) -> str:
        parts = [f"{self.half_turns}*pi"] if self.half_turns else []
        parts += [f"{count}*{symbol}" for symbol, count in self.parts]
        parts += [str(self.radians)] if self.radians else []
        return " + ".join(parts) or "0"


Point = tuple[Polynomial, Polynomial]
"""Cosine and sine of an angle."""


def multiple_of_point(point: Point, count: int) -> Point:
    """Cosine and sine of a multiple of an angle, by repeated squaring of c + i s."""
    power = (point[0], point[1] if count >= 0 else -point[1])
    result = (Polynomial.constant(1), Polynomial.constant(0))
    for bit in reversed(bin(abs(count))[2:]):
        result = _added(result, power) if bit == "1" else result
        power = _added(power, power)
    return result


def _added(a: Point, b: Point) -> Point:
    """Cosine and sine of a sum of angles."""
    return a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]


def _multiple(symbol: str, count: int) -> Point:
    """Cosine and sine of a multiple of a symbol, expanded where that is short."""
    if abs(count) <= _LARGEST_EXPANSION:
        return multiple_of_point((Polynomial.generator(cosine(symbol)), Polynomial.generator(sine(symbol))), count)
    argument = f"{abs(count)}*{symbol}"
    return Polynomial.generator(cosine(argument)), Polynomial.generator(sine(argument)) * (1 if count > 0 else -1)
