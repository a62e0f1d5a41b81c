"""Online estimates are those of the batch, weighted with forgetting; intervals hold; missing outputs are skipped."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import echelon as ec
from echelon.identification.estimators.least_squares import irls, wls
from support.paths import ROOT

NOISE = np.array([0.3, 0.05])
TRUE = np.array([0.4, 0.3, 0.1, 0.2, 0.1, 0.05])


@cache
def pendulum() -> ec.BaseModel:
    return ec.base_parameters(ec.load(ROOT / "examples/double_pendulum.yaml"))


def log(samples: int, seed: int = 0) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    q, qd, qdd = rng.normal(size=(3, samples, 2))
    y = pendulum().predict(q, qd, qdd, TRUE) + NOISE * rng.normal(size=(samples, 2))
    return {"q": q, "qd": qd, "qdd": qdd, "y": y}


def fed(estimator: ec.OnlineEstimator, data: dict[str, np.ndarray], step: int) -> None:
    for start in range(0, len(data["y"]), step):
        estimator.update(**{k: v[start : start + step] for k, v in data.items()})


def rows_of(
    data: dict[str, np.ndarray], age_base: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stacked rows of [W y] divided by the noise, and the weight of each by its age."""
    W = pendulum().regressor(data["q"], data["qd"], data["qdd"]) / NOISE[:, None]
    y = data["y"] / NOISE
    weights = np.repeat(age_base ** np.arange(len(y))[::-1], 2)
    kept = ~np.isnan(y.ravel())
    return W.reshape(-1, 6)[kept], y.ravel()[kept], weights[kept]


@pytest.mark.parametrize("step", [1, 7, 400])
def test_without_forgetting_it_is_the_batch(step: int) -> None:
    data = log(400)
    batch = pendulum().accumulate(data)
    given, found = ec.online(pendulum(), noise=NOISE), ec.online(pendulum())
    for estimator in (given, found):
        fed(estimator, data, step)
    wanted = wls(batch, pendulum().units, NOISE)
    np.testing.assert_allclose(given.estimate().values, wanted.values, rtol=1e-9)
    np.testing.assert_allclose(given.estimate().noise, wanted.noise, rtol=1e-9)
    free = irls(batch, pendulum().units)
    np.testing.assert_allclose(found.estimate().values, free.values, rtol=1e-9)
    np.testing.assert_allclose(found.estimate().covariance, free.covariance, rtol=1e-7)
    np.testing.assert_allclose(found.estimate().interval(), free.interval(), rtol=1e-7)


@pytest.mark.parametrize("step", [1, 7, 400])
def test_with_forgetting_it_is_the_weighted_batch(step: int) -> None:
    data = log(400)
    data["y"][50:90, 1] = np.nan
    data["y"][120] = np.nan
    estimator = ec.online(pendulum(), noise=NOISE, forgetting=0.97)
    fed(estimator, data, step)
    W, y, weights = rows_of(data, 0.97)
    root = np.sqrt(weights)
    wanted = np.linalg.lstsq(root[:, None] * W, root * y, rcond=None)[0]
    estimate = estimator.estimate()
    np.testing.assert_allclose(estimate.values, wanted, rtol=1e-9, atol=1e-10)
    inverse = np.linalg.inv(W.T * weights @ W)
    np.testing.assert_allclose(estimate.covariance, inverse, rtol=1e-8, atol=1e-12)
    assert estimate.rows == (399, 359)
    assert estimator.samples == 400


def test_the_prior_counts_as_a_measurement_that_does_not_fade() -> None:
    data, centre = log(60), np.full(6, 0.2)
    rng = np.random.default_rng(5)
    factor = np.tril(rng.normal(size=(6, 6))) + 3 * np.eye(6)
    covariance = factor @ factor.T
    estimator = ec.online(
        pendulum(), noise=NOISE, forgetting=0.9, prior=centre, covariance=covariance
    )
    np.testing.assert_allclose(estimator.estimate().values, centre)
    np.testing.assert_allclose(estimator.estimate().covariance, covariance)
    fed(estimator, data, 11)
    W, y, weights = rows_of(data, 0.9)
    information = np.linalg.inv(covariance)
    gram = W.T * weights @ W + information
    wanted = np.linalg.solve(gram, W.T * weights @ y + information @ centre)
    np.testing.assert_allclose(estimator.estimate().values, wanted, rtol=1e-9)
    alone = ec.online(pendulum(), prior=centre, covariance=np.full(6, 0.1))
    np.testing.assert_allclose(alone.triangle.solve(), centre)


def test_poor_excitation_winds_up_without_a_prior_and_not_with_one() -> None:
    prior = {"prior": np.zeros(6), "covariance": np.ones(6)}
    bare = ec.online(pendulum(), noise=NOISE, forgetting=0.95)
    bounded = ec.online(pendulum(), noise=NOISE, forgetting=0.95, **prior)
    still = {"q": np.full((300, 2), 0.3), "qd": np.zeros((300, 2))}
    still |= {"qdd": np.zeros((300, 2))}
    still["y"] = pendulum().predict(*still.values(), TRUE)
    for estimator in (bare, bounded):
        fed(estimator, log(200), 10)
        before, excited = estimator.estimate().std.max(), estimator.condition
        assert excited < 5
        fed(estimator, still, 10)
        assert estimator.condition > 100 * excited
        if estimator is bare:
            assert estimator.estimate().std.max() > 100 * before
        else:
            assert estimator.estimate().std.max() <= 1.0
    fed(bare, {name: np.tile(v, (10, 1)) for name, v in still.items()}, 1000)
    assert bare.rank < 6
    with pytest.raises(ec.InputError, match=r"the data determine \d of 6 parameters"):
        bare.estimate()


@pytest.mark.parametrize("noise", [NOISE, None])
def test_intervals_cover_constant_parameters(noise: np.ndarray | None) -> None:
    inside = []
    for seed in range(120):
        estimator = ec.online(pendulum(), noise=noise)
        fed(estimator, log(40, seed), 40)
        low, high = estimator.estimate().interval().T
        inside.append((low <= TRUE) & (high >= TRUE))
    # 720 intervals, of which those of one seed are correlated
    assert 0.92 < np.mean(inside) < 0.98


def test_intervals_cover_parameters_that_drift_as_fast_as_samples_are_forgotten() -> (
    None
):
    """A random walk whose steps make up for what is forgotten: then the estimator is the Kalman filter of the walk."""
    inside, forgetting = [], 0.8
    for seed in range(60):
        rng, true = np.random.default_rng(seed), TRUE
        estimator = ec.online(pendulum(), noise=NOISE, forgetting=forgetting)
        fed(estimator, log(30, seed), 30)
        # the first error is one of the covariance that the estimator states
        root = np.linalg.cholesky(estimator.estimate().covariance)
        true = estimator.estimate().values + root @ rng.normal(size=6)
        for _ in range(15):
            growth = (1 / forgetting - 1) * estimator.estimate().covariance
            true = true + np.linalg.cholesky(growth) @ rng.normal(size=6)
            q, qd, qdd = rng.normal(size=(3, 1, 2))
            y = pendulum().predict(q, qd, qdd, true) + NOISE * rng.normal(size=2)
            estimator.update(q, qd, qdd, y)
        low, high = estimator.estimate().interval().T
        inside.append((low <= true) & (high >= true))
    assert 0.91 < np.mean(inside) < 0.99


def test_noise_is_estimated_with_forgetting() -> None:
    found = []
    for seed in range(40):
        estimator = ec.online(pendulum(), forgetting=0.9)
        fed(estimator, log(100, seed), 50)
        found.append(estimator.estimate().noise ** 2)
    np.testing.assert_allclose(np.mean(found, axis=0), NOISE**2, rtol=0.15)


def test_a_change_is_followed() -> None:
    estimator = ec.online(pendulum(), noise=NOISE, forgetting=0.95)
    fed(estimator, log(300), 20)
    later = log(300, 1)
    later["y"] += pendulum().predict(later["q"], later["qd"], later["qdd"], TRUE)
    fed(estimator, later, 20)
    estimate = estimator.estimate()
    assert (np.abs(estimate.values - 2 * TRUE) < 4 * estimate.std).all()


def test_the_physical_estimate_is_one_that_a_robot_can_have() -> None:
    estimator, data = ec.online(pendulum(), noise=NOISE), log(50)
    states = data["q"], data["qd"], data["qdd"]
    data["y"] -= pendulum().predict(*states, np.eye(6)[3])  # a negative inertia
    fed(estimator, data, 50)
    fit = estimator.physical()
    np.testing.assert_allclose(fit.base, pendulum().B_float() @ fit.standard)
    assert all(margin > 0 for margin in fit.margins.values())
    assert fit.misfit > fit.unconstrained_misfit + 100
    many = ec.online(pendulum(), noise=NOISE)
    fed(many, log(5000), 5000)
    found, plain = many.physical().base, many.estimate()
    assert (np.abs(found - plain.values) < plain.std).all()


def test_a_sample_may_be_a_vector() -> None:
    data = log(40)
    alone, together = (ec.online(pendulum(), noise=NOISE) for _ in range(2))
    fed(together, data, 40)
    for k in range(40):
        alone.update(**{name: values[k] for name, values in data.items()})
    assert alone.samples == 40
    np.testing.assert_allclose(
        alone.estimate().values, together.estimate().values, rtol=1e-9
    )


def test_lengths_may_come_with_the_samples() -> None:
    data = log(40)
    text = (ROOT / "examples/double_pendulum.yaml").read_text()
    open_length = ec.base_parameters(ec.load(text.replace("l1: 0.3", "l1: null")))
    estimator = ec.online(open_length, noise=NOISE)
    with pytest.raises(ec.InputError, match="symbol 'l1' has no value"):
        estimator.update(**data)
    estimator.update(**data, symbols={"l1": 0.3})
    wanted = ec.online(pendulum(), noise=NOISE)
    fed(wanted, data, 40)
    np.testing.assert_allclose(
        estimator.estimate().values, wanted.estimate().values, rtol=1e-9
    )


def test_too_short_a_memory_says_how_long_it_is() -> None:
    estimator = ec.online(pendulum(), forgetting=0.5)
    fed(estimator, log(200), 200)
    with pytest.raises(ec.InputError, match=r"its 2 rows .* give online\(\) the noise"):
        estimator.estimate()


def test_refusals_change_nothing() -> None:
    estimator = ec.online(pendulum(), noise=NOISE)
    data = log(20)
    fed(estimator, data, 20)
    kept = estimator.estimate().values
    bad = {**data, "q": np.where(np.arange(20)[:, None] == 7, np.nan, data["q"])}
    with pytest.raises(ec.InputError, match="sample 7 has a state that is not finite"):
        estimator.update(**bad)
    with pytest.raises(
        ec.InputError, match=r"y has shape \(20, 1\); expected \(20, 2\)"
    ):
        estimator.update(**{**data, "y": data["y"][:, :1]})
    assert estimator.samples == 20
    np.testing.assert_array_equal(estimator.estimate().values, kept)
    for options, said in [
        ({"forgetting": 0.0}, "above 0 and up to 1"),
        ({"forgetting": 1.1}, "above 0 and up to 1"),
        ({"noise": [1.0]}, "one for each of"),
        ({"noise": [1.0, -1.0]}, "output 'j2'"),
        ({"prior": TRUE}, "both a prior and its covariance"),
        ({"prior": TRUE, "covariance": np.zeros(6)}, "not positive"),
        ({"prior": TRUE, "covariance": -np.ones(6)}, "not positive"),
        ({"prior": TRUE, "covariance": np.triu(np.ones((6, 6)))}, "not symmetric"),
        ({"prior": TRUE[:2], "covariance": np.ones(6)}, "expected 6 base parameters"),
    ]:
        with pytest.raises(ec.InputError, match=said):
            ec.online(pendulum(), **options)
    few = ec.online(pendulum())
    fed(few, log(3), 3)
    with pytest.raises(ec.InputError, match=r"all used up|determine"):
        few.estimate()
