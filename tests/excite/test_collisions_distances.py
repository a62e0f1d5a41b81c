"""Distances of two shapes: against formulas, and confirmed by planes between."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from echelon.errors import EchelonError
from echelon.excite.problem.clearance import Engine
from echelon.excite.problem.robot_shapes import mesh_shape
from echelon.excite.problem.shapes import Kind, Shape, plane_gaps
from echelon.formats.mjcf.mjcf_numbers import quaternion_matrix
from support.shaped_robots import Floats


def floating(*shapes: tuple[Kind, tuple[float, ...]]) -> tuple[Shape, ...]:
    """Shapes that are not on any body: their frames are given."""
    return tuple(Shape(f"s{k}", -1, kind, size, np.eye(4)) for k, (kind, size) in enumerate(shapes))


def measured(shapes: tuple[Shape, ...], places: Floats, reach: float = 100.0) -> tuple[Floats, Floats]:
    """Distances and points of the first two shapes."""
    asked = np.column_stack([np.arange(len(places)), np.zeros(len(places)), np.ones(len(places))]).astype(np.intp)
    found = Engine(shapes).measure(places, asked, reach)
    return found.distances, found.points


def random_places(rng: np.random.Generator, count: int, shapes: int, size: float) -> Floats:
    places = np.zeros((count, shapes, 3, 4))
    for n, s in np.ndindex(count, shapes):
        places[n, s, :, :3] = quaternion_matrix(rng.normal(size=4))
        places[n, s, :, 3] = rng.uniform(-size, size, 3)
    return places


def segment_distance(a: Floats, b: Floats, c: Floats, d: Floats) -> float:
    """Of two segments, on a fine grid of both that is refined once about its best point."""
    s = t = np.linspace(0, 1, 201)
    for _ in range(4):
        gaps = np.linalg.norm((a + s[:, None] * (b - a))[:, None] - (c + t[:, None] * (d - c)), axis=2)
        i, j = np.unravel_index(gaps.argmin(), gaps.shape)
        s = np.clip(np.linspace(s[i] - (s[1] - s[0]) * 2, s[i] + (s[1] - s[0]) * 2, 201), 0, 1)
        t = np.clip(np.linspace(t[j] - (t[1] - t[0]) * 2, t[j] + (t[1] - t[0]) * 2, 201), 0, 1)
    return float(gaps.min())


def test_spheres_and_planes() -> None:
    rng = np.random.default_rng(0)
    places = random_places(rng, 50, 2, 0.5)
    apart = np.linalg.norm(places[:, 0, :, 3] - places[:, 1, :, 3], axis=1)
    found = measured(floating((Kind.SPHERE, (0.2,)), (Kind.SPHERE, (0.3,))), places)[0]
    np.testing.assert_allclose(found, apart - 0.5, atol=1e-12)
    assert (found < 0).any()
    assert (found > 0).any()
    heights = np.einsum("ni,ni->n", places[:, 0, :, 2], places[:, 1, :, 3] - places[:, 0, :, 3])
    found = measured(floating((Kind.PLANE, ()), (Kind.SPHERE, (0.2,))), places)[0]
    np.testing.assert_allclose(found, heights - 0.2, atol=1e-12)


def test_capsules_are_segments_with_a_radius() -> None:
    places = random_places(np.random.default_rng(1), 20, 2, 0.6)
    ends = [
        [places[:, s, :, 3] + side * half * places[:, s, :, 2] for side in (-1, 1)] for s, half in ((0, 0.3), (1, 0.2))
    ]
    expected = [segment_distance(*(ends[s][k][n] for s in (0, 1) for k in (0, 1))) - 0.15 for n in range(20)]
    found = measured(floating((Kind.CAPSULE, (0.1, 0.3)), (Kind.CAPSULE, (0.05, 0.2))), places)[0]
    np.testing.assert_allclose(found, expected, atol=1e-6)


@pytest.mark.parametrize("other", [(Kind.SPHERE, (0.1,)), (Kind.CAPSULE, (0.1, 0.3))])
def test_boxes_outside(other: tuple[Kind, tuple[float, ...]]) -> None:
    places = random_places(np.random.default_rng(2), 300, 2, 0.6)
    half = np.array([0.1, 0.2, 0.3])
    along = np.linspace(-1, 1, 4001)[:, None] * (other[1][1] if len(other[1]) > 1 else 0.0)
    points = places[:, 1, None, :, 3] + along * places[:, 1, None, :, 2]
    inside = np.einsum("nij,nki->nkj", places[:, 0, :, :3], points - places[:, 0, None, :, 3])
    expected = np.linalg.norm(np.maximum(np.abs(inside) - half, 0), axis=2).min(axis=1) - 0.1
    found = measured(floating((Kind.BOX, tuple(half)), other), places)[0]
    clear = expected > -0.1 + 1e-9  # the axis stays outside
    np.testing.assert_allclose(found[clear], expected[clear], atol=2e-6)
    assert np.all(found[~clear] < 0)


SIZES = {
    Kind.SPHERE: (0.12,),
    Kind.CAPSULE: (0.06, 0.2),
    Kind.CYLINDER: (0.1, 0.15),
    Kind.BOX: (0.1, 0.2, 0.05),
    Kind.ELLIPSOID: (0.1, 0.2, 0.15),
}


def solid(name: str, kind: Kind) -> Shape:
    if kind is Kind.MESH:
        points = np.random.default_rng(5).normal(size=(40, 3)) * [0.05, 0.1, 0.15] + [0.1, 0, 0.2]
        return mesh_shape(name, -1, np.eye(4), points)
    return Shape(name, -1, kind, SIZES.get(kind, ()), np.eye(4))


@pytest.mark.parametrize("first", list(Kind))
@pytest.mark.parametrize("second", [kind for kind in Kind if kind is not Kind.PLANE])
def test_planes_between_confirm_distances(first: Kind, second: Kind) -> None:
    """A distance of two points is an upper bound, planes between are a lower one: where they meet both are right."""
    shapes = solid("first", first), solid("second", second)
    places = random_places(np.random.default_rng(3), 100, 2, 0.3)
    distances, points = measured(shapes, places)
    gaps = plane_gaps(*shapes, (places[:, 0], places[:, 1]), points)
    slack = 1e-6 if mujoco.__version__ >= "4" else 1e-3  # earlier ones sometimes end too early at ellipsoids
    np.testing.assert_allclose(gaps, distances, atol=slack)
    np.testing.assert_allclose(np.linalg.norm(points[:, 1] - points[:, 0], axis=1), np.abs(distances), atol=slack)
    arbitrary = plane_gaps(*shapes, (places[:, 0], places[:, 1]), np.random.default_rng(4).normal(size=points.shape))
    assert np.all(arbitrary < distances + slack)
    untold = plane_gaps(*shapes, (places[:, 0], places[:, 1]), np.zeros(points.shape))
    assert np.all(untold < distances + slack)


def test_values_stop_at_the_reach() -> None:
    places = random_places(np.random.default_rng(0), 50, 2, 1.0)
    far, _ = measured(floating((Kind.SPHERE, (0.1,)), (Kind.SPHERE, (0.1,))), places)
    near, _ = measured(floating((Kind.SPHERE, (0.1,)), (Kind.SPHERE, (0.1,))), places, 0.3)
    np.testing.assert_allclose(near, np.minimum(far, 0.3))
    assert (far > 0.3).any()


def test_old_versions_of_mujoco_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mujoco, "__version__", "3.9.1")
    with pytest.raises(EchelonError, match=r"MuJoCo 3\.9\.1 gives wrong distances.*3\.12 or later"):
        Engine(floating((Kind.SPHERE, (1.0,))))
