"""Slopes of clearances against differences."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import echelon as ec
from echelon.excite.problem.clearance import Clearance, clearance_of
from echelon.excite.problem.robot_shapes import read_geometry
from echelon.formats.robot_file import open_robot
from support.shaped_robots import ARM, Floats, planar, spheres


def differences(clearance: Clearance, q: Floats, step: float) -> Floats:
    """Of fourth order, shape (N, m, n)."""
    columns = []
    for k in range(q.shape[1]):
        e = step * np.eye(q.shape[1])[k]
        parts = [clearance.values(q + m * e, q, q) * w for m, w in ((-2, 1), (-1, -8), (1, 8), (2, -1))]
        columns.append(sum(parts) / (12 * step))
    return np.stack(columns, axis=2)


def test_slopes(tmp_path: Path) -> None:
    file = tmp_path / "arm.xml"
    file.write_text(ARM)
    mechanism = ec.load(file)
    clearance = clearance_of(mechanism, read_geometry(mechanism, open_robot(file)).shapes, 0.0, reach=0.4)
    q = np.random.default_rng(0).uniform(-2, 2, (150, 4)) * [1, 1, 0.2, 1]
    values, found = clearance.values(q, q, q), clearance.slopes(q, q, q)[0]
    assert found is not None
    expected = differences(clearance, q, 1e-4)
    wrong = np.abs(found - expected).max(axis=2) > 2e-4
    near, deep = (values < 0.3995) & (values > 0), values < 0
    assert near.sum() > 100
    assert deep.sum() > 20
    # at few states the nearest feature changes within the step
    assert wrong[near].mean() < 0.03
    assert wrong[deep].mean() < 0.1
    assert np.all(found[values >= 0.4] == 0)


def test_slopes_of_spheres_are_exact() -> None:
    mechanism = planar(4)
    clearance = clearance_of(mechanism, spheres(mechanism, 0.3), 0.0, reach=10.0)
    q = np.random.default_rng(1).uniform(-3, 3, (50, 4))
    found = clearance.slopes(q, q, q)[0]
    assert found is not None
    assert (clearance.values(q, q, q) < 0).any()
    np.testing.assert_allclose(found, differences(clearance, q, 1e-3), atol=1e-8)
