"""Frames of bodies in loops, and how far closures are open."""

from __future__ import annotations

import numpy as np

from echelon.algebra.exact.polynomial import float_generators
from echelon.robot.joint import GROUND, Placement
from echelon.robot.mechanism import Mechanism
from support.textbook_poses import Array, pose_of


def position(mechanism: Mechanism, q: dict[str, float]) -> dict[str, float]:
    """Positions of all coordinates; those not given are zero."""
    names = [name for motion in mechanism.motions for name in motion.positions]
    full = {name: q.get(name, 0.0) for name in names}
    for motion in mechanism.motions:
        if len(motion.positions) > 1:
            quaternion = np.array([full[name] for name in motion.positions])
            quaternion = (
                quaternion / np.linalg.norm(quaternion)
                if quaternion.any()
                else np.eye(4)[0]
            )
            full |= dict(zip(motion.positions, quaternion, strict=True))
    return full


def matrix(mechanism: Mechanism, placement: Placement) -> Array:
    known = {
        name: s.value for name, s in mechanism.symbols.items() if s.value is not None
    }
    pose = np.eye(4)
    entries = [
        e.evaluate(float_generators(e.generators(), known), float)
        for e in placement.entries()
    ]
    pose[:3, :3], pose[:3, 3] = np.reshape(entries[:9], (3, 3)), entries[9:]
    return pose


def world_pose(mechanism: Mechanism, body: int, q: dict[str, float]) -> Array:
    if body == GROUND:
        return np.eye(4)
    return world_pose(mechanism, mechanism.bodies[body].parent, q) @ pose_of(
        mechanism, body, q
    )


def frames(
    mechanism: Mechanism, number: int, q: dict[str, float]
) -> tuple[Array, Array]:
    """Both frames of a closure in the world."""
    closure, full = mechanism.closures[number], position(mechanism, q)
    return (
        world_pose(mechanism, closure.first, full)
        @ matrix(mechanism, closure.first_frame),
        world_pose(mechanism, closure.second, full)
        @ matrix(mechanism, closure.second_frame),
    )


def residual(mechanism: Mechanism, q: dict[str, float]) -> Array:
    values: list[float] = []
    for number, closure in enumerate(mechanism.closures):
        first, second = frames(mechanism, number, q)
        seen = np.linalg.inv(first) @ second
        values += [seen[k, 3] for k in closure.kind.positions]
        values += [seen[i, j] - value for i, j, value in closure.kind.directions]
    return np.array(values)
