"""Written descriptions, and the URDF files that are generated beside them."""

from __future__ import annotations

from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

import echelon as ec
from echelon.formats.robot_file import RobotFile
from echelon.formats.snapping import ReadingOptions
from echelon.formats.writers.robot_writer import identified_robot
from echelon.robot.mechanism import Mechanism
from support.float_regressor import float_regressor, random_states
from support.paths import EXAMPLES
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

DESCRIPTIONS = (
    *(
        "panda",
        "rx90",
        "stanford",
        "double_pendulum",
        "puma560",
        "ur10",
        "furuta",
        "tx40",
        "cart_pole",
    ),
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
    "near gimbal lock": """
echelon: 1
name: lock
gravity: [1, 2, -3]
bodies:
  - {name: a, joint: {type: revolute, axis: x, origin: {xyz: [0, 0.1, 1], rpy: [0.3, 1.57079, 0.7]}}}
  - {name: b, parent: a, joint: {type: revolute, axis: z, origin: {xyz: [0, 0.1, 1], rpy: [0.3, -1.5707963, 0.7]}}}
  - {name: c, parent: b, joint: {type: revolute, axis: y, origin: {xyz: [0.1, 0, 1], rpy: [1, 1.570796326, -2]}}}
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
    known = {
        n: s if s.value is not None else replace(s, value=SYMBOLS[n])
        for n, s in mechanism.symbols.items()
    }
    return replace(mechanism, symbols=known)


def described(name: str) -> Mechanism:
    if name in ODD:
        return RobotFile.of(ODD[name].encode(), "odd.yaml").mechanism(
            ReadingOptions(snap_tolerance=0)
        )
    return with_symbol_values(ec.load(EXAMPLES / f"{name}.yaml"))


def numeric_gravity(mechanism: Mechanism) -> Mechanism:
    """A symbolic gravity, and effects, would only be in the way."""
    parts = mechanism.gravity or ()
    fixed = (
        mechanism.gravity if all(part.number is not None for part in parts) else None
    )
    return replace(mechanism, gravity=fixed, effects=(), actuators=(), measured=None)


@pytest.mark.parametrize("name", [*ODD, *DESCRIPTIONS])
def test_written_description_says_everything(name: str) -> None:
    mechanism = described(name)
    values = random_parameters(mechanism)
    written = identified_robot(mechanism, values)[0]
    again = reread(written)
    known = dict(zip(mechanism.parameters, (float(v) for v in values), strict=True))
    effects = tuple(
        replace(effect, value=known[effect.parameter]) for effect in mechanism.effects
    )
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
    gravity = (
        "none"
        if rigid.gravity is None
        else ",".join(str(part.number) for part in rigid.gravity)
    )
    again = reread(written, replace(EXACT, floating=floating, gravity=gravity))
    assert again.velocities == rigid.velocities
    assert_near(float_regressor(again, *states) @ standard(again), expected, 1e-11)
    assert_near(
        pinocchio_efforts(again, written.text, states, floating), expected, 1e-12
    )


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("coupled_arm", "without values: d3, d5"),
        ("gripper_coupled", "'right'"),
        ("floating_tree", "'upper_arm'"),
    ],
)
def test_why_there_is_no_urdf_is_said(name: str, reason: str) -> None:
    mechanism = ec.load(EXAMPLES / f"{name}.yaml")
    (written,) = identified_robot(mechanism, random_parameters(mechanism))
    assert written.name == "identified.yaml"
    assert reason in written.notes[0]


def test_joints_of_a_generated_urdf_have_friction_and_unknown_limits() -> None:
    mechanism = ec.load(EXAMPLES / "tx40.yaml")
    values = random_parameters(mechanism)
    known = dict(zip(mechanism.parameters, values, strict=True))
    _, urdf = identified_robot(mechanism, values)
    for k, joint in enumerate(ElementTree.fromstring(urdf.text).findall("joint"), 1):
        friction = {
            "damping": repr(float(known[f"Fv{k}"])),
            "friction": repr(float(known[f"Fc{k}"])),
        }
        assert [element.attrib for element in joint.findall("dynamics")] == [friction]
    for name in ("Ia1", "Fo6", "fsm6"):
        assert f"{name} = {float(known[name])!r}" in urdf.text
    cart = ec.load(EXAMPLES / "cart_pole.yaml")
    assert "limits of 'cart' are made up" in "; ".join(
        identified_robot(cart, random_parameters(cart))[1].notes
    )


def test_rotors_are_in_the_description_only() -> None:
    mechanism = RobotFile.of(
        b"""{echelon: 1, name: geared, gravity: [0, 0, -9.81], modified_dh: [{joint: revolute, alpha: pi/2}],
        rotors: [{name: wheel, on: base, axis: z, drives: 50*j1}]}""",
        "geared.yaml",
    ).mechanism(ReadingOptions())
    written, urdf = identified_robot(mechanism, [*solid(2, 0.5), 0.125])
    assert standard(reread(written)).tolist() == [*solid(2, 0.5), 0.125]
    assert "wheel" not in urdf.text.split("-->")[1]
    assert any("= 0.125 kg·m²" in note for note in urdf.notes)
