"""Written URDF files against Pinocchio, which reads them, and against the files they come from."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import echelon as ec
from echelon.formats.robot_file import RobotFile, open_robot
from echelon.formats.snapping import ReadingOptions
from echelon.formats.writers.identified_values import sorted_values
from echelon.formats.writers.robot_writer import WrittenRobot, identified_robot
from echelon.formats.writers.urdf_writer import UrdfGenerator
from echelon.robot.mechanism import Mechanism
from echelon.shared.errors import InputError
from support.float_regressor import float_regressor, random_states
from support.robot_files import robot_file
from support.selection import slow_unless
from support.written_robots import (
    EXACT,
    assert_near,
    geometry,
    pinocchio_efforts,
    random_parameters,
    reread,
    solid,
    standard,
)

URDFS = [
    *[
        (name, False)
        for name in (
            "ur10_robot",
            "panda",
            "kinova",
            "tiago",
            "xarm7",
            "pr2",
            "z1",
            "so100",
        )
    ],
    *[
        (name, True)
        for name in ("a1", "romeo", "talos_full_v2", "anymal", "solo12", "icub")
    ],
]


LARGE = {"tiago", "pr2", "romeo", "talos_full_v2", "icub"}


@pytest.mark.parametrize(
    ("name", "floating"), slow_unless(lambda case: case[0] not in LARGE, URDFS)
)
def test_written_urdf_in_pinocchio_and_read_again(name: str, floating: bool) -> None:
    file = robot_file(name)
    options = replace(EXACT, floating=floating)
    mechanism = ec.load(
        file, snap_tolerance=0, floating=floating, independent_mimics=True
    )
    values = random_parameters(mechanism)
    (written,) = identified_robot(mechanism, values, open_robot(file))
    again = reread(written, options)
    assert geometry(again) == geometry(mechanism)
    assert_near(standard(again), values, 1e-14)
    states = random_states(mechanism, 2)
    found = pinocchio_efforts(mechanism, written.text, states, floating)
    assert_near(found, float_regressor(mechanism, *states) @ values, 1e-12)


def test_geometry_that_was_read_as_exact_stays_as_written_and_is_mentioned() -> None:
    file = robot_file("so100")
    mechanism = ec.load(file)
    values = random_parameters(mechanism)
    (written,) = identified_robot(mechanism, values, open_robot(file))
    again = reread(written, ReadingOptions())
    assert geometry(again) == geometry(mechanism)
    assert_near(standard(again), values, 1e-14)
    assert any("took them as exact" in note for note in written.notes)


def test_kept_fixed_links_have_their_own_inertial() -> None:
    file = robot_file("panda")
    mechanism = ec.load(
        file, snap_tolerance=0, independent_mimics=True, keep_fixed_links=True
    )
    values = random_parameters(mechanism)
    (written,) = identified_robot(mechanism, values, open_robot(file))
    assert_near(
        standard(reread(written, replace(EXACT, keep_fixed_links=True))), values, 1e-14
    )
    assert not any("fixed to" in note for note in written.notes)


ARM = """<?xml version="1.0" encoding="ISO-8859-1"?>\r
<!-- arm of M\xfcller -->\r
<robot name='arm "&lt;1&gt;"' xmlns:xacro="http://ros.org/xacro"><material name="a>b"/>\r
\t<link name="base">\r
\t\t<inertial><mass value="9"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="2"/></inertial></link>\r
\t<link name="upper">\r
\t\t<!-- <inertial> of an older arm -->\r
\t\t<visual><geometry><mesh filename="meshes/upper.stl"/></geometry></visual>\r
\t\t<inertial>\r
\t\t\t<origin rpy = '0.1 0.2 0.3'  xyz="1 2 3" /> <!-- CAD -->\r
\t\t\t<mass value="2" unit="kg"/>\r
\t\t\t<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"></inertia>\r
\t\t</inertial>\r
\t</link>\r
\t<link name="fore"/>\r
\t<link name="tool">\r
\t\t<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>\r
\t</link>\r
\t<joint name="shoulder" type="continuous"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>\r
\t\t<dynamics damping='0.5' friction="0.25" spring="7"/></joint>\r
\t<joint name="elbow" type="continuous">\r
\t\t<parent link="upper"/><child link="fore"/><origin xyz="0.3 0 0"/><axis xyz="0 1 0"/>\r
\t</joint>\r
\t<joint name="flange" type="fixed"><parent link="fore"/><child link="tool"/><origin xyz="0.2 0 0"/></joint>\r
\t<gazebo reference="upper"><mu1>0.2</mu1><![CDATA[<link name="x">]]></gazebo>\r
</robot>\r
"""

SETUP = """
echelon: 1
name: arm with drives
robot: {file: arm.urdf}
actuators: {m1: 3*shoulder}
rotors:
  - {name: wheel, on: upper, axis: z, drives: 50*elbow}
effects:
  - {type: viscous, at: [m1, elbow]}
  - {type: coulomb, at: m1}
  - {type: rotor_inertia, at: shoulder, side: joint}
  - {type: offset, at: elbow}
"""


@pytest.fixture
def arm(tmp_path: Path) -> tuple[Mechanism, WrittenRobot]:
    (tmp_path / "arm.urdf").write_bytes(ARM.encode("latin-1"))
    (tmp_path / "arm.yaml").write_text(SETUP)
    mechanism = ec.load(tmp_path / "arm.yaml", snap_tolerance=0, symbolic=False)
    known = {
        "ZZ_wheel": 0.001,
        "Fv_m1": 2.0,
        "Fv1": 2.0,
        "Fvm1": 2.0,
        "Fc1": 0.75,
        "Fv2": 0.125,
        "Ia1": 0.5,
        "Fo2": 0.0625,
    }
    values = [
        *solid(4, 0.5),
        *solid(2, 0.25),
        *(known[name] for name in mechanism.parameters[20:]),
    ]
    (written,) = identified_robot(mechanism, values, open_robot(tmp_path / "arm.urdf"))
    return mechanism, written


def test_all_but_the_edited_elements_stays(arm: tuple[Mechanism, WrittenRobot]) -> None:
    _, written = arm
    moments = 'ixx="1.0" ixy="0.0" ixz="0.0" iyy="2.0" iyz="0.0" izz="2.5"'
    old = 'ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"'
    expected = ARM.replace("ISO-8859-1", "UTF-8")
    expected = expected.replace(
        """rpy = '0.1 0.2 0.3'  xyz="1 2 3\"""", 'rpy = "0 0 0"  xyz="0.5 0.0 0.0"'
    )
    expected = expected.replace(
        f'"2" unit="kg"/>\r\n\t\t\t<inertia {old}>',
        f'"4.0" unit="kg"/>\r\n\t\t\t<inertia {moments}>',
    )
    block = [
        "<inertial>",
        '  <origin xyz="0.25 0.0 0.0" rpy="0 0 0"/>',
        '  <mass value="2.0"/>',
        f"  <inertia {moments}/>",
    ]
    lines = "".join(f"\t  {line}\r\n" for line in [*block, "</inertial>"])
    expected = expected.replace(
        '<link name="fore"/>', f'<link name="fore">\r\n{lines}\t</link>'
    )
    expected = expected.replace(
        f'\t\t<inertial><mass value="1"/><inertia {old}/></inertial>\r\n', ""
    )
    expected = expected.replace(
        """damping='0.5' friction="0.25\"""", 'damping="18.0" friction="2.25"'
    )
    expected = expected.replace(
        '<joint name="elbow" type="continuous">\r\n',
        '<joint name="elbow" type="continuous">\r\n\t\t<dynamics damping="0.125"/>\r\n',
    )
    start, end = written.text.index("<!--\r\n"), written.text.index("Note: files that")
    end = written.text.index("-->", end) + 3
    head = written.text[:start].rstrip(" \t\r\n")
    assert head + written.text[end:] == expected


def test_what_urdf_cannot_say_is_said(arm: tuple[Mechanism, WrittenRobot]) -> None:
    _, written = arm
    said = "; ".join(written.notes)
    for part in (
        "rotor inertia",
        "= 0.5 kg·m²",
        "Fo2 = 0.0625 N·m",
        "ZZ_wheel = 0.001 kg·m²",
        "'tool'",
        "relative to",
    ):
        assert part in said
    assert all(note in written.text for note in written.notes)
    (doubt,) = written.doubts
    assert "wrong accelerations" in doubt
    assert "0.5 kg·m² at 'shoulder', ZZ_wheel = 0.001 kg·m² of its drive" in doubt


def test_bytes_of_other_encodings_and_marks_are_read(tmp_path: Path) -> None:
    text = '<?xml version="1.0" encoding="UTF-16"?><robot name="ü"><link name="a"/></robot>'
    plain = '\ufeff<robot name="ü"><link name="a"/></robot>'
    for data in (text.encode("utf-16"), plain.encode()):
        file = tmp_path / "robot.urdf"
        file.write_bytes(data)
        mechanism = ec.load(file, floating=True)
        (written,) = identified_robot(mechanism, solid(2, 0.5), open_robot(file))
        assert_near(
            standard(reread(written, replace(EXACT, floating=True))),
            np.array(solid(2, 0.5)),
            1e-15,
        )


def test_massless_links_lose_their_inertial() -> None:
    file = robot_file("ur10_robot")
    mechanism = ec.load(file, snap_tolerance=0, massless=["wrist_1_link"])
    values = random_parameters(mechanism)
    (written,) = identified_robot(mechanism, values, open_robot(file))
    assert reread(written, EXACT).bodies[3].inertial is None
    assert any(
        "carry no parameters or zero: 'wrist_1_link'" in note for note in written.notes
    )


# -- what cannot be written --------------------------------------------------------------------------------------------


def pendulum() -> Mechanism:
    text = "{echelon: 1, name: p, gravity: [0, 0, -9.81], bodies: [{name: arm, joint: {type: revolute, axis: z}}]}"
    return RobotFile.of(text.encode(), "p.yaml").mechanism(ReadingOptions())


def test_bad_values_are_refused_by_name() -> None:
    with pytest.raises(InputError, match="expected 10 standard parameters"):
        identified_robot(pendulum(), np.ones(9))
    with pytest.raises(InputError, match=r"parameter 'MX1'.*not a finite"):
        identified_robot(pendulum(), [*[1.0] * 6, np.nan, 0, 0, 1])
    for impossible in (
        solid(-1, 0),
        [1, 0, 0, 1, 0, 2.1, 0, 0, 0, 1],
        [1, 0, 0, 1, 0, 1, 2, 0, 0, 1],
    ):
        with pytest.raises(
            InputError, match="body 'arm': no body has these parameters"
        ):
            identified_robot(pendulum(), impossible)


@pytest.mark.parametrize(
    ("name", "text", "problem"),
    [
        (
            "other.urdf",
            '<robot name="o"><link name="x"/></robot>',
            "body 'arm': the file has no such link",
        ),
        (
            "other.xml",
            '<mujoco><worldbody><body name="x"/></worldbody></mujoco>',
            "body 'arm': the model has no",
        ),
        ("page.xml", "<html/>", "the root element is <html>"),
        (
            "bomb.urdf",
            '<!DOCTYPE r [<!ENTITY a "b">]><robot>&a;</robot>',
            "entities are not accepted",
        ),
        (
            "odd.urdf",
            '<?xml version="1.0" encoding="klingon"?><robot/>',
            "cannot be decoded",
        ),
    ],
)
def test_files_of_other_robots_and_other_files_are_refused(
    name: str, text: str, problem: str, tmp_path: Path
) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=problem):
        identified_robot(pendulum(), solid(1, 0.1), open_robot(tmp_path / name))


def test_names_that_xml_cannot_have_are_refused() -> None:
    mechanism = pendulum()
    odd = replace(mechanism, name="a\x01b")
    with pytest.raises(InputError, match="control characters"):
        UrdfGenerator(odd, sorted_values(odd, solid(1, 0.1))).written()


# -- bodies with the values of their file ------------------------------------------------------------------------------

LINKS = """<robot name="chain"><link name="base"/>
<joint name="j1" type="continuous"><parent link="base"/><child link="l1"/><axis xyz="0 1 0"/></joint>
<link name="l1"><inertial><origin xyz=".10 2e-2 0"/><mass value="2.50"/>
<inertia ixx=".020" ixy="0" ixz="0" iyy=".020" iyz="1e-6" izz="0.020"/></inertial></link>
<joint name="f1" type="fixed"><parent link="l1"/><child link="cover"/><origin xyz="0 0 .1"/></joint>
<link name="cover"><inertial><mass value=".30"/>
<inertia ixx="1e-3" ixy="0" ixz="0" iyy="1e-3" iyz="0" izz="1e-3"/></inertial></link>
<joint name="j2" type="continuous"><parent link="l1"/><child link="l2"/><axis xyz="1 0 0"/></joint>
<link name="l2"><inertial><mass value="1.0"/>
<inertia ixx=".010" ixy="0" ixz="0" iyy=".010" iyz="0" izz=".010"/></inertial></link></robot>"""


def test_links_with_the_values_of_their_file_stay_byte_for_byte(tmp_path: Path) -> None:
    (tmp_path / "in.urdf").write_text(LINKS)
    file = open_robot(tmp_path / "in.urdf")
    mechanism = ec.load(tmp_path / "in.urdf")
    values = standard(mechanism)
    values[10:] *= 1.5
    (written,) = identified_robot(mechanism, values, file)
    first, _, second = LINKS.partition('<joint name="j2"')
    assert first.partition("\n")[2] in written.text
    assert second not in written.text
    assert '<mass value="1.5"/>' in written.text
    assert not any("'cover'" in note for note in written.notes)
    assert_near(standard(reread(written, EXACT)), values, 1e-14)
