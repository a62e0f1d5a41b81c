"""Loops of MJCF: frames against MuJoCo's own at the reference pose, lumping, exactness, and what is ignored."""

from __future__ import annotations

import json

import mujoco
import numpy as np
import pytest

from echelon.formats.robot_file import RobotFile
from echelon.formats.snapping import ReadingOptions
from echelon.formats.writers.description_writer import write_description
from echelon.robot.closure import ClosureKind
from echelon.robot.joint import GROUND
from echelon.robot.mechanism import Mechanism
from echelon.shared.errors import InputError
from support.descriptions import read_description
from support.loop_frames import frames, residual
from support.textbook_poses import Array

INERTIA = '<inertial pos="0.05 -0.02 0.11" mass="1.3" diaginertia="0.021 0.017 0.012"/>'
TREE = f"""<mujoco><compiler angle="degree"/><worldbody>
  <body name="stand" pos="0 0 0.5" euler="0 0 90">
    <body name="a" pos="0.1 0 1" euler="10 20 30">
      <joint name="ja" axis="0 1 0" ref="25" pos="0.1 0 0.2"/>{INERTIA}
      <body name="b" pos="0.3 0 0" euler="0 90 0"><joint name="jb" type="slide" axis="1 2 3" ref="0.3"/>{INERTIA}
        <body name="tool" pos="0 0.1 0.2" euler="0 0 37"><site name="tip" pos="0.01 0.02 0.03" euler="0 11 0"/></body>
      </body></body>
  </body>
  <body name="c" pos="0 1 0" euler="0 0 37"><joint name="jc" axis="1 0 1"/>{INERTIA}
    <site name="dot" pos="0.2 0 0" euler="50 0 0"/>
    <body name="d" pos="0 0.2 0"><joint name="jd" type="ball" pos="0 0 0.1"/>{INERTIA}</body></body>
  <body name="e" pos="1 2 3" euler="0 45 0"><freejoint name="je"/>{INERTIA}</body>
  <body name="handle" mocap="true"/>
</worldbody><equality>EQUALITY</equality>TAIL</mujoco>"""

EQUALITIES = {
    "connect": '<connect body1="a" body2="e" anchor="0.1 0.2 0.3"/>',
    "connect over a ref": '<connect body1="b" body2="e" anchor="0.1 0.2 0.3"/>',
    "connect with the world": '<connect body1="e" anchor="0.1 0.2 0.3"/>',
    "connect lumped": '<connect body1="tool" body2="d" anchor="0.1 0.2 0.3"/>',
    "connect world lumped": '<connect body1="stand" body2="e" anchor="0.1 0.2 0.3"/>',
    "weld": '<weld body1="b" body2="e"/>',
    "weld with anchor": '<weld body1="e" body2="tool" anchor="0.1 0.2 0.3"/>',
    "weld with the world": '<weld body1="e" anchor="0.1 0.2 0.3"/>',
    "weld without torque": '<weld body1="b" body2="e" anchor="0.1 0.2 0.3" torquescale="0"/>',
    "weld with pose": '<weld body1="b" body2="e" anchor="0.1 0 0.3" relpose="0.1 0.2 0.3 2 0 0 -1"/>',
    "sites": '<connect site1="tip" site2="dot"/>',
    "welded sites": '<weld site1="dot" site2="tip"/>',
}


@pytest.fixture(autouse=True)
def unclosed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Frames are read; whether they can meet is not asked."""
    monkeypatch.setattr(
        "echelon.loops.close", lambda mechanism, *_, prefer: chosen(mechanism, prefer)
    )


def chosen(mechanism: Mechanism, prefer: list[str]) -> Mechanism:
    object.__setattr__(mechanism, "preferred", tuple(prefer))
    return mechanism


def read(equality: str, tail: str = "", tree: str = TREE, **options: bool) -> Mechanism:
    return RobotFile.of(text(equality, tail, tree).encode(), "robot.xml").mechanism(
        ReadingOptions(snap_tolerance=0, **options)
    )


def text(equality: str, tail: str = "", tree: str = TREE) -> str:
    return tree.replace("EQUALITY", equality).replace("TAIL", tail)


def compiled(equality: str) -> tuple[object, object]:
    """MuJoCo's model and its data at the reference pose."""
    model = mujoco.MjModel.from_xml_string(text(equality))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def mujoco_points(equality: str) -> tuple[Array, Array]:
    """The two points that a constraint holds together, in the world at the reference pose."""
    model, data = compiled(equality)
    one, two = int(model.eq_obj1id[0]), int(model.eq_obj2id[0])
    if model.eq_objtype[0] == mujoco.mjtObj.mjOBJ_SITE:
        return data.site_xpos[one], data.site_xpos[two]
    first, second = model.eq_data[0, :3], model.eq_data[0, 3:6]
    if model.eq_type[0] == mujoco.mjtEq.mjEQ_WELD:
        first, second = second, first
    return tuple(
        data.xpos[b] + data.xmat[b].reshape(3, 3) @ p
        for b, p in ((one, first), (two, second))
    )


@pytest.mark.parametrize("name", EQUALITIES)
@pytest.mark.parametrize("keep_fixed_links", [False, True])
def test_points_are_those_of_mujoco(name: str, keep_fixed_links: bool) -> None:
    mechanism = read(EQUALITIES[name], keep_fixed_links=keep_fixed_links)
    points = [frame[:3, 3] for frame in frames(mechanism, 0, dict(mechanism.assembly))]
    expected = mujoco_points(EQUALITIES[name])
    if (
        name.split()[0] == "weld"
    ):  # between bodies, it states its point on the second one
        expected = expected[::-1]
    np.testing.assert_allclose(points, expected, atol=1e-12)


@pytest.mark.parametrize("name", [name for name in EQUALITIES if "weld" in name])
def test_orientations_are_those_of_mujoco(name: str) -> None:
    mechanism = read(EQUALITIES[name])
    if "without" in name:
        assert mechanism.closures[0].kind is ClosureKind.SPHERICAL
        return
    assert mechanism.closures[0].kind is ClosureKind.WELD
    model, data = compiled(EQUALITIES[name])
    rotations = [
        frame[:3, :3] for frame in frames(mechanism, 0, dict(mechanism.assembly))
    ]
    one, two = int(model.eq_obj1id[0]), int(model.eq_obj2id[0])
    if "sites" in name:
        expected = [
            data.site_xmat[one].reshape(3, 3),
            data.site_xmat[two].reshape(3, 3),
        ]
    else:
        relative = np.zeros(9)
        mujoco.mju_quat2Mat(relative, model.eq_data[0, 6:10])
        expected = [
            data.xmat[two].reshape(3, 3),
            data.xmat[one].reshape(3, 3) @ relative.reshape(3, 3),
        ]
    np.testing.assert_allclose(rotations, expected, atol=1e-12)


@pytest.mark.parametrize(
    "name", [name for name in EQUALITIES if "pose" not in name and "sites" not in name]
)
def test_derived_loops_close_at_the_reference_pose(name: str) -> None:
    mechanism = read(EQUALITIES[name])
    np.testing.assert_allclose(
        residual(mechanism, dict(mechanism.assembly)), 0, atol=1e-13
    )
    assert mechanism.assembly["jb"] == 0.3
    assert mechanism.assembly["je.tz"] == 3


def test_fixed_bodies_ride_on_their_hosts() -> None:
    mechanism = read('<connect body1="tool" body2="stand" anchor="0.1 0.2 0.3"/>')
    (closure,) = mechanism.closures
    assert (mechanism.bodies[closure.first].name, closure.second) == ("b", GROUND)


def test_lengths_stay_exact_numbers() -> None:
    mechanism = read('<connect name="pin" body1="e" body2="c" anchor="0.1 0 0.3"/>')
    assert [str(e) for e in mechanism.closures[0].first_frame.translation] == [
        "1/10",
        "0",
        "3/10",
    ]
    assert mechanism.closures[0].name == "pin"
    assert not any(
        name.startswith("p") and name[1] in "xyz" for name in mechanism.symbols
    )
    flat = """<mujoco><worldbody>
      <body name="a" pos="0.1 0 1" euler="0 45 0"><joint name="a" axis="0 1 0"/>INERTIA</body>
      <body name="b" pos="0.3 0.2 0" euler="0 -30 0"><joint name="b" axis="0 1 0"/>INERTIA</body></worldbody>
      <equality><connect body1="a" body2="b" anchor="0.2 0.5 0"/></equality></mujoco>"""
    (closure,) = read("", tree=flat.replace("INERTIA", INERTIA)).closures
    x, y, z = (str(e) for e in closure.second_frame.translation)
    assert y == "3/10"
    assert "sqrt" in x
    assert "sqrt" in z


def test_actuated_joints_are_preferred() -> None:
    tail = """<actuator><motor joint="jc"/><position jointinparent="ja"/><motor joint="jd" gear="1 1 1 0 0 0"/>
      <motor site="tip" gear="1 0 0 0 0 0"/></actuator>"""
    assert read(EQUALITIES["connect"], tail).preferred == ("jc", "ja")  # type: ignore[attr-defined]


def test_what_is_ignored_is_noted() -> None:
    mechanism = read(
        '<weld body1="handle" body2="e"/><connect body1="e" anchor="0 0 0" active="false"/>'
    )
    assert mechanism.closures == ()
    assert mechanism.reading is not None
    assert (
        "equality weld 'handle and e' is ignored: it follows a body that is moved from outside (mocap)"
        in (mechanism.reading.notes)
    )
    mechanism = read('<connect name="idle" body1="b" body2="tool" anchor="0 0 0"/>')
    assert mechanism.closures == ()
    assert mechanism.reading is not None
    assert (
        "equality connect 'idle' is ignored: its two ends do not move against each other"
        in (mechanism.reading.notes)
    )


def test_a_held_joint_does_not_move_the_anchor() -> None:
    """MuJoCo finds the second anchor at the reference pose, whatever equalities hold."""
    equality = '<connect body1="b" body2="e" anchor="0.1 0.2 0.3"/>'
    held = '<joint joint1="ja" polycoef="0.4 0 0 0 0"/>'
    assert (
        read(equality + held).closures[0].second_frame
        == read(equality).closures[0].second_frame
    )


@pytest.mark.parametrize("name", EQUALITIES)
def test_round_trip(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("echelon.loops.close", lambda mechanism, *_, **__: mechanism)
    mechanism = read(EQUALITIES[name])
    written = json.dumps(write_description(mechanism))
    again = read_description(
        written, "robot.json", ReadingOptions(keep_fixed_links=True)
    )
    assert (again.closures, again.assembly) == (mechanism.closures, mechanism.assembly)
    assert json.dumps(write_description(again)) == written


def test_bodies_that_do_not_exist_are_refused() -> None:
    with pytest.raises(InputError, match="nobody"):
        read('<connect name="pin" body1="a" body2="nobody" anchor="0 0 0"/>')


# -- where loops are assembled -----------------------------------------------------------------------------------------

BARS = f"""<mujoco><compiler angle="radian"/><default><joint axis="0 0 1"/></default><worldbody>
  <body name="crank"><joint name="q1"/>{INERTIA}
    <body name="coupler" pos="0.15 0 0"><joint name="q2"/>{INERTIA}<site name="one" pos="0.35 0 0"/></body></body>
  <body name="rocker" pos="0.4 0 0"><joint name="q3"/>{INERTIA}<site name="two" pos="0.3 0 0"/></body></worldbody>
<equality><connect name="pin" site1="one" site2="two"/></equality>
<keyframe><key name="far" qpos="0.5 0.5 0.5"/><key name="home" qpos="1 -0.4816 1.6206"/><key name="odd"/></keyframe>
</mujoco>"""


def notes(mechanism: Mechanism) -> str:
    assert mechanism.reading is not None
    return "; ".join(mechanism.reading.notes)


def test_a_keyframe_that_closes_is_where_loops_are_assembled() -> None:
    mechanism = read("", tree=BARS)
    assert dict(mechanism.assembly) == {"q1": 1, "q2": -0.4816, "q3": 1.6206}
    expected = (
        "the loops are assembled near keyframe 'home', because at the reference pose closure 'pin' is off by 0.2 m "
        "between coupler and rocker"
    )
    assert expected in notes(mechanism)


def test_a_pose_that_misses_by_little_is_said() -> None:
    near = BARS.replace('pos="0.3 0 0"', 'pos="0.1 0 0"').replace(
        '"0.35 0 0"', '"0.348 0 0"'
    )
    mechanism = read("", tree=near)
    assert not any(mechanism.assembly.values())
    assert (
        "at the reference pose closure 'pin' is off by 0.002 m between coupler and rocker"
        in notes(mechanism)
    )
    assert "assembled" not in notes(read("", tree=near.replace("0.348", "0.35")))


def test_half_turns_of_the_reference_pose_stay() -> None:
    """A rotation without w is not taken for none."""
    tree = TREE.replace('pos="1 2 3" euler="0 45 0"', 'pos="1 2 3" quat="0 0 1 0"')
    mechanism = read(EQUALITIES["connect"], tree=tree)
    assert (mechanism.assembly["je.r.w"], mechanism.assembly["je.r.y"]) == (0, 1)
    np.testing.assert_allclose(
        residual(mechanism, dict(mechanism.assembly)), 0, atol=1e-13
    )
