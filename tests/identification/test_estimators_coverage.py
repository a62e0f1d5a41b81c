"""Intervals cover the truth as often as they say, over hundreds of seeds."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pytest
from scipy.stats import binom, kstest

from echelon.identification.estimators.covariance import clustered
from echelon.identification.estimators.errors_in_variables import instrumental, tls
from echelon.identification.estimators.estimate import Estimate
from echelon.identification.estimators.least_squares import huber, irls, ols, wls
from echelon.identification.estimators.ridge import ridge
from support.estimation_problems import NOISE, TRUTH, Floats, serial
from support.observation_rows import ArrayRows

pytestmark = pytest.mark.slow

SEEDS = 400
BLUR = 0.3

Trial = Callable[[int], tuple[Estimate, Floats]]


def covered(trial: Trial) -> npt.NDArray[np.bool_]:
    """For each seed and parameter, whether the 95 % interval holds the truth."""
    hits = []
    for seed in range(SEEDS):
        estimate, truth = trial(seed)
        low, high = estimate.interval().T
        hits.append((low <= truth) & (truth <= high))
    return np.array(hits)


def assert_nominal(hits: npt.NDArray[np.bool_]) -> None:
    """Each parameter's count is one that 95 % would give, but for one case in ten thousand."""
    low, high = binom.interval(1 - 1e-4, SEEDS, 0.95)
    counts = hits.sum(axis=0)
    assert ((low <= counts) & (counts <= high)).all(), counts / SEEDS


def _serial(seed: int, noise: Floats = NOISE) -> ArrayRows:
    return serial(1000 + seed, samples=40, noise=noise)


def _ols(seed: int) -> tuple[Estimate, Floats]:
    rows = _serial(seed, np.full(3, 0.3))
    return ols(rows.observation(), rows.units), TRUTH


def _wls(seed: int) -> tuple[Estimate, Floats]:
    rows = _serial(seed)
    return wls(rows.observation(), rows.units, 5 * NOISE), TRUTH


def _irls(seed: int) -> tuple[Estimate, Floats]:
    rows = serial(1000 + seed, samples=100)
    return irls(rows.observation(), rows.units), TRUTH


def _huber(seed: int) -> tuple[Estimate, Floats]:
    rng = np.random.default_rng(seed)
    clean = serial(1000 + seed, samples=150)
    # one row in twenty is wrong by thirty standard deviations, to either side
    y = [
        some + 30 * s * rng.standard_normal(len(some)) * (rng.random(len(some)) < 0.05)
        for some, s in zip(clean.y, NOISE, strict=True)
    ]
    return huber(ArrayRows(clean.matrices, y, columns=clean.layout.columns)), TRUTH


def _blurred(
    seed: int, samples: int, size: float
) -> tuple[ArrayRows, ArrayRows, Floats]:
    """Rows with errors in all columns, others with independent errors, and the truth."""
    rng, truth = np.random.default_rng(seed), np.array([1.0, 2.0, -0.5])
    W = rng.standard_normal((samples, 3))
    y = W @ truth + BLUR * rng.standard_normal(samples)
    first, second = (W + size * rng.standard_normal(W.shape) for _ in range(2))
    return ArrayRows([first], [y]), ArrayRows([second], [y]), truth


def _tls(seed: int) -> tuple[Estimate, Floats]:
    rows, _, truth = _blurred(
        seed, 300, BLUR / np.sqrt(5.25)
    )  # the same share of all columns and of y
    return tls(rows.observation(), rows.units), truth


def _instrumental(seed: int) -> tuple[Estimate, Floats]:
    rows, instruments, truth = _blurred(seed, 300, BLUR)
    return instrumental(rows, instruments), truth


def _ridge(seed: int) -> tuple[Estimate, Floats]:
    """The truth is drawn from the prior, and the data leave one direction open."""
    rng = np.random.default_rng(seed)
    W = rng.standard_normal((40, 4)) @ np.diag([1, 1, 1, 0]) + rng.standard_normal(
        (40, 1)
    ) @ np.array([[0, 1, 0, 1]])
    truth = 1.0 + 3.0 * rng.standard_normal(4) / np.linalg.norm(W, axis=0)
    rows = ArrayRows([W], [W @ truth + 0.5 * rng.standard_normal(40)])
    return ridge(rows.observation(), rows.units, np.ones(4), weight=1 / 9), truth


TRIALS: dict[str, Trial] = {
    "ols": _ols,
    "wls": _wls,
    "irls": _irls,
    "huber": _huber,
    "tls": _tls,
    "instrumental": _instrumental,
    "ridge": _ridge,
}


@pytest.mark.parametrize("name", TRIALS)
def test_intervals_cover(name: str) -> None:
    assert_nominal(covered(TRIALS[name]))


def test_common_noise_does_not_fit_outputs_that_differ() -> None:
    """Classical intervals of parameters that only the loudest output shows are too narrow."""

    def classical(seed: int) -> tuple[Estimate, Floats]:
        rows = serial(1000 + seed, samples=200)
        return ols(rows.observation(), rows.units), TRUTH

    hits = covered(classical).mean(axis=0)
    assert hits[:3].max() < 0.92


def test_least_squares_with_errors_in_columns_does_not_cover() -> None:
    def plain(seed: int) -> tuple[Estimate, Floats]:
        rows, _, truth = _blurred(seed, 300, BLUR)
        return ols(rows.observation(), rows.units), truth

    assert covered(plain)[:, 1].mean() < 0.2


def _coloured(seed: int) -> ArrayRows:
    """Slow motion, and noise that takes twenty samples to forget."""
    rng = np.random.default_rng(seed)
    N, memory = 6000, np.exp(-1 / 20)

    def slow() -> Floats:
        from scipy.signal import lfilter

        filtered = lfilter(
            [np.sqrt(1 - memory**2)], [1, -memory], rng.standard_normal(N + 500)
        )
        return np.asarray(filtered[500:])

    W = [np.column_stack([np.ones(N), slow(), slow()]) for _ in range(2)]
    y = [
        matrix @ [1.0, 2.0, -0.5] + s * slow()
        for matrix, s in zip(W, (1.0, 0.2), strict=True)
    ]
    return ArrayRows(W, y)


def test_batches_cover_where_the_classical_covariance_does_not() -> None:
    def classical(seed: int) -> tuple[Estimate, Floats]:
        rows = _coloured(seed)
        return irls(rows.observation(), rows.units), np.array([1.0, 2.0, -0.5])

    def honest(seed: int) -> tuple[Estimate, Floats]:
        estimate, truth = classical(seed)
        return clustered(_coloured(seed), estimate), truth

    assert covered(classical).mean(axis=0).max() < 0.75
    assert_nominal(covered(honest))


def test_batches_tell_how_many_rows_count() -> None:
    """AR(1) noise with coefficient a against a constant column inflates the variance by (1 + a)/(1 − a)."""
    a = np.exp(-1 / 20)
    found = []
    for seed in range(100):
        rows = _coloured(seed)
        rest = [
            y - W[:, 1:] @ [2, -0.5] for y, W in zip(rows.y, rows.matrices, strict=True)
        ]
        constant = ArrayRows([W[:, :1] for W in rows.matrices], rest)
        estimate = irls(constant.observation(), constant.units)
        found.append(
            clustered(constant, estimate, seconds=0.3).diagnostics["inflation"][
                "joint2"
            ]
        )
    assert np.mean(found) == pytest.approx((1 + a) / (1 - a), rel=0.15)


@pytest.mark.parametrize(
    ("noise", "least", "most"), [(0.3, 0.8, 1.2), (0.7, 0.8, 1.2), (1.5, 0.5, 1.2)]
)
def test_tls_covariance_is_the_spread_of_its_values(
    noise: float, least: float, most: float
) -> None:
    """With errors in the columns, too.

    The columns' norms, which the sizes of the errors are taken from, vary with the values, so that these spread less
    than is said where errors are as large as the columns.
    """
    truth, found, variances = np.array([1.0, 2.0]), [], []
    for seed in range(SEEDS):
        rng = np.random.default_rng(seed)
        W = rng.standard_normal((400, 2))
        y = W @ truth + noise * rng.standard_normal(400)
        rows = ArrayRows([W + noise / np.sqrt(5) * rng.standard_normal(W.shape)], [y])
        estimate = tls(rows.observation(), rows.units)
        found.append(estimate.values)
        variances.append(np.diagonal(estimate.covariance))
    spread = np.var(found, axis=0) / np.mean(variances, axis=0)
    assert ((spread > least) & (spread < most)).all()


def test_hausman_rejects_as_often_as_it_should() -> None:
    """Without errors in W its probability is uniform."""
    found = []
    for seed in range(SEEDS):
        rng = np.random.default_rng(seed)
        W = rng.standard_normal((100, 3))
        y = W @ [1.0, 2.0, -0.5] + rng.standard_normal(100)
        instruments = ArrayRows([W + rng.standard_normal(W.shape)], [y])
        found.append(
            instrumental(ArrayRows([W], [y]), instruments).diagnostics[
                "hausman_probability"
            ]
        )
    assert kstest(found, "uniform").pvalue > 1e-3


def test_noise_is_unbiased() -> None:
    """σ² of each output on average, even with few rows; dividing by N or N − n/m would not do."""
    found = np.array(
        [
            irls(rows.observation(), rows.units).noise ** 2
            for rows in map(_serial, range(SEEDS))
        ]
    )
    error = found.std(axis=0) / np.sqrt(SEEDS)
    assert (np.abs(found.mean(axis=0) - NOISE**2) < 4 * error).all()
    naive = found.mean(axis=0) * (1 - 3 / 30)
    assert (np.abs(naive - NOISE**2) > 2 * error).any()
