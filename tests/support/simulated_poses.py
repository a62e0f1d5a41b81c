"""Poses of robots with planted errors of their geometry, by Pinocchio, which knows nothing of error models."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import reduce

import numpy as np
import pinocchio as pin

from echelon.robot import Mechanism, MotionKind, known_values, placement_matrix

Floats = np.ndarray


def pinocchio_model(mechanism: Mechanism) -> pin.Model:
    """The tree of a mechanism whose bodies each have one motion; what a joint moves is the frame of its motion."""
    known, after = known_values(mechanism), {-1: np.eye(4)}
    model = pin.Model()
    for index, body in enumerate(mechanism.bodies):
        (motion,) = body.joint.motions
        at = body.joint.steps.index(motion)
        before, after[index] = (
            reduce(np.matmul, [placement_matrix(s, known) for s in steps], np.eye(4))
            for steps in (body.joint.steps[:at], body.joint.steps[at + 1 :])
        )
        axis = motion.sign * np.eye(3)[motion.axis]
        slides = motion.kind is MotionKind.TRANSLATION
        kind = (
            pin.JointModelPrismaticUnaligned
            if slides
            else pin.JointModelRevoluteUnaligned
        )
        placed = after[body.parent] @ before
        model.addJoint(body.parent + 1, kind(axis), pin.SE3(placed), motion.name)
    return model


def twist(rng: np.random.Generator, shift: float, turn: float) -> Floats:
    """A random small motion: three shifts, then three turns."""
    return np.concatenate(
        [rng.normal(scale=shift, size=3), rng.normal(scale=turn, size=3)]
    )


def small_frame(errors: Sequence[float]) -> pin.SE3:
    """The frame of six errors: shifts, then turns about x, y and z one after another."""
    turned = pin.utils.rotate("x", errors[3]) @ pin.utils.rotate("y", errors[4])
    return pin.SE3(turned @ pin.utils.rotate("z", errors[5]), np.array(errors[:3]))


def body_frames(
    model: pin.Model, q: Floats, errors: Mapping[int, Sequence[float]]
) -> list[list[Floats]]:
    """Frames of all motions, with errors behind some of them, at positions of shape (N, n): 4 × 4 matrices."""
    found = []
    data = model.createData()
    for one in q:
        pin.forwardKinematics(model, data, one)
        frames = [pin.SE3.Identity()]
        for joint in range(1, model.njoints):
            local = data.liMi[joint] * small_frame(errors.get(joint - 1, np.zeros(6)))
            frames.append(frames[model.parents[joint]] * local)
        found.append([frame.homogeneous for frame in frames[1:]])
    return found


def moved_onto(
    off: Callable[[Floats], Floats], q: Floats, noise: Callable[[], Floats]
) -> Floats:
    """Positions near some others, shape (N, n), where a function is only noise; without those out of reach."""
    found, step = [], 1e-6
    for one in q:
        at, wanted = one, noise()
        for _ in range(20):
            gap = off(at) - wanted
            if np.abs(gap).max() < 1e-10:
                found.append(at)
                break
            moved = [off(at + by) - wanted for by in step * np.eye(len(at))]
            slopes = (np.array(moved) - gap).T / step
            at = at - np.clip(np.linalg.pinv(slopes) @ gap, -0.5, 0.5)
    return np.array(found).reshape(-1, q.shape[1])
