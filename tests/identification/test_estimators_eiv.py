"""Errors in the regressor: total least squares and instrumental variables."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from echelon.errors import InputError
from echelon.identification.estimators.errors_in_variables import instrumental, tls
from echelon.identification.estimators.least_squares import irls, ols, wls
from echelon.identification.rows.rows import Rows
from support.estimation_problems import NOISE, TRUTH, Floats, assert_same, dense, line, scaled, serial
from support.observation_rows import ArrayRows
from support.stated_regressors import SERIAL

# -- total least squares -----------------------------------------------------------------------------------------------


def noisy_columns(seed: int, samples: int, s: npt.ArrayLike, truth: npt.ArrayLike, noise: float = 0.1) -> ArrayRows:
    """Rows with errors in the columns, s times as large as those of y."""
    rng = np.random.default_rng(seed)
    s, truth = np.asarray(s), np.asarray(truth)
    W = np.column_stack([np.ones(samples), rng.standard_normal((samples, len(truth) - 1))])
    y = W @ truth + noise * rng.standard_normal(samples)
    return ArrayRows([W + noise * s * rng.standard_normal(W.shape)], [y])


@pytest.mark.parametrize("ratio", [0.3, 1.0, 4.0])
def test_tls_of_a_line_is_deming_regression(ratio: float) -> None:
    rows = noisy_columns(0, 50, [0, ratio], [1.0, 2.0])
    x, y = rows.matrices[0][:, 1], rows.y[0]
    delta = 1 / ratio**2  # variance of the errors of y over that of x
    sxx, syy, sxy = np.var(x), np.var(y), np.mean((x - x.mean()) * (y - y.mean()))
    slope = (syy - delta * sxx + np.sqrt((syy - delta * sxx) ** 2 + 4 * delta * sxy**2)) / (2 * sxy)
    rows.matrices[0][:, 0] = 1
    estimate = tls(rows.observation(), ("N", "N/m"), errors=[0, ratio])
    np.testing.assert_allclose(estimate.values, [y.mean() - slope * x.mean(), slope], rtol=1e-9)


def test_tls_is_the_smallest_singular_vector() -> None:
    rows = noisy_columns(1, 60, [1, 1, 1], [1.0, 2.0, -0.5])
    joined = np.column_stack([rows.matrices[0], rows.y[0]])
    singular, vectors = np.linalg.svd(joined)[1:]
    estimate = tls(rows.observation(), rows.units, errors=[1, 1, 1])
    np.testing.assert_allclose(estimate.values, -vectors[-1, :-1] / vectors[-1, -1], rtol=1e-9)
    assert estimate.diagnostics["smallest_singular_values"][0] == pytest.approx(singular[-1])
    assert estimate.diagnostics["deviation"] == pytest.approx(singular[-1] / np.sqrt(57))
    # the closed form: (WᵀW − σ²I) ζ = Wᵀy
    W, y = rows.matrices[0], rows.y[0]
    np.testing.assert_allclose(
        np.linalg.solve(W.T @ W - singular[-1] ** 2 * np.eye(3), W.T @ y), estimate.values, rtol=1e-8
    )


def test_tls_with_exact_columns_is_least_squares() -> None:
    rows = serial()
    plain = wls(rows.observation(), rows.units, NOISE, relative=True)
    exact = tls(rows.observation(), rows.units, errors=np.zeros(9), noise=NOISE)
    assert_same(exact, plain)
    assert exact.diagnostics["gap"] is None


def test_tls_is_consistent_where_least_squares_is_not() -> None:
    truth, s = [1.0, 2.0, -0.5], [0.0, 3.0, 1.0]
    rows = noisy_columns(2, 20_000, s, truth)
    estimate, plain = tls(rows.observation(), rows.units, errors=s), ols(rows.observation(), rows.units)
    assert (np.abs(estimate.values - truth) < 4 * estimate.std).all()
    assert plain.values[1] == pytest.approx(2 / 1.09, rel=0.01)  # attenuated by 1 + the variance of the errors
    assert abs(plain.values[1] - 2) > 20 * plain.std[1]
    assert estimate.diagnostics["deviation"] == pytest.approx(0.1, rel=0.02)


def test_tls_default_does_not_depend_on_units() -> None:
    rows, D = noisy_columns(3, 80, [0.1, 1, 1], [1.0, 2.0, -0.5]), np.array([1e-3, 1e4, 1.0])
    first = tls(rows.observation(), rows.units)
    second = tls(scaled(rows, D, [1e-5]).observation(), rows.units)
    np.testing.assert_allclose(second.values * D * 1e-5 / 1e-5, first.values, rtol=1e-8)


def test_tls_covariance_is_that_of_measurement_error_models() -> None:
    s = np.array([0.0, 3.0, 1.0])
    rows = noisy_columns(4, 60, s, [1.0, 2.0, -0.5], noise=0.3)
    estimate = tls(rows.observation(), rows.units, errors=s)
    W, v = rows.matrices[0], estimate.diagnostics["deviation"] ** 2
    smallest = estimate.diagnostics["smallest_singular_values"][0]
    M = W.T @ W - smallest**2 * np.diag(s**2)  # what the columns without errors would give
    np.testing.assert_allclose(M @ estimate.values, W.T @ rows.y[0], rtol=1e-8)
    errors, total = v * np.diag(s**2), v * (1 + np.sum((s * estimate.values) ** 2))
    mixed = -errors @ estimate.values
    middle = M * total + 60 * (errors * total - np.outer(mixed, mixed))
    np.testing.assert_allclose(estimate.covariance, np.linalg.inv(M) @ middle @ np.linalg.inv(M), rtol=1e-7)


def test_tls_says_when_there_is_no_solution() -> None:
    W = np.array([[1.0, 0.0], [0.0, 0.1], [0.0, 0.0]])
    with pytest.raises(InputError, match=r"has no solution here.*p2"):
        tls(ArrayRows([W], [[0.0, 0.0, 1.0]]).observation(), ("m", "m"), errors=[1, 1])
    with pytest.raises(InputError, match="not negative; 0 says"):
        tls(ArrayRows([W], [[0.0, 0.0, 1.0]]).observation(), ("m", "m"), errors=[-1, 1])


# -- instrumental variables --------------------------------------------------------------------------------------------


def blurred(seed: int, samples: int, blur: float = 0.5) -> tuple[ArrayRows, ArrayRows]:
    """Rows with errors in W, and instruments with independent ones."""
    rng = np.random.default_rng(seed)
    W = rng.standard_normal((samples, 3, 9)) * SERIAL
    y = W @ TRUTH + NOISE * rng.standard_normal((samples, 3))
    Z = W + blur * rng.standard_normal(W.shape) * SERIAL
    keep = rng.random((samples, 3)) < 0.9
    measured = W + blur * rng.standard_normal(W.shape) * SERIAL
    return ArrayRows.of(measured, y, SERIAL, keep=keep), ArrayRows.of(Z, 0 * y, SERIAL, keep=keep)


def test_instrumental_is_its_formula() -> None:
    rows, instruments = blurred(0, 100)
    estimate = instrumental(rows, instruments, noise=NOISE)
    (W, y, _), (Z, _, _) = dense(rows, 1 / NOISE), dense(instruments, 1 / NOISE)
    np.testing.assert_allclose(estimate.values, np.linalg.solve(Z.T @ W, Z.T @ y), rtol=1e-8)
    inverse = np.linalg.inv(Z.T @ W)
    np.testing.assert_allclose(estimate.covariance, inverse @ Z.T @ Z @ inverse.T, rtol=1e-6, atol=1e-10)
    Q, P = np.linalg.qr(Z)[0], np.linalg.qr(W)[0]
    correlations = np.linalg.svd(Q.T @ P, compute_uv=False)
    assert estimate.diagnostics["weakest_correlation"] == pytest.approx(correlations[-1])


def test_hausman_is_the_augmented_regression() -> None:
    rows, instruments = blurred(0, 100)
    found = instrumental(rows, instruments, noise=NOISE).diagnostics
    (W, y, _), (Z, _, _) = dense(rows, 1 / NOISE), dense(instruments, 1 / NOISE)
    fitted = Z @ np.linalg.lstsq(Z, W)[0]
    short, long = np.linalg.lstsq(W, y)[1][0], np.linalg.lstsq(np.hstack([W, W - fitted]), y)[1][0]
    statistic = (short - long) / 9 / (long / (len(y) - 18))
    assert found["hausman"] == pytest.approx(statistic)
    assert found["hausman_degrees"] == [9, len(y) - 18]


def test_instrumental_is_consistent_where_least_squares_is_not() -> None:
    rows, instruments = blurred(1, 20_000)
    estimate, plain = instrumental(rows, instruments), irls(rows.observation(), rows.units)
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
    rows = ArrayRows([np.column_stack([x[:-1], u])], [x[1:]], units=("", "m/N"), seconds=1.0)

    def instruments(values: Floats) -> Rows:
        return ArrayRows([np.column_stack([simulated(values, u)[:-1], u])], [x[1:]], units=("", "m/N"), seconds=1.0)

    estimate, plain = instrumental(rows, instruments), ols(rows.observation(), rows.units)
    assert plain.values[0] < 0.8
    np.testing.assert_allclose(estimate.values, truth, atol=0.03)
    assert estimate.diagnostics["converged"]
    assert 1 < estimate.diagnostics["iterations"] < 20
    assert estimate.diagnostics["hausman_probability"] < 1e-6
    assert not instrumental(rows, instruments, limit=1).diagnostics["converged"]
    exact = instrumental(rows, instruments(truth))
    assert np.abs(estimate.values - exact.values).max() < 0.5 * exact.std.max()


def test_instruments_must_fit() -> None:
    rows, instruments = blurred(0, 100)
    fewer = ArrayRows(
        [Z[:-1] for Z in instruments.matrices], [y[:-1] for y in instruments.y], columns=rows.layout.columns
    )
    with pytest.raises(InputError, match=r"arrays: output 'joint1' in segment 0: the instruments have \d+ rows"):
        instrumental(rows, fewer)
    with pytest.raises(InputError, match="other outputs or parameters"):
        instrumental(rows, line())
    zero = ArrayRows([0 * Z for Z in instruments.matrices], instruments.y, columns=rows.layout.columns)
    with pytest.raises(InputError, match="excites too little"):
        instrumental(rows, zero)
    with pytest.raises(InputError, match="start must be 9 finite"):
        instrumental(rows, instruments, start=[1.0])
    W = np.repeat(np.eye(2), 3, axis=0)
    other = np.column_stack([W[:, 0], np.array([0, 0, 0, 1.0, -1.0, 0])])
    with pytest.raises(InputError, match="say nothing of a combination of p2"):
        instrumental(ArrayRows([W], [[1.0, 1.1, 0.9, 2, 2.1, 1.9]]), ArrayRows([other], [np.zeros(6)]))
