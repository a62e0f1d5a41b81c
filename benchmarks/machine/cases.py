"""The robots of the comparison: one base model, and Pinocchio's model with the way from our order to its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

import echelon as ec
from anchors.build import UnavailableError
from anchors.pinocchio_cpp import CppRobot
from robots import find_urdf, panda

Floats = npt.NDArray[np.float64]
States = tuple[Floats, Floats, Floats]

_AMPLITUDES = (3.0, 3.0, 10.0)  # rad, rad/s, rad/s²
# Pinocchio's columns of a body: m, m·c, then the inertia tensor as XX XY YY XZ YZ ZZ
_THEIR_PLACE = {
    "XX": 4,
    "XY": 5,
    "XZ": 7,
    "YY": 6,
    "YZ": 8,
    "ZZ": 9,
    "MX": 1,
    "MY": 2,
    "MZ": 3,
    "M": 0,
}
_KINDS = tuple(_THEIR_PLACE)


@dataclass(frozen=True)
class Case:
    """One robot with a fixed base.

    Attributes
    ----------
    name, label : str
    base : BaseModel
    model : pinocchio.Model
        The same joints and bodies.
    """

    name: str
    label: str
    base: Any
    model: Any
    skipped: list[str] = field(default_factory=list)

    @cached_property
    def cpp(self) -> CppRobot | None:
        """Pinocchio in C++; None where it cannot be compiled, and :attr:`skipped` then says why."""
        try:
            return CppRobot(self.model)
        except UnavailableError as error:
            self.skipped.append(f"Pinocchio in C++: {error}")
            return None

    @cached_property
    def order(self) -> list[int]:
        """For every velocity of Pinocchio's, the place of ours."""
        ours = list(self.base.mechanism.velocities)
        return [ours.index(name) for name in list(self.model.names)[1:]]

    @property
    def outputs(self) -> int:
        return len(self.base.mechanism.outputs)

    def states(self, count: int, seed: int = 1) -> States:
        """Random states in our order."""
        rng = np.random.default_rng(seed)
        q, qd, qdd = (rng.uniform(-a, a, (count, len(self.order))) for a in _AMPLITUDES)
        return q, qd, qdd

    def theirs(self, states: States) -> States:
        """The same states in Pinocchio's order."""
        q, qd, qdd = (np.ascontiguousarray(part[:, self.order]) for part in states)
        return q, qd, qdd

    def their_columns(self, columns: Sequence[int]) -> list[int]:
        """Where Pinocchio's regressor has standard parameters of ours."""
        mechanism, found = self.base.mechanism, []
        for k in columns:
            parameter = mechanism.columns[k]
            body = mechanism.bodies[parameter.body]
            place = _THEIR_PLACE[_KINDS[parameter.kind]]
            found.append(10 * (self.model.getJointId(body.joint.name) - 1) + place)
        return found


def arms() -> list[Case]:
    """UR10 and Panda."""
    return [urdf_case("ur10", "UR10", "ur10_robot.urdf"), panda_case()]


def humanoid() -> Case:
    """Talos on a fixed base, with 32 revolute joints."""
    return urdf_case("talos", "Talos, 32 joints", "talos_reduced.urdf")


def urdf_case(name: str, label: str, file: str, *, literal: bool = False) -> Case:
    """A robot of the package example-robot-data; `literal` reads its decimals as they are, as Pinocchio does."""
    import pinocchio as pin

    path = find_urdf(file)
    mechanism = ec.load(path, snap_tolerance=0) if literal else ec.load(path)
    return Case(
        name, label, ec.base_parameters(mechanism), pin.buildModelFromUrdf(str(path))
    )


def panda_case() -> Case:
    """The arm of the example file."""
    robot = panda()
    return Case("panda", "Panda", ec.base_parameters(robot.exact()), robot.numeric())
