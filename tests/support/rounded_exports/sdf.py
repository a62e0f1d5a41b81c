"""Exports as SDF: links stand in the model's frame, and loops are joints as all others."""

from __future__ import annotations

from support.rounded_exports.export import Export
from support.rounded_exports.mechanism import GROUND, Closure, Part
from support.rounded_exports.rounding import Rounded

INERTIAL = (
    "<inertial><pose>0.01 0.02 0.03 0 0 0</pose><mass>1</mass>"
    "<inertia><ixx>0.01</ixx><iyy>0.012</iyy><izz>0.014</izz></inertia></inertial>"
)
KINDS = {
    "hinge": "revolute", "slide": "prismatic", "ball": "ball", "universal": "universal",
    "pin": "revolute", "point": "ball", "weld": "fixed",
}  # fmt: skip


def sdf(export: Export) -> str:
    writer = Writer(export)
    head = "<?xml version='1.0'?>\n<sdf version='1.9'><world name='w'><gravity>0 0 -9.81</gravity><model name='m'>"
    return "\n".join([head, *writer.lines(), "</model></world></sdf>", ""])


class Writer:
    def __init__(self, export: Export) -> None:
        self.exact, self.numbers = export.exact, Rounded(export, aligned=True)

    def lines(self) -> list[str]:
        names = (GROUND, *(part.name for part in self.exact.parts))
        held = (
            []
            if self.exact.floating
            else [
                f"<joint name='held' type='fixed'><parent>world</parent><child>{GROUND}</child></joint>"
            ]
        )
        return [
            *(self.link(name) for name in names),
            *held,
            *(self.joint(part) for part in self.exact.parts),
            *(
                self.closure(f"loop{k}", closure)
                for k, closure in enumerate(self.exact.closures)
            ),
        ]

    def link(self, name: str) -> str:
        frame = self.numbers.frames[name]
        pose = f"{self.numbers.lengths(frame.origin)} {self.numbers.rpy(frame.turn)}"
        return f"<link name='{name}'><pose>{pose}</pose>{INERTIAL}</link>"

    def joint(self, part: Part) -> str:
        axes = [self.numbers.axis(part.name, axis) for axis in part.axes]
        stated = "".join(
            f"<{tag}><xyz>{axis}</xyz></{tag}>"
            for tag, axis in zip(("axis", "axis2"), axes, strict=False)
        )
        ends = f"<parent>{part.parent}</parent><child>{part.name}</child>"
        return f"<joint name='{part.name}_j' type='{KINDS[part.kind]}'>{ends}{stated}</joint>"

    def closure(self, name: str, closure: Closure) -> str:
        parent, child = closure.first, closure.second
        if child == GROUND:
            parent, child = child, parent
        ends = f"<parent>{parent}</parent><child>{child}</child>"
        pose = f"<pose>{self.numbers.point(child, closure.point)} 0 0 0</pose>"
        axis = (
            f"<axis><xyz>{self.numbers.axis(child, closure.axis)}</xyz></axis>"
            if closure.kind == "pin"
            else ""
        )
        return f"<joint name='{name}' type='{KINDS[closure.kind]}'>{pose}{ends}{axis}</joint>"
