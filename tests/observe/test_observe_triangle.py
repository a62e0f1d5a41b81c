"""R-factors in blocks of rows against one of all rows: every number of columns, and numbers of any size."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from echelon.compute.observe.triangle import ROWS, update_triangle, upper_triangle

Floats = npt.NDArray[np.float64]

HEIGHT = 24
"""Rows of a block."""


def in_blocks(rows: Floats) -> Floats:
    """R of all rows, brought up to date with one block after the other; its signs are any."""
    n = rows.shape[1]
    R = np.zeros((n, n), order="F")
    for block in rows.reshape(-1, HEIGHT, n):
        update_triangle(R, block.T.copy())
    return R


def distance(R: Floats, rows: Floats) -> Floats:
    """Distance of R from the R-factor of rows, relative to each column's norm."""
    expected = np.linalg.qr(
        np.vstack([rows, np.zeros((R.shape[1], R.shape[1]))]), mode="r"
    )
    norms = np.linalg.norm(rows, axis=0)
    return np.abs(np.abs(R) - np.abs(expected)).max(axis=0) / np.where(
        norms == 0, 1, norms
    )


@pytest.mark.parametrize("size", [*range(1, 26), 37, 64])
def test_r_factor(size: int) -> None:
    rng = np.random.default_rng(size)
    rows = rng.standard_normal((24 * (2 + size // 12), size))
    R = in_blocks(rows)
    assert not np.tril(R, -1).any()
    assert distance(R, rows).max() < 1e-13


def test_fewer_rows_than_columns() -> None:
    rows = np.random.default_rng(1).standard_normal((3, 8))
    R = upper_triangle(rows)
    np.testing.assert_allclose(R.T @ R, rows.T @ rows, atol=1e-13)


@pytest.mark.parametrize("scale", [1e-140, 1e-75, 1e75, 1e140])
def test_numbers_of_any_size(scale: float) -> None:
    rng = np.random.default_rng(2)
    rows = rng.standard_normal((72, 11)) * scale
    R = in_blocks(rows)
    assert distance(R, rows).max() < 1e-13


def test_columns_of_different_sizes() -> None:
    rng = np.random.default_rng(3)
    rows = rng.standard_normal((72, 9)) * np.logspace(-140, 140, 9)
    R = in_blocks(rows)
    assert distance(R, rows).max() < 1e-13


def test_dependent_columns_leave_nothing_behind() -> None:
    rng = np.random.default_rng(4)
    rows = rng.standard_normal((96, 3)) @ rng.standard_normal((3, 13)) * 1e-130
    R = in_blocks(rows)
    assert np.abs(R[3:]).max() < 1e-14 * np.abs(R).max()
    np.testing.assert_allclose(
        np.linalg.norm(R, axis=0), np.linalg.norm(rows, axis=0), rtol=1e-13
    )


def test_zero_columns() -> None:
    rng = np.random.default_rng(5)
    rows = rng.standard_normal((48, 10))
    rows[:, [0, 3, 9]] = 0
    R = in_blocks(rows)
    np.testing.assert_allclose(R.T @ R, rows.T @ rows, atol=1e-12)
    assert not R[:, [0, 3, 9]].any()


@pytest.mark.parametrize("place", [(0, 0), (23, 0), (5, 9), (7, 12)])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_not_a_number_shows(place: tuple[int, int], value: float) -> None:
    rows = np.zeros((24, 13))
    rows[place] = value
    R = in_blocks(rows)
    assert not np.isfinite(R).all()


def test_reflectors_keep_lengths_where_columns_almost_agree() -> None:
    # what is left of the second column is 1e-9 of it: an inaccurate reflector would stretch the third one
    rng = np.random.default_rng(6)
    rows = rng.standard_normal((240, 12))
    rows[:, 1] = rows[:, 0] + 1e-9 * rng.standard_normal(240)
    rows[:, 6] = rows[:, 4] - rows[:, 5] + 1e-9 * rng.standard_normal(240)
    R = in_blocks(rows)
    np.testing.assert_allclose(
        np.linalg.norm(R, axis=0), np.linalg.norm(rows, axis=0), rtol=1e-14
    )
    assert abs(abs(R[1, 1]) / abs(np.linalg.qr(rows, mode="r")[1, 1]) - 1) < 1e-5


@pytest.mark.parametrize("count", [1, ROWS, 2 * ROWS + 7])
def test_parts_of_any_length(count: int) -> None:
    rows = np.random.default_rng(count).standard_normal((count, 6))
    whole = upper_triangle(rows)
    assert (np.diagonal(whole) >= 0).all()
    assert not np.signbit(np.tril(whole, -1)).any()
    for cut in (0, count // 3, count):
        np.testing.assert_allclose(
            upper_triangle(rows[:cut], rows[cut:]),
            whole,
            atol=1e-12 * np.abs(whole).max(),
        )
    np.testing.assert_array_equal(upper_triangle(rows[:0]), np.zeros((6, 6)))


@pytest.mark.parametrize("exponent", [-160, -245, -300, -320])
def test_columns_that_all_but_vanish(exponent: int) -> None:
    """As those of a Stribeck effect whose velocity is far below all that were measured."""
    rows = np.random.default_rng(4).standard_normal((900, 5))
    rows[:, 1] *= 10.0**exponent
    rows[:, 3] = 10.0 ** (exponent * np.random.default_rng(5).uniform(0.5, 1, 900))
    R = upper_triangle(rows)
    assert np.isfinite(R).all()
    np.testing.assert_allclose(
        (R.T @ R)[::2, ::2], (rows.T @ rows)[::2, ::2], rtol=0, atol=1e-10
    )
