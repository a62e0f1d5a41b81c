"""Measured outputs y: linear combinations of what sensors can measure.

A sensor is a freedom that never moves.  The power of the bodies' wrenches in a virtual motion of that freedom is what
the sensor measures: a joint torque is the power of the joint's own freedom, a torque or force sensor anywhere between
two bodies that of a turn or a shift of one against the other.
"""

from __future__ import annotations

from dataclasses import dataclass

from echelon.exact.polynomial import Polynomial
from echelon.mechanism.placement import Placement


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
