"""Robot files: parsed once, and mechanisms that are data."""

from __future__ import annotations

import pickle
from dataclasses import replace
from pathlib import Path

import pytest

import echelon as ec
from echelon.formats import robot_file
from echelon.formats.joint_limits import stated_limits
from echelon.formats.robot_file import RobotFile, open_robot
from echelon.formats.snapping import ReadingOptions

ARM = """<robot name="arm"><link name="base"/><link name="a"/><link name="b"/>
<joint name="j1" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="2" velocity="3"/></joint>
<joint name="j2" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0.3 0 0" rpy="1.5708 0 0"/>
<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="2" velocity="3"/></joint></robot>"""


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    """A URDF, and a description that adds to it."""
    urdf, added = tmp_path / "arm.urdf", tmp_path / "arm.yaml"
    urdf.write_text(ARM)
    added.write_text(
        "{echelon: 1, robot: {file: arm.urdf}, effects: [{type: viscous, at: j1}]}"
    )
    return urdf, added


def test_the_text_is_parsed_once(
    files: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    parsed: list[str] = []
    parse = robot_file.parse_xml
    monkeypatch.setattr(
        robot_file,
        "parse_xml",
        lambda data, source: parsed.append(source) or parse(data, source),
    )
    file = open_robot(files[1])
    mechanism = file.mechanism()
    assert set(stated_limits(file, mechanism)) == {"j1", "j2"}
    assert mechanism.reading is not None
    assert len(mechanism.reading.literal().symbols) > len(mechanism.symbols)
    assert parsed == [str(files[0])]


@pytest.mark.parametrize("index", [0, 1])
def test_files_are_data(files: tuple[Path, Path], index: int) -> None:
    file = open_robot(files[index])
    mechanism = file.mechanism()
    again = pickle.loads(pickle.dumps(mechanism))
    assert again == mechanism
    assert again.reading == mechanism.reading
    assert again.reading.literal() == mechanism.reading.literal()
    assert file == open_robot(files[index])


def test_what_is_changed_has_no_reading(files: tuple[Path, Path]) -> None:
    mechanism = ec.load(files[0])
    assert mechanism.reading is not None
    assert replace(mechanism, gravity=None).reading is None
    assert replace(mechanism) == mechanism


def test_usual_effects_are_part_of_the_literal_reading(
    files: tuple[Path, Path],
) -> None:
    mechanism = open_robot(files[0]).mechanism(ReadingOptions(usual_effects=True))
    assert mechanism.reading is not None
    assert [e.parameter for e in mechanism.reading.literal().effects] == [
        "Fv1",
        "Fv2",
        "Fc1",
        "Fc2",
        "Fo1",
        "Fo2",
    ]
    assert mechanism.reading.literal().effects == mechanism.effects


def test_the_content_decides_between_formats_of_xml() -> None:
    assert RobotFile.of(ARM.encode(), "robot.txt").mechanism().name == "arm"


TINY = {
    "urdf": """<robot name="r"><link name="base"/><link name="a"><inertial><mass value="1"/>
<inertia ixx="1" ixy="1e-114" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
<joint name="j" type="revolute"><parent link="base"/><child link="a"/><origin xyz="0 {} 1"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>""",
    "sdf": """<sdf version="1.9"><model name="r"><link name="base"/><link name="a"><pose>0 {} 1 0 0 0</pose></link>
<joint name="f" type="fixed"><parent>world</parent><child>base</child></joint><joint name="j" type="revolute">
<parent>base</parent><child>a</child><axis><xyz>0 1 0</xyz></axis></joint></model></sdf>""",
    "mjcf": """<mujoco><worldbody><body pos="0 {} 1"><joint axis="0 1 0"/>
<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body></worldbody></mujoco>""",
}


@pytest.mark.parametrize("text", TINY.values(), ids=TINY)
def test_tiny_numbers_are_zero(text: str) -> None:
    tiny, zero = ec.load(text.format("-1e-114")), ec.load(text.format("0"))
    assert ec.base_structure(tiny).rank == ec.base_structure(zero).rank
    assert tiny.reading is not None
    assert any(
        "taken as zero" in note and "1e-114" in note for note in tiny.reading.notes
    )


def test_a_description_lets_the_robot_of_a_file_float(files: tuple[Path, Path]) -> None:
    urdf, added = files
    added.write_text("{echelon: 1, robot: arm.urdf, floating_base: true}")
    floating = ec.load(urdf, floating=True)
    for stated in (ec.load(added), ec.load(added, floating=True)):
        assert stated.positions == floating.positions
        assert ec.base_parameters(stated).rank == ec.base_parameters(floating).rank
    added.write_text("{echelon: 1, robot: arm.urdf, couplings: [{j2: j1}]}")
    with pytest.raises(ec.InputError, match="leave couplings out"):
        ec.load(added)
