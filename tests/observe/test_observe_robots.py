"""Observations of real robots, whose regressors are computed and used up block by block, against dense matrices."""

from __future__ import annotations

import numpy as np
import pytest

import echelon as ec
from echelon.compute.machine.kernel import Kernel
from echelon.compute.observe.accumulate import Observer
from echelon.dynamics.functions import regressor
from support.robot_files import robot_file


@pytest.mark.parametrize("name", ["ur10_robot", "panda", "a1"])
def test_least_squares_of_robots(name: str) -> None:
    base = ec.base_parameters(ec.load(robot_file(name)))
    function = regressor(base.mechanism, base.matrix.pivots)
    rng = np.random.default_rng(1)
    samples = 700
    data = {
        a.name: rng.uniform(0.3, 2, len(a) if a.uniform else (samples, len(a)))
        for a in function.arguments
    }
    W = Kernel(function)(data)
    data["y"] = W @ rng.standard_normal(base.rank) + 0.1 * rng.standard_normal(
        W.shape[:2]
    )
    found = Observer(function)(data, block=200)
    whole = found.combined()
    A, b = W.reshape(-1, base.rank), data["y"].ravel()
    expected = np.linalg.lstsq(A, b, rcond=None)[0]
    assert whole.rank == base.rank
    np.testing.assert_allclose(
        whole.solve(), expected, atol=1e-11 * np.abs(expected).max()
    )
    assert whole.residual == pytest.approx(np.linalg.norm(A @ expected - b), rel=1e-11)
    np.testing.assert_allclose(whole.scales, np.linalg.norm(A, axis=0), rtol=1e-12)
    assert len(set(found.layout.sizes)) > 1  # not every output sees every parameter
