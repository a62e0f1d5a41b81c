"""Huber's estimate: its equations, scipy's solution, and gross errors."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares

from echelon.identification.estimators.least_squares import gaussian_square, huber, irls
from echelon.shared.errors import InputError
from support.estimation_problems import NOISE, TRUTH, assert_same, dense, line, serial
from support.observation_rows import ArrayRows


def spoilt(seed: int = 0, share: float = 0.05) -> ArrayRows:
    """Clean rows of which a share has errors of a hundred standard deviations, all in one direction."""
    rows = serial(seed, samples=400)
    rng = np.random.default_rng(seed + 1)
    y = [
        some + 100 * s * (rng.random(len(some)) < share)
        for some, s in zip(rows.y, NOISE, strict=True)
    ]
    return ArrayRows(rows.matrices, y, columns=rows.layout.columns)


def test_huber_resists_gross_errors() -> None:
    clean, rows = irls(serial(samples=400).observation(), ["kg"] * 9), spoilt()
    robust, plain = huber(rows), irls(rows.observation(), rows.units)
    error = np.abs(robust.values - TRUTH) / clean.std
    assert error.max() < 4
    assert np.median(np.abs(plain.values - TRUTH) / clean.std) > 5
    np.testing.assert_allclose(robust.noise, NOISE, rtol=0.25)
    assert (plain.noise > 15 * NOISE).all()


def test_huber_agrees_with_scipy() -> None:
    rows = spoilt()
    line = ArrayRows(rows.matrices[2:], rows.y[2:], columns=[range(3)])
    estimate = huber(line, tolerance=1e-11, limit=500)
    W, y = line.matrices[0], line.y[0]
    scale = 1.345 * estimate.noise[0]
    found = least_squares(
        lambda z: y - W @ z,
        np.zeros(3),
        jac=lambda _: -W,
        loss="huber",
        f_scale=scale,
        xtol=1e-15,
        ftol=1e-15,
        gtol=1e-12,
    )
    np.testing.assert_allclose(estimate.values, found.x, rtol=1e-6)


def test_huber_solves_its_equations() -> None:
    rows, k = spoilt(), 1.345
    estimate = huber(rows, tolerance=1e-11, limit=500)
    W, y, output = dense(rows)
    sigma = estimate.noise[output]
    u = (y - W @ estimate.values) / sigma
    psi, inside = np.clip(u, -k, k), np.abs(u) <= k
    np.testing.assert_allclose(
        W.T @ (psi / sigma), 0, atol=1e-6 * np.abs(W.T / sigma).sum(axis=1).max()
    )
    V = W / sigma[:, None]
    leverage = np.einsum("ij,jk,ik->i", V, np.linalg.inv(V.T @ V), V)
    for i in range(3):
        mine = output == i
        assert np.sum(psi[mine] ** 2) == pytest.approx(
            gaussian_square(k) * np.sum(1 - leverage[mine]), rel=1e-6
        )
        share = estimate.diagnostics["downweighted"][f"joint{i + 1}"]
        assert share == pytest.approx(1 - inside[mine].mean())


def test_huber_covariance_is_the_asymptotic_formula() -> None:
    rows, k = line(samples=50), 1.345
    estimate = huber(rows, tolerance=1e-11, limit=500)
    W, y, N, n = rows.matrices[0], rows.y[0], 50, 3
    u = (y - W @ estimate.values) / estimate.noise[0]
    slope = np.mean(np.abs(u) <= k)
    correction = 1 + n / N * (1 - slope) / slope
    spread = (
        np.sum(np.clip(u, -k, k) ** 2) * estimate.noise[0] ** 2 / (N - n) / slope**2
    )
    np.testing.assert_allclose(
        estimate.covariance, correction**2 * spread * np.linalg.inv(W.T @ W), rtol=1e-6
    )


def test_huber_with_a_large_clip_is_irls() -> None:
    rows = serial()
    wide, plain = (
        huber(rows, clip=50.0, tolerance=1e-10),
        irls(rows.observation(), rows.units),
    )
    assert_same(wide, plain, 1e-7)
    assert set(wide.diagnostics["downweighted"].values()) == {0.0}


def test_huber_of_gaussian_noise() -> None:
    rows = serial(samples=3000)
    robust, plain = huber(rows), irls(rows.observation(), rows.units)
    np.testing.assert_allclose(robust.noise, plain.noise, rtol=0.03)
    np.testing.assert_allclose(
        (plain.std / robust.std) ** 2, 0.95, atol=0.05
    )  # the efficiency of k = 1.345
    np.testing.assert_allclose(
        list(robust.diagnostics["downweighted"].values()), 0.179, atol=0.02
    )


def test_huber_says_when_it_has_not_converged() -> None:
    assert not huber(spoilt(), limit=2).diagnostics["converged"]
    with pytest.raises(InputError, match="clip is 0"):
        huber(spoilt(), clip=0)
