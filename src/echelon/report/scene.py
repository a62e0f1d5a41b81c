"""The moving robot: where its bodies are in every picture of an animation, ready to be projected by a script.

A body goes from its frame to those of the bodies that it carries.  A last body, whose length nobody states, goes on as
its parent came when all joints are at zero, or as it slides, and turns with its frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.dynamics.kinematics import Kinematics
from echelon.errors import EchelonError, one_line
from echelon.excite.excite import ExcitingTrajectory
from echelon.mechanism.joint import GROUND, Body, MotionKind
from echelon.mechanism.mechanism import Mechanism
from echelon.mechanism.stated import known_values
from echelon.regressor.loops.assembly import Assembly
from echelon.report.drawing import Pose, joint_axes, pose_at, positions_of, widest_view
from echelon.report.page import Context, packed

_RATE = 30.0
"""Pictures per second; fewer where a page would become too large.  Between them a script interpolates."""
_BYTES = 500_000  # of all pictures together, about
_NUMBERS, _PER_NUMBER = 10, 4 * 4 / 3  # of a body in a picture, and bytes of each in base 64
_STUB = 0.12  # length of a last body, of the robot's extent
_STILL = 1e-9  # of the robot's extent, and rad, below which a body counts as not moving
ELEVATION = 0.4  # how far the view looks down, rad


@dataclass(frozen=True)
class Scene:
    """A robot in motion, in the base frame."""

    mechanism: Mechanism
    time: Floats  # shape (N,), s
    q: Floats  # shape (N, n): of the trajectory's coordinates
    qd: Floats  # shape (N, n): of the trajectory's coordinates
    origins: Floats  # shape (N, bodies, 3): of the bodies' frames, m
    axes: Floats  # shape (N, bodies, 3): direction of each joint's first freedom; zero for joints that do not move
    tips: Floats  # shape (N, last bodies, 3): where drawings of the last bodies end, m
    last: tuple[int, ...]  # the last bodies
    still: npt.NDArray[np.bool_]  # shape (bodies,): bodies that do not move
    up: Floats  # shape (3,): against gravity; z without gravity
    extent: float  # size of what the robot's bodies sweep, m


def scene(found: ExcitingTrajectory) -> Scene:
    """Where everything is, picture by picture; an InputError if a length has no value."""
    mechanism, trajectory = found.base.mechanism, found.trajectory
    zero = pose_at(mechanism, positions_of(mechanism))
    kinematics = Kinematics(mechanism)
    time = _times(trajectory.duration, len(mechanism.bodies))
    frames = kinematics.frames(_positions(found, time))
    rotations, origins = frames[..., :3], frames[..., 3]
    cloud = np.vstack([origins.reshape(-1, 3), np.zeros((1, 3))])
    extent = float(np.linalg.norm(np.ptp(cloud, axis=0))) or 1.0
    carriers = {body.parent for body in mechanism.bodies}
    last = tuple(i for i in range(len(mechanism.bodies)) if i not in carriers)
    at_zero = kinematics.frames(positions_of(mechanism)[None])[0, :, :, :3]
    ends = [_STUB * extent * _ahead(mechanism.bodies[i], i, zero, at_zero, extent) for i in last]
    tips = np.stack([origins[:, i] + rotations[:, i] @ end for i, end in zip(last, ends, strict=True)], axis=1)
    moved = np.ptp(origins, axis=0).max(axis=1) / extent + np.ptp(rotations, axis=0).max(axis=(1, 2))
    axes = joint_axes(mechanism, rotations, known_values(mechanism))
    q, qd = trajectory(time), trajectory(time, 1)
    return Scene(mechanism, time, q, qd, origins, axes, tips, last, moved < _STILL, zero.up, extent)


def _positions(found: ExcitingTrajectory, time: Floats) -> Floats:
    """Positions of all coordinates, shape (pictures, positions); with loops, those that the others follow from."""
    mechanism, trajectory = found.base.mechanism, found.trajectory
    if mechanism.closures:
        return Assembly(mechanism).from_independent(trajectory(time))
    columns = [trajectory.coordinates.index(name) for name in mechanism.positions]
    return trajectory(time)[:, columns]


def robot(found: ExcitingTrajectory) -> tuple[Context, dict[str, Any] | None]:
    """What the section with the picture shows, and all pictures, JSON-able; None where a length has no value."""
    try:
        view = scene(found)
    except EchelonError as error:
        return {"problem": str(error)}, None
    return _context(found, view), _payload(found, view)


def _context(found: ExcitingTrajectory, view: Scene) -> Context:
    heights = view.origins @ view.up
    lowest = int(heights.min(axis=0).argmin())
    return {
        "problem": "",
        "below": max(-float(heights.min()), 0.0) if heights.min() < -1e-6 * view.extent else 0.0,
        "lowest": view.mechanism.bodies[lowest].name,
        "still": [body.name for body, still in zip(view.mechanism.bodies, view.still, strict=True) if still],
        "floats": not view.mechanism.gravity,
        "coordinates": list(zip(found.trajectory.coordinates, found.trajectory.units, strict=True)),
    }


def _payload(found: ExcitingTrajectory, view: Scene) -> dict[str, Any]:
    bodies = [
        {
            "name": one_line(body.name),
            "parent": body.parent,
            "joint": _kind(body),
            "still": bool(still),
            "last": view.last.index(i) if i in view.last else None,
        }
        for i, (body, still) in enumerate(zip(view.mechanism.bodies, view.still, strict=True))
    ]
    points = np.vstack([view.origins.reshape(-1, 3), view.tips.reshape(-1, 3), np.zeros((1, 3))])
    arrays = {name: packed(getattr(view, name)) for name in ("origins", "axes", "tips", "q", "qd")}
    return {
        "bodies": bodies,
        "pictures": len(view.time),
        "duration": float(view.time[-1]),
        "coordinates": [one_line(name) for name in found.trajectory.coordinates],
        "units": [one_line(unit) for unit in found.trajectory.units],
        "up": view.up.tolist(),
        "turn": widest_view(points / view.extent, view.up, ELEVATION),
        "elevation": ELEVATION,
        **arrays,
    }


def _times(duration: float, bodies: int) -> Floats:
    """Times of the pictures."""
    most = int(_BYTES / (_NUMBERS * _PER_NUMBER * max(bodies, 1)))
    return np.linspace(0.0, duration, min(int(np.ceil(_RATE * duration)), most) + 1)


def _ahead(body: Body, index: int, zero: Pose, turns: Floats, extent: float) -> Floats:
    """Direction of a last body, in its own frame."""
    before = np.zeros(3) if body.parent == GROUND else zero.origins[body.parent]
    direction = zero.origins[index] - before
    if _kind(body) in ("slide", "screw") or np.linalg.norm(direction) < 1e-6 * extent:
        direction = zero.axes[index] if np.linalg.norm(zero.axes[index]) else zero.up
    found: Floats = turns[index].T @ direction / np.linalg.norm(direction)
    return found


def _kind(body: Body) -> str:
    """How a joint is drawn."""
    kinds = [motion.kind for motion in body.joint.motions]
    if not kinds:
        return "fixed"
    return {MotionKind.TRANSLATION: "slide", MotionKind.SCREW: "screw"}.get(kinds[0], "turn")
