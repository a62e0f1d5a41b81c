"""Robots that are not files: models of other libraries, names of packages, texts, xacro."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pinocchio
import pytest

import echelon as ec
from echelon.formats.robot_file import open_robot
from echelon.formats.snapping import ReadingOptions
from echelon.shared.errors import InputError
from support.float_regressor import float_regressor, random_states, standard_vector
from support.paths import EXAMPLES
from support.robot_files import robot_file

MACROS = """<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:macro name="link" params="name mass">
<link name="${name}"><inertial><origin xyz="${mass/20} 0 0"/><mass value="${mass}"/>
<inertia ixx="${mass/10}" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link></xacro:macro></robot>"""
ARM = """<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arg name="heavy" default="2"/>
<xacro:include filename="$(find arm_description)/urdf/macros.xacro"/><xacro:include filename="macros.xacro"/>
<xacro:link name="a" mass="1"/><xacro:link name="b" mass="$(arg heavy)"/>
<joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 ${2 - 1} 0"/></joint></robot>"""


def same_dynamics(robot: ec.Mechanism, other: ec.Mechanism) -> None:
    """Both have one rank, and their own values predict one torque."""
    bases = [ec.base_parameters(some) for some in (robot, other)]
    assert bases[0].rank == bases[1].rank
    q, qd, qdd = random_states(robot, 5)
    torques = [
        base.predict(q, qd, qdd, base.values(base.mechanism.standard_values()))
        for base in bases
    ]
    np.testing.assert_allclose(torques[0], torques[1], rtol=1e-9, atol=1e-9)


def test_models_of_mujoco_mean_what_their_file_means() -> None:
    path = EXAMPLES / "two_link.xml"
    spec = mujoco.MjSpec.from_file(str(path))
    for robot in (spec, spec.copy().compile(), path.read_text()):
        same_dynamics(ec.load(robot), ec.load(path))


def test_a_compiled_loop_keeps_its_equalities() -> None:
    text = """<mujoco><option gravity="0 0 -9.81"/><worldbody><body name="a"><joint name="j1" axis="0 1 0"/>
      <inertial pos="0.1 0 0" mass="1" diaginertia="0.1 0.1 0.1"/><body name="b" pos="0.4 0 0">
      <joint name="j2" axis="0 1 0"/><inertial pos="0.1 0 0" mass="1" diaginertia="0.1 0.1 0.1"/></body></body>
      </worldbody><equality><joint joint1="j2" joint2="j1" polycoef="0 -1 0 0 0"/></equality></mujoco>"""
    assert ec.load(mujoco.MjModel.from_xml_string(text)).degrees_of_freedom == 1


def test_a_compiled_loop_between_sites_is_that_of_its_file() -> None:
    mass = '<inertial pos="0.1 0 0" mass="1" diaginertia="0.1 0.1 0.1"/>'
    text = f"""<mujoco><worldbody><site name="w" pos="0.7 0 0"/><body><joint name="j1" axis="0 1 0"/>{mass}
      <body pos="0 0 0.4"><joint name="j2" axis="0 1 0"/>{mass}<body pos="0.6 0 0.1"><joint name="j3" axis="0 1 0"/>
      {mass}<site pos="0.1 0 -0.5" name="s"/></body></body></body></worldbody>
      <equality><connect name="c" site1="s" site2="w"/></equality></mujoco>"""
    found, stated = (
        ec.load(robot) for robot in (mujoco.MjModel.from_xml_string(text), text)
    )
    assert found.degrees_of_freedom == 1
    assert found.closures == stated.closures


DRIVEN = """<mujoco><option><flag gravity="disable"/></option><worldbody>
  <body name="a"><joint name="j1" axis="0 1 0"/><inertial pos="0.1 0 0" mass="1" diaginertia="0.1 0.1 0.1"/>
  <body name="b" pos="0.4 0 0"><joint name="j2" axis="0 1 0"/>
  <inertial pos="0.1 0 0" mass="1" diaginertia="0.1 0.1 0.1"/><site name="s" pos="0 0.1 0"/><body pos="0 0 0.3">
  <joint name="ball" type="ball"/><inertial pos="0.1 0 0" mass="1" diaginertia="0.1 0.1 0.1"/></body></body></body>
  </worldbody><tendon><fixed name="t"><joint joint="j1" coef="2"/><joint joint="j2" coef="-1"/></fixed></tendon>
  <equality><tendon tendon1="t"/><joint joint1="j1" active="false"/></equality>
  <actuator><motor name="m" joint="j2" gear="5"/><motor name="n" joint="ball" gear="0 0 2"/></actuator>
  <sensor><actuatorfrc name="one" actuator="m"/><torque site="s"/><actuatorfrc actuator="n"/></sensor></mujoco>"""


@pytest.mark.parametrize("off", ["gravity", "equality", "constraint"])
def test_flags_drives_and_sensors_count_in_files_and_models(off: str) -> None:
    text = DRIVEN.replace("gravity=", f"{off}=")
    robots = [
        ec.load(robot, measured="file")
        for robot in (text, mujoco.MjModel.from_xml_string(text))
    ]
    assert robots[0].velocities == robots[1].velocities
    assert [robot.degrees_of_freedom for robot in robots] == [
        4 if off == "gravity" else 5
    ] * 2
    assert [output.name for output in robots[1].outputs] == [
        "s.tx",
        "s.ty",
        "s.tz",
        "one",
    ]
    assert robots[0].outputs == robots[1].outputs
    assert {robot.gravity is None for robot in robots} == {off == "gravity"}
    same_dynamics(*robots)


def test_gravity_armatures_and_bare_inertias_of_pinocchio_count() -> None:
    model = pinocchio.buildSampleModelManipulator()
    model.gravity.linear = np.array([1.0, 2.0, -3.0])
    model.inertias[3] = pinocchio.Inertia(0.0, np.zeros(3), np.diag([0.1, 0.2, 0.3]))
    model.armature[1] = 0.5
    robot = ec.load(model, snap_tolerance=0)
    q, qd, qdd = np.random.default_rng(1).normal(size=(3, 4, model.nv))
    usual = open_robot(model).mechanism(ReadingOptions(usual_effects=True))
    assert [
        effect.value for effect in usual.effects if effect.parameter.startswith("Ia")
    ] == [0.5]
    model.armature[1] = 0.0
    expected = [
        pinocchio.rnea(model, model.createData(), *state)
        for state in zip(q, qd, qdd, strict=True)
    ]
    found = float_regressor(robot, q, qd, qdd) @ standard_vector(robot)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("name", "floating"), [("ur10_robot", False), ("kinova", False), ("solo12", True)]
)
def test_a_model_of_pinocchio_is_the_urdf_it_was_read_from(
    name: str, floating: bool
) -> None:
    path = robot_file(name)
    root = [pinocchio.JointModelFreeFlyer()] if floating else []
    found = ec.load(pinocchio.buildModelFromUrdf(str(path), *root), symbolic=False)
    own = ec.load(path, symbolic=False, floating=floating)
    assert ec.base_structure(found).rank == ec.base_structure(own).rank
    if not floating:
        same_dynamics(found, own)


def test_pinocchio_joints_about_any_axis_are_read() -> None:
    """Pinocchio does not say the axis of one that turns without end."""
    text = "<robot name='r'><link name='a'/>" + "".join(
        f"""<link name='{child}'><inertial><origin xyz='0.1 0.2 0'/><mass value='1'/>
        <inertia ixx='0.1' ixy='0' ixz='0' iyy='0.2' iyz='0' izz='0.2'/></inertial></link>
        <joint name='{kind}' type='{kind}'><parent link='{parent}'/><child link='{child}'/><axis xyz='1 2 -3'/>
        <origin xyz='0.3 0 0'/><limit lower='-1' upper='1' velocity='1' effort='1'/></joint>"""
        for parent, child, kind in (
            ("a", "b", "continuous"),
            ("b", "c", "prismatic"),
            ("c", "d", "revolute"),
        )
    )
    robots = (
        ec.load(pinocchio.buildModelFromXML(text + "</robot>"), snap_tolerance=0),
        ec.load(text + "</robot>", snap_tolerance=0),
    )
    same_dynamics(*robots)


SIBLINGS = {
    "by package.xml": ("parts_folder", "<package><name>parts</name></package>"),
    "by folder": ("parts", ""),
}


@pytest.mark.parametrize("case", SIBLINGS)
def test_packages_beside_that_of_a_xacro_file_are_found(
    case: str, tmp_path: Path
) -> None:
    """Where the robot's own package has folders within folders, as vendors of many robots have."""
    folder, package = SIBLINGS[case]
    (tmp_path / "robots" / "six" / "urdf" / "v2").mkdir(parents=True)
    (tmp_path / folder / "urdf").mkdir(parents=True)
    if package:
        (tmp_path / folder / "package.xml").write_text(package)
    (tmp_path / folder / "urdf" / "macros.xacro").write_text(MACROS)
    file = tmp_path / "robots" / "six" / "urdf" / "v2" / "arm.urdf.xacro"
    include = '<xacro:include filename="$(find parts)/urdf/macros.xacro"/>'
    file.write_text(
        ARM[: ARM.index("<xacro:include")] + include + ARM[ARM.index("<xacro:link") :]
    )
    assert ec.load(file).degrees_of_freedom == 1
    file.write_text(file.read_text().replace("$(find parts)", "$(find nowhere)"))
    with pytest.raises(InputError, match="Package not found: nowhere"):
        ec.load(file)


def test_xacro_is_expanded(tmp_path: Path) -> None:
    folder = tmp_path / "arm_description" / "urdf"
    folder.mkdir(parents=True)
    (folder.parent / "package.xml").write_text(
        "<package><name>arm_description</name></package>"
    )
    (folder / "macros.xacro").write_text(MACROS)
    (folder / "arm.urdf.xacro").write_text(ARM)
    robot = ec.load(folder / "arm.urdf.xacro")
    assert robot.bodies[0].inertial is not None
    assert float(robot.bodies[0].inertial[9]) == 2.0
    assert float(robot.bodies[0].inertial[6]) == pytest.approx(0.2)
    (folder / "macros.xacro").unlink()
    with pytest.raises(
        ec.InputError, match=r"arm.urdf.xacro: xacro cannot expand it: .*macros.xacro"
    ):
        ec.load(folder / "arm.urdf.xacro")


def test_names_of_robot_descriptions_are_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The package fetches from the network once; here its cache holds the file already."""
    folder = (
        tmp_path
        / "mujoco_menagerie-HEAD"
        / "mujoco_menagerie"
        / "universal_robots_ur5e"
    )
    folder.mkdir(parents=True)
    (folder / "ur5e.xml").write_text((EXAMPLES / "two_link.xml").read_text())
    me = {
        "GIT_AUTHOR_NAME": "a",
        "GIT_AUTHOR_EMAIL": "a@b",
        "GIT_COMMITTER_NAME": "a",
        "GIT_COMMITTER_EMAIL": "a@b",
    }
    for command in ("init -q", "add .", "commit -q -m all"):
        subprocess.run(
            ["git", *command.split()],
            cwd=folder.parent,
            check=True,
            env={**os.environ, **me},
        )
    monkeypatch.setenv("ROBOT_DESCRIPTIONS_CACHE", str(tmp_path))
    monkeypatch.setenv("ROBOT_DESCRIPTION_COMMIT", "HEAD")
    assert ec.load("ur5e_mj_description").name == "two_link"
    with pytest.raises(
        ec.InputError,
        match="has no 'pand_description'; did you mean 'panda_description'",
    ):
        ec.load("pand_description")


def test_what_is_no_robot_is_refused() -> None:
    with pytest.raises(ec.InputError, match=r"expected a path, .* found builtins.int"):
        ec.load(3)


def test_a_mechanism_has_a_short_repr() -> None:
    assert (
        repr(ec.load(EXAMPLES / "panda.yaml"))
        == "Mechanism(panda: 7 bodies, 7 degrees of freedom)"
    )


@pytest.mark.parametrize("name", ["double_pendulum.yaml", "so101.urdf"])
def test_robots_without_loops_load_without_the_room_of_loops(name: str) -> None:
    script = "import sys, echelon; echelon.load(sys.argv[1]); print([m for m in sys.modules if 'echelon.loops' in m])"
    done = subprocess.run(
        [sys.executable, "-c", script, EXAMPLES / name],
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.strip() == "[]"
