"""Column maps: which columns of a log hold which quantities of a robot, and in which SI units these are."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import numpy.typing as npt

from echelon.identification.logs.columns.motion_sensors import (
    NO_SENSORS,
    MotionSensor,
    Sensors,
)
from echelon.identification.logs.recording import Recording
from echelon.robot import Actuator, Mechanism, Motion, MotionKind
from echelon.shared import Within


@dataclass(frozen=True)
class Channel:
    """A quantity in a column: value = scale · (column in SI units) + offset."""

    column: str  # its name in the file
    unit: str = ""  # of the column; empty for the SI unit of the quantity
    scale: float = (
        1.0  # sign, gear ratio or gain, applied after the conversion to SI units
    )
    offset: float = 0.0  # added last, SI unit of the quantity


@dataclass(frozen=True)
class Locked:
    """A joint or drive that does not move, and the columns that must say so, where a log has them."""

    position: Channel | None
    at: float  # where it stands, rad or m
    velocity: Channel | None = None  # asked where there is no position
    # whether somebody stated the columns, or their names tell them
    stated: bool = True

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(c.column for c in (self.position, self.velocity) if c is not None)


@dataclass(frozen=True)
class ColumnMap:
    """Which columns hold which quantities.

    Keys of positions, velocities, accelerations and references are coordinates of the mechanism; or actuators, for what
    is measured on the motor's side of the gear; or sensors of motion.  Keys of outputs are its outputs; or actuators,
    whose forces become those of the joints (τ_q = Tᵀ τ_θ) where joints are the outputs.
    """

    time: Channel | None = (
        None  # time stamps; omitted where columns bring their own clocks, or the rate is given
    )
    rate: Annotated[float, Within(gt=0)] | None = (
        None  # samples per second of a log without time stamps
    )
    positions: Mapping[str, Channel] = field(default_factory=dict)
    velocities: Mapping[str, Channel] = field(
        default_factory=dict
    )  # these and accelerations are empty if not logged
    accelerations: Mapping[str, Channel] = field(default_factory=dict)
    outputs: Mapping[str, Channel] = field(default_factory=dict)
    references: Mapping[str, Channel] = field(
        default_factory=dict
    )  # positions that the controller was asked for
    # measured inputs that effects use, such as currents, by coordinate or actuator
    inputs: Mapping[str, Channel] = field(default_factory=dict)
    # those whose names positions, velocities, accelerations and references use
    sensors: Mapping[str, MotionSensor] = field(default_factory=dict, kw_only=True)
    # above zero where a contact touches, by contact
    contacts: Mapping[str, Channel] = field(default_factory=dict, kw_only=True)
    twist: Literal["mixed", "body", "world"] = field(default="mixed", kw_only=True)
    # that the logs belong to; empty where there is one, or where contacts tell
    experiment: str = field(default="", kw_only=True)
    # patterns of file names that the map is for; all names that have the experiment's as a word if empty
    files: tuple[str, ...] = field(default=(), kw_only=True)

    # joints and drives that the robot has locked
    locked: Mapping[str, Locked] = field(default_factory=dict, kw_only=True)

    def is_for(self, source: str) -> bool:
        """Whether a log is one that the map is for, by its name."""
        names = [source, *(Path(part).name for part in source.split("+"))]
        if self.files:
            return any(n == p or fnmatchcase(n, p) for n in names for p in self.files)
        if not self.experiment:
            return True
        word = rf"(?<![^\W_]){re.escape(self.experiment)}(?![^\W_])"
        return any(re.search(word, name) for name in names[1:])

    def kept(self, keeps: Callable[[str, str], bool]) -> ColumnMap:
        """The map with those channels alone whose kind and name a function accepts."""
        groups: dict[str, Any] = {
            _GROUPS[kind]: {
                n: channel for n, channel in group.items() if keeps(kind, n)
            }
            for kind, group in self.channels.items()
        }
        return replace(self, **groups)

    def with_locked(self, at: Mapping[str, float]) -> ColumnMap:
        """The map for a robot with some joints and drives locked, whose positions are only compared with theirs."""
        found = self.kept(lambda kind, name: kind == "contact" or name not in at)
        locked = {
            name: Locked(self.positions.get(name), there, self.velocities.get(name))
            for name, there in at.items()
            if name in self.positions or name in self.velocities
        }
        return replace(found, locked={**self.locked, **locked})

    def within(self, mechanism: Mechanism) -> ColumnMap:
        """The map without channels of what a mechanism does not have, such as joints that an experiment locks."""
        drives = {actuator.name for actuator in mechanism.transmission.actuators}
        valid = {*mechanism.positions, *mechanism.velocities, *self.sensors, *drives}
        outputs = {output.name for output in mechanism.outputs}
        if not all(output.name in self.outputs for output in mechanism.sensed):
            outputs |= drives  # forces of joints follow from those of drives

        def is_there(kind: str, name: str) -> bool:
            return kind == "contact" or name in (outputs if kind == "output" else valid)

        return self.kept(is_there)

    @property
    def channels(self) -> dict[str, Mapping[str, Channel]]:
        """Channels by the kind of their quantity, positions first."""
        return {kind: getattr(self, group) for kind, group in _GROUPS.items()}


_GROUPS = {
    "position": "positions",
    "velocity": "velocities",
    "acceleration": "accelerations",
    "output": "outputs",
    "reference": "references",
    "input": "inputs",
    "contact": "contacts",
}
"""Fields of a column map by the kind of their channels."""

ORDERS = {"position": 0, "reference": 0, "velocity": 1, "acceleration": 2}
"""Times that positions were differentiated, by kind of channel."""

SIGNALS = {
    "q": "position",
    "qd": "velocity",
    "qdd": "acceleration",
    "reference": "reference",
    "y": "output",
}
"""Kind of channel by name of the signal in a recording."""

_PER = ("", "/s", "/s²")
_POSITIONS = ("q", "reference")

WRAP = 5.5  # jump of an angle between two samples, rad, that can only be a full turn taken off


def actuators(mechanism: Mechanism) -> tuple[Actuator, ...]:
    """The stated actuators, without those that share the name of a coordinate, which then means the coordinate."""
    taken = {*mechanism.positions, *mechanism.velocities}
    return tuple(
        actuator for actuator in mechanism.actuators if actuator.name not in taken
    )


def coordinates(mechanism: Mechanism, kind: str) -> tuple[str, ...]:
    """Names of the coordinates of positions and references, or of velocities and accelerations."""
    return mechanism.velocities if ORDERS[kind] else mechanism.positions


def independent_coordinates(mechanism: Mechanism, kind: str) -> tuple[str, ...]:
    """Names of those coordinates that all others follow from, which are enough in a log."""
    return (
        mechanism.independent_velocities
        if ORDERS[kind]
        else mechanism.independent_positions
    )


def units(
    mechanism: Mechanism, kind: str, name: str, sensors: Sensors = NO_SENSORS
) -> tuple[str, ...] | None:
    """SI units that a channel may have: two for an actuator, which turns or slides; None for an input."""
    if name in sensors:
        every = [
            units(mechanism, kind, part, {}) or () for part in sensors[name].weights
        ]
        return tuple(dict.fromkeys(unit for some in every for unit in some))
    if kind in ("input", "contact"):
        return None
    if kind == "output":
        found = next(
            (output.unit for output in mechanism.outputs if output.name == name), None
        )
        return ("N·m", "N") if found is None else (found,)
    per = _PER[ORDERS[kind]]
    motion = motion_of(mechanism, name)
    if motion is None:
        return (f"rad{per}", f"m{per}")
    if motion.kind is MotionKind.BALL and not per:
        return ("1",)
    return (f"m{per}",) if motion.kind is MotionKind.TRANSLATION else (f"rad{per}",)


def motion_of(mechanism: Mechanism, name: str) -> Motion | None:
    """The motion that has a coordinate of this name; None if there is none."""
    return next(
        (m for m in mechanism.motions if name in m.positions or name in m.velocities),
        None,
    )


def signal_names(mechanism: Mechanism, signal: str, columns: int) -> tuple[str, ...]:
    """Names of the columns of a signal; with loops it may have the independent coordinates only."""
    if signal == "y":
        return tuple(output.name for output in mechanism.outputs)
    kind = SIGNALS[signal]
    names = coordinates(mechanism, kind)
    return names if len(names) == columns else independent_coordinates(mechanism, kind)


@dataclass(frozen=True)
class Series:
    """One column of a recording with its name."""

    signal: str  # ``q``, ``qd``, ``qdd``, ``y``, ``reference`` or ``input``
    name: str  # coordinate, output, or actuator
    values: npt.NDArray[np.float64]  # shape (N,)

    @property
    def label(self) -> str:
        """The name of the column in messages."""
        return f"{SIGNALS.get(self.signal, self.signal)} of '{self.name}'"


def series(
    recording: Recording, mechanism: Mechanism, *signals: str
) -> Iterator[Series]:
    """Columns of some signals of a recording one by one; of all, and of the inputs, if none are named.

    What several outputs read is one column.
    """
    again = {output.name for output in mechanism.outputs if output.reads}
    for signal in signals or recording.signals:
        if signal in recording.signals:
            values = recording.signals[signal]
            for column, name in enumerate(
                signal_names(mechanism, signal, values.shape[1])
            ):
                if signal != "y" or name not in again:
                    yield Series(signal, name, values[:, column])
    if not signals:
        for name, values in recording.inputs.items():
            yield Series("input", name, values)


def quaternion_columns(
    mechanism: Mechanism, signal: str, columns: int
) -> tuple[int, ...]:
    """First columns of the quaternions in a signal with ``columns`` columns; only positions hold any."""
    if signal not in _POSITIONS:
        return ()
    balls = {
        motion.positions[0]
        for motion in mechanism.motions
        if motion.kind is MotionKind.BALL
    }
    names = signal_names(mechanism, signal, columns)
    return tuple(column for column, name in enumerate(names) if name in balls)


def angle_columns(mechanism: Mechanism, signal: str, columns: int) -> tuple[int, ...]:
    """Columns of the angles of turning joints in a signal with ``columns`` columns; only positions hold any."""
    if signal not in _POSITIONS:
        return ()
    motions = [
        motion_of(mechanism, name) for name in signal_names(mechanism, signal, columns)
    ]
    return tuple(
        k
        for k, motion in enumerate(motions)
        if motion is not None and motion.kind is MotionKind.ROTATION
    )
