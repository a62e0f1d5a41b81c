"""Sensors of a machine, as data models of the description format: each kind says which outputs it gives.

An output is a weighted sum of forces of joints or actuators and of components of wrenches between bodies.  A new kind
of sensor is a model with a method ``outputs`` and a row of :data:`SENSORS`.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from functools import reduce
from operator import or_
from typing import TYPE_CHECKING, Annotated, Any, Literal, Protocol

from echelon.algebra import Polynomial
from echelon.formats.schema.schema_types import (
    Expression,
    Frame,
    Model,
    Name,
    exactly_one,
)
from echelon.robot import Cut, Force, Output, Side
from echelon.shared import (
    Discriminator,
    Tag,
    UnfitError,
    model_check,
    optional,
    required,
)

Component = Literal["fx", "fy", "fz", "tx", "ty", "tz"]
COMPONENTS: tuple[Component, ...] = ("fx", "fy", "fz", "tx", "ty", "tz")
Fixed = Literal["body", "parent"]


class Places(Protocol):
    """The robot that sensors sit on; ``path`` is the element that names a place, for errors."""

    def forces(self, side: Side, at: str, path: str) -> Mapping[str, tuple[Force, str]]:
        """The force at a place, or at all of them, and its unit, by place."""

    def cut(
        self,
        component: str,
        body: str,
        frame: Frame,
        fixed_to: Fixed,
        stem: str,
        path: str,
        key: str = "wrench",
    ) -> Cut:
        """One component of the wrench of a body, in a frame whose angles are named after ``stem``.

        ``key`` is that under which the entry names the body, for errors.
        """

    def weight(self, text: str, path: str) -> Polynomial:
        """A number or an expression in symbols."""


class Sensor(Model):
    """A kind of sensor."""

    @property
    def carried(self) -> tuple[str, ...]:
        """Names of the bodies that it carries, or ``base``; no other body is welded to them."""
        return ()

    @abstractmethod
    def outputs(self, places: Places, path: str) -> Sequence[Output]:
        """Outputs of the mechanism that the sensor measures."""


def _each(forces: Mapping[str, tuple[Force, str]], name: str | None) -> list[Output]:
    """Forces as outputs, named after their places unless a name is given."""
    names = {
        at: at if name is None else name if len(forces) == 1 else f"{name}.{at}"
        for at in forces
    }
    return [force.output(names[at], unit) for at, (force, unit) in forces.items()]


class JointOutput(Sensor):
    """A torque or force sensor in a joint, on the joint's side of the drive."""

    joint: Name = required("Joint coordinate, or all.", "j1", "all")
    name: Name | None = optional(
        None, "Name of the output; default: the coordinate.", "tau1"
    )

    def outputs(self, places: Places, path: str) -> Sequence[Output]:
        """One output at every place."""
        return _each(places.forces(Side.JOINT, self.joint, f"{path}.joint"), self.name)


class ActuatorOutput(Sensor):
    """Torque, force or current of an actuator."""

    actuator: Name = required("Actuator, or all.", "m5", "all")
    name: Name | None = optional(
        None, "Name of the output; default: the actuator.", "i5"
    )

    def outputs(self, places: Places, path: str) -> Sequence[Output]:
        """One output at every place."""
        return _each(
            places.forces(Side.ACTUATOR, self.actuator, f"{path}.actuator"), self.name
        )


class WrenchOutput(Sensor):
    """A force/torque sensor between a body and its parent, or under the base."""

    wrench: Name = required(
        "Body that is carried by the sensor; base for all of them.", "hand"
    )
    name: Name | None = optional(None, "Name of the sensor; default: the body.", "ft")
    frame: Frame = optional(
        Frame.model_construct(), "The sensor's frame.", {"xyz": [0, 0, "0.05"]}
    )
    fixed_to: Fixed = optional(
        "body", "Body that the sensor's frame is fixed to.", "parent"
    )
    components: tuple[Component, ...] = optional(
        COMPONENTS, "Forces and torques along the axes of the frame.", ["tz"]
    )

    @property
    def carried(self) -> tuple[str, ...]:
        """The body, or the base."""
        return (self.wrench,)

    def outputs(self, places: Places, path: str) -> Sequence[Output]:
        """One output for every component."""
        name = self.name or self.wrench
        cuts = [
            places.cut(c, self.wrench, self.frame, self.fixed_to, name, path)
            for c in self.components
        ]
        return [cut.of_sensor(name) for cut in cuts]


class WeightedTerm(Model):
    """A joint's or an actuator's force, or a component of a wrench, with a weight."""

    joint: Name | None = optional(None, "Joint coordinate.", "j1")
    actuator: Name | None = optional(None, "Actuator.", "m5")
    wrench: Name | None = optional(
        None, "Body that a force/torque sensor carries, or base.", "hand"
    )
    component: Component | None = optional(
        None, "With a wrench, one force or torque along its frame's axes.", "fz"
    )
    frame: Frame = optional(
        Frame.model_construct(), "With a wrench, its frame.", {"xyz": [0, 0, "0.05"]}
    )
    fixed_to: Fixed = optional(
        "body", "With a wrench, what its frame is fixed to.", "parent"
    )
    weight: Expression = optional("1", "Its weight.", "1/2")

    _one_place = exactly_one("joint", "actuator", "wrench")

    @model_check
    def _check_component(self) -> None:
        if (self.wrench is None) != (self.component is None):
            raise UnfitError("a wrench goes with a component, such as component: fz")


class SumOutput(Sensor):
    """A weighted sum of forces."""

    name: Name = required("Name of the output.", "differential")
    unit: str = optional("N·m", "Its SI unit.", "N·m")
    sum: tuple[WeightedTerm, ...] = required(
        "Terms of the sum.", [{"joint": "j5"}, {"joint": "j6", "weight": "-1"}]
    )
    reads: Name = optional(
        "", "Another output, whose measured values are these as well.", "m1"
    )

    @property
    def carried(self) -> tuple[str, ...]:
        """Bodies whose wrenches are in the sum."""
        return tuple(term.wrench for term in self.sum if term.wrench is not None)

    def outputs(self, places: Places, path: str) -> Sequence[Output]:
        """One output."""
        forces: list[tuple[Force, Polynomial]] = []
        cuts: list[tuple[Cut, Polynomial]] = []
        for k, term in enumerate(self.sum):
            where = f"{path}.sum[{k}]"
            weight = places.weight(term.weight, f"{where}.weight")
            if term.wrench is not None and term.component is not None:
                cut = places.cut(
                    term.component,
                    term.wrench,
                    term.frame,
                    term.fixed_to,
                    self.name,
                    where,
                )
                cuts.append((cut, weight))
                continue
            side = Side.ACTUATOR if term.joint is None else Side.JOINT
            at = term.joint or term.actuator or ""
            forces += [
                (force, weight) for force, _ in places.forces(side, at, where).values()
            ]
        return [Output(self.name, self.unit, tuple(forces), tuple(cuts), self.reads)]


SENSORS: dict[str, type[Sensor]] = {
    "joint": JointOutput,
    "actuator": ActuatorOutput,
    "wrench": WrenchOutput,
    "sum": SumOutput,
}
"""Kinds of sensors, by the key that says what is measured."""


def _kind(value: Any) -> str:
    for key in SENSORS:
        if isinstance(value, dict) and key in value:
            return key
    *keys, last = SENSORS
    problem = f"needs one of the keys {', '.join(keys)} and {last}, which say what is measured"
    raise UnfitError(problem)


if TYPE_CHECKING:
    OutputEntry = Sensor
else:
    _tagged = [Annotated[model, Tag(key)] for key, model in SENSORS.items()]
    OutputEntry = Annotated[reduce(or_, _tagged), Discriminator(_kind)]
