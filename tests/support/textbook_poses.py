"""Rigid poses in floats, from textbook formulas: what descriptions must agree with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from echelon.algebra.exact.polynomial import Polynomial, float_generators
from echelon.robot.joint import Motion, MotionKind, Placement
from echelon.robot.mechanism import Mechanism

Array = npt.NDArray[np.float64]
X, Y, Z = (1, 0, 0), (0, 1, 0), (0, 0, 1)


def turned(axis: Sequence[float], angle: float) -> Array:
    """Rodrigues' formula as a homogeneous matrix."""
    x, y, z = np.array(axis, dtype=float) / np.linalg.norm(axis)
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    pose = np.eye(4)
    pose[:3, :3] += np.sin(angle) * k + (1 - np.cos(angle)) * k @ k
    return pose


def moved(*xyz: float) -> Array:
    pose = np.eye(4)
    pose[:3, 3] = xyz
    return pose


def along(axis: Sequence[float], distance: float) -> Array:
    return moved(*(distance * np.array(axis) / np.linalg.norm(axis)))


def quaternion_turn(w: float, x: float, y: float, z: float) -> Array:
    return turned(
        [x, y, z] if x or y or z else X, 2 * np.arctan2(np.linalg.norm([x, y, z]), w)
    )


def pose_of(mechanism: Mechanism, body: int, q: Mapping[str, float]) -> Array:
    """Homogeneous matrix of a body's frame in its parent's, by the steps of its joint."""
    known = {
        name: s.value for name, s in mechanism.symbols.items() if s.value is not None
    }

    def value(entry: Polynomial) -> float:
        return entry.evaluate(float_generators(entry.generators(), known), float)

    pose = np.eye(4)
    for step in mechanism.bodies[body].joint.steps:
        if isinstance(step, Placement):
            here = np.eye(4)
            here[:3, :3] = [[value(entry) for entry in row] for row in step.rotation]
            here[:3, 3] = [value(entry) for entry in step.translation]
            pose = pose @ here
        else:
            pose = pose @ motion_pose(step, q, value(step.pitch))
    return pose


def motion_pose(motion: Motion, q: Mapping[str, float], pitch: float) -> Array:
    if motion.kind is MotionKind.BALL:
        return quaternion_turn(*(q[name] for name in motion.positions))
    axis = motion.sign * np.eye(3)[motion.axis]
    position = q[motion.name]
    if motion.kind is MotionKind.TRANSLATION:
        return along(axis, position)
    return turned(axis, position) @ (
        along(axis, pitch * position) if pitch else np.eye(4)
    )
