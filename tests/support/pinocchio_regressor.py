"""Pinocchio's joint torque regressor in our order of parameters."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from echelon.robot.mechanism import Mechanism
from echelon.shared.conventions import PER_BODY
from support.robot_files import pinocchio_state

Floats = npt.NDArray[np.float64]

ORDER = [4, 5, 7, 6, 8, 9, 1, 2, 3, 0]
"""Places of XX XY XZ YY YZ ZZ MX MY MZ M in m mx my mz Ixx Ixy Iyy Ixz Iyz Izz."""


def pinocchio_regressor(
    mechanism: Mechanism, model: Any, q: Floats, qd: Floats, qdd: Floats
) -> Floats:
    """X at states of a mechanism whose joints have the names of Pinocchio's, shape (samples, outputs, parameters)."""
    import pinocchio as pin

    data = model.createData()
    columns = [
        PER_BODY * (model.getJointId(name) - 1) + place
        for name in _joints(mechanism)
        for place in ORDER
    ]
    found = np.zeros((len(q), len(mechanism.velocities), len(columns)))
    for k in range(len(q)):
        state = pinocchio_state(mechanism, model, q[k], qd[k], qdd[k])
        theirs = pin.computeJointTorqueRegressor(model, data, state.q, state.v, state.a)
        found[k] = state.to_ours(theirs[:, columns])
    return found


def _joints(mechanism: Mechanism) -> list[str]:
    """Pinocchio's names of the joints that move bodies, in our order."""
    joints = (body.joint for body in mechanism.bodies if body.carried)
    return [
        "root_joint" if j.name == "base" and j.kind == "floating" else j.name
        for j in joints
    ]
