"""Compiled MuJoCo models for the MJCF reader: documents that are checked, whatever meshes and masses are missing.

MuJoCo would resolve includes against the working directory, write a log file and go on when a number is not finite, and
take hours over a large ``<replicate>``.  So all documents are read here, and are handed over only if they are harmless.

MuJoCo's own compiler resolves defaults, frames, orientation notations, ``<replicate>``, ``<attach>`` and inertias of
geoms, so that a file means here what it means there.  Left alone it would also refuse what a geometric description may
well lack: mesh and texture files, and masses.  So everything that carries neither geometry nor inertia is removed
first, absent meshes are removed if need be, and bodies without mass get one that is far below anything meant.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite, isnan, prod
from pathlib import Path, PurePath
from typing import Any
from xml.etree.ElementTree import tostring

import numpy as np

from echelon.algebra import is_whole
from echelon.formats.snapping import SMALLEST, tiny_notes
from echelon.formats.vocabulary import without
from echelon.shared import (
    INCLUDES,
    InputError,
    extra,
    in_quotes,
    parse_xml,
    read_content,
    unused,
)

_NUMERIC = {
    *(
        "pos",
        "quat",
        "axisangle",
        "xyaxes",
        "zaxis",
        "euler",
        "axis",
        "ref",
        "polycoef",
        "gravity",
    ),
    *(
        "mass",
        "density",
        "diaginertia",
        "fullinertia",
        "fromto",
        "size",
        "offset",
        "scale",
        "massscale",
    ),
}
_MULTIPLYING = ("replicate", "composite", "flexcomp")
MOST_COPIES = 10_000
"""Copies that replicate and its kin may make: more are an attack on memory."""


@dataclass(frozen=True)
class MjcfDocument:
    """A checked document, with the contents of the files that it includes or attaches by the names it uses."""

    text: str
    source: str
    directory: Path | None
    included: Mapping[str, bytes]
    missing: tuple[
        str, ...
    ]  # files that are not there; the text does not include them any more


def checked_mjcf(
    text: str | bytes,
    source: str,
    directory: Path | None,
    ignored: Collection[str] = (),
) -> MjcfDocument:
    """A document that is harmless; includes of missing files are left out, unless they would define parts of bodies.

    Elements and attributes that are to be ignored are taken out of the document itself, not of what it includes.
    """
    root = parse_xml(text, source)
    if ignored:
        root = without(root, ignored, source)
        text = bytes(tostring(root, encoding="utf-8"))
    if root.tag == "mujocoinclude":
        raise InputError(
            "this is a fragment, not a model: read the file that includes it",
            source=source,
        )
    if root.tag != "mujoco":
        raise InputError(
            f"expected a <mujoco> element, found <{root.tag}>", source=source
        )
    try:
        decoded = text.decode("utf-8-sig") if isinstance(text, bytes) else text
    except UnicodeDecodeError:
        raise InputError("not UTF-8, which MuJoCo expects", source=source) from None
    included: dict[str, bytes] = {}
    _check(root, source)
    _gather(root, source, directory, PurePath(), included)
    missing = tuple(name for name, content in included.items() if not content)
    if missing:
        decoded = _without(root, missing).decode()
        present = {
            name: parse_xml(content, name)
            for name, content in included.items()
            if name not in missing
        }
        included = {name: _without(child, missing) for name, child in present.items()}
    return MjcfDocument(decoded, source, directory, included, missing)


def _without(root: Any, missing: Collection[str]) -> bytes:
    """A document without includes of missing files; for MuJoCo an empty file will not do."""
    for element in list(root.iter()):
        for child in [
            c for c in element if c.tag == "include" and c.get("file") in missing
        ]:
            element.remove(child)
    return bytes(tostring(root, encoding="utf-8"))


def _gather(
    root: Any,
    source: str,
    directory: Path | None,
    folder: PurePath,
    included: dict[str, bytes],
    inside: bool = False,
) -> None:
    """Read and check the files that a document includes or attaches, and those that these include."""
    in_bodies = {id(e) for tree in root.iter("worldbody") for e in tree.iter("include")}
    for element in root.iter():
        name = element.get("file") if element.tag in ("include", "model") else None
        if name is None or name in included:
            continue
        where = f"{element.tag} '{name}'"
        needed = inside or element.tag == "model" or id(element) in in_bodies
        if directory is None and needed:
            raise InputError(
                "the model has no directory to find this file in",
                source=source,
                element=where,
            )
        # MuJoCo looks beside the main file first, then beside the including one
        places = (PurePath(name), folder / name)
        found = (
            None
            if directory is None
            else next((p for p in places if (directory / p).is_file()), None)
        )
        if directory is None or found is None:
            if needed:
                raise InputError(
                    "no such file, and it is part of the bodies",
                    source=source,
                    element=where,
                )
            included[name] = b""
            continue
        included[name] = read_content(directory / found)
        INCLUDES.check(len(included), source, where)
        child = parse_xml(included[name], str(found))
        _check(child, str(found))
        _gather(child, str(found), directory, found.parent, included, needed)


def _check(root: Any, source: str) -> None:
    """Refuse nan and inf, which MuJoCo itself lets pass with no more than a warning, and too many copies."""
    for element in root.iter():
        for name, value in element.items():
            for word in value.split() if name in _NUMERIC else ():
                try:
                    finite = isfinite(float(word))
                except ValueError:
                    continue  # MuJoCo reports it, with the line
                if not finite:
                    where = f"{element.tag} '{element.get('name', '')}' {name}"
                    raise InputError(
                        f"'{word}' is not a finite number", source=source, element=where
                    )
    pending = [(root, 1)]
    while pending:
        element, copies = pending.pop()
        if element.tag in _MULTIPLYING:
            copies *= prod(
                int(word)
                for word in element.get("count", "1").split()
                if is_whole(word)
            )
            if copies > MOST_COPIES:
                problem = f"{copies} copies are too many; {MOST_COPIES} are allowed"
                raise InputError(problem, source=source, element=element.tag)
        pending.extend((child, copies) for child in element)


NO_MASS = 2e-15
"""Mass (kg) and inertia (kg·m²) given to moving bodies that have none; MuJoCo's compiler asks for at least 1e-15."""

# None of these moves a body or changes its inertia; equalities, which do matter, are kept.
IRRELEVANT = (
    "keys",
    "sensors",
    "actuators",
    "tendons",
    "pairs",
    "excludes",
    "skins",
    "tuples",
)
_EFFECTS = ("armature", "damping", "frictionloss", "stiffness")
_COMPILED = (
    *("body_pos", "body_quat", "body_mass", "body_inertia", "body_ipos", "body_iquat"),
    *("jnt_pos", "jnt_axis", "qpos0"),
)


@dataclass(frozen=True)
class CompiledModel:
    """A file as MuJoCo compiles it."""

    model: Any  # bodies and joints all have names
    spec: Any  # the same before compilation, with the numbers as written
    unknown: frozenset[
        str
    ]  # bodies whose inertia would come from meshes that are not there
    notes: tuple[str, ...]


def import_mujoco(needed_by: str = "mjcf") -> Any:
    """The optional package ``mujoco``, which the extras ``mjcf`` and ``excite`` bring."""
    with extra(needed_by):
        import mujoco
    return mujoco


def parse_spec(document: MjcfDocument) -> Any:
    """The ``MjSpec`` of an MJCF document, with the files that it includes."""
    mujoco = import_mujoco()
    try:
        spec = mujoco.MjSpec.from_string(document.text, include=dict(document.included))
    except (ValueError, mujoco.FatalError) as error:
        raise refusal(error, document.source) from None
    if document.directory is not None:
        spec.modelfiledir = str(document.directory)
    return spec


def compile_spec(spec: Any, document: MjcfDocument) -> CompiledModel:
    """Compile the spec of a document for its geometry and inertias; the spec is changed."""
    mujoco, directory = import_mujoco(), document.directory
    notes = _effect_notes(spec)
    keep_bodies(spec)
    if _keep_frames(spec, mujoco):
        notes.append(
            "free bodies keep the frames of the file: the alignment that it asks for is ignored"
        )
    name_all("body", spec.bodies)
    name_all("joint", spec.joints)
    _remove_irrelevant(spec)
    defined = {mesh_name(mesh) for mesh in spec.meshes}
    undefined = {
        geom.meshname for geom in spec.geoms if geom.meshname and document.missing
    } - defined
    absent = absent_meshes(spec, directory) | undefined
    stages = [absent] if directory is None or undefined else [set(), absent]
    unknown: set[str] = set()
    for doomed in (*stages, {mesh_name(mesh) for mesh in spec.meshes if mesh.file}):
        unknown |= _remove_meshes(spec, doomed)
        try:
            model = spec.compile()
            break
        except (ValueError, mujoco.FatalError) as error:
            failure = error
    else:
        raise refusal(failure, document.source)
    if (
        unknown and spec.compiler.settotalmass > 0
    ):  # then the share of every other body is unknown as well
        unknown = {body.name for body in spec.bodies}
    if unknown:
        notes.append(
            f"inertias of {_bodies(unknown)} are unknown: they come from meshes that cannot be read"
        )
    for name in _COMPILED:
        if not np.all(np.isfinite(getattr(model, name))):
            raise InputError(
                f"the compiled model has infinite values in {name}",
                source=document.source,
            )
    notes += tiny_notes(_without_tiny(model))
    inferred = _inferred(spec, model) - unknown
    if inferred:
        notes.append(
            f"inertias of {_bodies(inferred)} are computed from their geoms: the file does not state them"
        )
    return CompiledModel(model, spec, frozenset(unknown), tuple(notes))


def _without_tiny(model: Any) -> list[str]:
    """Put zero in the place of tiny numbers of a compiled model, and say where they were."""
    found = list[str]()
    for name in (*_COMPILED, "site_pos", "eq_data"):
        values = getattr(model, name)
        tiny = (np.abs(values) < float(SMALLEST)) & (values != 0)
        found += [f"{name} = {value:g}" for value in values[tiny]]
        values[tiny] = 0
    return found


# -- messages ----------------------------------------------------------------------------------------------------------


def _bodies(names: Collection[str]) -> str:
    return f"{'body' if len(names) == 1 else 'bodies'} {in_quotes(sorted(names))}"


def refusal(error: Exception, source: str) -> InputError:
    """MuJoCo's message as an input error that names the element."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    problem = re.sub(
        r"^((XML )?Error: )+", "", lines[0] if lines else "no reason given"
    )
    rest = " ".join(lines[1:])
    place = re.search(
        r"Element (?:name )?'(?P<name>[^']*)'(?:, id \d+)?(?:, line (?P<line>\d+))?",
        rest,
    )
    if place is None:
        return InputError(
            " ".join([f"MuJoCo refuses the model: {problem}", *lines[1:]]),
            source=source,
        )
    parts = [
        f"element '{place['name']}'" if place["name"] else "",
        f"line {place['line']}" if place["line"] else "",
    ]
    return InputError(
        f"MuJoCo refuses it: {problem}",
        source=source,
        element=", ".join(p for p in parts if p),
    )


# -- preparation -------------------------------------------------------------------------------------------------------


def _effect_notes(spec: Any) -> list[str]:
    found = [
        f"joint {name}"
        for name in _EFFECTS
        if any(np.any(getattr(joint, name)) for joint in spec.joints)
    ]
    if any(body.gravcomp for body in spec.bodies):
        found.append("gravity compensation")
    acts = any(
        np.any(getattr(tendon, name, 0)) for tendon in spec.tendons for name in _EFFECTS
    )
    if acts:
        found.append("forces of tendons")
    if any(_is_limited(tendon) for tendon in spec.tendons):
        found.append("limits of tendons")
    if spec.option.density or spec.option.viscosity:
        found.append("drag of a fluid")
    if any(body.plugin.active for body in spec.bodies):
        found.append("forces of plugins")
    joints = {
        import_mujoco().mjtTrn.mjTRN_JOINT,
        import_mujoco().mjtTrn.mjTRN_JOINTINPARENT,
    }
    if any(actuator.trntype not in joints for actuator in spec.actuators):
        found.append("actuators that act through tendons, sites or bodies")
    if found:
        return [
            f"ignored, since rigid-body parameters do not cover them: {', '.join(found)}"
        ]
    return []


def _is_limited(tendon: Any) -> bool:
    """Whether a tendon stops somewhere; where nothing says so, a range does."""
    limited = import_mujoco().mjtLimited
    low, high = tendon.range
    return bool(
        tendon.limited == limited.mjLIMITED_TRUE
        or (tendon.limited == limited.mjLIMITED_AUTO and low < high)
    )


def keep_bodies(spec: Any) -> None:
    """Have the compiler keep every body; moving ones without mass get :data:`NO_MASS`, which it asks for."""
    compiler = spec.compiler
    always = import_mujoco().mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    # here fused bodies have other inertias: stated ones give way to geoms of others, static ones do not count
    compiler.fusestatic &= (
        compiler.settotalmass > 0 or compiler.inertiafromgeom == always
    )
    compiler.discardvisual = False
    compiler.boundmass, compiler.boundinertia = (
        max(compiler.boundmass, NO_MASS),
        max(compiler.boundinertia, NO_MASS),
    )


def _keep_frames(spec: Any, mujoco: Any) -> bool:
    """Have free bodies keep the frames of the file; whether their joints were to change them."""
    compiler, aligned = spec.compiler, mujoco.mjtAlignFree
    free = [joint for joint in spec.joints if joint.type == mujoco.mjtJoint.mjJNT_FREE]
    asked = (
        (aligned.mjALIGNFREE_TRUE, aligned.mjALIGNFREE_AUTO)
        if compiler.alignfree
        else (aligned.mjALIGNFREE_TRUE,)
    )
    changed = any(joint.align in asked for joint in free)
    for joint in free:
        joint.align = aligned.mjALIGNFREE_FALSE
    return changed


def name_all(stem: str, elements: Sequence[Any]) -> None:
    """Give names to the elements that have none."""
    taken = {str(element.name) for element in elements}
    for index, element in enumerate(elements):
        if not element.name:
            element.name = unused(f"{stem}_{index}", taken)


def remove_groups(spec: Any, groups: Sequence[str]) -> None:
    """Delete all elements of some kinds, and what materials refer to."""
    for element in [e for group in groups for e in getattr(spec, group)]:
        spec.delete(element)
    for material in spec.materials:
        material.textures = [""] * len(material.textures)


def remove_unused(spec: Any) -> None:
    """Delete textures, height fields, and meshes that no geom uses."""
    used = {geom.meshname for geom in spec.geoms}
    unused = [mesh for mesh in spec.meshes if mesh_name(mesh) not in used]
    for element in (*spec.textures, *spec.hfields, *unused):
        spec.delete(element)


def _remove_irrelevant(spec: Any) -> None:
    remove_groups(spec, IRRELEVANT)
    for equality in [
        e for e in spec.equalities if e.type == import_mujoco().mjtEq.mjEQ_TENDON
    ]:
        spec.delete(equality)
    for geom in [
        g
        for g in spec.geoms
        if g.hfieldname or (g.meshname and not _contributes(spec, g))
    ]:
        spec.delete(geom)
    for element in (*spec.geoms, *spec.sites):
        element.material = ""
    remove_unused(spec)


def _contributes(spec: Any, geom: Any) -> bool:
    """Whether the body's inertia may come from this geom."""
    mujoco = import_mujoco()
    rule = spec.compiler.inertiafromgeom
    if (
        rule == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
        or geom.parent.name == "world"
    ):
        return False
    if (
        rule == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO
        and geom.parent.explicitinertial
    ):
        return False
    first, last = spec.compiler.inertiagrouprange
    weight = geom.density if isnan(geom.mass) else geom.mass
    return bool(weight) and first <= geom.group <= last


def _inferred(spec: Any, model: Any) -> set[str]:
    """Names of the bodies whose inertias come from geoms."""
    always = (
        spec.compiler.inertiafromgeom
        == import_mujoco().mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    )
    shaped = {geom.parent.name for geom in spec.geoms if _contributes(spec, geom)}
    heavy = {b.name for b in spec.bodies if always or not b.explicitinertial} & shaped
    return {name for name in heavy if float(model.body(name).mass[0]) > 2 * NO_MASS}


def absent_meshes(spec: Any, directory: Path | None) -> set[str]:
    """Names of meshes whose files are not there."""
    folder = None if directory is None else directory / spec.meshdir
    strip = spec.strippath
    files = {
        mesh_name(m): PurePath(m.file).name if strip else m.file
        for m in spec.meshes
        if m.file
    }
    return {
        name
        for name, file in files.items()
        if folder is None or not (folder / file).is_file()
    }


def mesh_name(mesh: Any) -> str:
    """The name by which geoms refer to a mesh."""
    return (
        str(mesh.name) or PurePath(mesh.file).stem
    )  # older versions find the latter only while compiling


def _remove_meshes(spec: Any, doomed: Collection[str]) -> set[str]:
    """Delete meshes and their geoms; returns the names of the bodies that lose inertia."""
    losers = set()
    for geom in [g for g in spec.geoms if g.meshname in doomed and g.meshname]:
        losers.add(str(geom.parent.name))
        spec.delete(geom)
    for mesh in [m for m in spec.meshes if mesh_name(m) in doomed]:
        spec.delete(mesh)
    return losers
