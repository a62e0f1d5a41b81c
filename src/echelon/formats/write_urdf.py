"""A URDF of a mechanism, from its geometry alone, for robots that came as a description.

A link's frame in URDF is where its joint ends, so whatever a description places after the last motion moves into the
inertial and the joints that follow.  A joint of several motions becomes several joints with massless links between.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from math import atan2, cos, hypot, sin

import numpy as np

from echelon.arrays import Floats
from echelon.exact.polynomial import as_polynomial
from echelon.formats.write_effects import joint_effects
from echelon.formats.write_notes import head_comment, listed, rotor_notes
from echelon.formats.write_urdf_file import DYNAMICS, FORMAT, inertial_lines
from echelon.formats.write_values import ROTOR, IdentifiedValues, has_centre, load_of, number_text
from echelon.formats.write_xml import quoted
from echelon.formats.written import expression_text
from echelon.inertia.spatial import move
from echelon.mechanism.joint import Motion, MotionKind
from echelon.mechanism.mechanism import GROUND, Body, Mechanism
from echelon.mechanism.placement import ORIGIN, Placement
from echelon.mechanism.values import known_values, placement_matrix

_TYPES = {MotionKind.ROTATION: "continuous", MotionKind.TRANSLATION: "prismatic"}
_FLOATING = (MotionKind.TRANSLATION,) * 3 + (MotionKind.BALL,)
_UNLIMITED = '<limit lower="-1e9" upper="1e9" effort="1e9" velocity="1e9"/>'
_ROUNDING = 1e-15
"""What is left of a zero in a product of two rotations."""
_USUAL_GRAVITY = (0, 0, Fraction(-981, 100))


def urdf_obstacle(mechanism: Mechanism, values: IdentifiedValues) -> str:
    """Why URDF cannot express a mechanism with these values; empty if it can."""
    rotors = {m.name for body in mechanism.bodies if body.joint.kind == ROTOR for m in body.joint.motions}
    coupled = [c.coordinate for c in mechanism.couplings if c.coordinate not in rotors]
    if mechanism.closures:
        return "the mechanism has loops"
    if coupled:
        return f"the mechanism has couplings, of {listed(coupled)}"
    for index, (body, ten) in enumerate(zip(mechanism.bodies, values.bodies, strict=True)):
        kinds = [motion.kind for motion in body.joint.motions]
        if not _floats(mechanism, index) and any(kind not in _TYPES for kind in kinds):
            return f"joint '{body.joint.name}' is no sequence of turns and slides, nor that of a floating base"
        if body.joint.kind == ROTOR and any(other.parent == index for other in mechanism.bodies):
            return f"rotor '{body.name}' carries other bodies"
        if not has_centre(ten):
            return f"body '{body.name}' has first moments and no positive mass, so it has no centre of mass"
    used = {name for body in mechanism.bodies for name in body.joint.symbols()}
    unknown = sorted(used - known_values(mechanism).keys())
    return f"symbols without values: {', '.join(unknown)}" if unknown else ""


def generated_urdf(mechanism: Mechanism, values: IdentifiedValues) -> tuple[str, tuple[str, ...]]:
    """A URDF document of a mechanism without an obstacle (see :func:`urdf_obstacle`)."""
    return _Generator(mechanism, values).document()


@dataclass(frozen=True)
class _Seat:
    """The link that stands for a body, and where the body's frame is in it."""

    link: str
    frame: Floats


class _Generator:
    def __init__(self, mechanism: Mechanism, values: IdentifiedValues) -> None:
        self.mechanism, self.values = mechanism, values
        self.known = known_values(mechanism)
        self.links = {body.name for body in mechanism.bodies}
        self.joints = {motion.name for motion in mechanism.motions}
        self.effects = joint_effects(mechanism, values.effects, DYNAMICS, self._single, FORMAT)

    def document(self) -> tuple[str, tuple[str, ...]]:
        lines: list[str] = []
        seats: dict[int, _Seat] = {}
        if not any(_floats(self.mechanism, index) for index in range(len(self.mechanism.bodies))):
            seats[GROUND] = _Seat(_unused("base", self.links), np.eye(4))
            lines.append(f"<link name={quoted(seats[GROUND].link)}/>")
        for index, body in enumerate(self.mechanism.bodies):
            if body.joint.kind == ROTOR:
                continue
            if _floats(self.mechanism, index):
                seats[index] = _Seat(body.name, self._placed(body.joint.steps[len(_FLOATING) :]))
            else:
                joints, seats[index] = self._joints(body, seats[body.parent])
                lines += joints
            lines += self._link(index, seats[index])
        notes = tuple(self._notes())
        inside = "".join(f"  {line}\n" for line in [*head_comment(notes), *lines])
        head = f'<?xml version="1.0" encoding="UTF-8"?>\n<robot name={quoted(self.mechanism.name)}>\n'
        return f"{head}{inside}</robot>\n", notes

    def _link(self, index: int, seat: _Seat) -> list[str]:
        load = load_of(move(self.values.bodies[index], seat.frame), seat.link)
        if load is None:
            return [f"<link name={quoted(seat.link)}/>"]
        return [f"<link name={quoted(seat.link)}>", *(f"  {line}" for line in inertial_lines(load)), "</link>"]

    def _joints(self, body: Body, parent: _Seat) -> tuple[list[str], _Seat]:
        """The joints between a body and its parent, and the links between them."""
        lines: list[str] = []
        link, frame, left = parent.link, parent.frame, len(body.joint.motions)
        if not left:
            name = _unused(body.joint.name or body.name, self.joints)
            lines += _joint(name, "fixed", link, body.name, frame @ self._placed(body.joint.steps), [])
            return lines, _Seat(body.name, np.eye(4))
        for step in body.joint.steps:
            if isinstance(step, Placement):
                frame = frame @ self._placed((step,))
                continue
            left -= 1
            child = _unused(f"{body.name}.{step.name}", self.links) if left else body.name
            lines += _joint(step.name, _TYPES[step.kind], link, child, frame, self._moving(step))
            lines += [f"<link name={quoted(child)}/>"] if left else []
            link, frame = child, np.eye(4)
        return lines, _Seat(link, frame)

    def _moving(self, motion: Motion) -> list[str]:
        axis = " ".join(str(motion.sign if k == motion.axis else 0) for k in range(3))
        numbers = self.effects.attributes.get(motion.name, {})
        dynamics = "".join(f' {key}="{number_text(value)}"' for key, value in numbers.items())
        return [
            f'<axis xyz="{axis}"/>',
            *([_UNLIMITED] if motion.kind is MotionKind.TRANSLATION else []),
            *([f"<dynamics{dynamics}/>"] if dynamics else []),
        ]

    def _placed(self, steps: tuple[object, ...]) -> Floats:
        """Placements one after the other as a homogeneous matrix."""
        total = np.eye(4)
        for step in steps:
            assert isinstance(step, Placement), "the caller takes the motions out"
            total = total @ placement_matrix(step, self.known)
        return total

    def _notes(self) -> Iterator[str]:
        yield from self.effects.notes
        yield from rotor_notes(self.mechanism, self.values, FORMAT)
        if self.mechanism.actuators:
            yield f"torques are those of joints; {FORMAT} lacks the transmission of " + listed(
                actuator.name for actuator in self.mechanism.actuators
            )
        gravity = [expression_text(part) for part in self.mechanism.gravity or ORIGIN]
        if gravity != [expression_text(as_polynomial(part)) for part in _USUAL_GRAVITY]:
            yield f"{FORMAT} has no gravity: in the base frame it is ({', '.join(gravity)}) m/s²"
        sliding = [
            m.name for m in self.mechanism.motions if m.kind is MotionKind.TRANSLATION and m.name in self._single
        ]
        if sliding:
            yield f"the limits of {listed(sliding)} are made up, because {FORMAT} demands some"

    @property
    def _single(self) -> set[str]:
        """Coordinates that become joints."""
        moving = [b for k, b in enumerate(self.mechanism.bodies) if not _floats(self.mechanism, k)]
        return {motion.name for body in moving if body.joint.kind != ROTOR for motion in body.joint.motions}


def _joint(name: str, kind: str, parent: str, child: str, frame: Floats, inside: list[str]) -> list[str]:
    placed = f'<origin xyz="{number_text(*frame[:3, 3])}" rpy="{number_text(*_rpy(frame[:3, :3]))}"/>'
    ends = [f"<parent link={quoted(parent)}/>", f"<child link={quoted(child)}/>"]
    lines = [placed, *ends, *inside]
    return [f"<joint name={quoted(name)} type={quoted(kind)}>", *(f"  {line}" for line in lines), "</joint>"]


def _floats(mechanism: Mechanism, index: int) -> bool:
    """Whether a body is a floating base that carries the whole robot."""
    body = mechanism.bodies[index]
    first = body.joint.steps[: len(_FLOATING)]
    kinds = tuple(step.kind for step in first if isinstance(step, Motion))
    plain = [step.axis for step in first[:3] if isinstance(step, Motion) and step.sign > 0] == [0, 1, 2]
    alone = sum(b.parent == GROUND and b.joint.kind != ROTOR for b in mechanism.bodies) == 1
    return body.parent == GROUND and alone and plain and kinds == _FLOATING == tuple(m.kind for m in body.joint.motions)


def _rpy(r: Floats) -> tuple[float, float, float]:
    """Angles with R = Rz(yaw) Ry(pitch) Rx(roll).

    The roll is taken after the yaw is undone, so that at a pitch near ±90°, where neither is well determined, their
    errors cancel.
    """
    yaw = atan2(r[1, 0], r[0, 0]) if hypot(r[0, 0], r[1, 0]) > _ROUNDING else 0.0
    c, s = cos(yaw), sin(yaw)
    return atan2(s * r[0, 2] - c * r[1, 2], c * r[1, 1] - s * r[0, 1]), atan2(-r[2, 0], hypot(r[0, 0], r[1, 0])), yaw


def _unused(name: str, taken: set[str]) -> str:
    """A name like this one that is not taken; it is, from then on."""
    while name in taken:
        name += "_"
    taken.add(name)
    return name
