"""Inverses of symmetric matrices of polynomials, without fractions on the way.

Bareiss's elimination keeps every entry a minor of the matrix, so each division is exact and no greatest common divisor
is needed: with FLINT's polynomials a block of 18 rows in four symbols takes half a second, where quotients take
minutes.  Pivots are on the diagonal, which is never zero for a definite matrix; the shortest goes first.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import flint

from echelon.errors import ClosedFormError

_SINGULAR = "the metric is not definite: B S Bᵀ has no inverse"

_PASSES = 4  # over a table of the greatest length; numbers get longer in every one

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


def adjugate(rows: Sequence[Sparse], one: Any, most_terms: int) -> tuple[list[Sparse], Any]:
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
        if length > most_terms or work > _PASSES * most_terms:
            raise ClosedFormError(f"the closed form has more than {most_terms} terms")
    return [{c - size: entry for c, entry in row.items() if c >= size} for row in table], previous


def _inverse_of_numbers(rows: Sequence[Sparse], one: Any) -> list[Sparse]:
    """The inverse itself, where FLINT's algorithm for rational numbers will do."""
    size, zero = len(rows), flint.fmpq(0)
    values = [{c: next(iter(entry.coeffs())) for c, entry in row.items()} for row in rows]
    matrix = flint.fmpq_mat(size, size, [row.get(c, zero) for row in values for c in range(size)])
    try:
        inverse = matrix.inv()
    except ZeroDivisionError:
        raise ClosedFormError(_SINGULAR) from None
    return [{c: one * inverse[k, c] for c in range(size) if inverse[k, c] != 0} for k in range(size)]


def _eliminated(row: Sparse, leading: Sparse, column: int, pivot: Any, previous: Any) -> Sparse:
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
            entry = -(factor * leading[c]) if entry is None else entry - factor * leading[c]
        if entry:
            found[c] = entry / previous
    return found
