"""SDF, the format of Gazebo: models of links and joints, also with loops.

A link may be the child of several joints.  One of them carries it, and the others close loops; since every joint is
stated at the pose in which all coordinates are zero, the loops are closed there exactly.  Numbers are taken from the
text, as in URDF.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from echelon.errors import InputError
from echelon.exact.numbers import Rational
from echelon.formats.inertia import central_inertial, numeric_placement
from echelon.formats.literal import (
    LiteralFrame,
    LiteralLink,
    LiteralTree,
    Triple,
)
from echelon.formats.sdf_frames import MODEL, WORLD, SdfFrame, SdfFrames
from echelon.formats.sdf_joints import CLOSURES, JOINT_TYPES, SdfJoint, SdfJoints

_AXIS_IN_JOINT = (1, 5)  # from this version of the format on, axes are stated in the joint's frame


def read_sdf(root: Any, source: str, *, mimics: bool = True) -> LiteralTree:
    """The tree of an SDF document with one model that moves."""
    worlds = root.findall("world")
    models = [m for place in (root, *worlds) for m in place.findall("model") if m.find("joint") is not None]
    if len(models) != 1:
        names = ", ".join(f"'{m.get('name')}'" for m in models) or "none"
        raise InputError(f"needs one model with joints, found {names}", source=source)
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
            raise self.frames.error(f"needs <{tag}>", where)
        return str(text).strip()

    def _joint(self, name: str, joint: Any) -> SdfJoint:
        where, kind = f"joint '{name}'", joint.get("type")
        if kind not in JOINT_TYPES:
            valid = ", ".join(JOINT_TYPES)
            raise self.frames.error(f"unknown or unsupported joint type '{kind}' (valid: {valid})", where)
        parent, child = (self.frames.link(self._end(joint, tag, where), where) for tag in ("parent", "child"))
        if parent == child:
            raise self.frames.error(f"connects link '{parent}' with itself", where)
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
            raise self.frames.error("no joint connects it with the others", f"link '{lost[0]}'")
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
        rotation, centre = np.eye(3), np.zeros(3)
        for placement in self.frames.pose(element, where):
            turned, shifted = numeric_placement(placement)
            centre, rotation = centre + rotation @ shifted, rotation @ turned
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        return tuple(float(v) for v in central_inertial(mass, centre, tensor, rotation))
