"""Outlines of shapes: curves that show a convex solid in a drawing of lines."""

from __future__ import annotations

import numpy as np

from echelon.excite import CORNERS, Shape, ShapeKind
from echelon.shared import Floats, extra

TURN = np.linspace(
    0.0, 2 * np.pi, 33
)  # a circle in 32 lines, which is round at the size of a picture
CROSSES = 4  # lines to either side of the middle of a plane


def outline(shape: Shape, extent: float) -> list[Floats]:
    """Curves in the frame of the body, each of shape (N, 3), m; planes are drawn as large as an extent, m."""
    rotation, origin = shape.placement[:3, :3], shape.placement[:3, 3]
    return [curve @ rotation.T + origin for curve in _own(shape, extent)]


def _own(shape: Shape, extent: float) -> list[Floats]:
    """Curves in the shape's own frame."""
    if shape.kind is ShapeKind.PLANE:
        ends = np.array([[-extent, 0.0, 0.0], [extent, 0.0, 0.0]])
        steps = [
            np.array([0.0, k * extent / CROSSES, 0.0])
            for k in range(-CROSSES, CROSSES + 1)
        ]
        across = [ends + step for step in steps]
        return [*across, *(line[:, [1, 0, 2]] for line in across)]
    if shape.kind is ShapeKind.BOX:
        pairs = [
            (a, b)
            for a in CORNERS
            for b in CORNERS
            if tuple(a) < tuple(b) and np.abs(a - b).sum() == 2
        ]
        return [np.array(pair) * shape.size for pair in pairs]
    if shape.kind is ShapeKind.MESH:
        return _edges(shape)
    if shape.kind in (ShapeKind.SPHERE, ShapeKind.ELLIPSOID):
        radii = np.array(shape.size)  # one, or one along each axis
        circles = [_circle(axes, 0.0) for axes in ((0, 1), (1, 2), (2, 0))]
        return [circle * radii for circle in circles]
    radius, half = shape.size
    circle = radius * _circle((0, 1), 0.0)
    up = np.array([0.0, 0.0, half])
    sides = [np.stack([corner - up, corner + up]) for corner in circle[:-1:8]]
    caps: list[Floats] = []
    if shape.kind is ShapeKind.CAPSULE:
        half_turn = len(TURN) // 2 + 1
        for axes in ((0, 2), (1, 2)):
            arc = radius * _circle(axes, 0.0)[:half_turn]
            caps += [arc + up, -arc - up]
    return [circle - up, circle + up, *sides, *caps]


def _circle(axes: tuple[int, int], height: float) -> Floats:
    found = np.full((len(TURN), 3), height)
    found[:, axes[0]], found[:, axes[1]] = np.cos(TURN), np.sin(TURN)
    return found


def _edges(shape: Shape) -> list[Floats]:
    """Edges of the hull of a mesh."""
    with extra("excite"):
        from scipy.spatial import ConvexHull

    assert shape.vertices is not None
    triangles = ConvexHull(shape.vertices).simplices
    edges = {
        tuple(sorted((int(t[k]), int(t[k - 1])))) for t in triangles for k in range(3)
    }
    return [shape.vertices[list(edge)] for edge in sorted(edges)]
