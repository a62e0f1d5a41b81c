"""SDF, the format of Gazebo: models of links and joints, also with loops.

A link may be the child of several joints.  One of them carries it, and the others close loops; since every joint is
stated at the pose in which all coordinates are zero, the loops are closed there exactly.  Numbers are taken from the
text, as in URDF.

Links, joints and named frames are all frames, each placed in another one by a pose.  What lies between two of them is
the way from one up to where both hang and down to the other, so inverses are exact, and what is common to both never
counts.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from math import radians
from typing import Any

from echelon.algebra import PER_PI, Polynomial, as_polynomial
from echelon.formats.literal import (
    DOUBLE_DIGITS,
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
from echelon.formats.mjcf.mjcf_numbers import (
    exact_angle,
    exact_number,
    placements,
    placements_of,
)
from echelon.formats.snapping import ANGLE_TOLERANCE, nearest_step, tiny_notes
from echelon.formats.urdf.exact_xml import ExactXml
from echelon.formats.urdf.sdf_vocabulary import MODEL_NAMES, SDF
from echelon.formats.vocabulary import unread
from echelon.robot import ClosureKind, MotionKind, linear
from echelon.shared import InputError, in_quotes, nearest_of

WORLD, MODEL = "world", "__model__"
_WORLDS_GRAVITY = "0 0 -9.8"  # of a world that states none, by the specification
_MOST_GENERAL = 2  # rotations by general angles that are multiplied exactly; products of more have too many terms
_AXIS_IN_JOINT = (
    1,
    5,
)  # from this version of the format on, axes are stated in the joint's frame


def read_sdf(
    root: Any, source: str, *, mimics: bool = True, model: str = ""
) -> LiteralTree:
    """The tree of the one model that moves in an SDF document, or of the one with a given name."""
    worlds = root.findall("world")
    found = [model for place in (root, *worlds) for model in place.findall("model")]
    models = [
        m
        for m in found
        if m.find("joint") is not None and not _says(m.findtext("static", "false"))
    ]
    names = [str(m.get("name")) for m in models]
    if not models:
        raise InputError("needs one model with joints, found none", source=source)
    if model and model not in names:
        raise InputError(
            f"there is no model '{model}' with joints{nearest_of(model, names)}",
            source=source,
        )
    if len(models) > 1 and not model:
        problem = f"several models have joints, {in_quotes(names)}: choose one by its name (--model {names[0]}, or model="
        raise InputError(f"{problem} of echelon.load)", source=source)
    chosen = models[names.index(model) if model else 0]
    gravity = worlds[0].findtext("gravity", _WORLDS_GRAVITY) if worlds else None
    return _SdfReader(root, chosen, source).read(gravity, mimics)


def _says(flag: str) -> bool:
    return flag.strip() in ("true", "1")


_SCREWS_TRAVEL = (
    "1"  # metres per turn of a screw that states no pitch, by the specification
)
_AXES = {
    "revolute": (MotionKind.ROTATION,),
    "continuous": (MotionKind.ROTATION,),
    "prismatic": (MotionKind.TRANSLATION,),
    "screw": (MotionKind.SCREW,),
    "universal": (MotionKind.ROTATION, MotionKind.ROTATION),
    "revolute2": (MotionKind.ROTATION, MotionKind.ROTATION),
}
_CLOSURES = {
    "revolute": ClosureKind.REVOLUTE,
    "continuous": ClosureKind.REVOLUTE,
    "prismatic": ClosureKind.PRISMATIC,
    "ball": ClosureKind.SPHERICAL,
    "fixed": ClosureKind.WELD,
}
_JOINT_TYPES = (*_AXES, "ball", "fixed")
_UP: Triple = (0, 0, 1)


@dataclass(frozen=True)
class _SdfFrame:
    """A frame of a model."""

    name: str
    kind: str  # tag of the element that states it
    carrier: (
        str  # the frame with which it moves; empty for a link, which moves by itself
    )
    base: str  # the frame in which its pose is stated
    pose: tuple[LiteralPlacement, ...]


@dataclass(frozen=True)
class _SdfJoint:
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


class _Frames(ExactXml):
    """All frames of a model, by name."""

    def __init__(self, source: str) -> None:
        super().__init__(source)
        self.known = {WORLD: _SdfFrame(WORLD, "world", "", "", ())}

    def place(self, frame: _SdfFrame) -> None:
        """One more frame, whose name nothing else has."""
        if frame.name in self.known:
            raise self.error(
                "this name occurs twice; names must be unique",
                f"{frame.kind} '{frame.name}'",
            )
        self.known[frame.name] = frame

    def link(self, name: str, element: str) -> str:
        """The link, or the world, that carries a frame."""
        seen: list[str] = []
        while self._known(name, element).carrier:
            if name in seen:
                raise self.error(
                    f"the frames {' -> '.join([*seen, name])} are attached in a circle",
                    element,
                )
            seen.append(name)
            name = self.known[name].carrier
        return name

    def between(
        self, start: str, end: str, element: str
    ) -> tuple[LiteralPlacement, ...]:
        """The placements from one frame to another one."""
        down, up = self._way(end, element), self._way(start, element)
        common = 0
        while common < min(len(down), len(up)) and down[common] == up[common]:
            common += 1
        inward = [
            replace(p, inverse=True)
            for name in reversed(up[common:])
            for p in reversed(self.known[name].pose)
        ]
        way = (*inward, *(p for name in down[common:] for p in self.known[name].pose))
        if sum(_is_general(p) for p in way) <= _MOST_GENERAL:
            return way
        frame = numeric_placements(way)  # several as one, rounded as doubles are
        x, y, z = (exact_number(round(float(v), DOUBLE_DIGITS)) for v in frame[:3, 3])
        return placements_of(element, (x, y, z), frame[:3, :3])

    def _way(self, name: str, element: str) -> list[str]:
        """From the world to a frame."""
        way: list[str] = []
        while name:
            if name in way:
                raise self.error(
                    f"the poses of {' -> '.join([*way, name])} refer to each other in a circle",
                    element,
                )
            way.append(name)
            name = self._known(name, element).base
        return way[::-1]

    def _known(self, name: str, element: str) -> _SdfFrame:
        if name not in self.known:
            raise self.error(
                f"there is no link, joint or frame '{name}'{nearest_of(name, self.known)}",
                element,
            )
        return self.known[name]

    # -- numbers ---------------------------------------------------------------------------------------------------

    def pose(self, element: Any, where: str) -> tuple[LiteralPlacement, ...]:
        """The pose that an element states."""
        stated = element.find("pose")
        text = "" if stated is None else (stated.text or "")
        if not text.strip():
            return ()
        turned = stated.get("rotation_format", "euler_rpy") == "quat_xyzw"
        numbers = [self.number(part, f"{where} pose") for part in text.split()]
        needed = 3 + (4 if turned else 3)  # a point, and a quaternion or three angles
        if len(numbers) != needed:
            raise self.error(
                f"needs {needed} numbers, found '{text.strip()}'",
                f"{where} pose",
            )
        x, y, z, *rest = numbers
        if turned and not any(rest):
            raise self.error("the quaternion is zero", f"{where} pose")
        if turned:
            return placements(
                f"{where} pose", (x, y, z), [float(rest[k]) for k in (3, 0, 1, 2)]
            )
        if _says(stated.get("degrees", "false")):
            rest = [exact_angle(radians(angle)) for angle in rest]
        roll, pitch, yaw = rest
        return (LiteralPlacement(f"{where} pose", (x, y, z), (roll, pitch, yaw)),)


class _SdfReader(_Frames):
    def __init__(self, root: Any, model: Any, source: str) -> None:
        super().__init__(source)
        self.model = model
        self.notes = [*unread(root, SDF, source), *unread(model, MODEL_NAMES, source)]
        version = tuple(
            int(part) if part.isdigit() else 0
            for part in root.get("version", "1.12").split(".")
        )
        self.axis_in_joint = version >= _AXIS_IN_JOINT
        self.links = dict(self._named("link"))
        self._add_frames()
        self.joints = [self._joint(name, joint) for name, joint in self._named("joint")]

    def read(self, gravity: str | None, mimics: bool) -> LiteralTree:
        order, carried = self._tree()
        position = {name: k for k, name in enumerate(order)}
        links = tuple(self._link(name, carried.get(name), position) for name in order)
        left = [joint for joint in self.joints if joint not in carried.values()]
        frames = [f for f in self.known.values() if f.kind == "frame"]
        stated = tuple(self._couplings())
        closures = tuple(self._closure(joint, position) for joint in left)
        self.notes += self._left_out()
        weightless = all(self._is_weightless(link) for link in self.links.values())
        return LiteralTree(
            self.model.get("name") or "robot",
            self.source,
            links,
            stated if mimics else (),
            (0, 0, 0)
            if weightless
            else self.triple(gravity, LiteralTree("", "", ()).gravity, "gravity"),
            (*self.notes, *tiny_notes(self.tiny)),
            root_is_world=True,
            closures=closures,
            poses={"zero": {}} if left else {},
            has_mimics=bool(stated),
            frames=tuple(self._frame(frame, position) for frame in frames),
        )

    # -- elements --------------------------------------------------------------------------------------------------

    def _named(self, tag: str) -> Iterator[tuple[str, Any]]:
        for element in self.model.findall(tag):
            if not element.get("name"):
                raise self.error(f"a <{tag}> has no name")
            yield str(element.get("name")), element

    def _add_frames(self) -> None:
        """The frames of the model, its links, its joints, and those that it names."""
        where = f"model '{self.model.get('name')}'"
        found = [
            tag for tag in ("model", "include") if self.model.find(tag) is not None
        ]
        if self.model.get("placement_frame"):
            found.append("placement_frame")
        if found or not self.links:
            problem = (
                f"has <{found[0]}>, which is not read: write one model of links"
                if found
                else "has no links"
            )
            raise self.error(problem, where)
        carrier = self.model.get("canonical_link") or next(iter(self.links))
        self.place(
            _SdfFrame(MODEL, "model", carrier, WORLD, self.pose(self.model, where))
        )
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
        placed = self.pose(element, f"{element.tag} '{name}'")
        self.place(_SdfFrame(name, element.tag, carrier, base, placed))

    def _end(self, joint: Any, tag: str, where: str) -> str:
        text = joint.findtext(tag)
        if not text or not text.strip():
            raise self.error(f"needs <{tag}>, the name of a link or frame", where)
        return str(text).strip()

    def _joint(self, name: str, joint: Any) -> _SdfJoint:
        where, kind = f"joint '{name}'", joint.get("type")
        if kind not in _JOINT_TYPES:
            valid = ", ".join(_JOINT_TYPES)
            raise self.error(
                f"unknown or unsupported joint type '{kind}' (valid: {valid})", where
            )
        parent, child = (
            self.link(self._end(joint, tag, where), where)
            for tag in ("parent", "child")
        )
        if parent == child:
            raise self.error(
                f"connects link '{parent}' with itself: name another <parent>", where
            )
        return _SdfJoint(where, name, kind, parent, child, joint)

    # -- tree ------------------------------------------------------------------------------------------------------

    def _tree(self) -> tuple[list[str], dict[str, _SdfJoint]]:
        """The world and the links in depth-first order, and the joint that carries each link."""
        kept = self._spanning()
        start = WORLD
        if not any(WORLD in (joint.parent, joint.child) for joint in self.joints):
            children = {joint.child for joint in self.joints}
            start = next(
                (link for link in self.links if link not in children),
                next(iter(self.links)),
            )
            self.notes.append(
                f"nothing holds link '{start}' in the world; it is read as fixed (--floating frees it)"
            )
        order, carried, pending = [WORLD], dict[str, _SdfJoint](), [start]
        while pending:
            link = pending.pop()
            order += [] if link == WORLD else [link]
            next_ones = [
                joint
                for joint in kept
                if link in (joint.parent, joint.child)
                and carried.get(link) is not joint
            ]
            carried |= {joint.other(link): joint for joint in next_ones}
            pending += [joint.other(link) for joint in reversed(next_ones)]
        lost = [name for name in self.links if name not in order]
        if lost:
            raise self.error(
                "no joint connects it with the others: add one, such as a fixed joint, or take the link out",
                f"link '{lost[0]}'",
            )
        return order, carried

    def _spanning(self) -> list[_SdfJoint]:
        """Joints that form a tree, in the order of the file."""
        # of each loop the last one is left out that can close it
        part = {name: name for name in (WORLD, *self.links)}
        kept: list[_SdfJoint] = []
        for joint in sorted(self.joints, key=lambda joint: joint.kind in _CLOSURES):
            one, two = part[joint.parent], part[joint.child]
            if one != two:
                part = {name: one if of == two else of for name, of in part.items()}
                kept.append(joint)
        return [joint for joint in self.joints if joint in kept]

    def _link(
        self, name: str, joint: _SdfJoint | None, position: dict[str, int]
    ) -> LiteralLink:
        if name == WORLD:
            return LiteralLink(WORLD, -1, "", "root", ())
        if joint is None:
            return LiteralLink(
                name,
                0,
                name,
                "fixed",
                self.between(WORLD, name, name),
                self._inertial(name),
            )
        carrier = joint.other(name)
        steps = (
            *self.between(carrier, joint.name, joint.element),
            *self._motions(joint, backwards=carrier == joint.child),
            *self.between(joint.name, name, joint.element),
        )
        return LiteralLink(
            name, position[carrier], joint.name, joint.kind, steps, self._inertial(name)
        )

    # -- links -----------------------------------------------------------------------------------------------------

    def _frame(self, frame: _SdfFrame, position: dict[str, int]) -> LiteralFrame:
        where = f"{frame.kind} '{frame.name}'"
        link = self.link(frame.name, where)
        return LiteralFrame(
            frame.name, position[link], self.between(link, frame.name, where)
        )

    @staticmethod
    def _is_weightless(link: Any) -> bool:
        return not _says(link.findtext("gravity", "true"))

    def _left_out(self) -> Iterator[str]:
        """Notes about what links state and no rigid body has."""
        weightless = [
            name for name, link in self.links.items() if self._is_weightless(link)
        ]
        fluid = [
            name
            for name, link in self.links.items()
            if link.find("inertial/fluid_added_mass") is not None
        ]
        shaped = [
            name for name, link in self.links.items() if self._by_collisions(link)
        ]
        if weightless and len(weightless) < len(self.links):
            yield f"gravity counts for all links, though the file switches it off for {in_quotes(weightless)}"
        if fluid:
            yield f"ignored, since rigid-body parameters do not cover it: added mass of fluid of {in_quotes(fluid)}"
        if shaped:
            yield f"inertias of {in_quotes(shaped)} are unknown: the file leaves them to collisions"

    @staticmethod
    def _by_collisions(link: Any) -> bool:
        element = link.find("inertial")
        return element is not None and _says(element.get("auto", "false"))

    def _inertial(self, name: str) -> tuple[float, ...] | None:
        where, element = f"link '{name}' inertial", self.links[name].find("inertial")
        if element is None or self._by_collisions(self.links[name]):
            return None

        def number(path: str, usual: str) -> float:
            return float(self.number(element.findtext(path, usual), f"{where} {path}"))

        moments = [
            number(f"inertia/i{a}{b}", "1" if a == b else "0")
            for a, b in ("xx", "xy", "xz", "yy", "yz", "zz")
        ]
        frame = numeric_placements(self.pose(element, where))
        return central_inertial(
            number("mass", "1"), frame[:3, 3], moments, frame[:3, :3]
        )

    # -- joints ----------------------------------------------------------------------------------------------------

    def _motions(self, joint: _SdfJoint, backwards: bool) -> tuple[LiteralStep, ...]:
        """The motions of a joint, seen from the link that carries the other one."""
        if joint.kind == "ball":
            return (LiteralMotion(joint.element, joint.name, MotionKind.BALL),)
        motions: list[LiteralStep] = []
        kinds = _AXES.get(joint.kind, ())
        for number, kind in enumerate(kinds, 1):
            turns, axis = self._axis(joint, "axis" if number == 1 else f"axis{number}")
            x, y, z = (-v for v in axis) if backwards else axis
            name = joint.name if len(kinds) == 1 else f"{joint.name}.{number}"
            pitch = self._pitch(joint) if kind is MotionKind.SCREW else Polynomial({})
            motions.append(
                LiteralMotion(joint.element, name, kind, (x, y, z), turns, pitch)
            )
        return tuple(reversed(motions) if backwards else motions)

    def _pitch(self, joint: _SdfJoint) -> Polynomial:
        """Travel of a screw along its axis, m/rad."""
        per_turn, old = (
            joint.data.findtext(tag) for tag in ("screw_thread_pitch", "thread_pitch")
        )
        if (
            per_turn is None and old is not None
        ):  # radians per metre, positive for a left-handed thread
            radians = self.number(old, f"{joint.element} thread_pitch")
            if not radians:
                problem = "zero radians per metre: state <screw_thread_pitch>, in metres per turn"
                raise self.error(problem, f"{joint.element} thread_pitch")
            return Polynomial.constant(-1 / Fraction(radians))
        if per_turn is None:
            self.notes.append(
                f"{joint.element} states no screw_thread_pitch: by the specification, it is 1 m per turn"
            )
        travel = self.number(
            per_turn or _SCREWS_TRAVEL, f"{joint.element} screw_thread_pitch"
        )
        return Polynomial.generator(PER_PI) * (Fraction(travel) / 2)

    def _axis(
        self, joint: _SdfJoint, tag: str
    ) -> tuple[tuple[LiteralPlacement, ...], Triple]:
        """The frame in which an axis is stated, as turns of the joint's frame, and the axis in it."""
        where = f"{joint.element} {tag}"
        element = joint.data.find(tag)
        if element is None:
            raise self.error(f"needs <{tag}> with <xyz>, such as 0 0 1", joint.element)
        direction = element.find("xyz")
        axis = self.triple(
            None if direction is None else direction.text, _UP, f"{where} xyz"
        )
        if not any(axis):
            raise self.error(
                "the axis is zero; it needs a direction such as 0 0 1", f"{where} xyz"
            )
        stated = None if direction is None else direction.get("expressed_in")
        in_model = element.findtext(
            "use_parent_model_frame", "false" if self.axis_in_joint else "true"
        )
        if not stated and not _says(in_model):
            return (), axis
        turns = self.between(joint.name, stated or MODEL, where)
        return tuple(replace(turn, xyz=(0, 0, 0)) for turn in turns), axis

    def _closure(self, joint: _SdfJoint, position: Mapping[str, int]) -> LiteralClosure:
        """A joint that closes a loop: its frame on both links, and its axis."""
        if joint.kind not in _CLOSURES:
            kinds = ", ".join(_CLOSURES)
            problem = f"it closes a loop, which a {joint.kind} joint cannot (these can: {kinds}): give that loop one of these"
            raise self.error(problem, joint.element)
        axis = None
        if joint.kind in _AXES:
            turns, direction = self._axis(joint, "axis")
            axis = LiteralMotion(
                joint.element, joint.name, MotionKind.ROTATION, direction, turns
            )
        one, two = (
            self.between(end, joint.name, joint.element)
            for end in (joint.parent, joint.child)
        )
        first, second = position[joint.parent], position[joint.child]
        return LiteralClosure(
            joint.element,
            joint.name,
            _CLOSURES[joint.kind],
            first,
            second,
            one,
            two,
            axis,
        )

    def _couplings(self) -> Iterator[StatedCoupling]:
        """The couplings that mimic elements state."""
        for joint in self.joints:
            mimic = joint.data.find("axis/mimic")
            if mimic is None:
                continue
            where, leader = f"{joint.element} mimic", str(mimic.get("joint") or "")
            led = next((other for other in self.joints if other.name == leader), None)
            for role in (joint, led):
                if role is None or len(_AXES.get(role.kind, ())) != 1:
                    raise self.error(
                        f"joint '{role.name if role else leader}' has not one axis, as both joints of a mimic need",
                        where,
                    )
            ratio, offset, reference = (
                self.number(mimic.findtext(key, usual), f"{where} {key}")
                for key, usual in (
                    ("multiplier", "1"),
                    ("offset", "0"),
                    ("reference", "0"),
                )
            )
            constant = as_polynomial(offset - ratio * reference)
            if constant and joint.kind == "screw":
                raise self.error(
                    "a screw follows others without an offset: put it into the poses of the links",
                    where,
                )
            yield StatedCoupling(
                where, joint.name, {leader: linear(as_polynomial(ratio))}, constant
            )


def _is_general(placement: LiteralPlacement) -> bool:
    """Whether a placement turns by angles other than multiples of 15°."""
    return any(
        abs(angle - nearest_step(angle)) > ANGLE_TOLERANCE
        for angle in map(float, placement.rpy)
    )
