"""Clearances: which pairs of bodies are checked, their distances and slopes, and start poses that have room."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import echelon as ec
from echelon.excite.problem.allowances import without_touching
from echelon.excite.problem.clearance import (
    Clearance,
    Engine,
    checked_pairs,
    clearance_of,
)
from echelon.excite.problem.robot_shapes import entry_shapes, mesh_shape, read_geometry
from echelon.excite.problem.shapes import Shape, ShapeKind, plane_gaps
from echelon.excite.problem.task import ResolvedLimits, task_of
from echelon.excite.solve.design import start_pose
from echelon.excite.verify import LeastClearances
from echelon.formats.mjcf.mjcf_numbers import quaternion_matrix
from echelon.formats.robot_file import open_robot
from echelon.robot.joint import rotation
from echelon.shared.errors import EchelonError, InputError
from support.robot_files import robot_file
from support.shaped_robots import ARM, Floats, motion, planar, spheres
from support.textbook_arms import body, place, tree


def test_neighbours_are_not_checked() -> None:
    mechanism = planar(4)
    found = {
        tuple(pair) for pair in checked_pairs(mechanism, spheres(mechanism)).tolist()
    }
    # index 0 is the world
    assert found == {(0, 2), (0, 3), (0, 4), (1, 3), (1, 4), (2, 4)}
    fewer = checked_pairs(
        mechanism,
        spheres(mechanism),
        [("link4", "link2"), ("stone", "link2"), ("world", "link3")],
    )
    assert {tuple(pair) for pair in fewer.tolist()} == {(0, 4), (1, 3), (1, 4)}
    with pytest.raises(InputError, match="no body, link or shape 'link7' to exclude"):
        checked_pairs(mechanism, spheres(mechanism), [("link7", "link1")])


def test_rigidly_connected_bodies_count_as_one() -> None:
    mechanism = tree(
        "kept",
        body(1, 0, "revolute", rotation("q1")),
        body(2, 1, "fixed", place("1 0 0")),
        body(3, 2, "revolute", rotation("q3")),
        body(4, 0, "fixed", place("0 1 0")),
    )
    found = {
        tuple(pair) for pair in checked_pairs(mechanism, spheres(mechanism)).tolist()
    }
    # 2 is 1; 4 is the world
    assert found == {(0, 3), (3, 4)}


def test_touching_pairs_are_left_out_on_request() -> None:
    mechanism = planar()
    shapes = entry_shapes(
        mechanism,
        [{"body": f"link{k}", "sphere": 1.2, "name": f"s{k}"} for k in (1, 3)],
    )
    assert len(clearance_of(mechanism, shapes, 0.01).pairs) == 1
    allowed = without_touching(clearance_of(mechanism, shapes, 0.01), np.zeros(3))
    found = allowed.clearance
    assert len(found.pairs) == 0
    assert allowed.unchecked == (
        "'s1' and 's3' are not checked: they are too close at the start of motions",
    )
    assert found.values(np.zeros((2, 3)), np.zeros((2, 3)), np.zeros((2, 3))).shape == (
        2,
        0,
    )
    assert LeastClearances(found, motion(mechanism, 0), 1e-3).bounds.shape == (0,)


STATED = """
echelon: 1
name: arm
modified_dh: [{joint: revolute}, {joint: revolute, a: 1}]
excitation:
  limits: {position: [-2, 2], effort: none}
  collisions:
    shapes: [{body: j1, sphere: 0.1}, {body: j2, sphere: 0.1, at: [1, 0, 0]}]
    obstacles:
      - {name: table, box: [0.4, 0.4, 0.2], at: [2, 0.5, 0]}
      - {plane: [0, 0, 1], through: [0, 0, -0.3]}
      - {name: table, box: [0.2, 0.2, 0.2], at: [2, -0.35, 0]}
    exclude: EXCLUDED
"""


@pytest.mark.parametrize(
    ("excluded", "expected"),
    [
        ("[]", ["j1 and table", "j2 and table", "j1 and plane 2", "j2 and plane 2"]),
        ("[[j1, table]]", ["j2 and table", "j1 and plane 2", "j2 and plane 2"]),
        ("[[plane 2, j2], [table, j1]]", ["j2 and table", "j1 and plane 2"]),
        ("[[j1, world]]", ["j2 and table", "j2 and plane 2"]),
    ],
)
def test_obstacles_of_a_set_up_go_by_their_names(
    tmp_path: Path, excluded: str, expected: list[str]
) -> None:
    file = tmp_path / "arm.yaml"
    file.write_text(STATED.replace("EXCLUDED", excluded))
    setup = ec.load_setup(file)
    clearance = task_of(setup, setup.excitation).constraints[-1]
    assert list(clearance.labels) == [f"distance of {pair}" for pair in expected]
    found = dict(zip(expected, clearance.values(*np.zeros((3, 1, 2)))[0], strict=True))
    # two boxes are one table; the sphere at (2, 0, 0) is nearer to the second
    assert found["j2 and table"] == pytest.approx(0.15, abs=1e-7)
    if "j1 and plane 2" in found:
        assert found["j1 and plane 2"] == pytest.approx(0.2)


def obstacles(*entries: dict[str, Any]) -> Sequence[Shape]:
    found = entry_shapes(planar(), [{"body": "world", **entry} for entry in entries])
    return [replace(shape, obstacle=True) for shape in found]


def test_an_obstacle_with_a_name_of_the_world_stands_for_itself() -> None:
    around = obstacles(
        {"name": "ground", "plane": [0, 0, 1], "through": [0, 0, -1]},
        {"name": "post", "sphere": 0.1},
    )
    shapes = [*spheres(planar()), *around]
    names = [shape.name for shape in shapes]
    for name, left in (
        ("ground", {"post", "stone"}),
        ("base", set()),
        ("world", set()),
    ):
        pairs = checked_pairs(planar(), shapes, [("link3", name)]).tolist()
        third = names.index("link3:sphere4")
        assert {names[i] for i, j in pairs if j == third} - {"link1:sphere2"} == left


def test_fixed_parts_of_the_robot_are_the_world() -> None:
    shapes = [*obstacles({"name": "post", "sphere": 0.1}), *spheres(planar(2))]
    assert clearance_of(planar(2), shapes, 0.01).labels == (
        "distance of link1 and post",
        "distance of link2 and post",
        "distance of link2 and world",
    )


def floating(*shapes: tuple[ShapeKind, tuple[float, ...]]) -> tuple[Shape, ...]:
    """Shapes that are not on any body: their frames are given."""
    return tuple(
        Shape(f"s{k}", -1, kind, size, np.eye(4))
        for k, (kind, size) in enumerate(shapes)
    )


def measured(
    shapes: tuple[Shape, ...], places: Floats, reach: float = 100.0
) -> tuple[Floats, Floats]:
    """Distances and points of the first two shapes."""
    asked = np.column_stack(
        [np.arange(len(places)), np.zeros(len(places)), np.ones(len(places))]
    ).astype(np.intp)
    found = Engine(shapes).measure(places, asked, reach)
    return found.distances, found.points


def random_places(
    rng: np.random.Generator, count: int, shapes: int, size: float
) -> Floats:
    places = np.zeros((count, shapes, 3, 4))
    for n, s in np.ndindex(count, shapes):
        places[n, s, :, :3] = quaternion_matrix(rng.normal(size=4))
        places[n, s, :, 3] = rng.uniform(-size, size, 3)
    return places


def segment_distance(a: Floats, b: Floats, c: Floats, d: Floats) -> float:
    """Distance of two segments, by a grid on both that is refined about its best point."""
    s = t = np.linspace(0, 1, 201)
    for _ in range(4):
        gaps = np.linalg.norm(
            (a + s[:, None] * (b - a))[:, None] - (c + t[:, None] * (d - c)), axis=2
        )
        i, j = np.unravel_index(gaps.argmin(), gaps.shape)
        s = np.clip(
            np.linspace(s[i] - (s[1] - s[0]) * 2, s[i] + (s[1] - s[0]) * 2, 201), 0, 1
        )
        t = np.clip(
            np.linspace(t[j] - (t[1] - t[0]) * 2, t[j] + (t[1] - t[0]) * 2, 201), 0, 1
        )
    return float(gaps.min())


def test_spheres_and_planes() -> None:
    rng = np.random.default_rng(0)
    places = random_places(rng, 50, 2, 0.5)
    apart = np.linalg.norm(places[:, 0, :, 3] - places[:, 1, :, 3], axis=1)
    found = measured(
        floating((ShapeKind.SPHERE, (0.2,)), (ShapeKind.SPHERE, (0.3,))), places
    )[0]
    np.testing.assert_allclose(found, apart - 0.5, atol=1e-12)
    assert (found < 0).any()
    assert (found > 0).any()
    heights = np.einsum(
        "ni,ni->n", places[:, 0, :, 2], places[:, 1, :, 3] - places[:, 0, :, 3]
    )
    found = measured(
        floating((ShapeKind.PLANE, ()), (ShapeKind.SPHERE, (0.2,))), places
    )[0]
    np.testing.assert_allclose(found, heights - 0.2, atol=1e-12)


def test_capsules_are_segments_with_a_radius() -> None:
    places = random_places(np.random.default_rng(1), 20, 2, 0.6)
    ends = [
        [places[:, s, :, 3] + side * half * places[:, s, :, 2] for side in (-1, 1)]
        for s, half in ((0, 0.3), (1, 0.2))
    ]
    expected = [
        segment_distance(*(ends[s][k][n] for s in (0, 1) for k in (0, 1))) - 0.15
        for n in range(20)
    ]
    found = measured(
        floating((ShapeKind.CAPSULE, (0.1, 0.3)), (ShapeKind.CAPSULE, (0.05, 0.2))),
        places,
    )[0]
    np.testing.assert_allclose(found, expected, atol=1e-6)


@pytest.mark.parametrize(
    "other", [(ShapeKind.SPHERE, (0.1,)), (ShapeKind.CAPSULE, (0.1, 0.3))]
)
def test_boxes_outside(other: tuple[ShapeKind, tuple[float, ...]]) -> None:
    places = random_places(np.random.default_rng(2), 300, 2, 0.6)
    half = np.array([0.1, 0.2, 0.3])
    along = np.linspace(-1, 1, 4001)[:, None] * (
        other[1][1] if len(other[1]) > 1 else 0.0
    )
    points = places[:, 1, None, :, 3] + along * places[:, 1, None, :, 2]
    inside = np.einsum(
        "nij,nki->nkj", places[:, 0, :, :3], points - places[:, 0, None, :, 3]
    )
    expected = (
        np.linalg.norm(np.maximum(np.abs(inside) - half, 0), axis=2).min(axis=1) - 0.1
    )
    found = measured(floating((ShapeKind.BOX, tuple(half)), other), places)[0]
    clear = expected > -0.1 + 1e-9  # the axis stays outside
    np.testing.assert_allclose(found[clear], expected[clear], atol=2e-6)
    assert np.all(found[~clear] < 0)


SIZES = {
    ShapeKind.SPHERE: (0.12,),
    ShapeKind.CAPSULE: (0.06, 0.2),
    ShapeKind.CYLINDER: (0.1, 0.15),
    ShapeKind.BOX: (0.1, 0.2, 0.05),
    ShapeKind.ELLIPSOID: (0.1, 0.2, 0.15),
}


def solid(name: str, kind: ShapeKind) -> Shape:
    if kind is ShapeKind.MESH:
        points = np.random.default_rng(5).normal(size=(40, 3)) * [0.05, 0.1, 0.15] + [
            0.1,
            0,
            0.2,
        ]
        return mesh_shape(name, -1, np.eye(4), points)
    return Shape(name, -1, kind, SIZES.get(kind, ()), np.eye(4))


@pytest.mark.parametrize("first", list(ShapeKind))
@pytest.mark.parametrize(
    "second", [kind for kind in ShapeKind if kind is not ShapeKind.PLANE]
)
def test_planes_between_confirm_distances(first: ShapeKind, second: ShapeKind) -> None:
    """A distance of two points is an upper bound, planes between are a lower one: where they meet both are right."""
    shapes = solid("first", first), solid("second", second)
    places = random_places(np.random.default_rng(3), 100, 2, 0.3)
    distances, points = measured(shapes, places)
    gaps = plane_gaps(*shapes, (places[:, 0], places[:, 1]), points)
    slack = (
        1e-6 if mujoco.__version__ >= "4" else 1e-3
    )  # earlier ones sometimes end too early at ellipsoids
    np.testing.assert_allclose(gaps, distances, atol=slack)
    np.testing.assert_allclose(
        np.linalg.norm(points[:, 1] - points[:, 0], axis=1),
        np.abs(distances),
        atol=slack,
    )
    arbitrary = plane_gaps(
        *shapes,
        (places[:, 0], places[:, 1]),
        np.random.default_rng(4).normal(size=points.shape),
    )
    assert np.all(arbitrary < distances + slack)
    untold = plane_gaps(*shapes, (places[:, 0], places[:, 1]), np.zeros(points.shape))
    assert np.all(untold < distances + slack)


def test_values_stop_at_the_reach() -> None:
    places = random_places(np.random.default_rng(0), 50, 2, 1.0)
    far, _ = measured(
        floating((ShapeKind.SPHERE, (0.1,)), (ShapeKind.SPHERE, (0.1,))), places
    )
    near, _ = measured(
        floating((ShapeKind.SPHERE, (0.1,)), (ShapeKind.SPHERE, (0.1,))), places, 0.3
    )
    np.testing.assert_allclose(near, np.minimum(far, 0.3))
    assert (far > 0.3).any()


def test_old_versions_of_mujoco_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mujoco, "__version__", "3.9.1")
    with pytest.raises(
        EchelonError, match=r"MuJoCo 3\.9\.1 gives wrong distances.*3\.12 or later"
    ):
        Engine(floating((ShapeKind.SPHERE, (1.0,))))


def differences(clearance: Clearance, q: Floats, step: float) -> Floats:
    """Central differences of fourth order by the positions, shape (N, m, n)."""
    columns = []
    for k in range(q.shape[1]):
        e = step * np.eye(q.shape[1])[k]
        parts = [
            clearance.values(q + m * e, q, q) * w
            for m, w in ((-2, 1), (-1, -8), (1, 8), (2, -1))
        ]
        columns.append(sum(parts) / (12 * step))
    return np.stack(columns, axis=2)


def test_slopes(tmp_path: Path) -> None:
    file = tmp_path / "arm.xml"
    file.write_text(ARM)
    mechanism = ec.load(file)
    clearance = clearance_of(
        mechanism, read_geometry(mechanism, open_robot(file)).shapes, 0.0, reach=0.4
    )
    q = np.random.default_rng(0).uniform(-2, 2, (150, 4)) * [1, 1, 0.2, 1]
    values, found = clearance.values(q, q, q), clearance.slopes(q, q, q)[0]
    assert found is not None
    expected = differences(clearance, q, 1e-4)
    wrong = np.abs(found - expected).max(axis=2) > 2e-4
    near, deep = (values < 0.3995) & (values > 0), values < 0
    assert near.sum() > 100
    assert deep.sum() > 20
    # at few states the nearest feature changes within the step
    assert wrong[near].mean() < 0.03
    assert wrong[deep].mean() < 0.1
    assert np.all(found[values >= 0.4] == 0)


def test_slopes_of_spheres_are_exact() -> None:
    mechanism = planar(4)
    clearance = clearance_of(mechanism, spheres(mechanism, 0.3), 0.0, reach=10.0)
    q = np.random.default_rng(1).uniform(-3, 3, (50, 4))
    found = clearance.slopes(q, q, q)[0]
    assert found is not None
    assert (clearance.values(q, q, q) < 0).any()
    np.testing.assert_allclose(found, differences(clearance, q, 1e-3), atol=1e-8)


LIMITS = ResolvedLimits(
    (), (), np.array([-1.5, -1.0]), np.array([1.5, 1.0]), ("rad", "rad"), ()
)
OPEN = np.full(2, np.nan)


def beside(wall: float) -> Clearance:
    """Two links along x with a ball at the end, and a wall at some y."""
    entries: list[dict[str, Any]] = [
        {"body": "link2", "sphere": 0.1, "at": [1, 0, 0]},
        {"body": "world", "plane": [0, -1, 0], "through": [0, wall, 0]},
    ]
    return clearance_of(planar(2), entry_shapes(planar(2), entries), 0.02)


def test_a_narrow_middle_is_left_for_a_pose_with_room() -> None:
    found = start_pose(OPEN, LIMITS, [beside(0.13)], 0)
    assert np.sin(found[0]) + np.sin(found.sum()) < -0.5
    np.testing.assert_array_equal(found, start_pose(OPEN, LIMITS, [beside(0.13)], 0))


def test_a_middle_with_room_is_kept() -> None:
    np.testing.assert_array_equal(
        start_pose(OPEN, LIMITS, [beside(2.5)], 0), [0.0, 0.0]
    )


def test_what_is_stated_stays_with_room_or_without() -> None:
    found = start_pose(np.array([0.0, np.nan]), LIMITS, [beside(0.13)], 0)
    assert found[0] == 0.0
    assert found[1] < 0.0
    np.testing.assert_array_equal(
        start_pose(np.zeros(2), LIMITS, [beside(0.13)], 0), [0.0, 0.0]
    )


@pytest.mark.slow
def test_a_leg_of_a_quadruped_over_a_floor() -> None:
    """In the middle of its ranges the thigh is 1.5 mm further from the trunk than it has to be."""
    leg = [f"FR_{part}_joint" for part in ("hip", "thigh", "calf")]
    floor = {"name": "floor", "plane": [0, 0, 1], "through": [0, 0, -0.45]}
    setup = ec.load_setup(robot_file("a1"), floating=True)
    found = ec.exciting_trajectory(
        setup, starts=1, harmonics=6, move=leg, collisions={"obstacles": [floor]}
    )
    assert found.safe
    assert found.starts[0].status == "converged"
    assert found.conditioning.scaled_condition < 60
    labels = [margin.label for margin in found.margins]
    assert "distance of FR_calf and floor" in labels
    assert "distance of base and FR_thigh" in labels
