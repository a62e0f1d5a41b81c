"""Shapes: convex solids that ride on the bodies of a mechanism, or stand in the world.

All are convex, so that two of them have one smallest distance with a normal, and its derivative is that of two points.
What a shape reaches in a direction (its support) is known in closed form: this bounds distances from below without
trust in any iteration (see :mod:`echelon.excite.collisions.supports`).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.mechanism.mechanism import GROUND

_RIGID = 1e-9  # how far a rotation matrix may be from orthogonal


class Kind(StrEnum):
    """Kinds of shapes."""

    SPHERE = "sphere"
    CAPSULE = "capsule"
    CYLINDER = "cylinder"
    BOX = "box"
    ELLIPSOID = "ellipsoid"
    PLANE = "plane"
    MESH = "mesh"


_SIZES = {
    Kind.SPHERE: ("radius",),
    Kind.CAPSULE: ("radius", "half length"),
    Kind.CYLINDER: ("radius", "half length"),
    Kind.BOX: ("half length in x", "half length in y", "half length in z"),
    Kind.ELLIPSOID: ("semi-axis x", "semi-axis y", "semi-axis z"),
    Kind.PLANE: (),
    Kind.MESH: (),
}


Owner = tuple[int, str]
"""A body, −1 for the world, and the name of an obstacle; no name for all that belongs to the robot."""


@dataclass(frozen=True, eq=False)
class Shape:
    """A convex solid.

    Attributes
    ----------
    name : str
        For messages and exclusions.
    body : int
        Index of the body that carries it, −1 for the world.
    kind : Kind
        Capsules and cylinders lie along z; a plane is the half-space below z = 0 and belongs to the world; a mesh
        stands for the convex hull of its vertices.
    size : tuple of float
        m: the radius of a sphere; radius and half length of a capsule (without its caps) or cylinder; half lengths of a
        box; semi-axes of an ellipsoid; empty for planes and meshes.
    placement : array of shape (4, 4)
        The shape's frame in that of its body.
    vertices : array of shape (k, 3), optional
        Of a mesh, in the shape's frame, m.
    link : str
        The link of a file that it came with, if any.
    obstacle : bool
        Whether it is no part of the robot, so that no body may touch it, and distances to it bear its name.

    Raises
    ------
    InputError
        If sizes, placement or vertices are not those of such a solid.
    """

    name: str
    body: int
    kind: Kind
    size: tuple[float, ...]
    placement: Floats
    vertices: Floats | None = None
    link: str = ""
    obstacle: bool = False

    def __post_init__(self) -> None:
        names = _SIZES[self.kind]
        if len(self.size) != len(names):
            wanted = f"{len(names)} sizes ({', '.join(names)})" if names else "no sizes"
            raise self._error(f"a {self.kind} has {wanted}, got {len(self.size)}")
        for name, value in zip(names, self.size, strict=True):
            if not (np.isfinite(value) and value > 0):
                raise self._error(f"the {name} must be a positive number, got {value}")
        if self.kind is Kind.PLANE and self.body != GROUND:
            raise self._error("a plane is endless: it can only belong to the world")
        self._check_placement()
        self._check_vertices()

    @property
    def owner(self) -> Owner:
        """What distances of it are distances of: its body, or an obstacle by its name."""
        return self.body, self.name if self.obstacle else ""

    def _check_placement(self) -> None:
        if self.placement.shape != (4, 4) or not np.all(np.isfinite(self.placement)):
            raise self._error("the placement must be a 4 × 4 matrix of finite numbers")
        rotation = self.placement[:3, :3]
        if np.abs(rotation @ rotation.T - np.eye(3)).max() > _RIGID or np.linalg.det(rotation) < 0:
            raise self._error("the placement's rotation is not a rotation matrix")

    def _check_vertices(self) -> None:
        if (self.kind is Kind.MESH) != (self.vertices is not None):
            raise self._error("a mesh needs vertices, and no other shape has any")
        if self.vertices is not None and (
            self.vertices.ndim != 2
            or self.vertices.shape[1] != 3
            or len(self.vertices) < 4
            or not np.all(np.isfinite(self.vertices))
        ):
            raise self._error("a mesh needs at least four vertices with three finite coordinates each")

    def _error(self, problem: str) -> InputError:
        return InputError(problem, element=f"shape '{self.name}'")


def placed(rotation: npt.ArrayLike | None = None, translation: npt.ArrayLike = (0.0, 0.0, 0.0)) -> Floats:
    """A placement as a 4 × 4 matrix.

    Parameters
    ----------
    rotation : array of shape (3, 3), optional
        Without it the axes are those of the reference.
    translation : array of shape (3,)
        m.
    """
    matrix = np.eye(4)
    matrix[:3, :3] = np.eye(3) if rotation is None else rotation
    matrix[:3, 3] = translation
    return matrix


def z_along(direction: npt.ArrayLike) -> Floats:
    """A rotation whose third column has a direction.

    Parameters
    ----------
    direction : array of shape (3,)
        Any length but zero.
    """
    z = np.asarray(direction, dtype=float) / np.linalg.norm(direction)
    # the coordinate axis that is furthest from z
    x = np.cross(np.eye(3)[np.argmin(np.abs(z))], z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])
