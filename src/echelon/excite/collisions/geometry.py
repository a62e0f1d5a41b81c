"""The shapes of a robot's own file."""

from __future__ import annotations

import os
from pathlib import Path

from echelon.errors import InputError
from echelon.excite.collisions.carriers import Geometry
from echelon.excite.collisions.mjcf import mjcf_geometry
from echelon.excite.collisions.urdf import urdf_geometry
from echelon.inputs.content import read_content
from echelon.inputs.xml_text import parse_xml
from echelon.mechanism.mechanism import Mechanism


def read_geometry(mechanism: Mechanism, path: str | os.PathLike[str], *, tolerant: bool = False) -> Geometry:
    """Collision shapes of a URDF or MJCF file.

    Meshes stand for their convex hulls, which are larger where a mesh is hollow or bent: distances are then too small,
    never too large.

    Parameters
    ----------
    mechanism : Mechanism
        Read from the same file; links that it does not have as bodies ride on those that carry them.
    path : path-like
    tolerant : bool
        Leave out shapes that cannot be read, with a note, in place of an error.

    Returns
    -------
    Geometry

    Raises
    ------
    InputError
        If the file is not one of these, does not fit the mechanism, or has a shape that cannot be read; names the link
        and the mesh.
    MissingExtraError
        If MuJoCo, which reads meshes and MJCF files, is not installed.
    """
    file = Path(path)
    text = read_content(file)
    tag = parse_xml(text, str(file)).tag
    if tag == "robot":
        return urdf_geometry(mechanism, text, file, tolerant)
    if tag == "mujoco":
        return mjcf_geometry(mechanism, text, file, tolerant)
    problem = f"the root element is <{tag}>; expected <robot> (URDF) or <mujoco> (MJCF)"
    raise InputError(problem, source=str(file))
