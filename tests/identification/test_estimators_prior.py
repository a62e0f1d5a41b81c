"""Priors, known values, and data that leave directions open."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from echelon.identification.estimators.errors_in_variables import tls
from echelon.identification.estimators.estimate import (
    Estimate,
    direction_text,
    open_directions,
)
from echelon.identification.estimators.fit import RowsOfUnknowns, known_values
from echelon.identification.estimators.least_squares import (
    huber,
    irls,
    minimum_norm,
    ols,
)
from echelon.identification.estimators.ridge import ridge
from echelon.shared.errors import InputError
from support.estimation_problems import (
    TRUTH,
    Floats,
    assert_same,
    dense,
    line,
    serial,
    unseen,
)
from support.observation_rows import ArrayRows

# -- ridge -------------------------------------------------------------------------------------------------------------


def by_hand(rows: ArrayRows) -> tuple[Floats, Floats, Floats]:
    """W, y, and the variances of the prior: those of columns of norm 1."""
    W, y, _ = dense(rows)
    return W, y, 1 / np.sum(W**2, axis=0)


def test_ridge_is_the_posterior() -> None:
    rows, prior = serial(samples=12), TRUTH + 0.3
    estimate = ridge(rows.observation(), rows.units, prior, weight=2.5)
    W, y, P = by_hand(rows)
    variance = estimate.diagnostics["deviation"] ** 2
    precision = W.T @ W / variance + 2.5 * np.diag(1 / P)
    np.testing.assert_allclose(
        estimate.covariance, np.linalg.inv(precision), rtol=1e-6, atol=1e-12
    )
    change = np.linalg.solve(precision, W.T @ (y - W @ prior) / variance)
    np.testing.assert_allclose(estimate.values, prior + change, rtol=1e-7)
    effective = np.trace(W @ np.linalg.inv(precision) @ W.T) / variance
    assert estimate.diagnostics["effective_parameters"] == pytest.approx(effective)
    assert estimate.degrees == pytest.approx(len(y) - effective)
    residual = y - W @ estimate.values
    assert variance == pytest.approx(residual @ residual / (len(y) - effective))
    from_data = 1 - np.diagonal(np.linalg.inv(precision)) * 2.5 / P
    np.testing.assert_allclose(estimate.diagnostics["from_data"], from_data, atol=1e-9)


def log_evidence(
    W: Floats, y: Floats, prior: Floats, P: Floats, weight: float, variance: float
) -> float:
    covariance = variance * np.eye(len(y)) + (W * P) @ W.T / weight
    return float(multivariate_normal(W @ prior, covariance).logpdf(y))


@pytest.mark.parametrize("weight", ["evidence", 3.0])
def test_ridge_maximises_the_evidence(weight: float | Literal["evidence"]) -> None:
    """By the weight, unless it is given, and by the noise."""
    rows, prior = serial(samples=12, noise=np.full(3, 0.3)), TRUTH + 0.3
    W, y, P = by_hand(rows)
    found = ridge(rows.observation(), rows.units, prior, weight=weight).diagnostics
    at, variance = found["weight"], found["deviation"] ** 2
    assert found["log_evidence"] == pytest.approx(
        log_evidence(W, y, prior, P, at, variance)
    )
    for factor in (0.8, 1.25):
        assert (
            log_evidence(W, y, prior, P, at, variance * factor) < found["log_evidence"]
        )
        if weight == "evidence":
            assert (
                log_evidence(W, y, prior, P, at * factor, variance)
                < found["log_evidence"]
            )
    assert not found["weight_at_bound"]
    assert weight == "evidence" or at == pytest.approx(weight)


def test_ridge_lies_between_the_prior_and_the_data() -> None:
    rows, prior = serial(), TRUTH + 1.0
    strong = ridge(rows.observation(), rows.units, prior, weight=1e14)
    weak = ridge(rows.observation(), rows.units, prior, weight=1e-12)
    np.testing.assert_allclose(strong.values, prior, atol=1e-6)
    assert_same(weak, ols(rows.observation(), rows.units))


def test_ridge_with_a_perfect_prior_trusts_it() -> None:
    rows = serial()
    found = ridge(
        rows.observation(), rows.units, ols(rows.observation(), rows.units).values
    )
    assert found.diagnostics["weight_at_bound"]


def test_ridge_takes_what_the_data_leave_open_from_the_prior() -> None:
    rows = unseen()
    with pytest.raises(InputError, match=r"parameter 'p4'.*fix its value"):
        ridge(rows.observation(), rows.units, np.zeros(4))
    twice = ArrayRows([rows.matrices[0][:, [0, 1, 0]]], rows.y)
    found = ridge(twice.observation(), twice.units, [1.0, 0.0, 5.0])
    assert found.values[0] - found.values[2] == pytest.approx(
        1.0 - 5.0
    )  # only their sum shows
    assert found.diagnostics["condition"] is None


def test_ridge_refuses_impossible_priors() -> None:
    rows = line()
    for weight in (-1.0, np.nan, "best"):
        with pytest.raises(
            InputError, match="expected a positive number or 'evidence'"
        ):
            ridge(rows.observation(), rows.units, np.zeros(3), weight=weight)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="3 finite numbers"):
        ridge(rows.observation(), rows.units, [np.nan] * 3)


# -- data that leave directions open -----------------------------------------------------------------------------------


def test_open_directions_are_named() -> None:
    rows = unseen()
    directions = open_directions(rows.observation().combined())
    np.testing.assert_allclose(rows.matrices[0] @ directions.T, 0, atol=1e-12)
    texts = {direction_text(some, rows.layout.parameters) for some in directions}
    assert "p4" in texts
    assert texts - {"p4"} <= {
        "p3 − 2·p1 + p2",
        "−2·p1 + p2 + p3",
        "p1 − 0.5·p2 − 0.5·p3",
    }


@pytest.mark.parametrize("method", [ols, irls, tls])
def test_what_the_data_leave_open_is_an_error(method: Callable[..., Estimate]) -> None:
    rows = unseen()
    with pytest.raises(
        InputError,
        match=r"determine 2 of 4 parameters; nothing changes along .*p4.*ridge\(\)",
    ):
        method(rows.observation(), rows.units)


def test_minimum_norm_is_the_pseudo_inverse_of_scaled_columns() -> None:
    rows = unseen()
    W, y = rows.matrices[0], rows.y[0]
    estimate = minimum_norm(rows.observation(), rows.units)
    norms = np.linalg.norm(W, axis=0) + (np.arange(4) == 3)
    np.testing.assert_allclose(
        estimate.values, np.linalg.pinv(W / norms, rcond=1e-10) @ y / norms, atol=1e-12
    )
    np.testing.assert_allclose(
        W @ estimate.values, W[:, :2] @ np.linalg.lstsq(W[:, :2], y)[0], atol=1e-12
    )
    assert np.isinf(estimate.std).all()
    assert estimate.degrees == 28
    assert len(estimate.diagnostics["open"]) == 2


def test_minimum_norm_of_determined_data_is_least_squares() -> None:
    rows = serial()
    assert_same(
        minimum_norm(rows.observation(), rows.units),
        ols(rows.observation(), rows.units),
    )
    first = ArrayRows(
        [np.column_stack([rows.matrices[0], np.zeros(len(rows.y[0]))])], rows.y[:1]
    )
    estimate = minimum_norm(first.observation(), first.units)
    assert np.isinf(estimate.std).tolist() == [False] * 9 + [True]
    alone = ols(ArrayRows(rows.matrices[:1], rows.y[:1]).observation(), rows.units)
    np.testing.assert_allclose(
        estimate.covariance[:9, :9], alone.covariance, rtol=1e-7, atol=1e-13
    )
    assert estimate.degrees == alone.degrees
    twice = ArrayRows(
        [np.column_stack([rows.matrices[0][:, :1], rows.matrices[0]])], rows.y[:1]
    )
    doubled = minimum_norm(twice.observation(), twice.units)
    np.testing.assert_allclose(doubled.std, [np.inf, np.inf, *alone.std[1:]], rtol=1e-7)
    np.testing.assert_allclose(doubled.values[:2], alone.values[0] / 2, rtol=1e-7)


# -- known values ------------------------------------------------------------------------------------------------------


def test_known_values_move_to_the_right() -> None:
    rows = serial()
    names = rows.layout.parameters
    known = known_values(names, rows.units, {"p2": -1.0, "p8": -4.0})
    estimate = known.restored(
        irls(known.observation(rows.observation()), known.unknown_units)
    )
    kept = [k for k in range(9) if k not in (1, 7)]
    W, y, _ = dense(rows, estimate.diagnostics["weights"])
    values = np.linalg.lstsq(W[:, kept], y - W[:, 1] * -1 - W[:, 7] * -4)[0]
    np.testing.assert_allclose(estimate.values[kept], values, rtol=1e-9)
    assert estimate.values[1] == -1
    assert estimate.std[7] == 0
    assert estimate.parameters == names
    assert estimate.diagnostics["known"] == ["p2", "p8"]
    assert (
        estimate.std[kept] <= irls(rows.observation(), rows.units).std[kept] * 1.05
    ).all()


def test_rows_and_observations_of_unknowns_agree() -> None:
    rows = serial(seconds=0.02)
    known = known_values(
        rows.layout.parameters, rows.units, {"p2": -1.0, "p4": 2.0, "p5": 0.5}
    )
    assert known.unknowns == [0, 2, 5, 6, 7, 8]
    changed = RowsOfUnknowns(rows, known)
    observation = changed.observation()
    assert observation.layout == changed.layout
    again = np.zeros((6, 6))
    for block in changed.blocks():
        for matrix, columns in zip(block.matrices, changed.layout.columns, strict=True):
            again[np.ix_(columns, columns)] += matrix.T @ matrix
    R = observation.combined().R
    np.testing.assert_allclose(R.T @ R, again, atol=1e-10)
    assert_same(
        huber(changed, clip=50.0, tolerance=1e-10),
        irls(observation, changed.units),
        1e-7,
    )


def test_open_directions_stay_open_when_restored() -> None:
    rows = unseen()
    known = known_values(rows.layout.parameters, rows.units, {"p3": 0.0})
    estimate = known.restored(
        minimum_norm(known.observation(rows.observation()), known.unknown_units)
    )
    assert np.isinf(estimate.std).tolist() == [False, False, False, True]
    assert not np.isnan(estimate.covariance).any()


def test_known_values_refuse_what_does_not_fit() -> None:
    rows = serial()
    names, units = rows.layout.parameters, rows.units
    with pytest.raises(
        InputError,
        match=r"parameter 'p22': there is no such parameter; did you mean 'p2'",
    ):
        known_values(names, units, {"p22": 1.0})
    with pytest.raises(InputError, match="nothing is left"):
        known_values(names, units, dict.fromkeys(names, 0.0))
    with pytest.raises(InputError, match="not a finite number"):
        known_values(names, units, {"p2": np.nan})
    other = known_values(("a", "b"), ("kg", "kg"), {"a": 1.0})
    with pytest.raises(InputError, match="other parameters"):
        other.observation(rows.observation())
    with pytest.raises(InputError, match="not one of the unknowns"):
        other.restored(ols(rows.observation(), units))
