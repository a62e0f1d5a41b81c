"""Claimed rows against the exact ones: coefficient by coefficient, and what they span together.

With B in reduced echelon form, a row c lies in its row space exactly if c = Σ c[p] · B[p] over the pivots p.  The
pivots are chosen among the claimed rows' own leading parameters where possible: then every c is compared with the one
row of B that it means, and what differs is the coefficient that is wrong.

Coefficients are compared as rational functions of the geometry, which decides exactly.  Rows that state numbers instead
of symbols are compared at the robot's lengths, exactly first, then within the rounding of the printed digits.

Which rows depend on others, and which base parameters none of them sees, are questions about the row rank and the
column rank of K, the claimed coefficients at the pivots of B.  They are decided modulo a 61-bit prime at random
geometry; where claims hold only at the robot's lengths and to their printed digits, by elimination in floats with that
precision.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np
import numpy.typing as npt

from echelon.algebra import (
    MOST_ATTEMPTS,
    Number,
    PrimeField,
    RationalFunction,
    Surd,
    Work,
    is_trigonometric,
    reduced_echelon,
    residues_at,
    substituted,
    symbol_of,
)
from echelon.base.claims.reading import DecimalPrecision, precision_of
from echelon.base.claims.result import Agreement, ClaimFinding, TermDifference
from echelon.base.matrix import BaseMatrix, coefficient_value, reordered
from echelon.base.model import BaseModel
from echelon.shared import (
    DegenerateSampleError,
    EchelonError,
    Floats,
    InputError,
    independent_columns,
)

Row = Mapping[
    int, RationalFunction
]  # claimed coefficients by column, in the order of the text

_ZERO, _ONE = RationalFunction(0), RationalFunction(1)
PRIME_BITS = 61
"""Size of primes whose residues still fit machine words: few rows agree by chance, and none need be proved."""
_NOISE = 1e-9
"""Residual, relative to a row, up to which rounding of doubles may make it."""


@dataclass(frozen=True)
class RobotNumbers:
    """The robot's numbers, to put in for its symbols."""

    exact: Mapping[str, Number]  # lengths with an exact value
    floats: Mapping[str, float]  # all symbols with a value

    @staticmethod
    def of(model: BaseModel) -> RobotNumbers:
        """The values that a model's mechanism states."""
        symbols = model.mechanism.symbols.items()
        exact = {
            name: symbol.number for name, symbol in symbols if symbol.number is not None
        }
        return RobotNumbers(
            exact,
            {
                name: symbol.value
                for name, symbol in symbols
                if symbol.value is not None
            },
        )

    def exactly(self, value: RationalFunction) -> Number | None:
        """A coefficient's exact value, if its lengths have one."""
        generators = value.generators()
        if any(g not in self.exact or is_trigonometric(g) for g in generators):
            return None
        try:
            return value.evaluate(
                {g: _fraction(self.exact[g]) for g in generators}, _fraction
            )
        except ZeroDivisionError:
            raise InputError(
                f"the denominator {value.denominator} is zero at the robot's values"
            ) from None

    def roughly(self, value: RationalFunction) -> float | None:
        """A coefficient's value, if its symbols have one."""
        if any(symbol not in self.floats for symbol in value.symbols()):
            return None
        return coefficient_value(value, self.floats)


def _fraction(x: Number) -> Number:
    return x if isinstance(x, Surd) else Fraction(x)


def led_by(
    matrix: BaseMatrix, rows: Sequence[Row], rng: np.random.Generator
) -> BaseMatrix:
    """B with the claimed rows' own leading parameters as representatives, as far as they can be."""
    uses = Counter(column for row in rows for column in row)
    leaders = []
    for row in rows:
        own = [c for c, value in row.items() if uses[c] == 1 and not value.symbols()]
        leaders += ([c for c in own if c in matrix.pivots] or own)[:1]
    if set(leaders) <= set(matrix.pivots) or matrix.numbers:
        return matrix
    order = (*leaders, *(c for c in matrix.order if c not in leaders))
    return reordered(matrix, order, rng, Work.of(1)) or matrix


def compare_row(
    finding: ClaimFinding,
    row: Row,
    matrix: BaseMatrix,
    geometry: RobotNumbers,
    precision: DecimalPrecision,
) -> ClaimFinding:
    """A claimed row with its agreement and what differs."""
    expected = combination(row, matrix)
    differing = [
        c
        for c in sorted({*row, *expected})
        if row.get(c, _ZERO) != expected.get(c, _ZERO)
    ]
    if not differing:
        return finding
    numeric = not any(value.symbols() for value in row.values())
    if numeric:
        differing = [
            c
            for c in differing
            if not _same(row.get(c, _ZERO), expected.get(c, _ZERO), geometry)
        ]
        if not differing:
            return replace(finding, numeric=True)
    rounded = precision_of([finding.claim.text]).decimals is not None
    if precision.decimals is not None and (numeric or rounded):
        gaps = {c: _gap(c, row, expected, geometry) for c in differing}
        allowed = zip(
            gaps.items(), _rounding(gaps, row, matrix, geometry, precision), strict=True
        )
        differing = [c for (c, gap), most in allowed if gap is None or abs(gap) > most]
        if not differing:
            largest = max(abs(gap or 0.0) for gap in gaps.values())
            return replace(
                finding,
                agreement=Agreement.PRINTED_DIGITS,
                numeric=True,
                largest_difference=largest,
            )
    differences = tuple(
        TermDifference(
            matrix.parameters[c],
            coefficient_words(row.get(c, _ZERO)),
            coefficient_words(expected.get(c, _ZERO)),
            _gap(c, row, expected, geometry),
            _value(row.get(c, _ZERO), geometry),
            _value(expected.get(c, _ZERO), geometry),
        )
        for c in differing
    )
    return replace(finding, agreement=Agreement.WRONG, differences=differences)


def combination(row: Row, matrix: BaseMatrix) -> dict[int, RationalFunction]:
    """The member of the row space of B that has a row's coefficients at the pivots."""
    exact = dict(zip(matrix.pivots, matrix.rows, strict=True))
    total = substituted(
        {pivot: row[pivot] for pivot in matrix.pivots if pivot in row}, exact
    )
    return {column: value for column, value in total.items() if value}


def _same(
    claimed: RationalFunction, expected: RationalFunction, geometry: RobotNumbers
) -> bool:
    left, right = geometry.exactly(claimed), geometry.exactly(expected)
    return left is not None and left == right


def _gap(column: int, row: Row, expected: Row, geometry: RobotNumbers) -> float | None:
    left, right = (
        geometry.roughly(terms.get(column, _ZERO)) for terms in (row, expected)
    )
    return None if left is None or right is None else left - right


def _value(coefficient: RationalFunction, geometry: RobotNumbers) -> float | None:
    """Value of a formula at the robot's geometry; None for a number, and where symbols have no value."""
    return geometry.roughly(coefficient) if coefficient.symbols() else None


def _rounding(
    columns: Iterable[int],
    row: Row,
    matrix: BaseMatrix,
    geometry: RobotNumbers,
    precision: DecimalPrecision,
) -> Floats:
    """The most that rounding explains at some columns: of their coefficients, and of those that multiply rows of B."""

    def size(some: Row, column: int) -> float:
        return geometry.roughly(some.get(column, _ZERO)) or 0.0

    def own(column: int) -> float:
        return precision.tolerance(size(row, column))

    def most(column: int) -> float:
        return own(column) + sum(off * abs(size(o, column)) for off, o in inexact)

    exact = zip(matrix.pivots, matrix.rows, strict=True)
    inexact = [
        (own(p), other)
        for p, other in exact
        if p in row and row[p] not in (_ONE, -_ONE)
    ]
    return (1 + 1e-9) * np.array([most(c) for c in columns])


def coefficient_words(value: RationalFunction) -> str:
    """A coefficient in plain characters, decimal where that is exact."""
    number = value.numerator.number if value.is_polynomial else None
    if not isinstance(number, int | Fraction):
        return str(value)
    text = f"{float(number):.12g}"
    return text if Fraction(text) == number else str(number)


@dataclass(frozen=True)
class Span:
    """Part of the row space of B that claimed rows span."""

    redundant: tuple[int, ...]  # right rows that depend on the right rows before them
    missing: tuple[int, ...]  # rows of B that complete the claimed ones


def span_exactly(
    rows: Sequence[Row],
    right: Sequence[int],
    matrix: BaseMatrix,
    rng: np.random.Generator,
) -> Span:
    """The span for generic geometry."""
    for _ in range(MOST_ATTEMPTS):
        field = PrimeField.random(rng, PRIME_BITS)
        try:
            values = _residues(rows, matrix, field, rng)
        except DegenerateSampleError:
            continue
        independent = reduced_echelon(values[list(right)].T, field)[1]
        return _span(right, independent, reduced_echelon(values, field)[1], matrix)
    raise EchelonError("the claimed coefficients are singular at every random geometry")


def span_roughly(
    rows: Sequence[Row],
    right: Sequence[int],
    matrix: BaseMatrix,
    geometry: RobotNumbers,
    tolerance: float,
) -> Span:
    """The span at the robot's geometry for coefficients that are known to a tolerance."""
    values = np.array(
        [
            [geometry.roughly(row.get(p, _ZERO)) or 0.0 for p in matrix.pivots]
            for row in rows
        ]
    )
    values = values.reshape(len(rows), matrix.rank)
    threshold = max(_NOISE, 4 * tolerance)
    independent = independent_columns(values[list(right)].T, threshold)
    return _span(right, independent, independent_columns(values, threshold), matrix)


def _span(
    right: Sequence[int],
    independent: Sequence[int],
    seen: Sequence[int],
    matrix: BaseMatrix,
) -> Span:
    redundant = set(right) - {right[k] for k in independent}
    return Span(
        tuple(sorted(redundant)),
        tuple(k for k in range(matrix.rank) if k not in set(seen)),
    )


def _residues(
    rows: Sequence[Row], matrix: BaseMatrix, field: PrimeField, rng: np.random.Generator
) -> npt.NDArray[np.object_]:
    used = [row[p] for row in rows for p in matrix.pivots if p in row]
    generators = sorted({g for c in used for g in c.generators()})
    symbols = {
        name: field.draw(rng, (1,))
        for name in sorted({symbol_of(g) for g in generators})
    }
    known = residues_at(generators, symbols, field)
    values = np.zeros((len(rows), matrix.rank), dtype=object)
    for i, row in enumerate(rows):
        for k, pivot in enumerate(matrix.pivots):
            if pivot in row:
                values[i, k] = row[pivot].residue(known, field)
    return values
