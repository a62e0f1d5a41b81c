"""Pseudo-inertias: which bodies exist, and how far two of them are apart."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from echelon.robot.inertia import (
    divergence,
    factor,
    margins,
    move,
    pseudo_inertia,
)
from echelon.shared.errors import InputError
from support.physical_robots import body_of_points, is_physical

seeds = st.integers(0, 2**32 - 1)


@given(seeds)
def test_a_body_exists_if_its_central_moments_satisfy_the_triangle_inequality(
    seed: int,
) -> None:
    rng = np.random.default_rng(seed)
    moments = rng.uniform(0.1, 1.2, 3)
    mass, centre = rng.uniform(-0.2, 1), rng.standard_normal(3)
    axes = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    tensor = axes @ np.diag(moments) @ axes.T + mass * (
        centre @ centre * np.eye(3) - np.outer(centre, centre)
    )
    body = np.array([*tensor[np.triu_indices(3)], *(mass * centre), mass])
    assert is_physical(body) == (mass > 0 and 2 * moments.max() < moments.sum())


@given(seeds)
def test_divergence_does_not_depend_on_frames_and_units(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = body_of_points(rng), body_of_points(rng)
    frame = np.eye(4)
    frame[:3, :3] = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    frame[:3, 3] = rng.standard_normal(3)
    ratio = pseudo_inertia(a) @ np.linalg.inv(pseudo_inertia(b))
    expected = np.trace(ratio) - np.log(np.linalg.det(ratio)) - 4
    assert np.isclose(divergence(a, b), expected, rtol=1e-6)
    assert np.isclose(divergence(move(a, frame), move(b, frame)), expected, rtol=1e-6)
    grams = 1000.0 * np.array([1e6] * 6 + [1e3] * 3 + [1.0])
    assert np.isclose(divergence(a * grams, b * grams), expected, rtol=1e-6)
    assert divergence((a + b) / 2, b) <= expected / 2 + 1e-12
    assert divergence(-a, b) == np.inf
    assert np.isclose(margins(a, b), np.linalg.eigvals(ratio).real.min(), rtol=1e-5)


def test_bodies_that_do_not_exist_have_no_factor() -> None:
    for body in (
        np.zeros(10),
        -np.ones(10),
        [1, 0, 0, 1, 0, 3, 0, 0, 0, 1],
        [np.nan] * 10,
    ):
        with pytest.raises(InputError, match="not positive definite"):
            factor(body)
