"""Real robot files of the example-robot-data package, and Pinocchio's view of them."""

from __future__ import annotations

import sysconfig
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from echelon.robot.joint import MotionKind
from echelon.robot.mechanism import Mechanism

Floats = npt.NDArray[np.float64]
EMPTY = ("ur3",)
"""Files that contain no robot."""


@cache
def robot_files() -> dict[str, Path]:
    """All valid URDF files by stem (anymal occurs twice)."""
    root = (
        Path(sysconfig.get_path("purelib"))
        / "cmeel.prefix/share/example-robot-data/robots"
    )
    files: dict[str, Path] = {}
    for file in sorted(root.glob("*/*/*.urdf")):
        stem = file.stem if file.stem not in files else f"{file.stem}-2"
        if stem not in EMPTY:
            files[stem] = file
    return files


def robot_file(name: str) -> Path:
    return robot_files()[name]


@cache
def pinocchio_model(file: Path, floating: bool) -> Any:
    """Pinocchio's model of a file; it ignores mimic elements."""
    import pinocchio as pin

    if floating:
        return pin.buildModelFromUrdf(str(file), pin.JointModelFreeFlyer())
    return pin.buildModelFromUrdf(str(file))


@dataclass(frozen=True)
class PinocchioState:
    """A state in Pinocchio's coordinates, and the way its forces come back to ours."""

    q: Floats
    v: Floats
    a: Floats
    map: Floats
    """Velocities: v = map · qd in order and axes; forces: ours = mapᵀ · theirs."""

    def to_ours(self, torque: Floats) -> Floats:
        ours: Floats = self.map.T @ torque
        return ours


def pinocchio_state(
    mechanism: Mechanism, model: Any, q: Floats, qd: Floats, qdd: Floats
) -> PinocchioState:
    """Our state of a mechanism, whose joints have the names of Pinocchio's, in Pinocchio's coordinates."""
    ours = dict(zip(mechanism.positions, q, strict=True))
    column = {name: i for i, name in enumerate(mechanism.velocities)}
    full_q = np.zeros(model.nq)
    jacobian, bias = np.zeros((model.nv, len(qd))), np.zeros(model.nv)
    for body in mechanism.bodies:
        name = (
            "root_joint"
            if body.joint.name == "base" and body.joint.kind == "floating"
            else body.joint.name
        )
        if not body.joint.motions:
            continue
        joint = model.joints[model.getJointId(name)]
        at, row = joint.idx_q, joint.idx_v
        if body.joint.kind == "floating":
            _free(
                body.joint.motions,
                ours,
                column,
                qd,
                full_q[at : at + 7],
                jacobian[row : row + 6],
                bias[row : row + 6],
            )
            continue
        (motion,) = body.joint.motions
        angle = ours[motion.name]
        full_q[at : at + joint.nq] = (
            (np.cos(angle), np.sin(angle)) if joint.nq == 2 else angle
        )
        jacobian[row, column[motion.name]] = 1
    return PinocchioState(full_q, jacobian @ qd, jacobian @ qdd + bias, jacobian)


def _free(motions, ours, column, qd, q, jacobian, bias) -> None:  # type: ignore[no-untyped-def]
    """Free flyer: linear velocity in body axes, quaternion with the scalar last."""
    slides, turn = motions[:3], motions[3]
    assert turn.kind is MotionKind.BALL
    w, x, y, z = (ours[n] for n in turn.positions)
    q[:] = (*(ours[m.name] for m in slides), x, y, z, w)
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    linear, angular = (
        [column[m.name] for m in slides],
        [column[n] for n in turn.velocities],
    )
    jacobian[:3, linear] = rotation.T
    jacobian[3:, angular] = np.eye(3)
    # the derivative of Rᵀ v in body axes: Rᵀ v̇ − ω × Rᵀ v
    bias[:3] = -np.cross(qd[angular], rotation.T @ qd[linear])
