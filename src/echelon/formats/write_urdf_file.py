"""The URDF file that a robot was read from, with identified inertials.

The user's file is more than its inertias: meshes, limits, comments, tags of other programs.  So it is edited, not
printed anew.  A link that counts as part of another loses its inertial, since its mass is in the other's now.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from echelon.errors import InputError
from echelon.formats.write_effects import COULOMB, VISCOUS, JointEffects, joint_effects, kept_notes
from echelon.formats.write_notes import head_comment, listed, reading_notes
from echelon.formats.write_values import ROTOR, IdentifiedValues, Load, load_of, number_text
from echelon.formats.write_xml import XmlEditor
from echelon.mechanism.mechanism import Mechanism

FORMAT = "URDF"
DYNAMICS = {VISCOUS: "damping", COULOMB: "friction"}
"""What the element <dynamics> can say; URDF has nothing for the inertia of a rotor."""
SINGLE_AXIS = ("revolute", "continuous", "prismatic")
_MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def edited_urdf(mechanism: Mechanism, values: IdentifiedValues, text: str, source: str) -> tuple[str, tuple[str, ...]]:
    """A URDF document with identified values in the place of its own."""
    return _Writer(mechanism, values, XmlEditor(text, source), source).written()


def inertial_lines(load: Load) -> list[str]:
    """The element <inertial> of a load, along the axes of the link's frame."""
    moments = " ".join(f'{name}="{number_text(v)}"' for name, v in zip(_MOMENTS, load.moments, strict=True))
    return [
        "<inertial>",
        f'  <origin xyz="{number_text(*load.centre)}" rpy="0 0 0"/>',
        f'  <mass value="{number_text(load.mass)}"/>',
        f"  <inertia {moments}/>",
        "</inertial>",
    ]


class _Writer:
    def __init__(self, mechanism: Mechanism, values: IdentifiedValues, editor: XmlEditor, source: str) -> None:
        self.mechanism, self.values, self.editor, self.source = mechanism, values, editor, source
        self.links = {str(e.get("name")): e for e in editor.root.findall("link")}
        self.joints = {str(e.get("name")): e for e in editor.root.findall("joint")}
        self.carriers = {_end(joint, "child"): _end(joint, "parent") for joint in self.joints.values()}
        self.bodies = {b.name: k for k, b in enumerate(mechanism.bodies) if b.joint.kind != ROTOR}

    def written(self) -> tuple[str, tuple[str, ...]]:
        strange = next((name for name in self.bodies if name not in self.links), None)
        if strange is not None:
            raise InputError("the file has no such link", source=self.source, element=f"body '{strange}'")
        notes = [*self._write_links()]
        effects = joint_effects(self.mechanism, self.values.effects, DYNAMICS, self._single_axes(), FORMAT)
        notes += self._write_dynamics(effects)
        notes += effects.notes
        notes += reading_notes(self.mechanism, self.values, self.editor.root, FORMAT)
        self.editor.insert_first(self.editor.root, head_comment(notes))
        return self.editor.result(), tuple(notes)

    # -- links -----------------------------------------------------------------------------------------------------

    def _write_links(self) -> Iterator[str]:
        lumped: list[str] = []
        massless: list[str] = []
        for name, link in self.links.items():
            inertials = link.findall("inertial")
            load = load_of(self.values.bodies[self.bodies[name]], name) if name in self.bodies else None
            if load is not None:
                self._write_inertial(link, inertials, load)
            elif name in self.bodies or self._rides(name):
                (massless if name in self.bodies else lumped).extend([name] if inertials else [])
                for element in inertials:
                    self.editor.remove(element)
        if lumped:
            reason = "no inertial of their own, since they count as part of the link that they are fixed to"
            yield f"{reason}: {listed(lumped)}"
        if massless:
            yield f"no inertial, since they carry no parameters or zero: {listed(massless)}"

    def _rides(self, link: str) -> bool:
        """Whether a link is fixed to a body, rather than to the world."""
        while link in self.carriers and link not in self.bodies:
            link = self.carriers[link]
        return link in self.bodies

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
            self.editor.insert_first(first, [f'<origin xyz="{place["xyz"]}" rpy="0 0 0"/>'])
        elif set(origin.keys()) <= place.keys():
            self.editor.set_attributes(origin, place)
        else:  # another notation of the orientation would contradict this one
            self.editor.replace(origin, f'<origin xyz="{place["xyz"]}" rpy="0 0 0"/>')
        self.editor.set_attributes(first.find("mass"), {"value": number_text(load.mass)})
        moments = {name: number_text(v) for name, v in zip(_MOMENTS, load.moments, strict=True)}
        self.editor.set_attributes(first.find("inertia"), moments)

    # -- joints ----------------------------------------------------------------------------------------------------

    def _single_axes(self) -> set[str]:
        return {name for name, joint in self.joints.items() if joint.get("type") in SINGLE_AXIS}

    def _write_dynamics(self, effects: JointEffects) -> Iterator[str]:
        stated: dict[str, dict[str, float]] = {}
        for name, joint in self.joints.items():
            numbers = effects.attributes.get(name, {})
            written = {key: number_text(value) for key, value in numbers.items()}
            element = joint.find("dynamics")
            if element is not None:
                stated[name] = {key: _number(element.get(key)) for key in DYNAMICS.values()}
                self.editor.set_attributes(element, written)
            elif written:
                attributes = "".join(f' {key}="{value}"' for key, value in written.items())
                self.editor.insert_first(joint, [f"<dynamics{attributes}/>"])
        yield from kept_notes(stated, effects.attributes)


def _end(joint: Any, tag: str) -> str:
    return str(joint.find(tag).get("link"))


def _number(text: str | None) -> float:
    """A number that nothing else checks; what is none is as good as zero here."""
    try:
        return float(text or 0)
    except ValueError:
        return 0.0
