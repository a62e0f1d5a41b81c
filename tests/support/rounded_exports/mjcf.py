"""Exports as MJCF: pins are two points on an axis, frames derived from an anchor or stated by sites."""

from __future__ import annotations

import random

from support.rounded_exports.export import Export
from support.rounded_exports.geometry import Vec, exactly
from support.rounded_exports.mechanism import GROUND, Closure, Part
from support.rounded_exports.rounding import Rounded

HALF_PIN = "0.05"
INERTIAL = '<inertial pos="0.01 0.02 0.03" mass="1" diaginertia="0.01 0.012 0.014"/>'


def mjcf(export: Export) -> str:
    return Writer(export).text()


class Writer:
    def __init__(self, export: Export) -> None:
        self.exact, self.numbers = export.exact, Rounded(export)
        self.by_sites = export.format == "mjcf_sites"
        # a planar loop needs one point of a pin only; some programs write two all the same
        self.single = self.exact.planar and random.Random(export.seed).random() < 0.5
        self.sites: dict[str, list[str]] = {}

    def text(self) -> str:
        equalities = [
            line for closure in self.exact.closures for line in self.closure(closure)
        ]
        inside = self.inside(GROUND)
        if self.exact.floating:
            quat = self.numbers.quaternion(self.numbers.frames[GROUND].turn)
            inside = f'<body name="{GROUND}" quat="{quat}"><freejoint/>{INERTIAL}\n{inside}</body>'
        head = '<mujoco>\n<option gravity="0 0 -9.81"/>\n<compiler angle="radian"/>'
        tail = "\n".join(["<equality>", *equalities, "</equality>", "</mujoco>", ""])
        return f"{head}\n<worldbody>\n{inside}\n</worldbody>\n{tail}"

    def inside(self, name: str) -> str:
        children = (self.body(part) for part in self.exact.parts if part.parent == name)
        return "\n".join([*self.sites.get(name, ()), *children])

    def body(self, part: Part) -> str:
        frame = self.numbers.placed(part)
        pose = f'pos="{self.numbers.lengths(frame.origin)}" quat="{self.numbers.quaternion(frame.turn)}"'
        inner = "".join(
            f"\n{line}" for line in (*self.joints(part), self.inside(part.name)) if line
        )
        return f'<body name="{part.name}" {pose}>{INERTIAL}{inner}</body>'

    def joints(self, part: Part) -> list[str]:
        if part.kind == "ball":
            return [f'<joint name="{part.name}_j" type="ball"/>']
        kind = "slide" if part.kind == "slide" else "hinge"
        return [
            f'<joint name="{part.name}_j{k}" type="{kind}" axis="{self.numbers.axis(part.name, axis)}"/>'
            for k, axis in enumerate(part.axes)
        ]

    def closure(self, closure: Closure) -> list[str]:
        points = [closure.point]
        if closure.kind == "pin" and not self.single:
            half = closure.axis * exactly(HALF_PIN)
            points = [closure.point + half, closure.point - half]
        kind = "weld" if closure.kind == "weld" else "connect"
        return [
            self.stated(kind, closure, p)
            if self.by_sites
            else self.derived(kind, closure, p)
            for p in points
        ]

    def derived(self, kind: str, closure: Closure, point: Vec) -> str:
        """The second frame is where the first one is in the file's pose."""
        first, second = closure.first, closure.second
        if first == GROUND and not self.exact.floating:
            first, second = second, first
        other = (
            "" if second == GROUND and not self.exact.floating else f' body2="{second}"'
        )
        anchor = (
            "" if kind == "weld" else f' anchor="{self.numbers.point(first, point)}"'
        )
        return f'<{kind} body1="{first}"{other}{anchor}/>'

    def stated(self, kind: str, closure: Closure, point: Vec) -> str:
        names = []
        for body in (closure.first, closure.second):
            name = f"site{sum(map(len, self.sites.values()))}"
            quat = (
                self.numbers.quaternion(self.numbers.frames[body].turn.T)
                if kind == "weld"
                else "1 0 0 0"
            )
            site = f'<site name="{name}" pos="{self.numbers.point(body, point)}" quat="{quat}"/>'
            self.sites.setdefault(body, []).append(site)
            names.append(name)
        return f'<{kind} site1="{names[0]}" site2="{names[1]}"/>'
