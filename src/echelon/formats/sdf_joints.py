"""Joints of SDF models: their motions along the tree, and as closures of loops."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import atan2, hypot
from typing import Any

from echelon.exact.polynomial import as_polynomial
from echelon.formats.literal import LiteralClosure, LiteralMotion, LiteralPlacement, LiteralStep, Triple
from echelon.formats.mjcf_numbers import exact_angle
from echelon.formats.sdf_frames import MODEL, SdfFrames
from echelon.formats.stated_couplings import StatedCoupling
from echelon.mechanism.closure import ClosureKind
from echelon.mechanism.joint import MotionKind
from echelon.mechanism.spline import linear

_AXES = {
    "revolute": (MotionKind.ROTATION,),
    "continuous": (MotionKind.ROTATION,),
    "prismatic": (MotionKind.TRANSLATION,),
    "universal": (MotionKind.ROTATION, MotionKind.ROTATION),
    "revolute2": (MotionKind.ROTATION, MotionKind.ROTATION),
}
CLOSURES = {
    "revolute": ClosureKind.REVOLUTE,
    "continuous": ClosureKind.REVOLUTE,
    "prismatic": ClosureKind.PRISMATIC,
    "ball": ClosureKind.SPHERICAL,
    "fixed": ClosureKind.WELD,
}
JOINT_TYPES = (*_AXES, "ball", "fixed")
_UP: Triple = (0, 0, 1)


@dataclass(frozen=True)
class SdfJoint:
    """A joint between two links, or a link and the world."""

    element: str
    name: str
    kind: str
    parent: str
    child: str
    data: Any

    def other(self, link: str) -> str:
        """The link at the other end."""
        return self.child if link == self.parent else self.parent


class SdfJoints:
    """Reads joints of a model."""

    def __init__(self, frames: SdfFrames, axis_in_joint: bool) -> None:
        self.frames, self.axis_in_joint = frames, axis_in_joint

    def motions(self, joint: SdfJoint, backwards: bool) -> tuple[LiteralStep, ...]:
        """The motions of a joint, seen from the link that carries the other one."""
        if joint.kind == "ball":
            return (LiteralMotion(joint.element, joint.name, MotionKind.BALL),)
        steps: list[LiteralStep] = []
        kinds = _AXES.get(joint.kind, ())
        for number, kind in enumerate(kinds, 1):
            turned, axis = self._axis(joint, "axis" if number == 1 else f"axis{number}")
            x, y, z = (-v for v in axis) if backwards else axis
            name = joint.name if len(kinds) == 1 else f"{joint.name}.{number}"
            motion: list[LiteralStep] = [*turned, LiteralMotion(joint.element, name, kind, (x, y, z)), *_undone(turned)]
            steps = motion + steps if backwards else steps + motion
        return tuple(steps)

    def _axis(self, joint: SdfJoint, tag: str) -> tuple[tuple[LiteralPlacement, ...], Triple]:
        """The frame in which an axis is stated, as turns of the joint's frame, and the axis in it."""
        where = f"{joint.element} {tag}"
        element = joint.data.find(tag)
        if element is None:
            raise self.frames.error(f"needs <{tag}>", joint.element)
        direction = element.find("xyz")
        axis = self.frames.triple(None if direction is None else direction.text, _UP, f"{where} xyz")
        if not any(axis):
            raise self.frames.error("the axis is zero; it needs a direction such as 0 0 1", f"{where} xyz")
        stated = None if direction is None else direction.get("expressed_in")
        in_model = element.findtext("use_parent_model_frame", "false" if self.axis_in_joint else "true")
        if not stated and in_model.strip() not in ("true", "1"):
            return (), axis
        turns = self.frames.between(joint.name, stated or MODEL, where)
        return tuple(replace(turn, xyz=(0, 0, 0)) for turn in turns), axis

    def closure(self, joint: SdfJoint, position: Mapping[str, int]) -> LiteralClosure:
        """A joint that closes a loop: its frame on both links, with z along its axis."""
        if joint.kind not in CLOSURES:
            kinds = ", ".join(CLOSURES)
            raise self.frames.error(f"a {joint.kind} joint cannot close a loop (these can: {kinds})", joint.element)
        aim: tuple[LiteralPlacement, ...] = ()
        if joint.kind in _AXES:
            turned, axis = self._axis(joint, "axis")
            x, y, z = (float(v) for v in axis)
            along = LiteralPlacement(
                f"{joint.element} axis", rpy=(0, exact_angle(atan2(hypot(x, y), z)), exact_angle(atan2(y, x)))
            )
            aim = (*turned, along)
        one, two = ((*self.frames.between(end, joint.name, joint.element), *aim) for end in (joint.parent, joint.child))
        first, second = position[joint.parent], position[joint.child]
        return LiteralClosure(joint.element, joint.name, CLOSURES[joint.kind], first, second, one, two)

    def couplings(self, joints: Sequence[SdfJoint]) -> Iterator[StatedCoupling]:
        """What mimic elements say."""
        for joint in joints:
            mimic = joint.data.find("axis/mimic")
            if mimic is None:
                continue
            where, leader = f"{joint.element} mimic", str(mimic.get("joint") or "")
            led = next((other for other in joints if other.name == leader), None)
            for role in (joint, led):
                if role is None or len(_AXES.get(role.kind, ())) != 1:
                    raise self.frames.error(f"joint '{role.name if role else leader}' has not one axis", where)
            ratio, offset, reference = (
                self.frames.number(mimic.findtext(key, usual), f"{where} {key}")
                for key, usual in (("multiplier", "1"), ("offset", "0"), ("reference", "0"))
            )
            constant = as_polynomial(offset - ratio * reference)
            yield StatedCoupling(where, joint.name, {leader: linear(as_polynomial(ratio))}, constant)


def _undone(turns: tuple[LiteralPlacement, ...]) -> tuple[LiteralPlacement, ...]:
    return tuple(replace(turn, inverse=not turn.inverse) for turn in reversed(turns))
