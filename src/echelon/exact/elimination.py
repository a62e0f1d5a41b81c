"""Linear algebra over GF(p).

Two shapes occur.  One large matrix, whose pivots are wanted: FLINT's ``nmod_mat`` (recursive, with fast
multiplication).  Very many small systems, one per random geometry: Gauss–Jordan in NumPy, vectorised over the batch.

In matrices of balls, what is surely not zero is a pivot and what may be zero is bounded.  The pivots are proved.
Columns without one are dependent up to a bound that shrinks with the precision.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol, TypeVar

import flint
import numpy as np

from echelon.errors import DegenerateSampleError
from echelon.exact.field import PrimeField, Residues


def reduced_echelon(matrix: Residues, field: PrimeField) -> tuple[Any, list[int]]:
    """Reduced row echelon form of a matrix over GF(p) with p below 2^63.  Shapes: matrix (rows, columns)."""
    rows, columns = matrix.shape
    if not rows or not columns:
        return flint.nmod_mat(rows, columns, field.p), []
    reduced, rank = flint.nmod_mat(rows, columns, matrix.ravel().tolist(), field.p).rref()
    pivots: list[int] = []
    column = 0
    for row in range(rank):
        while not int(reduced[row, column]):
            column += 1
        pivots.append(column)
        column += 1
    return reduced, pivots


def rank(matrix: Residues, field: PrimeField) -> int:
    """Rank of a matrix over GF(p)."""
    rows, columns = matrix.shape
    if not rows or not columns:
        return 0
    return int(flint.nmod_mat(rows, columns, matrix.ravel().tolist(), field.p).rank())


def by_pivots(matrix: Residues, field: PrimeField) -> dict[int, dict[int, int]]:
    """Every column without a pivot as a combination of pivot columns: their coefficients where they are not zero."""
    reduced, pivots = reduced_echelon(matrix, field)
    places = list(enumerate(pivots))
    return {
        column: {p: value for row, p in places if p < column and (value := int(reduced[row, column]))}
        for column in sorted(set(range(matrix.shape[1])) - set(pivots))
    }


def null_vectors(matrix: Residues, field: PrimeField) -> list[list[int]]:
    """Basis of the right null space, one vector per non-pivot column, with a 1 there."""
    basis = []
    for free, combination in by_pivots(matrix, field).items():
        vector = [0] * matrix.shape[1]
        vector[free] = 1
        for pivot, value in combination.items():
            vector[pivot] = field.p - value
        basis.append(vector)
    return basis


def solve_batched(left: Residues, right: Residues, field: PrimeField) -> Residues:
    """Solve many small systems A x = b at once, with as many or more equations than unknowns."""
    # shapes: left (batch, equations, unknowns); right (batch, equations, sides); returns (batch, unknowns, sides)
    unknowns = left.shape[2]
    table = np.concatenate([left, right], axis=2) % field.p
    batch = np.arange(table.shape[0])
    for j in range(unknowns):
        below = table[:, j:, j] != 0
        if not below.any(axis=1).all():
            raise DegenerateSampleError("a sample has dependent pivot columns")
        pivot = j + below.argmax(axis=1)
        chosen = table[batch, pivot]
        table[batch, pivot] = table[:, j]
        chosen = chosen * field.invert_array(chosen[:, j])[:, None] % field.p
        table = (table - table[:, :, j, None] * chosen[:, None, :]) % field.p
        table[:, j] = chosen
    if table[:, unknowns:, unknowns:].any():
        raise DegenerateSampleError("surplus equations contradict the relation")
    return table[:, :unknowns, unknowns:]


_DECIDED = 3
"""A ball that may be zero is taken as zero when it is below 2^-(precision / 3)."""


def ball_rank(matrix: list[list[Any]], bits: int) -> int | None:
    """Rank of a matrix of balls, or None if the precision does not decide it."""
    rows, rank = [list(row) for row in matrix], 0
    for column in range(len(matrix[0])):
        best = max(range(rank, len(rows)), key=lambda i: float(rows[i][column].abs_lower()), default=None)
        if best is None or not float(rows[best][column].abs_lower()) > 0:
            largest = max((float(rows[i][column].abs_upper()) for i in range(rank, len(rows))), default=0.0)
            if not largest < 2.0 ** (-bits / _DECIDED):
                return None
            continue
        rows[rank], rows[best] = rows[best], rows[rank]
        lead, rank = rows[rank], rank + 1
        for i in range(rank, len(rows)):
            factor = rows[i][column] / lead[column]
            rows[i] = [a - factor * b for a, b in zip(rows[i], lead, strict=True)]
    return rank


class Ring(Protocol):
    """Numbers that can be added and multiplied."""

    def __add__(self, other: Any, /) -> Any: ...

    def __mul__(self, other: Any, /) -> Any: ...


T = TypeVar("T", bound=Ring)


def substituted(combination: Mapping[int, T], solved: Mapping[int, Mapping[int, T]]) -> dict[int, T]:
    """A combination of columns as one of those that the solved ones are combinations of."""
    total: dict[int, T] = {}
    for column, coefficient in combination.items():
        if column not in solved:
            total[column] = total[column] + coefficient if column in total else coefficient
            continue
        for pivot, inner in solved[column].items():
            addend = coefficient * inner
            total[pivot] = total[pivot] + addend if pivot in total else addend
    return dict(sorted(total.items()))
