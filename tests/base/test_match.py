"""One robot in two descriptions: frames, standard and base parameters, one from the other."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import echelon as ec
from support.float_regressor import random_states
from support.paths import EXAMPLES
from support.robot_files import robot_file

TURNED = """
echelon: 1
name: turned
symbols: {D3: 0.45, RL4: 0.45}
standard_dh:
  - {joint: revolute, alpha: pi/2}
  - {joint: revolute, a: D3}
  - {joint: revolute, alpha: -pi/2}
  - {joint: revolute, d: RL4, alpha: pi/2}
  - {joint: revolute, alpha: -pi/2}
  - {joint: revolute}
"""


def described(tmp_path: Path, text: str, name: str = "robot.yaml") -> ec.Mechanism:
    file = tmp_path / name
    file.write_text(text)
    return ec.load(file)


def check_torques(matched: ec.Match) -> None:
    """The same motion of the same bodies needs the same torques, whatever the description."""
    first, second = matched.first, matched.second
    q, qd, qdd = random_states(first.mechanism, 5)
    joints = sorted(matched.alignment.bodies, key=lambda body: body.second)
    order = [body.first for body in joints]
    sign = np.array([body.sign for body in joints])
    offset = np.array([body.offset for body in joints])
    theirs = [sign * part[:, order] for part in (q, qd, qdd)]
    theirs[0] = theirs[0] + offset
    standard = np.random.default_rng(1).uniform(-1, 1, len(first.parameters))
    expected = sign * (first.standard_regressor(q, qd, qdd) @ standard)[:, order]
    moved = matched.standard(standard)
    np.testing.assert_allclose(second.standard_regressor(*theirs) @ moved, expected, atol=1e-7)
    base = matched.base(first.values(standard))
    np.testing.assert_allclose(second.values(moved), base, atol=1e-9)
    np.testing.assert_allclose(second.regressor(*theirs) @ base, expected, atol=1e-7)


def test_ur10_in_standard_dh_and_urdf() -> None:
    table, urdf = ec.load(EXAMPLES / "ur10.yaml"), ec.load(robot_file("ur10_robot"))
    matched = ec.match(table, urdf)
    assert matched.exact
    assert len(matched.rows) == 36
    # the manufacturer's base frame is turned by half a turn against the URDF's base_link
    assert [round(body.offset / math.pi, 12) for body in matched.alignment.bodies] == [1, 0, 0, 0, 0, 0]
    assert str(matched).splitlines()[1] == "  1  [ZZ1]' = [YY1] + [XX2] + [XX3]"
    check_torques(matched)
    back = ec.match(urdf, table)
    np.testing.assert_allclose(back.base_map @ matched.base_map, np.eye(36), atol=1e-12)


def test_panda_in_modified_dh_and_urdf(tmp_path: Path) -> None:
    arm = robot_file("panda").read_text().replace('type="prismatic"', 'type="fixed"')
    matched = ec.match(ec.load(EXAMPLES / "panda.yaml"), described(tmp_path, arm, "arm.urdf"))
    assert matched.exact
    assert np.array_equal(matched.base_map, np.eye(43))  # the URDF's frames are those of the table
    check_torques(matched)


def test_a_hand_makes_another_robot() -> None:
    with pytest.raises(ec.InputError, match=r"'panda_link7' carries 2 moving bodies|carries 0 moving bodies"):
        ec.match(ec.load(EXAMPLES / "panda.yaml"), ec.load(robot_file("panda")))


def test_rx90_in_both_dh_conventions(tmp_path: Path) -> None:
    matched = ec.match(ec.load(EXAMPLES / "rx90.yaml"), described(tmp_path, TURNED))
    assert matched.exact
    check_torques(matched)


def test_geometry_that_differs_is_named(tmp_path: Path) -> None:
    robot = ec.load(EXAMPLES / "rx90.yaml")
    longer = described(tmp_path, (EXAMPLES / "rx90.yaml").read_text().replace("RL4: 0.45", "RL4: 0.46"))
    with pytest.raises(
        ec.InputError, match=r"joints 'j5' and 'j5': the geometry differs: their axes are 0\.01 m apart"
    ):
        ec.match(robot, longer)
    twisted = described(tmp_path, (EXAMPLES / "rx90.yaml").read_text().replace("a: D3", "a: D3, alpha: pi/6"))
    with pytest.raises(ec.InputError, match=r"joints 'j3' and 'j3': the geometry differs: their axes are 30° apart"):
        ec.match(robot, twisted)
    floating = described(tmp_path, (EXAMPLES / "rx90.yaml").read_text() + "gravity: [0, 9.81, 0]\n")
    with pytest.raises(ec.InputError, match="gravity has another direction"):
        ec.match(robot, floating)
    with pytest.raises(ec.InputError, match="only revolute and prismatic joints can be matched"):
        ec.match(ec.load(EXAMPLES / "floating_tree.yaml"), ec.load(EXAMPLES / "floating_tree.yaml"))


def test_prismatic_joints_and_other_signs(tmp_path: Path) -> None:
    text = (EXAMPLES / "stanford.yaml").read_text()
    robot = described(tmp_path, text.replace("d2: null", "d2: 0.154"))
    matched = ec.match(robot, robot)
    assert np.array_equal(matched.base_map, np.eye(robot_rank := matched.first.rank))
    assert robot_rank == 33
    check_torques(matched)
    limit = "<limit lower='-1' upper='1' effort='1' velocity='1'/>"
    pendulum = f"""<robot name="{{name}}"><link name="base"/><link name="a"/><link name="b"/>
      <joint name="one" type="revolute"><parent link="base"/><child link="a"/>{limit}
        <origin xyz="0 0 {{height}}"/><axis xyz="0 {{first}} 0"/></joint>
      <joint name="two" type="prismatic"><parent link="a"/><child link="b"/>{limit}
        <origin xyz="{{x}} 0 {{z}}"/><axis xyz="0 0 {{second}}"/></joint></robot>"""
    one = described(tmp_path, pendulum.format(name="one", height=0, first=1, second=1, x=0.5, z=0), "one.urdf")
    two = described(tmp_path, pendulum.format(name="two", height=2, first=-1, second=-1, x=0.5, z=1), "two.urdf")
    matched = ec.match(one, two)
    assert [body.sign for body in matched.alignment.bodies] == [-1, -1]
    check_torques(matched)


def test_values_are_needed(tmp_path: Path) -> None:
    text = (EXAMPLES / "rx90.yaml").read_text()
    robot = described(tmp_path, text)
    assert repr(ec.match(ec.base_parameters(robot), robot)) == "Match(rx90 = rx90: 36 base parameters)"
    silent = described(tmp_path, text.replace("{D3: 0.45, RL4: 0.45}", "{D3: null, RL4: null}"), "silent.yaml")
    with pytest.raises(ec.InputError, match="symbol 'D3' of rx90 has no value"):
        ec.match(silent, robot)
