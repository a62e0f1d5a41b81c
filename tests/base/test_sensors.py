"""Sensors elsewhere than in the joints, against MuJoCo's sensors and published counts."""

from __future__ import annotations

import json
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

import echelon as ec
from echelon.algebra.exact.polynomial import Polynomial, as_polynomial
from echelon.algebra.program.schedule import FloatArithmetic, Schedule
from echelon.base.sensors import sensor_report
from echelon.cli.commands import app
from echelon.dynamics.evaluate import evaluate_floats
from echelon.dynamics.linear_forms import (
    inverse_dynamics_regressor,
    virtual_power_form,
)
from echelon.formats.snapping import ReadingOptions
from echelon.formats.writers.description_writer import write_description
from echelon.robot.joint import Placement, as_matrix
from echelon.robot.mechanism import Cut
from support.descriptions import read_description
from support.float_regressor import float_regressor, random_states, standard_vector
from support.paths import ROOT
from support.pinocchio_loops import Constrained
from support.random_mechanisms import mechanisms
from support.robot_files import robot_file
from support.selection import examples

MJCF = """
<mujoco>
  <option gravity="0.3 -0.4 -9.81"/>
  <worldbody>
    <body name="a" pos="0.1 0.2 0.3">
      <joint name="j1" type="hinge" axis="0 0 1"/>
      <inertial pos="0.02 0.03 0.04" mass="2.5" fullinertia="0.03 0.04 0.05 0.001 0.002 0.003"/>
      <site name="sa" pos="0.03 -0.02 0.05" euler="20 30 40"/>
      <body name="b" pos="0.1 0 0.25" euler="90 0 0">
        <joint name="j2" type="slide" axis="1 0 0"/>
        <inertial pos="-0.02 0.01 0.02" mass="1.5" fullinertia="0.02 0.03 0.025 0.001 -0.002 0.001"/>
        <site name="sb" pos="0.01 0.02 0.03" euler="10 -20 70"/>
        <body name="c" pos="0 0.2 0.1" euler="0 90 0">
          <joint name="j3" type="hinge" axis="0 1 0"/>
          <inertial pos="0.05 0.01 -0.02" mass="0.7" fullinertia="0.004 0.005 0.006 0.0001 0.0002 0.0003"/>
          <site name="sc" pos="-0.01 0.04 0.02" euler="-50 15 5"/>
        </body>
      </body>
    </body>
  </worldbody>
  <sensor>
    <force site="sa"/><torque site="sa"/><force site="sb"/><torque site="sb"/><force site="sc"/><torque site="sc"/>
  </sensor>
</mujoco>
"""


def set_up(tmp_path: Path, robot: str, **entries: object) -> ec.Mechanism:
    path = tmp_path / "setup.yaml"
    path.write_text(
        json.dumps(
            {"echelon": 1, "name": "set-up", "robot": {"file": robot}, **entries}
        )
    )
    return ec.load(path)


@pytest.fixture
def mujoco_arm(tmp_path: Path) -> tuple[mujoco.MjModel, ec.Mechanism]:
    (tmp_path / "arm.xml").write_text(MJCF)
    model = mujoco.MjModel.from_xml_string(MJCF)
    return model, _with_cuts(ec.load(tmp_path / "arm.xml"), model)


def _with_cuts(mechanism: ec.Mechanism, model: mujoco.MjModel) -> ec.Mechanism:
    """Sensors at MuJoCo's sites; their rotations are decimals, so they are put in directly."""

    def exact(x: float) -> Polynomial:
        return as_polynomial(Fraction(float(x)))

    outputs = []
    for k in range(3):
        rotation = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, model.site_quat[k])
        rows = as_matrix([[exact(x) for x in row] for row in rotation.reshape(3, 3)])
        x, y, z = (exact(v) for v in model.site_pos[k])
        frame = Placement(rows, (x, y, z))
        outputs += [
            Cut(k, frame, False, axis, angular).output(f"s{k}.{angular}{axis}", "N")
            for angular in (False, True)
            for axis in range(3)
        ]
    return replace(mechanism, measured=tuple(outputs))


def test_force_and_torque_sensors_agree_with_mujoco(
    mujoco_arm: tuple[mujoco.MjModel, ec.Mechanism],
) -> None:
    model, mechanism = mujoco_arm
    data, rng = mujoco.MjData(model), np.random.default_rng(3)
    forms = inverse_dynamics_regressor(mechanism)
    zeta = np.array(mechanism.standard_values(), dtype=float)
    for _ in range(5):
        data.qpos[:], data.qvel[:], data.qacc[:] = rng.normal(size=(3, 3))
        mujoco.mj_inverse(model, data)
        mujoco.mj_rnePostConstraint(model, data)
        # mj_inverse leaves qacc, from which the sensors are computed again
        mujoco.mj_sensorAcc(model, data)
        y = evaluate_floats(forms, mechanism, data.qpos, data.qvel, data.qacc)[0] @ zeta
        # MuJoCo's sensors point from the child to the parent's force on it with the same sign as ours
        np.testing.assert_allclose(y, data.sensordata, rtol=1e-9, atol=1e-9)


def test_rows_of_the_regressor_are_those_of_the_virtual_power(
    mujoco_arm: tuple[mujoco.MjModel, ec.Mechanism],
) -> None:
    _, mechanism = mujoco_arm
    rows, power = inverse_dynamics_regressor(mechanism), virtual_power_form(mechanism)
    rng = np.random.default_rng(0)
    schedule = Schedule(power.program, list(power.entries.values()))
    named = {power.program.inputs[n].name: n for n in schedule.leaves}
    state = {name: rng.normal(size=1) for name in named}
    for name in named:
        if power.program.inputs[named[name]].role == "symbol":
            value = mechanism.symbols[name].value
            assert value is not None
            state[name] = np.array([value])
    values = {node: state[name] for name, node in named.items()}
    got = np.zeros(len(mechanism.parameters))
    for (_, c), v in zip(
        power.entries, schedule.run(FloatArithmetic(), values, 1), strict=True
    ):
        got[c] = v[0]
    q, qd, qdd = (
        np.array(
            [
                state[f"{k}[{n}]"][0] if f"{k}[{n}]" in state else 0.0
                for n in mechanism.velocities
            ]
        )
        for k in ("q", "qd", "qdd")
    )
    u = np.array([state.get(f"u[{o.name}]", np.zeros(1))[0] for o in mechanism.outputs])
    np.testing.assert_allclose(
        got, u @ evaluate_floats(rows, mechanism, q, qd, qdd)[0], rtol=1e-9, atol=1e-9
    )


@pytest.mark.parametrize(
    ("outputs", "rank"),
    [
        ([{"joint": "all"}], 43),
        ([{"joint": "joint1"}, {"joint": "joint2"}], 43),
        ([{"joint": "joint2"}], 42),
        ([{"wrench": "base"}], 48),
        ([{"joint": "all"}, {"wrench": "base"}], 48),
    ],
)
def test_xarm7(tmp_path: Path, outputs: list[object], rank: int) -> None:
    robot = set_up(tmp_path, str(robot_file("xarm7")), outputs=outputs)
    assert ec.base_structure(robot).rank == rank
    assert ec.base_parameters(robot).certificate.rank == rank


def test_ur5_base_wrench(tmp_path: Path) -> None:
    assert (
        ec.base_parameters(
            set_up(tmp_path, str(robot_file("ur5_robot")), outputs=[{"wrench": "base"}])
        ).rank
        == 41
    )


def test_an_invertible_coupling_leaves_the_inertial_rank_alone(tmp_path: Path) -> None:
    drives = {
        "m5": "45*joint5 + 3*joint6",
        "m6": "-32*joint5 + 32*joint6",
        "m1": "50*joint1",
    }
    robot = set_up(tmp_path, str(robot_file("xarm7")), actuators=drives)
    assert ec.base_parameters(robot).rank == 43
    alone = set_up(
        tmp_path,
        str(robot_file("xarm7")),
        actuators=drives,
        outputs=[{"actuator": "m6"}],
    )
    direct = set_up(tmp_path, str(robot_file("xarm7")), outputs=[{"joint": "joint6"}])
    assert ec.base_structure(alone).rank > ec.base_structure(direct).rank


def test_torques_follow_the_transmission(tmp_path: Path) -> None:
    drives = {"m5": "45*joint5 + 3*joint6", "m6": "-32*joint5 + 32*joint6"}
    robot, direct = (
        set_up(tmp_path, str(robot_file("xarm7")), actuators=drives),
        ec.load(robot_file("xarm7")),
    )
    state = np.random.default_rng(1).normal(size=(3, 7))
    tau = evaluate_floats(inverse_dynamics_regressor(direct), direct, *state)[0]
    motor = evaluate_floats(inverse_dynamics_regressor(robot), robot, *state)[0]
    names = [o.name for o in robot.outputs]
    transmission = np.array([[45, 3], [-32, 32]])
    assert names[:2] == ["m5", "m6"]
    np.testing.assert_allclose(
        transmission.T @ motor[:2], tau[4:6], rtol=1e-9, atol=1e-12
    )


def test_sensor_report_of_xarm7() -> None:
    report = sensor_report(ec.load(robot_file("xarm7")), 2)
    assert report.rank == report.ranks["base",] == 48
    assert report.ranks["joint2",] == 42
    assert report.ranks["joint1", "joint2"] == 43
    assert report.smallest == ("base",)
    assert report.proven_smallest


def test_sensors_command() -> None:
    command = ["sensors", str(ROOT / "examples" / "panda.yaml")]
    assert "smallest sufficient set: base" in CliRunner().invoke(app, command).output
    assert (
        json.loads(CliRunner().invoke(app, [*command, "--json"]).stdout)["rank"] == 48
    )


SERIAL = """<robot name="r">
<link name="root"/><link name="arm">INERTIA</link><link name="ft"/><link name="tool">INERTIA</link>
<joint name="j1" type="continuous"><parent link="root"/><child link="arm"/><axis xyz="0 1 0"/></joint>
<joint name="f1" type="fixed"><parent link="arm"/><child link="ft"/><origin xyz="0.2 0 0.1" rpy="0 0.4 0"/></joint>
<joint name="f2" type="fixed"><parent link="ft"/><child link="tool"/><origin xyz="0 0 0.1"/></joint>
</robot>""".replace(
    "INERTIA",
    '<inertial><origin xyz="0.1 0.2 0.05"/><mass value="2"/>'
    '<inertia ixx="0.1" ixy="0.01" ixz="0.02" iyy="0.2" iyz="0" izz="0.15"/></inertial>',
)


def test_sensors_may_carry_fixed_links(tmp_path: Path) -> None:
    """A sensor cuts between a fixed link and its parent: what it carries counts apart, as with a moving joint there."""
    (tmp_path / "r.urdf").write_text(SERIAL)
    (tmp_path / "setup.yaml").write_text(
        "echelon: 1\nrobot: {file: r.urdf}\noutputs: [{wrench: ft}, {joint: j1}]\n"
    )
    robot = ec.load(tmp_path / "setup.yaml")
    assert [body.name for body in robot.bodies] == ["arm", "ft"]
    moving = SERIAL.replace('name="f1" type="fixed"', 'name="f1" type="continuous"')
    (tmp_path / "r.urdf").write_text(moving)
    free = ec.load(tmp_path / "setup.yaml")
    q, qd, qdd = random_states(robot, 4)
    still = np.zeros((4, 1))
    expected = float_regressor(
        free, np.hstack([q, still]), np.hstack([qd, still]), np.hstack([qdd, still])
    )
    zeta = standard_vector(free)
    assert np.abs(expected @ zeta).max() > 1
    np.testing.assert_allclose(
        float_regressor(robot, q, qd, qdd) @ standard_vector(robot),
        expected @ zeta,
        atol=1e-12,
    )


def test_rotors_may_sit_on_fixed_links(tmp_path: Path) -> None:
    (tmp_path / "r.urdf").write_text(SERIAL)
    text = "echelon: 1\nrobot: {file: r.urdf}\nrotors: [{name: m, on: PLACE, drives: 50*j1, axis: z}]\n"
    (tmp_path / "a.yaml").write_text(text.replace("PLACE", "ft"))
    (tmp_path / "b.yaml").write_text(
        text.replace("PLACE", "arm, frame: {xyz: [0.2, 0, 0.1], rpy: [0, 0.4, 0]}")
    )
    first, second = (ec.load(tmp_path / name) for name in ("a.yaml", "b.yaml"))
    q, qd, qdd = random_states(first, 3)
    np.testing.assert_allclose(
        float_regressor(first, q, qd, qdd),
        float_regressor(second, q, qd, qdd),
        atol=1e-12,
    )


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        ({"outputs": [{"joint": "ghost"}]}, "no joint coordinate 'ghost'"),
        ({"outputs": [{"wrench": "ghost"}]}, "there is no body or frame 'ghost'"),
        ({"outputs": [{"torque": "joint1"}]}, "outputs"),
        (
            {"actuators": {"a": "joint1 + joint2", "b": "2*joint1 + 2*joint2"}},
            "singular",
        ),
        ({"actuators": {"a": "joint1 + joint2"}}, "1 actuators drive 2"),
        ({"effects": [{"type": "viscous", "at": "ghost"}]}, "no coordinate 'ghost'"),
        (
            {"effects": [{"type": "viscous", "at": "joint1", "velocity": "1"}]},
            "a viscous effect has no 'velocity'",
        ),
        (
            {
                "effects": [
                    {"parameter": "M1", "acts": [{"at": "joint1", "term": "qd"}]}
                ]
            },
            "another parameter",
        ),
        ({"outputs": [{"joint": "joint1"}, {"joint": "joint1"}]}, "two outputs"),
    ],
)
def test_bad_set_ups_are_named(
    tmp_path: Path, entries: dict[str, object], message: str
) -> None:
    with pytest.raises(ec.InputError, match=message):
        set_up(tmp_path, str(robot_file("xarm7")), **entries)


def test_a_set_up_survives_saving(tmp_path: Path) -> None:
    robot = set_up(
        tmp_path,
        str(robot_file("xarm7")),
        actuators={"m5": "45*joint5 + 3*joint6", "m6": "-32*joint5 + 32*joint6"},
        effects=[{"type": "viscous", "at": "all"}, {"type": "rotor_inertia", "at": "m5"}],
        rotors=[{"name": "r3", "on": "link2", "drives": "100*joint3"}],
        outputs=[{"actuator": "m5"}, {"joint": "joint1"}, {"wrench": "link4", "components": ["fx", "tz"]},
                 {"name": "sum", "sum": [{"joint": "joint2"}, {"actuator": "m6", "weight": "1/2"}]},
                 {"name": "pin", "unit": "N", "sum": [{"wrench": "link6", "component": "fx", "weight": "3/5"},
                                                      {"wrench": "base", "component": "fz", "weight": "4/5"}]}],
    )  # fmt: skip
    again = read_description(
        json.dumps(write_description(robot)), "again", ReadingOptions()
    )
    for field in ("bodies", "couplings", "actuators", "effects", "measured"):
        assert getattr(again, field) == getattr(robot, field)
    base = ec.base_parameters(robot)
    ec.save_base(base, tmp_path / "base.json")
    assert ec.verify(tmp_path / "base.json").rank == base.rank


def test_positions_measured_at_motors_are_those_of_joints() -> None:
    mechanism = ec.load(ROOT / "examples" / "coupled_arm.yaml")
    q = np.random.default_rng(0).uniform(-1, 1, (5, 7))
    theta = q.copy()
    for j in (1, 3, 5):
        theta[:, j], theta[:, j + 1] = q[:, j] + q[:, j + 1], q[:, j] - q[:, j + 1]
    assert np.allclose(ec.joint_side(mechanism, theta), q)
    with pytest.raises(ec.InputError, match="expected columns for j1, m2, m3"):
        ec.joint_side(mechanism, theta[:, :3])


@examples(15)
@given(mechanisms(), st.integers(0, 1000))
def test_wrenches_of_random_mechanisms_are_pinocchios(
    mechanism: ec.Mechanism, seed: int
) -> None:
    """Six-axis sensors, anywhere on any body, against the wrench that the joint above transmits."""
    rng = np.random.default_rng(seed)
    frame = Placement(
        translation=tuple(
            as_polynomial(Fraction(int(n), 10)) for n in rng.integers(-5, 6, 3)
        )
    )
    cuts = [
        Cut(body, frame, False, axis, angular).output(
            f"{body}.{'t' if angular else 'f'}{axis}", ""
        )
        for body in range(len(mechanism.bodies))
        for angular in (False, True)
        for axis in range(3)
    ]
    measured = replace(mechanism, measured=tuple(cuts))
    standard = np.zeros((len(mechanism.bodies), 10))
    carried = [index for index, body in enumerate(mechanism.bodies) if body.carried]
    standard[carried] = rng.uniform(-1, 1, (len(carried), 10)) + np.eye(10)[9] * 2
    q, qd, qdd = random_states(mechanism, 1, seed)
    y = (
        evaluate_floats(inverse_dynamics_regressor(measured), measured, q, qd, qdd)[0]
        @ standard[carried].ravel()
    )
    standard[:, 9] += 1e-30  # Pinocchio divides by masses
    truth = Constrained(mechanism, standard.ravel())
    rates = truth.couplings
    pin.rnea(
        truth.model,
        truth.data,
        truth.joint_positions(q[0]),
        rates @ qd[0],
        rates @ qdd[0],
    )
    shift = pin.SE3(np.eye(3), np.array([float(e.number) for e in frame.translation]))
    for index, output in enumerate(y.reshape(-1, 6)):
        joint, place = truth.places[index]
        wrench = (place * shift).actInv(truth.data.f[joint])
        np.testing.assert_allclose(
            output, [*wrench.linear, *wrench.angular], rtol=1e-8, atol=1e-8
        )
