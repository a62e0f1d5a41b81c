"""Kernels against LAPACK: every width of vectors, every remainder of columns, and numbers of any size."""

from __future__ import annotations

import ctypes
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pytest

from echelon.machine.batch import aligned, batch
from echelon.machine.kernel import loaded
from echelon.machine.target import Target, host
from echelon.observe import engine
from echelon.observe.engine import Engine, GramEngine, QrEngine
from echelon.observe.gram_text import gram_update_text
from echelon.observe.layout import measured
from echelon.observe.qr_text import qr_text
from echelon.observe.tiles import Tiling, tiling
from kernels import LANES, Fences
from observations import data_of, random_problem, table

Floats = npt.NDArray[np.float64]

_UPDATE = (ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64, *[ctypes.c_void_p] * 3)


class Update:
    """``@update`` on plain arrays."""

    def __init__(self, text: Callable[[Tiling], str], lanes: int, rows: int) -> None:
        target = host(lanes)
        cut = tiling(target, rows)
        self.rows = rows
        self.call = loaded(text(cut), target).function("update", _UPDATE)

    def __call__(self, R: Floats, block: Floats) -> None:
        count, size = block.shape
        assert count <= self.rows
        order = np.random.default_rng(size).permutation(size + 2)[:size].astype(np.int64)
        buffer = aligned(((size + 2) * self.rows,), zero=True)
        buffer.reshape(size + 2, self.rows)[order, :count] = block.T
        groups = -(-size // 4)
        v, t = aligned((groups * 4 * self.rows,)), aligned((groups * 16,))
        v[:] = t[:] = np.nan  # nothing is read that was not written
        data = [array.ctypes.data for array in (buffer, order, R, v, t)]
        self.call(data[0], data[1], size, *data[2:])


@pytest.fixture(scope="module", params=LANES)
def qr(request: pytest.FixtureRequest) -> Update:
    return Update(qr_text, request.param, 24)


@pytest.fixture(scope="module", params=LANES)
def gram(request: pytest.FixtureRequest) -> Update:
    return Update(gram_update_text, request.param, 24)


def distance(R: Floats, rows: Floats) -> Floats:
    """How far R is from the R-factor of rows, relative to each column's norm."""
    expected = np.linalg.qr(np.vstack([rows, np.zeros((R.shape[1], R.shape[1]))]), mode="r")
    norms = np.linalg.norm(rows, axis=0)
    return np.abs(np.abs(R) - np.abs(expected)).max(axis=0) / np.where(norms == 0, 1, norms)


@pytest.mark.parametrize("size", [*range(1, 26), 37, 64])
def test_r_factor(qr: Update, size: int) -> None:
    rng = np.random.default_rng(size)
    R, rows = np.zeros((size, size)), rng.standard_normal((24 * (2 + size // 12), size))
    for block in rows.reshape(-1, 24, size):
        qr(R, block)
    assert not np.tril(R, -1).any()
    assert distance(R, rows).max() < 1e-13


def test_fewer_rows_than_columns(qr: Update) -> None:
    rows = np.random.default_rng(1).standard_normal((3, 8))
    R = np.zeros((8, 8))
    qr(R, rows)
    np.testing.assert_allclose(R.T @ R, rows.T @ rows, atol=1e-13)


@pytest.mark.parametrize("scale", [1e-140, 1e-75, 1e75, 1e140])
def test_numbers_of_any_size(qr: Update, scale: float) -> None:
    rng = np.random.default_rng(2)
    rows = rng.standard_normal((72, 11)) * scale
    R = np.zeros((11, 11))
    for block in rows.reshape(3, 24, 11):
        qr(R, block)
    assert distance(R, rows).max() < 1e-13


def test_columns_of_different_sizes(qr: Update) -> None:
    rng = np.random.default_rng(3)
    rows = rng.standard_normal((72, 9)) * np.logspace(-140, 140, 9)
    R = np.zeros((9, 9))
    for block in rows.reshape(3, 24, 9):
        qr(R, block)
    assert distance(R, rows).max() < 1e-13


def test_dependent_columns_leave_nothing_behind(qr: Update) -> None:
    rng = np.random.default_rng(4)
    rows = rng.standard_normal((96, 3)) @ rng.standard_normal((3, 13)) * 1e-130
    R = np.zeros((13, 13))
    for block in rows.reshape(4, 24, 13):
        qr(R, block)
    assert np.abs(R[3:]).max() < 1e-14 * np.abs(R).max()
    np.testing.assert_allclose(np.linalg.norm(R, axis=0), np.linalg.norm(rows, axis=0), rtol=1e-13)


def test_zero_columns(qr: Update) -> None:
    rng = np.random.default_rng(5)
    rows = rng.standard_normal((48, 10))
    rows[:, [0, 3, 9]] = 0
    R = np.zeros((10, 10))
    for block in rows.reshape(2, 24, 10):
        qr(R, block)
    np.testing.assert_allclose(R.T @ R, rows.T @ rows, atol=1e-12)
    assert not R[:, [0, 3, 9]].any()


@pytest.mark.parametrize("place", [(0, 0), (23, 0), (5, 9), (7, 12)])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_not_a_number_shows(qr: Update, place: tuple[int, int], value: float) -> None:
    rows = np.zeros((24, 13))
    rows[place] = value
    R = np.zeros((13, 13))
    qr(R, rows)
    assert not np.isfinite(R).all()


def test_reflectors_keep_lengths_where_columns_almost_agree(qr: Update) -> None:
    # what is left of the second column is 1e-9 of it: an inaccurate reflector would stretch the third one
    rng = np.random.default_rng(6)
    rows = rng.standard_normal((240, 12))
    rows[:, 1] = rows[:, 0] + 1e-9 * rng.standard_normal(240)
    rows[:, 6] = rows[:, 4] - rows[:, 5] + 1e-9 * rng.standard_normal(240)
    R = np.zeros((12, 12))
    for block in rows.reshape(10, 24, 12):
        qr(R, block)
    np.testing.assert_allclose(np.linalg.norm(R, axis=0), np.linalg.norm(rows, axis=0), rtol=1e-14)
    assert abs(abs(R[1, 1]) / abs(np.linalg.qr(rows, mode="r")[1, 1]) - 1) < 1e-5


@pytest.mark.parametrize("size", [4, 8, 12, 40])
def test_gram_matrix(gram: Update, size: int) -> None:
    rng = np.random.default_rng(size)
    G, rows = np.zeros((size, size)), rng.standard_normal((72, size))
    for block in rows.reshape(3, 24, size):
        gram(G, block)
    np.testing.assert_allclose(np.triu(G), np.triu(rows.T @ rows), atol=1e-13 * size)


@pytest.mark.parametrize("make", [QrEngine, GramEngine])
@pytest.mark.parametrize("most", [1, 4, 9, 30])
def test_nothing_is_written_outside(
    monkeypatch: pytest.MonkeyPatch, target: Target, make: Callable[..., Engine], most: int
) -> None:
    fences = Fences()
    monkeypatch.setattr(engine, "aligned", fences.aligned)
    rng = np.random.default_rng(most)
    pattern = rng.random((3, most)) < 0.8
    W, _, y = random_problem(rng, 61, pattern)
    run = make(measured(table(pattern)), rows=24, target=target)
    given = batch(run.function.arguments, data_of(W, y, pattern))
    total = run.start()
    for first, count in ((0, 1), (1, 24), (25, 36)):
        run.merge(total, run.observe(given, first, count))
    fences.check()
    for i, found in enumerate(run.factors(total)):
        rows = np.column_stack([W[:, i][:, pattern[i]], y[:, i]])
        gram = found if make is GramEngine else found.T @ found
        np.testing.assert_allclose(gram, rows.T @ rows, atol=1e-12)
