"""The inverse of B from the right in closed form: B† = S Bᵀ (B S Bᵀ)⁻¹ for a metric S of numbers and formulas.

B S Bᵀ falls into blocks of base parameters that share standard ones; most are single.  Each block is inverted without
fractions, with one denominator, its determinant.  B · B† = 1 is then checked as an identity of polynomials.

Bareiss's elimination keeps every entry a minor of the matrix, so each division is exact and no greatest common divisor
is needed: with FLINT's polynomials a block of 18 rows in four symbols takes half a second, where quotients take
minutes.  Pivots are on the diagonal, which is never zero for a definite matrix; the shortest goes first.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import reduce
from math import lcm
from typing import Any, Literal, TypeAlias

import flint
import numpy as np

from echelon.algebra import Polynomial, RationalFunction, Ring, parse, substituted
from echelon.base.matrix import BaseMatrix, sympy_generators
from echelon.shared import ClosedFormError, EchelonError, InputError, extra

with extra("symbolic"):
    import sympy

ExactMetric: TypeAlias = Literal["identity"] | Sequence[Any] | sympy.MatrixBase
"""``"identity"``, the diagonal of S, or S."""

_SINGULAR = "the metric is not definite: B S Bᵀ has no inverse"

MOST_PASSES = 4
"""Work of an elimination, in passes over a table of the greatest length."""

Sparse = dict[int, Any]
"""Non-zero entries of a row by column: FLINT polynomials of one ring."""


def blocks(rows: Sequence[Sparse]) -> list[list[int]]:
    """Sets of rows that are connected by non-zero entries of a symmetric matrix, each in ascending order."""
    found: list[list[int]] = []
    seen: set[int] = set()
    for start in range(len(rows)):
        pending, block = [start], []
        while pending:
            row = pending.pop()
            if row not in seen:
                seen.add(row)
                block.append(row)
                pending += rows[row]
        if block:
            found.append(sorted(block))
    return found


def adjugate(
    rows: Sequence[Sparse], one: Any, most_terms: int
) -> tuple[list[Sparse], Any]:
    """The inverse of a symmetric definite matrix as a matrix of polynomials and a common denominator."""
    size = len(rows)
    if 4 * size * size > most_terms:  # even in numbers, whose digits grow with the size
        raise ClosedFormError(f"the closed form has more than {most_terms} terms")
    if all(entry.is_constant() for row in rows for entry in row.values()):
        return _inverse_of_numbers(rows, one), one
    table: list[Sparse] = [{**row, size + k: one} for k, row in enumerate(rows)]
    previous, left, work = one, set(range(size)), 0
    while left:
        regular = [k for k in left if k in table[k]]
        if not regular:
            raise ClosedFormError(_SINGULAR)
        k = min(regular, key=lambda i: (len(table[i][i]), i))
        left.remove(k)
        pivot, leading = table[k][k], table[k]
        for i in range(size):
            if i != k:
                table[i] = _eliminated(table[i], leading, k, pivot, previous)
        previous = pivot
        length = sum(len(entry) for row in table for entry in row.values())
        work += length
        if length > most_terms or work > MOST_PASSES * most_terms:
            raise ClosedFormError(f"the closed form has more than {most_terms} terms")
    return [
        {c - size: entry for c, entry in row.items() if c >= size} for row in table
    ], previous


def _inverse_of_numbers(rows: Sequence[Sparse], one: Any) -> list[Sparse]:
    """The inverse itself, where FLINT's algorithm for rational numbers will do."""
    size, zero = len(rows), flint.fmpq(0)
    values = [
        {c: next(iter(entry.coeffs())) for c, entry in row.items()} for row in rows
    ]
    matrix = flint.fmpq_mat(
        size, size, [row.get(c, zero) for row in values for c in range(size)]
    )
    try:
        inverse = matrix.inv()
    except ZeroDivisionError:
        raise ClosedFormError(_SINGULAR) from None
    return [
        {c: one * inverse[k, c] for c in range(size) if inverse[k, c] != 0}
        for k in range(size)
    ]


def _eliminated(
    row: Sparse, leading: Sparse, column: int, pivot: Any, previous: Any
) -> Sparse:
    """(pivot · row − factor · leading) / previous, without the column."""
    factor = row.get(column)
    if factor is None:
        return {c: entry * pivot / previous for c, entry in row.items()}
    found: Sparse = {}
    for c in {**row, **leading}:
        if c == column:
            continue
        entry = row[c] * pivot if c in row else None
        if c in leading:
            entry = (
                -(factor * leading[c]) if entry is None else entry - factor * leading[c]
            )
        if entry:
            found[c] = entry / previous
    return found


def metric_entries(metric: Any, size: int) -> dict[tuple[int, int], RationalFunction]:
    """Non-zero entries of S."""
    if isinstance(metric, str):
        if metric != "identity":
            raise InputError(
                f"unknown metric '{metric}' (valid: identity, a diagonal, or a sympy Matrix)"
            )
        return {(k, k): RationalFunction(1) for k in range(size)}
    if not (hasattr(metric, "todok") or hasattr(metric, "__iter__")):
        raise InputError(
            f"a metric is 'identity', a diagonal, or a sympy Matrix, not {metric!r}"
        )
    if hasattr(metric, "todok") and 1 not in metric.shape:
        shape = metric.shape
        given = {(int(i), int(j)): value for (i, j), value in metric.todok().items()}
    else:
        diagonal = list(metric)
        shape = (len(diagonal),) * 2
        given = {(k, k): value for k, value in enumerate(diagonal)}
    if shape != (size, size):
        raise InputError(
            f"the metric is {shape[0]} × {shape[1]}; expected {size} × {size} or its diagonal"
        )
    entries = {place: _rational(value) for place, value in given.items() if value != 0}
    if any(entries.get((j, i)) != value for (i, j), value in entries.items()):
        raise InputError("the metric is not symmetric")
    _check_definite(entries, size)
    return entries


def _check_definite(
    entries: Mapping[tuple[int, int], RationalFunction], size: int
) -> None:
    """Refuse what is surely not positive definite; where S has symbols, by the numbers on its diagonal."""
    numbers = {
        place: value.numerator.number
        for place, value in entries.items()
        if value.is_polynomial
    }
    known = {
        place: float(number) for place, number in numbers.items() if number is not None
    }
    matrix = np.zeros((size, size))
    for i, j in entries:
        matrix[i, j] = (
            known.get((i, j), i == j) if i == j or len(known) == len(entries) else 0.0
        )
    if np.linalg.eigvalsh(matrix).min(initial=1.0) <= 0:
        raise InputError("the metric is not positive definite")


def _rational(value: Any) -> RationalFunction:
    """A number or formula as a quotient of polynomials."""
    try:
        if isinstance(value, str):  # text is read, never evaluated as code
            return RationalFunction(parse(value))
        formula = sympy.sympify(value, rational=False, strict=True)
        formula = formula.replace(
            lambda e: e.is_Float, lambda e: sympy.Rational(str(e))
        )
        if (
            formula.has(sympy.sqrt(2), sympy.sqrt(3))
            or not formula.is_rational_function()
        ):
            raise ValueError(value)
        return RationalFunction(
            *(parse(str(part)) for part in sympy.fraction(sympy.together(formula)))
        )
    except (sympy.SympifyError, AttributeError, TypeError, ValueError):
        raise InputError(
            f"the metric's entry '{value}' is not a rational function with rational numbers"
        ) from None


def pseudo_inverse(
    matrix: BaseMatrix,
    metric: Any,
    formulas: Mapping[str, Any],
    most_terms: int = 150_000,
) -> sympy.ImmutableMatrix:
    """The inverse of B from the right that belongs to a metric; more terms than most_terms in a block take minutes."""
    n = len(matrix.parameters)
    weights, _ = _cleared(metric_entries(metric, n))
    cleared = [_cleared(dict(row)) for row in matrix.rows]
    ring = Ring(
        *weights.values(),
        *(p for row, factor in cleared for p in (*row.values(), factor)),
    )
    rows = [{c: ring.enter(p) for c, p in row.items()} for row, _ in cleared]
    weight: dict[int, Sparse] = {c: {} for c in range(n)}
    for (i, j), polynomial in weights.items():
        weight[i][j] = ring.enter(polynomial)
    weighted = [_product(row, weight) for row in rows]
    columns: dict[int, Sparse] = {c: {} for c in range(n)}
    for i, row in enumerate(rows):
        for c, entry in row.items():
            columns[c][i] = entry
    gram = [_product(row, columns) for row in weighted]
    factors = [ring.enter(factor) for _, factor in cleared]
    writer = _SympyWriter(ring, {**_own_symbols(metric, matrix), **formulas})
    entries = [sympy.S.Zero] * (n * matrix.rank)
    for block in blocks(gram):
        try:
            numerators, denominator = _block(
                block, gram, weighted, ring.context.constant(1), most_terms
            )
        except ClosedFormError as error:
            problem = f"{error}; numbers for symbols, or pseudo_inverse_float, need no closed form"
            raise ClosedFormError(problem) from None
        _check_inverse([rows[i] for i in block], numerators, denominator)
        for c, row in numerators.items():
            for k, numerator in row.items():
                entries[c * matrix.rank + block[k]] = writer.quotient(
                    numerator * factors[block[k]], denominator
                )
    return sympy.ImmutableMatrix(
        n, matrix.rank, entries, copy=False
    )  # a sparse one would sort its entries: slow


def _own_symbols(metric: Any, matrix: BaseMatrix) -> dict[str, Any]:
    """Symbols of the metric as they were given, with their assumptions, unless B has symbols of their names."""
    given = (
        {}
        if isinstance(metric, str)
        else {s.name: s for e in metric for s in getattr(e, "free_symbols", ())}
    )
    return {
        name: symbol for name, symbol in given.items() if name not in matrix.symbols
    }


def _cleared(
    entries: Mapping[Any, RationalFunction],
) -> tuple[dict[Any, Polynomial], Polynomial]:
    """Rational functions times their common denominator, and it."""
    denominators: dict[Polynomial, None] = {
        e.denominator: None for e in entries.values()
    }
    common = reduce(
        lambda a, b: RationalFunction(a, b).denominator * a,
        denominators,
        Polynomial.constant(1),
    )
    scaled = {
        place: RationalFunction(e.numerator * common, e.denominator).numerator
        for place, e in entries.items()
    }
    return scaled, common


def _product(row: Sparse, others: Mapping[int, Sparse]) -> Sparse:
    """A sparse row times a sparse matrix."""
    return {c: entry for c, entry in substituted(row, others).items() if entry}


def _block(
    block: Sequence[int],
    gram: Sequence[Sparse],
    weighted: Sequence[Sparse],
    one: Any,
    most_terms: int,
) -> tuple[dict[int, Sparse], Any]:
    """Rows of S Bᵀ (B S Bᵀ)⁻¹ for one block, by standard parameter, times the denominator that follows."""
    place = {row: k for k, row in enumerate(block)}
    inverse, denominator = adjugate(
        [{place[c]: e for c, e in gram[i].items()} for i in block], one, most_terms
    )
    rows, transposed = dict(enumerate(inverse)), dict[int, Sparse]()
    for k, i in enumerate(block):
        for c, entry in weighted[i].items():
            transposed.setdefault(c, {})[k] = entry
    return {c: _product(row, rows) for c, row in transposed.items()}, denominator


def _check_inverse(
    rows: Sequence[Sparse], numerators: Mapping[int, Sparse], denominator: Any
) -> None:
    """B · B† = 1 as an identity of polynomials."""
    for i, row in enumerate(rows):
        total = substituted(
            {c: entry for c, entry in row.items() if c in numerators}, numerators
        )
        if (
            any(value != (denominator if k == i else 0) for k, value in total.items())
            or i not in total
        ):
            raise EchelonError("B · B† is not the identity; please report this model")


class _SympyWriter:
    """Writes elements of a ring in sympy; what was written before is not written again."""

    def __init__(self, ring: Ring, formulas: Mapping[str, Any]) -> None:
        self._ring = ring
        *names, _, _ = ring.names
        self._generators = [
            *sympy_generators(names, formulas).values(),
            sympy.sqrt(2),
            sympy.sqrt(3),
        ]
        self._monomials: dict[tuple[int, ...], Any] = {}
        self._written: dict[str, Any] = {}

    def quotient(self, top: Any, bottom: Any) -> Any:
        """In lowest terms, with whole numbers below."""
        common = top.gcd(bottom)
        whole = lcm(*(int(coefficient.q) for coefficient in (bottom / common).coeffs()))
        return self._sum(top * whole / common) / self._sum(bottom * whole / common)

    def _sum(self, element: Any) -> Any:
        text = str(element)
        if text not in self._written:
            terms = self._ring.reduced(element).to_dict().items()
            self._written[text] = sympy.Add(
                *(self._term(exponents, number) for exponents, number in terms)
            )
        return self._written[text]

    def _term(self, exponents: tuple[int, ...], coefficient: Any) -> Any:
        number = sympy.Rational(int(coefficient.p), int(coefficient.q))
        if exponents not in self._monomials:
            pairs = zip(self._generators, exponents, strict=True)
            self._monomials[exponents] = sympy.Mul(
                *(g ** int(e) for g, e in pairs if e)
            )
        monomial = self._monomials[exponents]
        if number == 1 or not any(exponents[:-2]):
            return number * monomial
        # as sympy would put it, without its questions
        return sympy.Mul._from_args((number, *sympy.Mul.make_args(monomial)), True)
