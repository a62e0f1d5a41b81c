"""Factors and remainders of polynomials with rational coefficients, by FLINT."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import flint

from echelon.exact.numbers import Number, Surd
from echelon.exact.polynomial import Monomial, Polynomial

Factors = list[tuple[Polynomial, int]]
"""Irreducible polynomials with their exponents."""


def is_rational(polynomial: Polynomial) -> bool:
    """Whether no coefficient has a square root in it."""
    return not any(isinstance(c, Surd) for c in polynomial.terms.values())


def factors(polynomial: Polynomial) -> tuple[Fraction, Factors]:
    """A non-zero polynomial with rational coefficients as a number times irreducible factors.

    Every factor has coprime integer coefficients and a positive first one, so equal factors are equal polynomials.
    Generators are taken as independent.

    >>> x, y = Polynomial.generator("x"), Polynomial.generator("y")
    >>> factors((y * y - x * x) * Fraction(1, 2))
    (Fraction(-1, 2), [(x + y, 1), (x - y, 1)])
    """
    names = polynomial.generators()
    ring = _context(len(names))
    constant, found = _enter(polynomial, names, ring).factor()
    total, result = _fraction(constant), []
    for element, exponent in found:
        raw = _leave(element, names)
        plain, scale = _primitive(raw)
        total *= scale**exponent
        result.append((plain, int(exponent)))
    return total, sorted(result, key=lambda pair: str(pair[0]))


def divided(polynomial: Polynomial, divisor: Polynomial, order: Sequence[str]) -> tuple[Polynomial, Polynomial]:
    """Quotient and remainder; no term of the remainder is divisible by the first term of the divisor."""
    ring = _context(len(order))
    quotient, rest = divmod(_enter(polynomial, order, ring), _enter(divisor, order, ring))
    return _leave(quotient, order), _leave(rest, order)


def _primitive(polynomial: Polynomial) -> tuple[Polynomial, Fraction]:
    """The polynomial with coprime integer coefficients, the first one positive, and the number taken out."""
    coefficients = [Fraction(c) for _, c in polynomial.sorted_terms() if not isinstance(c, Surd)]
    numerator, denominator = flint.fmpz(0), flint.fmpz(1)
    for c in coefficients:
        numerator = flint.fmpz(c.numerator).gcd(numerator)
        denominator = flint.fmpz(c.denominator).lcm(denominator)
    scale = Fraction(int(numerator), int(denominator)) * (1 if coefficients[0] > 0 else -1)
    return Polynomial({m: _plain(Fraction(c) / scale) for m, c in polynomial.terms.items()}), scale  # type: ignore[arg-type]


def _context(size: int) -> Any:
    return flint.fmpq_mpoly_ctx.get(("x", max(1, size)), flint.Ordering.lex)


def _enter(polynomial: Polynomial, names: Sequence[str], ring: Any) -> Any:
    width = max(1, len(names))
    position = {name: k for k, name in enumerate(names)}
    terms = {}
    for monomial, coefficient in polynomial.terms.items():
        exponents = [0] * width
        for name, exponent in monomial:
            exponents[position[name]] = exponent
        value = Fraction(coefficient)  # type: ignore[arg-type]
        terms[tuple(exponents)] = flint.fmpq(value.numerator, value.denominator)
    return ring.from_dict(terms)


def _leave(element: Any, names: Sequence[str]) -> Polynomial:
    terms: dict[Monomial, Number] = {}
    for exponents, coefficient in element.to_dict().items():
        monomial = tuple(sorted((name, int(e)) for name, e in zip(names, exponents, strict=False) if e))
        terms[monomial] = _plain(_fraction(coefficient))
    return Polynomial(terms)


def _fraction(value: Any) -> Fraction:
    return Fraction(int(value.p), int(value.q))


def _plain(value: Fraction) -> Number:
    return value.numerator if value.denominator == 1 else value
