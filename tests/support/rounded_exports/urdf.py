"""Exports as URDF, with a YAML file that states loops, balls and universal joints."""

from __future__ import annotations

from support.rounded_exports.export import Export
from support.rounded_exports.mechanism import GROUND, Closure, Part, frame_along
from support.rounded_exports.rounding import NEUTRAL, Frame, Rounded

INERTIAL = (
    '<inertial><origin xyz="0.01 0.02 0.03"/><mass value="1"/>'
    '<inertia ixx="0.01" iyy="0.012" izz="0.014" ixy="0" ixz="0" iyz="0"/></inertial>'
)
LIMIT = '<limit lower="-3" upper="3" effort="10" velocity="10"/>'
CLOSURES = {"pin": "revolute", "point": "spherical", "weld": "weld"}


def urdf(export: Export) -> tuple[str, str]:
    """The texts of the URDF and the YAML file."""
    return Writer(export).texts()


class Writer:
    def __init__(self, export: Export) -> None:
        self.export, self.exact, self.numbers = (
            export,
            export.exact,
            Rounded(export, aligned=True),
        )

    def texts(self) -> tuple[str, str]:
        links = [
            self.link(GROUND),
            *(self.link(part.name) for part in self.exact.parts),
        ]
        joints = [self.joint(part) for part in self.exact.parts]
        loops = []
        for k, closure in enumerate(self.exact.closures):
            if self.export.format == "urdf":
                loops.append(self.derived(closure))
                continue
            ends = {f"loop{k}_a": closure.first, f"loop{k}_b": closure.second}
            for end, body in ends.items():
                links.append(f'<link name="{end}"/>')
                joints.append(self.end(end, body, closure))
            loops.append(
                f"{{joint: {CLOSURES[closure.kind]}, connects: [{', '.join(ends)}]}}"
            )
        robot = "\n".join(['<robot name="export">', *links, *joints, "</robot>", ""])
        beside = [
            "echelon: 1",
            "robot:",
            f"  file: {self.export.code}.urdf",
            *self.kinds(),
        ]
        return robot, "\n".join(
            [*beside, "loops:", *(f"  - {loop}" for loop in loops), ""]
        )

    def link(self, name: str) -> str:
        return f'<link name="{name}">{INERTIAL}</link>'

    def joint(self, part: Part) -> str:
        kind = "prismatic" if part.kind == "slide" else "revolute"
        axis = (
            self.numbers.axis(part.name, part.axes[0])
            if part.kind in ("hinge", "slide")
            else "1 0 0"
        )
        return (
            f'<joint name="{part.name}_j" type="{kind}"><parent link="{part.parent}"/><child link="{part.name}"/>'
            f'{self.origin(self.numbers.placed(part))}<axis xyz="{axis}"/>{LIMIT}</joint>'
        )

    def origin(self, frame: Frame) -> str:
        return f'<origin xyz="{self.numbers.lengths(frame.origin)}" rpy="{self.numbers.rpy(frame.turn)}"/>'

    def end(self, name: str, body: str, closure: Closure) -> str:
        turn = frame_along(closure.axis) if closure.kind == "pin" else NEUTRAL
        frame = Frame(turn, closure.point).within(self.numbers.frames[body])
        if closure.kind == "point":
            frame = Frame(NEUTRAL, frame.origin)
        return (
            f'<joint name="{name}_j" type="fixed"><parent link="{body}"/><child link="{name}"/>'
            f"{self.origin(frame)}</joint>"
        )

    def kinds(self) -> list[str]:
        words = {
            "ball": "{type: spherical}",
            "universal": "{type: universal, axis: x, axis2: y}",
        }
        stated = [
            f"    {part.name}_j: {words[part.kind]}"
            for part in self.exact.parts
            if part.kind in words
        ]
        return ["  joints:", *stated] if stated else []

    def derived(self, closure: Closure) -> str:
        """The second frame is where the first one is in the file's pose."""
        at = listed(self.numbers.point(closure.first, closure.point))
        axis = (
            f", axis: {listed(self.numbers.axis(closure.first, closure.axis))}"
            if closure.kind == "pin"
            else ""
        )
        ends = f"{closure.first}, {closure.second}"
        return f"{{joint: {CLOSURES[closure.kind]}, connects: [{ends}], at: {{xyz: {at}}}{axis}}}"


def listed(numbers: str) -> str:
    return f"[{', '.join(numbers.split())}]"
