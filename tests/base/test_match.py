"""One robot in two descriptions: frames, standard and base parameters, one from the other."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import echelon as ec
from support.paths import ROOT
from support.posed_urdf import Axes, Description
from support.robot_files import robot_file
from support.selection import one_in

EXAMPLES = ROOT / "examples"


def described(folder: Path, text: str, name: str = "robot.yaml") -> ec.Mechanism:
    file = folder / name
    file.write_text(text)
    return ec.load(file)


def check_torques(matched: ec.Match) -> None:
    """Equal motions of equal bodies need equal torques, whatever the description."""
    rng, order = np.random.default_rng(0), list(matched.order)
    q, qd, qdd = rng.uniform(-1.5, 1.5, (3, 5, len(order)))
    theirs = [matched.sign * part[:, order] for part in (q, qd, qdd)]
    theirs[0] += matched.offset
    standard = rng.uniform(-1, 1, len(matched.first.parameters))
    expected = (
        matched.sign
        * (matched.first.standard_regressor(q, qd, qdd) @ standard)[:, order]
    )
    moved, base = (
        matched.standard_map @ standard,
        matched.base_map @ matched.first.values(standard),
    )
    np.testing.assert_allclose(
        matched.second.standard_regressor(*theirs) @ moved, expected, atol=1e-9
    )
    np.testing.assert_allclose(
        matched.second.regressor(*theirs) @ base, expected, atol=1e-9
    )


@pytest.mark.slow
def test_ur10_in_standard_dh_and_urdf() -> None:
    table, urdf = ec.load(EXAMPLES / "ur10.yaml"), ec.load(robot_file("ur10_robot"))
    matched = ec.match(table, urdf)
    # the manufacturer's base frame is turned by half a turn against the URDF's base_link
    assert (matched.offset / math.pi).round(12).tolist() == [1, 0, 0, 0, 0, 0]
    assert str(matched).splitlines()[1] == "  1  [ZZ1]' = [YY1] + [XX2] + [XX3]"
    check_torques(matched)
    back = ec.match(urdf, table)
    np.testing.assert_allclose(back.base_map @ matched.base_map, np.eye(36), atol=1e-12)


@pytest.mark.slow
def test_panda_in_modified_dh_and_urdf(tmp_path: Path) -> None:
    arm = robot_file("panda").read_text().replace('type="prismatic"', 'type="fixed"')
    matched = ec.match(
        ec.load(EXAMPLES / "panda.yaml"), described(tmp_path, arm, "arm.urdf")
    )
    np.testing.assert_allclose(
        matched.base_map, np.eye(43), atol=1e-12
    )  # the URDF's frames are those of the table


def test_other_parameters_of_a_tree_by_those_of_its_mirrored_zero_pose(
    tmp_path: Path,
) -> None:
    """Signs, offsets and order of coordinates, axes at right angles, slides, and a branch."""
    limit = "<limit lower='-1' upper='1' effort='1' velocity='1'/>"
    text = f"""<robot name="{{name}}"><link name="o"/><link name="a"/><link name="b"/><link name="c"/><link name="d"/>
      <joint name="one" type="revolute"><parent link="o"/><child link="a"/>{limit}
        <origin xyz="0 0 {{height}}"/><axis xyz="0 {{first}} 0"/></joint>
      <joint name="two" type="prismatic"><parent link="a"/><child link="b"/>{limit}
        <origin xyz="{{x}}"/><axis xyz="0 0 {{second}}"/></joint>
      <joint name="three" type="revolute"><parent link="b"/><child link="c"/>{limit}
        <origin xyz="0.2 0 {{z}}"/><axis xyz="{{third}} 0 0"/></joint>
      <joint name="four" type="revolute"><parent link="a"/><child link="d"/>{limit}
        <origin xyz="0 0.3 -0.4"/><axis xyz="0 0.6 0.8"/></joint></robot>"""
    plain = {
        "name": "plain",
        "height": 0,
        "first": 1,
        "second": 1,
        "third": 1,
        "x": "0.5 0 0",
        "z": 0,
    }
    turned = {
        "name": "turned",
        "height": 2,
        "first": -1,
        "second": -1,
        "third": -1,
        "x": "0.5 0 1",
        "z": 0.25,
    }
    one, two = (
        described(tmp_path, text.format(**v), f"{v['name']}.urdf")
        for v in (plain, turned)
    )
    matched = ec.match(one, two)
    assert matched.sign.tolist() == [-1, -1, -1, 1]
    check_torques(matched)


def test_a_coaxial_joint_before_its_sibling(tmp_path: Path) -> None:
    """The first child leaves its parent's angle open, and the second one tells it."""
    text = """<robot name="{name}"><link name="o"/><link name="a"/><link name="b"/><link name="c"/>
      <joint name="one" type="continuous"><parent link="o"/><child link="a"/><axis xyz="0 0 1"/></joint>
      <joint name="two" type="continuous"><parent link="a"/><child link="b"/>
        <origin xyz="0 0 0.4" rpy="0 0 {turn}"/><axis xyz="0 0 1"/></joint>
      <joint name="three" type="continuous"><parent link="a"/><child link="c"/>
        <origin xyz="{x} {y} 0" rpy="0 0 {turn}"/><axis xyz="1 0 0"/></joint></robot>"""
    c, s = math.cos(0.5), math.sin(0.5)
    zero = {
        "plain": (0, 0.2, 0.1),
        "turned": (-0.5, 0.2 * c + 0.1 * s, 0.1 * c - 0.2 * s),
    }
    one, two = (
        described(tmp_path, text.format(name=name, turn=turn, x=x, y=y), f"{name}.urdf")
        for name, (turn, x, y) in zero.items()
    )
    matched = ec.match(one, two)
    np.testing.assert_allclose(matched.offset, [0.5, 0, 0], atol=1e-9)
    check_torques(matched)


@pytest.mark.parametrize("seed", one_in(6, range(36)))
def test_any_zeros_directions_and_bases(seed: int) -> None:
    """One set of axes, described twice: equal motions need equal torques."""
    rng = np.random.default_rng(seed)
    axes = Axes.random(rng, oblique=seed % 2 == 0)
    n = len(axes.parents)
    base = np.eye(4)
    if seed % 3:
        base[:3, :3] = Rotation.from_rotvec([0, 0, rng.uniform(-3, 3)]).as_matrix()
        base[:3, 3] = rng.uniform(-1, 1, 3)
    zeros = {k: float(rng.uniform(-1, 1)) for k in range(n) if rng.random() < 0.7}
    turned = frozenset(k for k in range(n) if rng.random() < 0.5)
    descriptions = Description(axes), Description(axes, zeros, turned, base)
    robots = [ec.load(d.urdf(), snap_tolerance=0) for d in descriptions]
    check_torques(ec.match(*robots))


def test_what_differs_is_named(tmp_path: Path) -> None:
    text = (EXAMPLES / "rx90.yaml").read_text()
    robot = described(tmp_path, text)
    differences = {
        "joints 'j5' and 'j5': the geometry differs: their axes are 0.01 m apart": text.replace(
            "0.45}", "0.46}"
        ),
        "joints 'j3' and 'j3': the geometry differs: their axes are 30° apart": text.replace(
            "a: D3", "a: D3, alpha: pi/6"
        ),
        "gravity has another direction": text + "gravity: [0, 9.81, 0]\n",
        "couplings, loops and effects cannot be matched": text + "effects: [viscous]\n",
        "symbol 'D3' has no value": text.replace(
            "{D3: 0.45, RL4: 0.45}", "{D3: null, RL4: null}"
        ),
        "'j6' carries 0 moving bodies, its counterpart 'j6' 1": text.rstrip()
        + "\n  - {joint: revolute}\n",
    }
    for problem, changed in differences.items():
        with pytest.raises(ec.InputError, match=problem):
            ec.match(robot, described(tmp_path, changed))
    with pytest.raises(
        ec.InputError, match="only revolute and prismatic joints can be matched"
    ):
        ec.match(robot, ec.load(EXAMPLES / "floating_tree.yaml"))


def test_bases_at_an_oblique_angle(tmp_path: Path) -> None:
    """A first axis that is tilted by no right angle is laid over its counterpart, and gravity with it."""
    tilted = """
echelon: 1
name: tilted
symbols: {g: 9.81}
gravity: [0, g*sin(0.3), -g*cos(0.3)]
modified_dh:
  - {joint: revolute, alpha: 0.3, d: 0.2}
  - {joint: revolute, alpha: pi/2, a: 0.4}
  - {joint: revolute, a: 0.3, alpha: 0.5}
"""
    upright = tilted.replace("0, g*sin(0.3), -g*cos(0.3)", "0, 0, -g")
    upright = upright.replace("alpha: 0.3,", "alpha: 0.6,")
    upright = upright.replace("0, 0, -g", "0, g*sin(0.6), -g*cos(0.6)")
    found = ec.match(
        described(tmp_path, tilted), described(tmp_path, upright, "upright.yaml")
    )
    check_torques(found)
