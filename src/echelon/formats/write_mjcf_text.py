"""The text of an MJCF model as one document in which every body stands where MuJoCo has it.

Files that it includes are put in their places.  What multiplies or attaches bodies is left to MuJoCo, which prints the
model that it made; it prints six digits, so that bodies, frames and joints get theirs back from its own numbers.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from echelon.errors import InputError
from echelon.formats.mjcf_document import check_document
from echelon.formats.mjcf_spec import NO_MASS, compile_spec, import_mujoco, parse_spec
from echelon.formats.write_values import number_text
from echelon.formats.write_xml import XmlEditor, decoded

_PRINTED = (
    "MuJoCo has written out what multiplies or attaches bodies: without comments, "
    "and with six digits but for bodies, frames and joints"
)
JOINTS = ("joint", "freejoint")


class NamedModel:
    """A document with the names under which Echelon knows its bodies and joints."""

    def __init__(self, text: str, source: str, directory: Path | None) -> None:
        text = text.removeprefix("\ufeff")  # MuJoCo would stumble over the mark of byte order
        _, included, missing = check_document(text, source, directory)
        self._lenient = bool(missing)
        parse_spec(text, source, directory)  # which refuses files that include themselves
        self.notes: tuple[str, ...] = ()
        self._read(_with_includes(text, source, included), source, directory)
        if not self._is_complete:
            self.notes = (_PRINTED,)
            self._read(_printed(text, source, directory), source, directory)
        if not self._is_complete:
            raise InputError("its bodies cannot be told apart; give every body and joint a name", source=source)

    def _read(self, text: str, source: str, directory: Path | None) -> None:
        self.editor = XmlEditor(text, source)
        self.spec = compile_spec(parse_spec(text, source, directory), source, directory, lenient=self._lenient).spec
        self._spec_bodies = [str(body.name) for body in self.spec.bodies][1:]
        self._spec_joints = [str(joint.name) for joint in self.spec.joints]
        world = [e for part in self.editor.root.findall("worldbody") for e in part.iter()]
        bodies, joints = [e for e in world if e.tag == "body"], [e for e in world if e.tag in JOINTS]
        self.bodies = dict(zip(bodies, self._spec_bodies, strict=False))
        self.joints = dict(zip(joints, self._spec_joints, strict=False))
        self._counts = len(bodies) == len(self._spec_bodies) and len(joints) == len(self._spec_joints)

    @property
    def _is_complete(self) -> bool:
        """Whether elements and MuJoCo's bodies and joints are the same ones in the same order."""
        named = (*self.bodies.items(), *self.joints.items())
        return self._counts and all(element.get("name") in (None, "", name) for element, name in named)


def _with_includes(text: str, source: str, included: Mapping[str, bytes]) -> str:
    editor = XmlEditor(text, source)
    for element in editor.root.iter("include"):
        name = element.get("file")
        if name not in included:
            continue  # missing from the start, and still needed for whatever it defines
        inner = XmlEditor(_with_includes(decoded(included[name], name), name, included), name)
        editor.replace(element, inner.inside(inner.root))
    return editor.result()


def _printed(text: str, source: str, directory: Path | None) -> str:
    """The model that MuJoCo makes of a document, with all digits where bodies, frames and joints are."""
    mujoco = import_mujoco()
    spec = parse_spec(text, source, directory)
    spec.compiler.fusestatic = spec.compiler.discardvisual = False
    spec.compiler.boundmass = max(spec.compiler.boundmass, NO_MASS)
    spec.compiler.boundinertia = max(spec.compiler.boundinertia, NO_MASS)
    for stem, elements in (("body", spec.bodies), ("joint", spec.joints), ("frame", spec.frames)):
        _name(stem, elements)
    try:
        model = spec.compile()
        spec.compiler.boundmass = spec.compiler.boundinertia = 0.0
        printed = str(spec.to_xml())
    except (ValueError, mujoco.FatalError) as error:
        problem = f"MuJoCo, which must write out what multiplies or attaches bodies, refuses the model: {error}"
        raise InputError(" ".join(problem.split()), source=source) from None
    editor = XmlEditor(printed, source)
    precise = dict(_precise(spec, model))
    for element in (e for part in editor.root.findall("worldbody") for e in part.iter()):
        tag = "joint" if element.tag in JOINTS else element.tag
        editor.set_attributes(element, precise.get((tag, element.get("name", "")), {}))
    return editor.result()


def _name(stem: str, elements: list[Any]) -> None:
    taken = {str(element.name) for element in elements}
    for index, element in enumerate(elements):
        name = f"{stem}_{index}"
        while name in taken:
            name += "_"
        if not element.name:
            element.name = name


def _precise(spec: Any, model: Any) -> Iterator[tuple[tuple[str, str], dict[str, str]]]:
    """Poses of bodies and frames and axes of joints, by tag and name."""
    mujoco = import_mujoco()
    for tag, elements in (("body", spec.bodies[1:]), ("frame", spec.frames)):
        for element in elements:
            rotation = element.quat
            if element.alt.type != mujoco.mjtOrientation.mjORIENTATION_QUAT:
                rules = getattr(element, "compiler", spec.compiler)  # of the model that was attached
                rotation = spec.resolve_orientation(
                    degree=rules.degree, sequence=rules.eulerseq, orientation=element.alt
                )
            yield (tag, str(element.name)), {"pos": number_text(*element.pos), "quat": number_text(*rotation)}
    for joint in spec.joints:
        if joint.type == mujoco.mjtJoint.mjJNT_FREE:
            continue
        place = {"pos": number_text(*joint.pos)}
        if joint.type != mujoco.mjtJoint.mjJNT_BALL:
            place["axis"] = number_text(*joint.axis)
            place["ref"] = number_text(model.qpos0[model.joint(joint.name).qposadr[0]])
        yield ("joint", str(joint.name)), place
