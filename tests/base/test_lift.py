"""The lift back to standard parameters: Theorem 1 of the paper, and nearest in the metric."""

from __future__ import annotations

import numpy as np
import pytest

import echelon as ec
from echelon.base.lift import metric_matrix
from echelon.shared.conventions import LENGTH_DEGREE
from support import textbook_arms as arms
from support.float_regressor import random_states


@pytest.fixture(scope="module")
def base() -> ec.BaseModel:
    return ec.base_parameters(arms.panda())


@pytest.fixture(scope="module")
def zeta(base: ec.BaseModel) -> np.ndarray:
    return np.random.default_rng(1).uniform(-1, 1, len(base.parameters))


@pytest.mark.parametrize("metric", ["identity", "physical", "diagonal", "full"])
def test_lift_is_the_nearest_with_these_values(
    base: ec.BaseModel, zeta: np.ndarray, metric: str
) -> None:
    n, rng = len(zeta), np.random.default_rng(2)
    root = rng.uniform(-1, 1, (n, n)) + 3 * np.eye(n)
    chosen = {"diagonal": rng.uniform(0.5, 2, n), "full": root @ root.T}.get(
        metric, metric
    )
    s = metric_matrix(chosen, [c.length_degree for c in base.mechanism.columns], 0.384)
    prior = rng.uniform(-1, 1, n)
    lifted = base.lift(base.values(zeta), prior, chosen)
    b = base.B_float()
    np.testing.assert_allclose(b @ lifted, b @ zeta, atol=1e-9)
    # nearest in the norm of S⁻¹: the correction S⁻¹(ζ̂ − ζ₀) lies in the row space of B
    dual = np.linalg.solve(s, lifted - prior)
    np.testing.assert_allclose(
        b.T @ np.linalg.lstsq(b.T, dual, rcond=None)[0],
        dual,
        atol=1e-7 * np.abs(dual).max(),
    )
    # the formula of the paper
    paper = prior + s @ b.T @ np.linalg.solve(
        b @ s @ b.T, base.values(zeta) - b @ prior
    )
    np.testing.assert_allclose(lifted, paper, atol=1e-7)
    np.testing.assert_allclose(
        base.lift(base.values(lifted), lifted, chosen), lifted, atol=1e-9
    )


def test_lift_moves_torques_not_at_all(base: ec.BaseModel, zeta: np.ndarray) -> None:
    full = base.standard_regressor(*random_states(base.mechanism, 4))
    np.testing.assert_allclose(
        full @ base.lift(base.values(zeta)), full @ zeta, atol=1e-9
    )


@pytest.mark.parametrize(
    "metric",
    ["euclid", np.zeros(70), -np.ones(70), np.ones(3), np.triu(np.ones((70, 70)))],
)
def test_bad_metrics_are_refused(
    base: ec.BaseModel, zeta: np.ndarray, metric: object
) -> None:
    with pytest.raises(ec.InputError, match="metric"):
        base.lift(base.values(zeta), metric=metric)  # type: ignore[arg-type]


def test_bad_shapes_are_refused(base: ec.BaseModel, zeta: np.ndarray) -> None:
    with pytest.raises(ec.InputError, match="43 base parameters"):
        base.lift([1.0])
    with pytest.raises(ec.InputError, match="prior of 70"):
        base.lift(base.values(zeta), prior=[1.0])


@pytest.mark.parametrize("length", [0, -1, float("nan"), float("inf")])
def test_bad_lengths_are_refused(
    base: ec.BaseModel, zeta: np.ndarray, length: float
) -> None:
    with pytest.raises(ec.InputError, match="length"):
        base.lift(base.values(zeta), length=length)


def test_numbers_must_be_finite(base: ec.BaseModel, zeta: np.ndarray) -> None:
    with pytest.raises(ec.InputError, match="finite"):
        base.lift(np.full(base.rank, np.nan))
    with pytest.raises(ec.InputError, match="finite"):
        base.lift(base.values(zeta), prior=np.full(70, np.inf))


@pytest.mark.parametrize(("metric", "same"), [("physical", True), ("identity", False)])
def test_the_physical_metric_does_not_know_the_unit_of_length(
    zeta: np.ndarray, metric: str, same: bool
) -> None:
    metres = ec.base_parameters(arms.panda(lengths=tuple(arms.PANDA.values())))
    longer = [f"{1000 * float(x):g}" for x in arms.PANDA.values()]
    millimetres = ec.base_parameters(arms.panda("0 0 -9810", longer))
    unit = np.tile([1000.0**power for power in LENGTH_DEGREE], 7)
    one, other = (
        model.lift(model.values(z), metric=metric)
        for model, z in ((metres, zeta), (millimetres, zeta * unit))
    )
    assert np.allclose(one * unit, other, rtol=1e-6, atol=1e-6 * unit) is same


def test_symbols_are_used_and_nothing_else_changes(
    base: ec.BaseModel, zeta: np.ndarray
) -> None:
    longer = {"a4": 0.2, "d3": 0.5}
    lifted = base.lift(base.values(zeta, longer), symbols=longer)
    np.testing.assert_allclose(
        base.B_float(longer) @ lifted, base.B_float(longer) @ zeta, atol=1e-9
    )


def test_without_prior_and_metric(base: ec.BaseModel, zeta: np.ndarray) -> None:
    """The shortest vector in the plain norm; unidentifiable parameters stay where the prior has them."""
    shortest = np.linalg.pinv(base.B_float()) @ base.values(zeta)
    np.testing.assert_allclose(
        base.lift(base.values(zeta), metric="identity"), shortest, atol=1e-9
    )
    silent = [
        name is ec.Identifiability.UNIDENTIFIABLE
        for name in base.classification.values()
    ]
    np.testing.assert_array_equal(
        base.lift(base.values(zeta), prior=zeta)[silent], zeta[silent]
    )
