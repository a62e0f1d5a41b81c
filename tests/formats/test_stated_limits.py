"""Limits that robot files state, against the numbers in the files, Pinocchio's reading and MuJoCo's simulation."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import echelon as ec
from echelon.formats.joint_limits import StatedLimits, stated_limits
from echelon.formats.robot_file import open_robot
from support.mjcf_models import INERTIA, model
from support.paths import ROOT
from support.robot_files import pinocchio_model, robot_file, robot_files
from support.selection import one_in
from support.textbook_poses import Z, pose_of, turned

LIMIT = "<limit lower='-1.5' upper='2' velocity='3' effort='40'/>"
ALL = StatedLimits((-1.5, 2), 3, None, None, 40)


def urdf(content: str, kind: str = "revolute") -> str:
    """A joint that turns about z, and a second one with the given content."""
    joints = (
        "<joint name='j1' type='revolute'><parent link='base'/><child link='a'/><axis xyz='0 0 1'/></joint>"
        f"<joint name='j2' type='{kind}'><parent link='a'/><child link='b'/><axis xyz='0 0 1'/>{content}</joint>"
    )
    return f"<robot name='r'><link name='base'/><link name='a'/><link name='b'/>{joints}</robot>"


def mjcf(joint: str, actuators: str = "", tail: str = "") -> str:
    inner = f'<body name="b" pos="0 0 1"><joint name="j2" {joint}/>{INERTIA}</body>'
    body = f'<body name="a"><joint name="j1" axis="0 0 1"/>{INERTIA}{inner}</body>'
    return model(body, tail=f"<actuator>{actuators}</actuator>{tail}")


def limits_of(tmp_path: Path, text: str, **options: Any) -> dict[str, StatedLimits]:
    file = tmp_path / ("robot.xml" if text.startswith("<mujoco") else "robot.urdf")
    file.write_text(text, encoding="utf-8")
    return stated_limits(open_robot(file), ec.load(file, **options))


# -- URDF -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "content", "expected"),
    [
        ("revolute", LIMIT, ALL),
        ("prismatic", LIMIT, ALL),
        ("continuous", LIMIT, StatedLimits(None, 3, None, None, 40)),
        ("planar", LIMIT, None),
        ("floating", LIMIT, None),
        ("fixed", LIMIT, None),
        ("revolute", "", None),
        (
            "revolute",
            "<limit effort='1' velocity='2'/>",
            StatedLimits(None, 2, None, None, 1),
        ),
        ("revolute", "<limit lower='-1'/>", StatedLimits((-1, 0))),
        ("revolute", "<limit lower='0' upper='0'/>", StatedLimits((0, 0))),
        ("revolute", "<limit lower='-inf' upper='inf' velocity='inf'/>", None),
        ("revolute", "<limit lower='-inf' upper='1'/>", StatedLimits((-math.inf, 1))),
        (
            "revolute",
            "<limit acceleration='5' deceleration='4' jerk='100'/>",
            StatedLimits(None, None, 4, 100),
        ),
        (
            "revolute",
            "<limit acceleration='5' deceleration='0'/>",
            StatedLimits(acceleration=5),
        ),
        (
            "revolute",
            f"{LIMIT}<safety_controller soft_lower_limit='-1' soft_upper_limit='2.5' k_velocity='1'/>",
            StatedLimits((-1, 2), 3, None, None, 40),
        ),
        (
            "revolute",
            f"{LIMIT}<safety_controller soft_upper_limit='1'/>",
            StatedLimits((-1.5, 1), 3, effort=40),
        ),
        ("revolute", f"{LIMIT}<safety_controller k_velocity='10'/>", ALL),
        (
            "revolute",
            f"{LIMIT}<safety_controller soft_lower_limit='0' soft_upper_limit='0'/>",
            ALL,
        ),
        (
            "revolute",
            "<safety_controller soft_lower_limit='-1' soft_upper_limit='1'/>",
            StatedLimits((-1, 1)),
        ),
        (
            "continuous",
            "<safety_controller soft_lower_limit='-1' soft_upper_limit='1'/>",
            None,
        ),
    ],
)
def test_urdf(
    tmp_path: Path, kind: str, content: str, expected: StatedLimits | None
) -> None:
    found = limits_of(tmp_path, urdf(content, kind))
    assert set(found) <= {"j2"}
    got = found.get("j2", StatedLimits())
    assert replace(got, notes=()) == (expected or StatedLimits())


def test_a_limit_without_a_range_is_noted(tmp_path: Path) -> None:
    (note,) = limits_of(tmp_path, urdf("<limit effort='1' velocity='2'/>"))["j2"].notes
    assert (
        note
        == "joint 'j2': it states neither lower nor upper, and counts as free, not as locked at 0"
    )


def test_zeros_that_the_format_demands_are_no_limits_and_are_noted(
    tmp_path: Path,
) -> None:
    content = "<limit lower='-1' upper='1' velocity='0' effort='-1'/>"
    soft = "<safety_controller soft_lower_limit='0' soft_upper_limit='0'/>"
    notes = tuple(
        f"joint 'j2': {what} counts as not stated"
        for what in ("velocity 0", "effort -1", "soft limits 0")
    )
    assert limits_of(tmp_path, urdf(content + soft))["j2"] == StatedLimits(
        (-1, 1), notes=notes
    )


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (
            "<limit lower='1' upper='-1'/>",
            "joint 'j2': its positions have an empty range: the lowest is 1 and the",
        ),
        (
            "<limit velocity='fast'/>",
            "joint 'j2' limit velocity: needs a number, found 'fast'",
        ),
        (
            "<limit effort='nan'/>",
            "joint 'j2' limit effort: needs a number, found 'nan'",
        ),
        (
            f"{LIMIT}<safety_controller soft_lower_limit='3'/>",
            "the lowest is 3 and the highest 2",
        ),
        (
            "<safety_controller soft_lower_limit=''/>",
            "joint 'j2' safety_controller soft_lower_limit: needs a number",
        ),
    ],
)
def test_unusable_limits_name_the_joint(
    tmp_path: Path, content: str, said: str
) -> None:
    with pytest.raises(ec.InputError, match=r"robot\.urdf") as caught:
        limits_of(tmp_path, urdf(content))
    assert said in str(caught.value)


def test_coupled_joints_count_without_the_offset_of_their_coupling(
    tmp_path: Path,
) -> None:
    mimic = "<mimic joint='j1' multiplier='2' offset='0.5'/>"
    found = limits_of(tmp_path, urdf(LIMIT + mimic))
    mechanism = ec.load(tmp_path / "robot.urdf", snap_tolerance=0)
    assert mechanism.dependent == {"j2"}
    for end, stated in zip(found["j2"].position or (), (-1.5, 2), strict=True):
        np.testing.assert_allclose(
            pose_of(mechanism, 1, {"j2": end}), turned(Z, stated), atol=1e-12
        )
    alone = limits_of(tmp_path, urdf(LIMIT + mimic), independent_mimics=True)
    assert alone["j2"] == ALL


def test_couplings_by_polynomials_and_tendons_count_without_their_offsets(
    tmp_path: Path,
) -> None:
    joints = "".join(
        f'<body><joint name="{name}" type="slide" range="-1 2"/><geom size="0.1"/></body>'
        for name in "abc"
    )
    text = f"""<mujoco><worldbody>{joints}</worldbody>
    <tendon><fixed name="t"><joint joint="b" coef="1"/><joint joint="c" coef="4"/></fixed></tendon>
    <equality><joint joint1="b" joint2="a" polycoef="0.5 0 3 0 0"/>
    <tendon tendon1="t" polycoef="0.1 0 0 0 0"/></equality>
    </mujoco>"""
    (tmp_path / "robot.xml").write_text(text)
    mechanism = ec.load(tmp_path / "robot.xml")
    found = stated_limits(open_robot(tmp_path / "robot.xml"), mechanism)
    assert found["a"].position == (-1, 2)
    assert found["b"].position == (-1.5, 1.5)  # b = 0.5 + 3 a²
    assert found["c"].position == (-0.9, 2.1)  # c = (0.1 − b)/4


def test_chains_of_couplings_count_without_their_offsets(tmp_path: Path) -> None:
    third = (
        "<link name='c'/><joint name='j3' type='revolute'><parent link='b'/><child link='c'/><axis xyz='0 0 1'/>"
        f"{LIMIT}<mimic joint='j2' multiplier='3' offset='0.25'/></joint></robot>"
    )
    text = urdf("<mimic joint='j1' multiplier='2' offset='0.5'/>").replace(
        "</robot>", third
    )
    found = limits_of(tmp_path, text)
    mechanism = ec.load(tmp_path / "robot.urdf", snap_tolerance=0)
    for end, stated in zip(found["j3"].position or (), (-1.5, 2), strict=True):
        np.testing.assert_allclose(
            pose_of(mechanism, 2, {"j3": end}), turned(Z, stated), atol=1e-12
        )


@pytest.mark.parametrize("name", one_in(7, sorted(robot_files())))
def test_pinocchio_reads_the_same(name: str) -> None:
    file = robot_file(name)
    mechanism = ec.load(file, independent_mimics=True)
    found, theirs = (
        stated_limits(open_robot(file), mechanism),
        pinocchio_model(file, False),
    )
    speeds, efforts = theirs.velocityLimit, theirs.effortLimit
    names = [
        m.name
        for m in mechanism.motions
        if len(m.velocities) == 1 and theirs.existJointName(m.name)
    ]
    for name in names:
        joint, got = (
            theirs.joints[theirs.getJointId(name)],
            found.get(name, StatedLimits()),
        )
        assert (got.velocity or 0) == positive(speeds[joint.idx_v])
        assert (got.effort or 0) == positive(efforts[joint.idx_v])
        low, high = (
            theirs.lowerPositionLimit[joint.idx_q],
            theirs.upperPositionLimit[joint.idx_q],
        )
        if joint.nq == 2:
            assert got.position is None
        elif (
            got.position is None
        ):  # what is not stated is zero for Pinocchio, and that is noted
            assert (low, high) == (0, 0)
            assert "neither lower nor upper" in got.notes[-1]
        else:  # Pinocchio does not look at soft limits
            soft = "soft_lower_limit" in file.read_text(encoding="utf-8")
            assert (low, high) == got.position or (
                soft and low <= got.position[0] <= got.position[1] <= high
            )


def positive(value: float) -> float:
    """Zero or less, and what is as large as a number can be, is no limit."""
    return float(value) if 0 < value < 1e300 else 0.0


# -- MJCF -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("joint", "expected"),
    [
        ('type="hinge" axis="0 1 0" range="-90 45"', (-math.pi / 2, math.pi / 4)),
        (
            'type="hinge" axis="0 1 0" range="-90 45" ref="30"',
            (-math.pi / 2, math.pi / 4),
        ),
        ('type="slide" axis="0 1 0" range="-0.1 0.2"', (-0.1, 0.2)),
        ('type="hinge" axis="0 1 0" range="-90 45" limited="false"', None),
        ('type="hinge" axis="0 1 0"', None),
    ],
)
def test_ranges_of_mjcf_joints(
    tmp_path: Path, joint: str, expected: tuple[float, float] | None
) -> None:
    found = limits_of(tmp_path, mjcf(joint))
    assert set(found) <= {"j2"}
    position = found.get("j2", StatedLimits()).position
    assert position == (
        None if expected is None else pytest.approx(expected, abs=1e-15)
    )


@pytest.mark.parametrize(
    "joint", ['type="ball" range="0 60"', 'type="ball" limited="true" range="0 60"']
)
def test_balls_have_no_limits(tmp_path: Path, joint: str) -> None:
    assert limits_of(tmp_path, mjcf(joint)) == {}


def test_a_range_of_mjcf_means_the_same_pose(tmp_path: Path) -> None:
    """With a reference position and a coupling, an end of the range is where MuJoCo has the body at that end."""
    import mujoco

    text = mjcf(
        'type="hinge" axis="0 0 1" range="-60 45" ref="30"',
        tail='<equality><joint joint1="j2" joint2="j1" polycoef="0.2 2 0 0 0"/></equality>',
    )
    found = limits_of(tmp_path, text)
    mechanism = ec.load(tmp_path / "robot.xml", snap_tolerance=0)
    assert mechanism.dependent == {"j2"}
    theirs = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(theirs)
    for end, stated in zip(
        found["j2"].position or (), theirs.joint("j2").range, strict=True
    ):
        data.joint("j2").qpos[:] = stated
        mujoco.mj_kinematics(theirs, data)
        turn = pose_of(mechanism, 1, {"j2": end})[
            :3, :3
        ]  # the first joint is at zero, so this is the whole pose
        np.testing.assert_allclose(turn, data.body("b").xmat.reshape(3, 3), atol=1e-12)


@pytest.mark.parametrize(
    ("joint", "actuators"),
    [
        ("", '<motor joint="j2" ctrlrange="-2 2" gear="30"/>'),
        ("", '<motor joint="j2" ctrlrange="-2 3" gear="-30"/>'),
        ("", '<general joint="j2" ctrlrange="-2 2" gainprm="4"/>'),
        ("", '<motor joint="j2" ctrlrange="-2 2" forcerange="-1 1.5" gear="30"/>'),
        ("", '<motor joint="j2" forcerange="-1 1" gear="30"/>'),
        (
            "",
            '<position joint="j2" kp="1e5" ctrlrange="-3 3" forcerange="-7 7" gear="2"/>',
        ),
        (
            "",
            '<motor joint="j2" ctrlrange="0 1" gear="5"/><motor joint="j2" ctrlrange="0 1" gear="-4"/>',
        ),
        ('actuatorfrcrange="-12 12"', '<motor joint="j2"/>'),
        ('actuatorfrcrange="-12 12"', '<motor joint="j2" ctrlrange="-2 2" gear="3"/>'),
        ('actuatorfrcrange="-12 12"', '<motor joint="j2" ctrlrange="-2 2" gear="30"/>'),
        ("", '<motor jointinparent="j2" ctrlrange="-2 2" gear="30"/>'),
    ],
)
def test_efforts_of_mjcf_are_what_the_simulation_reaches(
    tmp_path: Path, joint: str, actuators: str
) -> None:
    import mujoco

    text = mjcf(f'type="hinge" axis="0 1 0" {joint}', actuators)
    found = limits_of(tmp_path, text)
    theirs = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(theirs)
    reached = []
    for corner in np.stack(
        np.meshgrid(*[[-1e6, 0.0, 1e6]] * theirs.nu), axis=-1
    ).reshape(-1, theirs.nu):
        data.ctrl[:] = corner
        mujoco.mj_forward(theirs, data)
        reached.append(float(data.qfrc_actuator[theirs.joint("j2").dofadr[0]]))
    assert found["j2"].effort == pytest.approx(
        min(-min(reached), max(reached)), rel=1e-12
    )
    assert (found["j2"].velocity, found["j2"].acceleration, found["j2"].jerk) == (
        None,
        None,
        None,
    )
    assert "j1" not in found


@pytest.mark.parametrize(
    "actuators",
    [
        '<motor joint="j2" gear="30"/>',
        '<motor joint="j2" ctrlrange="-2 2" ctrllimited="false"/>',
        '<position joint="j2" ctrlrange="-2 2"/>',
        '<motor joint="j2" ctrlrange="-2 2"/><motor joint="j2"/>',
        '<general joint="j2" ctrlrange="-2 2" dyntype="integrator"/>',
        '<motor joint="j2" gear="0" ctrlrange="-1 1"/>',
        '<motor joint="j1" ctrlrange="-1 1" forcelimited="false" ctrllimited="false"/>',
    ],
)
def test_actuators_without_bound_limit_no_effort(
    tmp_path: Path, actuators: str
) -> None:
    assert limits_of(tmp_path, mjcf('type="hinge" axis="0 1 0"', actuators)) == {}


def test_an_actuator_that_pushes_one_way_is_noted(tmp_path: Path) -> None:
    found = limits_of(
        tmp_path,
        mjcf('type="hinge" axis="0 1 0"', '<motor joint="j2" ctrlrange="0 1"/>'),
    )
    note = "joint 'j2': its actuators push one way only, so they limit no effort here"
    assert found == {"j2": StatedLimits(notes=(note,))}


# -- descriptions -----------------------------------------------------------------------------------------------------


def test_a_description_states_the_limits_of_its_robot_file(tmp_path: Path) -> None:
    (tmp_path / "arm").mkdir()
    (tmp_path / "arm" / "arm.urdf").write_text(urdf(LIMIT), encoding="utf-8")
    file = tmp_path / "setup.yaml"
    file.write_text(
        "echelon: 1\nrobot: {file: arm/arm.urdf}\neffects: [{type: viscous, at: all}]\n",
        encoding="utf-8",
    )
    assert stated_limits(open_robot(file), ec.load(file)) == {"j2": ALL}


def test_a_plain_description_and_examples() -> None:
    panda = ROOT / "examples" / "panda.yaml"
    assert stated_limits(open_robot(panda), ec.load(panda)) == {}
    arm = ROOT / "examples" / "two_link.xml"
    ends = math.radians(150)
    found = stated_limits(open_robot(str(arm)), ec.load(arm))
    assert list(found) == ["shoulder", "elbow"]
    assert [limits.position for limits in found.values()] == [
        pytest.approx((-ends, ends))
    ] * 2
    biped = ROOT / "examples" / "loops" / "biped.xml"
    assert set(stated_limits(open_robot(biped), ec.load(biped))) <= set(
        ec.load(biped).velocities
    )
