"""Estimation problems with their dense matrices, and all estimators by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from echelon.identification.estimators.covariance import clustered
from echelon.identification.estimators.errors_in_variables import instrumental, tls
from echelon.identification.estimators.estimate import Estimate
from echelon.identification.estimators.least_squares import huber, irls, ols, wls
from echelon.identification.estimators.ridge import ridge
from support.observation_rows import ArrayRows
from support.stated_regressors import SERIAL

Floats = npt.NDArray[np.float64]

TRUTH = np.array([2.0, -1.0, 0.5, 3.0, -0.2, 0.1, 1.0, -4.0, 0.7])
NOISE = np.array([0.5, 0.1, 0.02])


def serial(
    seed: int = 0, samples: int = 80, noise: Floats = NOISE, **options: Any
) -> ArrayRows:
    """Rows of a serial arm, of which each output has lost others."""
    rng = np.random.default_rng(seed)
    W = rng.standard_normal((samples, 3, 9)) * SERIAL
    y = W @ TRUTH + noise * rng.standard_normal((samples, 3))
    return ArrayRows.of(
        W, y, SERIAL, keep=rng.random((samples, 3)) < [0.9, 0.7, 0.8], **options
    )


def line(seed: int = 0, samples: int = 60, noise: float = 0.3) -> ArrayRows:
    rng = np.random.default_rng(seed)
    W = np.column_stack(
        [np.ones(samples), rng.uniform(0, 5, samples), rng.standard_normal(samples)]
    )
    return ArrayRows([W], [W @ [1.0, 2.0, -0.5] + noise * rng.standard_normal(samples)])


def dense(
    rows: ArrayRows, weights: npt.ArrayLike | None = None
) -> tuple[Floats, Floats, npt.NDArray[np.int64]]:
    """W, y and the output of each row, weighted and stacked."""
    w = np.ones(len(rows.y)) if weights is None else np.asarray(weights)
    blocks = []
    for factor, matrix, columns in zip(
        w, rows.matrices, rows.layout.columns, strict=True
    ):
        full = np.zeros((len(matrix), len(rows.layout.parameters)))
        full[:, list(columns)] = factor * matrix
        blocks.append(full)
    y = np.concatenate([factor * some for factor, some in zip(w, rows.y, strict=True)])
    return (
        np.vstack(blocks),
        y,
        np.repeat(np.arange(len(w)), [len(some) for some in rows.y]),
    )


def scaled(
    rows: ArrayRows, columns: npt.ArrayLike, outputs: npt.ArrayLike
) -> ArrayRows:
    """The same rows in other units of parameters and outputs."""
    columns, outputs = np.asarray(columns), np.asarray(outputs)
    matrices = [
        u * matrix * columns[list(c)]
        for u, matrix, c in zip(
            outputs, rows.matrices, rows.layout.columns, strict=True
        )
    ]
    y = [u * some for u, some in zip(outputs, rows.y, strict=True)]
    return ArrayRows(matrices, y, columns=rows.layout.columns, times=rows.times)


def assert_same(first: Estimate, second: Estimate, tolerance: float = 1e-8) -> None:
    np.testing.assert_allclose(
        first.values, second.values, rtol=tolerance, atol=tolerance
    )
    size = np.sqrt(
        np.outer(np.diagonal(second.covariance), np.diagonal(second.covariance))
    )
    np.testing.assert_allclose(
        first.covariance / size, second.covariance / size, atol=100 * tolerance
    )
    np.testing.assert_allclose(first.noise, second.noise, rtol=100 * tolerance)


METHODS: dict[str, Callable[[ArrayRows], Estimate]] = {
    "ols": lambda rows: ols(rows.observation(), rows.units),
    "wls": lambda rows: wls(rows.observation(), rows.units, NOISE),
    "irls": lambda rows: irls(rows.observation(), rows.units),
    "huber": lambda rows: huber(rows, tolerance=1e-10, limit=500),
    "tls": lambda rows: tls(rows.observation(), rows.units),
    "instrumental": lambda rows: instrumental(rows, rows),
    "ridge": lambda rows: ridge(rows.observation(), rows.units, np.zeros(9)),
    "clustered": lambda rows: clustered(
        rows, irls(rows.observation(), rows.units), seconds=0.01
    ),
}


def unseen() -> ArrayRows:
    """The third column is twice the first less the second; the fourth is zero."""
    rng = np.random.default_rng(3)
    W = rng.standard_normal((30, 2))
    whole = np.column_stack([W, 2 * W[:, 0] - W[:, 1], np.zeros(30)])
    return ArrayRows([whole], [W @ [1.0, 2.0] + 0.1 * rng.standard_normal(30)])
