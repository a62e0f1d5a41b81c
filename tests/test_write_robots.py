"""Written robots against the programs that read them: Pinocchio, MuJoCo and Echelon itself."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import echelon as ec
from echelon.conventions import PARAMETERS, PER_BODY
from echelon.errors import InputError
from echelon.formats.load import parse_robot
from echelon.formats.options import ReadingOptions
from echelon.formats.write_robot import WrittenRobot, identified_robot
from echelon.inertia.spatial import from_pseudo_inertia
from echelon.mechanism.mechanism import ALL, Mechanism
from oracles import float_regressor, random_states
from robots import PinocchioState, has_pinocchio, pinocchio_state, robot_file

EXAMPLES = Path(__file__).parents[1] / "examples"
EXACT = ReadingOptions(tolerance=0, independent_mimics=True)
TEXTS: dict[str, str] = {}


def random_parameters(mechanism: Mechanism, seed: int = 7) -> np.ndarray:
    """Standard parameters of random solid bodies; what is carried alone, and effects, positive."""
    rng = np.random.default_rng(seed)
    values = rng.uniform(0.1, 1.0, len(mechanism.parameters))
    for index, body in enumerate(mechanism.bodies):
        if body.carried == ALL:
            root = np.tril(rng.uniform(-0.3, 0.3, (4, 4))) + np.diag([0.2, 0.2, 0.2, 1.0])
            first = mechanism.first_column[index]
            values[first : first + PER_BODY] = from_pseudo_inertia(root @ root.T)
    return values


def reread(written: WrittenRobot, options: ReadingOptions = EXACT, directory: Path | None = None) -> Mechanism:
    return parse_robot(written.text.encode(), written.name, options, directory)


def standard(mechanism: Mechanism) -> np.ndarray:
    return np.array([0.0 if value is None else value for value in mechanism.standard_values()])


def geometry(mechanism: Mechanism) -> Mechanism:
    """The mechanism without inertial values."""
    return replace(mechanism, bodies=tuple(replace(body, inertial=None) for body in mechanism.bodies))


def assert_near(found: np.ndarray, expected: np.ndarray, tolerance: float) -> None:
    np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance * np.abs(expected).max())


def pinocchio_efforts(mechanism: Mechanism, text: str, states: tuple[np.ndarray, ...], floating: bool) -> np.ndarray:
    """Pinocchio's inverse dynamics of a URDF text at our states, in our coordinates."""
    pin = pytest.importorskip("pinocchio", reason="Pinocchio is not installed")
    model = pin.buildModelFromXML(text, pin.JointModelFreeFlyer()) if floating else pin.buildModelFromXML(text)
    gravity = mechanism.gravity
    model.gravity.linear = np.array([0.0] * 3 if gravity is None else [float(part.number) for part in gravity])
    data = model.createData()
    efforts = []
    for q, qd, qdd in zip(*states, strict=True):
        state: PinocchioState = pinocchio_state(mechanism, model, q, qd, qdd)
        efforts.append(state.to_ours(pin.rnea(model, data, state.q, state.v, state.a)))
    return np.array(efforts)


# -- URDF files --------------------------------------------------------------------------------------------------------

URDFS = [
    *[(name, False) for name in ("ur10_robot", "panda", "kinova", "tiago", "xarm7", "pr2", "z1", "so100")],
    *[(name, True) for name in ("a1", "romeo", "talos_full_v2", "anymal", "solo12", "icub")],
]


@pytest.mark.parametrize(("name", "floating"), URDFS)
def test_written_urdf_in_pinocchio_and_read_again(name: str, floating: bool) -> None:
    file = robot_file(name)
    options = replace(EXACT, floating=floating)
    mechanism = ec.load(file, tolerance=0, floating=floating, independent_mimics=True)
    values = random_parameters(mechanism)
    (written,) = identified_robot(mechanism, values, file)
    again = reread(written, options)
    assert geometry(again) == geometry(mechanism)
    assert_near(standard(again), values, 1e-14)
    states = random_states(mechanism, 2)
    if not has_pinocchio():
        return
    found = pinocchio_efforts(mechanism, written.text, states, floating)
    assert_near(found, float_regressor(mechanism, *states) @ values, 1e-12)


def test_every_link_keeps_its_own_inertial() -> None:
    file = robot_file("panda")
    mechanism = ec.load(file, tolerance=0, independent_mimics=True, every_link=True)
    values = random_parameters(mechanism)
    (written,) = identified_robot(mechanism, values, file)
    assert_near(standard(reread(written, replace(EXACT, every_link=True))), values, 1e-14)
    assert not any("fixed to" in note for note in written.notes)


ARM = """<?xml version="1.0" encoding="ISO-8859-1"?>\r
<!-- arm of M\xfcller -->\r
<robot name='arm "&lt;1&gt;"' xmlns:xacro="http://ros.org/xacro"><material name="a>b"/>\r
\t<link name="base"><inertial><mass value="9"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>\r
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


def solid(mass: float, x: float) -> list[float]:
    """A body with a round centre of mass and moments 1, 2, 2.5 about it."""
    return [1.0, 0, 0, 2 + mass * x * x, 0, 2.5 + mass * x * x, mass * x, 0, 0, mass]


@pytest.fixture
def arm(tmp_path: Path) -> tuple[Mechanism, WrittenRobot]:
    (tmp_path / "arm.urdf").write_bytes(ARM.encode("latin-1"))
    (tmp_path / "arm.yaml").write_text(SETUP)
    mechanism = ec.load(tmp_path / "arm.yaml", tolerance=0, symbolic=False)
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
    values = [*solid(4, 0.5), *solid(2, 0.25), *(known[name] for name in mechanism.parameters[20:])]
    (written,) = identified_robot(mechanism, values, tmp_path / "arm.urdf")
    return mechanism, written


def test_all_but_the_edited_elements_stays(arm: tuple[Mechanism, WrittenRobot]) -> None:
    _, written = arm
    moments = 'ixx="1.0" ixy="0.0" ixz="0.0" iyy="2.0" iyz="0.0" izz="2.5"'
    old = 'ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"'
    expected = ARM.replace("ISO-8859-1", "UTF-8")
    expected = expected.replace("""rpy = '0.1 0.2 0.3'  xyz="1 2 3\"""", 'rpy = "0 0 0"  xyz="0.5 0.0 0.0"')
    expected = expected.replace(
        f'"2" unit="kg"/>\r\n\t\t\t<inertia {old}>', f'"4.0" unit="kg"/>\r\n\t\t\t<inertia {moments}>'
    )
    block = [
        "<inertial>",
        '  <origin xyz="0.25 0.0 0.0" rpy="0 0 0"/>',
        '  <mass value="2.0"/>',
        f"  <inertia {moments}/>",
    ]
    lines = "".join(f"\t  {line}\r\n" for line in [*block, "</inertial>"])
    expected = expected.replace('<link name="fore"/>', f'<link name="fore">\r\n{lines}\t</link>')
    expected = expected.replace(f'\t\t<inertial><mass value="1"/><inertia {old}/></inertial>\r\n', "")
    expected = expected.replace("""damping='0.5' friction="0.25\"""", 'damping="18.0" friction="2.25"')
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
    for part in ("rotor inertia", "= 0.5 kg·m²", "Fo2 = 0.0625 N·m", "ZZ_wheel = 0.001 kg·m²", "'tool'", "relative to"):
        assert part in said
    assert all(note in written.text for note in written.notes)
