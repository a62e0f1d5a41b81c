"""Exact numbers: rationals and the field Q(√2, √3).

Q(√2, √3) is the smallest field that holds the sine and cosine of every multiple of 15°, which is where real robots
put their axes.  Rationals stay plain ``int`` or ``Fraction`` (fast, the common case); a :class:`Surd` appears only when
a square root really survives, and arithmetic returns to rationals by itself.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from fractions import Fraction
from math import isfinite, isqrt, sqrt
from typing import TypeVar

T = TypeVar("T")
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
        return surd(mine[0] + theirs[0], mine[1] + theirs[1], mine[2] + theirs[2], mine[3] + theirs[3])

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
        return float(sum(float(x) * sqrt(r) for x, r in zip(self.parts, _RADICANDS, strict=True)))

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
    raise ValueError(f"sqrt({value}) is not in Q(√2, √3): use a symbol with that value instead")


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


_LONGEST_DECIMAL = 1000
_DECIMAL = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE]([+-]?\d+))?", re.ASCII)
BEYOND_DOUBLES = "beyond the range of double precision (5e-324 to 1.8e308)"
"""What is said about numbers that no double comes near to."""


def is_negative(x: Number) -> bool:
    """The sign of a number; rational ones may be beyond double precision."""
    return float(x) < 0 if isinstance(x, Surd) else x < 0


def parse_decimal(text: str) -> Rational:
    """The exact value of a decimal literal.

    >>> parse_decimal("-0.0825"), parse_decimal("1e-3"), parse_decimal("2.0")
    (Fraction(-33, 400), Fraction(1, 1000), 2)
    """
    if len(text) > _LONGEST_DECIMAL:
        raise ValueError(f"a number of {len(text)} characters is too long (at most {_LONGEST_DECIMAL})")
    found = _DECIMAL.fullmatch(text)
    if found is None:
        raise ValueError(f"'{text}' is not a finite decimal number")
    # a large exponent is refused before it becomes as many digits
    value = Fraction(text) if abs(int(found[3] or 0)) <= 2 * _LONGEST_DECIMAL else None
    if value is None or not in_double_range(value):
        raise ValueError(f"'{text}' is {BEYOND_DOUBLES}")
    return simplest(value)


def is_whole(text: str) -> bool:
    """Whether a text is a whole number without sign, in digits that are counted with."""
    return re.fullmatch(r"[0-9]{1,18}", text) is not None


def in_double_range(x: Number) -> bool:
    """Whether a number is zero or has a double next to it that is neither zero nor infinite."""
    try:
        if isinstance(x, Surd):
            return isfinite(float(x)) and all(map(in_double_range, x.parts))
        return not x or float(x) != 0
    except OverflowError:
        return False


def format_number(x: Number) -> str:
    """Text that :func:`echelon.exact.expressions.parse` reads back to the same number."""
    if not isinstance(x, Surd):
        return str(x)
    pieces = [_format_part(value, radicand) for value, radicand in zip(x.parts, _RADICANDS, strict=True) if value]
    return " + ".join(pieces).replace("+ -", "- ")


def decimal_text(number: Number) -> str:
    """Exact text of a number, as a terminating decimal where it has one."""
    if isinstance(number, Surd):
        return format_number(number)
    denominator = Fraction(number).denominator
    for prime in (2, 5):
        while denominator % prime == 0:
            denominator //= prime
    if denominator != 1:
        return str(number)
    decimal = repr(float(number))
    return decimal if Fraction(decimal) == number else str(number)


def _format_part(value: Rational, radicand: int) -> str:
    if radicand == 1:
        return str(value)
    root = f"sqrt({radicand})"
    sign = "-" if value < 0 else ""
    numerator, denominator = abs(value.numerator), value.denominator
    body = root if numerator == 1 else f"{numerator}*{root}"
    return f"{sign}{body}" if denominator == 1 else f"{sign}{body}/{denominator}"
