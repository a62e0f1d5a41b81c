"""Clearances: distances against formulas, MuJoCo and coal, their slopes against differences, and certified bounds."""

from __future__ import annotations

import re
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import echelon as ec
from arms import body, place, tree
from echelon.errors import EchelonError, InputError
from echelon.exact.expressions import parse
from echelon.excite.collisions.certificate import least_clearances
from echelon.excite.collisions.constraint import Clearance, clearance_of
from echelon.excite.collisions.engine import Engine
from echelon.excite.collisions.entries import entry_shapes
from echelon.excite.collisions.geometry import read_geometry
from echelon.excite.collisions.levers import Levers
from echelon.excite.collisions.meshes import mesh_shape
from echelon.excite.collisions.pairs import checked_pairs
from echelon.excite.collisions.shapes import Kind, Shape, placed
from echelon.excite.collisions.supports import plane_gaps
from echelon.excite.families.basis import Basis
from echelon.excite.families.bsplines import uniform_splines
from echelon.excite.families.fourier import Fourier
from echelon.excite.trajectory import Trajectory
from echelon.formats.mjcf_numbers import quaternion_matrix
from echelon.mechanism.joint import rotation, screw, translation
from echelon.mechanism.mechanism import Mechanism
from robots import has_pinocchio, robot_file

mujoco = pytest.importorskip("mujoco")

Floats = npt.NDArray[np.float64]

ARM = """<mujoco><compiler angle="radian"/><worldbody>
<geom name="floor" type="plane" size="1 1 1" pos="0 0 -0.4" euler="0.1 0 0"/>
<geom name="seen" type="sphere" size="0.5" contype="0" conaffinity="0"/>
<body name="a"><joint name="a" axis="0 0 1"/><geom name="ga" type="capsule" size="0.05" fromto="0 0 0 0.3 0 0"/>
<body name="b" pos="0.3 0 0.02"><joint name="b" axis="0 1 0"/><geom name="gb" type="box" size="0.1 0.04 0.03"
 pos="0.2 0 0" euler="0.2 0.1 0.3"/>
<body name="tool" pos="0.3 0 0" euler="0 0.4 0.3"><geom name="gt" type="cylinder" size="0.03 0.06" pos="0 0 0.02"/>
<body pos="0.1 0 0"><joint name="c" type="slide" axis="1 1 0"/><geom name="gc" type="ellipsoid" size="0.05 0.07 0.03"/>
<body name="d" pos="0.05 0 0.1"><joint name="d" axis="1 0 1" pos="0.02 0 0"/><geom name="gd" size="0.04"/>
<geom name="gm" type="mesh" mesh="m" pos="0.05 0 0.1"/></body></body></body></body></body>
</worldbody>
<asset><mesh name="m" vertex="0 0 0 0.1 0 0 0 0.2 0 0 0 0.15 0.1 0.2 0.1"/></asset>
<contact><exclude body1="a" body2="d"/></contact></mujoco>"""


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


# -- distances ---------------------------------------------------------------------------------------------------------


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


# -- robots of files ---------------------------------------------------------------------------------------------------


def brute(clearance: Clearance, model: Any, data: Any, geoms: dict[str, int]) -> Floats:
    """Smallest distances of the same pairs of bodies by MuJoCo, at its own frames."""
    least = np.full(len(clearance.bodies), clearance.reach)
    for (i, j), group in zip(clearance.pairs.tolist(), clearance.groups.tolist(), strict=True):
        ends = [geoms[clearance.shapes[k].name] for k in (i, j)]
        least[group] = min(least[group], mujoco.mj_geomDistance(model, data, *ends, clearance.reach, None))
    return least


def test_mjcf_arm_as_mujoco_has_it(tmp_path: Path) -> None:
    file = tmp_path / "arm.xml"
    file.write_text(ARM)
    mechanism = ec.load(file)
    geometry = read_geometry(mechanism, file)
    assert [shape.name for shape in geometry.shapes] == ["floor", "ga", "gb", "gt", "gc", "gd", "gm"]
    # the tool rides on b
    assert [shape.body for shape in geometry.shapes] == [-1, 0, 1, 1, 2, 3, 3]
    assert geometry.excluded == (("a", "d"),)
    clearance = clearance_of(mechanism, geometry.shapes, 0.0, reach=0.5)
    model = mujoco.MjModel.from_xml_string(ARM)
    data = mujoco.MjData(model)
    geoms = {model.geom(k).name: k for k in range(model.ngeom)}
    q = np.random.default_rng(0).uniform(-2, 2, (60, 4)) * [1, 1, 0.2, 1]
    values = clearance.values(q, q, q)
    for state, found in zip(q, values, strict=True):
        data.qpos[:] = state
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(found, brute(clearance, model, data, geoms), atol=2e-5)
    assert np.mean(values < 0.5) > 0.3
    assert (values < 0).any()


def test_urdf_arm_as_mujoco_has_it() -> None:
    file = robot_file("ur10_robot")
    mechanism = ec.load(file)
    geometry = read_geometry(mechanism, file)
    clearance = clearance_of(mechanism, geometry.shapes, 0.0, reach=1.0)
    meshes = file.parents[1] / "meshes/ur10/collision"
    compiler = f'<mujoco><compiler meshdir="{meshes}" strippath="true" fusestatic="false"/></mujoco>'
    text = re.sub(r"<visual>.*?</visual>", "", file.read_text(), flags=re.DOTALL)
    model = mujoco.MjModel.from_xml_string(re.sub(r"(<robot[^>]*>)", r"\1" + compiler, text, count=1))
    data = mujoco.MjData(model)
    carrier = [model.body(int(b)).name for b in model.geom_bodyid]
    geoms = {shape.name: carrier.index(shape.link) for shape in geometry.shapes}
    assert len(set(geoms.values())) == len(geoms) == 8
    q = np.random.default_rng(0).uniform(-2, 2, (40, 6))
    values = clearance.values(q, q, q)
    for state, found in zip(q, values, strict=True):
        data.qpos[:] = state
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(found, brute(clearance, model, data, geoms), atol=1e-4)
    assert (values < 0.0).any()
    assert np.mean(values < 1.0) > 0.3


@pytest.mark.skipif(not has_pinocchio(), reason="Pinocchio is not installed")
def test_urdf_arm_as_coal_has_it() -> None:
    import pinocchio as pin

    file = robot_file("panda_collision")
    mechanism = ec.load(file, independent_mimics=True)
    geometry = read_geometry(mechanism, file)
    clearance = clearance_of(mechanism, geometry.shapes, 0.0, reach=5.0)
    model = pin.buildModelFromUrdf(str(file))
    solids = pin.buildGeomFromUrdf(model, str(file), pin.GeometryType.COLLISION)
    names = [model.frames[g.parentFrame].name for g in solids.geometryObjects]
    theirs = {link: [k for k, name in enumerate(names) if name == link] for link in names}
    ours = {link: [k for k, s in enumerate(geometry.shapes) if s.link == link] for link in theirs}
    assert all(len(theirs[link]) == len(ours[link]) for link in theirs)
    twin = {k: t for link in theirs for k, t in zip(ours[link], theirs[link], strict=True)}
    for i, j in clearance.pairs.tolist():
        solids.addCollisionPair(pin.CollisionPair(twin[i], twin[j]))
    data, geometry_data = model.createData(), solids.createData()
    rng = np.random.default_rng(0)
    q = np.array([pin.randomConfiguration(model) for _ in range(10)]) * rng.uniform(0.3, 1, (10, 1))
    order = [mechanism.positions.index(name) for name in list(model.names)[1:]]
    mine = np.empty_like(q)
    mine[:, order] = q
    values = clearance.values(mine, mine, mine)
    for state, found in zip(q, values, strict=True):
        pin.computeDistances(model, data, solids, geometry_data, state)
        distances = [result.min_distance for result in geometry_data.distanceResults]
        expected = np.full(len(found), clearance.reach)
        np.minimum.at(expected, clearance.groups, distances)
        clear = expected > 0.005
        assert clear.any()
        np.testing.assert_allclose(found[clear], expected[clear], atol=2e-4)


def test_fixed_links_ride_on_bodies(tmp_path: Path) -> None:
    """A sphere behind two fixed joints is where forward kinematics by hand puts it."""
    file = tmp_path / "arm.urdf"
    sphere = '<collision><origin xyz="0 0 0.1"/><geometry><sphere radius="0.05"/></geometry></collision>'
    file.write_text(
        f"""<robot name="r"><link name="root">{sphere}</link><link name="one"/><link name="flange"/>
        <link name="tip">{sphere}</link><link name="stand">{sphere}</link>
        <joint name="j" type="revolute"><parent link="root"/><child link="one"/><axis xyz="0 0 1"/>
        <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
        <joint name="f" type="fixed"><parent link="one"/><child link="flange"/>
        <origin xyz="1 0 0" rpy="0 1.5 0"/></joint>
        <joint name="g" type="fixed"><parent link="flange"/><child link="tip"/><origin xyz="0 0 0.2"/></joint>
        <joint name="h" type="fixed"><parent link="root"/><child link="stand"/><origin xyz="0 3 0"/></joint></robot>"""
    )
    mechanism = ec.load(file)
    shapes = {shape.link: shape for shape in read_geometry(mechanism, file).shapes}
    assert {link: shape.body for link, shape in shapes.items()} == {"root": -1, "tip": 0, "stand": -1}
    np.testing.assert_allclose(shapes["stand"].placement[:3, 3], [0, 3, 0.1])
    expected = [1 + 0.3 * np.sin(1.5), 0, 0.3 * np.cos(1.5)]
    np.testing.assert_allclose(shapes["tip"].placement[:3, 3], expected, atol=1e-12)


def test_meshes_that_cannot_be_read(tmp_path: Path) -> None:
    file = tmp_path / "robots" / "arm.urdf"
    file.parent.mkdir()
    mesh = '<collision><geometry><mesh filename="{}"/></geometry></collision>'
    links = [mesh.format("package://parts/away.stl"), mesh.format("link.dae"), mesh.format("package://parts/box.obj")]
    parents = ["root", "l0", "l1"]
    joints = "".join(
        f'<joint name="j{k}" type="continuous"><parent link="{parent}"/><child link="l{k}"/></joint><link name="l{k}">'
        f"{link}</link>"
        for k, (link, parent) in enumerate(zip(links, parents, strict=True))
    )
    file.write_text(f'<robot name="r"><link name="root"/>{joints}</robot>')
    (tmp_path / "parts").mkdir()
    corners = "".join(f"v {x} {y} {z}\n" for x, y, z in product((0, 0.1), (0, 0.2), (0, 0.3)))
    (tmp_path / "parts" / "box.obj").write_text(corners + "f 1 2 4 3\nf 5 6 8 7\nf 1 2 6 5\nf 3 4 8 7\n")
    mechanism = ec.load(file)
    with pytest.raises(InputError, match=r"link 'l0'.*parts/away\.stl' is not found.*set-up can stand in"):
        read_geometry(mechanism, file)
    geometry = read_geometry(mechanism, file, tolerant=True)
    assert len(geometry.notes) == 2
    assert "link.dae' cannot be read (valid: .stl, .obj, .msh)" in geometry.notes[1]
    (shape,) = geometry.shapes
    assert shape.vertices is not None
    assert {tuple(v) for v in shape.vertices.round(6) + 0.0} == set(product((0, 0.1), (0, 0.2), (0, 0.3)))


# -- shapes of the set-up ----------------------------------------------------------------------------------------------


def planar(links: int = 3) -> Mechanism:
    """Links of length 1 in a plane."""
    return tree(
        "planar",
        *(
            body(k, k - 1, "revolute", place("1 0 0" if k > 1 else "0 0 0"), rotation(f"q{k}"))
            for k in range(1, links + 1)
        ),
    )


def test_entries() -> None:
    mechanism = planar()
    shapes = entry_shapes(
        mechanism,
        [
            {"body": "link3", "sphere": 0.06, "at": [0.5, 0, 0.1]},
            {"body": "link1", "capsule": [0.05], "from": [0, 0, 0], "to": [1, 0, 0], "name": "upper"},
            {"body": "link2", "box": [0.1, 0.2, 0.3], "at": [0, 0, 0.2], "rpy": [0, 0, 0.3]},
            {"body": "world", "plane": [0, 0, 2], "through": [0, 0, -0.1]},
        ],
    )
    assert [(s.body, s.kind, s.size) for s in shapes] == [
        (2, Kind.SPHERE, (0.06,)),
        (0, Kind.CAPSULE, (0.05, 0.5)),
        (1, Kind.BOX, (0.1, 0.2, 0.3)),
        (-1, Kind.PLANE, ()),
    ]
    np.testing.assert_allclose(shapes[1].placement[:3, [2, 3]], [[1, 0.5], [0, 0], [0, 0]], atol=1e-15)
    np.testing.assert_allclose(shapes[2].placement[:2, 0], [np.cos(0.3), np.sin(0.3)])
    # at zero the sphere is at (2.5, 0, 0.1) over the plane, and 1.5 from the end of the capsule
    zero = np.zeros((1, 3))
    clearance = clearance_of(mechanism, shapes, 0.01, reach=10.0)
    assert clearance.labels[1] == "distance of world and link3"
    found = dict(zip(clearance.labels, clearance.values(zero, zero, zero)[0], strict=True))
    assert found["distance of world and link3"] == pytest.approx(0.2 - 0.06)
    assert found["distance of link1 and link3"] == pytest.approx(np.hypot(1.5, 0.1) - 0.11)
    # the box stands on the plane; hulls have single precision in MuJoCo
    assert found["distance of world and link2"] == pytest.approx(0.0, abs=1e-7)


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ({"body": "link9", "sphere": 1}, r"entry 1: there is no body 'link9' \(valid: link1, link2, link3, world\)"),
        ({"sphere": 1}, "does not name its body"),
        ({"body": "link1"}, "exactly one of sphere.*found none"),
        ({"body": "link1", "sphere": 1, "box": [1, 1, 1]}, "found sphere and box"),
        ({"body": "link1", "sphere": -1}, "radius must be a positive number"),
        ({"body": "link1", "sphere": 0.1, "rpy": [0, 0, 0]}, "'rpy' has no meaning for a sphere"),
        ({"body": "link1", "sphere": 0.1, "at": [0, float("nan"), 0]}, "'at' needs 3 numbers"),
        ({"body": "link1", "capsule": 0.1, "from": [0, 0, 0]}, "needs 'to'"),
        ({"body": "link1", "capsule": 0.1, "from": [0, 0, 0], "to": [0, 0, 0]}, "must not be zero"),
        ({"body": "link1", "plane": [0, 0, 1]}, "only belong to the world"),
        ({"body": "link1", "mesh": "none.stl"}, "is not found"),
        ("link1", "expected a mapping"),
    ],
)
def test_entries_are_checked(entry: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        entry_shapes(planar(), [entry])


# -- pairs -------------------------------------------------------------------------------------------------------------


def spheres(mechanism: Mechanism, radius: float = 0.1) -> tuple[Shape, ...]:
    world = {"body": "world", "sphere": radius, "name": "stone"}
    return entry_shapes(mechanism, [world, *({"body": b.name, "sphere": radius} for b in mechanism.bodies)])


def test_neighbours_are_not_checked() -> None:
    mechanism = planar(4)
    found = {tuple(pair) for pair in checked_pairs(mechanism, spheres(mechanism)).tolist()}
    # index 0 is the world
    assert found == {(0, 2), (0, 3), (0, 4), (1, 3), (1, 4), (2, 4)}
    fewer = checked_pairs(mechanism, spheres(mechanism), [("link4", "link2"), ("stone", "link2"), ("world", "link3")])
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
    found = {tuple(pair) for pair in checked_pairs(mechanism, spheres(mechanism)).tolist()}
    # 2 is 1; 4 is the world
    assert found == {(0, 3), (3, 4)}


def test_touching_pairs_are_left_out_on_request() -> None:
    mechanism = planar()
    shapes = entry_shapes(mechanism, [{"body": f"link{k}", "sphere": 1.2, "name": f"s{k}"} for k in (1, 3)])
    assert len(clearance_of(mechanism, shapes, 0.01).pairs) == 1
    found = clearance_of(mechanism, shapes, 0.01, ignore_touching=True)
    assert len(found.pairs) == 0
    assert found.notes == ("'s1' and 's3' are not checked: they are too near at the reference pose",)
    assert found.values(np.zeros((2, 3)), np.zeros((2, 3)), np.zeros((2, 3))).shape == (2, 0)
    assert least_clearances(found, motion(mechanism, 0)).bounds.shape == (0,)


# -- slopes ------------------------------------------------------------------------------------------------------------


def differences(clearance: Clearance, q: Floats, step: float) -> Floats:
    """Of fourth order, shape (N, m, n)."""
    columns = []
    for k in range(q.shape[1]):
        e = step * np.eye(q.shape[1])[k]
        parts = [clearance.values(q + m * e, q, q) * w for m, w in ((-2, 1), (-1, -8), (1, 8), (2, -1))]
        columns.append(sum(parts) / (12 * step))
    return np.stack(columns, axis=2)


def test_slopes(tmp_path: Path) -> None:
    file = tmp_path / "arm.xml"
    file.write_text(ARM)
    mechanism = ec.load(file)
    clearance = clearance_of(mechanism, read_geometry(mechanism, file).shapes, 0.0, reach=0.4)
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


# -- certificates ------------------------------------------------------------------------------------------------------


def motion(mechanism: Mechanism, seed: int, size: float = 1.0) -> Trajectory:
    rng, n = np.random.default_rng(seed), len(mechanism.positions)
    basis: Basis = Fourier(4.0, 4) if seed % 2 else uniform_splines(4.0, 12)
    return Trajectory(mechanism.positions, ("rad",) * n, basis, size * rng.normal(size=(basis.size, n)))


def random_arm(seed: int) -> tuple[Mechanism, tuple[Shape, ...]]:
    """A branched tree of revolute, prismatic and screw joints, one of them coupled, with shapes and obstacles."""
    rng = np.random.default_rng(seed)
    bodies, entries = [], []
    for k in range(1, 6):
        xyz, rpy = (" ".join(f"{v:.3f}" for v in rng.uniform(-s, s, 3)) for s in (0.3, 0.0))
        joint = [rotation(f"q{k}", int(rng.integers(3))), translation(f"q{k}", int(rng.integers(3)))]
        joint += [screw(f"q{k}", parse("0.05"), int(rng.integers(3)))]
        kind = int(rng.choice(3, p=[0.6, 0.2, 0.2]))
        parent = k - 1 if k < 5 else 2
        bodies.append(body(k, parent, ("revolute", "prismatic", "screw")[kind], place(xyz, rpy), joint[kind]))
        at = rng.uniform(-0.1, 0.1, 3).tolist()
        shape = [{"sphere": 0.08, "at": at}, {"box": [0.05, 0.1, 0.08], "at": at}]
        shape += [
            {"capsule": 0.05, "from": at, "to": [0.1, 0.1, 0.2]},
            {"cylinder": 0.05, "from": at, "to": [0, 0, 0.3]},
        ]
        entries.append({"body": f"link{k}", **shape[int(rng.integers(4))]})
    entries.append({"body": "world", "plane": [0, 0.2, 1], "through": [0, 0, -0.6]})
    entries.append({"body": "world", "sphere": 0.2, "at": rng.uniform(-0.8, 0.8, 3).tolist()})
    mechanism = tree(f"random{seed}", *bodies, couplings={"q3": {"q1": "-0.5", "q2": "0.3"}})
    return mechanism, entry_shapes(mechanism, entries)


@pytest.mark.parametrize("seed", range(8))
def test_no_sample_is_below_the_bound(seed: int) -> None:
    mechanism, shapes = random_arm(seed)
    clearance = clearance_of(mechanism, shapes, 0.03)
    trajectory = motion(mechanism, seed, 0.35)
    found = least_clearances(clearance, trajectory, 2e-3)
    t = np.linspace(0, trajectory.duration, 8001)
    q = trajectory(t)
    least = clearance.values(q, q, q).min(axis=0)
    assert np.all(found.bounds <= least + 1e-9)
    assert np.all(found.bounds <= found.found)
    # they are as sharp as was promised
    assert np.all(found.bounds >= least - np.maximum(2e-3, 0.26 * np.abs(least - 0.03)) - 1e-3)
    assert np.all(np.abs(found.found - least) < np.maximum(2e-3, 0.26 * np.abs(least - 0.03)) + 1e-3)
    for k in np.flatnonzero(found.found < clearance.reach):
        state = trajectory(found.times[k])
        assert clearance.values(state, state, state)[0, k] == pytest.approx(found.found[k], abs=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_levers_bound_speeds(seed: int) -> None:
    """Points of shapes never move faster than the levers say."""
    mechanism, shapes = random_arm(seed)
    rng = np.random.default_rng(seed)
    trajectory = motion(mechanism, seed, 0.35)
    levers = Levers(mechanism, trajectory.basis.bounds(trajectory.coefficients, 0))
    slopes = clearance_of(mechanism, shapes, 0.0).kinematics.slopes(
        trajectory(rng.uniform(0, trajectory.duration, 400))
    )
    ratios = []
    stone = shapes[-1]  # against the world, velocities are absolute
    for shape in shapes[:5]:
        centre = shape.placement[:3, 3]
        moved = slopes[:, shape.body]
        speeds = np.linalg.norm(np.einsum("ncik,i->nck", moved[:, :, :3], centre) + moved[:, :, 3], axis=1)
        bound = levers.between(stone, shape)
        assert np.all(speeds <= bound + 1e-12)
        ratios.append(speeds.max(axis=0)[bound > 0] / bound[bound > 0])
    assert 0.3 < np.concatenate(ratios).max() <= 1 + 1e-12


def test_levers_of_a_branch_do_not_count_what_carries_both() -> None:
    mechanism = planar(4)
    shapes = spheres(mechanism)
    levers = Levers(mechanism, np.full(4, np.pi))
    np.testing.assert_allclose(levers.between(shapes[1], shapes[4]), [0, 2.1, 1.1, 0.1])
    np.testing.assert_allclose(levers.between(shapes[0], shapes[3]), [2.1, 1.1, 0.1, 0])


def test_a_short_dip_is_found() -> None:
    """A tip that rushes past a thin post between all samples of a coarse grid."""
    mechanism = planar(2)
    post = {"body": "world", "capsule": 0.01, "from": [2.1, 0, -1], "to": [2.1, 0, 1]}
    shapes = entry_shapes(mechanism, [post, {"body": "link2", "sphere": 0.05, "at": [1, 0, 0]}])
    clearance = clearance_of(mechanism, shapes, 0.0)
    coefficients = np.zeros((3, 2))
    phase = np.pi / 20  # q1 = 2 sin(2πt + phase) is zero between two of 20 samples
    coefficients[1:, 0] = 2 * np.cos(phase), 2 * np.sin(phase)
    trajectory = Trajectory(mechanism.positions, ("rad", "rad"), Fourier(1.0, 1), coefficients)
    found = least_clearances(clearance, trajectory, 1e-4)
    # link 1 is the first moving body, so only link 2 and the post are checked
    assert found.found[0] == pytest.approx(0.04, abs=2e-3)
    assert 0.03 - 1e-3 < found.bounds[0] <= 0.04 + 1e-12
    coarse = trajectory(np.linspace(0, 1, 21))
    assert clearance.values(coarse, coarse, coarse).min() > 0.1
    assert np.sin(2 * np.pi * found.times[0] + phase) == pytest.approx(0, abs=0.02)


def test_motions_that_rest_at_every_first_sample_are_seen_through() -> None:
    """The arm swings once per interval and is at rest, far from the post, in the middle of each."""
    mechanism = planar(2)
    post = {"body": "world", "capsule": 0.01, "from": [2.1, 0, -1], "to": [2.1, 0, 1]}
    shapes = entry_shapes(mechanism, [post, {"body": "link2", "sphere": 0.05, "at": [1, 0, 0]}])
    coefficients = np.zeros((129, 2))
    coefficients[0, 0], coefficients[128, 0] = 0.3, -0.3  # q1 = 0.3 (1 − cos(128πt))
    trajectory = Trajectory(mechanism.positions, ("rad", "rad"), Fourier(1.0, 64), coefficients)
    found = least_clearances(clearance_of(mechanism, shapes, 0.0), trajectory, 1e-3)
    assert 0.03 - 1e-3 < found.bounds[0] <= 0.04 + 1e-12


def test_faulty_distances_do_not_weaken_a_certificate(monkeypatch: pytest.MonkeyPatch) -> None:
    mechanism, shapes = random_arm(1)
    clearance = clearance_of(mechanism, shapes, 0.03)
    trajectory = motion(mechanism, 1, 0.35)
    sound = least_clearances(clearance, trajectory, 5e-3)
    true = Engine.measure

    def faulty(engine: Engine, places: Floats, asked: npt.NDArray[np.intp], reach: float) -> Any:
        found = true(engine, places, asked, reach)
        found.distances[:] += 0.1
        found.points[:] += np.random.default_rng(0).normal(size=found.points.shape) * 0.02
        return found

    monkeypatch.setattr(Engine, "measure", faulty)
    assert np.all(least_clearances(clearance, trajectory, 5e-3).bounds <= sound.found + 1e-12)


def test_old_versions_of_mujoco_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mujoco, "__version__", "3.9.1")
    with pytest.raises(EchelonError, match=r"MuJoCo 3\.9\.1 gives wrong distances.*3\.12 or later"):
        Engine(floating((Kind.SPHERE, (1.0,))))


def test_arguments_are_checked() -> None:
    mechanism = planar()
    shapes = spheres(mechanism)
    with pytest.raises(InputError, match="reach must be larger than the clearance"):
        clearance_of(mechanism, shapes, 0.1, reach=0.05)
    with pytest.raises(InputError, match="0 or more"):
        clearance_of(mechanism, shapes, -0.1)
    with pytest.raises(InputError, match="rotates freely"):
        clearance_of(ec.load("examples/floating_tree.yaml"), (), 0.1)
    with pytest.raises(InputError, match="must move the positions q1, q2, q3"):
        least_clearances(clearance_of(mechanism, shapes, 0.1), motion(planar(2), 0))
    with pytest.raises(InputError, match="tolerance"):
        least_clearances(clearance_of(mechanism, shapes, 0.1), motion(mechanism, 0), 0.0)
    with pytest.raises(InputError, match="lie in a plane"):
        mesh_shape("flat", -1, np.eye(4), np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]))
    with pytest.raises(InputError, match="not a rotation"):
        Shape("bent", -1, Kind.SPHERE, (1.0,), placed(2 * np.eye(3)))
