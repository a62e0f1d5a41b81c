"""Quotients of polynomials in lowest terms.

In the classical base-to-tip order the entries of B are polynomials, so the denominator is almost always 1 and every
operation takes a short cut.  Other column orders bring true denominators; then common factors are cancelled with
FLINT's multivariate gcd.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from hashlib import sha256
from typing import Any, TypeVar, cast

import numpy as np

from echelon.algebra.exact.field import PrimeField, residues_at
from echelon.algebra.exact.polynomial import (
    Number,
    Polynomial,
    Surd,
    as_polynomial,
    format_polynomial,
)
from echelon.algebra.exact.ring import Ring, lowest_terms
from echelon.shared import DegenerateSampleError

T = TypeVar("T")
_ONE = Polynomial.constant(1)
_FIELD = PrimeField.of(2147483543)
_PRODUCT, _QUOTIENT = 300.0, 1000.0
"""Costs of a product of two terms, and of its part of a quotient, in operations on residues."""


class RationalFunction:
    """An immutable quotient of polynomials in lowest terms, with a normalised denominator.

    >>> a, b = Polynomial.generator("a"), Polynomial.generator("b")
    >>> RationalFunction(a * a - b * b, a * 2 + b * 2)
    a/2 - b/2
    """

    __slots__ = ("denominator", "numerator")

    def __init__(
        self, numerator: Polynomial | Number, denominator: Polynomial | Number = _ONE
    ) -> None:
        top, bottom = as_polynomial(numerator), as_polynomial(denominator)
        if not bottom:
            raise ZeroDivisionError("a rational function needs a non-zero denominator")
        if bottom != _ONE:
            top, bottom = lowest_terms(top, bottom)
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
        return RationalFunction(
            self.numerator * other.numerator, self.denominator * other.denominator
        )

    def __truediv__(self, other: RationalFunction) -> RationalFunction:
        return RationalFunction(
            self.numerator * other.denominator, self.denominator * other.numerator
        )

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, RationalFunction):
            return isinstance(
                other, Polynomial | int | Fraction | Surd
            ) and self == RationalFunction(other)
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
        value: Any = self.numerator.evaluate(values, number)
        if not self.is_polynomial:
            value = value / self.denominator.evaluate(values, number)
        return cast("T", value)

    def residue(self, generators: Mapping[str, int], field: PrimeField) -> int:
        """The residue for given residues of the generators."""
        top = self.numerator.evaluate(generators, field.embed) % field.p
        if self.is_polynomial:
            return top
        return (
            top
            * field.invert(self.denominator.evaluate(generators, field.embed))
            % field.p
        )

    def __repr__(self) -> str:
        top = format_polynomial(self.numerator)
        if self.is_polynomial:
            return top
        return f"({top})/({format_polynomial(self.denominator)})"


ONE = RationalFunction(1)


def sum_of_products(
    products: Sequence[tuple[RationalFunction, RationalFunction]],
) -> RationalFunction:
    """The sum of some products, brought to lowest terms once; quickest where first factors are :data:`ONE` itself."""
    if len(products) == 1 and products[0][0] is ONE:
        return products[0][1]
    groups: dict[Polynomial, list[Polynomial]] = {}
    for a, b in products:
        top = b.numerator if a is ONE else a.numerator * b.numerator
        bottom = (
            b.denominator
            if a is ONE or a.is_polynomial
            else a.denominator * b.denominator
        )
        groups.setdefault(bottom, []).append(top)
    tops = {bottom: Polynomial.sum(parts) for bottom, parts in groups.items()}
    if tops.keys() <= {_ONE}:
        return RationalFunction(tops.get(_ONE, 0))
    ring = Ring(*tops)
    shared = ring.context.constant(1)
    for bottom in tops:
        element = ring.enter(bottom)
        shared = shared * (element / shared.gcd(element))
    scaled = [
        top * ring.leave(ring.reduced(shared / ring.enter(bottom)))
        for bottom, top in tops.items()
    ]
    return RationalFunction(Polynomial.sum(scaled), ring.leave(ring.reduced(shared)))


def cost_of_products(
    products: Sequence[tuple[RationalFunction, RationalFunction]],
) -> float:
    """Operations of :func:`sum_of_products`, in the count of :class:`echelon.algebra.exact.unknown_functions.Work`."""
    true = [(a, b) for a, b in products if a is not ONE]
    if not true:
        return 0.0
    size = sum(len(a.numerator.terms) * len(b.numerator.terms) for a, b in true)
    plain = all(a.is_polynomial and b.is_polynomial for a, b in products)
    return size * (_PRODUCT if plain else _QUOTIENT)


def inverse_matrix(
    matrix: list[list[RationalFunction]],
) -> list[list[RationalFunction]] | None:
    """Inverse of a square matrix by Gauss–Jordan elimination; None if it is singular."""
    size = len(matrix)
    rows = [
        [*row, *(RationalFunction(int(i == j)) for j in range(size))]
        for i, row in enumerate(matrix)
    ]
    for column in range(size):
        pivot = next((i for i in range(column, size) if rows[i][column]), None)
        if pivot is None:
            return None
        rows[column], rows[pivot] = rows[pivot], rows[column]
        lead = rows[column][column]
        rows[column] = [entry / lead for entry in rows[column]]
        for i in range(size):
            factor = rows[i][column]
            if i != column and factor:
                rows[i] = [
                    a - factor * b for a, b in zip(rows[i], rows[column], strict=True)
                ]
    return [row[size:] for row in rows]


def _value_somewhere(function: RationalFunction) -> int:
    """The value at a fixed point modulo a fixed prime, which is the same however a quotient is written."""
    digests = {name: sha256(name.encode()).digest()[:4] for name in function.symbols()}
    point = {
        name: np.array([int.from_bytes(d, "little") % _FIELD.p])
        for name, d in digests.items()
    }
    try:
        return function.residue(
            residues_at(function.generators(), point, _FIELD), _FIELD
        )
    except DegenerateSampleError:
        return 0
