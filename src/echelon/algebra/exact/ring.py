"""Common factors of polynomials, by FLINT.

FLINT does not know that sines and square roots are algebraic, so they are reduced and rationalised here.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from math import gcd, lcm
from typing import Any

import flint

from echelon.algebra.exact.polynomial import (
    Monomial,
    Number,
    Polynomial,
    Surd,
    inverse,
    parts_of,
    simplest,
    surd,
)

_ONE = Polynomial.constant(1)
_MOST_RATIONALISED = 2000
"""Terms that conjugates may bring while a polynomial is looked for that is written as a quotient."""


def lowest_terms(top: Polynomial, bottom: Polynomial) -> tuple[Polynomial, Polynomial]:
    """A quotient without common factors, and with 1 as first coefficient of the denominator."""
    if not top:
        return top, _ONE
    if bottom.number is None:
        ring = Ring(top, bottom)
        short = _coprime(ring.enter(top), ring.enter(bottom))
        if (
            len(top.terms) * len(bottom.terms) ** ring.roots_in(short[1])
            <= _MOST_RATIONALISED
        ):
            plain = _coprime(*ring.rationalised(*short))
            # a true quotient is mostly longer when rationalised, but a polynomial shows itself only then
            short = plain if plain[1].is_constant() else short
        top, bottom = map(ring.leave, short)
    return _monic(top, bottom)


def _monic(top: Polynomial, bottom: Polynomial) -> tuple[Polynomial, Polynomial]:
    """Equal quotient whose denominator has the first coefficient 1."""
    lead = next(bottom.sorted_terms())[1]
    scale = inverse(lead)
    scale = scale if isinstance(scale, Surd) else simplest(scale)
    return top * scale, bottom * scale


def _coprime(top: Any, bottom: Any) -> tuple[Any, Any]:
    """FLINT polynomials divided by their greatest common divisor."""
    divisor = top.gcd(bottom)
    return top / divisor, bottom / divisor


class Ring:
    """FLINT's ring for some polynomials, with √2 and √3 as extra generators; sorted, or in a given order.

    FLINT does not know that sines and roots are algebraic, so its gcd may miss a factor that needs their squares.
    """

    def __init__(self, *polynomials: Polynomial, order: Sequence[str] = ()) -> None:
        generators = {g for polynomial in polynomials for g in polynomial.generators()}
        sines = sorted(g for g in generators if g.startswith("sin("))
        generators |= {"cos" + g[3:] for g in sines}
        self.names = (*(order or sorted(generators)), "√2", "√3")
        self.context = flint.fmpq_mpoly_ctx.get(
            ("x", len(self.names)), flint.Ordering.lex
        )
        element = dict(zip(self.names, self.context.gens(), strict=True))
        squares = {"√2": self.context.constant(2), "√3": self.context.constant(3)}
        squares |= {g: 1 - element["cos" + g[3:]] ** 2 for g in sines}
        self.squares = [
            (self.names.index(g), element[g], square) for g, square in squares.items()
        ]

    def enter(self, polynomial: Polynomial) -> Any:
        """A polynomial as an element of this ring."""
        terms: dict[tuple[int, ...], Any] = {}
        for monomial, coefficient in polynomial.terms.items():
            powers = dict(monomial)
            exponents = [powers.get(name, 0) for name in self.names[:-2]]
            for k, part in enumerate(parts_of(coefficient)):
                if part:
                    terms[*exponents, k & 1, k >> 1] = flint.fmpq(
                        part.numerator, part.denominator
                    )
        return self.context.from_dict(terms)

    def leave(self, element: Any) -> Polynomial:
        """An element without squares of roots as a polynomial."""
        terms: dict[Monomial, Number] = {}
        for exponents, coefficient in element.to_dict().items():
            monomial = tuple(
                (name, int(e))
                for name, e in zip(self.names[:-2], exponents, strict=False)
                if e
            )
            value = simplest(Fraction(int(coefficient.p), int(coefficient.q)))
            root = surd(
                *(int(k == exponents[-2] + 2 * exponents[-1]) for k in range(4))
            )
            terms[monomial] = terms.get(monomial, 0) + root * value
        return Polynomial(terms)

    def reduced(self, element: Any) -> Any:
        """Equal element with sines and roots to the first power at most."""
        for index, generator, square in self.squares:
            if element.degrees()[index] > 1:
                p, q = self._split(element, index, square)
                element = p + q * generator
        return element

    def roots_in(self, element: Any) -> int:
        """Number of sines and roots in an element."""
        degrees = element.degrees()
        return sum(bool(degrees[index]) for index, _, _ in self.squares)

    def rationalised(self, top: Any, bottom: Any) -> tuple[Any, Any]:
        """Equal quotient with a denominator free of sines and roots, by multiplying with its conjugates."""
        degrees = bottom.degrees()
        for index, element, square in self.squares:
            if not degrees[index]:
                continue
            p, q = self._split(top, index, square)
            a, b = self._split(bottom, index, square)
            top, bottom = p + q * element, a
            if b:
                top = p * a - q * b * square + (q * a - p * b) * element
                bottom = a * a - b * b * square
        return top, bottom

    def _split(self, polynomial: Any, index: int, square: Any) -> tuple[Any, Any]:
        """Parts without and with one generator, whose powers are replaced by powers of its square."""
        by_power: dict[int, dict[tuple[int, ...], Any]] = {}
        for exponents, coefficient in polynomial.to_dict().items():
            rest = (*exponents[:index], 0, *exponents[index + 1 :])
            by_power.setdefault(int(exponents[index]), {})[rest] = coefficient
        halves = [self.context.constant(0), self.context.constant(0)]
        for power, terms in by_power.items():
            halves[power % 2] += self.context.from_dict(terms) * square ** (power // 2)
        return halves[0], halves[1]


# -- factors and remainders, with rational coefficients and independent generators -------------------------------------


def factors(polynomial: Polynomial) -> tuple[Fraction, list[tuple[Polynomial, int]]]:
    """A non-zero polynomial as a number times powers of irreducible factors.

    Every factor has coprime integer coefficients and a positive first one, so equal factors are equal polynomials.

    >>> x, y = Polynomial.generator("x"), Polynomial.generator("y")
    >>> factors((y * y - x * x) * Fraction(1, 2))
    (Fraction(-1, 2), [(x + y, 1), (x - y, 1)])
    """
    ring = Ring(polynomial)
    constant, found = ring.enter(polynomial).factor()
    total, result = Fraction(int(constant.p), int(constant.q)), []
    for element, exponent in found:
        factor, scale = _primitive(ring.leave(element))
        total *= scale**exponent
        result.append((factor, int(exponent)))
    return total, sorted(result, key=lambda pair: str(pair[0]))


def _primitive(polynomial: Polynomial) -> tuple[Polynomial, Fraction]:
    """The polynomial with coprime integer coefficients, the first one positive, and the number taken out."""
    numbers = [
        Fraction(c) for _, c in polynomial.sorted_terms() if not isinstance(c, Surd)
    ]
    scale = Fraction(
        gcd(*(c.numerator for c in numbers)), lcm(*(c.denominator for c in numbers))
    )
    scale = scale if numbers[0] > 0 else -scale
    return Polynomial(
        {
            m: simplest(c / scale)
            for m, c in polynomial.terms.items()
            if not isinstance(c, Surd)
        }
    ), scale


def divided(
    polynomial: Polynomial, divisor: Polynomial, order: Sequence[str]
) -> tuple[Polynomial, Polynomial]:
    """Quotient and remainder; no term of the remainder is divisible by the first term of the divisor."""
    ring = Ring(order=order)
    quotient, rest = divmod(ring.enter(polynomial), ring.enter(divisor))
    return ring.leave(quotient), ring.leave(rest)
