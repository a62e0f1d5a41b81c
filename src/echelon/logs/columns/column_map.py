"""What the columns of a log mean for a robot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Channel:
    """A quantity in a column: value = scale · (column in SI units) + offset.

    Attributes
    ----------
    column : str
        Name of the column in the file.
    unit : str
        Unit of the column; empty for the SI unit of the quantity.
    scale : float
        Sign, gear ratio or gain, applied after the conversion to SI units.
    offset : float
        Added last, SI unit of the quantity.
    """

    column: str
    unit: str = ""
    scale: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class ColumnMap:
    """Which columns hold which quantities.

    Keys of positions, velocities, accelerations and references are coordinates of the mechanism; or actuators, for what
    is measured on the motor's side of the gear.  Keys of outputs are its outputs; or actuators, whose forces become
    those of the joints (τ_q = Tᵀ τ_θ) where joints are the outputs.

    Attributes
    ----------
    time : Channel, optional
        Time stamps; omitted where columns bring their own clocks, or ``rate`` is given.
    rate : float, optional
        Samples per second of a log without time stamps.
    positions, velocities, accelerations : mapping of str to Channel
        Velocities and accelerations are empty where they are not logged.
    outputs : mapping of str to Channel
    references : mapping of str to Channel
        Positions that the controller was asked for, if logged.
    inputs : mapping of str to Channel
        Measured inputs that effects use, such as currents, by coordinate or actuator.
    """

    time: Channel | None = None
    rate: float | None = None
    positions: Mapping[str, Channel] = field(default_factory=dict)
    velocities: Mapping[str, Channel] = field(default_factory=dict)
    accelerations: Mapping[str, Channel] = field(default_factory=dict)
    outputs: Mapping[str, Channel] = field(default_factory=dict)
    references: Mapping[str, Channel] = field(default_factory=dict)
    inputs: Mapping[str, Channel] = field(default_factory=dict)

    @property
    def channels(self) -> dict[str, Mapping[str, Channel]]:
        """Channels by the kind of their quantity, positions first."""
        return {
            "position": self.positions,
            "velocity": self.velocities,
            "acceleration": self.accelerations,
            "output": self.outputs,
            "reference": self.references,
            "input": self.inputs,
        }
