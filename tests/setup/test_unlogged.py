"""Logs of a part of a robot: what is not in them rests, and is said to."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import echelon as ec
from echelon.identification.logs.columns.column_guess import guess
from echelon.identification.logs.files.log_file import Table
from echelon.identification.logs.finding import Severity
from echelon.identification.setup.logs import with_logs
from echelon.identification.setup.skeleton import skeleton
from support.robot_files import robot_file
from support.swinging_arm import ARM, Motion, swinging

GRIPPER = """<link name="jaw"><inertial><origin xyz="0.05 0 0"/><mass value="0.1"/>
<inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="gripper_joint" type="prismatic"><parent link="lower"/><child link="jaw"/><origin xyz="0.2 0 0"/>
<axis xyz="0 1 0"/><limit lower="0.01" upper="0.04" effort="1" velocity="1"/></joint></robot>"""
RAIL = """<link name="floor"/><joint name="rail" type="prismatic"><parent link="floor"/><child link="base"/>
<axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""
ARM_ON_RAIL = ARM.replace("</robot>", RAIL)
ARM_WITH_GRIPPER = ARM.replace("</robot>", GRIPPER)
FLOATING = ARM.replace(
    "</robot>",
    '<link name="odom"/><joint name="free" type="floating"><parent link="odom"/><child link="base"/></joint></robot>',
)


@pytest.fixture(scope="module")
def motion() -> Motion:
    return swinging()


def frame(
    motion: Motion, position: str = "q{n}", output: str = "tau{n}"
) -> pd.DataFrame:
    found = pd.DataFrame({"t": motion["t"]})
    for pattern, values in ((position, motion["q"]), (output, motion["tau"])):
        for k, name in enumerate(("shoulder_joint", "elbow_joint")):
            found[pattern.format(n=k + 1, name=name)] = values[:, k]
    return found


@pytest.mark.parametrize(
    ("robot", "rests"),
    [
        (ARM_WITH_GRIPPER, "gripper_joint: 0.01"),
        (ARM_ON_RAIL, "rail: 0"),
        (FLOATING, "free.tx: 0, free.ty: 0, free.tz: 0, free.r: 0"),
    ],
)
@pytest.mark.parametrize(
    "names", [("q{n}", "tau{n}"), ("{name} Istwinkel", "{name} Drehmoment")]
)
def test_joints_without_columns_rest(
    robot: str, rests: str, names: tuple[str, str], motion: Motion
) -> None:
    setup, _, _ = with_logs(robot, frame(motion, *names))
    assert setup.mechanism.velocities == ("shoulder_joint", "elbow_joint")
    told = [text for text in setup.assumed if "no columns for" in text]
    assert len(told) == 1
    assert f"locked: {{{rests}}}" in told[0]


def test_a_set_up_locks_what_is_not_logged(motion: Motion, tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(ARM_WITH_GRIPPER)
    frame(motion, "ang {n}", "mom {n}").to_csv(tmp_path / "log.csv", index=False)
    found = skeleton(tmp_path / "arm.urdf", [tmp_path / "log.csv"], tmp_path)
    assert "\nlocked: {gripper_joint: 0.01}" in found.text
    assert "log.csv: 10 s at 300 Hz in 1 stretch" in found.report
    (tmp_path / "setup.yaml").write_text(found.text)
    result = ec.identify(tmp_path / "setup.yaml", tmp_path / "log.csv")
    assert result.base.mechanism.velocities == ("shoulder_joint", "elbow_joint")
    ec.save_identification(result, tmp_path / "model.json")
    model = ec.load_identified(tmp_path / "model.json")
    predicted = ec.predict_log(model.plan, model.values, tmp_path / "log.csv")
    assert min(score.r2 for score in predicted.scores) > 0.99


def test_what_rests_in_the_log_is_locked_there(motion: Motion) -> None:
    log = frame(motion, "{name}_pos", "{name}_effort")
    log["gripper_joint_pos"], log["gripper_joint_effort"] = 0.03, 0.0
    result = ec.identify(ARM_WITH_GRIPPER, log)
    assert result.base.mechanism.velocities == ("shoulder_joint", "elbow_joint")
    assert any(
        "locked: {gripper_joint: 0.03}" in finding.text for finding in result.findings
    )


def test_a_stated_column_that_no_log_has_is_a_warning(
    motion: Motion, tmp_path: Path
) -> None:
    """Unless its name is near that of a column nobody uses, so that it may be misspelt."""
    (tmp_path / "arm.urdf").write_text(ARM)
    setup = tmp_path / "setup.yaml"
    stated = "echelon: 1\nrobot: arm.urdf\nlog: {time: t, position: 'q{n}', output: 'tau{n}'}\n"
    setup.write_text(stated)
    log = frame(motion).drop(columns="tau1")
    result = ec.identify(setup, log)
    assert [output.name for output in result.base.mechanism.outputs] == ["elbow_joint"]
    texts = [f.text for f in result.findings if f.severity is Severity.WARNING]
    assert any(
        "no log has the column 'tau1': parameters that only the output of shoulder_joint"
        in text
        for text in texts
    )
    with pytest.raises(ec.InputError, match="'tau1'; did you mean 'tau_1'"):
        ec.identify(setup, frame(motion).rename(columns={"tau1": "tau_1"}))
    with pytest.raises(ec.InputError, match="no columns 'tau1', 'tau2'"):
        ec.identify(setup, log.drop(columns="tau2"))


def test_an_output_without_a_column_is_not_measured(
    motion: Motion, tmp_path: Path
) -> None:
    log = frame(motion).drop(columns="tau1")
    result = ec.identify(ARM, log)
    assert [output.name for output in result.base.mechanism.outputs] == ["elbow_joint"]
    assert any(
        "no measured output for shoulder_joint" in finding.text
        for finding in result.findings
    )
    (tmp_path / "arm.urdf").write_text(ARM)
    log.to_csv(tmp_path / "log.csv", index=False)
    text = skeleton(tmp_path / "arm.urdf", [tmp_path / "log.csv"], tmp_path).text
    assert "\noutputs: [{actuator: elbow_joint}]\n" in text
    (tmp_path / "setup.yaml").write_text(text)
    np.testing.assert_allclose(
        ec.identify(tmp_path / "setup.yaml", tmp_path / "log.csv").values, result.values
    )


NUMBERED = ["t", *(f"q{k}" for k in range(1, 8)), *(f"tau{k}" for k in range(1, 8))]


def test_the_joints_of_public_robots_that_rest() -> None:
    """Seven columns of position and torque, with numbers only."""
    panda = guess(NUMBERED, ec.load(robot_file("panda")))
    assert (panda.problems, panda.unlogged) == ((), ("panda_finger_joint1",))
    baxter = guess(NUMBERED, ec.load(robot_file("baxter")))
    assert [sorted({name[:5] for name in some}) for some in baxter.choices] == [
        ["head_", "l_gri", "left_", "r_gri"],
        ["head_", "l_gri", "r_gri", "right"],
    ]
    assert "those of right_s0, " in baxter.problems[0]


def test_an_arm_is_not_cut_short() -> None:
    """A log of six joints is not that of an arm with seven, none of which is a gripper."""
    names = [name for name in NUMBERED if "7" not in name]
    found = guess(names, ec.load("examples/panda.yaml"))
    assert "the log has 6 positions (numbers 1, 2, 3, 4, 5, 6)" in found.problems[0]
    assert not found.unlogged


def test_a_joint_called_alike_is_no_part_of_the_robot() -> None:
    """An elbow among columns that are called otherwise than the robot's joints says nothing of the other joints."""
    joints = ("base", "shoulder", "elbow", "wrist1", "wrist2", "wrist3")
    angles, moments = (
        [f"{name} {word}" for name in joints] for word in ("angle", "moment")
    )
    names, rng = [*angles, *moments], np.random.default_rng(1)
    robot, table = (
        ec.load(robot_file("ur5_robot")),
        Table("", dict(zip(names, rng.normal(size=(12, 50)), strict=True))),
    )
    found = guess(names, robot)
    assert found.problems
    assert not found.unlogged
    found = guess(names, robot, lambda: table, by_values=True)
    assert [channel.column for channel in found.columns.positions.values()] == angles
    assert [channel.column for channel in found.columns.outputs.values()] == moments


def test_locked_joints_are_read_in_every_form() -> None:
    held = ec.load(ARM_WITH_GRIPPER, locked={"gripper_joint": 0.02})
    assert ec.base_parameters(held).rank == ec.base_parameters(ec.load(ARM)).rank
    assert ec.load(FLOATING, locked={"free": 0}).velocities == (
        "shoulder_joint",
        "elbow_joint",
    )
    text = 'echelon: 1\nmodified_dh: [{joint: revolute}, {joint: revolute, a: "0.3"}]\nlocked: {j2: pi/2}\n'
    assert ec.load(text).velocities == ("j1",)
    with pytest.raises(ec.InputError, match="there is no coordinate 'j3' to hold"):
        ec.load(text.replace("j2:", "j3:"))


def test_a_joint_that_never_moves_is_locked_if_there_is_no_other_log(
    motion: Motion,
) -> None:
    log = frame(motion)
    log["q2"], log["tau2"] = 0.4 + 1e-4 * (motion["q"][:, 1] > 0.5), 0.1
    setup, _, _ = with_logs(ARM, log)
    assert setup.mechanism.velocities == ("shoulder_joint",)
    assert any(
        "at rest all the time: elbow_joint, as by  locked: {elbow_joint: 0.4}" in text
        for text in setup.assumed
    )
    later = pd.concat([log] * 50 + [frame(motion)], ignore_index=True)
    later["t"] = np.arange(len(later)) / 300
    for several in ([log, frame(motion)], later):
        setup, _, _ = with_logs(ARM, several)
        assert setup.mechanism.velocities == ("shoulder_joint", "elbow_joint")
