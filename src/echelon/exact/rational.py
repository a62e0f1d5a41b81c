"""Quotients of polynomials, reduced to lowest terms.

In the classical base-to-tip order the entries of B are polynomials, so the denominator is almost always 1 and every
operation takes a short cut.  Other column orders bring true denominators; then common factors are cancelled with
FLINT's multivariate gcd.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from fractions import Fraction
from functools import partial
from typing import Any, TypeVar

import flint

from echelon.exact.numbers import Number, Surd, inverse, parts_of, surd
from echelon.exact.polynomial import Polynomial, as_polynomial, format_polynomial

T = TypeVar("T")
_ONE = Polynomial.constant(1)
_CONJUGATIONS = ((1, -1, 1, -1), (1, 1, -1, -1))  # signs of 1, √2, √3, √6 when √2 or √3 changes its sign


class RationalFunction:
    """An immutable quotient of polynomials in lowest terms, with a normalised denominator.

    Examples
    --------
    >>> a, b = Polynomial.generator("a"), Polynomial.generator("b")
    >>> RationalFunction(a * a - b * b, a * 2 + b * 2)
    a/2 - b/2
    """

    __slots__ = ("denominator", "numerator")

    def __init__(self, numerator: Polynomial | Number, denominator: Polynomial | Number = _ONE) -> None:
        top, bottom = as_polynomial(numerator), as_polynomial(denominator)
        if not bottom:
            raise ZeroDivisionError("a rational function needs a non-zero denominator")
        if bottom != _ONE:
            top, bottom = _lowest_terms(top, bottom)
        self.numerator, self.denominator = top, bottom

    def __add__(self, other: RationalFunction) -> RationalFunction:
        if self.denominator == other.denominator:
            return RationalFunction(self.numerator + other.numerator, self.denominator)
        top = self.numerator * other.denominator + other.numerator * self.denominator
        return RationalFunction(top, self.denominator * other.denominator)

    def __neg__(self) -> RationalFunction:
        return RationalFunction(-self.numerator, self.denominator)

    def __sub__(self, other: RationalFunction) -> RationalFunction:
        return self + (-other)

    def __mul__(self, other: RationalFunction) -> RationalFunction:
        return RationalFunction(self.numerator * other.numerator, self.denominator * other.denominator)

    def __truediv__(self, other: RationalFunction) -> RationalFunction:
        return RationalFunction(self.numerator * other.denominator, self.denominator * other.numerator)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, RationalFunction):
            return isinstance(other, Polynomial | int | Fraction | Surd) and self == RationalFunction(other)
        return self.numerator * other.denominator == other.numerator * self.denominator

    def __hash__(self) -> int:
        if self.is_polynomial:
            return hash(self.numerator)
        return hash(_monic(*_cancel(*_rationalised(self.numerator, self.denominator))))

    def __bool__(self) -> bool:
        return bool(self.numerator)

    @property
    def is_polynomial(self) -> bool:
        """Whether the denominator is 1."""
        return self.denominator == _ONE

    def symbols(self) -> list[str]:
        """Symbols that occur, sorted."""
        return sorted({*self.numerator.symbols(), *self.denominator.symbols()})

    def evaluate(self, values: Mapping[str, T], number: Callable[[Number], T]) -> T:
        """Value over any field; see :meth:`Polynomial.evaluate`."""
        top: Any = self.numerator.evaluate(values, number)
        return top if self.is_polynomial else top / self.denominator.evaluate(values, number)  # type: ignore[no-any-return]

    def __repr__(self) -> str:
        top = format_polynomial(self.numerator)
        if self.is_polynomial:
            return top
        return f"({top})/({format_polynomial(self.denominator)})"


def _lowest_terms(top: Polynomial, bottom: Polynomial) -> tuple[Polynomial, Polynomial]:
    if not top:
        return top, _ONE
    if bottom.number is None:
        plain = _rationalised(top, bottom)
        reduced = _cancel(*plain)
        # where rationalising leaves a true quotient, the original is the shorter one
        top, bottom = reduced if plain[1] is bottom or reduced[1].number is not None else _cancel(top, bottom)
    return _monic(top, bottom)


def _monic(top: Polynomial, bottom: Polynomial) -> tuple[Polynomial, Polynomial]:
    """The same quotient with 1 as first coefficient of the denominator."""
    lead = next(bottom.sorted_terms())[1]
    scale = inverse(lead)
    return top * _plain(scale), bottom * _plain(scale)


def _plain(x: Number) -> Number:
    """An integral fraction as an int."""
    return x.numerator if isinstance(x, Fraction) and x.denominator == 1 else x


def _rationalised(top: Polynomial, bottom: Polynomial) -> tuple[Polynomial, Polynomial]:
    """The same quotient with a denominator free of sines and roots; in lowest terms it is unique."""
    sines = [g for g in bottom.generators() if g.startswith("sin(")]
    flips = [*(partial(_flip_sine, g) for g in sines), *(partial(_flip_roots, signs) for signs in _CONJUGATIONS)]
    for flip in flips:
        conjugate = flip(bottom)
        if conjugate != bottom:
            top, bottom = top * conjugate, bottom * conjugate
    return top, bottom


def _flip_sine(sine: str, polynomial: Polynomial) -> Polynomial:
    return Polynomial({m: -c if (sine, 1) in m else c for m, c in polynomial.terms.items()})


def _flip_roots(signs: tuple[int, ...], polynomial: Polynomial) -> Polynomial:
    parts = {m: parts_of(c) for m, c in polynomial.terms.items()}
    return Polynomial({m: surd(*(s * x for s, x in zip(signs, p, strict=True))) for m, p in parts.items()})


def _cancel(top: Polynomial, bottom: Polynomial) -> tuple[Polynomial, Polynomial]:
    """Divide both by their greatest common divisor; √2 and √3 take part as extra generators.

    Sines, cosines and roots are independent generators here, so with them the quotient is correct but perhaps not the
    shortest one (see :func:`_rationalised`).
    """
    names = tuple(sorted({*top.generators(), *bottom.generators(), "√2", "√3"}))
    context = flint.fmpq_mpoly_ctx.get(("x", len(names)), flint.Ordering.lex)
    flint_top, flint_bottom = _to_flint(top, names, context), _to_flint(bottom, names, context)
    divisor = flint_top.gcd(flint_bottom)
    return _from_flint(flint_top / divisor, names), _from_flint(flint_bottom / divisor, names)


def _to_flint(polynomial: Polynomial, names: tuple[str, ...], context: Any) -> Any:
    index = {name: i for i, name in enumerate(names)}
    terms: dict[tuple[int, ...], Any] = {}
    for monomial, coefficient in polynomial.terms.items():
        exponents = [0] * len(names)
        for generator, exponent in monomial:
            exponents[index[generator]] = exponent
        parts = coefficient.parts if isinstance(coefficient, Surd) else (coefficient,)
        for k, part in enumerate(parts):
            if part:
                exponents[index["√2"]], exponents[index["√3"]] = k & 1, k >> 1
                value = Fraction(part)
                terms[tuple(exponents)] = flint.fmpq(value.numerator, value.denominator)
    return context.from_dict(terms)


def _from_flint(polynomial: Any, names: tuple[str, ...]) -> Polynomial:
    roots: dict[str, Polynomial] = {
        "√2": Polynomial.constant(Surd((0, 1, 0, 0))),
        "√3": Polynomial.constant(Surd((0, 0, 1, 0))),
    }
    parts = []
    for exponents, coefficient in polynomial.to_dict().items():
        value = _plain(Fraction(int(coefficient.p), int(coefficient.q)))
        part = Polynomial.constant(value)
        for name, exponent in zip(names, exponents, strict=True):
            if exponent:
                part = part * (roots.get(name) or Polynomial.generator(name)) ** int(exponent)
        parts.append(part)
    return Polynomial.sum(parts)
