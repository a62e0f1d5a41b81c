"""Prime fields: embeddings are homomorphisms, points lie where they should, nothing overflows at the largest prime.

Linear algebra modulo p against sympy's DomainMatrix, and solutions against the equations they solve.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
import sympy
from hypothesis import given
from hypothesis import strategies as st
from sympy import GF
from sympy.polys.matrices import DomainMatrix

from echelon.algebra.exact.field import (
    ARRAY_BITS,
    CERTIFICATE_BITS,
    PrimeField,
    Residues,
    null_vectors,
    random_prime,
    rank,
    reduced_echelon,
    solve_batched,
)
from echelon.algebra.exact.polynomial import Number, surd
from echelon.shared.errors import DegenerateSampleError
from support.strategies import FIELDS, LARGE_FIELD, SMALL_FIELD, numbers

both_fields = pytest.mark.parametrize("field", FIELDS, ids=["small", "large"])
ROOT2, ROOT3 = surd(0, 1, 0, 0), surd(0, 0, 1, 0)


def extremes(field: PrimeField) -> Residues:
    """Residues that come closest to overflow, and a few others."""
    p = field.p
    return np.array(
        [0, 1, 2, 12345, p // 2, p // 2 + 1, p - 2, p - 1], dtype=field.dtype
    )


@pytest.mark.parametrize("bits", [ARRAY_BITS, CERTIFICATE_BITS])
def test_random_primes(bits: int) -> None:
    rng = np.random.default_rng(1)
    primes = [random_prime(rng, bits) for _ in range(20)]
    assert len(set(primes)) == 20
    assert all(
        sympy.isprime(p) and p % 24 == 23 and p.bit_length() == bits for p in primes
    )


@both_fields
def test_roots_and_conjugates(field: PrimeField) -> None:
    p = field.p
    seen = set()
    for flip2 in (False, True):
        for flip3 in (False, True):
            other = field.conjugate(flip2, flip3)
            assert (other.root2**2 % p, other.root3**2 % p) == (2, 3)
            assert other.embed(ROOT2 * ROOT3) == other.root2 * other.root3 % p
            seen.add((other.root2, other.root3))
    assert len(seen) == 4
    assert pow(p - 1, (p - 1) // 2, p) == p - 1  # -1 is no square


@both_fields
@given(x=numbers, y=numbers)
def test_embedding_is_a_homomorphism(x: Number, y: Number, field: PrimeField) -> None:
    assert field.embed(x + y) == (field.embed(x) + field.embed(y)) % field.p
    assert field.embed(x * y) == field.embed(x) * field.embed(y) % field.p
    assert field.embed(-x) == -field.embed(x) % field.p
    if field.embed(y):
        assert field.embed(Fraction(1) / y) * field.embed(y) % field.p == 1


def test_a_denominator_divisible_by_the_prime_is_degenerate() -> None:
    p = SMALL_FIELD.p
    for action in (
        lambda: SMALL_FIELD.embed(Fraction(1, 3 * p)),
        lambda: SMALL_FIELD.invert(5 * p),
    ):
        with pytest.raises(DegenerateSampleError):
            action()


@both_fields
@pytest.mark.parametrize("shape", [(0,), (1,), (3, 5), (63,), (64,), (8, 25)])
def test_inverses_of_arrays(field: PrimeField, shape: tuple[int, ...]) -> None:
    rng = np.random.default_rng(2)
    x = (field.draw(rng, shape) % (field.p - 1) + 1).astype(field.dtype)
    inverse = field.invert_array(x)
    assert inverse.shape == shape
    assert inverse.dtype == x.dtype
    assert inverse.ravel().tolist() == [pow(int(v), -1, field.p) for v in x.ravel()]
    if x.size:
        x.ravel()[-1] = 0
        with pytest.raises(DegenerateSampleError):
            field.invert_array(x)


@both_fields
def test_draws_cover_the_field(field: PrimeField) -> None:
    x = field.draw(np.random.default_rng(3), (50, 40))
    assert x.shape == (50, 40)
    assert x.dtype == field.dtype
    assert min(x.ravel()) >= 0
    assert max(x.ravel()) < field.p
    assert max(x.ravel()) > 0.99 * field.p
    assert len(set(x.ravel().tolist())) > 1990


@both_fields
def test_circle_is_the_half_angle_formula(field: PrimeField) -> None:
    p, t = field.p, extremes(field)
    c, s = field.circle(t)
    for ours, x in zip(zip(c, s, strict=True), t.tolist(), strict=True):
        scale = pow(1 + x * x, -1, p)
        assert ours == ((1 - x * x) * scale % p, 2 * x * scale % p)


@both_fields
@pytest.mark.parametrize("dimension", [1, 2, 3])
def test_sphere(field: PrimeField, dimension: int) -> None:
    t = np.stack([np.roll(extremes(field), k) for k in range(dimension)])
    x = field.sphere(t)
    assert x.shape == (dimension + 1, t.shape[1])
    assert x.dtype == field.dtype
    assert [sum(int(v) ** 2 for v in column) % field.p for column in x.T] == [
        1
    ] * t.shape[1]


def test_sphere_has_points_at_infinity() -> None:
    p = SMALL_FIELD.p
    a = next(a for a in range(1, 99) if pow(-1 - a * a, (p - 1) // 2, p) == 1)
    b = pow(-1 - a * a, (p + 1) // 4, p)
    with pytest.raises(DegenerateSampleError):
        SMALL_FIELD.sphere(np.array([[a], [b]]))


@both_fields
@pytest.mark.parametrize("count", [0, 1, -1, 2, 3, -4, 7, 64, 1000])
def test_multiple_angles_are_chebyshev_polynomials(
    field: PrimeField, count: int
) -> None:
    p = field.p
    c, s = field.circle(extremes(field))
    ours = field.multiply_angle((c, s), count)
    for i, (x, y) in enumerate(zip(c.tolist(), s.tolist(), strict=True)):
        first, second = (1, x), (0, 1)  # T and U by their recurrence
        for _ in range(abs(count)):
            first = first[1], (2 * x * first[1] - first[0]) % p
            second = second[1], (2 * x * second[1] - second[0]) % p
        assert ours[0][i] == first[0]
        assert ours[1][i] == (1 if count >= 0 else -1) * y * second[0] % p


@both_fields
@given(a=st.integers(-20, 20), b=st.integers(-20, 20))
def test_angles_add(field: PrimeField, a: int, b: int) -> None:
    point = field.circle(extremes(field))

    def multiple(n: int) -> tuple[Residues, Residues]:
        return field.multiply_angle(point, n)

    for ours, expected in zip(
        field.add_angles(multiple(a), multiple(b)), multiple(a + b), strict=True
    ):
        assert ours.tolist() == expected.tolist()


def test_only_small_fields_use_machine_integers() -> None:
    assert SMALL_FIELD.dtype is np.int64
    assert LARGE_FIELD.dtype is object


def of_rank(r: int, rows: int, columns: int, *, lead: int = 0) -> Residues:
    """A random matrix of known rank; its first ``lead`` columns are zero."""
    rng = np.random.default_rng([r, rows, columns])
    left, right = (
        SMALL_FIELD.draw(rng, shape).astype(object)
        for shape in ((rows, r), (r, columns))
    )
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
    return [[int(x) % SMALL_FIELD.p for x in row] for row in reduced.to_list()], list(
        pivots
    )


@every_matrix
def test_echelon_form_and_rank_agree_with_sympy(matrix: Residues) -> None:
    reduced, pivots = reduced_echelon(matrix, SMALL_FIELD)
    rows, columns = matrix.shape
    assert (
        [[int(reduced[i, j]) for j in range(columns)] for i in range(rows)],
        pivots,
    ) == sympy_echelon(matrix)
    assert rank(matrix, SMALL_FIELD) == len(pivots)


@every_matrix
def test_null_vectors(matrix: Residues) -> None:
    basis = null_vectors(matrix, SMALL_FIELD)
    free = sorted(set(range(matrix.shape[1])) - set(sympy_echelon(matrix)[1]))
    assert len(basis) == len(free)
    for vector, column in zip(basis, free, strict=True):
        assert not (
            matrix.astype(object).dot(np.array(vector, dtype=object)) % SMALL_FIELD.p
        ).any()
        assert [vector[f] for f in free] == [int(f == column) for f in free]


def systems(
    field: PrimeField, equations: int, unknowns: int, sides: int
) -> tuple[Residues, Residues, Residues]:
    """Ten systems with known solutions; the first needs its rows exchanged at every step."""
    rng = np.random.default_rng(4)
    left, x = (
        field.draw(rng, (10, n, m)).astype(object)
        for n, m in ((equations, unknowns), (unknowns, sides))
    )
    left[0] = np.eye(equations, unknowns, dtype=object)[::-1] * (field.p - 1)
    return (
        left.astype(field.dtype),
        (np.matmul(left, x) % field.p).astype(field.dtype),
        x.astype(field.dtype),
    )


@pytest.mark.parametrize("field", FIELDS, ids=["small", "large"])
@pytest.mark.parametrize(
    "shape", [(1, 1, 1), (4, 4, 2), (7, 4, 3), (5, 5, 0), (3, 0, 2)]
)
def test_batches_of_systems_are_solved(
    field: PrimeField, shape: tuple[int, int, int]
) -> None:
    left, right, x = systems(field, *shape)
    if shape[0] > shape[1]:
        left[0, : shape[1]], right[0, : shape[1]] = (
            left[1, : shape[1]],
            right[1, : shape[1]],
        )
        left[0], right[0], x[0] = left[1], right[1], x[1]
    assert np.array_equal(solve_batched(left, right, field), x)


def test_an_empty_batch_has_an_empty_solution() -> None:
    empty = np.zeros((0, 3, 2), dtype=np.int64)
    assert solve_batched(
        empty, np.zeros((0, 3, 1), dtype=np.int64), SMALL_FIELD
    ).shape == (0, 2, 1)


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
        solve_batched(
            np.ones((2, 1, 2), dtype=np.int64),
            np.ones((2, 1, 1), dtype=np.int64),
            SMALL_FIELD,
        )
