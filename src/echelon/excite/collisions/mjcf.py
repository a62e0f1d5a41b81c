"""Collision shapes of MJCF files, as MuJoCo's own compiler understands them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path, PurePath
from typing import Any

import numpy as np

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.excite.collisions.carriers import STAND_IN, Geometry, carriers
from echelon.excite.collisions.meshes import mesh_shape
from echelon.excite.collisions.shapes import Kind, Shape, placed
from echelon.formats.mjcf import read_mjcf
from echelon.formats.mjcf_numbers import quaternion_matrix
from echelon.formats.mjcf_spec import NO_MASS, import_mujoco, parse_spec
from echelon.mechanism.mechanism import GROUND, Mechanism

# None of these is a shape, and some refer to geoms or files that are taken away.
_OTHERS = ("keys", "sensors", "actuators", "tendons", "pairs", "excludes", "skins", "tuples", "equalities")
_SIZES = {Kind.SPHERE: 1, Kind.CAPSULE: 2, Kind.CYLINDER: 2, Kind.BOX: 3, Kind.ELLIPSOID: 3, Kind.PLANE: 0}


def mjcf_geometry(mechanism: Mechanism, text: str | bytes, file: Path, tolerant: bool = False) -> Geometry:
    """Shapes of all geoms that collide with something; see :func:`echelon.excite.collisions.geometry.read_geometry`.

    Parameters
    ----------
    mechanism : Mechanism
    text : str or bytes
        Content of the file.
    file : Path
        For messages, and to find meshes and included files from.
    tolerant : bool
    """
    source = str(file)
    tree = read_mjcf(text, source, file.parent, mimics=False)
    spec = parse_spec(text, source, file.parent)
    excluded = tuple((str(pair.bodyname1), str(pair.bodyname2)) for pair in spec.excludes)
    doomed = list(_unreadable(spec, file))
    if doomed and not tolerant:
        raise InputError(doomed[0][1], source=source, element=doomed[0][0])
    model = _compiled(spec, source)
    # bodies have the same order everywhere, but the readers name those without a name
    links = list(zip((link.name for link in tree.links), carriers(tree, mechanism), strict=True))
    shapes = []
    notes = [f"left out: {source}: {element}: {problem}" for element, problem in doomed]
    for geom in range(model.ngeom):
        link, (body, place) = links[int(model.geom_bodyid[geom])]
        try:
            shapes.append(_shape(model, geom, link, body, place))
        except InputError as error:
            if not tolerant:
                raise error.located(source) from None
            notes.append(f"left out: {error.located(source)}")
    return Geometry(tuple(shapes), excluded, tuple(notes))


def _unreadable(spec: Any, file: Path) -> Iterator[tuple[str, str]]:
    """Remove what is no shape, and geoms whose meshes are missing; yields the latter with what is wrong."""
    for group in _OTHERS:
        for element in list(getattr(spec, group)):
            spec.delete(element)
    for material in spec.materials:
        material.textures = [""] * len(material.textures)
    folder = file.parent / spec.meshdir
    meshes = {mesh.name or PurePath(mesh.file).stem: mesh for mesh in spec.meshes}
    missing = set()
    for name, mesh in meshes.items():
        inside = PurePath(mesh.file).name if spec.strippath else mesh.file
        if mesh.file and not (folder / inside).is_file():
            missing.add(name)
    for geom in list(spec.geoms):
        collides = bool(geom.contype or geom.conaffinity)
        lost = geom.meshname in missing
        if collides and (lost or geom.hfieldname):
            what = f"mesh '{meshes[geom.meshname].file}' is not found" if lost else "a height field is not convex"
            yield f"geom of body '{geom.parent.name}'", f"{what}; {STAND_IN}"
        if lost or geom.hfieldname or not collides:
            spec.delete(geom)
    used = {geom.meshname for geom in spec.geoms}
    unused = [mesh for name, mesh in meshes.items() if name not in used]
    for element in (*spec.textures, *spec.hfields, *unused):
        spec.delete(element)


def _compiled(spec: Any, source: str) -> Any:
    mujoco = import_mujoco()
    compiler = spec.compiler
    compiler.fusestatic = compiler.discardvisual = False
    # masses do not matter here, but the compiler asks for some
    compiler.boundmass, compiler.boundinertia = max(compiler.boundmass, NO_MASS), max(compiler.boundinertia, NO_MASS)
    compiler.balanceinertia = True
    try:
        return spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        reason = " ".join(line.strip() for line in str(error).splitlines() if line.strip())
        raise InputError(f"MuJoCo refuses the model: {reason.removeprefix('Error: ')}", source=source) from None


def _shape(model: Any, geom: int, link: str, body: int, place: Floats) -> Shape:
    mujoco = import_mujoco()
    name = str(model.geom(geom).name) or f"{link}/{geom - int(model.body_geomadr[model.geom_bodyid[geom]]) + 1}"
    placement = place @ placed(quaternion_matrix(model.geom_quat[geom]), model.geom_pos[geom])
    kind = mujoco.mjtGeom(int(model.geom_type[geom])).name.removeprefix("mjGEOM_").lower()
    if kind == "mesh":
        mesh = int(model.geom_dataid[geom])
        first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
        vertices = np.asarray(model.mesh_vert[first : first + count], dtype=float)
        return mesh_shape(name, body, placement, vertices, link)
    if kind not in list(Kind) or (kind == "plane" and body != GROUND):
        problem = "a moving plane has no end" if kind == "plane" else f"shapes of type '{kind}' are not convex solids"
        raise InputError(f"{problem}; {STAND_IN}", element=f"geom '{name}' of body '{link}'")
    sizes = tuple(float(v) for v in model.geom_size[geom][: _SIZES[Kind(kind)]])
    return Shape(name, body, Kind(kind), sizes, placement, link=link)
