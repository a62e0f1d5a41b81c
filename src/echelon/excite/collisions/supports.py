"""What shapes reach: supports, bounding balls, and lower bounds of distances that need no iteration.

Two convex solids are at least as far apart as any two parallel planes between them.  For a direction n from the first
to the second, −h₁(n) − h₂(−n) is the distance of such planes, h the supports; it is a lower bound of the distance, or
if negative of the signed distance, whatever n was.  With the normal that a distance routine found it is the distance
itself, so the routine's rounding, early ends and faults make a bound weaker, but never wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np

from echelon.arrays import Floats, Integers
from echelon.excite.collisions.shapes import Kind, Shape

_DIRECTIONS = np.array([d for d in product((-1, 0, 1), repeat=3) if any(d)], dtype=float)
_UP = np.array([0.0, 0.0, 1.0])
_TOUCHING = 1e-9  # m, of witness points that are too near each other to tell a normal


def support(shape: Shape, directions: Floats) -> Floats:
    """The largest n · x over a solid, from the origin of its own frame.

    Parameters
    ----------
    shape : Shape
        No plane.
    directions : array of shape (K, 3)
        Unit vectors n in the shape's frame.

    Returns
    -------
    array of shape (K,)
        m.
    """
    n = directions
    if shape.vertices is not None:
        return np.asarray((n @ shape.vertices.T).max(axis=1))
    size = np.array(shape.size)
    if shape.kind is Kind.SPHERE:
        return np.full(len(n), size[0])
    if shape.kind is Kind.CAPSULE:
        return np.asarray(size[0] + size[1] * np.abs(n[:, 2]))
    if shape.kind is Kind.CYLINDER:
        return np.asarray(size[0] * np.hypot(n[:, 0], n[:, 1]) + size[1] * np.abs(n[:, 2]))
    if shape.kind is Kind.BOX:
        return np.asarray(np.abs(n) @ size)
    return np.asarray(np.linalg.norm(n * size, axis=1))


def ball(shape: Shape) -> tuple[Floats, float]:
    """A ball that holds a shape.

    Returns
    -------
    centre : array of shape (3,)
        In the body's frame, m.
    radius : float
        m; infinite for a plane.
    """
    rotation, origin = shape.placement[:3, :3], shape.placement[:3, 3]
    if shape.kind is Kind.PLANE:
        return origin, float("inf")
    if shape.vertices is not None:
        middle = (shape.vertices.min(axis=0) + shape.vertices.max(axis=0)) / 2
        return origin + rotation @ middle, float(np.linalg.norm(shape.vertices - middle, axis=1).max())
    size = np.array(shape.size)
    radius = {
        Kind.SPHERE: size[0],
        Kind.CAPSULE: size.sum(),
        Kind.CYLINDER: np.linalg.norm(size),
        Kind.BOX: np.linalg.norm(size),
        Kind.ELLIPSOID: size.max(),
    }[shape.kind]
    return origin, float(radius)


def extent(shape: Shape) -> float:
    """A bound of the distance of any point of a shape from its body's origin, m; infinite for a plane."""
    rotation, origin = shape.placement[:3, :3], shape.placement[:3, 3]
    if shape.vertices is not None:
        return float(np.linalg.norm(shape.vertices @ rotation.T + origin, axis=1).max())
    if shape.kind is Kind.CAPSULE:
        radius, half = shape.size
        return radius + max(float(np.linalg.norm(origin + side * half * rotation[:, 2])) for side in (-1, 1))
    if shape.kind is Kind.BOX:
        corners = np.array(list(product((-1, 1), repeat=3))) * shape.size
        return float(np.linalg.norm(corners @ rotation.T + origin, axis=1).max())
    return float(np.linalg.norm(origin)) + ball(shape)[1]


class Balls:
    """Balls that hold some shapes, for quick bounds.

    Parameters
    ----------
    shapes : sequence of Shape

    Attributes
    ----------
    radii : array of shape (shapes,)
        m; infinite for planes.
    size : float
        The largest finite diameter, m.
    centres : array of shape (shapes, 3)
        In the shapes' own frames, m.
    """

    def __init__(self, shapes: Sequence[Shape]) -> None:
        found = [ball(shape) for shape in shapes]
        self.radii = np.array([radius for _, radius in found])
        finite = self.radii[np.isfinite(self.radii)]
        self.size = float(2 * finite.max(initial=0.0))
        # in the shapes' own frames
        self.centres = np.array(
            [s.placement[:3, :3].T @ (c - s.placement[:3, 3]) for s, (c, _) in zip(shapes, found, strict=True)]
        ).reshape(-1, 3)

    def gaps(self, places: Floats, pairs: Integers) -> Floats:
        """Lower bounds of distances; exact between spheres, and between a sphere and a plane.

        Parameters
        ----------
        places : array of shape (N, shapes, 3, 4)
            The shapes' frames in the base frame.
        pairs : array of shape (P, 2)
            Indices of shapes; only the first may be a plane.

        Returns
        -------
        array of shape (N, P)
            m.
        """
        first, second = pairs.T
        centres = np.einsum("nsij,sj->nsi", places[..., :3], self.centres) + places[..., 3]
        apart = centres[:, second] - centres[:, first]
        flat = np.isinf(self.radii)[first]
        heights = np.einsum("npi,npi->np", places[..., 2][:, first], apart)
        between = np.where(flat, heights, np.linalg.norm(apart, axis=2))
        return np.asarray(between - np.where(flat, 0.0, self.radii[first]) - self.radii[second])


def plane_gaps(first: Shape, second: Shape, places: tuple[Floats, Floats], points: Floats) -> Floats:
    """Lower bounds of signed distances by a pair of parallel planes between two shapes.

    Parameters
    ----------
    first, second : Shape
        The second is no plane.
    places : two arrays of shape (N, 3, 4)
        The shapes' frames in one frame.
    points : array of shape (N, 2, 3)
        Points of both shapes that are said to be nearest, or deepest; they give the normal, m.

    Returns
    -------
    array of shape (N,)
        m; negative where shapes overlap.
    """
    if first.kind is Kind.PLANE:
        return _between(first, second, places, places[0][:, :, 2])
    apart = points[:, 1] - points[:, 0]
    lengths = np.linalg.norm(apart, axis=1, keepdims=True)
    normals = np.where(lengths > _TOUCHING, apart / np.maximum(lengths, _TOUCHING), _UP)
    # the points of overlapping shapes lie the other way round
    found = np.maximum(_between(first, second, places, normals), _between(first, second, places, -normals))
    untold = np.flatnonzero(lengths[:, 0] <= _TOUCHING)
    if len(untold):
        some = (places[0][untold], places[1][untold])
        for guess in _DIRECTIONS:
            normals = np.broadcast_to(guess / np.linalg.norm(guess), (len(untold), 3))
            found[untold] = np.maximum(found[untold], _between(first, second, some, normals))
    return found


def _between(first: Shape, second: Shape, places: tuple[Floats, Floats], normals: Floats) -> Floats:
    """Distances of the planes with given normals that touch two shapes from between; a plane has its own normal."""
    total = np.einsum("ni,ni->n", normals, places[1][:, :, 3] - places[0][:, :, 3])
    for shape, place, side in ((first, places[0], normals), (second, places[1], -normals)):
        if shape.kind is not Kind.PLANE:
            total = total - support(shape, np.einsum("nij,ni->nj", place[:, :, :3], side))
    return np.asarray(total)
