"""The loops of a description: joints that close them, and which coordinates stay independent."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from fractions import Fraction
from typing import TYPE_CHECKING

from echelon.exact.angle import Angle
from echelon.exact.expressions import PI
from echelon.formats.bodies import BASE
from echelon.formats.closure_frames import at_zero, second_frame
from echelon.formats.description.stated_expressions import Expressions
from echelon.formats.description.stated_joints import Joints
from echelon.formats.snapping import symbol_stem
from echelon.mechanism.closed_pose import follow
from echelon.mechanism.closure import Closure, ClosureKind
from echelon.mechanism.joint import X, Y, Z
from echelon.mechanism.mechanism import Mechanism
from echelon.mechanism.placement import Placement, turn
from echelon.regressor.loops.closing import close
from echelon.regressor.loops.exact_pose import check_pose

if TYPE_CHECKING:
    from echelon.formats.schema.robot_schema import RobotDescription
    from echelon.formats.schema.schema_geometry import LoopEntry


FindPart = Callable[[str | None, str], tuple[int, Placement]]
"""The body that carries a part and where the part sits on it, by the part's name and the element that names it."""

_ALIASES = {"points": ClosureKind.SPHERICAL, "axes": ClosureKind.CYLINDRICAL}
_QUARTER, _HALF = Angle(Fraction(1, 2)), Angle(Fraction(1))
_BACK = Angle(Fraction(-1, 2))
_Z_ALONG = {
    (X, 1): turn(Y, _QUARTER),
    (X, -1): turn(Y, _BACK),
    (Y, 1): turn(X, _BACK),
    (Y, -1): turn(X, _QUARTER),
    (Z, 1): Placement(),
    (Z, -1): turn(X, _HALF),
}
"""Frames whose z axis lies along a coordinate axis, by axis and sign."""


def add_loops(mechanism: Mechanism, robot: RobotDescription, expressions: Expressions, find: FindPart) -> Mechanism:
    """A mechanism with the loops that a description states, beside those that it has."""
    loops = _Loops(mechanism, robot, expressions, find)
    closures = (*mechanism.closures, *loops.closures())
    if not closures:
        for key in ("independent", "assembly", "closed_at"):
            if key in robot.model_fields_set:
                raise expressions.error(key, "there are no loops, so no coordinate depends on others through them")
        return mechanism
    # what a robot file chose already stays where it can
    prefer = (*loops.driven(), *mechanism.independent)
    assembly = {**mechanism.assembly, **loops.assembly()}
    symbols = {**mechanism.symbols, **expressions.named}
    opened = replace(mechanism, closures=closures, independent=(), assembly=assembly, symbols=symbols)
    if robot.closed_at:
        opened = loops.followed(opened)
    return close(opened, loops.independent(), prefer=prefer)


class _Loops:
    def __init__(self, mechanism: Mechanism, robot: RobotDescription, expressions: Expressions, find: FindPart) -> None:
        self.mechanism, self.robot, self.expressions, self.find = mechanism, robot, expressions, find
        self.joints = Joints(expressions)

    # -- closures --------------------------------------------------------------------------------------------------

    def closures(self) -> Iterator[Closure]:
        """The joints that close loops."""
        taken = {closure.name for closure in self.mechanism.closures}
        for index, entry in enumerate(self.robot.loops):
            path = f"loops[{index}]"
            if isinstance(entry, tuple):
                entry = _weld(entry)
            name = entry.name or f"loop{len(self.mechanism.closures) + index + 1}"
            if name in taken:
                raise self.expressions.error(f"{path}.name", f"another loop has the name '{name}'")
            taken.add(name)
            yield self._closure(entry, name, path)

    def _closure(self, entry: LoopEntry, name: str, path: str) -> Closure:
        (first, offset), (second, other) = (
            self.find(part, f"{path}.connects[{k}]") for k, part in enumerate(entry.connects)
        )
        if first == second:
            shown = " and ".join(f"'{part}'" if part else "the world" for part in entry.connects)
            raise self.expressions.error(f"{path}.connects", f"{shown} do not move against each other")
        stem = symbol_stem(name)
        aim = self._aim(entry, path, stem)
        kind = _ALIASES.get(entry.joint) or ClosureKind(entry.joint)
        frame = offset @ self.joints.frame(entry.at, f"{path}.at", stem) @ aim
        meets = "at" not in entry.model_fields_set and all(self._is_frame(part) for part in entry.connects)
        if entry.on_second is None and not meets:
            met = self._met(kind, first, second, frame, path)
        else:
            stated = entry.at if entry.on_second is None else entry.on_second
            met = other @ self.joints.frame(stated, f"{path}.on_second", stem) @ aim
        return Closure(name, kind, first, second, frame, met)

    def _is_frame(self, part: str | None) -> bool:
        """Whether a part is only fixed to what moves, so that it can have no other use than to mark a place."""
        if part is None or part == BASE:
            return False
        return all(body.name != part or body.joint.is_fixed for body in self.mechanism.bodies)

    def _aim(self, entry: LoopEntry, path: str, stem: str) -> Placement:
        """A frame whose z axis lies along the joint's axis."""
        if entry.axis is None:
            return Placement()
        direction = self.expressions.direction(entry.axis, f"{path}.axis")
        mounting, axis, sign = self.expressions.snapping.direction(direction, f"{path}.axis", stem)
        return mounting @ _Z_ALONG[axis, sign]

    def _met(self, kind: ClosureKind, first: int, second: int, frame: Placement, path: str) -> Placement:
        """Where a frame of the first body is on the second one while all coordinates are zero."""
        bodies, symbols = self.mechanism.bodies, {**self.mechanism.symbols, **self.expressions.named}
        try:
            return second_frame(
                kind, first, second, frame, lambda k: bodies[k].parent, lambda k: at_zero(bodies[k]), symbols
            )
        except ValueError as error:
            raise self.expressions.error(path, str(error)) from None

    # -- coordinates -----------------------------------------------------------------------------------------------

    def independent(self) -> tuple[str, ...] | None:
        """The coordinates that shall be independent, if they are stated."""
        for index, name in enumerate(self.robot.independent or ()):
            self.expressions.check(name, self.mechanism.velocities, f"independent[{index}]")
        return self.robot.independent

    def assembly(self) -> dict[str, float]:
        """Positions near which the loops close."""
        found = {}
        for name, text in self.robot.assembly.items():
            path = f"assembly.{name}"
            self.expressions.check(name, self.mechanism.positions, path)
            value = self.expressions.polynomial(text, path)
            if not set(value.generators()) <= {PI}:
                raise self.expressions.error(path, f"'{text}' must be a number here, without symbols")
            found[name] = value.evaluate({PI: math.pi}, float)
        return found

    def followed(self, mechanism: Mechanism) -> Mechanism:
        """The mechanism with second frames that follow at the exact pose."""
        pose = {
            name: tuple(self.expressions.polynomial(text, f"closed_at.{name}[{k}]") for k, text in enumerate(position))
            for name, position in self.robot.closed_at.items()
        }
        try:
            check_pose(mechanism, pose)
            return follow(mechanism, pose)
        except ValueError as error:
            raise self.expressions.error("closed_at", str(error)) from None

    def driven(self) -> list[str]:
        """Coordinates that actuators drive."""
        stated: list[str] = []
        if self.robot.robot is not None:
            for index, name in enumerate(self.robot.robot.driven):
                several = [known for known in self.mechanism.velocities if known.startswith(f"{name}.")]
                if not several:
                    self.expressions.check(name, self.mechanism.velocities, f"robot.driven[{index}]")
                stated += several or [name]
        for actuator, entry in self.robot.actuators.items():
            if isinstance(entry, str):
                stated += self.expressions.parsed(entry, f"actuators.{actuator}").symbols()
            else:
                stated += entry.terms
        return [name for name in dict.fromkeys(stated) if name in self.mechanism.velocities]


def _weld(pair: tuple[str | None, str | None]) -> LoopEntry:
    """Two frames that are held together as they are."""
    from echelon.formats.schema.schema_geometry import Frame, LoopEntry

    name = "-".join(part or BASE for part in pair)
    return LoopEntry.model_construct(name=name, joint="weld", connects=pair, on_second=Frame.model_construct())
