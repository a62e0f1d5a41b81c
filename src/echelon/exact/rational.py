"""Quotients of polynomials, reduced to lowest terms.

In the classical base-to-tip order the entries of B are polynomials, so the denominator is almost always 1 and every
operation takes a short cut.  Other column orders bring true denominators; then common factors are cancelled with
FLINT's multivariate gcd.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from fractions import Fraction
from hashlib import sha256
from math import gcd, lcm
from typing import Any, TypeVar

import flint
import numpy as np

from echelon.errors import DegenerateSampleError
from echelon.exact.field import PrimeField, Residues
from echelon.exact.polynomial import (
    Monomial,
    Number,
    Polynomial,
    Surd,
    as_polynomial,
    format_polynomial,
    generator_values,
    inverse,
    parts_of,
    simplest,
    surd,
)

T = TypeVar("T")
_ONE = Polynomial.constant(1)
_FIELD = PrimeField.of(2147483543)
_MOST_RATIONALISED = 2000
"""Terms that conjugates may bring while a polynomial is looked for that is written as a quotient."""
_PRODUCT, _QUOTIENT = 300.0, 1000.0
"""Operations on residues that take as long as a product of two terms, and as its part of a quotient."""


class RationalFunction:
    """An immutable quotient of polynomials in lowest terms, with a normalised denominator.

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
        return _value_somewhere(self)

    def __bool__(self) -> bool:
        return bool(self.numerator)

    @property
    def is_polynomial(self) -> bool:
        """Whether the denominator is 1."""
        return self.denominator == _ONE

    @property
    def is_one(self) -> bool:
        """Whether it is the number 1."""
        return self.numerator == _ONE and self.denominator == _ONE

    def generators(self) -> list[str]:
        """Generators that occur, sorted."""
        return sorted({*self.numerator.generators(), *self.denominator.generators()})

    def symbols(self) -> list[str]:
        """Symbols that occur, sorted."""
        return sorted({*self.numerator.symbols(), *self.denominator.symbols()})

    def evaluate(self, values: Mapping[str, T], number: Callable[[Number], T]) -> T:
        """Value over any field; see :meth:`Polynomial.evaluate`."""
        top: Any = self.numerator.evaluate(values, number)
        return top if self.is_polynomial else top / self.denominator.evaluate(values, number)  # type: ignore[no-any-return]

    def residue(self, generators: Mapping[str, int], field: PrimeField) -> int:
        """The residue for given residues of the generators."""
        top = self.numerator.evaluate(generators, field.embed) % field.p
        if self.is_polynomial:
            return top
        return top * field.invert(self.denominator.evaluate(generators, field.embed)) % field.p

    def __repr__(self) -> str:
        top = format_polynomial(self.numerator)
        if self.is_polynomial:
            return top
        return f"({top})/({format_polynomial(self.denominator)})"


ONE = RationalFunction(1)


def sum_of_products(products: Sequence[tuple[RationalFunction, RationalFunction]]) -> RationalFunction:
    """The sum of some products, brought to lowest terms once; quickest where first factors are :data:`ONE` itself."""
    if len(products) == 1 and products[0][0] is ONE:
        return products[0][1]
    groups: dict[Polynomial, list[Polynomial]] = {}
    for a, b in products:
        top = b.numerator if a is ONE else a.numerator * b.numerator
        bottom = b.denominator if a is ONE or a.is_polynomial else a.denominator * b.denominator
        groups.setdefault(bottom, []).append(top)
    tops = {bottom: Polynomial.sum(parts) for bottom, parts in groups.items()}
    if tops.keys() <= {_ONE}:
        return RationalFunction(tops.get(_ONE, 0))
    ring = Ring(*tops)
    shared = ring.context.constant(1)
    for bottom in tops:
        element = ring.enter(bottom)
        shared = shared * (element / shared.gcd(element))
    scaled = [top * ring.leave(shared / ring.enter(bottom)) for bottom, top in tops.items()]
    return RationalFunction(Polynomial.sum(scaled), ring.leave(shared))


def cost_of_products(products: Sequence[tuple[RationalFunction, RationalFunction]]) -> float:
    """Operations of :func:`sum_of_products`, in the count of :class:`echelon.exact.field.Work`."""
    true = [(a, b) for a, b in products if a is not ONE]
    if not true:
        return 0.0
    size = sum(len(a.numerator.terms) * len(b.numerator.terms) for a, b in true)
    plain = all(a.is_polynomial and b.is_polynomial for a, b in products)
    return size * (_PRODUCT if plain else _QUOTIENT)


def _lowest_terms(top: Polynomial, bottom: Polynomial) -> tuple[Polynomial, Polynomial]:
    if not top:
        return top, _ONE
    if bottom.number is None:
        ring = Ring(top, bottom)
        short = _coprime(ring.enter(top), ring.enter(bottom))
        if len(top.terms) * len(bottom.terms) ** ring.roots_in(short[1]) <= _MOST_RATIONALISED:
            plain = _coprime(*ring.rationalised(*short))
            # a true quotient is mostly longer when rationalised, but a polynomial shows itself only then
            short = plain if plain[1].is_constant() else short
        top, bottom = map(ring.leave, short)
    return _monic(top, bottom)


def residues_of_generators(
    generators: Iterable[str], symbols: Mapping[str, Residues], field: PrimeField
) -> dict[str, Residues]:
    """Residues of generators for given symbols; an angle symbol is given by the tangent of its half."""

    def circle(t: Residues, count: int) -> tuple[Residues, Residues]:
        point = field.circle(t)
        return point if count == 1 else field.multiply_angle(point, count)

    return generator_values(generators, symbols.__getitem__, circle)


def residues_at(generators: Iterable[str], symbols: Mapping[str, Residues], field: PrimeField) -> dict[str, int]:
    """The same at one geometry.  Shapes: symbols (1,)."""
    return {g: int(value[0]) for g, value in residues_of_generators(generators, symbols, field).items()}


def _value_somewhere(function: RationalFunction) -> int:
    """The value at a fixed point modulo a fixed prime, which is the same however a quotient is written."""
    digests = {name: sha256(name.encode()).digest()[:4] for name in function.symbols()}
    point = {name: np.array([int.from_bytes(d, "little") % _FIELD.p]) for name, d in digests.items()}
    try:
        return function.residue(residues_at(function.generators(), point, _FIELD), _FIELD)
    except DegenerateSampleError:
        return 0


def _monic(top: Polynomial, bottom: Polynomial) -> tuple[Polynomial, Polynomial]:
    """The same quotient with 1 as first coefficient of the denominator."""
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
        self.context = flint.fmpq_mpoly_ctx.get(("x", len(self.names)), flint.Ordering.lex)
        element = dict(zip(self.names, self.context.gens(), strict=True))
        squares = {"√2": self.context.constant(2), "√3": self.context.constant(3)}
        squares |= {g: 1 - element["cos" + g[3:]] ** 2 for g in sines}
        self.squares = [(self.names.index(g), element[g], square) for g, square in squares.items()]

    def enter(self, polynomial: Polynomial) -> Any:
        """A polynomial as an element of this ring."""
        terms: dict[tuple[int, ...], Any] = {}
        for monomial, coefficient in polynomial.terms.items():
            powers = dict(monomial)
            exponents = [powers.get(name, 0) for name in self.names[:-2]]
            for k, part in enumerate(parts_of(coefficient)):
                if part:
                    terms[*exponents, k & 1, k >> 1] = flint.fmpq(part.numerator, part.denominator)
        return self.context.from_dict(terms)

    def leave(self, element: Any) -> Polynomial:
        """An element without squares of roots as a polynomial."""
        terms: dict[Monomial, Number] = {}
        for exponents, coefficient in element.to_dict().items():
            monomial = tuple((name, int(e)) for name, e in zip(self.names[:-2], exponents, strict=False) if e)
            value = simplest(Fraction(int(coefficient.p), int(coefficient.q)))
            root = surd(*(int(k == exponents[-2] + 2 * exponents[-1]) for k in range(4)))
            terms[monomial] = terms.get(monomial, 0) + root * value
        return Polynomial(terms)

    def reduced(self, element: Any) -> Any:
        """The same element with sines and roots to the first power at most."""
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
        """The same quotient with a denominator free of sines and roots, by multiplying with its conjugates."""
        degrees = bottom.degrees()
        for index, element, square in self.squares:
            if not degrees[index]:
                continue
            (p, q), (a, b) = self._split(top, index, square), self._split(bottom, index, square)
            top, bottom = p + q * element, a
            if b:
                top, bottom = p * a - q * b * square + (q * a - p * b) * element, a * a - b * b * square
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


def is_rational(polynomial: Polynomial) -> bool:
    """Whether no coefficient has a square root in it."""
    return not any(isinstance(c, Surd) for c in polynomial.terms.values())


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
    numbers = [Fraction(c) for _, c in polynomial.sorted_terms() if not isinstance(c, Surd)]
    scale = Fraction(gcd(*(c.numerator for c in numbers)), lcm(*(c.denominator for c in numbers)))
    scale = scale if numbers[0] > 0 else -scale
    return Polynomial({m: simplest(c / scale) for m, c in polynomial.terms.items() if not isinstance(c, Surd)}), scale


def divided(polynomial: Polynomial, divisor: Polynomial, order: Sequence[str]) -> tuple[Polynomial, Polynomial]:
    """Quotient and remainder; no term of the remainder is divisible by the first term of the divisor."""
    ring = Ring(order=order)
    quotient, rest = divmod(ring.enter(polynomial), ring.enter(divisor))
    return ring.leave(quotient), ring.leave(rest)
