"""Errors in the regressor: total least squares and instrumental variables."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from echelon.identification.estimators.errors_in_variables import instrumental, tls
from echelon.identification.estimators.least_squares import irls, ols
from echelon.identification.rows.rows import RowStream
from echelon.shared.errors import InputError
from support.estimation_problems import (
    NOISE,
    TRUTH,
    Floats,
    assert_same,
    dense,
    line,
    scaled,
    serial,
)
from support.observation_rows import ArrayRows
from support.stated_regressors import SERIAL

# -- total least squares -----------------------------------------------------------------------------------------------


def noisy_columns(
    seed: int, samples: int, truth: npt.ArrayLike, noise: float
) -> ArrayRows:
    """Rows in which errors are the same share of all columns and of y."""
    rng, truth = np.random.default_rng(seed), np.asarray(truth)
    W = rng.standard_normal((samples, len(truth)))
    y = W @ truth + noise * rng.standard_normal(samples)
    return ArrayRows(
        [W + noise / np.linalg.norm(truth) * rng.standard_normal(W.shape)], [y]
    )


def test_tls_of_one_column_is_geometric_mean_regression() -> None:
    rows = noisy_columns(0, 50, [-2.0], 0.5)
    x, y = rows.matrices[0][:, 0], rows.y[0]
    estimate = tls(rows.observation(), rows.units)
    np.testing.assert_allclose(
        estimate.values, [-np.sqrt((y @ y) / (x @ x))], rtol=1e-9
    )


def test_tls_is_the_smallest_singular_vector() -> None:
    rows = noisy_columns(1, 60, [1.0, 2.0, -0.5], 0.1)
    W, y = rows.matrices[0], rows.y[0]
    scale = np.linalg.norm(W, axis=0) / np.linalg.norm(y)
    singular, vectors = np.linalg.svd(np.column_stack([W / scale, y]))[1:]
    estimate = tls(rows.observation(), rows.units)
    np.testing.assert_allclose(
        estimate.values, -vectors[-1, :-1] / vectors[-1, -1] / scale, rtol=1e-9
    )
    assert estimate.diagnostics["smallest_singular_values"][0] == pytest.approx(
        singular[-1]
    )
    assert estimate.diagnostics["deviation"] == pytest.approx(
        singular[-1] / np.sqrt(57)
    )
    # the closed form: (WᵀW − σ²S²) ζ = Wᵀy
    closed = np.linalg.solve(W.T @ W - singular[-1] ** 2 * np.diag(scale**2), W.T @ y)
    np.testing.assert_allclose(closed, estimate.values, rtol=1e-8)


def test_tls_is_consistent_where_least_squares_is_not() -> None:
    truth = [1.0, 2.0, -0.5]
    rows = noisy_columns(2, 20_000, truth, 1.0)
    estimate, plain = (
        tls(rows.observation(), rows.units),
        ols(rows.observation(), rows.units),
    )
    assert (np.abs(estimate.values - truth) < 4 * estimate.std).all()
    # attenuated by 1 + the variance of the errors
    assert plain.values[1] == pytest.approx(
        2 / (1 + 1 / np.dot(truth, truth)), rel=0.01
    )
    assert abs(plain.values[1] - 2) > 20 * plain.std[1]
    assert estimate.diagnostics["deviation"] == pytest.approx(1.0, rel=0.02)


def test_tls_does_not_depend_on_units() -> None:
    rows, D = noisy_columns(3, 80, [1.0, 2.0, -0.5], 0.1), np.array([1e-3, 1e4, 1.0])
    first = tls(rows.observation(), rows.units)
    second = tls(scaled(rows, D, [1e-5]).observation(), rows.units)
    np.testing.assert_allclose(second.values * D * 1e-5 / 1e-5, first.values, rtol=1e-8)


def test_tls_covariance_is_that_of_measurement_error_models() -> None:
    rows = noisy_columns(4, 60, [1.0, 2.0, -0.5], 0.3)
    estimate = tls(rows.observation(), rows.units)
    W, v, s = (
        rows.matrices[0],
        estimate.diagnostics["deviation"] ** 2,
        np.array(estimate.diagnostics["errors"]),
    )
    smallest = estimate.diagnostics["smallest_singular_values"][0]
    M = W.T @ W - smallest**2 * np.diag(
        s**2
    )  # what the columns without errors would give
    np.testing.assert_allclose(M @ estimate.values, W.T @ rows.y[0], rtol=1e-8)
    errors, total = v * np.diag(s**2), v * (1 + np.sum((s * estimate.values) ** 2))
    mixed = -errors @ estimate.values
    middle = M * total + 60 * (errors * total - np.outer(mixed, mixed))
    np.testing.assert_allclose(
        estimate.covariance, np.linalg.inv(M) @ middle @ np.linalg.inv(M), rtol=1e-7
    )


def test_tls_says_when_there_is_no_solution() -> None:
    W = np.array([[1.0, 0.0], [0.0, 0.1], [0.0, 0.0]])
    with pytest.raises(InputError, match=r"has no solution here.*p"):
        tls(ArrayRows([W], [[0.0, 0.0, 1.0]]).observation(), ("m", "m"))


# -- instrumental variables --------------------------------------------------------------------------------------------


def blurred(seed: int, samples: int, blur: float = 0.5) -> tuple[ArrayRows, ArrayRows]:
    """Rows with errors in W, and instruments with independent ones."""
    rng = np.random.default_rng(seed)
    W = rng.standard_normal((samples, 3, 9)) * SERIAL
    y = W @ TRUTH + NOISE * rng.standard_normal((samples, 3))
    Z = W + blur * rng.standard_normal(W.shape) * SERIAL
    keep = rng.random((samples, 3)) < 0.9
    measured = W + blur * rng.standard_normal(W.shape) * SERIAL
    return ArrayRows.of(measured, y, SERIAL, keep=keep), ArrayRows.of(
        Z, 0 * y, SERIAL, keep=keep
    )


def test_instrumental_is_its_formula() -> None:
    rows, instruments = blurred(0, 100)
    estimate = instrumental(rows, instruments)
    (W, y, output), (Z, _, _) = (
        dense(rows, 1 / estimate.noise),
        dense(instruments, 1 / estimate.noise),
    )
    np.testing.assert_allclose(
        estimate.values, np.linalg.solve(Z.T @ W, Z.T @ y), rtol=1e-6
    )
    inverse = np.linalg.inv(Z.T @ W)
    np.testing.assert_allclose(
        estimate.covariance, inverse @ Z.T @ Z @ inverse.T, rtol=1e-6, atol=1e-10
    )
    Q, P = np.linalg.qr(Z)[0], np.linalg.qr(W)[0]
    correlations = np.linalg.svd(Q.T @ P, compute_uv=False)
    assert estimate.diagnostics["weakest_correlation"] == pytest.approx(
        correlations[-1]
    )
    # the noise is that of the residuals: it leaves as many squares as rows that the parameters leave over
    spare = np.bincount(output) - [np.sum(Q[output == i] ** 2) for i in range(3)]
    squares = np.bincount(output, (y - W @ estimate.values) ** 2)
    np.testing.assert_allclose(squares, spare, rtol=1e-6)


def test_hausman_is_the_augmented_regression() -> None:
    rows, instruments = blurred(0, 100)
    estimate = instrumental(rows, instruments)
    found = estimate.diagnostics
    (W, y, _), (Z, _, _) = (
        dense(rows, 1 / estimate.noise),
        dense(instruments, 1 / estimate.noise),
    )
    fitted = Z @ np.linalg.lstsq(Z, W)[0]
    short, long = (
        np.linalg.lstsq(W, y)[1][0],
        np.linalg.lstsq(np.hstack([W, W - fitted]), y)[1][0],
    )
    statistic = (short - long) / 9 / (long / (len(y) - 18))
    assert found["hausman"] == pytest.approx(statistic)
    assert found["hausman_degrees"] == [9, len(y) - 18]


def test_instrumental_is_consistent_where_least_squares_is_not() -> None:
    rows, instruments = blurred(1, 20_000)
    estimate, plain = (
        instrumental(rows, instruments),
        irls(rows.observation(), rows.units),
    )
    assert (np.abs(estimate.values - TRUTH) < 4 * estimate.std).all()
    np.testing.assert_allclose(plain.values, TRUTH / 1.25, rtol=0.1, atol=0.1)
    assert (np.abs(plain.values - TRUTH) > 4 * plain.std).sum() >= 7
    assert estimate.diagnostics["hausman_probability"] < 1e-10


def test_instruments_that_are_the_regressor_give_least_squares() -> None:
    rows = serial()
    estimate = instrumental(rows, rows)
    assert_same(estimate, irls(rows.observation(), rows.units), 1e-7)
    assert estimate.diagnostics["hausman_probability"] == 1.0
    assert estimate.diagnostics["weakest_correlation"] == pytest.approx(1.0)


def simulated(values: Floats, u: Floats) -> Floats:
    """x_{k+1} = a x_k + b u_k."""
    x = np.zeros(len(u) + 1)
    for k, some in enumerate(u):
        x[k + 1] = values[0] * x[k] + values[1] * some
    return x


def test_instruments_from_simulation_make_the_estimate_consistent() -> None:
    rng, truth = np.random.default_rng(5), np.array([0.9, 0.5])
    u = rng.standard_normal(4000)
    x = simulated(truth, u) + 0.5 * rng.standard_normal(4001)
    rows = ArrayRows(
        [np.column_stack([x[:-1], u])], [x[1:]], units=("", "m/N"), seconds=1.0
    )

    def instruments(values: Floats) -> RowStream:
        return ArrayRows(
            [np.column_stack([simulated(values, u)[:-1], u])],
            [x[1:]],
            units=("", "m/N"),
            seconds=1.0,
        )

    estimate, plain = (
        instrumental(rows, instruments),
        ols(rows.observation(), rows.units),
    )
    assert plain.values[0] < 0.8
    np.testing.assert_allclose(estimate.values, truth, atol=0.03)
    assert estimate.diagnostics["converged"]
    assert 1 < estimate.diagnostics["iterations"] < 20
    assert estimate.diagnostics["hausman_probability"] < 1e-6
    exact = instrumental(rows, instruments(truth))
    assert np.abs(estimate.values - exact.values).max() < 0.5 * exact.std.max()


def test_instruments_must_fit() -> None:
    rows, instruments = blurred(0, 100)
    fewer = ArrayRows(
        [Z[:-1] for Z in instruments.matrices],
        [y[:-1] for y in instruments.y],
        columns=rows.layout.columns,
    )
    with pytest.raises(
        InputError,
        match=r"arrays: output 'joint1' in segment 0: the instruments have \d+ rows",
    ):
        instrumental(rows, fewer)
    with pytest.raises(InputError, match="other outputs or parameters"):
        instrumental(rows, line())
    zero = ArrayRows(
        [0 * Z for Z in instruments.matrices],
        instruments.y,
        columns=rows.layout.columns,
    )
    with pytest.raises(InputError, match="excites too little"):
        instrumental(rows, zero)
    W = np.repeat(np.eye(2), 3, axis=0)
    other = np.column_stack([W[:, 0], np.array([0, 0, 0, 1.0, -1.0, 0])])
    with pytest.raises(InputError, match="do not determine a combination of p2"):
        instrumental(
            ArrayRows([W], [[1.0, 1.1, 0.9, 2, 2.1, 1.9]]),
            ArrayRows([other], [np.zeros(6)]),
        )
