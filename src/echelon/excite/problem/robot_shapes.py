"""Collision shapes of URDF and MJCF files.

Links that are fixed to others ride on the bodies that carry them, so their shapes are placed in those bodies' frames.
Meshes stand for their convex hulls, which are larger where a mesh is hollow or bent: distances are then too small,
never too large.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path, PurePath, PurePosixPath
from typing import Any

import numpy as np

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.excite.problem.shapes import Kind, Shape, placed
from echelon.extras import extra
from echelon.formats.literal import LiteralPlacement, LiteralTree, numeric_placement, rotation_matrix
from echelon.formats.mjcf.mjcf_model import import_mujoco, keep_bodies, parse_spec
from echelon.formats.mjcf.mjcf_numbers import quaternion_matrix
from echelon.formats.robot_file import RobotFile
from echelon.mechanism.body import GROUND
from echelon.mechanism.mechanism import Mechanism

STAND_IN = "shapes of the set-up can stand in for it"
"""Advice for a shape that cannot be read."""


@dataclass(frozen=True)
class Geometry:
    """Shapes of a file."""

    shapes: tuple[Shape, ...]
    excluded: tuple[tuple[str, str], ...] = ()  # pairs of links that the file declares not to collide
    notes: tuple[str, ...] = ()  # what was left out, and why


def carrying_bodies(tree: LiteralTree, mechanism: Mechanism) -> tuple[tuple[int, Floats], ...]:
    """For every link of a file, the body that carries it and the link's frame in the body's, shape (4, 4)."""
    bodies: Mapping[str, int] = {body.name: index for index, body in enumerate(mechanism.bodies)}
    found: list[tuple[int, Floats]] = []
    for index, link in enumerate(tree.links):
        if link.name in bodies and not (index == 0 and tree.root_is_world):
            found.append((bodies[link.name], np.eye(4)))
            continue
        body, place = found[link.parent] if link.parent >= 0 else (GROUND, np.eye(4))
        for step in link.steps:
            if not isinstance(step, LiteralPlacement):
                problem = "it moves but is not a body of the mechanism; read both from the same file"
                raise InputError(problem, source=tree.source, element=f"link '{link.name}'")
            place = place @ numeric_placement(step)
        found.append((body, place))
    return tuple(found)


READABLE = (".stl", ".obj", ".msh")
"""Suffixes of meshes that MuJoCo reads."""


def find_mesh(name: str, directory: Path) -> Path | None:
    """The file that a robot file means by a path or a URL ``package://…``, ``model://…`` or ``file://…``, if any.

    A package is looked for in all folders above the robot file, then in those of ``ROS_PACKAGE_PATH`` and
    ``AMENT_PREFIX_PATH``.
    """
    scheme, found, rest = name.partition("://")
    if not found or scheme == "file":
        candidates = iter([directory / (rest if found else name)])
    else:
        package, *inside = PurePosixPath(rest).parts or ("",)
        candidates = (folder.joinpath(*inside) for folder in _packages(package, directory.resolve()))
    return next((file for file in candidates if file.is_file()), None)


def _packages(name: str, directory: Path) -> Iterator[Path]:
    """Folders that may be a package."""
    above = (directory, *directory.parents)
    yield from (folder for folder in above if folder.name == name)
    yield from (folder / name for folder in above)
    for folder in map(Path, filter(None, os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep))):
        yield folder if folder.name == name else folder / name
    for folder in map(Path, filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep))):
        yield folder / "share" / name


def mesh_vertices(file: Path, scale: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> Floats:
    """Vertices of a mesh file in the file's own frame, shape (k, 3)."""
    if file.suffix.lower() not in READABLE:
        raise InputError(f"'{file.suffix}' meshes cannot be read (valid: {', '.join(READABLE)})", source=str(file))
    mujoco = import_mujoco("excite")
    spec = mujoco.MjSpec()
    mesh = spec.add_mesh(name="mesh", file=str(file.resolve()), scale=scale)
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="mesh")
    try:
        model = spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        reason = str(error).splitlines()[0].removeprefix("Error: ") if str(error) else "no reason given"
        raise InputError(f"the mesh cannot be read: {reason}", source=str(file)) from None
    # MuJoCo moves vertices to the mesh's centre and principal axes
    return np.asarray(model.mesh_vert @ quaternion_matrix(model.geom_quat[0]).T + model.geom_pos[0])


def mesh_shape(name: str, body: int, placement: Floats, vertices: Floats, link: str = "") -> Shape:
    """A mesh as a shape, which keeps the vertices of the convex hull only."""
    with extra("excite"):
        from scipy.spatial import ConvexHull, QhullError

    shape = Shape(name, body, Kind.MESH, (), placement, np.asarray(vertices, dtype=float), link)
    try:
        hull = ConvexHull(vertices)
    except QhullError:
        problem = "its vertices lie in a plane: a thin box can stand in for it"
        raise InputError(problem, element=f"shape '{name}'") from None
    return replace(shape, vertices=np.asarray(vertices, dtype=float)[np.sort(hull.vertices)])


def urdf_geometry(mechanism: Mechanism, file: RobotFile, tolerant: bool = False) -> Geometry:
    """Shapes of all ``<collision>`` elements; see :func:`read_geometry`."""
    tree = file.tree(mimics=False)
    placement = {link.name: where for link, where in zip(tree.links, carrying_bodies(tree, mechanism), strict=True)}
    shapes: list[Shape] = []
    notes: list[str] = []
    for link in file.root.findall("link"):
        name = link.get("name")
        body, place = placement[name]
        for element, own in _named(link):
            reader = _Reader(element, own, name, file)
            try:
                shapes.append(reader.shape(body, place))
            except InputError as error:
                if not tolerant:
                    raise
                notes.append(f"left out: {error}")
    return Geometry(tuple(shapes), notes=tuple(notes))


def _named(link: Any) -> Iterator[tuple[Any, str]]:
    """Collision elements with names: those of the links, numbered if there are several."""
    elements = link.findall("collision")
    for number, element in enumerate(elements, start=1):
        yield element, link.get("name") if len(elements) == 1 else f"{link.get('name')}/{number}"


class _Reader:
    """One collision element."""

    def __init__(self, element: Any, name: str, link: str, file: RobotFile) -> None:
        self.element, self.name, self.link, self.file = element, name, link, file

    def shape(self, body: int, place: Floats) -> Shape:
        """The shape, placed in the frame of a body in which the link has a place."""
        geometry = self.element.find("geometry")
        form = None if geometry is None or len(geometry) == 0 else geometry[0]
        placement = place @ self._origin()
        if form is not None and form.tag == "mesh":
            return mesh_shape(self.name, body, placement, self._vertices(form), self.link)
        if form is not None and form.tag == "box":
            x, y, z = self._numbers(form, "size", 3)
            return Shape(self.name, body, Kind.BOX, (x / 2, y / 2, z / 2), placement, link=self.link)
        if form is not None and form.tag == "sphere":
            return Shape(self.name, body, Kind.SPHERE, self._numbers(form, "radius", 1), placement, link=self.link)
        if form is not None and form.tag in ("cylinder", "capsule"):
            size = (*self._numbers(form, "radius", 1), self._numbers(form, "length", 1)[0] / 2)
            return Shape(self.name, body, Kind(form.tag), size, placement, link=self.link)
        found = "nothing" if form is None else f"<{form.tag}>"
        raise self._error(f"its geometry is {found}; expected <box>, <cylinder>, <capsule>, <sphere> or <mesh>")

    def _origin(self) -> Floats:
        origin = self.element.find("origin")
        if origin is None:
            return np.eye(4)
        rotation = rotation_matrix(*self._numbers(origin, "rpy", 3, "0 0 0"))
        return placed(rotation, self._numbers(origin, "xyz", 3, "0 0 0"))

    def _vertices(self, form: Any) -> Floats:
        name = form.get("filename")
        if not name:
            raise self._error("a <mesh> needs filename='…'")
        x, y, z = self._numbers(form, "scale", 3, "1 1 1")
        suffix = Path(name).suffix.lower()
        if suffix not in READABLE:
            raise self._error(f"mesh '{name}' cannot be read (valid: {', '.join(READABLE)}); {STAND_IN}")
        found = find_mesh(name, self.file.directory or Path())
        if found is None:
            raise self._error(f"mesh '{name}' is not found; {STAND_IN}")
        try:
            return mesh_vertices(found, (x, y, z))
        except InputError as error:
            raise self._error(f"mesh '{name}': {error.problem}; {STAND_IN}") from None

    def _numbers(self, element: Any, name: str, count: int, default: str = "") -> tuple[float, ...]:
        text = element.get(name, default)
        try:
            values = tuple(float(word) for word in text.split())
        except ValueError:
            values = ()
        if len(values) != count or not np.all(np.isfinite(values)):
            numbers = "a number" if count == 1 else f"{count} numbers"
            raise self._error(f"<{element.tag}> needs {name} = {numbers}, found '{text}'")
        return values

    def _error(self, problem: str) -> InputError:
        return InputError(problem, source=self.file.source, element=f"collision of link '{self.link}'")


# None of these is a shape, and some refer to geoms or files that are taken away.
_OTHERS = ("keys", "sensors", "actuators", "tendons", "pairs", "excludes", "skins", "tuples", "equalities")
_SIZES = {Kind.SPHERE: 1, Kind.CAPSULE: 2, Kind.CYLINDER: 2, Kind.BOX: 3, Kind.ELLIPSOID: 3, Kind.PLANE: 0}


def mjcf_geometry(mechanism: Mechanism, file: RobotFile, tolerant: bool = False) -> Geometry:
    """Shapes of all geoms that collide with something; see :func:`read_geometry`."""
    source, tree = file.source, file.tree(mimics=False)
    spec = parse_spec(file.mjcf)
    excluded = tuple((str(pair.bodyname1), str(pair.bodyname2)) for pair in spec.excludes)
    doomed = list(_unreadable(spec, file.directory or Path()))
    if doomed and not tolerant:
        raise InputError(doomed[0][1], source=source, element=doomed[0][0])
    model = _compiled(spec, source)
    # bodies have the same order everywhere, but the readers name those without a name
    links = list(zip((link.name for link in tree.links), carrying_bodies(tree, mechanism), strict=True))
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


def _unreadable(spec: Any, directory: Path) -> Iterator[tuple[str, str]]:
    """Remove what is no shape, and geoms whose meshes are missing; yields the latter with what is wrong."""
    for group in _OTHERS:
        for element in list(getattr(spec, group)):
            spec.delete(element)
    for material in spec.materials:
        material.textures = [""] * len(material.textures)
    folder = directory / spec.meshdir
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
    mujoco = import_mujoco("excite")
    keep_bodies(spec)
    spec.compiler.balanceinertia = True
    try:
        return spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        reason = " ".join(line.strip() for line in str(error).splitlines() if line.strip())
        raise InputError(f"MuJoCo refuses the model: {reason.removeprefix('Error: ')}", source=source) from None


def _shape(model: Any, geom: int, link: str, body: int, place: Floats) -> Shape:
    mujoco = import_mujoco("excite")
    name = str(model.geom(geom).name) or f"{link}/{geom - int(model.body_geomadr[model.geom_bodyid[geom]]) + 1}"
    placement = place @ placed(quaternion_matrix(model.geom_quat[geom]), model.geom_pos[geom])
    kind = mujoco.mjtGeom(int(model.geom_type[geom])).name.removeprefix("mjGEOM_").lower()
    if kind == "mesh":
        mesh = int(model.geom_dataid[geom])
        first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
        vertices = np.asarray(model.mesh_vert[first : first + count], dtype=float)
        return mesh_shape(name, body, placement, vertices, link)
    if kind not in list(Kind) or (kind == "plane" and body != GROUND):
        problem = (
            "a plane on a moving body is not supported"
            if kind == "plane"
            else f"shapes of type '{kind}' are not convex solids"
        )
        raise InputError(f"{problem}; {STAND_IN}", element=f"geom '{name}' of body '{link}'")
    sizes = tuple(float(v) for v in model.geom_size[geom][: _SIZES[Kind(kind)]])
    return Shape(name, body, Kind(kind), sizes, placement, link=link)


def read_geometry(mechanism: Mechanism, file: RobotFile, *, tolerant: bool = False) -> Geometry:
    """Collision shapes of a URDF or MJCF file.

    Meshes stand for their convex hulls, which are larger where a mesh is hollow or bent: distances are then too small,
    never too large.
    """
    tag = file.root.tag
    if tag == "robot":
        return urdf_geometry(mechanism, file, tolerant)
    if tag == "mujoco":
        return mjcf_geometry(mechanism, file, tolerant)
    problem = f"the root element is <{tag}>; expected <robot> (URDF) or <mujoco> (MJCF)"
    raise InputError(problem, source=file.source)
