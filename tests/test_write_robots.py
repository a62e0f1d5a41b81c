"""Written robots against the programs that read them: Pinocchio, MuJoCo and Echelon itself."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

import echelon as ec
from echelon.conventions import PER_BODY
from echelon.errors import InputError
from echelon.formats.load import parse_robot
from echelon.formats.options import ReadingOptions
from echelon.formats.write_robot import WrittenRobot, identified_robot
from echelon.formats.write_urdf import generated_urdf
from echelon.formats.write_values import sorted_values
from echelon.inertia.spatial import from_pseudo_inertia
from echelon.mechanism.mechanism import ALL, Mechanism
from oracles import float_regressor, random_states
from robots import PinocchioState, has_pinocchio, pinocchio_state, robot_file

EXAMPLES = Path(__file__).parents[1] / "examples"
EXACT = ReadingOptions(tolerance=0, independent_mimics=True)


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


def test_bytes_of_other_encodings_and_marks_are_read(tmp_path: Path) -> None:
    text = '<?xml version="1.0" encoding="UTF-16"?><robot name="ü"><link name="a"/></robot>'
    plain = '\ufeff<robot name="ü"><link name="a"/></robot>'
    for data in (text.encode("utf-16"), plain.encode()):
        file = tmp_path / "robot.urdf"
        file.write_bytes(data)
        mechanism = ec.load(file, floating=True)
        (written,) = identified_robot(mechanism, solid(2, 0.5), file)
        assert_near(standard(reread(written, replace(EXACT, floating=True))), np.array(solid(2, 0.5)), 1e-15)


def test_massless_links_lose_their_inertial() -> None:
    file = robot_file("ur10_robot")
    mechanism = ec.load(file, tolerance=0, massless=["wrist_1_link"])
    values = random_parameters(mechanism)
    (written,) = identified_robot(mechanism, values, file)
    assert reread(written, EXACT).bodies[3].inertial is None
    assert any("carry no parameters: 'wrist_1_link'" in note for note in written.notes)


# -- MJCF files --------------------------------------------------------------------------------------------------------

BODY = '<inertial pos="0.05 -0.02 0.11" mass="1.3" euler="0.2 0.3 -0.4" diaginertia="0.021 0.017 0.012"/>'
MJCFS = {
    "one body, several joints": f"""<mujoco><compiler angle="radian"/><worldbody><geom type="plane" size="1 1 1"/>
        <body pos="0.1 0 0.2" euler="0.3 0.1 0.2"><joint type="slide" axis="1 1 0"/>
          <joint axis="0 1 0" pos="0.2 0 0.3"/>{BODY}<geom size="0.1"/>
          <body pos="0 0.3 0"><joint axis="1 0 1"/><geom size="0.2" mass="3"/></body></body>
        </worldbody>
        <worldbody><body name="late"><joint name="body_1" type="ball"/>{BODY}</body></worldbody></mujoco>""",
    "free base with frames, fixed parts": f"""<mujoco><worldbody><body name="post"><geom size="1"/></body>
        <body name="base" pos="1 2 3"><freejoint name="f"/>{BODY}<frame pos="0.1 0 0" euler="10 20 30">
        <body name="tip" pos="0 0 0.1"><frame><geom size="0.2"/></frame></body></frame><body name="bare"/>
        <frame euler="0 0 12"><body name="arm" pos="0.3 0 0"><joint name="a"/><geom size="0.1"/></body></frame></body>
        </worldbody></mujoco>""",
    "settings that change inertias": f"""<mujoco><compiler boundmass="5" boundinertia="5" balanceinertia="true"
        settotalmass="3" inertiafromgeom="true"/><compiler fusestatic="true"/><worldbody><body name="a">
        <joint name="j" axis="0 1 0"/>{BODY}<geom size="0.1"/><body name="lump" pos="0 0 1">{BODY}
        <geom size="0.1"/></body></body></worldbody></mujoco>""",
    "replicated": f"""<mujoco><compiler eulerseq="zyx"/><worldbody>
        <replicate count="3" offset="0 0.1234567890123 0.2" euler="0 7 25.123456789">
        <body name="arm" pos="0.4 0 0"><joint name="j" axis="0.3 1 0" ref="12.3456789"/>{BODY}
        <body euler="1 2 3.456789012"><joint axis="1 0 0"/>{BODY}<geom size="0.1"/></body></body></replicate>
        </worldbody></mujoco>""",
}


def mujoco_efforts(text: str, states: tuple[np.ndarray, ...], folder: Path) -> np.ndarray:
    mujoco = pytest.importorskip("mujoco")
    (folder / "simulated.xml").write_text(text)
    model = mujoco.MjModel.from_xml_path(str(folder / "simulated.xml"))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data = mujoco.MjData(model)
    efforts = []
    for data.qpos[:], data.qvel[:], data.qacc[:] in zip(*states, strict=True):
        mujoco.mj_inverse(model, data)
        efforts.append(data.qfrc_inverse.copy())
    return np.array(efforts)


def check_mjcf(file: Path, folder: Path) -> WrittenRobot:
    mechanism = ec.load(file, tolerance=0)
    values = random_parameters(mechanism)
    (written,) = identified_robot(mechanism, values, file)
    again = reread(written, ReadingOptions(tolerance=0), folder)
    assert geometry(again) == geometry(mechanism)
    assert_near(standard(again), values, 1e-11)
    states = random_states(mechanism, 3)
    found = mujoco_efforts(written.text, states, folder)
    assert_near(found, float_regressor(mechanism, *states) @ values, 1e-9)
    return written


@pytest.mark.filterwarnings("ignore:compiler attribute")
@pytest.mark.parametrize("name", MJCFS)
def test_written_mjcf_in_mujoco_and_read_again(name: str, tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    (tmp_path / "in.xml").write_text(MJCFS[name])
    check_mjcf(tmp_path / "in.xml", tmp_path)


def test_written_example_is_the_example_elsewhere(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    file = EXAMPLES / "two_link.xml"
    written = check_mjcf(file, tmp_path)
    kept = [line for line in file.read_text().splitlines() if "<inertial" not in line]
    assert [line for line in written.text.splitlines() if line in kept] == kept


def test_includes_are_put_in_place_with_their_comments(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "arm.xml").write_text(
        f"""<mujocoinclude><!-- an arm --><body name="a"><joint name="j"/>{BODY}
        <include file="hand.xml"/></body></mujocoinclude>"""
    )
    (tmp_path / "parts" / "hand.xml").write_text(
        f'<mujoco><body name="b" pos="0 1 0"><joint name="k" axis="1 0 0"/>{BODY}</body></mujoco>'
    )
    (tmp_path / "in.xml").write_text('<mujoco><worldbody><include file="parts/arm.xml"/></worldbody></mujoco>')
    written = check_mjcf(tmp_path / "in.xml", tmp_path)
    assert "<!-- an arm -->" in written.text
    assert "include" not in written.text


def test_drives_of_mjcf_become_attributes_of_joints(tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco")
    (tmp_path / "in.xml").write_text(
        f"""<mujoco><default><joint damping="9" stiffness="4"/></default><worldbody><body name="a">
        <joint name="j" axis="0 1 0"/>{BODY}
        <body name="b" pos="0.3 0 0"><joint name="k" axis="0 1 0" armature="0.5"/>{BODY}</body></body>
        </worldbody></mujoco>"""
    )
    (tmp_path / "in.yaml").write_text(
        """{echelon: 1, name: driven, robot: {file: in.xml}, actuators: {m: -10*k}, effects: [
        {type: viscous, at: all}, {type: coulomb, at: m}, {type: rotor_inertia, at: m}, {type: spring, at: j}]}"""
    )
    mechanism = ec.load(tmp_path / "in.yaml")
    values = dict(zip(mechanism.parameters, random_parameters(mechanism), strict=True))
    (written,) = identified_robot(mechanism, list(values.values()), tmp_path / "in.xml")
    model = mujoco.MjModel.from_xml_string(written.text)
    fv = [values[name] for name in values if name.startswith("Fv")]
    fc, ia = (next(values[name] for name in values if name.startswith(start)) for start in ("Fc", "Ia"))
    by_actuator = dict(zip([e.actions[0].at for e in mechanism.effects[:2]], fv, strict=True))
    np.testing.assert_allclose(np.ravel(model.dof_damping), [by_actuator["j"], 100 * by_actuator["m"]], rtol=1e-15)
    np.testing.assert_allclose(model.dof_frictionloss, [0, 10 * fc], rtol=1e-15)
    np.testing.assert_allclose(model.dof_armature, [0, 100 * ia], rtol=1e-15)
    said = "; ".join(written.notes)
    for part in ("'j' keeps stiffness = 4.0", "Ks1 = ", "Ps1 = "):
        assert part in said


def test_held_joints_keep_next_to_no_mass(tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco")
    (tmp_path / "in.xml").write_text(
        f"""<mujoco><worldbody><body name="a"><joint name="j"/>{BODY}<body name="b" pos="0 1 0"><joint name="k"/>{BODY}
        </body></body></worldbody><equality><joint joint1="k" polycoef="0.3 0 0 0 0"/></equality></mujoco>"""
    )
    mechanism = ec.load(tmp_path / "in.xml", tolerance=0)
    assert len(mechanism.bodies) == 1
    values = random_parameters(mechanism)
    (written,) = identified_robot(mechanism, values, tmp_path / "in.xml")
    assert_near(standard(reread(written, directory=tmp_path)), values, 1e-11)
    assert mujoco.MjModel.from_xml_string(written.text).body_mass.sum() == pytest.approx(values[9], rel=1e-12)


# -- descriptions ------------------------------------------------------------------------------------------------------

DESCRIPTIONS = (
    *("panda", "rx90", "stanford", "double_pendulum", "puma560", "ur10", "furuta", "tx40", "cart_pole"),
    *("floating_tree", "scara", "gripper_coupled"),
)


def by_name(mechanism: Mechanism) -> dict[str, tuple[float, ...]]:
    return {body.name: body.inertial or () for body in mechanism.bodies}


SYMBOLS = {"d2": 0.1524, "g": 9.81, "d3": 0.4, "d5": 0.39}
"""Values of symbols that the examples leave open."""
ODD = {
    "standard DH, branches, several motions": """
echelon: 1
name: '"><robot & -- <!-- ünï'
gravity: [1, 2, -3]
symbols: {a: 0.3, b: 0.7}
bodies:
  - {name: "<a>", joint: {type: universal, axis: x, axis2: z, origin: {xyz: [a, 0, 1], rpy: [0.3, pi/2, b]}},
     frame: {xyz: [0.1, 0.2, 0.3], rpy: [0.2, 0.3, 0.4]}}
  - {name: base, parent: "<a>", joint: {type: cylindrical, name: "'c'", axis: -y}, frame: {rpy: [pi/3, 0, 0.1]}}
  - {name: plate, parent: base, joint: {type: fixed, origin: {xyz: [0, 0, a]}}, separate: true}
  - {name: leg, parent: plate, joint: {type: planar, axis: x}}
  - {name: empty, parent: leg, joint: {type: prismatic, axis: z}, massless: true}
  - {name: last, parent: empty, joint: {type: revolute, axis: x}}
  - {name: ball, parent: "<a>", joint: {type: revolute, axis: y}, parameters: [M]}
""",
    "floating base in a frame of its own": """
echelon: 1
name: free
gravity: [0, 0, -9.81]
bodies:
  - {name: trunk, joint: {type: floating, name: base}, frame: {xyz: [0.1, 0.2, 0.3], rpy: [0.2, 0.3, 0.4]}}
  - {name: arm, parent: trunk, joint: {type: revolute, axis: y, origin: {xyz: [0, 1, 0]}}}
""",
}


def with_symbol_values(mechanism: Mechanism) -> Mechanism:
    known = {n: s if s.value is not None else replace(s, value=SYMBOLS[n]) for n, s in mechanism.symbols.items()}
    return replace(mechanism, symbols=known)


def described(name: str) -> Mechanism:
    if name in ODD:
        return parse_robot(ODD[name].encode(), "odd.yaml", ReadingOptions())
    return with_symbol_values(ec.load(EXAMPLES / f"{name}.yaml"))


def numeric_gravity(mechanism: Mechanism) -> Mechanism:
    """A symbolic gravity, and effects, would only be in the way."""
    parts = mechanism.gravity or ()
    fixed = mechanism.gravity if all(part.number is not None for part in parts) else None
    return replace(mechanism, gravity=fixed, effects=(), actuators=(), measured=None)


@pytest.mark.parametrize("name", [*ODD, *DESCRIPTIONS])
def test_written_description_says_everything(name: str) -> None:
    mechanism = described(name)
    values = random_parameters(mechanism)
    written = identified_robot(mechanism, values)[0]
    again = reread(written)
    known = dict(zip(mechanism.parameters, (float(v) for v in values), strict=True))
    effects = tuple(replace(effect, value=known[effect.parameter]) for effect in mechanism.effects)
    assert geometry(again) == geometry(replace(mechanism, effects=effects))
    assert np.array_equal(standard(again), values)


@pytest.mark.parametrize("name", [*ODD, *DESCRIPTIONS[:9]])
def test_urdf_of_a_description_in_pinocchio_and_read_again(name: str) -> None:
    mechanism = described(name)
    values = random_parameters(mechanism)
    written = identified_robot(mechanism, values)[1]
    rigid = numeric_gravity(mechanism)
    states, count = random_states(rigid, 3), len(rigid.parameters)
    expected = float_regressor(rigid, *states) @ values[:count]
    floating = rigid.bodies[0].joint.kind == "floating"
    gravity = "none" if rigid.gravity is None else ",".join(str(part.number) for part in rigid.gravity)
    again = reread(written, replace(EXACT, floating=floating, gravity=gravity))
    assert again.velocities == rigid.velocities
    assert_near(float_regressor(again, *states) @ standard(again), expected, 1e-11)
    if has_pinocchio():
        assert_near(pinocchio_efforts(again, written.text, states, floating), expected, 1e-12)


@pytest.mark.parametrize(
    ("name", "reason"),
    [("coupled_arm", "without values: d3, d5"), ("gripper_coupled", "'right'"), ("floating_tree", "'upper_arm'")],
)
def test_why_there_is_no_urdf_is_said(name: str, reason: str) -> None:
    mechanism = ec.load(EXAMPLES / f"{name}.yaml")
    (written,) = identified_robot(mechanism, random_parameters(mechanism))
    assert written.name == "robot.yaml"
    assert reason in written.notes[0]


def test_joints_of_a_generated_urdf_have_friction_and_unknown_limits() -> None:
    mechanism = ec.load(EXAMPLES / "tx40.yaml")
    values = random_parameters(mechanism)
    known = dict(zip(mechanism.parameters, values, strict=True))
    _, urdf = identified_robot(mechanism, values)
    for k, joint in enumerate(ElementTree.fromstring(urdf.text).findall("joint"), 1):
        friction = {"damping": repr(float(known[f"Fv{k}"])), "friction": repr(float(known[f"Fc{k}"]))}
        assert [element.attrib for element in joint.findall("dynamics")] == [friction]
    for name in ("Ia1", "Fo6", "fsm6"):
        assert f"{name} = {float(known[name])!r}" in urdf.text
    cart = ec.load(EXAMPLES / "cart_pole.yaml")
    assert "limits of 'cart' are made up" in "; ".join(identified_robot(cart, random_parameters(cart))[1].notes)


def test_rotors_are_in_the_description_only() -> None:
    mechanism = parse_robot(
        b"""{echelon: 1, name: geared, gravity: [0, 0, -9.81], modified_dh: [{joint: revolute, alpha: pi/2}],
        rotors: [{name: wheel, on: base, axis: z, drives: 50*j1}]}""",
        "geared.yaml",
        ReadingOptions(),
    )
    written, urdf = identified_robot(mechanism, [*solid(2, 0.5), 0.125])
    assert standard(reread(written)).tolist() == [*solid(2, 0.5), 0.125]
    assert "wheel" not in urdf.text.split("-->")[1]
    assert any("= 0.125 kg·m²" in note for note in urdf.notes)


# -- what cannot be written --------------------------------------------------------------------------------------------


def pendulum() -> Mechanism:
    text = "{echelon: 1, name: p, gravity: [0, 0, -9.81], bodies: [{name: arm, joint: {type: revolute, axis: z}}]}"
    return parse_robot(text.encode(), "p.yaml", ReadingOptions())


def test_bad_values_are_refused_by_name() -> None:
    with pytest.raises(InputError, match="expected 10 standard parameters"):
        identified_robot(pendulum(), np.ones(9))
    with pytest.raises(InputError, match=r"parameter 'MX1'.*not a finite"):
        identified_robot(pendulum(), [*[1.0] * 6, np.nan, 0, 0, 1])
    for impossible in (solid(-1, 0), [1, 0, 0, 1, 0, 2.1, 0, 0, 0, 1], [1, 0, 0, 1, 0, 1, 2, 0, 0, 1]):
        with pytest.raises(InputError, match="body 'arm': no body has these parameters"):
            identified_robot(pendulum(), impossible)


@pytest.mark.parametrize(
    ("name", "text", "problem"),
    [
        ("other.urdf", '<robot name="o"><link name="x"/></robot>', "body 'arm': the file has no such link"),
        ("other.xml", '<mujoco><worldbody><body name="x"/></worldbody></mujoco>', "body 'arm': the model has no"),
        ("page.xml", "<html/>", "the root element is <html>"),
        ("bomb.urdf", '<!DOCTYPE r [<!ENTITY a "b">]><robot>&a;</robot>', "entities are not accepted"),
        ("odd.urdf", '<?xml version="1.0" encoding="klingon"?><robot/>', "cannot be decoded"),
    ],
)
def test_files_of_other_robots_and_other_files_are_refused(name: str, text: str, problem: str, tmp_path: Path) -> None:
    if "mujoco" in text:
        pytest.importorskip("mujoco")
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=problem):
        identified_robot(pendulum(), solid(1, 0.1), tmp_path / name)


def test_names_that_xml_cannot_have_are_refused() -> None:
    mechanism = pendulum()
    odd = replace(mechanism, bodies=(replace(mechanism.bodies[0], name="a\x01b"),))
    with pytest.raises(InputError, match="control characters"):
        generated_urdf(odd, sorted_values(odd, solid(1, 0.1)))
