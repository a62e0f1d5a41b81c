"""Matrices of power series against exact integers, and their equations against what they were made from."""

from __future__ import annotations

import numpy as np
import pytest

from echelon.errors import DegenerateSampleError
from echelon.exact import series
from support.strategies import SMALL_FIELD

ORDER = 6


@pytest.mark.parametrize("terms", [1, 40, 2048])
@pytest.mark.parametrize("lowest", [0, SMALL_FIELD.p - 1])
def test_products_of_matrices_do_not_overflow(terms, lowest):
    rng = np.random.default_rng(terms)
    left, right = (rng.integers(lowest, SMALL_FIELD.p, shape) for shape in ((2, 3, terms, 1), (2, terms, 5, 1)))
    expected = (left[..., 0].astype(object) @ right[..., 0].astype(object)) % SMALL_FIELD.p
    assert series.matrix_product(left, right, SMALL_FIELD)[..., 0].tolist() == expected.tolist()


def equations(coupled):
    """Ten blocks of two unknowns that follow from each other as some are coupled, in random order; and solutions."""
    rng = np.random.default_rng(len(coupled))
    a = np.zeros((3, 20, 20, ORDER), dtype=np.int64)
    for i, j in [*((k, k) for k in range(10)), *coupled]:
        a[:, 2 * i : 2 * i + 2, 2 * j : 2 * j + 2] = SMALL_FIELD.draw(rng, (3, 2, 2, ORDER))
    a = a[:, rng.permutation(20)][:, :, rng.permutation(20)]
    x = SMALL_FIELD.draw(rng, (3, 20, 1, ORDER))
    return a, x, series.matrix_product(a, x, SMALL_FIELD)


@pytest.mark.parametrize(
    ("coupled", "sizes"),
    [
        ([], [8, 8, 4]),
        ([(k + 1, k) for k in range(9)], [8, 8, 4]),
        ([(k + 1, k) for k in range(9)] + [(0, 9)], [20]),
    ],
    ids=["apart", "in series", "in a ring"],
)
def test_equations_are_solved_block_by_block(coupled, sizes):
    a, x, right = equations(coupled)
    solved, inverses = series.solve(a, right, SMALL_FIELD)
    assert (solved == x).all()
    assert [len(rows) for rows, _ in inverses] == sizes
    first = series.solve(a[..., :3], right[..., :3], SMALL_FIELD)[1]
    continued, again = series.solve(a, right, SMALL_FIELD, first)
    assert (continued == x).all()
    assert all((again[key] == inverses[key]).all() for key in inverses)


def test_singular_equations_are_refused():
    a, _, right = equations([])
    a[1, :, 3] = 0
    with pytest.raises(DegenerateSampleError):
        series.solve(a, right, SMALL_FIELD)
