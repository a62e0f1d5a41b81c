"""The exact matrix B: base parameters = B · standard parameters, in reduced echelon form for a column order.

B is unique for a given order, so another choice of representatives is an exact change of basis: exchange pivots, one at
a time, as in the simplex method.  Which columns become pivots is decided modulo a prime; the exchange itself is exact
and brings denominators where it must.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property
from math import inf
from sys import float_info
from typing import TYPE_CHECKING, Any

import flint
import numpy as np
import numpy.typing as npt

from echelon.algebra import (
    BEYOND_DOUBLES,
    Number,
    PrimeField,
    RationalFunction,
    Residues,
    Work,
    cost_of_products,
    generator_values,
    parse,
    reduced_echelon,
    residues_at,
    sympy_number,
)
from echelon.robot import UNITS, Parameter
from echelon.shared import PARAMETERS, EchelonError, InputError, Order, extra, shortened

if TYPE_CHECKING:
    import sympy


Row = Mapping[int, RationalFunction]
"""Non-zero entries of a row of B by column."""


@dataclass(frozen=True)
class StatedNumbers:
    """Columns of B whose coefficients are numbers, true at stated values of the symbols only."""

    columns: tuple[int, ...]  # ascending
    at: Mapping[
        str, str
    ]  # the stated values of the symbols that matter, as exact text; radians for angles
    radius: float  # largest error of a coefficient; 0 where they are exact
    rounded: bool  # whether they hold to the last decimals of a file only, which the error stands for

    def exact(self, angles: frozenset[str]) -> dict[str, Number] | None:
        """The stated values as exact numbers, or None if angles are among them, whose sines are not."""
        if angles & self.at.keys():
            return None
        values = {name: parse(text).number for name, text in self.at.items()}
        known = {name: value for name, value in values.items() if value is not None}
        return known if len(known) == len(values) else None


@dataclass(frozen=True)
class BaseMatrix:
    """Sparse exact B."""

    parameters: tuple[str, ...]  # names of the standard parameters, one per column
    pivots: tuple[int, ...]  # column of the representative of every row
    rows: tuple[Row, ...]  # non-zero entries; the pivot's entry is 1
    order: tuple[int, ...]  # column order for which B is in reduced echelon form
    numbers: StatedNumbers | None = None  # columns without closed forms

    @property
    def rank(self) -> int:
        """Number of rows, the base parameters."""
        return len(self.pivots)

    @property
    def shape(self) -> tuple[int, int]:
        """(base parameters, standard parameters)."""
        return self.rank, len(self.parameters)

    @cached_property
    def coefficients(self) -> tuple[RationalFunction, ...]:
        """Entries, of which one that stands in many places is mostly there once.

        What moves along a chain moves unchanged to most bodies, so that a large B has few coefficients.
        """
        return tuple({id(c): c for row in self.rows for c in row.values()}.values())

    @cached_property
    def symbols(self) -> tuple[str, ...]:
        """Geometry symbols that occur in B, sorted."""
        return tuple(sorted({s for c in self.coefficients for s in c.symbols()}))

    @cached_property
    def generators(self) -> tuple[str, ...]:
        """Generators (symbols, sines and cosines of angle symbols) that occur in B, sorted."""
        return tuple(sorted({g for c in self.coefficients for g in c.generators()}))

    def arranged(self, parameters: Sequence[str]) -> BaseMatrix:
        """B with its columns in another order."""
        place = {name: k for k, name in enumerate(parameters)}
        moved = [place[name] for name in self.parameters]
        numbers = self.numbers
        if numbers is not None:
            numbers = replace(numbers, columns=tuple(moved[c] for c in numbers.columns))
        return BaseMatrix(
            tuple(parameters),
            tuple(moved[pivot] for pivot in self.pivots),
            tuple({moved[c]: value for c, value in row.items()} for row in self.rows),
            tuple(moved[c] for c in self.order),
            numbers,
        )

    @property
    def denominators(self) -> set[str]:
        """Denominators of coefficients, as text."""
        return {str(c.denominator) for c in self.coefficients if not c.is_polynomial}

    def modulo(
        self, symbols: Mapping[str, Residues], field: PrimeField
    ) -> list[dict[int, int]]:
        """Rows of B modulo a prime, at one geometry.  Shapes: symbols (1,)."""
        values = residues_at(self.generators, symbols, field)
        known = {id(c): c.residue(values, field) for c in self.coefficients}
        return [
            {column: known[id(c)] for column, c in row.items()} for row in self.rows
        ]

    def dense_modulo(
        self,
        symbols: Mapping[str, Residues],
        field: PrimeField,
        columns: Sequence[int] | None = None,
    ) -> Residues:
        """B, or some of its columns in the given order, modulo a prime at one geometry."""
        chosen = range(len(self.parameters)) if columns is None else columns
        place = {column: k for k, column in enumerate(chosen)}
        dense: Residues = np.zeros((len(self.rows), len(place)), dtype=np.int64)
        for row, coefficients in zip(dense, self.modulo(symbols, field), strict=True):
            for column in coefficients.keys() & place.keys():
                row[place[column]] = coefficients[column]
        return dense

    def floats(self, symbols: Mapping[str, float]) -> npt.NDArray[np.float64]:
        """B in double precision.  Shapes: returns (base parameters, standard parameters)."""
        known = {id(c): coefficient_value(c, symbols) for c in self.coefficients}
        matrix = np.zeros(self.shape)
        for i, row in enumerate(self.rows):
            for column, coefficient in row.items():
                matrix[i, column] = known[id(coefficient)]
        return matrix

    def sympy(
        self, exact: Mapping[str, Any] | None = None
    ) -> sympy.ImmutableSparseMatrix:
        """B as a sympy matrix."""
        with extra("symbolic"):
            import sympy

        values = sympy_generators(self.generators, exact or {})
        entries = {
            (i, column): coefficient.evaluate(values, sympy_number)
            for i, row in enumerate(self.rows)
            for column, coefficient in row.items()
        }
        lost = next(
            (c for (i, c), value in entries.items() if value.has(sympy.zoo, sympy.nan)),
            None,
        )
        if lost is not None:
            problem = f"a denominator in the column of {self.parameters[lost]} is zero at the values of the symbols"
            raise InputError(f"{problem}: other representatives are needed")
        return sympy.ImmutableSparseMatrix(*self.shape, entries)


class Identifiability(Enum):
    """Identifiability of one standard parameter from the outputs."""

    UNIDENTIFIABLE = "unidentifiable"
    ALONE = "identifiable alone"
    COMBINATION = "identifiable in combination"


def classify(matrix: BaseMatrix) -> dict[str, Identifiability]:
    """Class of every standard parameter, in column order.

    A zero column of B is unidentifiable; a unit row whose parameter occurs in no other row is identifiable alone.
    """
    seen: dict[int, Identifiability] = {}
    for row in matrix.rows:
        kind = Identifiability.ALONE if len(row) == 1 else Identifiability.COMBINATION
        for column in row:
            seen[column] = kind
    return {
        name: seen.get(column, Identifiability.UNIDENTIFIABLE)
        for column, name in enumerate(matrix.parameters)
    }


NEGLIGIBLE_ERROR = 1e-30
"""Error of a coefficient, beside the largest, that no user notices."""
_PRECISIONS = (128, 512, 2048)


def in_units(coefficient: RationalFunction) -> bool:
    """Whether units of angles stand in a coefficient, whose degree in them may be large."""
    return not set(UNITS).isdisjoint(coefficient.symbols())


def _ball_value(coefficient: RationalFunction, symbols: Mapping[str, float]) -> float:
    """A coefficient by balls, because long ones may be sums that cancel but for 1e-12 of their terms."""
    from echelon.algebra import ball

    for bits in _PRECISIONS:
        with flint.ctx.workprec(bits):
            values: Mapping[str, Any] = generator_values(
                coefficient.generators(),
                lambda name: flint.arb(symbols[name]),
                lambda x, n: ((n * x).cos(), (n * x).sin()),
            )
            value = coefficient.evaluate(values, ball)
            if (
                value.rel_accuracy_bits() >= float_info.mant_dig
                or value.rad() < NEGLIGIBLE_ERROR
            ):
                return float(value)
    raise ZeroDivisionError


def coefficient_value(
    coefficient: RationalFunction, symbols: Mapping[str, float]
) -> float:
    """A coefficient in double precision."""
    try:
        if coefficient.is_polynomial and not in_units(coefficient):
            value = coefficient.numerator.at(symbols)
        else:
            value = _ball_value(coefficient, symbols)
    except ZeroDivisionError:
        problem = f"the denominator {coefficient.denominator} is zero at these values of the symbols"
        raise InputError(f"{problem}: other representatives are needed") from None
    except OverflowError:
        value = math.inf
    if not math.isfinite(value):
        raise InputError(
            f"the coefficient {shortened(str(coefficient))} is {BEYOND_DOUBLES}"
        )
    return value


def sympy_generators(
    generators: Iterable[str], exact: Mapping[str, Any]
) -> dict[str, Any]:
    """Generators in sympy, with values put in for some symbols."""
    with extra("symbolic"):
        import sympy

    def symbol(name: str) -> Any:
        return exact[name] if name in exact else sympy.Symbol(name)

    return generator_values(
        generators, symbol, lambda x, n: (sympy.cos(n * x), sympy.sin(n * x))
    )


EXCHANGE_COST = 5.0
"""Cost of a product in an exchange, relative to one in a sum: every sum is reduced on its own."""


def column_order(
    columns: Sequence[Parameter], order: Order, prefer: Sequence[str] = ()
) -> tuple[int, ...]:
    """Columns from most to least preferred as representative."""
    numbers = list(range(len(columns)))
    if (
        order == "tip-to-base"
    ):  # parameters of effects, which belong to no body, stay last
        numbers.sort(key=lambda c: inf if (body := columns[c].body) is None else -body)
    position = {parameter.name: i for i, parameter in enumerate(columns)}
    first: list[int] = []
    for name in (prefer,) if isinstance(prefer, str) else prefer:
        if name in position:
            first.append(position[name])
        elif name in PARAMETERS:
            first += [c for c in numbers if columns[c].kind == PARAMETERS.index(name)]
        else:
            raise InputError(
                f"'{name}' is neither a standard parameter of this model nor one of {', '.join(PARAMETERS)}"
            )
    first = list(dict.fromkeys(first))
    return (*first, *(c for c in numbers if c not in set(first)))


def reordered(
    matrix: BaseMatrix, order: tuple[int, ...], rng: np.random.Generator, work: Work
) -> BaseMatrix | None:
    """The reduced echelon form for another column order."""
    wanted = _pivots(matrix, order, rng)
    rows = dict(zip(matrix.pivots, (dict(row) for row in matrix.rows), strict=True))
    entering = [c for c in wanted if c not in rows]
    leaving = {c for c in rows if c not in set(wanted)}
    while entering:
        column, pivot = _exchange(rows, entering, leaving)
        entering.remove(column)
        leaving.remove(pivot)
        if not _pivot(rows, column, pivot, work):
            return None
    return BaseMatrix(matrix.parameters, wanted, tuple(rows[c] for c in wanted), order)


def _pivots(
    matrix: BaseMatrix, order: tuple[int, ...], rng: np.random.Generator
) -> tuple[int, ...]:
    field = PrimeField.random(rng)
    symbols = {name: field.draw(rng, (1,)) for name in matrix.symbols}
    _, pivots = reduced_echelon(matrix.dense_modulo(symbols, field, order), field)
    return tuple(order[k] for k in pivots)


def _exchange(
    rows: dict[int, dict[int, RationalFunction]], entering: list[int], leaving: set[int]
) -> tuple[int, int]:
    """The cheapest next exchange: the simplest non-zero entry of a leaving row in an entering column."""
    choices = [
        (_complexity(rows[pivot][column]), column, pivot)
        for pivot in leaving
        for column in entering
        if column in rows[pivot]
    ]
    if not choices:
        raise EchelonError(
            "the chosen representatives are dependent; please report this model"
        )
    _, column, pivot = min(choices)
    return column, pivot


def _complexity(coefficient: RationalFunction) -> int:
    constant = coefficient.is_polynomial and coefficient.numerator.number is not None
    if constant:
        return 0
    return len(coefficient.numerator.terms) + 10 * len(coefficient.denominator.terms)


def _pivot(
    rows: dict[int, dict[int, RationalFunction]], column: int, pivot: int, work: Work
) -> bool:
    """Exchange a representative; whether the budget allows it."""
    row = rows.pop(pivot)
    lead = row[column]
    across = [other[column] for other in rows.values() if column in other]
    if not work.take(
        EXCHANGE_COST
        * sum(cost_of_products([(a, b)]) for b in row.values() for a in (lead, *across))
    ):
        return False
    scaled = {c: value / lead for c, value in row.items()}
    for other in rows.values():
        factor = other.pop(column, None)
        if factor is None:
            continue
        for c, value in scaled.items():
            if c != column:
                total = other[c] - factor * value if c in other else -(factor * value)
                other[c] = total
                if not total:
                    del other[c]
    rows[column] = scaled
    return True
