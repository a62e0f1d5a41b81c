"""From columns to a recording: values, clocks of pieces, and which columns a robot needs."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import echelon as ec
from echelon.formats.robot_file import load
from echelon.identification.logs.columns.column_map import Channel, ColumnMap
from echelon.identification.logs.columns.conversion import (
    in_own_axes,
    needed_columns,
    recording,
)
from echelon.identification.logs.files.log_file import Table
from echelon.shared import Floats
from support.column_maps import PENDULUM, channels, random_columns

GRIPPER = load("examples/gripper_coupled.yaml")
TREE = load("examples/floating_tree.yaml")


def test_value_is_scale_times_column_in_si_plus_offset() -> None:
    table = Table("run", random_columns(["t", "a", "b", "tau1", "tau2", "i"]))
    columns = ColumnMap(
        time=Channel("t", "ms"),
        positions={"j1": Channel("a", "deg", -2.0, 0.5), "j2": Channel("b")},
        velocities={"j2": Channel("b", "rpm"), "j1": Channel("a", "rev/s")},
        outputs={
            "j2": Channel("tau2", "mN·m", 3.0),
            "j1": Channel("tau1", "", 1.0, -1.0),
        },
        inputs={"j1": Channel("i", "mA")},
    )
    found = recording(table, columns, PENDULUM)
    raw = table.columns
    assert np.allclose(found.time, raw["t"] / 1e3)
    assert np.allclose(
        found.signals["q"], np.stack([0.5 - 2 * np.radians(raw["a"]), raw["b"]], axis=1)
    )
    assert np.allclose(
        found.signals["qd"],
        np.stack([raw["a"] * math.tau, raw["b"] * math.tau / 60], axis=1),
    )
    assert np.allclose(
        found.signals["y"], np.stack([raw["tau1"] - 1, raw["tau2"] * 3e-3], axis=1)
    )
    assert np.allclose(found.inputs["j1"], raw["i"] / 1e3)
    assert found.signals.keys() == {"q", "qd", "y"}


def test_only_what_is_needed_is_read() -> None:
    columns = ColumnMap(
        time=Channel("t"),
        positions=channels("q{n}", ["j1", "j2"]),
        inputs={"j1": Channel("q1")},
    )
    assert needed_columns(columns) == ("t", "q1", "q2")
    with pytest.raises(
        ec.InputError,
        match=r"no column 'q2'; did you mean 'q_2'\? \(valid: t, q1, q_2\)",
    ):
        needed_columns(columns, ["t", "q1", "q_2"])
    every = r"no columns 'q1' \('q_1'\?\), 'q2' \('q_2'\?\); in brackets .*; the log has t, q_1, q_2, x"
    with pytest.raises(ec.InputError, match=every):
        needed_columns(columns, ["t", "q_1", "q_2", "x"])
    assert needed_columns(
        ColumnMap(positions={"j1": Channel("q1")}), ["q1", "stamp", "x"]
    ) == ("q1", "stamp")


def test_pieces_continue_the_clock() -> None:
    whole = random_columns(["q1", "q2"], 100)
    columns = ColumnMap(rate=250.0, positions=channels("q{n}", ["j1", "j2"]))
    first = recording(
        Table("run", {k: v[:60] for k, v in whole.items()}), columns, PENDULUM
    )
    second = recording(
        Table("run", {k: v[60:] for k, v in whole.items()}, first=60), columns, PENDULUM
    )
    assert np.array_equal(np.append(first.time, second.time), np.arange(100) / 250)


WRONG_MAPS = [
    ({}, "names no positions"),
    ({"positions": {"j1": Channel("q1")}}, "position: columns are missing for j2"),
    (
        {"positions": {"j1": Channel("q1"), "j3": Channel("q2")}},
        "position of 'j3': .* has no coordinate or actuator",
    ),
    (
        {"positions": {"j1": Channel("q1"), "j2": Channel("q_2")}},
        "no column 'q_2'; did you mean 'q2'",
    ),
    (
        {"velocities": {"j1": Channel("q1")}},
        "velocity: columns are missing for j2; give all or none",
    ),
    ({"outputs": {"j1": Channel("q1")}}, "output: columns are missing for j2"),
    (
        {"outputs": {"j1": Channel("q1"), "tau": Channel("q2")}},
        "output of 'tau': .* has no output or actuator",
    ),
    (
        {"positions": {"j1": Channel("q1", "mm"), "j2": Channel("q2")}},
        r"unit of column 'q1' \(position of 'j1'\)",
    ),
    (
        {"velocities": {"j1": Channel("q1", "deg"), "j2": Channel("q2")}},
        "angle, not of an angular velocity",
    ),
    (
        {"positions": {"j1": Channel("q1", "", 0.0), "j2": Channel("q2")}},
        "the scale not 0",
    ),
    (
        {"time": Channel("t", "deg")},
        "unit of time: 'deg' is the unit of an angle, not of a time",
    ),
    (
        {"time": None},
        "name the column with time stamps as time, or write  rate: 1000 .* could be time stamps: t",
    ),
    ({"time": None, "rate": -5.0}, "rate must be positive"),
    ({"inputs": {"j9": Channel("q1")}}, "input of 'j9'"),
]


@pytest.mark.parametrize(("changes", "problem"), WRONG_MAPS)
def test_wrong_maps_are_named(changes: dict[str, object], problem: str) -> None:
    table = Table("run.csv", random_columns(["t", "q1", "q2"]))
    valid = (
        {"time": Channel("t"), "positions": channels("q{n}", ["j1", "j2"])}
        if changes
        else {}
    )
    with pytest.raises(ec.InputError, match=rf"run\.csv: .*{problem}"):
        recording(table, ColumnMap(**{**valid, **changes}), PENDULUM)  # type: ignore[arg-type]


def test_columns_of_one_clock_have_one_length() -> None:
    table = Table("run", {"t": np.arange(5.0), "q1": np.zeros(5), "q2": np.zeros(4)})
    with pytest.raises(ec.InputError, match="different lengths: 't' 5, 'q1' 5, 'q2' 4"):
        recording(
            table,
            ColumnMap(time=Channel("t"), positions=channels("q{n}", ["j1", "j2"])),
            PENDULUM,
        )


def test_coupled_coordinates_are_not_measured_and_balls_have_four() -> None:
    names = list(GRIPPER.positions)
    assert "right" not in names
    table = Table("run", random_columns([*names, "right"]))
    found = recording(
        table, ColumnMap(rate=10, positions=channels("{name}", names)), GRIPPER
    )
    assert found.signals["q"].shape == (40, len(names))
    with pytest.raises(
        ec.InputError,
        match="position of 'right': it follows from others through a coupling",
    ):
        recording(
            table,
            ColumnMap(rate=10, positions=channels("{name}", [*names, "right"])),
            GRIPPER,
        )
    table = Table("run", random_columns(list(TREE.positions)))
    absent = next(name for name in TREE.positions if name.endswith(".y"))
    some = [name for name in TREE.positions if name != absent]
    with pytest.raises(ec.InputError, match=f"columns are missing for {absent}"):
        recording(table, ColumnMap(rate=10, positions=channels("{name}", some)), TREE)
    turned = channels("{name}", list(TREE.positions)) | {absent: Channel(absent, "deg")}
    with pytest.raises(
        ec.InputError, match="'deg' is the unit of an angle, not of a pure number"
    ):
        recording(table, ColumnMap(rate=10, positions=turned), TREE)


def test_with_loops_the_independent_coordinates_are_enough() -> None:
    robot = load("examples/loops/four_bar.yaml")
    (free,) = robot.independent_velocities
    assert len(robot.positions) > 1
    table = Table("run", random_columns(list(robot.positions)))
    some = recording(table, ColumnMap(rate=1, positions={free: Channel(free)}), robot)
    assert np.array_equal(some.signals["q"], table.columns[free][:, None])
    every = recording(
        table,
        ColumnMap(rate=1, positions=channels("{name}", list(robot.positions))),
        robot,
    )
    assert every.signals["q"].shape == (40, len(robot.positions))
    other = next(name for name in robot.positions if name != free)
    with pytest.raises(ec.InputError, match="columns are missing for"):
        recording(table, ColumnMap(rate=1, positions={other: Channel(other)}), robot)


FLOATING = """<mujoco><worldbody><body name="trunk"><freejoint name="root"/><geom size="0.1"/></body></worldbody></mujoco>"""


def velocities_of(robot: ec.Mechanism, twist: str, q: Floats, qd: Floats) -> Floats:
    return in_own_axes(robot, {"q": q, "qd": qd}, twist)


@pytest.mark.parametrize("twist", ["world", "body"])
def test_velocities_of_a_floating_base_in_other_axes(twist: str) -> None:
    rng = np.random.default_rng(3)
    robot = ec.load(FLOATING)
    q, qd = rng.normal(size=(20, 7)), rng.normal(size=(20, 6))
    pose = Rotation.from_quat(q[:, 3:], scalar_first=True)
    linear = pose.apply(qd[:, :3]) if twist == "body" else qd[:, :3]
    angular = pose.apply(qd[:, 3:], inverse=True) if twist == "world" else qd[:, 3:]
    expected = np.hstack([linear, angular])
    np.testing.assert_allclose(velocities_of(robot, twist, q, qd), expected, atol=1e-12)


@pytest.mark.parametrize("twist", ["world", "body"])
def test_a_base_that_is_held_upright_has_the_axes_of_the_world(twist: str) -> None:
    robot = ec.load(FLOATING, locked={"root.r": 0})
    q = qd = np.ones((2, 3))
    np.testing.assert_array_equal(velocities_of(robot, twist, q, qd), qd)


def test_linear_velocities_of_a_base_are_turned_together() -> None:
    robot = ec.load(FLOATING, locked={"root.tx": 0})
    with pytest.raises(ec.InputError, match="lock none of its translations, or all"):
        velocities_of(robot, "body", np.ones((2, 6)), np.ones((2, 5)))
