"""Poses of a robot that can be drawn: where its bodies and joint axes are, and which way is up."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from echelon.arrays import Floats
from echelon.dynamics.kinematics import Kinematics
from echelon.errors import EchelonError
from echelon.mechanism.body import GROUND
from echelon.mechanism.joint import MotionKind
from echelon.mechanism.mechanism import Mechanism
from echelon.mechanism.placement import Placement
from echelon.mechanism.stated import placement_matrix, symbol_values
from echelon.regressor.loops.assembly import Assembly

_BEND = 0.5  # rad, between neighbouring joints of a robot whose zero pose is a line
_VIEWS = 12  # directions that are tried
_FLAT = 0.15  # ratio of a pose's second extent to its first, below which it is called a line


@dataclass(frozen=True)
class Pose:
    """Frames and joint axes of all bodies, in the base frame."""

    origins: Floats  # shape (bodies, 3): origins of the bodies' frames, m
    # shape (bodies, 3, 3): what a joint's position turns its body by, against the pose in which the joint is at zero
    turns: Floats
    axes: Floats  # shape (bodies, 3): direction of the joint's first freedom; zero for fixed joints
    up: Floats  # shape (3,): against gravity; z without gravity
    bent: bool  # whether joints were turned from zero, because the zero pose is a line


def drawable_pose(mechanism: Mechanism) -> Pose | None:
    """A pose in which a robot can be recognised: assembled where there are loops, else zero, bent if that is a line.

    None where lengths have no values or loops do not close.
    """
    try:
        if mechanism.closures:
            return pose_at(mechanism, Assembly(mechanism).pose)
        straight = pose_at(mechanism, positions_of(mechanism))
        if len(mechanism.bodies) < 2:
            return straight if mechanism.bodies else None
        extent = np.linalg.svd(straight.origins - straight.origins.mean(axis=0), compute_uv=False)
        if extent[1] < _FLAT * extent[0]:
            return pose_at(mechanism, positions_of(mechanism, _BEND), bent=True)
        return straight
    except EchelonError:
        return None


def positions_of(mechanism: Mechanism, bend: float = 0.0) -> Floats:
    """All positions, shape (positions,): rotations alternate between bend and −bend; balls are upright; others zero."""
    found: dict[str, float] = {}
    sign = 1.0
    for motion in mechanism.motions:
        if motion.kind is MotionKind.BALL:
            found |= dict(zip(motion.positions, (1.0, 0.0, 0.0, 0.0), strict=True))
        elif motion.kind is MotionKind.ROTATION:
            found[motion.name] = sign * bend
            sign = -sign
    return np.array([found.get(name, 0.0) for name in mechanism.positions])


def pose_at(mechanism: Mechanism, q: Floats, *, bent: bool = False) -> Pose:
    """Frames of all bodies at positions of shape (positions,); an InputError if a geometry symbol has no value."""
    symbols = symbol_values(mechanism, sorted({s for body in mechanism.bodies for s in body.joint.symbols()}))
    here, zero = Kinematics(mechanism).frames(np.array([q, positions_of(mechanism)]))
    axes = joint_axes(mechanism, here[None, :, :, :3], symbols)[0]
    turns = _turns(mechanism, here[:, :, :3], zero[:, :, :3])
    return Pose(here[:, :, 3], turns, axes, upward(mechanism), bent)


def upward(mechanism: Mechanism) -> Floats:
    """Unit vector against gravity; z without gravity."""
    entries = mechanism.gravity or ()
    symbols = symbol_values(mechanism, sorted({s for entry in entries for s in entry.symbols()}))
    gravity = np.array([e.at(symbols) for e in entries])
    size = float(np.linalg.norm(gravity))
    return -gravity / size if size > 0 else np.array([0.0, 0.0, 1.0])


def joint_axes(mechanism: Mechanism, rotations: Floats, symbols: Mapping[str, float]) -> Floats:
    """Direction of each joint's first freedom, shape (N, bodies, 3), for rotations of all bodies, (N, bodies, 3, 3).

    It is fixed in the parent's frame, behind constant placements; zero for fixed joints.
    """
    axes = np.zeros(rotations.shape[:-1])
    for index, body in enumerate(mechanism.bodies):
        if body.joint.is_fixed:
            continue
        first, motion = body.joint.steps[0], body.joint.motions[0]
        frame = placement_matrix(first, symbols)[:3, :3] if isinstance(first, Placement) else np.eye(3)
        own = frame[:, 0] if motion.kind is MotionKind.BALL else motion.sign * frame[:, motion.axis]
        axes[:, index] = own if body.parent == GROUND else rotations[:, body.parent] @ own
    return axes


def _turns(mechanism: Mechanism, here: Floats, zero: Floats) -> Floats:
    """What positions turn each body by against its parent, in the base frame, from all bodies' rotations."""
    turns = np.empty_like(here)
    for index, body in enumerate(mechanism.bodies):
        carrier = np.stack([np.eye(3), np.eye(3)]) if body.parent == GROUND else np.stack([here, zero])[:, body.parent]
        turns[index] = here[index] @ zero[index].T @ carrier[1] @ carrier[0].T
    return turns


def sides(up: Floats) -> tuple[Floats, Floats]:
    """Two unit vectors perpendicular to a third and to each other; the script of the preview derives the same ones."""
    side = np.cross(up, [1.0, 0.0, 0.0] if abs(up[0]) < 0.9 else [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side)
    return side, np.cross(side, up)


def projection(up: Floats, turn: float, elevation: float) -> Floats:
    """Right and up on paper, as rows, seen from a direction around the vertical that looks down; angles in rad."""
    side, front = sides(up)
    right = np.cos(turn) * side + np.sin(turn) * front
    return np.stack([right, np.cos(elevation) * up + np.sin(elevation) * np.cross(up, right)])


def widest_view(points: Floats, up: Floats, elevation: float) -> float:
    """Direction of view around the vertical, rad, from which points of about unit size fill the largest area."""

    def area(turn: float) -> float:
        flat = points @ projection(up, turn, elevation).T
        values = np.linalg.svd(flat - flat.mean(axis=0), compute_uv=False)
        return round(float(values[0] * values[1]), 6)  # rounded, so that the view is the same everywhere

    return max((float(np.pi * (k + 0.25) / _VIEWS) for k in range(_VIEWS)), key=area)
