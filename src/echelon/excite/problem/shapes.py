"""Shapes: convex solids that ride on the bodies of a mechanism, or stand in the world, and what they reach.

All are convex, so that two of them have one smallest distance with a normal, and its derivative is that of two points.
Two convex solids are at least as far apart as any two parallel planes between them.  For a direction n from the first
to the second, −h₁(n) − h₂(−n) is the distance of such planes, with the supports h in closed form; it is a lower bound
of the (signed) distance, whatever n was.  With the normal that a distance routine found it is the distance itself, so
the routine's rounding, early ends and faults make a bound weaker, but never wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from itertools import product

import numpy as np
import numpy.typing as npt

from echelon.robot import GROUND
from echelon.shared import Floats, InputError, Integers


class ShapeKind(StrEnum):
    """Kinds of shapes."""

    SPHERE = "sphere"
    CAPSULE = "capsule"
    CYLINDER = "cylinder"
    BOX = "box"
    ELLIPSOID = "ellipsoid"
    PLANE = "plane"
    MESH = "mesh"


SIZES = {
    ShapeKind.SPHERE: ("radius",),
    ShapeKind.CAPSULE: ("radius", "half length"),
    ShapeKind.CYLINDER: ("radius", "half length"),
    ShapeKind.BOX: ("half length in x", "half length in y", "half length in z"),
    ShapeKind.ELLIPSOID: ("semi-axis x", "semi-axis y", "semi-axis z"),
    ShapeKind.PLANE: (),
    ShapeKind.MESH: (),
}


WORLD = (
    "world",
    "base",
    "ground",
)  # names of the fixed world, unless a body has one of them

CORNERS = np.array(
    list(product((-1.0, 1.0), repeat=3))
)  # corners of a box with half lengths of 1

Owner = tuple[int, str]
"""A body, −1 for the world, and the name of an obstacle; no name for all that belongs to the robot."""


@dataclass(frozen=True, eq=False)
class Shape:
    """A convex solid."""

    name: str  # for messages and exclusions
    body: int  # index of the body that carries it, −1 for the world
    # capsules and cylinders lie along z; a plane is the half-space below z = 0 and belongs to the world; a mesh
    # stands for the convex hull of its vertices
    kind: ShapeKind
    # m: the radius of a sphere; radius and half length of a capsule (without its caps) or cylinder; half lengths of
    # a box; semi-axes of an ellipsoid; empty for planes and meshes
    size: tuple[float, ...]
    placement: Floats  # shape (4, 4); the shape's frame in that of its body
    vertices: Floats | None = None  # shape (k, 3); of a mesh, in the shape's frame, m
    link: str = ""  # the link of a file that it came with, if any
    # whether it is not a part of the robot, so that no body may touch it, and distances to it bear its name
    obstacle: bool = False

    def __post_init__(self) -> None:
        names = SIZES[self.kind]
        if len(self.size) != len(names):
            wanted = f"{len(names)} sizes ({', '.join(names)})" if names else "no sizes"
            raise self._error(f"a {self.kind} has {wanted}, got {len(self.size)}")
        for name, value in zip(names, self.size, strict=True):
            if not (np.isfinite(value) and value > 0):
                raise self._error(f"the {name} must be a positive number, got {value}")
        if self.kind is ShapeKind.PLANE and self.body != GROUND:
            raise self._error("a plane is infinite: it can only belong to the world")

    @cached_property
    def core(self) -> tuple[Floats, float] | None:
        """Points of shape (k, 3) and a radius, if the solid is what is so near to the points' convex hull."""
        if self.kind is ShapeKind.SPHERE:
            return np.zeros((1, 3)), self.size[0]
        if self.kind is ShapeKind.CAPSULE:
            radius, half = self.size
            return np.array([[0.0, 0.0, -half], [0.0, 0.0, half]]), radius
        points = CORNERS * self.size if self.kind is ShapeKind.BOX else self.vertices
        return None if points is None else (points, 0.0)

    @property
    def owner(self) -> Owner:
        """The body or the obstacle that distances of the shape are named after."""
        return self.body, self.name if self.obstacle else ""

    def _error(self, problem: str) -> InputError:
        return InputError(problem, element=f"shape '{self.name}'")


def box_lengths(box: Shape) -> str:
    """Full lengths of a box, in words.

    >>> box_lengths(Shape("table", GROUND, ShapeKind.BOX, (0.6, 0.4, 0.02), np.eye(4)))
    '1.2 × 0.8 × 0.04 m'
    """
    return f"{' × '.join(f'{2 * half:.3g}' for half in box.size)} m"


def placed(rotation: npt.ArrayLike, translation: npt.ArrayLike) -> Floats:
    """A placement as a 4 × 4 matrix."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, translation
    return matrix


def z_along(direction: npt.ArrayLike) -> Floats:
    """A rotation whose third column has a direction."""
    z = np.asarray(direction, dtype=float) / np.linalg.norm(direction)
    # the coordinate axis that is furthest from z
    x = np.cross(np.eye(3)[np.argmin(np.abs(z))], z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


_DIRECTIONS = np.array(
    [d for d in product((-1, 0, 1), repeat=3) if any(d)], dtype=float
)
_UP = np.array([0.0, 0.0, 1.0])
UNCONFIRMED = 1e-6
"""Length, m, by which planes across a normal may be nearer to each other than the points that it joins."""
TOUCHING = 1e-9
"""Distance of nearest points, m, that is too short to tell a normal."""


def support(shape: Shape, directions: Floats) -> Floats:
    """The largest n · x over a solid that is not a plane, in its own frame, (K,), m, for unit vectors n of (K, 3)."""
    n = directions
    if shape.core is not None:
        points, radius = shape.core
        return np.asarray((n @ points.T).max(axis=1) + radius)
    if shape.kind is ShapeKind.CYLINDER:
        return np.asarray(
            shape.size[0] * np.hypot(n[:, 0], n[:, 1]) + shape.size[1] * np.abs(n[:, 2])
        )
    return np.asarray(np.linalg.norm(n * shape.size, axis=1))


def bounding_sphere(shape: Shape) -> tuple[Floats, float]:
    """Centre in the shape's frame and radius of a sphere that holds it, m; infinite for a plane."""
    if shape.core is not None:
        points, radius = shape.core
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        return middle, radius + float(np.linalg.norm(points - middle, axis=1).max())
    largest = (
        np.linalg.norm(shape.size)
        if shape.kind is ShapeKind.CYLINDER
        else max(shape.size, default=np.inf)
    )
    return np.zeros(3), float(largest)


def extent(shape: Shape) -> float:
    """A bound of the distance of any point of a shape from its body's origin, m; infinite for a plane."""
    rotation, origin = shape.placement[:3, :3], shape.placement[:3, 3]
    if shape.core is not None:
        points, radius = shape.core
        return radius + float(
            np.linalg.norm(points @ rotation.T + origin, axis=1).max()
        )
    return float(np.linalg.norm(origin)) + bounding_sphere(shape)[1]


class BoundingSpheres:
    """Spheres that hold some shapes, for quick bounds."""

    def __init__(self, shapes: Sequence[Shape]) -> None:
        found = [bounding_sphere(shape) for shape in shapes]
        self.radii = np.array([radius for _, radius in found])
        finite = self.radii[np.isfinite(self.radii)]
        self.size = float(2 * finite.max(initial=0.0))
        self.centres = np.array([centre for centre, _ in found]).reshape(
            -1, 3
        )  # in the shapes' own frames, m

    def gaps(self, places: Floats, pairs: Integers) -> Floats:
        """Lower bounds of distances, (N, P), exact for spheres and planes; only the first of a pair may be a plane."""
        first, second = pairs.T
        centres = (
            np.einsum("nsij,sj->nsi", places[..., :3], self.centres) + places[..., 3]
        )
        apart = centres[:, second] - centres[:, first]
        flat = np.isinf(self.radii)[first]
        heights = np.einsum("npi,npi->np", places[..., 2][:, first], apart)
        between = np.where(flat, heights, np.linalg.norm(apart, axis=2))
        return np.asarray(
            between - np.where(flat, 0.0, self.radii[first]) - self.radii[second]
        )


def plane_gaps(
    first: Shape, second: Shape, places: tuple[Floats, Floats], points: Floats
) -> Floats:
    """Lower bounds of signed distances, shape (N,), m, by pairs of parallel planes between two shapes.

    The second shape is not a plane.  Points of shape (N, 2, 3) that are nearest, or deepest, give the normals.
    """
    if first.kind is ShapeKind.PLANE:
        return _between(first, second, places, places[0][:, :, 2])
    apart = points[:, 1] - points[:, 0]
    lengths = np.linalg.norm(apart, axis=1, keepdims=True)
    normals = np.where(lengths > TOUCHING, apart / np.maximum(lengths, TOUCHING), _UP)
    # the points of overlapping shapes lie the other way round
    found = np.maximum(
        _between(first, second, places, normals),
        _between(first, second, places, -normals),
    )
    # points of faces that lie on each other, and of shapes that touch, tell no normal; axes of the shapes may be one
    untold = np.flatnonzero(np.abs(np.abs(found) - lengths[:, 0]) > UNCONFIRMED)
    if len(untold):
        some = (places[0][untold], places[1][untold])
        axes = [place[:, :, k] for place in some for k in range(3)]
        fixed = [
            np.broadcast_to(guess / np.linalg.norm(guess), (len(untold), 3))
            for guess in _DIRECTIONS
        ]
        for normals in (*fixed, *axes, *(-axis for axis in axes)):
            found[untold] = np.maximum(
                found[untold], _between(first, second, some, normals)
            )
    return found


def _between(
    first: Shape, second: Shape, places: tuple[Floats, Floats], normals: Floats
) -> Floats:
    """Distances of the planes with given normals that touch two shapes from between; a plane has its own normal."""
    total = np.einsum("ni,ni->n", normals, places[1][:, :, 3] - places[0][:, :, 3])
    for shape, place, side in (
        (first, places[0], normals),
        (second, places[1], -normals),
    ):
        if shape.kind is not ShapeKind.PLANE:
            total = total - support(
                shape, np.einsum("nij,ni->nj", place[:, :, :3], side)
            )
    return np.asarray(total)
