"""Unread contents of robot files: refused, listed, or ignored on request."""

from __future__ import annotations

from pathlib import Path

import pytest

import echelon as ec
from echelon.shared.errors import InputError
from support.robot_files import robot_file

ARM = """<robot name='arm'><link name='base'/>
  <link name='arm'><inertial><origin xyz='0.1 0 0'/><mass value='1'/>
    <inertia ixx='0.001' iyy='0.002' izz='0.002' ixy='0' ixz='0' iyz='0'/></inertial></link>
  <joint name='j' type='revolute'><parent link='base'/><child link='arm'/><origin xyz='0 0 1'/><axis xyz='0 1 0'/>
    <limit lower='-1' upper='1' effort='1' velocity='1'/></joint></robot>"""
SDF = """<sdf version='1.9'><model name='arm'><link name='base'/>
  <joint name='w' type='fixed'><parent>world</parent><child>base</child></joint>
  <link name='arm'><inertial><pose>0.1 0 0 0 0 0</pose><mass>1</mass></inertial></link>
  <joint name='j' type='revolute'><parent>base</parent><child>arm</child><axis><xyz>0 1 0</xyz></axis></joint>
  </model></sdf>"""


def notes(text: str, **options: object) -> tuple[str, ...]:
    reading = ec.load(text, **options).reading  # type: ignore[arg-type]
    assert reading is not None
    return tuple(
        note
        for note in reading.notes
        if note.startswith(("not read", "ignored, as asked"))
    )


REFUSED = {
    "a link": (
        ARM,
        "<inertial>",
        "<inertail/><inertial>",
        r"link 'arm': <inertail> .* did you mean 'inertial'",
    ),
    "mass in a link": (
        ARM,
        "<inertial>",
        "<mass value='1'/><inertial>",
        "link 'arm': <mass> is not read",
    ),
    "a joint": (
        ARM,
        "<axis",
        "<pitch value='1'/><axis",
        "joint 'j': <pitch> is not read.*<parent>, <child>",
    ),
    "a joint's attribute": (
        ARM,
        "type='revolute'",
        "type='revolute' axis2='x'",
        "joint 'j': the attribute 'axis2'",
    ),
    "an origin": (
        ARM,
        "<origin xyz='0 0 1'/>",
        "<origin quat='1 0 0 0'/>",
        "joint 'j' origin: the attribute 'quat'",
    ),
    "an inertial's origin": (
        ARM,
        "<origin xyz='0.1",
        "<origin quat='1 0 0 0' xyz='0.1",
        "link 'arm' inertial origin",
    ),
    "an axis": (
        ARM,
        "<axis",
        "<axis expressed_in='base'",
        "joint 'j' axis: the attribute 'expressed_in'",
    ),
    "a mass": (
        ARM,
        "value='1'",
        "value='1' scale='2'",
        "link 'arm' inertial mass: the attribute 'scale'",
    ),
    "a robot": (
        ARM,
        "<link name='base'/>",
        "<spring/><link name='base'/>",
        "robot 'arm': <spring> is not read",
    ),
    "a robot's attribute": (
        ARM,
        "name='arm'>",
        "name='arm' scale='2'>",
        "robot 'arm': the attribute 'scale'",
    ),
    "an SDF link": (
        SDF,
        "<link name='base'/>",
        "<link name='base'><mass>1</mass></link>",
        "link 'base': <mass> is not",
    ),
    "an SDF joint": (SDF, "<axis>", "<gear/><axis>", "joint 'j': <gear> is not read"),
    "an SDF axis": (
        SDF,
        "<xyz>",
        "<xyz frame='base'>",
        "joint 'j' axis xyz: the attribute 'frame'",
    ),
    "an SDF model": (
        SDF,
        "<link name='base'/>",
        "<drake:joint/><link name='base'/>",
        "model 'arm': <drake:joint>",
    ),
    "an SDF pose": (
        SDF,
        "<pose>",
        "<pose frame='base'>",
        "link 'arm' inertial pose: the attribute 'frame'",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_may_change_the_dynamics_is_refused(case: str) -> None:
    text, old, new, problem = REFUSED[case]
    with pytest.raises(InputError, match=f"{problem}.*") as caught:
        ec.load(text.replace(old, new, 1))
    assert "may change how the robot moves" in str(caught.value)
    assert "--ignore" in str(caught.value)


LISTED = {
    "vendors": (
        ARM, "<link name='base'/>", "<link name='base' type='x'><self_filter/></link>", "link@type, link/self_filter",
    ),
    "dynamics": (ARM, "<axis", "<dynamics damping='1' D='1' K='2'/><axis", "dynamics@D, dynamics@K"),
    "limits": (ARM, "effort='1'", "effort='1' current='2'", "limit@current"),
    "Gazebo": (ARM, "<link name='base'/>", "<gazebo><odd/><odd/></gazebo><link name='base'/>", "gazebo/odd (2 times)"),
    "mimics of Gazebo": (
        ARM, "<link name='base'/>", "<gazebo><plugin><mimicJoint>j</mimicJoint></plugin></gazebo><link name='base'/>",
        "plugin/mimicJoint",
    ),
    "second elements": (ARM, "<parent link='base'/>", "<parent link='base'/>" * 2, "joint/parent after the first"),
    "springs of SDF": (
        SDF, "</xyz>", "</xyz><dynamics><spring_stiffness>1</spring_stiffness></dynamics>", "dynamics/spring_stiffness",
    ),
    "plugins of SDF": (SDF, "<link name='base'/>", "<plugin name='p'/><link name='base'/>", "model/plugin"),
}  # fmt: skip


@pytest.mark.parametrize("case", LISTED)
def test_what_else_is_not_read_is_listed_once(case: str) -> None:
    text, old, new, listed = LISTED[case]
    assert notes(text.replace(old, new, 1)) == (f"not read: {listed}",)
    assert ec.base_structure(ec.load(text.replace(old, new, 1))).rank == 3


QUIET = {
    "usual parts": (
        ARM, "</robot>",
        "<material name='m'/><transmission name='t'><type>x</type><joint name='j'/></transmission><ros2_control/>"
        "<gazebo reference='arm'><mu1>1</mu1><kp>2</kp><material>x</material></gazebo></robot>",
    ),
    "controllers": (ARM, "<axis", "<safety_controller k_velocity='1'/><calibration rising='0'/><axis"),
    "prefixes that nobody declares": (ARM, "effort='1'", "effort='1' drake:acceleration='20'"),
    "comments with hyphens": (ARM, "<link name='base'/>", "<!-- -- a --- b ---><link name='base'/>"),
    "namespaces": (ARM, "<robot ", "<robot xmlns='http://www.ros.org' xmlns:x='y' "),
    "grippers": (SDF, "<link name='base'/>", "<gripper><palm_link>base</palm_link></gripper><link name='base'/>"),
    "empty attributes": (SDF, "<pose>", "<pose frame=''>"),
}  # fmt: skip


@pytest.mark.parametrize("case", QUIET)
def test_what_says_nothing_about_motions_is_passed_over(case: str) -> None:
    text, old, new = QUIET[case]
    changed = text.replace(old, new, 1)
    assert changed != text
    assert notes(changed) == ()
    assert ec.base_structure(ec.load(changed)).rank == 3


# -- on request --------------------------------------------------------------------------------------------------------

STRANGE = ARM.replace("<link name='base'/>", "<spring/><link name='base'/>").replace(
    "<axis", "<axis twist='1'"
)


@pytest.mark.parametrize(
    "names", [("spring", "@twist"), ("robot/spring", "axis@twist")]
)
def test_what_a_user_ignores_counts_as_if_it_were_not_there(
    names: tuple[str, ...],
) -> None:
    assert notes(STRANGE, ignore=names) == (f"ignored, as asked: {', '.join(names)}",)
    assert ec.load(STRANGE, ignore=names).bodies == ec.load(ARM).bodies


def test_a_description_ignores_parts_of_its_file(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(STRANGE)
    (tmp_path / "arm.yaml").write_text(
        "echelon: 1\nrobot: {file: arm.urdf, ignore: [spring, axis@twist]}\n"
    )
    mechanism = ec.load(tmp_path / "arm.yaml")
    assert mechanism.bodies == ec.load(ARM).bodies
    assert mechanism.reading is not None
    assert "ignored, as asked: spring, axis@twist" in mechanism.reading.notes


def test_joints_and_constraints_of_mjcf_are_ignored_too() -> None:
    body = "<body name='b'><joint name='j' axis='0 1 0'/><geom size='.1'/></body>"
    held = "<equality><joint joint1='j' polycoef='0.5 0 0 0 0'/></equality>"
    text = f"<mujoco><worldbody>{body}</worldbody>{held}</mujoco>"
    assert [
        ec.load(text, ignore=names).degrees_of_freedom for names in ((), ("equality",))
    ] == [0, 1]


def test_a_name_to_ignore_that_is_not_there_is_an_error() -> None:
    with pytest.raises(
        InputError,
        match="it has no 'sprnig' that could be ignored; did you mean 'spring'",
    ):
        ec.load(STRANGE, ignore=["sprnig"])
    with pytest.raises(InputError, match="it has no 'spring' that could be ignored"):
        ec.load(
            "echelon: 1\nname: a\nbodies: [{name: b, joint: {type: revolute, axis: z}}]",
            ignore=["spring"],
        )


def test_mjcf_names_forces_that_base_parameters_do_not_cover() -> None:
    text = """<mujoco><option density='1.2'/><worldbody><site name='w'/><body name='b'><joint name='j'/>
      <geom size='.1' mass='1'/><site name='t' pos='0 0 .1'/></body></worldbody>
      <tendon><spatial name='t' range='0 1'><site site='w'/><site site='t'/></spatial></tendon>
      <actuator><motor tendon='t'/></actuator></mujoco>"""
    reading = ec.load(text).reading
    assert reading is not None
    kinds = "limits of tendons, drag of a fluid, actuators that act through tendons, sites or bodies"
    assert (
        f"ignored, since rigid-body parameters do not cover them: {kinds}"
        in reading.notes
    )


@pytest.mark.parametrize(
    ("name", "listed"),
    [
        ("panda", "not read: dynamics@D (7 times), dynamics@K (7 times)"),
        ("ur10_robot", ""),
        ("so101", "not read: link/origin"),
    ],
)
def test_files_of_vendors_are_read_as_ever(name: str, listed: str) -> None:
    found = ec.load(robot_file(name)).reading
    assert found is not None
    assert (
        any(note.startswith(listed) for note in found.notes)
        if listed
        else "not read" not in " ".join(found.notes)
    )
