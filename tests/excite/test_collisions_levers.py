"""MotionBounds: how fast points of a shape can move."""

from __future__ import annotations

import numpy as np
import pytest

from echelon.excite.problem.clearance import clearance_of
from echelon.excite.verify.clearance_bounds import MotionBounds
from support.shaped_robots import motion, planar, random_arm, spheres


@pytest.mark.parametrize("seed", range(4))
def test_levers_bound_speeds(seed: int) -> None:
    """Points of shapes never move faster than the levers say."""
    mechanism, shapes = random_arm(seed)
    rng = np.random.default_rng(seed)
    trajectory = motion(mechanism, seed, 0.35)
    levers = MotionBounds(mechanism, trajectory.basis.bounds(trajectory.coefficients, 0))
    slopes = clearance_of(mechanism, shapes, 0.0).kinematics.slopes(
        trajectory(rng.uniform(0, trajectory.duration, 400))
    )
    ratios = []
    stone = shapes[-1]  # against the world, velocities are absolute
    for shape in shapes[:5]:
        centre = shape.placement[:3, 3]
        moved = slopes[:, shape.body]
        speeds = np.linalg.norm(np.einsum("ncik,i->nck", moved[:, :, :3], centre) + moved[:, :, 3], axis=1)
        bound = levers.between(stone, shape)
        assert np.all(speeds <= bound + 1e-12)
        ratios.append(speeds.max(axis=0)[bound > 0] / bound[bound > 0])
    assert 0.3 < np.concatenate(ratios).max() <= 1 + 1e-12


def test_levers_of_a_branch_do_not_count_what_carries_both() -> None:
    mechanism = planar(4)
    shapes = spheres(mechanism)
    levers = MotionBounds(mechanism, np.full(4, np.pi))
    np.testing.assert_allclose(levers.between(shapes[1], shapes[4]), [0, 2.1, 1.1, 0.1])
    np.testing.assert_allclose(levers.between(shapes[0], shapes[3]), [2.1, 1.1, 0.1, 0])
