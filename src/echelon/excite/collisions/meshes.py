"""Meshes of robot files: where they are, and the convex hulls of their vertices."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path, PurePosixPath

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.excite.collisions.shapes import Kind, Shape
from echelon.formats.mjcf_numbers import quaternion_matrix
from echelon.formats.mjcf_spec import import_mujoco

READABLE = (".stl", ".obj", ".msh")
"""What MuJoCo reads."""


def find_mesh(name: str, directory: Path) -> Path | None:
    """The file that a robot file means by a name.

    Parameters
    ----------
    name : str
        A path, relative to the robot file, or a URL ``package://…``, ``model://…`` or ``file://…``.  A package is
        looked for in all folders above the robot file, then in those of ``ROS_PACKAGE_PATH`` and
        ``AMENT_PREFIX_PATH``.
    directory : Path
        The folder of the robot file.

    Returns
    -------
    Path or None
        None if there is no such file.
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
    """Vertices of a mesh file in the file's own frame.

    Parameters
    ----------
    file : Path
        One of :data:`READABLE`.
    scale : 3 floats
        Along the file's axes.

    Returns
    -------
    array of shape (k, 3)
        m.

    Raises
    ------
    InputError
        If MuJoCo cannot read it.
    """
    if file.suffix.lower() not in READABLE:
        raise InputError(f"'{file.suffix}' meshes cannot be read (valid: {', '.join(READABLE)})", source=str(file))
    mujoco = import_mujoco()
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
    """A mesh as a shape, which keeps the vertices of the convex hull only.

    Raises
    ------
    InputError
        If the vertices span no volume.
    """
    shape = Shape(name, body, Kind.MESH, (), placement, np.asarray(vertices, dtype=float), link)
    try:
        hull = ConvexHull(vertices)
    except QhullError:
        problem = "its vertices lie in a plane: a thin box can stand in for it"
        raise InputError(problem, element=f"shape '{name}'") from None
    return replace(shape, vertices=np.asarray(vertices, dtype=float)[np.sort(hull.vertices)])
