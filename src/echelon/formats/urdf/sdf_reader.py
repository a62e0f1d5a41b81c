"""SDF, the format of Gazebo: models of links and joints, also with loops.

A link may be the child of several joints.  One of them carries it, and the others close loops; since every joint is
stated at the pose in which all coordinates are zero, the loops are closed there exactly.  Numbers are taken from the
text, as in URDF.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import atan2, hypot
from typing import Any

import numpy as np

from echelon.errors import InputError
from echelon.exact.numbers import Rational
from echelon.exact.polynomial import as_polynomial
from echelon.formats.literal import (
    LiteralClosure,
    LiteralFrame,
    LiteralLink,
    LiteralMotion,
    LiteralPlacement,
    LiteralStep,
    LiteralTree,
    StatedCoupling,
    Triple,
    central_inertial,
    numeric_placements,
)
from echelon.formats.mjcf.mjcf_numbers import exact_angle
from echelon.formats.urdf.sdf_frames import MODEL, WORLD, SdfFrame, SdfFrames
from echelon.mechanism.closure import ClosureKind
from echelon.mechanism.coupling import linear
from echelon.mechanism.joint import MotionKind

_AXIS_IN_JOINT = (1, 5)  # from this version of the format on, axes are stated in the joint's frame


def read_sdf(root: Any, source: str, *, mimics: bool = True) -> LiteralTree:
    """The tree of an SDF document with one model that moves."""
    worlds = root.findall("world")
    models = [m for place in (root, *worlds) for m in place.findall("model") if m.find("joint") is not None]
    if len(models) != 1:
        names = ", ".join(f"'{m.get('name')}'" for m in models) or "none"
        problem = f"needs one model with joints, found {names}: keep one, with its joints, in the file"
        raise InputError(problem, source=source)
    gravity = worlds[0].find("gravity") if worlds else None
    return _Reader(root, models[0], source).read(None if gravity is None else gravity.text, mimics)


class _Reader:
    def __init__(self, root: Any, model: Any, source: str) -> None:
        self.model, self.source = model, source
        self.frames = SdfFrames(source)
        self.notes: list[str] = []
        version = tuple(int(part) if part.isdigit() else 0 for part in root.get("version", "1.12").split("."))
        self.reader = SdfJoints(self.frames, version >= _AXIS_IN_JOINT)
        self.links = dict(self._named("link"))
        self._add_frames()
        self.joints = [self._joint(name, joint) for name, joint in self._named("joint")]

    def read(self, gravity: str | None, mimics: bool) -> LiteralTree:
        order, carried = self._tree()
        position = {name: k for k, name in enumerate(order)}
        links = tuple(self._link(name, carried.get(name), position) for name in order)
        left = [joint for joint in self.joints if joint not in carried.values()]
        frames = [f for f in self.frames.known.values() if f.kind == "frame"]
        stated = tuple(self.reader.couplings(self.joints))
        usual: Triple = LiteralTree("", "", ()).gravity
        return LiteralTree(
            self.model.get("name") or "robot",
            self.source,
            links,
            stated if mimics else (),
            self.frames.triple(gravity, usual, "gravity"),
            tuple(self.notes),
            root_is_world=True,
            closures=tuple(self.reader.closure(joint, position) for joint in left),
            poses={"zero": {}} if left else {},
            has_mimics=bool(stated),
            frames=tuple(self._frame(frame, position) for frame in frames),
        )

    # -- elements --------------------------------------------------------------------------------------------------

    def _named(self, tag: str) -> Iterator[tuple[str, Any]]:
        for element in self.model.findall(tag):
            if not element.get("name"):
                raise self.frames.error(f"a <{tag}> has no name")
            yield str(element.get("name")), element

    def _add_frames(self) -> None:
        """The frames of the model, its links, its joints, and those that it names."""
        where = f"model '{self.model.get('name')}'"
        found = [tag for tag in ("model", "include", "gripper") if self.model.find(tag) is not None]
        found += ["placement_frame"] if self.model.get("placement_frame") else []
        if found or not self.links:
            problem = f"has <{found[0]}>, which is not read: write one model of links" if found else "has no links"
            raise self.frames.error(problem, where)
        carrier = self.model.get("canonical_link") or next(iter(self.links))
        self.frames.add(SdfFrame(MODEL, "model", carrier, WORLD, self.frames.pose(self.model, where)))
        for name, link in self._named("link"):
            self._add(name, link, "", MODEL)
        for name, joint in self._named("joint"):
            child = self._end(joint, "child", f"joint '{name}'")
            self._add(name, joint, child, child)
        for name, frame in self._named("frame"):
            carrier = frame.get("attached_to") or MODEL
            self._add(name, frame, carrier, carrier)

    def _add(self, name: str, element: Any, carrier: str, usual: str) -> None:
        pose = element.find("pose")
        base = (None if pose is None else pose.get("relative_to")) or usual
        placed = self.frames.pose(element, f"{element.tag} '{name}'")
        self.frames.add(SdfFrame(name, element.tag, carrier, base, placed))

    def _end(self, joint: Any, tag: str, where: str) -> str:
        text = joint.findtext(tag)
        if not text or not text.strip():
            raise self.frames.error(f"needs <{tag}>, the name of a link or frame", where)
        return str(text).strip()

    def _joint(self, name: str, joint: Any) -> SdfJoint:
        where, kind = f"joint '{name}'", joint.get("type")
        if kind not in JOINT_TYPES:
            valid = ", ".join(JOINT_TYPES)
            raise self.frames.error(f"unknown or unsupported joint type '{kind}' (valid: {valid})", where)
        parent, child = (self.frames.link(self._end(joint, tag, where), where) for tag in ("parent", "child"))
        if parent == child:
            raise self.frames.error(f"connects link '{parent}' with itself: name another <parent>", where)
        return SdfJoint(where, name, kind, parent, child, joint)

    # -- tree ------------------------------------------------------------------------------------------------------

    def _tree(self) -> tuple[list[str], dict[str, SdfJoint]]:
        """The world and the links in depth-first order, and the joint that carries each link."""
        kept = self._spanning()
        start = WORLD
        if not any(WORLD in (joint.parent, joint.child) for joint in self.joints):
            children = {joint.child for joint in self.joints}
            start = next((link for link in self.links if link not in children), next(iter(self.links)))
            self.notes.append(f"nothing holds link '{start}' in the world; it is read as fixed (--floating frees it)")
        order, carried, pending = [WORLD], dict[str, SdfJoint](), [start]
        while pending:
            link = pending.pop()
            order += [] if link == WORLD else [link]
            next_ones = [
                joint for joint in kept if link in (joint.parent, joint.child) and carried.get(link) is not joint
            ]
            carried |= {joint.other(link): joint for joint in next_ones}
            pending += [joint.other(link) for joint in reversed(next_ones)]
        lost = [name for name in self.links if name not in order]
        if lost:
            raise self.frames.error(
                "no joint connects it with the others: add one, such as a fixed joint, or take the link out",
                f"link '{lost[0]}'",
            )
        return order, carried

    def _spanning(self) -> list[SdfJoint]:
        """Joints that form a tree, in the order of the file.

        Of each loop the last one is left out that can close it.
        """
        part = {name: name for name in (WORLD, *self.links)}
        kept: list[SdfJoint] = []
        for joint in sorted(self.joints, key=lambda joint: joint.kind in CLOSURES):
            one, two = part[joint.parent], part[joint.child]
            if one != two:
                part = {name: one if of == two else of for name, of in part.items()}
                kept.append(joint)
        return [joint for joint in self.joints if joint in kept]

    def _link(self, name: str, joint: SdfJoint | None, position: dict[str, int]) -> LiteralLink:
        if name == WORLD:
            return LiteralLink(WORLD, -1, "", "root", ())
        if joint is None:
            return LiteralLink(name, 0, name, "fixed", self.frames.between(WORLD, name, name), self._inertial(name))
        carrier = joint.other(name)
        steps = (
            *self.frames.between(carrier, joint.name, joint.element),
            *self.reader.motions(joint, backwards=carrier == joint.child),
            *self.frames.between(joint.name, name, joint.element),
        )
        return LiteralLink(name, position[carrier], joint.name, joint.kind, steps, self._inertial(name))

    # -- links -----------------------------------------------------------------------------------------------------

    def _frame(self, frame: SdfFrame, position: dict[str, int]) -> LiteralFrame:
        where = f"{frame.kind} '{frame.name}'"
        link = self.frames.link(frame.name, where)
        return LiteralFrame(frame.name, position[link], self.frames.between(link, frame.name, where))

    def _inertial(self, name: str) -> tuple[float, ...] | None:
        where, element = f"link '{name}' inertial", self.links[name].find("inertial")
        if element is None:
            return None

        def number(path: str, usual: str) -> Rational:
            return self.frames.number(element.findtext(path, usual), f"{where} {path}")

        mass = float(number("mass", "1"))
        xx, yy, zz = (float(number(f"inertia/i{k}", "1")) for k in ("xx", "yy", "zz"))
        xy, xz, yz = (float(number(f"inertia/i{k}", "0")) for k in ("xy", "xz", "yz"))
        rotation, centre = numeric_placements(self.frames.pose(element, where))
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        return tuple(float(v) for v in central_inertial(mass, centre, tensor, rotation))


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
            raise self.frames.error(f"needs <{tag}> with <xyz>, such as 0 0 1", joint.element)
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
            problem = (
                f"it closes a loop, which a {joint.kind} joint cannot (these can: {kinds}): give that loop one of these"
            )
            raise self.frames.error(problem, joint.element)
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
                    raise self.frames.error(
                        f"joint '{role.name if role else leader}' has not one axis, as both joints of a mimic need",
                        where,
                    )
            ratio, offset, reference = (
                self.frames.number(mimic.findtext(key, usual), f"{where} {key}")
                for key, usual in (("multiplier", "1"), ("offset", "0"), ("reference", "0"))
            )
            constant = as_polynomial(offset - ratio * reference)
            yield StatedCoupling(where, joint.name, {leader: linear(as_polynomial(ratio))}, constant)


def _undone(turns: tuple[LiteralPlacement, ...]) -> tuple[LiteralPlacement, ...]:
    return tuple(replace(turn, inverse=not turn.inverse) for turn in reversed(turns))
