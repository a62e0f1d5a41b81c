"""The MJCF file that a robot was read from, with identified inertials, as one document.

Included files are put in their places.  What multiplies or attaches bodies has no
elements that could be edited: see :attr:`NamedModel.is_complete`.

Every body that moves gets an explicit inertial, so that its geoms no longer weigh anything, and what is fixed to such a
body gets an empty one.  Settings that would change these values afterwards are switched off.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from echelon.formats.mjcf.mjcf_model import (
    NO_MASS,
    MjcfDocument,
    checked_mjcf,
    compile_spec,
    import_mujoco,
    parse_spec,
)
from echelon.formats.mjcf.mjcf_reader import DRIVES
from echelon.formats.writers.identified_values import (
    ROTOR,
    IdentifiedValues,
    JointEffects,
    Load,
    head_comment,
    joint_effects,
    kept_notes,
    load_of,
    number_text,
    reading_notes,
    rotor_doubts,
)
from echelon.formats.writers.xml_editor import XmlEditor, decoded
from echelon.robot import JointNumber, Mechanism
from echelon.shared import InputError, in_quotes

JOINTS = ("joint", "freejoint")


class NamedModel:
    """A document with the names under which Echelon knows its bodies and joints."""

    def __init__(self, text: str, document: MjcfDocument) -> None:
        parse_spec(document)  # which refuses files that include themselves
        text = text.removeprefix(
            "\ufeff"
        )  # MuJoCo would stumble over the mark of byte order
        text = _with_includes(text, document.source, document.included)
        self.editor = XmlEditor(text, document.source)
        checked = checked_mjcf(text, document.source, document.directory)
        self.spec = compile_spec(
            parse_spec(checked), replace(checked, missing=document.missing)
        ).spec
        world = [
            e for part in self.editor.root.findall("worldbody") for e in part.iter()
        ]
        bodies = [e for e in world if e.tag == "body"]
        joints = [e for e in world if e.tag in JOINTS]
        self.bodies = {
            e: str(made.name)
            for e, made in zip(bodies, self.spec.bodies[1:], strict=False)
        }
        self.joints = {
            e: str(made.name) for e, made in zip(joints, self.spec.joints, strict=False)
        }
        self._counts = (len(bodies), len(joints)) == (
            len(self.spec.bodies) - 1,
            len(self.spec.joints),
        )

    @property
    def is_complete(self) -> bool:
        """Whether elements and MuJoCo's bodies and joints are the same ones in the same order."""
        named = (*self.bodies.items(), *self.joints.items())
        return self._counts and all(
            element.get("name") in (None, "", name) for element, name in named
        )


def _with_includes(text: str, source: str, included: Mapping[str, bytes]) -> str:
    editor = XmlEditor(text, source)
    for element in editor.root.iter("include"):
        name = element.get("file")
        if name not in included:
            continue  # missing from the start, and still needed for whatever it defines
        inner = XmlEditor(
            _with_includes(decoded(included[name], name), name, included), name
        )
        editor.replace(element, inner.inside(inner.root))
    return editor.result()


_FORMAT = "MJCF"
_ATTRIBUTES = {
    JointNumber.DAMPING: "damping",
    JointNumber.DRY: "frictionloss",
    JointNumber.ARMATURE: "armature",
    JointNumber.STIFFNESS: "stiffness",
    JointNumber.FORCE: "springref",
}
_RUBBING = ("damping", "frictionloss", "armature")
_HARMFUL = (
    "inertiafromgeom",
    "balanceinertia",
    "boundmass",
    "boundinertia",
    "settotalmass",
)
"""Settings of the compiler that may change stated inertias; without them it does not."""
_HARMLESS = ("auto", "false")


class MjcfEditor:
    """Puts identified values in the place of those of an MJCF document."""

    def __init__(
        self,
        mechanism: Mechanism,
        values: IdentifiedValues,
        model: NamedModel,
        source: str,
    ) -> None:
        self.mechanism = mechanism
        self.values = values
        self.model = model
        self.source = source
        self.editor = model.editor
        self.indices = {
            b.name: k for k, b in enumerate(mechanism.bodies) if b.joint.kind != ROTOR
        }

    @cached_property
    def kept(self) -> frozenset[str]:
        """Bodies that stay as they are: those with the file's values, unless settings of the compiler change them."""
        changes = any(map(_harmful, self.editor.root.findall("compiler")))
        return frozenset() if changes else self.values.kept

    def written(
        self, remarks: Sequence[str]
    ) -> tuple[str, tuple[str, ...], tuple[str, ...]]:
        """The document, notes, and doubts."""
        fixed = {
            name for body, name in self.model.bodies.items() if not _has(body, JOINTS)
        }
        strange = next(
            (name for name in self.indices if name not in self.model.bodies.values()),
            None,
        )
        if strange is not None:
            raise InputError(
                "the model has no such body",
                source=self.source,
                element=f"body '{strange}'",
            )
        stated = self._single_joints()
        effects = joint_effects(
            self.mechanism, self.values.effects, _ATTRIBUTES, stated, _FORMAT
        )
        notes = [
            *remarks,
            *self._write_bodies(),
            *self._write_joints(stated, effects),
            *self._write_compiler(),
        ]
        notes += reading_notes(self.mechanism, self.values, self.editor.root, _FORMAT)
        base = self.mechanism.bodies[0] if self.mechanism.bodies else None
        if (
            base is not None
            and (base.joint.name, base.joint.kind) == ("base", "floating")
            and base.name in fixed
        ):
            notes.append(
                "the base is fixed in this file as in the input, although it was identified floating"
            )
        self.editor.insert_first(self.editor.root, head_comment(notes))
        doubts = rotor_doubts(self.mechanism, self.values, effects, _FORMAT)
        return self.editor.result(), tuple(notes), doubts

    # -- bodies ----------------------------------------------------------------------------------------------------

    def _write_bodies(self) -> Iterator[str]:
        lumped: list[str] = []
        massless: list[str] = []
        pending: list[tuple[Any, str | None]] = [
            (e, None)
            for world in self.editor.root.findall("worldbody")
            for e in _children(world)
        ]
        while pending:
            element, rides = pending.pop(0)
            name = self.model.bodies[element]
            moves = name if name in self.indices else rides
            if moves in self.kept:
                pass
            elif name in self.indices:
                load = load_of(self.values.bodies[self.indices[name]], name)
                massless += [] if load else [name]
                self._write_inertial(element, load or _nothing(element))
            elif rides and (
                element.find("inertial") is not None or _has(element, (*JOINTS, "geom"))
            ):
                lumped.append(name)
                self._write_inertial(element, _nothing(element))
            pending += [(child, moves) for child in _children(element)]
        if lumped:
            reason = "no mass of their own, since they count as part of the body that they are fixed to"
            yield f"{reason}: {in_quotes(lumped)}"
        if massless:
            reason = "no mass, or next to none where MuJoCo demands some, since they carry no parameters or zero"
            yield f"{reason}: {in_quotes(massless)}"

    def _write_inertial(self, body: Any, load: Load) -> None:
        xx, xy, xz, yy, yz, zz = load.moments
        if xy or xz or yz:
            moments = f'fullinertia="{number_text(xx, yy, zz, xy, xz, yz)}"'
        else:
            moments = f'diaginertia="{number_text(xx, yy, zz)}"'
        text = f'<inertial pos="{number_text(*load.centre)}" mass="{number_text(load.mass)}" {moments}/>'
        stated = body.findall("inertial")
        for element in stated[1:]:
            self.editor.remove(element)
        if stated:
            self.editor.replace(stated[0], text)
        else:
            self.editor.insert_first(body, [text])

    # -- joints and settings ---------------------------------------------------------------------------------------

    def _single_joints(self) -> dict[str, Any]:
        """Hinges and slides of the compiled model, by name."""
        mujoco = import_mujoco()
        single = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
        return {
            str(joint.name): joint
            for joint in self.model.spec.joints
            if joint.type in single
        }

    def _write_joints(
        self, stated: Mapping[str, Any], effects: JointEffects
    ) -> Iterator[str]:
        written = {name: dict(effects.attributes.get(name, {})) for name in stated}
        yield from self._counted_elsewhere(stated, written)
        for element, name in self.model.joints.items():
            numbers = (
                self._with_spring(stated[name], written[name]) if name in stated else {}
            )
            self.editor.set_attributes(
                element, {key: number_text(value) for key, value in numbers.items()}
            )
        said = {
            name: {key: _first(getattr(joint, key)) for key in DRIVES}
            for name, joint in stated.items()
        }
        yield from kept_notes(said, written)
        yield from effects.notes
        yield from self._lost_offsets(written)

    def _counted_elsewhere(
        self, stated: Mapping[str, Any], written: dict[str, dict[str, float]]
    ) -> Iterator[str]:
        """Take away armatures that identified inertias hold, and what joints have that follow others."""
        # the identified values of the joint that leads cover those
        cleared: dict[str, list[str]] = {}
        unseen = {
            motion.name
            for body in self.mechanism.bodies
            if body.name in self.kept
            for motion in body.joint.motions
        }
        for name, joint in stated.items():
            if name in unseen and name not in self.mechanism.dependent:
                continue
            for key in _RUBBING if name in self.mechanism.dependent else ("armature",):
                if _first(getattr(joint, key)) and key not in written[name]:
                    written[name][key] = 0.0
                    cleared.setdefault(key, []).append(name)
        for key, joints in cleared.items():
            yield f"{key} is set to zero, because other identified parameters contain it: {in_quotes(joints)}"

    def _with_spring(
        self, joint: Any, numbers: Mapping[str, float]
    ) -> dict[str, float]:
        """Attributes of a joint, with the constant force as the place where its spring rests."""
        found = {key: value for key, value in numbers.items() if key != "springref"}
        if not numbers.get("stiffness"):
            return found
        rest = -numbers.get("springref", 0.0) / numbers["stiffness"]
        degrees = (
            self.model.spec.compiler.degree
            and joint.type == import_mujoco().mjtJoint.mjJNT_HINGE
        )
        return {**found, "springref": float(np.degrees(rest)) if degrees else rest}

    def _lost_offsets(
        self, written: Mapping[str, Mapping[str, float]]
    ) -> Iterator[str]:
        lost = [
            f"{number_text(numbers['springref'])} at '{name}'"
            for name, numbers in written.items()
            if numbers.get("springref") and not numbers.get("stiffness")
        ]
        if lost:
            yield f"{_FORMAT} has no place for constant forces without springs, left out (SI units): {', '.join(lost)}"

    def _write_compiler(self) -> Iterator[str]:
        changed: list[str] = []
        for element in self.editor.root.findall("compiler"):
            harmful = _harmful(element)
            self.editor.drop_attributes(element, harmful)
            changed += harmful
        if changed:
            yield f"settings that could change the inertias are left out: {', '.join(dict.fromkeys(changed))}"


def _harmful(compiler: Any) -> list[str]:
    """Settings of an element that may change stated inertias."""
    return [
        key
        for key in _HARMFUL
        if compiler.get(key) is not None and compiler.get(key) not in _HARMLESS
    ]


def _children(element: Any) -> Iterator[Any]:
    """Bodies in a body or the world, also those in frames."""
    for child in element:
        if child.tag == "body":
            yield child
        elif child.tag == "frame":
            yield from _children(child)


def _has(body: Any, tags: Collection[str]) -> bool:
    """Whether a body has elements of some kinds, perhaps in frames."""
    return any(e.tag in tags or (e.tag == "frame" and _has(e, tags)) for e in body)


def _nothing(body: Any) -> Load:
    """No mass, or what MuJoCo needs of a body that moves."""
    least = NO_MASS if _has(body, JOINTS) else 0.0
    return Load(least, (0.0, 0.0, 0.0), (least, 0.0, 0.0, least, 0.0, least))


def _first(value: Any) -> float:
    """A number of a joint, or the first coefficient of a polynomial."""
    return float(np.ravel(value)[0])
