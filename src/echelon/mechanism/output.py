"""The rows and columns of the regressor X: measured outputs, and standard parameters.

An output is a linear combination of what sensors can measure.  A sensor is a freedom that never moves.  The power of
the bodies' wrenches in a virtual motion of that freedom is what the sensor measures: a joint torque is the power of the
joint's own freedom, a torque or force sensor anywhere between two bodies that of a turn or a shift of one against the
other.
"""

from __future__ import annotations

from dataclasses import dataclass

from echelon.conventions import LENGTH_DEGREE, UNITS, parameter_name
from echelon.exact.polynomial import Polynomial
from echelon.mechanism.joint import Placement


@dataclass(frozen=True)
class JointForce:
    """Generalised force of a joint coordinate, on the joint's side of its drive: rigid bodies and effects there."""

    coordinate: str


@dataclass(frozen=True)
class ActuatorForce:
    """Torque or force of an actuator: everything that its motion moves, and the effects in the drive."""

    actuator: str


@dataclass(frozen=True)
class Cut:
    """One component of the wrench that a body gets from its parent (from the ground: all bodies that hang on it)."""

    body: int  # the body; GROUND for the wrench under the base
    frame: Placement  # the sensor's frame in the frame of the body, or of its parent
    on_parent: bool  # whether the frame is fixed to the parent
    axis: int  # 0, 1, 2 for x, y, z of the sensor's frame
    angular: bool  # moment (N·m) or force (N)


Channel = JointForce | ActuatorForce | Cut


@dataclass(frozen=True)
class Output:
    """One measured output, a row of X."""

    name: str
    unit: str
    terms: tuple[tuple[Channel, Polynomial], ...]  # y = Σ weight · channel


_ONE = Polynomial.constant(1)


def plain(name: str, unit: str, channel: Channel) -> Output:
    """The output that is one channel."""
    return Output(name, unit, ((channel, _ONE),))


@dataclass(frozen=True)
class Parameter:
    """One standard parameter."""

    name: str
    unit: str  # SI unit
    body: int | None = None  # index of the body whose inertia it describes; None for parameters of effects
    kind: int | None = None  # its place in XX … M, for a body's parameter

    @property
    def length_degree(self) -> int:
        """Power of length in the unit of an inertial parameter; 0 for other parameters."""
        return 0 if self.kind is None else LENGTH_DEGREE[self.kind]


def inertial_parameter(body: int, label: str, kind: int) -> Parameter:
    """One of the ten standard parameters of a body."""
    return Parameter(parameter_name(label, kind), UNITS[kind], body, kind)
