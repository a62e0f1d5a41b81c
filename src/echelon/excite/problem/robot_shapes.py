"""Collision shapes: of URDF and MJCF files, and those that a set-up states for a robot and for what is around it.

Links that are fixed to others ride on the bodies that carry them, so their shapes are placed in those bodies' frames.
Meshes stand for their convex hulls, which are larger where a mesh is hollow or bent: distances are then too small,
never too large.

An entry of a set-up names a body and one shape::

    {"body": "link3", "sphere": 0.06, "at": [0, 0, 0.1]}
    {"body": "link3", "capsule": 0.05, "from": [0, 0, 0], "to": [0, 0, 0.4]}
    {"body": "link2", "box": [0.1, 0.1, 0.4], "at": [0, 0, 0.2], "rpy": [0, 0, 0.3]}
    {"body": "world", "plane": [0, 0, 1], "through": [0, 0, -0.1]}

Lengths are in m, angles in rad, in the frame of the body.  Boxes have full lengths, as in URDF and SDF; ellipsoids have
semi-axes.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
import numpy.typing as npt

from echelon.algebra import Rational
from echelon.excite.problem.shapes import (
    SIZES,
    WORLD,
    Shape,
    ShapeKind,
    placed,
    z_along,
)
from echelon.formats import (
    IRRELEVANT,
    ExactXml,
    LiteralPlacement,
    LiteralTree,
    RobotFile,
    absent_meshes,
    import_mujoco,
    keep_bodies,
    mesh_name,
    numeric_placement,
    parse_spec,
    quaternion_matrix,
    refusal,
    remove_groups,
    remove_unused,
    rotation_matrix,
)
from echelon.robot import GROUND, Mechanism
from echelon.shared import Floats, InputError, extra

STAND_IN = "add a shape under collisions"  # advice for a shape that cannot be read


@dataclass(frozen=True)
class LostShape:
    """A shape of a file that cannot be read."""

    link: str
    body: int  # that carries the link, −1 for the world
    problem: str  # where and why, and what to do


@dataclass(frozen=True)
class FileShapes:
    """Shapes of a file."""

    shapes: tuple[Shape, ...]
    excluded: tuple[
        tuple[str, str], ...
    ] = ()  # pairs of links that the file declares not to collide
    lost: tuple[LostShape, ...] = ()


Place = tuple[int, Floats]
"""The body that carries a link, −1 for the world, and the link's frame in the body's, shape (4, 4)."""


def carrying_bodies(tree: LiteralTree, mechanism: Mechanism) -> tuple[Place, ...]:
    """For every link of a file, the body that carries it and the link's frame in the body's, shape (4, 4)."""
    bodies: Mapping[str, int] = {
        body.name: index for index, body in enumerate(mechanism.bodies)
    }
    found: list[Place] = []
    for index, link in enumerate(tree.links):
        if link.name in bodies and not (index == 0 and tree.root_is_world):
            found.append((bodies[link.name], np.eye(4)))
            continue
        body, place = found[link.parent] if link.parent >= 0 else (GROUND, np.eye(4))
        for step in link.steps:
            if not isinstance(step, LiteralPlacement):
                problem = "it moves but is not a body of the mechanism; read both from the same file"
                raise InputError(
                    problem, source=tree.source, element=f"link '{link.name}'"
                )
            place = place @ numeric_placement(step)
        found.append((body, place))
    return tuple(found)


READABLE = (".stl", ".obj", ".msh")  # suffixes of meshes that MuJoCo reads


def find_mesh(name: str, directory: Path) -> Path | None:
    """The file that a robot file means by a path or a URL ``package://…``, ``model://…`` or ``file://…``, if any."""
    # a package is looked for in all folders above the robot file, then in those of `ROS_PACKAGE_PATH` and
    # `AMENT_PREFIX_PATH`
    scheme, found, rest = name.partition("://")
    if not found or scheme == "file":
        candidates = iter([directory / (rest if found else name)])
    else:
        package, *inside = PurePosixPath(rest).parts or ("",)
        candidates = (
            folder.joinpath(*inside)
            for folder in _packages(package, directory.resolve())
        )
    return next((file for file in candidates if file.is_file()), None)


def _packages(name: str, directory: Path) -> Iterator[Path]:
    """Folders that may be a package."""
    above = (directory, *directory.parents)
    yield from (folder for folder in above if folder.name == name)
    yield from (folder / name for folder in above)
    for folder in map(
        Path, filter(None, os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep))
    ):
        yield folder if folder.name == name else folder / name
    for folder in map(
        Path, filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep))
    ):
        yield folder / "share" / name


def mesh_vertices(
    name: str, directory: Path, scale: Sequence[float | Rational]
) -> Floats:
    """Vertices of the mesh that a robot file or a set-up names, in the mesh's own frame, shape (k, 3)."""
    file = find_mesh(name, directory)
    if Path(name).suffix.lower() not in READABLE:
        raise InputError(f"mesh '{name}' cannot be read (valid: {', '.join(READABLE)})")
    if file is None:
        raise InputError(
            f"mesh '{name}' not found; set ROS_PACKAGE_PATH to the folder of the package"
        )
    mujoco = import_mujoco("excite")
    spec = mujoco.MjSpec()
    mesh = spec.add_mesh(
        name="mesh", file=str(file.resolve()), scale=list(map(float, scale))
    )
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="mesh")
    try:
        model = spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        reason = (
            str(error).splitlines()[0].removeprefix("Error: ")
            if str(error)
            else "no reason given"
        )
        raise InputError(f"mesh '{name}' cannot be read: {reason}") from None
    # MuJoCo moves vertices to the mesh's centre and principal axes
    return np.asarray(
        model.mesh_vert @ quaternion_matrix(model.geom_quat[0]).T + model.geom_pos[0]
    )


def mesh_shape(
    name: str, body: int, placement: Floats, vertices: Floats, link: str = ""
) -> Shape:
    """A mesh as a shape, which keeps the vertices of the convex hull only."""
    with extra("excite"):
        from scipy.spatial import ConvexHull, QhullError

    try:
        kept = np.sort(ConvexHull(vertices).vertices)
    except QhullError:
        problem = "its vertices lie in a plane: use a thin box"
        raise InputError(problem, element=f"shape '{name}'") from None
    return Shape(name, body, ShapeKind.MESH, (), placement, vertices[kept], link)


def urdf_geometry(
    mechanism: Mechanism, file: RobotFile, tolerant: bool = False
) -> FileShapes:
    """Shapes of all ``<collision>`` elements; see :func:`read_geometry`."""
    placement = link_places(mechanism, file)
    shapes: list[Shape] = []
    lost: list[LostShape] = []
    for link in file.root.findall("link"):
        name = link.get("name")
        elements = link.findall("collision")
        for number, element in enumerate(elements, start=1):
            own = name if len(elements) == 1 else f"{name}/{number}"
            try:
                shapes.append(_collision(element, own, name, placement[name], file))
            except InputError as error:
                if not tolerant:
                    raise
                lost.append(LostShape(name, placement[name][0], str(error)))
    return FileShapes(tuple(shapes), lost=tuple(lost))


def _collision(
    element: Any, name: str, link: str, place: Place, file: RobotFile
) -> Shape:
    """A collision element of a link, placed in the frame of the body that carries the link."""
    xml = ExactXml(file.source)
    where = f"collision of link '{link}'"
    geometry = element.find("geometry")
    form: Any = None if geometry is None or len(geometry) == 0 else geometry[0]
    body, placement = place[0], place[1] @ numeric_placement(xml.origin(element, where))

    def number(key: str) -> float:
        return float(xml.number(form.get(key, ""), f"{where} {key}"))

    match "nothing" if form is None else form.tag:
        case "mesh":
            scale = xml.triple(form.get("scale"), (1, 1, 1), f"{where} scale")
            try:
                vertices = mesh_vertices(
                    form.get("filename", ""), file.directory or Path(), scale
                )
            except InputError as error:
                raise xml.error(f"{error.problem}; {STAND_IN}", where) from None
            return mesh_shape(name, body, placement, vertices, link)
        case "box":
            x, y, z = map(
                float, xml.triple(form.get("size", ""), (0, 0, 0), f"{where} size")
            )
            return Shape(
                name, body, ShapeKind.BOX, (x / 2, y / 2, z / 2), placement, link=link
            )
        case "sphere":
            return Shape(
                name, body, ShapeKind.SPHERE, (number("radius"),), placement, link=link
            )
        case "cylinder" | "capsule" as kind:
            return Shape(
                name,
                body,
                ShapeKind(kind),
                (number("radius"), number("length") / 2),
                placement,
                link=link,
            )
        case other:
            shown = other if form is None else f"<{other}>"
            problem = f"its geometry is {shown}; expected <box>, <cylinder>, <capsule>, <sphere> or <mesh>"
            raise xml.error(problem, where)


def mjcf_geometry(
    mechanism: Mechanism, file: RobotFile, tolerant: bool = False
) -> FileShapes:
    """Shapes of all geoms that collide with something; see :func:`read_geometry`."""
    source, tree = file.source, file.tree(mimics=False)
    spec = parse_spec(file.mjcf)
    excluded = tuple(
        (str(pair.bodyname1), str(pair.bodyname2)) for pair in spec.excludes
    )
    # bodies have the same order everywhere, but the readers name those without a name
    links = list(
        zip(
            (link.name for link in tree.links),
            carrying_bodies(tree, mechanism),
            strict=True,
        )
    )
    lost = []
    for number, problem in _remove_others(spec, file.directory or Path()):
        link, (body, _) = links[number]
        error = InputError(problem, source=source, element=f"geom of body '{link}'")
        if not tolerant:
            raise error
        lost.append(LostShape(link, body, str(error)))
    model = _compiled(spec, source)
    shapes = []
    for geom in range(model.ngeom):
        link, (body, place) = links[int(model.geom_bodyid[geom])]
        try:
            shapes.append(_geom(model, geom, link, body, place))
        except InputError as error:
            if not tolerant:
                raise error.located(source) from None
            lost.append(LostShape(link, body, str(error.located(source))))
    return FileShapes(tuple(shapes), excluded, tuple(lost))


def _remove_others(spec: Any, directory: Path) -> list[tuple[int, str]]:
    """Remove all but geoms that collide and can be read; the bodies of those that cannot, with what is wrong."""
    remove_groups(spec, (*IRRELEVANT, "equalities"))  # some refer to what is taken away
    absent = absent_meshes(spec, directory)
    files = {mesh_name(mesh): mesh.file for mesh in spec.meshes}
    lost = []
    owned = [(k, geom) for k, body in enumerate(spec.bodies) for geom in body.geoms]
    for place, geom in owned:
        problem = "a height field is not convex" if geom.hfieldname else ""
        if geom.meshname in absent:
            problem = f"mesh '{files[geom.meshname]}' not found"
        collides = bool(geom.contype or geom.conaffinity)
        if problem and collides:
            lost.append((place, f"{problem}; {STAND_IN}"))
        if problem or not collides:
            spec.delete(geom)
    remove_unused(spec)
    return lost


def _compiled(spec: Any, source: str) -> Any:
    mujoco = import_mujoco("excite")
    keep_bodies(spec)
    spec.compiler.balanceinertia = True
    try:
        return spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise refusal(error, source) from None


def _geom(model: Any, geom: int, link: str, body: int, place: Floats) -> Shape:
    mujoco = import_mujoco("excite")
    name = (
        str(model.geom(geom).name)
        or f"{link}/{geom - int(model.body_geomadr[model.geom_bodyid[geom]]) + 1}"
    )
    placement = place @ placed(
        quaternion_matrix(model.geom_quat[geom]), model.geom_pos[geom]
    )
    kind = (
        mujoco.mjtGeom(int(model.geom_type[geom])).name.removeprefix("mjGEOM_").lower()
    )
    if kind == "mesh":
        mesh = int(model.geom_dataid[geom])
        first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
        vertices = np.asarray(model.mesh_vert[first : first + count], dtype=float)
        return mesh_shape(name, body, placement, vertices, link)
    problem = (
        ""
        if kind in list(ShapeKind)
        else f"shapes of type '{kind}' are not convex solids"
    )
    if kind == "plane" and body != GROUND:
        problem = "a plane on a moving body is not supported"
    if problem:
        raise InputError(
            f"{problem}; {STAND_IN}", element=f"geom '{name}' of body '{link}'"
        )
    sizes = tuple(
        float(v) for v in model.geom_size[geom][: len(SIZES[ShapeKind(kind)])]
    )
    return Shape(name, body, ShapeKind(kind), sizes, placement, link=link)


def link_places(mechanism: Mechanism, file: RobotFile) -> dict[str, Place]:
    """Where the links of a URDF or MJCF file are, by name."""
    tree = file.tree(mimics=False)
    places = carrying_bodies(tree, mechanism)
    return {link.name: place for link, place in zip(tree.links, places, strict=True)}


def read_geometry(
    mechanism: Mechanism, file: RobotFile, *, tolerant: bool = False
) -> FileShapes:
    """Collision shapes of a URDF or MJCF file; with ``tolerant``, those that cannot be read are returned as lost."""
    tag = file.root.tag
    if tag == "robot":
        return urdf_geometry(mechanism, file, tolerant)
    if tag == "mujoco":
        return mjcf_geometry(mechanism, file, tolerant)
    problem = f"the root element is <{tag}>; expected <robot> (URDF) or <mujoco> (MJCF)"
    raise InputError(problem, source=file.source)


# -- shapes of a set-up ------------------------------------------------------------------------------------------------

_POSED = ("at", "rpy")
_ALLOWED = {
    ShapeKind.SPHERE: ("at",),
    ShapeKind.CAPSULE: ("from", "to"),
    ShapeKind.CYLINDER: ("from", "to"),
    ShapeKind.BOX: _POSED,
    ShapeKind.ELLIPSOID: _POSED,
    ShapeKind.PLANE: ("through",),
    ShapeKind.MESH: (*_POSED, "scale"),
}


def entry_shapes(
    mechanism: Mechanism,
    entries: Sequence[Mapping[str, Any]],
    directory: Path | None = None,
    refused: Callable[[int, str], InputError] | None = None,
    links: Mapping[str, Place] | None = None,
) -> tuple[Shape, ...]:
    """Shapes of a set-up, whose meshes are looked for from a directory.

    ``refused`` makes an error of the place of an entry and a problem.  Entries may also name links of the robot's file.
    """
    found = []
    for number, entry in enumerate(entries, start=1):
        try:
            found.append(
                _stated(entry, number, mechanism, directory or Path(), links or {})
            )
        except InputError as error:
            named = entry.get("name") if hasattr(entry, "get") else None
            problem = error.problem if named is None else f"'{named}': {error.problem}"
            if refused is not None:
                raise refused(number - 1, problem) from None
            raise InputError(
                problem, source=error.source, element=f"shapes, entry {number}"
            ) from None
    return tuple(found)


def _stated(
    entry: Mapping[str, Any],
    number: int,
    mechanism: Mechanism,
    directory: Path,
    links: Mapping[str, Place],
) -> Shape:
    """An entry as a shape, placed in the frame of the body or link that it names."""
    kind = _kind(entry)
    body, frame = _place(entry.get("body"), mechanism, links)
    own = _formed(entry, kind, number, body, directory)
    link = str(entry["body"])
    return replace(
        own, placement=frame @ own.placement, link=link if link in links else ""
    )


def _formed(
    entry: Mapping[str, Any],
    kind: ShapeKind,
    number: int,
    body: int,
    directory: Path,
) -> Shape:
    """An entry as a shape in the frame that it is stated in."""
    unnamed = (
        f"{kind} {number}" if body == GROUND else f"{entry['body']}:{kind}{number}"
    )
    name = str(entry.get("name", unnamed))
    if kind is ShapeKind.PLANE:
        normal = _direction(_numbers(entry, kind.value, 3), "the normal")
        return Shape(
            name, body, kind, (), placed(z_along(normal), _triple(entry, "through"))
        )
    if kind in (ShapeKind.CAPSULE, ShapeKind.CYLINDER):
        return _between(entry, name, body, kind)
    pose = placed(rotation_matrix(*_triple(entry, "rpy")), _triple(entry, "at"))
    if kind is ShapeKind.MESH:
        if not isinstance(entry["mesh"], str):
            raise InputError(f"'mesh' needs the name of a file, got {entry['mesh']!r}")
        scale = _numbers(entry, "scale", 3) if "scale" in entry else [1.0, 1.0, 1.0]
        return mesh_shape(
            name, body, pose, mesh_vertices(entry["mesh"], directory, scale)
        )
    sizes = _numbers(entry, kind.value, len(SIZES[kind]))
    if kind is ShapeKind.BOX:
        sizes = [length / 2 for length in sizes]
    return Shape(name, body, kind, tuple(sizes), pose)


def _kind(entry: Mapping[str, Any]) -> ShapeKind:
    """The kind of an entry, which has no keys that mean nothing to it."""
    if not isinstance(entry, Mapping):
        raise InputError(
            f"expected a mapping such as {{body: link3, sphere: 0.06}}, got {entry!r}"
        )
    kinds = [kind for kind in ShapeKind if kind.value in entry]
    if len(kinds) != 1:
        found = " and ".join(kinds) if kinds else "none"
        raise InputError(
            f"it needs exactly one of {', '.join(ShapeKind)}; found {found}"
        )
    valid = ("body", "name", kinds[0].value, *_ALLOWED[kinds[0]])
    strange = next((key for key in entry if key not in valid), None)
    if strange is not None:
        raise InputError(
            f"'{strange}' has no meaning for a {kinds[0]} (valid: {', '.join(valid)})"
        )
    return kinds[0]


def _place(name: object, mechanism: Mechanism, links: Mapping[str, Place]) -> Place:
    """The body that carries what is named, −1 for the world, and the frame of that in the body's."""
    names = [body.name for body in mechanism.bodies]
    if name in links:
        return links[str(name)]
    if name in names:
        return names.index(str(name)), np.eye(4)
    if name in WORLD:
        return GROUND, np.eye(4)
    problem = (
        f"there is no body '{name}'"
        if name is not None
        else "it does not name its body"
    )
    valid = dict.fromkeys((*names, *links, WORLD[0]))
    raise InputError(f"{problem} (valid: {', '.join(valid)})")


def _between(entry: Mapping[str, Any], name: str, body: int, kind: ShapeKind) -> Shape:
    """A capsule or cylinder between the ends of its axis."""
    for key in ("from", "to"):
        if key not in entry:
            raise InputError(f"a {kind} needs '{key}', an end of its axis")
    first, last = _triple(entry, "from"), _triple(entry, "to")
    along = _direction(last - first, "the way from 'from' to 'to'")
    size = (_numbers(entry, kind.value, 1)[0], float(np.linalg.norm(along)) / 2)
    return Shape(name, body, kind, size, placed(z_along(along), (first + last) / 2))


def _triple(entry: Mapping[str, Any], key: str) -> Floats:
    return np.array(_numbers(entry, key, 3)) if key in entry else np.zeros(3)


def _numbers(entry: Mapping[str, Any], key: str, count: int) -> list[float]:
    given = entry[key]
    try:
        values = list(map(float, np.atleast_1d(np.asarray(given, dtype=float))))
    except (TypeError, ValueError):
        values = []
    if len(values) != count or not np.all(np.isfinite(values)):
        raise InputError(
            f"'{key}' needs {'a number' if count == 1 else f'{count} numbers'}, got {given!r}"
        )
    return values


def _direction(vector: npt.ArrayLike, what: str) -> Floats:
    found = np.asarray(vector, dtype=float)
    if not np.any(found):
        raise InputError(f"{what} must not be zero")
    return found
