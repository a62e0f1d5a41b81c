"""Robot files whose loops stand beside them: frames that meet, joints that are of other types, lists of frame pairs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import echelon as ec
from echelon.robot.closure import ClosureKind
from echelon.robot.joint import MotionKind
from echelon.robot.mechanism import Mechanism
from echelon.robot.stated import known_values, placement_matrix

URDF = """<robot name="five"><link name="floor"/><link name="a1"/><link name="a2"/><link name="b1"/><link name="b2"/>
<joint name="mot1" type="revolute"><origin rpy="1.5707963267948966 0 0"/><parent link="floor"/><child link="a1"/>
  <axis xyz="0 0 1"/></joint>
<joint name="free1" type="revolute"><origin xyz="0.2 0 1e-18"/><parent link="a1"/><child link="a2"/>
  <axis xyz="0 0 1"/></joint>
<joint name="mot2" type="revolute"><origin xyz="0.3 0 0" rpy="1.5707963267948966 0 0"/><parent link="floor"/>
  <child link="b1"/><axis xyz="0 0 1"/></joint>
<joint name="free2" type="revolute"><origin xyz="0.2 0 0"/><parent link="b1"/><child link="b2"/>
  <axis xyz="0 0 1"/></joint>
<link name="end_A"/><link name="end_B"/>
<joint name="end_A_frame" type="fixed"><origin xyz="0.25 0 0"/><parent link="a2"/><child link="end_A"/></joint>
<joint name="end_B_frame" type="fixed"><origin xyz="0.25 3e-17 0"/><parent link="b2"/><child link="end_B"/></joint>
</robot>"""
ASSEMBLY = "assembly: {mot1: 1.2, free1: -0.9, mot2: 2, free2: 0.8}\n"
START = "echelon: 1\nrobot: {file: robot.urdf}\n"
PAIRS = """closed_loop: [['end_A', 'end_B']]
type: ['6d']
name_mot: ['mot2', 'mot1']
joint_name: []
joint_type: []
"""


@pytest.fixture
def unclosed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Closures are read without asking whether they can close."""
    monkeypatch.setattr("echelon.loops.close", lambda mechanism, *_, **__: mechanism)


def read(folder: Path, text: str, file: str = URDF) -> Mechanism:
    (folder / "robot.urdf").write_text(file)
    (folder / "robot.yaml").write_text(text)
    return ec.load(folder / "robot.yaml")


# -- what meets --------------------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("unclosed")
def test_fixed_frames_meet_as_they_are(tmp_path: Path) -> None:
    """Whether fixed links are bodies of their own makes no difference, nor does the noise of their origins."""
    text = START + "loops: [{joint: spherical, connects: [end_A, end_B]}]\n" + ASSEMBLY
    (closure,) = read(tmp_path, text).closures
    assert [str(e) for e in closure.first_frame.translation] == ["1/4", "0", "0"]
    assert [str(e) for e in closure.second_frame.translation] == ["1/4", "0", "0"]
    apart = ec.load(tmp_path / "robot.yaml", keep_fixed_links=True)
    names = [
        apart.bodies[k].name
        for k in (apart.closures[0].first, apart.closures[0].second)
    ]
    assert names == ["end_A", "end_B"]
    assert all(
        f.is_identity
        for f in (apart.closures[0].first_frame, apart.closures[0].second_frame)
    )


@pytest.mark.usefixtures("unclosed")
def test_with_a_frame_on_the_first_the_second_follows(tmp_path: Path) -> None:
    text = (
        START
        + "loops: [{joint: spherical, connects: [end_A, end_B], at: {xyz: [0.1, 0, 0]}}]\n"
    )
    (closure,) = read(tmp_path, text).closures
    assert [str(e) for e in closure.second_frame.translation] == ["1/20", "0", "0"]
    (closure,) = read(
        tmp_path, START + "loops: [{joint: spherical, connects: [a2, b2]}]\n"
    ).closures
    assert str(closure.second_frame.translation[0]) == "-3/10"


@pytest.mark.usefixtures("unclosed")
def test_a_pair_is_a_weld_of_both_frames(tmp_path: Path) -> None:
    (closure,) = read(tmp_path, START + "loops: [[end_A, b2]]\n").closures
    assert (closure.name, closure.kind) == ("end_A-b2", ClosureKind.WELD)
    assert closure.second_frame.is_identity
    (closure,) = read(tmp_path, START + "loops: [[null, b2]]\n").closures
    assert closure.name == "base-b2"


@pytest.mark.usefixtures("unclosed")
def test_sites_of_mjcf_meet(tmp_path: Path) -> None:
    file = """<mujoco><compiler angle="radian"/><worldbody><site name="hook" pos="0.2 0 0" euler="0 0 0.4"/>
      <body name="a"><joint name="qa" axis="0 1 0"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
        <body name="arm" pos="0.1 0 0"><site name="tip" pos="0.2 0.5 0"/><site name="a"/><site/></body></body>
    </worldbody></mujoco>"""
    (tmp_path / "robot.xml").write_text(file)
    text = "echelon: 1\nrobot: {file: robot.xml}\nloops: [{joint: revolute, connects: [tip, hook]}]\n"
    mechanism = read(tmp_path, text)
    (closure,) = mechanism.closures
    assert (closure.first, closure.second) == (0, -1)
    assert [str(e) for e in closure.first_frame.translation] == ["3/10", "1/2", "0"]
    hook = placement_matrix(closure.second_frame, known_values(mechanism))
    np.testing.assert_allclose(hook[:2, 0], [np.cos(0.4), np.sin(0.4)], atol=1e-15)
    assert (
        read(tmp_path, text.replace("tip", "a")).closures[0].first_frame.is_identity
    )  # bodies come first
    with pytest.raises(
        ec.InputError,
        match=r"connects\[0\]: there is no body or frame 'top'; did you mean 'tip'",
    ):
        read(tmp_path, text.replace("tip", "top"))


# -- joints of other types ---------------------------------------------------------------------------------------------


def test_joints_of_other_types(tmp_path: Path) -> None:
    stated = "free1: {type: spherical}, free2: {type: universal, axis: x, axis2: -y}, end_A_frame: {type: spherical}"
    robot = read(
        tmp_path,
        START.replace("urdf}", "urdf, joints: {" + stated + ", mot2: {type: fixed}}}"),
    )
    assert [body.name for body in robot.bodies] == ["a1", "a2", "end_A", "b2"]
    motions = {m.name: (m.kind, m.axis, m.sign) for m in robot.motions}
    assert motions["free1"][0] is MotionKind.BALL
    assert motions["free2.1"] == (MotionKind.ROTATION, 0, 1)
    assert motions["free2.2"] == (MotionKind.ROTATION, 1, -1)
    assert motions["end_A_frame"][0] is MotionKind.BALL
    plain = {body.name: body.joint for body in read(tmp_path, START).bodies}
    changed = {body.name: body.joint for body in robot.bodies}
    assert (
        changed["a2"].steps[0] == plain["a2"].steps[0]
    )  # where the joint is stays as the file says
    assert (changed["a2"].kind, changed["b2"].kind) == ("spherical", "universal")


WRONG = {
    "no such joint": (
        "{free3: {type: spherical}}",
        r"robot.joints.free3: the robot file has no joint .* 'free2'",
    ),
    "an axis too many": (
        "{free1: {type: spherical, axis: x}}",
        "a spherical joint has no axis",
    ),
    "an axis too few": (
        "{free1: {type: universal, axis: x}}",
        "perpendicular to each other",
    ),
    "parallel axes": (
        "{free1: {type: universal, axis: x, axis2: -x}}",
        "perpendicular to each other",
    ),
    "unknown type": ("{free1: {type: ball}}", "'ball' is not valid"),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_types_are_named(tmp_path: Path, case: str) -> None:
    joints, message = WRONG[case]
    with pytest.raises(ec.InputError, match=message) as error:
        read(tmp_path, START.replace("urdf}", f"urdf, joints: {joints}}}"))
    assert "robot.yaml" in str(error.value)


def test_a_joint_that_is_coupled_keeps_its_axis(tmp_path: Path) -> None:
    mimic = URDF.replace(
        '<child link="a2"/>', '<child link="a2"/><mimic joint="mot1"/>'
    )
    with pytest.raises(
        ec.InputError,
        match=r"robot\.joints\.mot1: it has one axis, because of joint 'free1' mimic",
    ):
        read(
            tmp_path,
            START.replace("urdf}", "urdf, joints: {mot1: {type: spherical}}}"),
            mimic,
        )


# -- published lists ---------------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("unclosed")
def test_a_list_of_pairs_says_what_a_description_says(tmp_path: Path) -> None:
    listed = PAIRS.replace(
        "joint_name: []", "joint_name: ['free1', 'free2', 'mot2']"
    ).replace("joint_type: []", "joint_type: ['SPHERICAL', 'CARDAN', 'UJOINT_ZY']")
    robot = read(tmp_path, listed)
    joints = """{free1: {type: spherical}, free2: {type: universal, axis: x, axis2: y},
        mot2: {type: universal, axis: z, axis2: y}}"""
    text = (
        START.replace("urdf}", f"urdf, joints: {joints}}}")
        + "loops: [[end_A, end_B]]\n"
    )
    same = read(tmp_path, text)
    assert (robot.bodies, robot.closures) == (same.bodies, same.closures)
    assert (
        read(tmp_path, PAIRS.replace("'6d'", "'3D'")).closures[0].kind
        is ClosureKind.SPHERICAL
    )
    assert (
        read(tmp_path, PAIRS.replace("type: ['6d']\n", "", 1)).closures[0].kind
        is ClosureKind.WELD
    )
    assert not read(
        tmp_path, PAIRS.replace("[['end_A', 'end_B']]", "[]").replace("['6d']", "[]")
    ).closures


def test_motors_are_independent_first(tmp_path: Path) -> None:
    text = START + "loops: [{joint: spherical, connects: [end_A, end_B]}]\n" + ASSEMBLY
    assert read(
        tmp_path, text.replace("urdf}", "urdf, driven: [free1, free2]}")
    ).independent == ("free1", "free2")


WRONG_LISTS = {
    "no such frame": (
        "'end_B'",
        "'end_C'",
        r"closed_loop\[0\]\[1\]: there is no body or frame 'end_C'.*line 1",
    ),
    "no pair": (", 'end_B'", "", r"closed_loop\[0\]: needs two names .*line 1"),
    "no list": ("['6d']", "6d", r"type: needs a list, found '6d' .*line 2"),
    "unknown contact": (
        "6d",
        "4d",
        r"type\[0\]: '4d' is not a type of contact .*line 2",
    ),
    "too many types": (
        "['6d']",
        "['6d', '3d']",
        "type: has 2 entries, and closed_loop has 1",
    ),
    "unknown motor": (
        "'mot1'",
        "'moto1'",
        r"name_mot\[1\]: there is no coordinate 'moto1'; did you mean 'mot1'",
    ),
    "no type of a joint": (
        "joint_name: []",
        "joint_name: [free1]",
        "joint_type: has 0 entries, and joint_name has 1",
    ),
    "unknown joint": (
        "joint_name: []\njoint_type: []",
        "joint_name: [free]\njoint_type: [SPHERICAL]",
        r"joint_name\[0\]: the robot file has no joint 'free'; did you mean .*line 4",
    ),
    "unknown type": (
        "joint_name: []\njoint_type: []",
        "joint_name: [free1]\njoint_type: [BALL]",
        r"joint_type\[0\]: 'BALL' is not a type of joint .*line 5",
    ),
}


@pytest.mark.parametrize("case", WRONG_LISTS)
def test_wrong_lists_are_named(tmp_path: Path, case: str) -> None:
    old, new, message = WRONG_LISTS[case]
    assert old in PAIRS
    with pytest.raises(ec.InputError, match=message):
        read(tmp_path, PAIRS.replace(old, new))


def test_the_urdf_beside_a_list_has_its_name(tmp_path: Path) -> None:
    (tmp_path / "other.yaml").write_text(PAIRS)
    with pytest.raises(ec.InputError, match=r"other.urdf: cannot be read"):
        ec.load(tmp_path / "other.yaml")


# -- links with two joints ---------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("unclosed")
def test_a_link_with_two_joints_is_said_as_a_loop(tmp_path: Path) -> None:
    """The message states a loop that can be read."""
    pin = '<joint name="pin" type="TYPE"><origin xyz="0.35 0 0"/><parent link="a2"/><child link="b2"/><axis xyz="0 0 1"/>'
    file = URDF.replace("</robot>", pin + "</joint></robot>")
    with pytest.raises(
        ec.InputError, match="joint 'pin': link 'b2' already has joint 'free2'"
    ) as error:
        read(tmp_path, START, file.replace("TYPE", "continuous"))
    loop = str(error.value).split("'")[-2]
    (closure,) = read(tmp_path, f"{START}{loop}\n").closures
    assert (closure.name, closure.kind) == ("pin", ClosureKind.REVOLUTE)
    assert [str(e) for e in closure.first_frame.translation] == ["7/20", "0", "0"]
    assert closure.second_frame.is_identity
    with pytest.raises(ec.InputError, match="joint: weld, "):
        read(tmp_path, START, file.replace("TYPE", "fixed"))
    with pytest.raises(ec.InputError, match="as it constrains nothing"):
        read(tmp_path, START, file.replace("TYPE", "floating"))
