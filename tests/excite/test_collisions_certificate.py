"""Certified clearances of whole motions: no sample is below them, short dips and rests included."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import echelon as ec
from echelon.errors import InputError
from echelon.excite.problem.clearance import Engine, clearance_of
from echelon.excite.problem.robot_shapes import entry_shapes, mesh_shape
from echelon.excite.problem.trajectory import Fourier, Trajectory
from echelon.excite.verify.clearance_bounds import least_clearances
from support.shaped_robots import Floats, motion, planar, random_arm, spheres


@pytest.mark.parametrize("seed", range(8))
def test_no_sample_is_below_the_bound(seed: int) -> None:
    mechanism, shapes = random_arm(seed)
    clearance = clearance_of(mechanism, shapes, 0.03)
    trajectory = motion(mechanism, seed, 0.35)
    found = least_clearances(clearance, trajectory, 2e-3)
    t = np.linspace(0, trajectory.duration, 8001)
    q = trajectory(t)
    least = clearance.values(q, q, q).min(axis=0)
    assert np.all(found.bounds <= least + 1e-9)
    assert np.all(found.bounds <= found.found)
    # they are as sharp as was promised
    assert np.all(found.bounds >= least - np.maximum(2e-3, 0.26 * np.abs(least - 0.03)) - 1e-3)
    assert np.all(np.abs(found.found - least) < np.maximum(2e-3, 0.26 * np.abs(least - 0.03)) + 1e-3)
    for k in np.flatnonzero(found.found < clearance.reach):
        state = trajectory(found.times[k])
        assert clearance.values(state, state, state)[0, k] == pytest.approx(found.found[k], abs=1e-6)


def test_a_short_dip_is_found() -> None:
    """A tip that rushes past a thin post between all samples of a coarse grid."""
    mechanism = planar(2)
    post = {"body": "world", "capsule": 0.01, "from": [2.1, 0, -1], "to": [2.1, 0, 1]}
    shapes = entry_shapes(mechanism, [post, {"body": "link2", "sphere": 0.05, "at": [1, 0, 0]}])
    clearance = clearance_of(mechanism, shapes, 0.0)
    coefficients = np.zeros((3, 2))
    phase = np.pi / 20  # q1 = 2 sin(2πt + phase) is zero between two of 20 samples
    coefficients[1:, 0] = 2 * np.cos(phase), 2 * np.sin(phase)
    trajectory = Trajectory(mechanism.positions, ("rad", "rad"), Fourier(1.0, 1), coefficients)
    found = least_clearances(clearance, trajectory, 1e-4)
    # link 1 is the first moving body, so only link 2 and the post are checked
    assert found.found[0] == pytest.approx(0.04, abs=2e-3)
    assert 0.03 - 1e-3 < found.bounds[0] <= 0.04 + 1e-12
    coarse = trajectory(np.linspace(0, 1, 21))
    assert clearance.values(coarse, coarse, coarse).min() > 0.1
    assert np.sin(2 * np.pi * found.times[0] + phase) == pytest.approx(0, abs=0.02)


def test_motions_that_rest_at_every_first_sample_are_seen_through() -> None:
    """The arm swings once per interval and is at rest, far from the post, in the middle of each."""
    mechanism = planar(2)
    post = {"body": "world", "capsule": 0.01, "from": [2.1, 0, -1], "to": [2.1, 0, 1]}
    shapes = entry_shapes(mechanism, [post, {"body": "link2", "sphere": 0.05, "at": [1, 0, 0]}])
    coefficients = np.zeros((129, 2))
    coefficients[0, 0], coefficients[128, 0] = 0.3, -0.3  # q1 = 0.3 (1 − cos(128πt))
    trajectory = Trajectory(mechanism.positions, ("rad", "rad"), Fourier(1.0, 64), coefficients)
    found = least_clearances(clearance_of(mechanism, shapes, 0.0), trajectory, 1e-3)
    assert 0.03 - 1e-3 < found.bounds[0] <= 0.04 + 1e-12


def test_faulty_distances_do_not_weaken_a_certificate(monkeypatch: pytest.MonkeyPatch) -> None:
    mechanism, shapes = random_arm(1)
    clearance = clearance_of(mechanism, shapes, 0.03)
    trajectory = motion(mechanism, 1, 0.35)
    sound = least_clearances(clearance, trajectory, 5e-3)
    true = Engine.measure

    def faulty(engine: Engine, places: Floats, asked: npt.NDArray[np.intp], reach: float) -> Any:
        found = true(engine, places, asked, reach)
        found.distances[:] += 0.1
        found.points[:] += np.random.default_rng(0).normal(size=found.points.shape) * 0.02
        return found

    monkeypatch.setattr(Engine, "measure", faulty)
    assert np.all(least_clearances(clearance, trajectory, 5e-3).bounds <= sound.found + 1e-12)


def test_arguments_are_checked() -> None:
    mechanism = planar()
    shapes = spheres(mechanism)
    with pytest.raises(InputError, match="reach must be larger than the clearance"):
        clearance_of(mechanism, shapes, 0.1, reach=0.05)
    with pytest.raises(InputError, match="0 or more"):
        clearance_of(mechanism, shapes, -0.1)
    with pytest.raises(InputError, match="rotates freely"):
        clearance_of(ec.load("examples/floating_tree.yaml"), (), 0.1)
    with pytest.raises(InputError, match="must move the positions q1, q2, q3"):
        least_clearances(clearance_of(mechanism, shapes, 0.1), motion(planar(2), 0))
    with pytest.raises(InputError, match="lie in a plane"):
        mesh_shape("flat", -1, np.eye(4), np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]))
