"""Criteria of optimal experiments: values by their definitions, slopes by differences."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from echelon.excite.problem import information as criteria
from echelon.excite.problem.information import (
    OptimalityCriterion,
    condition_number,
    log_det,
)
from echelon.shared.choices import Optimality
from support.excitation_cases import Floats, slope_along

NAMES: tuple[Optimality, ...] = ("d_optimal", "a_optimal", "condition")


def information(seed: int, size: int = 5, spread: float = 2.0) -> Floats:
    """A random positive definite matrix with eigenvalues over some decades."""
    rng = np.random.default_rng(seed)
    turned = np.linalg.qr(rng.normal(size=(size, size)))[0]
    return (turned * 10 ** rng.uniform(-spread, spread, size)) @ turned.T


def scales(seed: int, size: int = 5) -> Floats:
    return 10 ** np.random.default_rng(seed).uniform(-1, 1, size)


@pytest.mark.parametrize("seed", range(5))
def test_values_by_definition(seed: int) -> None:
    F, units = information(seed), scales(seed)
    scaled = np.diag(units) @ F @ np.diag(units)
    assert OptimalityCriterion("d_optimal", units).evaluate(F)[0] == pytest.approx(
        -np.linalg.slogdet(scaled)[1] / 5, rel=1e-9
    )
    expected = np.log(np.trace(np.linalg.inv(scaled)))
    assert OptimalityCriterion("a_optimal", units).evaluate(F)[0] == pytest.approx(
        expected, rel=1e-7
    )
    assert condition_number(F) == pytest.approx(np.sqrt(np.linalg.cond(F)), rel=1e-7)
    assert log_det(F) == pytest.approx(np.linalg.slogdet(F)[1], rel=1e-12)


@given(st.integers(0, 2**32 - 1), st.integers(1, 12), st.floats(0, 3))
def test_smoothed_condition_is_a_bound(seed: int, size: int, spread: float) -> None:
    """Sums of powers of n numbers lie between the largest and n times it."""
    F = information(seed, size, spread)
    exact = np.log(condition_number(F))
    found = OptimalityCriterion("condition", np.ones(size)).evaluate(F)[0]
    assert exact - 1e-9 <= found <= exact + np.log(size) / 8 + 1e-9


def test_smoothed_condition_tends_to_the_condition(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    F = information(3, 8, 0.3)
    gaps = []
    for power in (4, 8, 64, 512):
        monkeypatch.setattr(criteria, "SHARPNESS", power)
        gaps.append(
            OptimalityCriterion("condition", np.ones(8)).evaluate(F)[0]
            - np.log(condition_number(F))
        )
    assert gaps == sorted(gaps, reverse=True)
    assert 0 <= gaps[-1] < 1e-3 < gaps[0]


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("name", NAMES)
def test_slopes(name: Optimality, seed: int) -> None:
    """tr(M D) is the derivative along every symmetric direction D."""
    criterion, F = (
        OptimalityCriterion(name, scales(seed)),
        information(seed, spread=1.0),
    )
    M = criterion.evaluate(F)[1]
    np.testing.assert_allclose(M, M.T, atol=1e-12 * np.abs(M).max())
    rng = np.random.default_rng(seed)
    for _ in range(4):
        D = rng.normal(size=(5, 5))
        D = (D + D.T) * np.sqrt(np.outer(np.diag(F), np.diag(F)))
        smallest = np.abs(np.linalg.eigvals(np.linalg.solve(F, D))).max()
        expected = slope_along(
            lambda t, D=D: criterion.evaluate(F + t * D)[0], 1e-3 / smallest
        )
        assert np.trace(M @ D) == pytest.approx(
            float(expected), rel=1e-6, abs=1e-6 * smallest
        )


@pytest.mark.parametrize("name", NAMES)
def test_more_information_is_better(name: Optimality) -> None:
    F = information(0)
    assert (
        OptimalityCriterion(name, np.ones(5)).evaluate(F)[0]
        > OptimalityCriterion(name, np.ones(5)).evaluate(F + np.eye(5) * 10)[0]
    )


def test_scales_only_shift_the_first_one() -> None:
    units = scales(1)
    shifts = []
    for seed in range(3):
        values = [
            OptimalityCriterion("d_optimal", u).evaluate(information(seed))
            for u in (units, np.ones(5))
        ]
        shifts.append(values[0][0] - values[1][0])
        np.testing.assert_allclose(
            values[0][1],
            values[1][1],
            rtol=1e-6,
            atol=1e-6 * np.abs(values[1][1]).max(),
        )
    np.testing.assert_allclose(shifts, -2 * np.mean(np.log(units)), rtol=1e-7)


def test_singular_matrices() -> None:
    dependent = np.outer([1.0, 2.0, 3.0], [1.0, 2.0, 3.0])
    for F in (dependent, np.zeros((3, 3)), np.diag([1.0, 0.0, 2.0])):
        assert condition_number(F) == np.inf
    assert condition_number(np.diag([4.0, 1.0, 1.0])) == pytest.approx(2.0)
    assert condition_number(np.diag([1.0, 1e-14])) == pytest.approx(1e7, rel=1e-6)
    assert log_det(np.zeros((3, 3))) == -np.inf
    assert log_det(np.diag([1.0, 0.0, 2.0])) == -np.inf
    assert log_det(np.diag([1.0, -1.0])) == -np.inf  # what rounding may make of one


@pytest.mark.parametrize(
    "F",
    [np.outer([1.0, 2.0, 3.0], [1.0, 2.0, 3.0]), np.zeros((3, 3))],
    ids=["one", "none"],
)
@pytest.mark.parametrize("name", NAMES)
def test_singular_matrices_are_bad_but_numbers(name: Optimality, F: Floats) -> None:
    """A search can begin where parameters are not visible: values and slopes are finite, and much worse."""
    criterion = OptimalityCriterion(name, np.ones(3))
    value, slope = criterion.evaluate(F)
    assert np.isfinite(value)
    assert np.isfinite(slope).all()
    assert value > criterion.evaluate(F + 1e-3 * np.diag([1.0, 2.0, 3.0]))[0] + 1
