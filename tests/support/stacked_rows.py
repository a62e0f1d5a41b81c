"""Observation matrices of experiments by Pinocchio: turned bases, locked joints, contacts with unknown forces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from echelon.base.model import BaseModel
from support.pinocchio_regressor import ORDER

Floats = npt.NDArray[np.float64]
GAP = 1e6
"""Ratio of neighbouring singular values that counts as a rank."""
SAMPLES = 60


def random_urdf(rng: np.random.Generator, joints: int, *, tree: bool = True) -> str:
    """A robot whose joints have oblique axes and offsets; every link has some inertia."""
    inertial = (
        '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
        "</inertial>"
    )
    parts = [f'<link name="l0">{inertial}</link>']
    for k in range(1, joints + 1):
        parent = int(rng.integers(0, k)) if tree else k - 1
        xyz, rpy, axis = (
            " ".join(f"{x:.3f}" for x in rng.uniform(-1, 1, 3)) for _ in "123"
        )
        kind = "prismatic" if rng.random() < 0.25 else "revolute"
        parts.append(
            f'<link name="l{k}">{inertial}</link><joint name="j{k}" type="{kind}"><parent link="l{parent}"/>'
            f'<child link="l{k}"/><origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>'
            '<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
        )
    return f'<robot name="random">{"".join(parts)}</robot>'


@dataclass(frozen=True)
class Touch:
    """A contact of a Pinocchio model."""

    joint: str
    place: Floats  # in the joint's frame
    kind: str
    measured: tuple[int, ...] = ()  # components of the force that are known
    radius: float = 0.0  # of what rolls on a level ground


class Observed:
    """A Pinocchio model and the rows that experiments with it give, columns ordered as ours by names of joints."""

    def __init__(self, model: Any, joints: Sequence[str]) -> None:
        self.model, self.data = model, model.createData()
        self.columns = [
            10 * (model.getJointId(name) - 1) + place
            for name in joints
            for place in ORDER
        ]

    def arm(
        self,
        rng: np.random.Generator,
        gravity: Sequence[float] = (0, 0, -9.81),
        locked: dict[str, float] | None = None,
        samples: int = SAMPLES,
    ) -> Floats:
        """Rows of the joints that move."""
        import pinocchio as pin

        self.model.gravity.linear = np.array(gravity, dtype=float)
        held = {
            self.model.joints[self.model.getJointId(n)].idx_q: at
            for n, at in (locked or {}).items()
        }
        free = [k for k in range(self.model.nv) if k not in held]
        rows = []
        for _ in range(samples):
            q, v, a = rng.uniform(-2, 2, (3, self.model.nv))
            for k, at in held.items():
                q[k], v[k], a[k] = at, 0, 0
            X = pin.computeJointTorqueRegressor(self.model, self.data, q, v, a)
            rows.append(X[free][:, self.columns])
        return np.vstack(rows)

    def standing(
        self, rng: np.random.Generator, touches: Sequence[Touch], samples: int = SAMPLES
    ) -> Floats:
        """Rows of a floating robot that unknown forces at contacts do not enter."""
        import pinocchio as pin

        rows = []
        for _ in range(samples):
            q = pin.integrate(
                self.model, pin.neutral(self.model), rng.normal(size=self.model.nv)
            )
            slips = [self._slip(touch, q) for touch in touches]
            J = np.vstack([slip for slip, _ in slips])
            free = null_space(J)
            v = free @ rng.normal(size=free.shape[1])
            drift = np.concatenate([bias(v) for _, bias in slips])
            a = -np.linalg.pinv(J) @ drift + free @ rng.normal(size=free.shape[1])
            hidden = np.vstack(
                [
                    np.delete(slip, touch.measured, axis=0)
                    for (slip, _), touch in zip(slips, touches, strict=True)
                ]
            )
            X = pin.computeJointTorqueRegressor(self.model, self.data, q, v, a)
            rows.append(null_space(hidden).T @ X[:, self.columns])
        return np.vstack(rows)

    def _slip(self, touch: Touch, q: Floats) -> tuple[Floats, Any]:
        """Jacobian of what a contact holds, and the rate of it at zero acceleration as a function of velocities."""
        import pinocchio as pin

        model, data = self.model, self.data
        joint = model.getJointId(touch.joint)
        frame = model.addFrame(
            pin.Frame(
                f"touch{model.nframes}",
                joint,
                0,
                pin.SE3(np.eye(3), np.array(touch.place)),
                pin.FrameType.OP_FRAME,
            )
        )
        self.data = data = model.createData()
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        if touch.kind == "rolling":
            up = touch.radius * pin.skew(np.array([0.0, 0.0, 1.0]))

            def rolled(motion: Any) -> Floats:
                return motion.linear + up @ motion.angular

            level = pin.LOCAL_WORLD_ALIGNED
            J = pin.getFrameJacobian(model, data, frame, level)

            def drift(v: Floats) -> Floats:
                pin.forwardKinematics(model, self.data, q, v, np.zeros(model.nv))
                at = pin.getFrameClassicalAcceleration(model, self.data, frame, level)
                return rolled(at)

            return J[:3] + up @ J[3:], drift
        J = pin.getFrameJacobian(model, data, frame, pin.LOCAL)
        held = {
            "point": [0, 1, 2],
            "line": [0, 1, 2, 4, 5],
            "surface": [0, 1, 2, 3, 4, 5],
        }[touch.kind]

        def bias(v: Floats) -> Floats:
            pin.forwardKinematics(model, self.data, q, v, np.zeros(model.nv))
            at = pin.getFrameClassicalAcceleration(model, self.data, frame, pin.LOCAL)
            return np.concatenate([at.linear, at.angular])[held]

        return J[held], bias


def null_space(matrix: Floats) -> Floats:
    """Orthonormal directions that a matrix does not see."""
    if not len(matrix):
        return np.eye(matrix.shape[1])
    _, sizes, ways = np.linalg.svd(matrix)
    rank = int((sizes > 1e-9 * sizes[0]).sum())
    return ways[rank:].T


def agrees(base: BaseModel, stacked: Floats) -> bool:
    """Whether B has the row space of stacked rows, of which a gap shows the rank."""
    sizes = np.linalg.svd(stacked, compute_uv=False)
    rank = base.rank
    clear = rank == len(sizes) or sizes[rank - 1] > GAP * sizes[rank]
    unseen = null_space(base.B_float())
    return bool(clear and np.abs(stacked @ unseen).max(initial=0) < sizes[0] / GAP)
