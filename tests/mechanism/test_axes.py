"""Lines in space: turning one axis to another, and coordinates on the motors' side of a transmission."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import echelon as ec
from echelon.mechanism.axes import angle_about, shortest_turn, turn_about
from echelon.mechanism.motor_side import joint_side, transmission_matrix
from support.paths import EXAMPLES

RNG = np.random.default_rng(0)


@pytest.mark.parametrize("angle", [-3.0, -1.2, 0.0, 0.4, 2.9])
def test_turns_about_an_axis(angle: float) -> None:
    """Rotations are scipy's, and the angle of a turned vector is that of the turn, sign included."""
    axis, here = RNG.normal(size=(2, 3))
    axis /= np.linalg.norm(axis)
    turned = turn_about(axis, angle)
    np.testing.assert_allclose(turned, Rotation.from_rotvec(angle * axis).as_matrix(), atol=1e-14)
    assert angle_about(axis, here, turned @ here) == pytest.approx(angle, abs=1e-12)
    assert angle_about(axis, here, turned @ here + 0.3 * axis) == pytest.approx(angle, abs=1e-12)


def test_the_shortest_turn_takes_one_line_to_another() -> None:
    here, there = RNG.normal(size=(2, 3))
    here, there = here / np.linalg.norm(here), there / np.linalg.norm(there)
    turned = shortest_turn(here, there) @ here
    np.testing.assert_allclose(turned, there * np.sign(here @ there), atol=1e-14)


def test_positions_of_motors_become_positions_of_joints() -> None:
    """θ = T q, with motors that move two joints."""
    robot = ec.load(EXAMPLES / "tx40.yaml")
    names, matrix = transmission_matrix(robot)
    assert np.abs(matrix - matrix.T).max() > 1  # else T could not be told from its transpose
    q = RNG.normal(size=(5, len(robot.velocities)))
    columns = [robot.velocities.index(name) for name in names]
    motors = q.copy()
    motors[:, columns] = q[:, columns] @ matrix.T
    np.testing.assert_allclose(joint_side(robot, motors), q, atol=1e-12)
