"""Frames of a robot that do not move against each other: those that a force/torque sensor's axes may follow."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import pi

import numpy as np

from echelon.formats.bodies import BASE
from echelon.formats.literal import roll_pitch_yaw
from echelon.formats.met_frames import at_zero
from echelon.formats.robot_file import RobotFile
from echelon.formats.snapping import ReadingOptions
from echelon.robot import (
    GROUND,
    Cut,
    Mechanism,
    Output,
    known_values,
    placement_matrix,
)
from echelon.shared import Floats

_SAME = 1e-6  # differences of rotation matrices up to which axes are the same
_DIGITS = (
    4  # of lengths and angles that are no quarter turns, as far as sensors are mounted
)
_QUARTERS = {0: "0", 1: "pi/2", -1: "-pi/2", 2: "pi", -2: "pi"}


@dataclass(frozen=True)
class FixedFrame:
    """A frame on a body that moves, or on the ground."""

    carrier: str
    pose: Floats  # there, shape (4, 4)


def fixed_frames(
    mechanism: Mechanism, file: RobotFile | None = None
) -> dict[str, FixedFrame]:
    """Frames of a robot's bodies, and of what else its file has fixed to them, by name."""
    found = {BASE: FixedFrame(BASE, np.eye(4))}
    values = known_values(mechanism)
    for body in mechanism.bodies:
        frame = FixedFrame(body.name, np.eye(4))
        if body.joint.is_fixed:
            parent = found[_name(mechanism, body.parent)]
            placed = placement_matrix(at_zero(body), values)
            frame = FixedFrame(parent.carrier, parent.pose @ placed)
        found[body.name] = frame
    if file is None:
        return found
    built = file.built(ReadingOptions())
    for name in built.rides:
        index, placement = built.place(name)
        carrier = found.get(_name(built.mechanism, index))
        if carrier is not None and name not in found:
            values = known_values(built.mechanism)
            pose = carrier.pose @ placement_matrix(placement, values)
            found[name] = FixedFrame(carrier.carrier, pose)
    return found


def _name(mechanism: Mechanism, body: int) -> str:
    return BASE if body == GROUND else mechanism.bodies[body].name


@dataclass(frozen=True)
class OtherAxes:
    """A frame that the axes of a sensor may follow."""

    name: str  # of a frame of the robot; empty if it is the stated one, turned by quarter turns
    pose: Floats  # in the frame that is stated, shape (4, 4)
    stated: Floats  # the stated frame in that of its body, shape (4, 4)

    @property
    def words(self) -> str:
        """Such as ``those of 'ee_link' (frame: {…})``."""
        which = f"those of '{self.name}'" if self.name else "turned by quarter turns"
        return f"{which} ({_frame_text(self.stated @ self.pose)})"


def other_axes(
    mechanism: Mechanism, cut: Cut, frames: Mapping[str, FixedFrame]
) -> list[OtherAxes]:
    """Frames with other axes than those of a sensor: on the link that it is fixed to, or turned by quarter turns."""
    stated = placement_matrix(cut.frame, known_values(mechanism))
    parent = cut.body != GROUND and cut.on_parent
    host = _name(mechanism, mechanism.bodies[cut.body].parent if parent else cut.body)
    found = [OtherAxes("", np.eye(4), stated)]

    def add(name: str, pose: Floats) -> None:
        if all(_differ(pose, known.pose) for known in found):
            found.append(OtherAxes(name, pose, stated))

    own = frames.get(host)
    for name, frame in frames.items():
        if own is not None and frame.carrier == own.carrier:
            back = np.linalg.inv(own.pose @ stated)
            add(name, back @ frame.pose)
    for pose in _quarter_turns():
        add("", pose)
    return found[1:]


def named_axes(
    mechanism: Mechanism, output: Output, frames: Mapping[str, FixedFrame]
) -> list[str]:
    """Names of other frames that the axes of a sensor may follow, in quotation marks, each once."""
    cut, _ = output.cuts[0]
    others = other_axes(mechanism, cut, frames)
    return [f"'{some.name}'" for some in others if some.name]


def _differ(one: Floats, other: Floats) -> bool:
    return float(np.abs(one[:3, :3] - other[:3, :3]).max()) > _SAME


def _quarter_turns() -> list[Floats]:
    """The rotations of a cube, those about one axis first, each once."""
    turns = []
    for axis in (2, 0, 1):
        quarter = np.eye(4)
        i, j = [k for k in range(3) if k != axis]
        quarter[[i, j], [i, j]] = 0.0
        quarter[i, j], quarter[j, i] = (-1.0, 1.0) if axis != 1 else (1.0, -1.0)
        turns.append([np.linalg.matrix_power(quarter, n) for n in (1, -1, 2)])
    single = [turn for about in turns for turn in about]
    both = [one @ other for one in single for other in single]
    return [*single, *both]


def _frame_text(pose: Floats) -> str:
    """A frame as set-ups state it, such as ``frame: {rpy: [0, 0, pi/2]}``."""
    rpy = f"rpy: [{', '.join(map(_angle_text, roll_pitch_yaw(pose[:3, :3])))}]"
    shift = [f"{x:.{_DIGITS}g}" for x in pose[:3, 3].round(_DIGITS + 2) + 0.0]
    xyz = f"xyz: [{', '.join(shift)}], " if pose[:3, 3].any() else ""
    return f"frame: {{{xyz}{rpy}}}"


def _angle_text(angle: float) -> str:
    quarters = angle / (pi / 2)
    if abs(quarters - round(quarters)) < _SAME:
        return _QUARTERS[round(quarters)]
    return f"{angle:.{_DIGITS}g}"
