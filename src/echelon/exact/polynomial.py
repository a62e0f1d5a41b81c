"""Sparse polynomials in geometry symbols, with exact coefficients.

This one type carries both what goes in (placements of joints: ``-px4``, ``cos(roll3)``) and what comes out (the
entries of B).  A generator is a string: a symbol's name, or ``cos(name)`` / ``sin(name)`` of an angle symbol.  The only
relation is sin² = 1 − cos², applied on every product, so equal polynomials have equal terms.  Large multiples of an
angle have generators of their own, ``cos(40*name)``: every evaluation knows their relation, equality of terms does not.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from fractions import Fraction
from functools import reduce
from typing import Any, TypeVar

from echelon.exact.numbers import Number, Surd, format_number

Monomial = tuple[tuple[str, int], ...]
"""Generators with their positive exponents, sorted by generator."""

T = TypeVar("T")
_ONE: Monomial = ()


def cosine(symbol: str) -> str:
    """Name of the generator for the cosine of an angle symbol."""
    return f"cos({symbol})"


def sine(symbol: str) -> str:
    """Name of the generator for the sine of an angle symbol."""
    return f"sin({symbol})"


def symbol_of(generator: str) -> str:
    """The symbol a generator is made of: ``cos(a)``, ``sin(40*a)`` and ``a`` all give ``a``."""
    return multiple_of(generator)[1] if generator.endswith(")") else generator


def multiple_of(generator: str) -> tuple[int, str]:
    """The argument of a sine or cosine: ``cos(40*a)`` gives 40 and ``a``."""
    argument = generator[4:-1]
    count, _, symbol = argument.partition("*")  # names in brackets may hold a * too
    # decimals of doubles are counted in units of 1e-20 and less, so counts have any number of digits
    return (int(count), symbol) if count.isascii() and count.isdigit() else (1, argument)


def is_trigonometric(generator: str) -> bool:
    """Whether a generator is the sine or cosine of an angle symbol."""
    return generator.endswith(")")


class Polynomial:
    """An immutable polynomial: a map from monomials to non-zero exact coefficients.

    >>> d = Polynomial.generator("d4")
    >>> (d + 1) * (d - 1)
    -1 + d4^2
    """

    __slots__ = ("_hash", "terms")

    def __init__(self, terms: Mapping[Monomial, Number]) -> None:
        self.terms: dict[Monomial, Number] = {m: c for m, c in terms.items() if c}
        self._hash: int | None = None

    @staticmethod
    def generator(name: str) -> Polynomial:
        """The polynomial that is one generator."""
        return Polynomial({((name, 1),): 1})

    @staticmethod
    def constant(value: Number) -> Polynomial:
        """A number as a polynomial."""
        return Polynomial({_ONE: value})

    @staticmethod
    def sum(parts: Iterable[Polynomial]) -> Polynomial:
        """Sum of many polynomials in one pass."""
        terms: dict[Monomial, Number] = {}
        for part in parts:
            for monomial, coefficient in part.terms.items():
                terms[monomial] = terms.get(monomial, 0) + coefficient
        return Polynomial(terms)

    # -- arithmetic --------------------------------------------------------------------------------------------

    def __add__(self, other: Polynomial | Number) -> Polynomial:
        return Polynomial.sum((self, as_polynomial(other)))

    __radd__ = __add__

    def __neg__(self) -> Polynomial:
        return Polynomial({m: -c for m, c in self.terms.items()})

    def __sub__(self, other: Polynomial | Number) -> Polynomial:
        return self + (-as_polynomial(other))

    def __rsub__(self, other: Number) -> Polynomial:
        return (-self) + other

    def __mul__(self, other: Polynomial | Number) -> Polynomial:
        if not isinstance(other, Polynomial):
            return Polynomial({m: c * other for m, c in self.terms.items()})
        terms: dict[Monomial, Number] = {}
        for left, a in self.terms.items():
            for right, b in other.terms.items():
                for monomial, factor in _multiply(left, right):
                    terms[monomial] = terms.get(monomial, 0) + a * b * factor
        return Polynomial(terms)

    __rmul__ = __mul__

    def __pow__(self, exponent: int) -> Polynomial:
        if exponent < 0:
            raise ValueError(f"a polynomial has no power {exponent}: use a RationalFunction")
        if exponent > 1 and len(self.terms) == 1:
            ((monomial, coefficient),) = self.terms.items()
            if coefficient == 1 and not any(is_trigonometric(generator) for generator, _ in monomial):
                return Polynomial({tuple((g, exponent * e) for g, e in monomial): 1})
        return reduce(lambda total, _: total * self, range(exponent), Polynomial.constant(1))

    # -- comparison ----------------------------------------------------------------------------------------------

    def __eq__(self, other: object) -> bool:
        if isinstance(other, int | Fraction | Surd):
            other = Polynomial.constant(other)
        return self.terms == other.terms if isinstance(other, Polynomial) else NotImplemented

    def __hash__(self) -> int:
        if self._hash is None:
            value = self.number  # equal to a plain number, so hashed like one
            self._hash = hash(frozenset(self.terms.items()) if value is None else value)
        return self._hash

    def __bool__(self) -> bool:
        return bool(self.terms)

    # -- inspection ----------------------------------------------------------------------------------------------

    @property
    def number(self) -> Number | None:
        """The value if this polynomial is a constant, else None."""
        if not self.terms:
            return 0
        return self.terms.get(_ONE) if len(self.terms) == 1 else None

    def generators(self) -> list[str]:
        """Generators that occur, sorted."""
        return sorted({g for monomial in self.terms for g, _ in monomial})

    def symbols(self) -> list[str]:
        """Symbols that occur, sorted (angles by the name of the angle)."""
        return sorted({symbol_of(g) for monomial in self.terms for g, _ in monomial})

    def sorted_terms(self) -> Iterator[tuple[Monomial, Number]]:
        """Terms in a fixed order: by degree, then by generators."""
        return iter(sorted(self.terms.items(), key=lambda term: (sum(e for _, e in term[0]), term[0])))

    def evaluate(self, values: Mapping[str, T], number: Callable[[Number], T]) -> T:
        """Value of the polynomial over any ring; terms are added in a fixed order, so that rounding is the same."""
        total: Any = number(0)
        for monomial, coefficient in self.sorted_terms():
            term: Any = number(coefficient)
            for generator, exponent in monomial:
                for _ in range(exponent):
                    term = term * values[generator]
            total = total + term
        return total  # type: ignore[no-any-return]

    def at(self, symbols: Mapping[str, float]) -> float:
        """The value in doubles at given values of the symbols (radians for angles)."""
        return self.evaluate(float_generators(self.generators(), symbols), float)

    def __repr__(self) -> str:
        return format_polynomial(self)


def generator_values(
    generators: Iterable[str], symbol: Callable[[str], T], circle: Callable[[T, int], tuple[T, T]]
) -> dict[str, T]:
    """Values of generators, from those of symbols and from the cosine and sine of multiples of an angle."""
    values: dict[str, T] = {}
    points: dict[tuple[int, str], tuple[T, T]] = {}
    for generator in generators:
        if not is_trigonometric(generator):
            values[generator] = symbol(generator)
            continue
        count, name = argument = multiple_of(generator)
        if argument not in points:
            points[argument] = circle(symbol(name), count)
        values[generator] = points[argument][0 if generator.startswith("cos(") else 1]
    return values


def float_generators(generators: Iterable[str], symbols: Mapping[str, float]) -> dict[str, float]:
    """Float values of generators for given values of the symbols (radians for angles)."""
    return generator_values(generators, symbols.__getitem__, lambda x, n: (math.cos(n * x), math.sin(n * x)))


def as_polynomial(x: Polynomial | Number) -> Polynomial:
    """The same polynomial, or a number as a constant one."""
    return x if isinstance(x, Polynomial) else Polynomial.constant(x)


def _multiply(left: Monomial, right: Monomial) -> list[tuple[Monomial, int]]:
    """Product of two monomials as a reduced sum, because sin² = 1 − cos²."""
    if not left or not right:
        return [(left or right, 1)]
    exponents = dict(left)
    for generator, exponent in right:
        exponents[generator] = exponents.get(generator, 0) + exponent
    return _reduced(exponents)


def _reduced(exponents: dict[str, int]) -> list[tuple[Monomial, int]]:
    """A product of generators as a sum of monomials without powers of sines."""
    for generator, exponent in exponents.items():
        if exponent >= 2 and generator.startswith("sin("):
            partner = "cos" + generator[3:]
            rest = {**exponents, generator: exponent - 2}
            squared = {**rest, partner: rest.get(partner, 0) + 2}
            return _reduced(rest) + [(m, -f) for m, f in _reduced(squared)]
    return [(tuple(sorted((g, e) for g, e in exponents.items() if e)), 1)]


def format_polynomial(polynomial: Polynomial, names: Mapping[str, str] | None = None) -> str:
    """Plain text, readable back by :func:`echelon.exact.expressions.parse`, with generators called by other names."""
    called = names or {}
    terms = ([(called.get(g, g), e) for g, e in monomial] for monomial, _ in polynomial.sorted_terms())
    text = " + ".join(_format_term(m, c) for m, (_, c) in zip(terms, polynomial.sorted_terms(), strict=True))
    return text.replace("+ -", "- ") or "0"


def _format_term(monomial: Sequence[tuple[str, int]], coefficient: Number) -> str:
    factors = "*".join(g if e == 1 else f"{g}^{e}" for g, e in monomial)
    if not factors:
        return format_number(coefficient)
    if coefficient == 1:
        return factors
    if coefficient == -1:
        return f"-{factors}"
    if isinstance(coefficient, Surd):
        return f"({format_number(coefficient)})*{factors}"
    if coefficient.denominator == 1:
        return f"{coefficient}*{factors}"
    sign = "-" if coefficient < 0 else ""
    top = abs(coefficient.numerator)
    return f"{sign}{factors if top == 1 else f'{top}*{factors}'}/{coefficient.denominator}"
