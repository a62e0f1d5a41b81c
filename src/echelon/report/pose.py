"""Where the bodies of a mechanism are, in numbers: the recorded steps of its joints, put one behind the other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from echelon.arrays import Floats
from echelon.dynamics.kinematics import moved
from echelon.errors import EchelonError
from echelon.mechanism.joint import MotionKind
from echelon.mechanism.mechanism import GROUND, Mechanism
from echelon.mechanism.values import symbol_values
from echelon.program.schedule import FloatArithmetic, Schedule
from echelon.program.tape import Program, Scalar
from echelon.regressor.loops.assembly import Assembly
from echelon.regressor.spatial import Mat, Vec, apply
from echelon.regressor.steps import Recorder, Step

_BEND = 0.5  # rad, between neighbouring joints of a robot whose zero pose is a line
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
    """A pose in which a robot can be recognised: assembled where there are loops, else zero, bent if that is a line."""
    try:
        if mechanism.closures:
            positions = dict(zip(mechanism.positions, Assembly(mechanism).pose.tolist(), strict=True))
            return pose_at(mechanism, positions)
        straight = pose_at(mechanism, _positions(mechanism, 0.0))
        extent = np.linalg.svd(straight.origins - straight.origins.mean(axis=0), compute_uv=False)
        if len(mechanism.bodies) > 1 and extent[1] < _FLAT * extent[0]:
            return pose_at(mechanism, _positions(mechanism, _BEND), bent=True)
        return straight
    except EchelonError:
        return None


def _positions(mechanism: Mechanism, bend: float) -> dict[str, float]:
    """Positions of all coordinates: rotations alternate between bend and −bend; balls are upright."""
    found: dict[str, float] = {}
    sign = 1.0
    for motion in mechanism.motions:
        if motion.kind is MotionKind.BALL:
            found |= dict(zip(motion.positions, (1.0, 0.0, 0.0, 0.0), strict=True))
        elif motion.kind is MotionKind.ROTATION:
            found[motion.name] = sign * bend
            sign = -sign
        else:
            found[motion.name] = 0.0
    return found


def pose_at(mechanism: Mechanism, positions: Mapping[str, float], *, bent: bool = False) -> Pose:
    """Frames of all bodies at given positions."""
    program = Program()
    recorder = Recorder(mechanism, program)
    start = _start(program)
    frames: list[_Frame] = []
    for index, body in enumerate(mechanism.bodies):
        frame = start if body.parent == GROUND else replace(frames[body.parent], axis=start.axis)
        for step in recorder.steps(index):
            frame = frame.after(step)
        frames.append(frame)
    scalars = [s for frame in frames for s in (*frame.shift, *frame.axis, *(e for row in frame.rotation for e in row))]
    states = [dict(positions), _positions(mechanism, 0.0)]
    values = _evaluated(mechanism, program, [*scalars, *recorder.gravity()], states)
    (here, zero), gravity = values[:, :-3].reshape(2, -1, 15), values[0, -3:]
    size = float(np.linalg.norm(gravity))
    up = -gravity / size if size > 0 else np.array([0.0, 0.0, 1.0])
    turns = _turns(mechanism, here[:, 6:].reshape(-1, 3, 3), zero[:, 6:].reshape(-1, 3, 3))
    return Pose(here[:, :3], turns, here[:, 3:6], up, bent)


def _turns(mechanism: Mechanism, here: Floats, zero: Floats) -> Floats:
    """What positions turn each body by against its parent, in the base frame, from all bodies' rotations."""
    turns = np.empty_like(here)
    for index, body in enumerate(mechanism.bodies):
        carrier = np.stack([np.eye(3), np.eye(3)]) if body.parent == GROUND else np.stack([here, zero])[:, body.parent]
        turns[index] = here[index] @ zero[index].T @ carrier[1] @ carrier[0].T
    return turns


@dataclass(frozen=True)
class _Frame:
    """Rotation and origin in the base frame, and direction of the first freedom behind the parent."""

    rotation: Mat
    shift: Vec
    axis: Vec

    def after(self, step: Step) -> _Frame:
        rotation, shift = moved((self.rotation, self.shift), step)
        axis = self.axis
        if step.freedoms and all(entry.is_zero for entry in axis):
            first = step.freedoms[0]
            still = all(entry.is_zero for entry in first.angular)
            axis = apply(rotation, first.linear if still else first.angular)
        return _Frame(rotation, shift, axis)


def _start(program: Program) -> _Frame:
    zero, one = program.zero, program.one
    return _Frame(((one, zero, zero), (zero, one, zero), (zero, zero, one)), (zero, zero, zero), (zero, zero, zero))


def _evaluated(
    mechanism: Mechanism, program: Program, scalars: list[Scalar], states: Sequence[Mapping[str, float]]
) -> Floats:
    """Values of recorded scalars at positions, shape (states, scalars)."""
    schedule = Schedule(program, [scalar.node for scalar in scalars])
    leaves = {node: program.inputs[node] for node in schedule.leaves}
    known = symbol_values(mechanism, [leaf.name for leaf in leaves.values() if leaf.role == "symbol"])
    given = {}
    for node, leaf in leaves.items():
        fixed = known.get(leaf.name)
        given[node] = np.array([state[leaf.name[2:-1]] if fixed is None else fixed for state in states])
    values: Floats = schedule.run(FloatArithmetic(), given, len(states)).T
    return values
