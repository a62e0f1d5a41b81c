"""Exact numbers, in the field Q(√2, √3), and sparse polynomials in geometry symbols with such coefficients.

Q(√2, √3) is the smallest field that holds the sine and cosine of every multiple of 15°, which is where real robots put
their axes.  Rationals stay plain ``int`` or ``Fraction`` (fast, the common case); a :class:`Surd` appears only when a
square root really survives, and arithmetic returns to rationals by itself.

One type of polynomial carries both what goes in (placements of joints: ``-px4``, ``cos(roll3)``) and what comes out
(the entries of B).  A generator is a string: a symbol's name, or ``cos(name)`` / ``sin(name)`` of an angle symbol.  The
only relation is sin² = 1 − cos², applied on every product, so equal polynomials have equal terms.  Large multiples of
an angle have generators of their own, ``cos(40*name)``: every evaluation knows their relation, equality of terms does
not.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from fractions import Fraction
from functools import reduce
from math import isqrt, sqrt
from typing import Any, TypeVar

T = TypeVar("T")
_MOST_DIGITS = 15  # of the denominator of a fraction next to a number
Rational = int | Fraction

_RADICANDS = (1, 2, 3, 6)
# product of the basis elements √r_i·√r_j = factor·√r_k, as (factor, k)
_PRODUCT = (
    ((1, 0), (1, 1), (1, 2), (1, 3)),
    ((1, 1), (2, 0), (1, 3), (2, 2)),
    ((1, 2), (1, 3), (3, 0), (3, 1)),
    ((1, 3), (2, 2), (3, 1), (6, 0)),
)


class Surd:
    """An irrational element a + b√2 + c√3 + d√6 with rational a, b, c, d.

    Use :func:`surd` to build one: it returns a plain rational when b = c = d = 0.
    """

    __slots__ = ("parts",)

    def __init__(self, parts: tuple[Rational, Rational, Rational, Rational]) -> None:
        self.parts = parts

    def __add__(self, other: Number) -> Number:
        if not isinstance(other, int | Fraction | Surd):
            return NotImplemented
        mine, theirs = self.parts, parts_of(other)
        return surd(
            mine[0] + theirs[0],
            mine[1] + theirs[1],
            mine[2] + theirs[2],
            mine[3] + theirs[3],
        )

    __radd__ = __add__

    def __neg__(self) -> Surd:
        a, b, c, d = self.parts
        return Surd((-a, -b, -c, -d))

    def __sub__(self, other: Number) -> Number:
        return self + (-other)

    def __rsub__(self, other: Number) -> Number:
        return -self + other

    def __mul__(self, other: Number) -> Number:
        if isinstance(other, int | Fraction):
            a, b, c, d = self.parts
            return surd(a * other, b * other, c * other, d * other)
        if not isinstance(other, Surd):
            return NotImplemented
        total: list[Rational] = [0, 0, 0, 0]
        for i, x in enumerate(self.parts):
            for j, y in enumerate(other.parts):
                factor, k = _PRODUCT[i][j]
                total[k] += factor * x * y
        return surd(*total)

    __rmul__ = __mul__

    def inverse(self) -> Number:
        """1/x by multiplying with the three Galois conjugates, whose product with x is rational."""
        a, b, c, d = self.parts
        conjugates = (surd(a, -b, c, -d), surd(a, b, -c, -d), surd(a, -b, -c, d))
        adjugate = conjugates[0] * conjugates[1] * conjugates[2]
        norm = self * adjugate
        assert isinstance(norm, int | Fraction)
        return adjugate * Fraction(1, 1) * (1 / Fraction(norm))

    def __truediv__(self, other: Number) -> Number:
        if not isinstance(other, int | Fraction | Surd):
            return NotImplemented
        return self * inverse(other)

    def __rtruediv__(self, other: Number) -> Number:
        return self.inverse() * other

    def __eq__(self, other: object) -> bool:
        return self.parts == other.parts if isinstance(other, Surd) else NotImplemented

    def __hash__(self) -> int:
        return hash(self.parts)

    def __float__(self) -> float:
        return float(
            sum(float(x) * sqrt(r) for x, r in zip(self.parts, _RADICANDS, strict=True))
        )

    def __repr__(self) -> str:
        return format_number(self)


Number = int | Fraction | Surd


def surd(a: Rational, b: Rational, c: Rational, d: Rational) -> Number:
    """The number a + b√2 + c√3 + d√6 in its simplest type."""
    return Surd((a, b, c, d)) if b or c or d else a


def parts_of(x: Number) -> tuple[Rational, Rational, Rational, Rational]:
    """Coordinates of x on the basis 1, √2, √3, √6."""
    return x.parts if isinstance(x, Surd) else (x, 0, 0, 0)


def inverse(x: Number) -> Number:
    """Exact 1/x."""
    return x.inverse() if isinstance(x, Surd) else 1 / Fraction(x)


def repeated(base: T, count: int, unit: T, times: Callable[[T, T], T]) -> T:
    """A product of equal factors, by repeated squaring, from the lowest bit on."""
    total = unit
    while count:
        total = times(total, base) if count & 1 else total
        count >>= 1
        base = times(base, base) if count else base
    return total


def simplest(x: Rational) -> Rational:
    """A fraction that is whole as an int."""
    return x.numerator if x.denominator == 1 else x


def square_root(value: Number) -> Number:
    """Exact √value; ValueError where it is not in Q(√2, √3)."""
    if isinstance(value, Surd) or value < 0:
        raise ValueError("sqrt needs a non-negative rational number")
    for k, radicand in enumerate(_RADICANDS):
        square = Fraction(value) / radicand
        root = simplest(Fraction(isqrt(square.numerator), isqrt(square.denominator)))
        if root * root == square:
            return surd(*(root if i == k else 0 for i in range(4)))
    raise ValueError(
        f"sqrt({value}) is not in Q(√2, √3): use a symbol with that value instead"
    )


def circle_point(tangent: Fraction) -> tuple[Fraction, Fraction]:
    """Cosine and sine of the angle of which the half has a tangent."""
    size = 1 + tangent * tangent
    return (1 - tangent * tangent) / size, 2 * tangent / size


def simple_fraction(value: float, tolerance: float) -> Fraction:
    """A simple fraction next to a number."""
    exact = Fraction(value)
    found = (exact.limit_denominator(10**digits) for digits in range(_MOST_DIGITS))
    return next(
        (f for f in found if abs(f - exact) <= tolerance),
        exact.limit_denominator(10**_MOST_DIGITS),
    )


def cosine_of_turn(k: int) -> Number:
    """cos(k·15°), exactly."""
    half = Fraction(1, 2)
    quarter = Fraction(1, 4)
    first = (
        1,
        surd(0, quarter, 0, quarter),
        surd(0, 0, half, 0),
        surd(0, half, 0, 0),
        half,
        surd(0, -quarter, 0, quarter),
        0,
    )
    k %= 24
    k = min(k, 24 - k)
    return first[k] if k <= 6 else -first[12 - k]


def sine_of_turn(k: int) -> Number:
    """sin(k·15°), exactly."""
    return cosine_of_turn(k - 6)


def is_negative(x: Number) -> bool:
    """The sign of a number; rational ones may be beyond double precision."""
    return float(x) < 0 if isinstance(x, Surd) else x < 0


def format_number(x: Number) -> str:
    """Text that :func:`echelon.algebra.exact.expressions.parse` reads back to the same number."""
    if not isinstance(x, Surd):
        return str(x)
    pieces = [
        _format_part(value, radicand)
        for value, radicand in zip(x.parts, _RADICANDS, strict=True)
        if value
    ]
    return " + ".join(pieces).replace("+ -", "- ")


def _format_part(value: Rational, radicand: int) -> str:
    if radicand == 1:
        return str(value)
    root = f"sqrt({radicand})"
    sign = "-" if value < 0 else ""
    numerator, denominator = abs(value.numerator), value.denominator
    body = root if numerator == 1 else f"{numerator}*{root}"
    return f"{sign}{body}" if denominator == 1 else f"{sign}{body}/{denominator}"


Monomial = tuple[
    tuple[str, int], ...
]  # generators with their positive exponents, sorted by generator

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
    if count.isascii() and count.isdigit():
        return int(count), symbol
    return 1, argument


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
            raise ValueError(
                f"a polynomial has no power {exponent}: use a RationalFunction"
            )
        if exponent > 1 and len(self.terms) == 1:
            ((monomial, coefficient),) = self.terms.items()
            if coefficient == 1 and not any(
                is_trigonometric(generator) for generator, _ in monomial
            ):
                return Polynomial({tuple((g, exponent * e) for g, e in monomial): 1})
        return reduce(
            lambda total, _: total * self, range(exponent), Polynomial.constant(1)
        )

    # -- comparison ----------------------------------------------------------------------------------------------

    def __eq__(self, other: object) -> bool:
        if isinstance(other, int | Fraction | Surd):
            other = Polynomial.constant(other)
        if isinstance(other, Polynomial):
            return self.terms == other.terms
        return NotImplemented

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
        return iter(
            sorted(
                self.terms.items(),
                key=lambda term: (sum(e for _, e in term[0]), term[0]),
            )
        )

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
    generators: Iterable[str],
    symbol: Callable[[str], T],
    circle: Callable[[T, int], tuple[T, T]],
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


def float_generators(
    generators: Iterable[str], symbols: Mapping[str, float]
) -> dict[str, float]:
    """Float values of generators for given values of the symbols (radians for angles)."""
    return generator_values(
        generators, symbols.__getitem__, lambda x, n: (math.cos(n * x), math.sin(n * x))
    )


def as_polynomial(x: Polynomial | Number) -> Polynomial:
    """Polynomial itself, or the constant polynomial of a number."""
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


def format_polynomial(polynomial: Polynomial) -> str:
    """Plain text, which :func:`echelon.algebra.exact.expressions.parse` reads."""
    text = " + ".join(_format_term(m, c) for m, c in polynomial.sorted_terms())
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
    return (
        f"{sign}{factors if top == 1 else f'{top}*{factors}'}/{coefficient.denominator}"
    )
