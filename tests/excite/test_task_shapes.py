"""Links without shapes are named wherever a motion is called safe, and boxes that are no links are doubted."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import echelon as ec
from echelon.cli.excite import verdict
from echelon.excite.excite import ExcitingTrajectory
from echelon.excite.problem.inertia_boxes import inertia_boxes
from echelon.excite.problem.task import Task, changed, task_of
from echelon.report.preview import verdict as verdict_of_page
from support.robot_files import robot_file

MESH = "<collision><geometry><mesh filename='away.stl'/></geometry></collision>"
CUBE = "<collision><geometry><box size='0.01 0.01 0.01'/></geometry></collision>"


def inertial(mass: float, xx: float, yy: float, zz: float, x: float = 0.0) -> str:
    return (
        f"<inertial><origin xyz='{x} 0 0'/><mass value='{mass}'/>"
        f"<inertia ixx='{xx}' iyy='{yy}' izz='{zz}' ixy='0' ixz='0' iyz='0'/></inertial>"
    )


def arm(folder: Path, collisions: str = "") -> Path:
    """Two links of 0.4 m whose meshes are away, with a small cube on the flange, and a set-up."""
    links = [
        f"<link name='base_link'>{MESH}</link>",
        f"<link name='upper'>{inertial(4, 0.01, 0.06, 0.06, 0.2)}{MESH}</link>",
        f"<link name='fore'>{inertial(1, 0.22, 0.22, 0.001, 0.2)}{MESH}</link>",
        f"<link name='flange'>{CUBE}</link>",
    ]
    joints = [
        f"<joint name='j{k}' type='{kind}'><parent link='{a}'/><child link='{b}'/><origin xyz='{x} 0 0'/>"
        "<axis xyz='0 1 0'/><limit lower='-2' upper='2' velocity='2' effort='100'/></joint>"
        for k, (kind, a, b, x) in enumerate(
            [
                ("revolute", "base_link", "upper", 0),
                ("revolute", "upper", "fore", 0.4),
                ("fixed", "fore", "flange", 0.4),
            ]
        )
    ]
    (folder / "arm.urdf").write_text(
        f"<robot name='arm'>{''.join(links + joints)}</robot>"
    )
    file = folder / "task.yaml"
    file.write_text(
        f"echelon: 1\nname: arm\nrobot: arm.urdf\nexcitation:\n  collisions: {{{collisions}}}\n"
    )
    return file


def task(file: Path, **changes: Any) -> Task:
    setup = ec.load_setup(file)
    return task_of(setup, changed(setup.excitation, changes, setup.source))


def texts(of: Task) -> list[str]:
    return [
        f"{f.severity.value}: {f.text}" for f in of.findings if f.kind == "collisions"
    ]


def test_links_without_shapes_are_named(tmp_path: Path) -> None:
    found = task(arm(tmp_path, "unreadable: none"))
    (lost,) = texts(found)
    assert lost.startswith(
        "warning: 3 of 4 links have no shape, so their distances are not checked: base_link, upper, fore ("
    )
    assert "mesh 'away.stl' not found" in lost
    assert found.unchecked == (
        "links without shapes were not checked: base_link, upper, fore",
    )


def test_verdicts_name_what_was_not_checked(tmp_path: Path) -> None:
    file = arm(tmp_path, "unreadable: none")
    found: ExcitingTrajectory = ec.exciting_trajectory(
        ec.load_setup(file), starts=1, iterations=2, duration=4
    )
    what = "links without shapes were not checked: base_link, upper, fore"
    assert (
        verdict(found)
        == f"all {len(found.margins)} limits are kept at every time; {what}"
    )
    assert verdict_of_page(found.margins, found.unchecked) == (
        f"Every checked limit is kept at every time; {what}."
    )


def test_shapes_of_the_set_up_stand_for_meshes_by_body_or_link(tmp_path: Path) -> None:
    shapes = (
        "{body: base_link, sphere: 0.05, at: [0, 0, -0.3]}",
        "{body: upper, capsule: 0.05, from: [0, 0, 0], to: [0.4, 0, 0]}",
        "{body: flange, sphere: 0.05, at: [0, 0.1, 0]}",
        "{body: fore, sphere: 0.05, at: [0.2, 0, 0]}",
    )
    file = arm(tmp_path, f"shapes: [{', '.join(shapes[:3])}]")
    with pytest.raises(ec.InputError, match="add shapes of fore under collisions"):
        task(file)
    file = arm(tmp_path, f"shapes: [{', '.join(shapes)}]")
    found = task(file)
    assert texts(found) == [
        "note: shapes of the file that cannot be read are left out, and other shapes stand for their links: base_link, "
        "upper, fore"
    ]
    assert found.unchecked == ()
    (clearance,) = [part for part in found.constraints if hasattr(part, "shapes")]
    of = {shape.link: shape for shape in clearance.shapes[1:]}
    assert [of[name].body for name in ("base_link", "upper", "flange")] == [-1, 0, 1]
    # the flange is fixed 0.4 m along the forearm
    np.testing.assert_allclose(of["flange"].placement[:3, 3], [0.4, 0.1, 0])
    file = arm(tmp_path, f"shapes: [{shapes[1]}]")
    with pytest.raises(
        ec.InputError, match=r"add shapes of base_link, fore under collisions"
    ):
        task(file)
    file = arm(tmp_path, "shapes: [{body: hand, sphere: 0.1}]")
    with pytest.raises(
        ec.InputError,
        match=r"no body 'hand' \(valid: upper, fore, base_link, flange, world\)",
    ):
        task(file)


def test_boxes_that_are_no_links_are_doubted(tmp_path: Path) -> None:
    found = task(arm(tmp_path, "unreadable: boxes"))
    boxes, doubts, lost, *_ = texts(found)
    # of 4 kg with 0.01, 0.06 and 0.06 kg·m²: √(6 (b + c − a) / m)
    assert "'upper' 0.122 × 0.122 × 0.406 m" in boxes
    assert doubts.startswith(
        "warning: boxes of inertias that can hardly be their links: 'fore' "
    )
    assert "'upper'" not in doubts
    assert lost.startswith("warning: 1 of 4 links has no shape")


def test_boxes_are_told_only_where_there_are_some(tmp_path: Path) -> None:
    shapes = ", ".join(f"{{body: {name}, sphere: 0.05}}" for name in ("upper", "fore"))
    (text,) = [
        some
        for some in texts(task(arm(tmp_path, f"unreadable: boxes, shapes: [{shapes}]")))
        if some.startswith("warning")
    ]
    assert text.startswith("warning: 1 of 4 links has no shape")


def test_boxes_of_stock_robots_that_are_doubted() -> None:
    """Inertias of wrists and of a shoulder that nobody computed; boxes of other links are about as large as these."""
    expected = {
        "ur10_robot": set(),
        "xarm7": set(),
        "kinova": set(),
        "a1": set(),
        "ur5_robot": {"wrist_1_link", "wrist_2_link", "wrist_3_link"},
        "panda": {"panda_link1", "panda_link5"},
    }
    for name, doubted in expected.items():
        boxes = inertia_boxes(ec.load(robot_file(name)), ())
        found = {box.shape.name.removesuffix(":inertia") for box in boxes if box.doubt}
        assert found == doubted, name
