"""Linear algebra modulo p against sympy's DomainMatrix, and solutions against the equations they solve."""

from __future__ import annotations

import numpy as np
import pytest
from sympy import GF
from sympy.polys.matrices import DomainMatrix

from echelon.errors import DegenerateSampleError
from echelon.exact.field import PrimeField, Residues, null_vectors, rank, reduced_echelon, solve_batched
from support.strategies import FIELDS, LARGE_FIELD, SMALL_FIELD


def of_rank(r: int, rows: int, columns: int, *, lead: int = 0) -> Residues:
    """A random matrix of known rank; its first ``lead`` columns are zero."""
    rng = np.random.default_rng([r, rows, columns])
    left, right = (SMALL_FIELD.draw(rng, shape).astype(object) for shape in ((rows, r), (r, columns)))
    right[:, :lead] = 0
    product: Residues = (left.dot(right) % SMALL_FIELD.p).astype(np.int64)
    return product


MATRICES = {
    "no rows": np.zeros((0, 3), dtype=np.int64),
    "no columns": np.zeros((3, 0), dtype=np.int64),
    "empty": np.zeros((0, 0), dtype=np.int64),
    "zero": np.zeros((3, 4), dtype=np.int64),
    "one entry": np.array([[0, 7, 0]]),
    "zero only modulo p": np.array([[SMALL_FIELD.p, 1], [0, -SMALL_FIELD.p]]),
    "negative": np.array([[-1, 2], [1, -2]]),
    "identity": np.eye(4, dtype=np.int64),
    "full": of_rank(5, 5, 5),
    "wide": of_rank(3, 4, 9),
    "tall": of_rank(3, 9, 4),
    "late pivots": of_rank(2, 5, 7, lead=3),
}
every_matrix = pytest.mark.parametrize("matrix", MATRICES.values(), ids=MATRICES.keys())


def sympy_echelon(matrix: Residues) -> tuple[list[list[int]], list[int]]:
    domain = GF(SMALL_FIELD.p, symmetric=False)
    rows = [[domain(x) for x in row] for row in matrix.tolist()]
    reduced, pivots = DomainMatrix(rows, matrix.shape, domain).rref()
    return [[int(x) % SMALL_FIELD.p for x in row] for row in reduced.to_list()], list(pivots)


@every_matrix
def test_echelon_form_and_rank_agree_with_sympy(matrix: Residues) -> None:
    reduced, pivots = reduced_echelon(matrix, SMALL_FIELD)
    rows, columns = matrix.shape
    assert ([[int(reduced[i, j]) for j in range(columns)] for i in range(rows)], pivots) == sympy_echelon(matrix)
    assert rank(matrix, SMALL_FIELD) == len(pivots)


@every_matrix
def test_null_vectors(matrix: Residues) -> None:
    basis = null_vectors(matrix, SMALL_FIELD)
    free = sorted(set(range(matrix.shape[1])) - set(sympy_echelon(matrix)[1]))
    assert len(basis) == len(free)
    for vector, column in zip(basis, free, strict=True):
        assert not (matrix.astype(object).dot(np.array(vector, dtype=object)) % SMALL_FIELD.p).any()
        assert [vector[f] for f in free] == [int(f == column) for f in free]


def systems(field: PrimeField, equations: int, unknowns: int, sides: int) -> tuple[Residues, Residues, Residues]:
    """Ten systems with known solutions; the first needs its rows exchanged at every step."""
    rng = np.random.default_rng(4)
    left, x = (field.draw(rng, (10, n, m)).astype(object) for n, m in ((equations, unknowns), (unknowns, sides)))
    left[0] = np.eye(equations, unknowns, dtype=object)[::-1] * (field.p - 1)
    return left.astype(field.dtype), (np.matmul(left, x) % field.p).astype(field.dtype), x.astype(field.dtype)


@pytest.mark.parametrize("field", FIELDS, ids=["small", "large"])
@pytest.mark.parametrize("shape", [(1, 1, 1), (4, 4, 2), (7, 4, 3), (5, 5, 0), (3, 0, 2)])
def test_batches_of_systems_are_solved(field: PrimeField, shape: tuple[int, int, int]) -> None:
    left, right, x = systems(field, *shape)
    if shape[0] > shape[1]:
        left[0, : shape[1]], right[0, : shape[1]] = left[1, : shape[1]], right[1, : shape[1]]
        left[0], right[0], x[0] = left[1], right[1], x[1]
    assert np.array_equal(solve_batched(left, right, field), x)


def test_an_empty_batch_has_an_empty_solution() -> None:
    empty = np.zeros((0, 3, 2), dtype=np.int64)
    assert solve_batched(empty, np.zeros((0, 3, 1), dtype=np.int64), SMALL_FIELD).shape == (0, 2, 1)


@pytest.mark.parametrize("field", [SMALL_FIELD, LARGE_FIELD], ids=["small", "large"])
def test_one_bad_system_spoils_the_batch(field: PrimeField) -> None:
    left, right, _ = systems(field, 5, 3, 1)
    left[0], right[0] = left[1], right[1]
    contradictory, dependent = right.copy(), left.copy()
    contradictory[7, 4, 0] = (contradictory[7, 4, 0] + 1) % field.p
    dependent[7, :, 2] = dependent[7, :, 0] * 3 % field.p
    with pytest.raises(DegenerateSampleError, match="contradict"):
        solve_batched(left, contradictory, field)
    with pytest.raises(DegenerateSampleError, match="dependent"):
        solve_batched(dependent, right, field)


def test_too_few_equations_are_degenerate() -> None:
    with pytest.raises(DegenerateSampleError, match="dependent"):
        solve_batched(np.ones((2, 1, 2), dtype=np.int64), np.ones((2, 1, 1), dtype=np.int64), SMALL_FIELD)
