"""Logs of robots: R-factors and normal equations beside the observation matrix itself."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import echelon as ec
from echelon.loops.assembly import Assembly
from support.derived import base_of

Log = dict[str, Any]


def states(base: ec.BaseModel, count: int, rng: np.random.Generator) -> Log:
    mechanism = base.mechanism
    if mechanism.closures:
        motion = Assembly(mechanism).random_closed_states(rng, count)
    else:
        motion = tuple(
            rng.uniform(-2, 2, (count, len(mechanism.velocities))) for _ in range(3)
        )
    return dict(zip(("q", "qd", "qdd"), motion, strict=True))


def noisy_log(base: ec.BaseModel, count: int, seed: int = 0) -> Log:
    rng = np.random.default_rng(seed)
    log = states(base, count, rng)
    exact = base.predict(*log.values(), rng.normal(size=base.rank))
    return log | {"y": exact + 0.01 * rng.normal(size=exact.shape)}


@pytest.fixture(scope="module", params=["panda", "tx40", "loops/parallelogram"])
def base(request: pytest.FixtureRequest) -> ec.BaseModel:
    return base_of(request.param)


def stacked(
    base: ec.BaseModel, log: Log, weights: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    W = base.regressor(log["q"], log["qd"], log["qdd"]) * weights[:, None]
    return W.reshape(-1, base.rank), (log["y"] * weights).ravel()


def test_agrees_with_the_matrix(base: ec.BaseModel) -> None:
    log = noisy_log(base, 700)
    seen = base.accumulate(log)
    weights = np.linspace(0.5, 2.0, len(base.mechanism.outputs))
    W, y = stacked(base, log, weights)
    expected, _, rank, _ = np.linalg.lstsq(W, y)
    whole = seen.combined(weights)
    assert rank == base.rank == whole.rank
    scale = np.abs(expected).max() * whole.scaled_condition
    np.testing.assert_allclose(whole.solve(), expected, rtol=0, atol=1e-13 * scale)
    np.testing.assert_allclose(
        whole.residual, np.linalg.norm(W @ expected - y), rtol=1e-10
    )
    np.testing.assert_allclose(whole.scales, np.linalg.norm(W, axis=0), rtol=1e-12)
    np.testing.assert_allclose(
        whole.R.T @ whole.R, W.T @ W, rtol=0, atol=1e-12 * np.abs(W.T @ W).max()
    )
    gram, moment, square = base.normal_equations(log).combined(weights)
    np.testing.assert_allclose(gram, W.T @ W, rtol=0, atol=1e-12 * np.abs(gram).max())
    np.testing.assert_allclose(
        moment, W.T @ y, rtol=0, atol=1e-12 * np.abs(moment).max()
    )
    np.testing.assert_allclose(square, y @ y, rtol=1e-12)


def test_pieces_logs_and_threads(base: ec.BaseModel) -> None:
    log = noisy_log(base, 500)
    whole = base.accumulate(log, block=128)
    pieces = [
        {name: value[k : k + 90] for name, value in log.items()}
        for k in range(0, 500, 90)
    ]
    for other in (
        base.accumulate(iter(pieces), block=128),
        base.accumulate(log, block=128, threads=1),
    ):
        assert all(
            np.array_equal(a, b)
            for a, b in zip(whole.factors, other.factors, strict=True)
        )
    merged = base.accumulate(pieces[:2]) + base.accumulate(pieces[2:])
    np.testing.assert_allclose(
        merged.combined().solve(), whole.combined().solve(), rtol=0, atol=1e-8
    )
    assert merged.samples == whole.samples == 500


@pytest.mark.parametrize("missing", ["q", "qdd", "y"])
def test_what_a_log_lacks_is_named(base: ec.BaseModel, missing: str) -> None:
    log = noisy_log(base, 4)
    del log[missing]
    with pytest.raises(ec.InputError, match=f"^{missing} is missing"):
        base.accumulate(log)


def test_values_that_are_not_finite_are_named(base: ec.BaseModel) -> None:
    log = noisy_log(base, 300)
    log["y"][250, 0] = np.nan
    with pytest.raises(ec.InputError, match=r"y of '.*' is nan in sample 250"):
        base.accumulate(log)


def test_wrong_shapes(base: ec.BaseModel) -> None:
    log = noisy_log(base, 5)
    with pytest.raises(ec.InputError, match="y has shape"):
        base.accumulate(log | {"y": log["y"][:, :0]})
    with pytest.raises(ec.InputError, match="block is 0"):
        base.accumulate(log, block=0)
    with pytest.raises(ec.InputError, match="inputs has 'ghost'"):
        base.accumulate(log | {"inputs": {"ghost": np.zeros(5)}})


def test_no_samples(base: ec.BaseModel) -> None:
    if base.mechanism.closures:
        pytest.skip("random closed states need at least one sample")
    empty = base.accumulate(noisy_log(base, 0))
    assert empty.samples == 0
    assert not empty.combined().R.any()
