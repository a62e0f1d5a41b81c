"""Columns found by their names; what is not clear is not guessed."""

from __future__ import annotations

import re

import numpy as np
import numpy.typing as npt
import pytest

import echelon as ec
from echelon.identification.logs.columns.column_map import Channel
from echelon.identification.logs.columns.column_names import meaning
from echelon.identification.logs.columns.conversion import recording
from echelon.identification.logs.columns.magnitudes import with_units
from echelon.identification.logs.files.log_file import Table
from support.column_maps import MOTORS, PENDULUM, TX40, guess_columns, random_columns

Floats = npt.NDArray[np.float64]
ARM = """<robot name="arm"><link name="a"/><link name="b"/><link name="c"/>
<joint name="shoulder_joint" type="continuous"><parent link="a"/><child link="b"/></joint>
<joint name="elbow_joint" type="continuous"><parent link="b"/><child link="c"/><axis xyz="0 1 0"/></joint></robot>"""

SPELLINGS = [
    "t q1 q2 tau1 tau2",
    "time q_1 q_2 tau_1 tau_2",
    "t_s q_rad_1 q_rad_2 tau_Nm_1 tau_Nm_2",
    "timestamp pos1 pos2 torque1 torque2",
    "time pos_meas1 pos_meas2 tau_meas1 tau_meas2 tau_con1 tau_fric2 pos_filt1 pos_filt2",
    "t position[0] position[1] torques[0] torques[1]",
    "time position_j1 position_j2 effort_j1 effort_j2",
    "stamp j1_pos j2_pos j1_tau j2_tau",
    "/joint_states/position/j2 /joint_states/position/j1 /joint_states/effort/j1 /joint_states/effort/j2",
    "/joint_states/position[0] /joint_states/position[1] /joint_states/effort[0] /joint_states/effort[1] /x/y",
    "/arm/left/joint_states/position/j1 /arm/left/joint_states/position/j2 /arm/left/joint_states/effort/j1 "
    "/arm/left/joint_states/effort/j2",
    "%time field.position0 field.position1 field.velocity0 field.velocity1 field.effort0 field.effort1",
    "time joint_0 joint_1 torque_0 torque_1",
    "t j1 j2 torque_j1 torque_j2",
    "t axis1_q1 axis2_q2 axis1_tau1 axis2_tau2",
    "t joint_1_rad joint_2_rad joint_1_Nm joint_2_Nm",
    # RTDE
    "timestamp actual_q_0 actual_q_1 target_q_0 target_q_1 actual_qd_0 actual_qd_1 actual_current_0 actual_current_1 "
    "target_moment_0 target_moment_1 actual_TCP_pose_0 actual_TCP_pose_1 joint_temperatures_0 joint_temperatures_1",
    # libfranka
    "time success_rate state.q[0] state.q[1] state.q_d[0] state.q_d[1] state.dq[0] state.dq[1] state.tau_J[0] "
    "state.tau_J[1] state.tau_ext_hat_filtered[0] state.tau_ext_hat_filtered[1] cmd.q_d[0] cmd.q_d[1] cmd.tau_J_d[0]",
    # FRI: ROS, Java, pyfri
    "time measured_joint_position_0 measured_joint_position_1 commanded_joint_position_0 commanded_joint_position_1 "
    "measured_torque_0 measured_torque_1 external_torque_0 external_torque_1",
    "time axisQMsr[0] axisQMsr[1] axisTorqueMsr[0] axisTorqueMsr[1] axisTauExtMsr[0] axisTauExtMsr[1]",
    "time index record_time_nsec tsec tnsec mp1 mp2 ip1 ip2 mt1 mt2 et1 et2 dt",
    # LeRobot and MuJoCo
    "timestamp observation.state[0] observation.state[1] action[0] action[1] observation.effort[0] "
    "observation.effort[1]",
    "timestamp observation.state/j1.pos observation.state/j2.pos action/j1.pos action/j2.pos observation.effort/j1 "
    "observation.effort/j2 frame_index",
    "time qpos[0] qpos[1] qvel[0] qvel[1] qfrc_actuator[0] qfrc_actuator[1]",
    "/PSM1/measured_js/position[0] /PSM1/measured_js/position[1] /PSM1/measured_js/effort[0] "
    "/PSM1/measured_js/effort[1] /PSM1/setpoint_js/position[0] /PSM1/setpoint_js/position[1]",
    "stamp position[j1] position[j2] velocity[j1] velocity[j2] effort[j1] effort[j2]",
    "timestamp observations/qpos[0] observations/qpos[1] observations/effort[0] "
    "observations/effort[1] action[0] action[1]",
]


@pytest.mark.parametrize("names", SPELLINGS)
def test_usual_spellings_are_understood(names: str) -> None:
    columns = names.split()
    found = guess_columns(columns, PENDULUM)
    for group in (found.positions, found.outputs):
        assert list(group) == ["j1", "j2"]
        for name, channel in group.items():
            number = int(re.findall(r"\d+", channel.column)[-1])
            first = int(re.findall(r"\d+", group["j1"].column)[-1])
            assert number - first == ("j1", "j2").index(name)
    if not names.startswith("/"):
        assert found.time is not None
        assert found.time.column == columns[0]
    table = Table("run", random_columns(columns))
    if found.time:
        recording(table, found, PENDULUM)


def test_units_in_names_count() -> None:
    found = guess_columns(
        ["Time [ms]", "q_deg_1", "q_deg_2", "Torque1 (mNm)", "Torque2 (mNm)"], PENDULUM
    )
    assert found.time == Channel("Time [ms]", "ms")
    assert [c.unit for c in found.positions.values()] == ["deg", "deg"]
    assert [c.unit for c in found.outputs.values()] == ["mNm", "mNm"]
    beside = {"t": "ms", "q1": "deg", "q2": "deg", "tau1": "mNm", "tau2": "mNm"}
    stated = guess_columns(
        list(beside),
        PENDULUM,
        said={name: f"{name} [{unit}]" for name, unit in beside.items()},
    )
    for kind, group in stated.channels.items():
        assert [c.unit for c in group.values()] == [
            c.unit for c in found.channels[kind].values()
        ]


def test_references_of_the_usual_recorders_are_found() -> None:
    for names in (
        "q_1 q_2 target_q_1 target_q_2",
        "state[0] state[1] action[0] action[1]",
        "q1 q2 cmd.q_d[0] cmd.q_d[1]",
    ):
        found = guess_columns(names.split(), PENDULUM, outputs=False)
        assert [
            channel.column for channel in found.references.values()
        ] == names.split()[2:]


def test_names_of_joints_count_with_and_without_their_ending() -> None:
    robot = ec.load(ARM)
    for names in (
        "t shoulder_pos elbow_pos shoulder_torque elbow_torque",
        "time Shoulder Elbow tau_shoulder tau_elbow",
    ):
        found = guess_columns(names.split(), robot)
        assert [
            channel.column for channel in found.positions.values()
        ] == names.split()[1:3]
        assert list(found.outputs) == ["shoulder_joint", "elbow_joint"]


def swinging(count: int = 600, rate: float = 200.0) -> dict[str, Floats]:
    """A motion of two joints with its velocity, what the controller asked for, and forces that are rough."""
    t = np.arange(count) / rate
    w = np.array([2.1, 3.7])
    q, v = np.sin(t[:, None] * w), w * np.cos(t[:, None] * w)
    random = np.random.default_rng(2)
    force = q[:, ::-1] * [3, 5] + np.sign(v) + 0.2 * random.normal(size=q.shape)
    return {"t": t, "q": q, "v": v, "u": force, "r": np.sin((t[:, None] + 0.01) * w)}


@pytest.mark.parametrize("order", ["tqu", "tqvu", "tqruv", "tuqv", "tvqu", "qvut"])
@pytest.mark.parametrize("counter", [False, True])
def test_columns_without_names_are_told_by_their_values(
    order: str, counter: bool
) -> None:
    motion = swinging()
    table = np.column_stack([motion[letter] for letter in order])
    places = {letter: 2 * k - (k > order.index("t")) for k, letter in enumerate(order)}
    if counter:
        table = np.column_stack([np.arange(len(table)), table])
        places = {letter: place + 1 for letter, place in places.items()}
    content = {str(k): table[:, k] for k in range(table.shape[1])}
    found = guess_columns(
        list(content), PENDULUM, "log.csv", look=lambda: Table("log.csv", content)
    )
    assert found.time == Channel(str(places["t"]))
    for letter, group in {
        "q": found.positions,
        "u": found.outputs,
        "v": found.velocities,
    }.items():
        if letter in order:
            assert [int(channel.column) for channel in group.values()] == [
                places[letter],
                places[letter] + 1,
            ]


def test_columns_that_do_not_fit_are_all_listed_with_the_nearest_guesses() -> None:
    motion = swinging()
    content = {f"ax_{k}_enkoder": motion["q"][:, k] for k in range(2)} | {
        "temprature": motion["t"]
    }
    content |= {f"M{k}": motion["u"][:, k] for k in range(2)} | {
        "torqe_9": motion["t"],
        "t": motion["t"],
    }
    with pytest.raises(ec.InputError) as caught:
        guess_columns(
            list(content), PENDULUM, "log.csv", look=lambda: Table("log.csv", content)
        )
    for part in (
        "log.csv: no position and output columns of double pendulum",
        "ax_0_enkoder … ax_1_enkoder (positions, judging by their values)",
        "M0 … M1 (outputs, judging by their values)",
        "temprature (temperature?)",
        "torqe_9 (output?)",
    ):
        assert part in str(caught.value)


def test_magnitudes_decide_about_units_that_no_name_states() -> None:
    motion = swinging()
    degrees = 180 / np.pi
    content = {"t": 1e3 * motion["t"]}
    for k in range(2):
        content |= {
            f"q{k}": degrees * motion["q"][:, k],
            f"v{k}": degrees * motion["v"][:, k],
        }
        content |= {f"tau{k}": motion["u"][:, k]}
    columns = guess_columns(list(content), PENDULUM)
    found, notes = with_units(columns, Table("log.csv", content), PENDULUM)
    assert found.time == Channel("t", "ms")
    assert found.positions["j1"].unit == "deg"
    assert found.velocities["j1"].unit == "deg/s"
    assert [finding.kind for finding in notes] == ["units", "units"]
    plain = {
        name: values / 1e3 if name == "t" else values / degrees
        for name, values in content.items()
    }
    assert with_units(columns, Table("log.csv", plain), PENDULUM) == (columns, ())


def test_lengths_of_hundreds_are_millimetres() -> None:
    text = "echelon: 1\nbodies: [{name: cart, joint: {type: prismatic, axis: x}}]\n"
    content = {
        "t": np.arange(50) / 100,
        "pos": 300 * np.sin(np.arange(50) / 10),
        "force": np.ones(50),
    }
    robot = ec.load(text)
    found, notes = with_units(
        guess_columns(list(content), robot), Table("log.csv", content), robot
    )
    assert [channel.unit for channel in found.positions.values()] == ["mm"]
    assert "are read as mm" in notes[0].text


def test_velocities_of_slides_are_in_what_their_positions_say() -> None:
    """Names of joints may be the last hump of a column's."""
    text = "echelon: 1\nbodies: [{name: cart, joint: {name: X, type: prismatic, axis: x}}]\n"
    t, robot = np.arange(500) / 1000, ec.load(text)
    content = {
        "Time": t,
        "PosX": 300 * np.sin(9 * t),
        "VelX": 2700 * np.cos(9 * t),
        "ForceX": np.ones(500),
    }
    found, _ = with_units(
        guess_columns(list(content), robot), Table("log.csv", content), robot
    )
    assert (found.positions["X"].unit, found.velocities["X"].unit) == ("mm", "mm/s")


def test_motors_are_told_from_joints() -> None:
    names = (
        ["t_s"]
        + [f"q_motor_rad_{n}" for n in range(1, 7)]
        + [f"tau_motor_Nm_{n}" for n in range(1, 7)]
    )
    found = guess_columns(names, TX40)
    assert list(found.positions) == list(found.outputs) == MOTORS
    told = guess_columns(["t_s", "q1", "q2", "motor_tau1", "motor_tau2"], PENDULUM)
    assert list(told.outputs) == ["j1", "j2"]
    with pytest.raises(ec.InputError, match=r"have names of motors, but .* states no"):
        guess_columns(["t_s", "q_motor_1", "q_motor_2", "tau1", "tau2"], PENDULUM)


UNCLEAR = [
    ("t q1 q2", "no output columns of .* recognised"),
    ("a b c", "no position and output columns of"),
    (
        "t q1 q2 q3 tau1 tau2 tau3",
        r"has 3 positions \(numbers 1, 2, 3\), q1, q2, q3, but .* has 2: j1, j2; is it a log of another robot",
    ),
    ("t q1 tau1 tau2", "has 1 position "),
    ("t q_meas tau1 tau2", "has one position, q_meas, but"),
    ("t q1 q2 pos1 tau1 tau2", "'q1' and 'pos1' could both be the position of 'j1'"),
    ("t time q1 q2 tau1 tau2", "t, time could all be the time"),
    ("t position_j1 tau1 tau2", "no column is the position of j2"),
]


@pytest.mark.parametrize(("names", "problem"), UNCLEAR)
def test_what_is_not_clear_is_not_guessed(names: str, problem: str) -> None:
    with pytest.raises(ec.InputError, match=f"log.csv: .*{problem}"):
        guess_columns(names.split(), PENDULUM, "log.csv")


def test_outputs_may_be_missing_where_they_are_not_needed() -> None:
    found = guess_columns(
        ["t", "q1", "q2", "qd1", "qd2", "qd_ref1"], PENDULUM, outputs=False
    )
    assert not found.outputs
    assert list(found.velocities) == ["j1", "j2"]


def test_numbers_of_thousands_of_digits_are_no_joints() -> None:
    """Python refuses to read them as integers."""
    assert meaning("q_" + "7" * 5000, {}) is None
    assert meaning("q_7", {}) is not None
