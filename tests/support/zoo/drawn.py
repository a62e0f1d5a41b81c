"""Mechanisms drawn in one closed pose: joints and closures at points of the world, all coordinates zero there."""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction

Point = tuple[float | str, ...]


@dataclass
class Drawn:
    """A mechanism whose bodies stand as the world does, with origins at their joints.

    Joint types and closures are words of the description format.
    """

    gravity: str = "1.2, -3.4, -9.1"
    bodies: list[str] = field(default_factory=list)
    loops: list[str] = field(default_factory=list)
    at: dict[str, Point] = field(default_factory=lambda: {"base": (0, 0, 0)})

    def body(
        self, name: str, parent: str, point: Point, joint: str = "revolute, axis: z"
    ) -> str:
        """A body that is joined to its parent at a point."""
        xyz, self.at[name] = self._from(parent, point), point
        self.bodies.append(
            f"{{name: {name}, parent: {parent}, joint: {{type: {joint}, origin: {{xyz: {xyz}}}}}}}"
        )
        return name

    def chain(self, name: str, parent: str, *joints: tuple[Point, str]) -> str:
        """Bodies in a row, each with its joint; returns the last one's name."""
        for k, (point, joint) in enumerate(joints, 1):
            parent = self.body(f"{name}{k}", parent, point, joint)
        return parent

    def loop(
        self, first: str, second: str, point: Point, joint: str = "revolute, axis: z"
    ) -> None:
        """A joint that closes a loop at a point."""
        one, two = self._from(first, point), self._from(second, point)
        self.loops.append(
            f"{{joint: {joint}, connects: [{first}, {second}], at: {{xyz: {one}}}, on_second: {{xyz: {two}}}}}"
        )

    @property
    def text(self) -> str:
        bodies, loops = (
            "".join(f"  - {entry}\n" for entry in part)
            for part in (self.bodies, self.loops)
        )
        return f"gravity: [{self.gravity}]\nbodies:\n{bodies}loops:\n{loops}"

    def _from(self, body: str, point: Point) -> str:
        parts = [
            Fraction(str(a)) - Fraction(str(b))
            for a, b in zip(_spatial(point), _spatial(self.at[body]), strict=True)
        ]
        return f"[{', '.join(map(str, parts))}]"


def _spatial(point: Point) -> Point:
    return (*point, *([0] * (3 - len(point))))
