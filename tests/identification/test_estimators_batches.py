"""Covariance from batches of time: against refits without a batch, and its formula."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from echelon.identification.estimators.covariance import clustered
from echelon.identification.estimators.least_squares import huber, irls, ols
from echelon.shared.errors import InputError
from support.estimation_problems import METHODS, dense, line, serial
from support.observation_rows import ArrayRows


def batches_of(rows: ArrayRows, seconds: float) -> npt.NDArray[np.int64]:
    times = np.concatenate(rows.times)
    return np.floor((times - times.min()) / seconds).astype(int)


@pytest.mark.parametrize("method", ["ols", "wls", "irls"])
def test_jackknife_is_that_of_refits(method: str) -> None:
    rows = serial(samples=200)
    estimate = METHODS[method](rows)
    found = clustered(rows, estimate, seconds=0.0197)
    W, y, _ = dense(rows, estimate.diagnostics["weights"])
    batch = batches_of(rows, 0.0197)
    refits = np.array(
        [np.linalg.lstsq(W[batch != b], y[batch != b])[0] for b in np.unique(batch)]
    )
    G = len(refits)
    changes = refits - estimate.values
    np.testing.assert_allclose(
        found.covariance, (G - 1) / G * changes.T @ changes, rtol=1e-6, atol=1e-14
    )
    assert found.degrees == G - 1
    assert found.diagnostics["clusters"] == G
    np.testing.assert_array_equal(found.values, estimate.values)


def test_jackknife_of_huber_is_one_newton_step() -> None:
    rows = serial(samples=200)
    estimate = huber(rows)
    found = clustered(rows, estimate, seconds=0.0197)
    W, y, output = dense(rows)
    clips, slopes, weights = (
        np.array(estimate.diagnostics[k])[output]
        for k in ("clips", "slopes", "weights")
    )
    pull = weights**2 * np.clip(y - W @ estimate.values, -clips, clips)
    batch, changes = batches_of(rows, 0.0197), []
    for b in np.unique(batch):
        rest = batch != b
        bread = (W[rest].T * (slopes * weights**2)[rest]) @ W[rest]
        changes.append(np.linalg.solve(bread, W[~rest].T @ pull[~rest]))
    G, spread = len(changes), np.array(changes)
    np.testing.assert_allclose(
        found.covariance, (G - 1) / G * spread.T @ spread, rtol=1e-6, atol=1e-14
    )


def test_batches_of_white_residuals_agree_with_the_classical_covariance() -> None:
    rows = serial(samples=6000)
    estimate = irls(rows.observation(), rows.units)
    found = clustered(rows, estimate, clusters=300)
    assert 300 <= found.diagnostics["clusters"] <= 301
    np.testing.assert_allclose(found.std, estimate.std, rtol=0.2)
    np.testing.assert_allclose(
        list(found.diagnostics["inflation"].values()), 1, atol=0.2
    )
    robust = huber(rows)
    np.testing.assert_allclose(
        clustered(rows, robust, clusters=300).std, robust.std, rtol=0.2
    )


def test_repeated_rows_count_once() -> None:
    rows = serial(samples=2000)
    tenfold = ArrayRows(
        [np.repeat(matrix, 10, axis=0) for matrix in rows.matrices],
        [np.repeat(some, 10) for some in rows.y],
        columns=rows.layout.columns,
        times=[np.repeat(some, 10) for some in rows.times],
    )
    once, ten = (
        irls(rows.observation(), rows.units),
        irls(tenfold.observation(), rows.units),
    )
    np.testing.assert_allclose(ten.std, once.std / np.sqrt(10), rtol=0.01)
    found = clustered(tenfold, ten, seconds=0.01)
    np.testing.assert_allclose(found.std, once.std, rtol=0.2)
    for label, count in zip(rows.layout.outputs, map(len, rows.y), strict=True):
        assert found.diagnostics["effective_rows"][label] == pytest.approx(
            count, rel=0.2
        )


def test_batches_refuse_what_they_cannot_judge() -> None:
    rows = serial()
    estimate = irls(rows.observation(), rows.units)
    with pytest.raises(InputError, match="all rows lie within one batch"):
        clustered(rows, estimate, seconds=10)
    with pytest.raises(InputError, match="positive number of seconds"):
        clustered(rows, estimate, seconds=0)
    with pytest.raises(InputError, match="at least two"):
        clustered(rows, estimate, clusters=1)
    with pytest.raises(InputError, match="'tls' has no batches"):
        clustered(rows, METHODS["tls"](rows), seconds=0.01)
    with pytest.raises(InputError, match="other parameters or outputs"):
        clustered(line(), estimate, seconds=0.01)
    W = np.column_stack([np.ones(60), np.arange(60) < 10])
    once = ArrayRows([W], [W @ [1.0, 2.0] + 0.1 * np.sin(np.arange(60))])
    fitted = ols(once.observation(), once.units)
    with pytest.raises(
        InputError,
        match=r"batch arrays from 0 to 0.009 s: only this batch .* combination of p2",
    ):
        clustered(once, fitted, seconds=0.01)
