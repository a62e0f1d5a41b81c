"""Columns found by their names; what is not clear is not guessed."""

from __future__ import annotations

import pytest

import echelon as ec
from echelon.logs.columns.column_guess import guess_columns
from echelon.logs.columns.column_map import Channel
from echelon.logs.columns.conversion import recording
from echelon.logs.files.log_file import Table
from support.column_maps import MOTORS, PENDULUM, TX40, random_columns

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
]


@pytest.mark.parametrize("names", SPELLINGS)
def test_usual_spellings_are_understood(names: str) -> None:
    columns = names.split()
    found = guess_columns(columns, PENDULUM)
    ends = {"j1": ("1", "[0]"), "j2": ("2", "[1]")}
    for group in (found.positions, found.outputs):
        assert list(group) == ["j1", "j2"]
        for name, channel in group.items():
            assert channel.column.endswith(ends[name]) or name in channel.column
    if not names.startswith("/"):
        assert found.time is not None
        assert found.time.column == columns[0]
    table = Table("run", random_columns(columns))
    if found.time:
        recording(table, found, PENDULUM)


def test_units_in_names_count() -> None:
    found = guess_columns(["Time [ms]", "q_deg_1", "q_deg_2", "Torque1 (mNm)", "Torque2 (mNm)"], PENDULUM)
    assert found.time == Channel("Time [ms]", "ms")
    assert [c.unit for c in found.positions.values()] == ["deg", "deg"]
    assert [c.unit for c in found.outputs.values()] == ["mNm", "mNm"]


def test_motors_are_told_from_joints() -> None:
    names = ["t_s"] + [f"q_motor_rad_{n}" for n in range(1, 7)] + [f"tau_motor_Nm_{n}" for n in range(1, 7)]
    found = guess_columns(names, TX40)
    assert list(found.positions) == list(found.outputs) == MOTORS
    with pytest.raises(ec.InputError, match=r"measured at motors by their names, but .* states no"):
        guess_columns(["t_s", "q_motor_1", "q_motor_2", "tau1", "tau2"], PENDULUM)


UNCLEAR = [
    ("t q1 q2", "no columns for outputs of .* can be told from their names"),
    ("a b c", "no columns for positions and outputs"),
    (
        "t q1 q2 q3 tau1 tau2 tau3",
        r"a position for 3 \(numbers 1, 2, 3\), q1, q2, q3, but .* has 2: j1, j2; is it a log of another robot",
    ),
    ("t q1 tau1 tau2", "has a position for 1 "),
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
    found = guess_columns(["t", "q1", "q2", "qd1", "qd2", "qd_ref1"], PENDULUM, outputs=False)
    assert not found.outputs
    assert list(found.velocities) == ["j1", "j2"]
