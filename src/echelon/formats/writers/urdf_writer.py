"""URDF with identified inertials: the file that a robot was read from, or one made from the geometry alone.

The user's file is more than its inertias: meshes, limits, comments, tags of other programs.  So it is edited, not
printed anew.  A link that counts as part of another loses its inertial, since its mass is in the other's now.

For robots that came as a description, a link's frame in URDF is where its joint ends.  Whatever a description places
after the last motion moves into the inertial and the joints that follow.  A joint of several motions becomes several
joints with massless links between.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import reduce
from typing import Any

import numpy as np

from echelon.algebra import as_polynomial
from echelon.formats.literal import roll_pitch_yaw
from echelon.formats.urdf.urdf_reader import SINGLE_AXIS, stated_number
from echelon.formats.writers.description_writer import expression_text
from echelon.formats.writers.identified_values import (
    ROTOR,
    IdentifiedValues,
    JointEffects,
    Load,
    has_centre,
    head_comment,
    joint_effects,
    kept_notes,
    load_of,
    number_text,
    reading_notes,
    rotor_doubts,
    rotor_notes,
)
from echelon.formats.writers.xml_editor import XmlEditor, quoted
from echelon.robot import (
    GROUND,
    ORIGIN,
    Body,
    JointNumber,
    Mechanism,
    Motion,
    MotionKind,
    Placement,
    known_values,
    move,
    placement_matrix,
)
from echelon.shared import Floats, InputError, in_quotes, unused

FORMAT = "URDF"
DYNAMICS = {JointNumber.DAMPING: "damping", JointNumber.DRY: "friction"}
"""What the element <dynamics> can say; URDF has nothing for the inertia of a rotor."""
_MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def inertial_lines(load: Load) -> list[str]:
    """The element <inertial> of a load, along the axes of the link's frame."""
    moments = " ".join(
        f'{name}="{number_text(v)}"'
        for name, v in zip(_MOMENTS, load.moments, strict=True)
    )
    return [
        "<inertial>",
        f'  <origin xyz="{number_text(*load.centre)}" rpy="0 0 0"/>',
        f'  <mass value="{number_text(load.mass)}"/>',
        f"  <inertia {moments}/>",
        "</inertial>",
    ]


class UrdfEditor:
    """Puts identified values in the place of those of a URDF document."""

    def __init__(
        self, mechanism: Mechanism, values: IdentifiedValues, text: str, source: str
    ) -> None:
        self.mechanism = mechanism
        self.values = values
        self.editor = XmlEditor(text, source)
        self.source = source
        self.links = {str(e.get("name")): e for e in self.editor.root.findall("link")}
        self.joints = {str(e.get("name")): e for e in self.editor.root.findall("joint")}
        self.carriers = {
            _end(joint, "child"): _end(joint, "parent")
            for joint in self.joints.values()
        }
        self.bodies = {
            b.name: k for k, b in enumerate(mechanism.bodies) if b.joint.kind != ROTOR
        }

    def written(
        self, remarks: Sequence[str]
    ) -> tuple[str, tuple[str, ...], tuple[str, ...]]:
        """The document, notes, and doubts."""
        strange = next((name for name in self.bodies if name not in self.links), None)
        if strange is not None:
            raise InputError(
                "the file has no such link",
                source=self.source,
                element=f"body '{strange}'",
            )
        notes = [*remarks, *self._write_links()]
        single = {
            name
            for name, joint in self.joints.items()
            if joint.get("type") in SINGLE_AXIS
        }
        effects = joint_effects(
            self.mechanism, self.values.effects, DYNAMICS, single, FORMAT
        )
        notes += self._write_dynamics(effects)
        notes += effects.notes
        notes += reading_notes(self.mechanism, self.values, self.editor.root, FORMAT)
        self.editor.insert_first(self.editor.root, head_comment(notes))
        doubts = rotor_doubts(self.mechanism, self.values, effects, FORMAT)
        return self.editor.result(), tuple(notes), doubts

    # -- links -----------------------------------------------------------------------------------------------------

    def _write_links(self) -> Iterator[str]:
        lumped: list[str] = []
        massless: list[str] = []
        for name, link in self.links.items():
            inertials = link.findall("inertial")
            body = self._body_of(name)
            if body in self.values.kept:
                continue
            load = (
                load_of(self.values.bodies[self.bodies[name]], name)
                if name in self.bodies
                else None
            )
            if load is not None:
                self._write_inertial(link, inertials, load)
            elif body is not None:
                (massless if name in self.bodies else lumped).extend(
                    [name] if inertials else []
                )
                for element in inertials:
                    self.editor.remove(element)
        if lumped:
            reason = "no inertial of their own, since they count as part of the link that they are fixed to"
            yield f"{reason}: {in_quotes(lumped)}"
        if massless:
            yield f"no inertial, since they carry no parameters or zero: {in_quotes(massless)}"

    def _body_of(self, link: str) -> str | None:
        """The body that a link is or is fixed to; None of the world."""
        while link in self.carriers and link not in self.bodies:
            link = self.carriers[link]
        return link if link in self.bodies else None

    def _write_inertial(self, link: Any, inertials: list[Any], load: Load) -> None:
        if not inertials:
            self.editor.insert_first(link, inertial_lines(load))
            return
        first, *others = inertials
        for element in others:
            self.editor.remove(element)
        place = {"xyz": number_text(*load.centre), "rpy": "0 0 0"}
        origin = first.find("origin")
        if origin is None:
            self.editor.insert_first(
                first, [f'<origin xyz="{place["xyz"]}" rpy="0 0 0"/>']
            )
        elif set(origin.keys()) <= place.keys():
            self.editor.set_attributes(origin, place)
        else:  # another notation of the orientation would contradict this one
            self.editor.replace(origin, f'<origin xyz="{place["xyz"]}" rpy="0 0 0"/>')
        self.editor.set_attributes(
            first.find("mass"), {"value": number_text(load.mass)}
        )
        moments = {
            name: number_text(v) for name, v in zip(_MOMENTS, load.moments, strict=True)
        }
        self.editor.set_attributes(first.find("inertia"), moments)

    # -- joints ----------------------------------------------------------------------------------------------------

    def _write_dynamics(self, effects: JointEffects) -> Iterator[str]:
        stated: dict[str, dict[str, float]] = {}
        for name, joint in self.joints.items():
            numbers = effects.attributes.get(name, {})
            written = {key: number_text(value) for key, value in numbers.items()}
            element = joint.find("dynamics")
            if element is not None:
                stated[name] = {
                    key: stated_number(element.get(key)) for key in DYNAMICS.values()
                }
                self.editor.set_attributes(element, written)
            elif written:
                attributes = "".join(
                    f' {key}="{value}"' for key, value in written.items()
                )
                self.editor.insert_first(joint, [f"<dynamics{attributes}/>"])
        yield from kept_notes(stated, effects.attributes)


def _end(joint: Any, tag: str) -> str:
    return str(joint.find(tag).get("link"))


_TYPES = {MotionKind.ROTATION: "continuous", MotionKind.TRANSLATION: "prismatic"}
_FLOATING = (MotionKind.TRANSLATION,) * 3 + (MotionKind.BALL,)
_UNLIMITED = '<limit lower="-1e9" upper="1e9" effort="1e9" velocity="1e9"/>'
_USUAL_GRAVITY = (0, 0, Fraction(-981, 100))


def urdf_obstacle(mechanism: Mechanism, values: IdentifiedValues) -> str:
    """The reason why URDF cannot express a mechanism with these values; empty if it can."""
    rotors = {
        m.name
        for body in mechanism.bodies
        if body.joint.kind == ROTOR
        for m in body.joint.motions
    }
    coupled = [c.coordinate for c in mechanism.couplings if c.coordinate not in rotors]
    if mechanism.closures:
        return "the mechanism has loops"
    if coupled:
        return f"the mechanism has couplings, of {in_quotes(coupled)}"
    base = _floating_base(mechanism)
    for index, (body, ten) in enumerate(
        zip(mechanism.bodies, values.bodies, strict=True)
    ):
        if index != base and any(
            motion.kind not in _TYPES for motion in body.joint.motions
        ):
            return f"joint '{body.joint.name}' is neither made of rotations and translations nor a floating base"
        if body.joint.kind == ROTOR and any(
            other.parent == index for other in mechanism.bodies
        ):
            return f"rotor '{body.name}' carries other bodies"
        if not has_centre(ten):
            return f"body '{body.name}' has first moments and no positive mass, so it has no centre of mass"
    used = {name for body in mechanism.bodies for name in body.joint.symbols()}
    unknown = sorted(used - known_values(mechanism).keys())
    return f"symbols without values: {', '.join(unknown)}" if unknown else ""


@dataclass(frozen=True)
class _Seat:
    """The link that stands for a body, and where the body's frame is in it."""

    link: str
    frame: Floats


class UrdfGenerator:
    """Makes a URDF document of a mechanism without an obstacle (see :func:`urdf_obstacle`)."""

    def __init__(self, mechanism: Mechanism, values: IdentifiedValues) -> None:
        self.mechanism, self.values = mechanism, values
        self.known = known_values(mechanism)
        self.links = {body.name for body in mechanism.bodies}
        self.joints = {motion.name for motion in mechanism.motions}
        self.base = _floating_base(mechanism)
        moving = [
            b
            for k, b in enumerate(mechanism.bodies)
            if k != self.base and b.joint.kind != ROTOR
        ]
        self.single = {
            motion.name for body in moving for motion in body.joint.motions
        }  # what becomes a joint
        self.effects = joint_effects(
            mechanism, values.effects, DYNAMICS, self.single, FORMAT
        )

    def written(
        self, remarks: Sequence[str] = ()
    ) -> tuple[str, tuple[str, ...], tuple[str, ...]]:
        """The document, notes, and doubts."""
        lines: list[str] = []
        seats: dict[int, _Seat] = {}
        if self.base is None:
            seats[GROUND] = _Seat(_new("base", self.links), np.eye(4))
            lines.append(f"<link name={quoted(seats[GROUND].link)}/>")
        for index, body in enumerate(self.mechanism.bodies):
            if body.joint.kind == ROTOR:
                continue
            if index == self.base:
                seats[index] = _Seat(
                    body.name, self._placed(body.joint.steps[len(_FLOATING) :])
                )
            else:
                joints, seats[index] = self._joints(body, seats[body.parent])
                lines += joints
            lines += self._link(index, seats[index])
        notes = (*remarks, *self._notes())
        inside = "".join(f"  {line}\n" for line in [*head_comment(notes), *lines])
        head = f'<?xml version="1.0" encoding="UTF-8"?>\n<robot name={quoted(self.mechanism.name)}>\n'
        doubts = rotor_doubts(self.mechanism, self.values, self.effects, FORMAT)
        return f"{head}{inside}</robot>\n", notes, doubts

    def _link(self, index: int, seat: _Seat) -> list[str]:
        load = load_of(move(self.values.bodies[index], seat.frame), seat.link)
        if load is None:
            return [f"<link name={quoted(seat.link)}/>"]
        return [
            f"<link name={quoted(seat.link)}>",
            *(f"  {line}" for line in inertial_lines(load)),
            "</link>",
        ]

    def _joints(self, body: Body, parent: _Seat) -> tuple[list[str], _Seat]:
        """The joints between a body and its parent, and the links between them."""
        lines: list[str] = []
        link, frame, left = parent.link, parent.frame, len(body.joint.motions)
        if not left:
            name = _new(body.joint.name or body.name, self.joints)
            lines += _joint(
                name,
                "fixed",
                link,
                body.name,
                frame @ self._placed(body.joint.steps),
                [],
            )
            return lines, _Seat(body.name, np.eye(4))
        for step in body.joint.steps:
            if isinstance(step, Placement):
                frame = frame @ self._placed((step,))
                continue
            left -= 1
            child = _new(f"{body.name}.{step.name}", self.links) if left else body.name
            lines += _joint(
                step.name, _TYPES[step.kind], link, child, frame, self._moving(step)
            )
            if left:
                lines.append(f"<link name={quoted(child)}/>")
            link, frame = child, np.eye(4)
        return lines, _Seat(link, frame)

    def _moving(self, motion: Motion) -> list[str]:
        axis = " ".join(str(motion.sign if k == motion.axis else 0) for k in range(3))
        numbers = self.effects.attributes.get(motion.name, {})
        dynamics = "".join(
            f' {key}="{number_text(value)}"' for key, value in numbers.items()
        )
        return [
            f'<axis xyz="{axis}"/>',
            *([_UNLIMITED] if motion.kind is MotionKind.TRANSLATION else []),
            *([f"<dynamics{dynamics}/>"] if dynamics else []),
        ]

    def _placed(self, steps: tuple[object, ...]) -> Floats:
        """Placements one after the other as a homogeneous matrix."""
        placements = (
            placement_matrix(step, self.known)
            for step in steps
            if isinstance(step, Placement)
        )
        return reduce(np.matmul, placements, np.eye(4))

    def _notes(self) -> Iterator[str]:
        yield from self.effects.notes
        yield from rotor_notes(self.mechanism, self.values, FORMAT)
        if self.mechanism.actuators:
            yield (
                f"torques are those of joints; {FORMAT} lacks the transmission of "
                + in_quotes(actuator.name for actuator in self.mechanism.actuators)
            )
        gravity = [expression_text(part) for part in self.mechanism.gravity or ORIGIN]
        if gravity != [expression_text(as_polynomial(part)) for part in _USUAL_GRAVITY]:
            yield f"{FORMAT} has no gravity: in the base frame it is ({', '.join(gravity)}) m/s²"
        sliding = [
            m.name
            for m in self.mechanism.motions
            if m.kind is MotionKind.TRANSLATION and m.name in self.single
        ]
        if sliding:
            yield f"the limits of {in_quotes(sliding)} are made up, because {FORMAT} demands some"


def _joint(
    name: str, kind: str, parent: str, child: str, frame: Floats, inside: list[str]
) -> list[str]:
    placed = f'<origin xyz="{number_text(*frame[:3, 3])}" rpy="{number_text(*roll_pitch_yaw(frame[:3, :3]))}"/>'
    ends = [f"<parent link={quoted(parent)}/>", f"<child link={quoted(child)}/>"]
    lines = [placed, *ends, *inside]
    return [
        f"<joint name={quoted(name)} type={quoted(kind)}>",
        *(f"  {line}" for line in lines),
        "</joint>",
    ]


def _floating_base(mechanism: Mechanism) -> int | None:
    """The body that is a floating base and carries the whole robot."""
    hanging = [
        k
        for k, body in enumerate(mechanism.bodies)
        if body.parent == GROUND and body.joint.kind != ROTOR
    ]
    if len(hanging) != 1:
        return None
    motions = mechanism.bodies[hanging[0]].joint.motions
    first = mechanism.bodies[hanging[0]].joint.steps[: len(_FLOATING)]
    plain = [(motion.axis, motion.sign) for motion in motions[:3]] == [
        (0, 1),
        (1, 1),
        (2, 1),
    ]
    if motions == first and plain and tuple(m.kind for m in motions) == _FLOATING:
        return hanging[0]
    return None


def _new(name: str, taken: set[str]) -> str:
    """A name like this one that is not taken; it is, from then on."""
    free = unused(name, taken)
    taken.add(free)
    return free
