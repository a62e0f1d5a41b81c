"""Coordinates on the motors' side of a transmission."""

from __future__ import annotations

import numpy as np

import echelon as ec
from echelon.robot.motor_side import joint_side, transmission_matrix
from support.paths import EXAMPLES

RNG = np.random.default_rng(0)


def test_positions_of_motors_become_positions_of_joints() -> None:
    """θ = T q, with motors that move two joints."""
    robot = ec.load(EXAMPLES / "tx40.yaml")
    names, matrix = transmission_matrix(robot)
    assert (
        np.abs(matrix - matrix.T).max() > 1
    )  # else T could not be told from its transpose
    q = RNG.normal(size=(5, len(robot.velocities)))
    columns = [robot.velocities.index(name) for name in names]
    motors = q.copy()
    motors[:, columns] = q[:, columns] @ matrix.T
    np.testing.assert_allclose(joint_side(robot, motors), q, atol=1e-12)
