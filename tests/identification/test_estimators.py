"""Least squares against dense linear algebra and textbooks, and what must not matter to any estimator."""

from __future__ import annotations

import json
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize

from echelon.identification.estimators.errors_in_variables import tls
from echelon.identification.estimators.estimate import ROUNDING, Estimate, solved
from echelon.identification.estimators.least_squares import (
    irls,
    noise_estimate,
    ols,
    wls,
)
from echelon.shared.errors import InputError
from support.estimation_problems import (
    METHODS,
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
from support.selection import examples

# -- least squares -----------------------------------------------------------------------------------------------------


def test_ols_is_the_textbook() -> None:
    rows = serial()
    W, y, _ = dense(rows)
    estimate = ols(rows.observation(), rows.units)
    values, squares = np.linalg.lstsq(W, y)[:2]
    np.testing.assert_allclose(estimate.values, values, rtol=1e-10)
    np.testing.assert_allclose(
        estimate.covariance,
        squares / (len(y) - 9) * np.linalg.inv(W.T @ W),
        rtol=1e-8,
        atol=1e-14,
    )
    assert estimate.degrees == len(y) - 9
    assert estimate.rows == tuple(map(len, rows.y))
    assert estimate.diagnostics["condition"] == pytest.approx(np.linalg.cond(W))
    assert estimate.diagnostics["scaled_condition"] == pytest.approx(
        np.linalg.cond(W / np.linalg.norm(W, axis=0))
    )


def test_ols_interval_is_that_of_linear_regression() -> None:
    from scipy.stats import linregress, t

    rng = np.random.default_rng(4)
    x = rng.uniform(0, 1, 12)
    y = 3 + 2 * x + rng.standard_normal(12)
    found = linregress(x, y)
    estimate = ols(
        ArrayRows([np.column_stack([np.ones(12), x])], [y]).observation(), ("N", "N/m")
    )
    np.testing.assert_allclose(estimate.values, [found.intercept, found.slope])
    np.testing.assert_allclose(estimate.std, [found.intercept_stderr, found.stderr])
    half = t.ppf(0.975, 10) * found.stderr
    np.testing.assert_allclose(
        estimate.interval()[1], [found.slope - half, found.slope + half]
    )


def test_leverages_are_traces_of_the_hat_matrix() -> None:
    rows = serial()
    W, _, output = dense(rows, 1 / NOISE)
    hat = np.diagonal(W @ np.linalg.inv(W.T @ W) @ W.T)
    leverages = solved(rows.observation(), rows.units, 1 / NOISE).leverages
    np.testing.assert_allclose(
        leverages, [hat[output == i].sum() for i in range(3)], rtol=1e-9
    )
    assert leverages.sum() == pytest.approx(9)


def test_wls_divides_rows_by_their_noise() -> None:
    rows = serial()
    W, y, _ = dense(rows, 1 / NOISE)
    estimate = wls(rows.observation(), rows.units, NOISE)
    values, squares = np.linalg.lstsq(W, y)[:2]
    np.testing.assert_allclose(estimate.values, values, rtol=1e-9)
    variance = squares / (len(y) - 9)
    np.testing.assert_allclose(
        estimate.covariance, variance * np.linalg.inv(W.T @ W), rtol=1e-7, atol=1e-14
    )
    louder = wls(rows.observation(), rows.units, 7 * NOISE)
    np.testing.assert_allclose(louder.covariance, estimate.covariance, rtol=1e-9)


def test_infinite_noise_leaves_an_output_out() -> None:
    rows = serial()
    without = ArrayRows(
        rows.matrices[:2],
        rows.y[:2],
        columns=rows.layout.columns[:2],
        parameters=rows.layout.parameters,
    )
    kept = wls(rows.observation(), rows.units, [0.5, 0.1, np.inf])
    alone = wls(without.observation(), rows.units, [0.5, 0.1])
    np.testing.assert_allclose(kept.values, alone.values, rtol=1e-10)
    assert kept.degrees == alone.degrees


# -- noise by output ---------------------------------------------------------------------------------------------------


def test_irls_maximises_the_restricted_likelihood() -> None:
    rows = serial(samples=25)
    W, y, output = dense(rows)

    def negative(logarithms: Floats) -> float:
        precision = np.exp(-2 * logarithms)[output]
        gram = (W.T * precision) @ W
        residual = y - W @ np.linalg.solve(gram, W.T @ (precision * y))
        return (
            float(
                np.sum(precision * residual**2)
                - np.sum(np.log(precision))
                + np.linalg.slogdet(gram)[1]
            )
            / 2
        )

    found = minimize(
        negative,
        np.log(noise_estimate(rows.observation())),
        method="BFGS",
        options={"gtol": 1e-9},
    )
    estimate = irls(rows.observation(), rows.units)
    np.testing.assert_allclose(estimate.noise, np.exp(found.x), rtol=1e-5)
    assert estimate.diagnostics["converged"]
    np.testing.assert_allclose(
        estimate.diagnostics["weights"], 1 / estimate.noise, rtol=1e-8
    )


def test_irls_with_one_output_is_ols() -> None:
    rows = line()
    assert_same(
        irls(rows.observation(), rows.units), ols(rows.observation(), rows.units), 1e-10
    )


def test_irls_says_when_it_has_not_converged() -> None:
    rows = serial(samples=25)
    estimate = irls(rows.observation(), rows.units, limit=1)
    assert not estimate.diagnostics["converged"]
    assert estimate.diagnostics["iterations"] == 1


def test_irls_takes_exact_data() -> None:
    rows = serial(noise=np.zeros(3))
    estimate = irls(rows.observation(), rows.units)
    np.testing.assert_allclose(estimate.values, TRUTH, rtol=1e-10)
    assert estimate.diagnostics["exact_outputs"] == ["joint1", "joint2", "joint3"]
    believed = [ROUNDING * np.sqrt(np.mean(some**2)) for some in rows.y]
    np.testing.assert_allclose(
        estimate.diagnostics["weights"], 1 / np.array(believed), rtol=1e-9
    )
    one = irls(serial(noise=np.array([0.5, 0.0, 0.02])).observation(), rows.units)
    assert one.diagnostics["exact_outputs"] == ["joint2"]
    np.testing.assert_allclose(one.values[3:], TRUTH[3:], rtol=1e-6)


def test_outputs_without_rows_do_no_harm() -> None:
    rows = serial()
    empty = ArrayRows(
        [*rows.matrices, np.zeros((0, 9))],
        [*rows.y, np.zeros(0)],
        columns=[*rows.layout.columns, range(9)],
    )
    for method in (
        METHODS["irls"],
        METHODS["huber"],
        METHODS["instrumental"],
        METHODS["clustered"],
    ):
        full, more = method(rows), method(empty)
        np.testing.assert_allclose(more.values, full.values, rtol=1e-9)
        assert np.isnan(more.noise[3])


# -- what must not matter ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
def test_units_of_parameters_do_not_matter(method: str) -> None:
    rows, D = serial(), 10.0 ** np.array([-6, 3, 0, 5, -2, 1, -4, 6, 2])
    first, second = METHODS[method](rows), METHODS[method](scaled(rows, D, np.ones(3)))
    np.testing.assert_allclose(second.values * D, first.values, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(second.std * D, first.std, rtol=1e-6)


@pytest.mark.parametrize("method", ["irls", "huber", "instrumental", "clustered"])
@given(exponents=st.tuples(*[st.integers(-5, 5)] * 3))
@examples(5)
def test_units_of_outputs_do_not_matter(
    method: str, exponents: tuple[int, int, int]
) -> None:
    rows, units = serial(samples=40), 10.0 ** np.array(exponents)
    first, second = (
        METHODS[method](rows),
        METHODS[method](scaled(rows, np.ones(9), units)),
    )
    np.testing.assert_allclose(second.values, first.values, rtol=1e-6)
    np.testing.assert_allclose(second.std, first.std, rtol=1e-6)
    np.testing.assert_allclose(second.noise, first.noise * units, rtol=1e-6)


@pytest.mark.parametrize("method", [name for name in METHODS if name != "clustered"])
def test_order_of_rows_does_not_matter(method: str) -> None:
    rows = serial()
    orders = [np.random.default_rng(1).permutation(len(some)) for some in rows.y]
    mixed = ArrayRows(
        [matrix[order] for matrix, order in zip(rows.matrices, orders, strict=True)],
        [some[order] for some, order in zip(rows.y, orders, strict=True)],
        columns=rows.layout.columns,
    )
    assert_same(METHODS[method](mixed), METHODS[method](rows))


@pytest.mark.parametrize("method", ["huber", "instrumental", "clustered"])
def test_blocks_do_not_matter(method: str) -> None:
    pieces = serial(seconds=0.0037, breaks=[0.0205, 0.05])
    assert len(list(pieces.blocks())) > 15
    assert_same(METHODS[method](pieces), METHODS[method](serial()))


@pytest.mark.parametrize("method", [ols, irls])
def test_merged_observations_are_one(method: Callable[..., Estimate]) -> None:
    first, second = serial(1), serial(2)
    both = ArrayRows(
        [np.vstack(pair) for pair in zip(first.matrices, second.matrices, strict=True)],
        [np.concatenate(pair) for pair in zip(first.y, second.y, strict=True)],
        columns=first.layout.columns,
    )
    merged = first.observation() + second.observation()
    assert_same(method(merged, first.units), method(both.observation(), both.units))


@pytest.mark.parametrize("method", METHODS)
def test_diagnostics_travel(method: str) -> None:
    estimate = METHODS[method](serial())
    found = json.loads(json.dumps(dict(estimate.diagnostics), allow_nan=False))
    assert {
        "weights",
        "condition",
        "scaled_condition",
        "iterations",
        "converged",
    } <= set(found)
    assert found["converged"]
    np.testing.assert_array_equal(estimate.covariance, estimate.covariance.T)
    assert (
        np.linalg.eigvalsh(estimate.covariance / np.outer(estimate.std, estimate.std))[
            0
        ]
        > -1e-12
    )


# -- bad input ---------------------------------------------------------------------------------------------------------


def test_bad_input_is_refused() -> None:
    rows = serial()
    observation = rows.observation()
    with pytest.raises(InputError, match="8 units for 9 parameters"):
        ols(observation, rows.units[1:])
    with pytest.raises(
        InputError,
        match=r"noise has shape \(2,\); expected \(3,\), one for each of joint1",
    ):
        wls(observation, rows.units, [1, 1])
    with pytest.raises(InputError, match="'joint2': the noise must be a positive"):
        wls(observation, rows.units, [1, 0, 1])
    dead = ArrayRows(
        rows.matrices,
        [rows.y[0], 0 * rows.y[1], rows.y[2]],
        columns=rows.layout.columns,
    )
    with pytest.raises(InputError, match="'joint2': all its measured values are zero"):
        irls(dead.observation(), rows.units)
    wrong = ArrayRows(
        rows.matrices,
        [rows.y[0], np.nan * rows.y[1], rows.y[2]],
        columns=rows.layout.columns,
    )
    with pytest.raises(
        InputError, match="'joint2': its rows contain numbers that are not finite"
    ):
        ols(wrong.observation(), rows.units)
    nothing = ArrayRows([np.zeros((0, 2))], [np.zeros(0)])
    with pytest.raises(InputError, match="nothing to estimate"):
        ols(nothing.observation(), nothing.units)


def test_too_few_rows_are_refused() -> None:
    square = ArrayRows([np.eye(3)], [np.ones(3)])
    for method in (ols, tls):
        with pytest.raises(InputError, match="over to estimate"):
            method(square.observation(), square.units)
    with pytest.raises(InputError, match="only 2 rows"):
        ols(ArrayRows([np.eye(3)[:2]], [np.ones(2)]).observation(), square.units)
    rows = serial()
    few = ArrayRows(
        [rows.matrices[0][:3], *rows.matrices[1:]],
        [rows.y[0][:3], *rows.y[1:]],
        columns=rows.layout.columns,
    )
    with pytest.raises(InputError, match="'joint1': its 3 rows are all used up"):
        irls(few.observation(), few.units)
