"""Shapes of robots of files, as MuJoCo and coal have them, and those that a set-up names."""

from __future__ import annotations

import re
from itertools import product
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import echelon as ec
from echelon.excite.problem.clearance import Clearance, clearance_of
from echelon.excite.problem.robot_shapes import entry_shapes, read_geometry
from echelon.excite.problem.shapes import ShapeKind
from echelon.formats.robot_file import open_robot
from echelon.shared.errors import InputError
from support.robot_files import robot_file
from support.shaped_robots import ARM, Floats, planar


def brute(clearance: Clearance, model: Any, data: Any, geoms: dict[str, int]) -> Floats:
    """Smallest distances of the same pairs of bodies by MuJoCo, at its own frames."""
    least = np.full(len(clearance.owners), clearance.reach)
    for (i, j), group in zip(
        clearance.pairs.tolist(), clearance.groups.tolist(), strict=True
    ):
        ends = [geoms[clearance.shapes[k].name] for k in (i, j)]
        least[group] = min(
            least[group],
            mujoco.mj_geomDistance(model, data, *ends, clearance.reach, None),
        )
    return least


def test_mjcf_arm_as_mujoco_has_it(tmp_path: Path) -> None:
    file = tmp_path / "arm.xml"
    file.write_text(ARM)
    mechanism = ec.load(file)
    geometry = read_geometry(mechanism, open_robot(file))
    assert [shape.name for shape in geometry.shapes] == [
        "floor",
        "ga",
        "gb",
        "gt",
        "gc",
        "gd",
        "gm",
    ]
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
        np.testing.assert_allclose(
            found, brute(clearance, model, data, geoms), atol=2e-5
        )
    assert np.mean(values < 0.5) > 0.3
    assert (values < 0).any()


def test_urdf_arm_as_mujoco_has_it() -> None:
    file = robot_file("ur10_robot")
    mechanism = ec.load(file)
    geometry = read_geometry(mechanism, open_robot(file))
    clearance = clearance_of(mechanism, geometry.shapes, 0.0, reach=1.0)
    meshes = file.parents[1] / "meshes/ur10/collision"
    compiler = f'<mujoco><compiler meshdir="{meshes}" strippath="true" fusestatic="false"/></mujoco>'
    text = re.sub(r"<visual>.*?</visual>", "", file.read_text(), flags=re.DOTALL)
    model = mujoco.MjModel.from_xml_string(
        re.sub(r"(<robot[^>]*>)", r"\1" + compiler, text, count=1)
    )
    data = mujoco.MjData(model)
    carrier = [model.body(int(b)).name for b in model.geom_bodyid]
    geoms = {shape.name: carrier.index(shape.link) for shape in geometry.shapes}
    assert len(set(geoms.values())) == len(geoms) == 8
    q = np.random.default_rng(0).uniform(-2, 2, (40, 6))
    values = clearance.values(q, q, q)
    for state, found in zip(q, values, strict=True):
        data.qpos[:] = state
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(
            found, brute(clearance, model, data, geoms), atol=1e-4
        )
    assert (values < 0.0).any()
    assert np.mean(values < 1.0) > 0.3


def test_urdf_arm_as_coal_has_it() -> None:
    import pinocchio as pin

    file = robot_file("panda_collision")
    mechanism = ec.load(file, independent_mimics=True)
    geometry = read_geometry(mechanism, open_robot(file))
    clearance = clearance_of(mechanism, geometry.shapes, 0.0, reach=5.0)
    model = pin.buildModelFromUrdf(str(file))
    solids = pin.buildGeomFromUrdf(model, str(file), pin.GeometryType.COLLISION)
    names = [model.frames[g.parentFrame].name for g in solids.geometryObjects]
    theirs = {
        link: [k for k, name in enumerate(names) if name == link] for link in names
    }
    ours = {
        link: [k for k, s in enumerate(geometry.shapes) if s.link == link]
        for link in theirs
    }
    assert all(len(theirs[link]) == len(ours[link]) for link in theirs)
    twin = {
        k: t for link in theirs for k, t in zip(ours[link], theirs[link], strict=True)
    }
    for i, j in clearance.pairs.tolist():
        solids.addCollisionPair(pin.CollisionPair(twin[i], twin[j]))
    data, geometry_data = model.createData(), solids.createData()
    rng = np.random.default_rng(0)
    q = np.array([pin.randomConfiguration(model) for _ in range(10)]) * rng.uniform(
        0.3, 1, (10, 1)
    )
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
    shapes = {
        shape.link: shape for shape in read_geometry(mechanism, open_robot(file)).shapes
    }
    assert {link: shape.body for link, shape in shapes.items()} == {
        "root": -1,
        "tip": 0,
        "stand": -1,
    }
    np.testing.assert_allclose(shapes["stand"].placement[:3, 3], [0, 3, 0.1])
    expected = [1 + 0.3 * np.sin(1.5), 0, 0.3 * np.cos(1.5)]
    np.testing.assert_allclose(shapes["tip"].placement[:3, 3], expected, atol=1e-12)


def test_meshes_that_cannot_be_read(tmp_path: Path) -> None:
    file = tmp_path / "robots" / "arm.urdf"
    file.parent.mkdir()
    mesh = '<collision><geometry><mesh filename="{}"/></geometry></collision>'
    links = [
        mesh.format("package://parts/away.stl"),
        mesh.format("link.dae"),
        mesh.format("package://parts/box.obj"),
    ]
    parents = ["root", "l0", "l1"]
    joints = "".join(
        f'<joint name="j{k}" type="continuous"><parent link="{parent}"/><child link="l{k}"/></joint><link name="l{k}">'
        f"{link}</link>"
        for k, (link, parent) in enumerate(zip(links, parents, strict=True))
    )
    file.write_text(f'<robot name="r"><link name="root"/>{joints}</robot>')
    (tmp_path / "parts").mkdir()
    corners = "".join(
        f"v {x} {y} {z}\n" for x, y, z in product((0, 0.1), (0, 0.2), (0, 0.3))
    )
    (tmp_path / "parts" / "box.obj").write_text(
        corners + "f 1 2 4 3\nf 5 6 8 7\nf 1 2 6 5\nf 3 4 8 7\n"
    )
    mechanism = ec.load(file)
    with pytest.raises(
        InputError,
        match=r"link 'l0'.*parts/away\.stl' not found.*add a shape under collisions",
    ):
        read_geometry(mechanism, open_robot(file))
    geometry = read_geometry(mechanism, open_robot(file), tolerant=True)
    assert [(one.link, one.body) for one in geometry.lost] == [("l0", 0), ("l1", 1)]
    problem = geometry.lost[1].problem
    assert "link.dae' cannot be read (valid: .stl, .obj, .msh)" in problem
    (shape,) = geometry.shapes
    assert shape.vertices is not None
    assert {tuple(v) for v in shape.vertices.round(6) + 0.0} == set(
        product((0, 0.1), (0, 0.2), (0, 0.3))
    )


def test_entries() -> None:
    mechanism = planar()
    shapes = entry_shapes(
        mechanism,
        [
            {"body": "link3", "sphere": 0.06, "at": [0.5, 0, 0.1]},
            {
                "body": "link1",
                "capsule": [0.05],
                "from": [0, 0, 0],
                "to": [1, 0, 0],
                "name": "upper",
            },
            {
                "body": "link2",
                "box": [0.2, 0.4, 0.6],
                "at": [0, 0, 0.2],
                "rpy": [0, 0, 0.3],
            },
            {"body": "world", "plane": [0, 0, 2], "through": [0, 0, -0.1]},
        ],
    )
    assert [(s.body, s.kind, s.size) for s in shapes] == [
        (2, ShapeKind.SPHERE, (0.06,)),
        (0, ShapeKind.CAPSULE, (0.05, 0.5)),
        (1, ShapeKind.BOX, (0.1, 0.2, 0.3)),
        (-1, ShapeKind.PLANE, ()),
    ]
    np.testing.assert_allclose(
        shapes[1].placement[:3, [2, 3]], [[1, 0.5], [0, 0], [0, 0]], atol=1e-15
    )
    np.testing.assert_allclose(shapes[2].placement[:2, 0], [np.cos(0.3), np.sin(0.3)])
    # at zero the sphere is at (2.5, 0, 0.1) over the plane, and 1.5 from the end of the capsule
    zero = np.zeros((1, 3))
    clearance = clearance_of(mechanism, shapes, 0.01, reach=10.0)
    assert clearance.labels == (
        "distance of link2 and world",
        "distance of link3 and world",
        "distance of link1 and link3",
    )
    found = dict(
        zip(clearance.labels, clearance.values(zero, zero, zero)[0], strict=True)
    )
    assert found["distance of link3 and world"] == pytest.approx(0.2 - 0.06)
    assert found["distance of link1 and link3"] == pytest.approx(
        np.hypot(1.5, 0.1) - 0.11
    )
    # the box stands on the plane; hulls have single precision in MuJoCo
    assert found["distance of link2 and world"] == pytest.approx(0.0, abs=1e-7)


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        (
            {"body": "link9", "sphere": 1},
            r"entry 1: there is no body 'link9' \(valid: link1, link2, link3, world\)",
        ),
        ({"sphere": 1}, "does not name its body"),
        ({"body": "link1"}, "exactly one of sphere.*found none"),
        ({"body": "link1", "sphere": 1, "box": [1, 1, 1]}, "found sphere and box"),
        ({"body": "link1", "sphere": -1}, "radius must be a positive number"),
        (
            {"body": "link1", "sphere": 0.1, "rpy": [0, 0, 0]},
            "'rpy' has no meaning for a sphere",
        ),
        (
            {"body": "link1", "sphere": 0.1, "at": [0, float("nan"), 0]},
            "'at' needs 3 numbers",
        ),
        ({"body": "link1", "capsule": 0.1, "from": [0, 0, 0]}, "needs 'to'"),
        (
            {"body": "link1", "capsule": 0.1, "from": [0, 0, 0], "to": [0, 0, 0]},
            "must not be zero",
        ),
        ({"body": "link1", "plane": [0, 0, 1]}, "only belong to the world"),
        ({"body": "link1", "mesh": "none.stl"}, "not found"),
        ("link1", "expected a mapping"),
    ],
)
def test_entries_are_checked(entry: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        entry_shapes(planar(), [entry])


def test_stated_boxes_have_lengths_as_in_urdf(tmp_path: Path) -> None:
    file = tmp_path / "arm.urdf"
    file.write_text(
        "<robot name='arm'><link name='base'/><link name='arm'><collision><geometry><box size='0.2 0.4 0.6'/>"
        "</geometry></collision></link><joint name='j' type='continuous'><parent link='base'/><child link='arm'/>"
        "<axis xyz='1 0 0'/></joint></robot>"
    )
    mechanism = ec.load(file)
    (of_file,) = read_geometry(mechanism, open_robot(file)).shapes
    (stated,) = entry_shapes(mechanism, [{"body": "arm", "box": [0.2, 0.4, 0.6]}])
    assert stated.size == of_file.size
