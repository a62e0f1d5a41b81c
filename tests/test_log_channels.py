"""From columns to a recording: units, names, sides of the gears, clocks, and columns found by their names."""

from __future__ import annotations

import math
import os
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

import echelon as ec
from echelon.formats.load import load
from echelon.logs.channels import needed_columns, recording
from echelon.logs.column_map import Channel, ColumnMap
from echelon.logs.guess import columns_text, guess_columns
from echelon.logs.table import Table
from echelon.logs.units import factor

Floats = npt.NDArray[np.float64]

DATA = Path(os.environ.get("ECHELON_DATA", Path(__file__).parent.parent.parent / "shared" / "data"))

PENDULUM = load("examples/double_pendulum.yaml")
TX40 = load("examples/tx40.yaml")
COUPLED = load("examples/coupled_arm.yaml")
GRIPPER = load("examples/gripper_coupled.yaml")
TREE = load("examples/floating_tree.yaml")
PANDA = load("examples/panda.yaml")


def channels(pattern: str, names: tuple[str, ...] | list[str], **settings: str | float) -> dict[str, Channel]:
    return {name: Channel(pattern.format(n=n, name=name), **settings) for n, name in enumerate(names, 1)}  # type: ignore[arg-type]


def random_columns(names: list[str], count: int = 40, seed: int = 3) -> dict[str, Floats]:
    random = np.random.default_rng(seed)
    return {name: random.normal(size=count) for name in names}


# -- units ------------------------------------------------------------------------------------------------------------

G = 9.80665
FACTORS = [
    ("rad", "rad", 1.0),
    ("deg", "rad", math.radians(1)),
    ("°", "rad", math.radians(1)),
    ("rev", "rad", math.tau),
    ("turn", "rad", math.tau),
    ("mrad", "rad", 1e-3),
    ("grad", "rad", math.pi / 200),
    ("arcmin", "rad", math.radians(1 / 60)),
    ("deg/s", "rad/s", math.radians(1)),
    ("°/s", "rad/s", math.radians(1)),
    ("rpm", "rad/s", math.tau / 60),
    ("rev/min", "rad/s", math.tau / 60),
    ("RPM", "rad/s", math.tau / 60),
    ("rev/s", "rad/s", math.tau),
    ("deg/s^2", "rad/s²", math.radians(1)),
    ("rad s^-2", "rad/s²", 1.0),
    ("deg/s/s", "rad/s²", math.radians(1)),
    ("mm", "m", 1e-3),
    ("cm", "m", 1e-2),
    ("um", "m", 1e-6),
    ("µm", "m", 1e-6),
    ("in", "m", 0.0254),
    ("mm/s", "m/s", 1e-3),
    ("m / s", "m/s", 1.0),
    ("mm/s²", "m/s²", 1e-3),
    ("N·m", "N·m", 1.0),
    ("Nm", "N·m", 1.0),
    ("N*m", "N·m", 1.0),
    ("N m", "N·m", 1.0),
    ("mNm", "N·m", 1e-3),
    ("mN·m", "N·m", 1e-3),
    ("Nmm", "N·m", 1e-3),
    ("N·mm", "N·m", 1e-3),
    ("kgf·cm", "N·m", G / 100),
    ("kgf*m", "N·m", G),
    ("lbf·in", "N·m", 0.45359237 * G * 0.0254),
    ("in-lbf", "N·m", 0.45359237 * G * 0.0254),
    ("lbf.ft", "N·m", 0.45359237 * G * 0.3048),
    ("ozf·in", "N·m", 0.45359237 / 16 * G * 0.0254),
    ("kg·m²/s²", "N·m", 1.0),
    ("kN", "N", 1e3),
    ("mN", "N", 1e-3),
    ("lbf", "N", 0.45359237 * G),
    ("mA", "A", 1e-3),
    ("mV", "V", 1e-3),
    ("ms", "s", 1e-3),
    ("us", "s", 1e-6),
    ("µs", "s", 1e-6),
    ("ns", "s", 1e-9),
    ("min", "s", 60.0),
    ("", "N·m", 1.0),
]


@pytest.mark.parametrize(("unit", "quantity", "expected"), FACTORS)
def test_factors(unit: str, quantity: str, expected: float) -> None:
    assert factor(unit, quantity) == pytest.approx(expected, rel=4e-16)


WRONG = [
    ("mm", "rad", r"'mm' is the unit of a length, not of an angle \(valid: rad, deg, °"),
    ("deg/s", "rad", "of an angular velocity, not of an angle"),
    ("A", "N·m", "of a current, not of a torque"),
    ("N", "N·m", "of a force, not of a torque"),
    ("nm", "N·m", "of a length, not of a torque"),
    ("lb·in", "N·m", "something else, not of a torque"),
    ("degre", "rad", "'degre' is not a unit; did you mean 'deg'"),
    ("N·", "N", "'N·' is not a unit"),
    ("rad/", "rad", "'rad/' is not a unit"),
    ("(rad)", "rad", "not a unit"),
    ("counts", "rad", "has no size of its own.*scale"),
]


@pytest.mark.parametrize(("unit", "quantity", "problem"), WRONG)
def test_wrong_units_say_what_would_be_right(unit: str, quantity: str, problem: str) -> None:
    with pytest.raises(ec.InputError, match=problem):
        factor(unit, quantity)


@given(st.sampled_from(["N", "m", "s", "rad", "A"]), st.sampled_from(["m", "s", "A"]), st.integers(1, 3))
def test_products_and_quotients_are_what_they_say(first: str, second: str, power: int) -> None:
    prefixed = f"k{first}/m{second}^{power}"
    assert factor(prefixed, f"{first}/{second}^{power}") == pytest.approx(1e3 / 1e-3**power, rel=1e-15)
    assert factor(f"m{first}*k{second}", f"{first}·{second}") == pytest.approx(1.0, rel=1e-15)


# -- values -----------------------------------------------------------------------------------------------------------


def test_value_is_scale_times_column_in_si_plus_offset() -> None:
    table = Table("run", random_columns(["t", "a", "b", "tau1", "tau2", "i"]))
    columns = ColumnMap(
        time=Channel("t", "ms"),
        positions={"j1": Channel("a", "deg", -2.0, 0.5), "j2": Channel("b")},
        velocities={"j2": Channel("b", "rpm"), "j1": Channel("a", "rev/s")},
        outputs={"j2": Channel("tau2", "mN·m", 3.0), "j1": Channel("tau1", "", 1.0, -1.0)},
        inputs={"j1": Channel("i", "mA")},
    )
    found = recording(table, columns, PENDULUM)
    raw = table.columns
    assert np.allclose(found.time, raw["t"] / 1e3)
    assert np.allclose(found.signals["q"], np.stack([0.5 - 2 * np.radians(raw["a"]), raw["b"]], axis=1))
    assert np.allclose(found.signals["qd"], np.stack([raw["a"] * math.tau, raw["b"] * math.tau / 60], axis=1))
    assert np.allclose(found.signals["y"], np.stack([raw["tau1"] - 1, raw["tau2"] * 3e-3], axis=1))
    assert np.allclose(found.inputs["j1"], raw["i"] / 1e3)
    assert found.signals.keys() == {"q", "qd", "y"}


def test_only_what_is_needed_is_read() -> None:
    columns = ColumnMap(time=Channel("t"), positions=channels("q{n}", ["j1", "j2"]), inputs={"j1": Channel("q1")})
    assert needed_columns(columns) == ("t", "q1", "q2")
    with pytest.raises(ec.InputError, match=r"no column 'q2'; did you mean 'q_2'\? \(valid: t, q1, q_2\)"):
        needed_columns(columns, ["t", "q1", "q_2"])
    assert needed_columns(ColumnMap(positions={"j1": Channel("q1")}), ["q1", "stamp", "x"]) == ("q1", "stamp")


def test_pieces_continue_the_clock() -> None:
    whole = random_columns(["q1", "q2"], 100)
    columns = ColumnMap(rate=250.0, positions=channels("q{n}", ["j1", "j2"]))
    first = recording(Table("run", {k: v[:60] for k, v in whole.items()}), columns, PENDULUM)
    second = recording(Table("run", {k: v[60:] for k, v in whole.items()}, first=60), columns, PENDULUM)
    assert np.array_equal(np.append(first.time, second.time), np.arange(100) / 250)


WRONG_MAPS = [
    ({}, "names no positions"),
    ({"positions": {"j1": Channel("q1")}}, "position: columns are missing for j2"),
    ({"positions": {"j1": Channel("q1"), "j3": Channel("q2")}}, "position of 'j3': .* has no coordinate or actuator"),
    ({"positions": {"j1": Channel("q1"), "j2": Channel("q_2")}}, "no column 'q_2'; did you mean 'q2'"),
    ({"velocities": {"j1": Channel("q1")}}, "velocity: columns are missing for j2; give all or none"),
    ({"outputs": {"j1": Channel("q1")}}, "output: columns are missing for j2"),
    ({"outputs": {"j1": Channel("q1"), "tau": Channel("q2")}}, "output of 'tau': .* has no output or actuator"),
    ({"positions": {"j1": Channel("q1", "mm"), "j2": Channel("q2")}}, r"unit of column 'q1' \(position of 'j1'\)"),
    ({"velocities": {"j1": Channel("q1", "deg"), "j2": Channel("q2")}}, "angle, not of an angular velocity"),
    ({"positions": {"j1": Channel("q1", "", 0.0), "j2": Channel("q2")}}, "the scale not 0"),
    ({"time": Channel("t", "deg")}, "unit of time: 'deg' is the unit of an angle, not of a time"),
    ({"time": None}, "name the column with time stamps as time, or give rate: .* could be time stamps: t"),
    ({"time": None, "rate": -5.0}, "rate must be positive"),
    ({"inputs": {"j9": Channel("q1")}}, "input of 'j9'"),
]


@pytest.mark.parametrize(("changes", "problem"), WRONG_MAPS)
def test_wrong_maps_are_named(changes: dict[str, object], problem: str) -> None:
    table = Table("run.csv", random_columns(["t", "q1", "q2"]))
    valid = {"time": Channel("t"), "positions": channels("q{n}", ["j1", "j2"])} if changes else {}
    with pytest.raises(ec.InputError, match=rf"run\.csv: .*{problem}"):
        recording(table, ColumnMap(**{**valid, **changes}), PENDULUM)  # type: ignore[arg-type]


def test_columns_of_one_clock_have_one_length() -> None:
    table = Table("run", {"t": np.arange(5.0), "q1": np.zeros(5), "q2": np.zeros(4)})
    with pytest.raises(ec.InputError, match="different lengths: 't' 5, 'q1' 5, 'q2' 4"):
        recording(table, ColumnMap(time=Channel("t"), positions=channels("q{n}", ["j1", "j2"])), PENDULUM)


def test_coupled_coordinates_are_not_measured_and_balls_have_four() -> None:
    names = list(GRIPPER.positions)
    assert "right" not in names
    table = Table("run", random_columns([*names, "right"]))
    found = recording(table, ColumnMap(rate=10, positions=channels("{name}", names)), GRIPPER)
    assert found.signals["q"].shape == (40, len(names))
    with pytest.raises(ec.InputError, match="position of 'right': it follows from others through a coupling"):
        recording(table, ColumnMap(rate=10, positions=channels("{name}", [*names, "right"])), GRIPPER)
    table = Table("run", random_columns(list(TREE.positions)))
    absent = next(name for name in TREE.positions if name.endswith(".y"))
    some = [name for name in TREE.positions if name != absent]
    with pytest.raises(ec.InputError, match=f"columns are missing for {absent}"):
        recording(table, ColumnMap(rate=10, positions=channels("{name}", some)), TREE)
    turned = channels("{name}", list(TREE.positions)) | {absent: Channel(absent, "deg")}
    with pytest.raises(ec.InputError, match="'deg' is the unit of an angle, not of a pure number"):
        recording(table, ColumnMap(rate=10, positions=turned), TREE)


# -- sides of the gears -----------------------------------------------------------------------------------------------

N = np.diag([32.0, 32, 45, -48, 45, 32])
N[5, 4] = 32.0
"""θ = N q of the TX40, as its README in the measured logs says; τ_q = Nᵀ τ_θ."""

MOTORS = ["m1", "m2", "m3", "m4", "m5", "m6"]


def test_motor_side_of_a_coupled_wrist() -> None:
    table = Table("run", random_columns([f"q{n}" for n in range(1, 7)] + [f"tau{n}" for n in range(1, 7)]))
    raw = np.stack(list(table.columns.values()), axis=1)
    turned = channels("q{n}", MOTORS) | {"m2": Channel("q2", offset=-16 * math.pi)}
    columns = ColumnMap(rate=5000, positions=turned, references=turned, outputs=channels("tau{n}", MOTORS))
    found = recording(table, columns, TX40)
    expected = np.linalg.solve(N, raw[:, :6].T).T - np.array([0, math.pi / 2, 0, 0, 0, 0])
    assert np.allclose(found.signals["q"], expected, atol=1e-14)
    assert np.allclose(found.signals["reference"], expected, atol=1e-14)
    assert np.allclose(found.signals["y"], raw[:, 6:] @ N, rtol=1e-13)


def test_both_sides_may_be_mixed_where_that_determines_all() -> None:
    names = list(TX40.positions)
    q = np.random.default_rng(0).normal(size=(30, 6))
    theta = q @ N.T
    table = Table("run", {f"q{n + 1}": q[:, n] for n in range(6)} | {f"m{n + 1}": theta[:, n] for n in range(6)})

    def read(*keys: str) -> Floats:
        own = {name: Channel("q" + name[1:]) for name in names}
        chosen = {key: own.get(key, Channel(key)) for key in keys}
        return recording(table, ColumnMap(rate=1, positions=chosen), TX40).signals["q"]

    for keys in (["j1", "j2", "j3", "m4", "j5", "m6"], ["m1", "j2", "m3", "m4", "m6", "j6"], [*MOTORS[:4], "m6", "m5"]):
        assert np.allclose(read(*keys), q, atol=1e-12)
    with pytest.raises(ec.InputError, match="columns are missing for j5, or for the actuators m5, m6"):
        read("j1", "j2", "j3", "j4", "j6")
    with pytest.raises(ec.InputError, match="both sides of a gear"):
        read(*MOTORS, "j1")
    with pytest.raises(ec.InputError, match="m1, m2, m3, m4 alone do not determine"):
        read(*MOTORS[:4])
    with pytest.raises(ec.InputError, match="m4 do not determine j5"):
        read("j1", "j2", "j3", "j4", "m4", "j6")


def test_velocities_of_motors_and_units_of_either_kind() -> None:
    names = [a.name for a in COUPLED.actuators]
    table = Table("run", random_columns(["j1", *names]))
    columns = ColumnMap(
        rate=1,
        positions={"j1": Channel("j1")} | channels("{name}", names),
        velocities={"j1": Channel("j1", "rpm")} | channels("{name}", names, unit="rpm"),
    )
    found = recording(table, columns, COUPLED)
    side = ec.joint_side(COUPLED, np.stack([table.columns[n] for n in ["j1", *names]], axis=1))
    assert np.allclose(found.signals["q"], side)
    assert np.allclose(found.signals["qd"], side * math.tau / 60)


def test_forces_that_are_not_those_of_joints_are_refused() -> None:
    names = list(TX40.positions)
    table = Table("run", random_columns([*names, *MOTORS]))
    positions = channels("{name}", names)
    with pytest.raises(ec.InputError, match="output 'j5': a column is missing for it, or for the actuator 'm6'"):
        recording(table, ColumnMap(rate=1, positions=positions, outputs=channels("{name}", MOTORS[:5])), TX40)
    mixed = channels("{name}", [*names[:5], "j6", "m6"])
    with pytest.raises(ec.InputError, match="output of 'm6': no output needs it"):
        recording(table, ColumnMap(rate=1, positions=positions, outputs=mixed), TX40)
    # the coupled arm measures its actuators' forces, which joint torques are not: there is friction in the drives
    torques = channels("{name}", [*COUPLED.velocities])
    table = Table("run", random_columns(list(COUPLED.velocities)))
    columns = ColumnMap(rate=1, positions=channels("{name}", list(COUPLED.positions)), outputs=torques)
    with pytest.raises(ec.InputError, match="output of 'j2': coupled arm has no output or actuator"):
        recording(table, columns, COUPLED)


def test_friction_in_the_drive_stands_between_motor_and_joint(tmp_path: Path) -> None:
    text = (
        Path("examples/tx40.yaml")
        .read_text()
        .replace("{type: viscous, at: all, side: joint}", "{type: viscous, at: m6}")
    )
    assert "at: m6" in text
    file = tmp_path / "arm.yaml"
    file.write_text(text)
    arm = load(file)
    table = Table("run", random_columns([*arm.positions, *MOTORS]))
    columns = ColumnMap(rate=1, positions=channels("{name}", list(arm.positions)), outputs=channels("{name}", MOTORS))
    with pytest.raises(ec.InputError, match="actuator 'm6' differs from that at the joint by the effect 'Fv6'"):
        recording(table, columns, arm)


def test_with_loops_the_independent_coordinates_are_enough() -> None:
    robot = load("examples/loops/four_bar.yaml")
    (free,) = robot.independent_velocities
    assert len(robot.positions) > 1
    table = Table("run", random_columns(list(robot.positions)))
    some = recording(table, ColumnMap(rate=1, positions={free: Channel(free)}), robot)
    assert np.array_equal(some.signals["q"], table.columns[free][:, None])
    every = recording(table, ColumnMap(rate=1, positions=channels("{name}", list(robot.positions))), robot)
    assert every.signals["q"].shape == (40, len(robot.positions))
    other = next(name for name in robot.positions if name != free)
    with pytest.raises(ec.InputError, match="columns are missing for"):
        recording(table, ColumnMap(rate=1, positions={other: Channel(other)}), robot)


# -- clocks -----------------------------------------------------------------------------------------------------------


def bag(shift: float = 0.0) -> Table:
    states, wrench = np.arange(0, 2, 0.01), np.arange(0.3, 1.5, 0.004) + shift
    return Table(
        "bag",
        {
            "/s/time": states,
            "/s/q1": np.sin(states),
            "/s/q2": np.cos(states),
            "/w/time": wrench,
            "/w/t1": 2 * wrench + 1,
            "/w/t2": -wrench,
        },
        {"/s/q1": "/s/time", "/s/q2": "/s/time", "/w/t1": "/w/time", "/w/t2": "/w/time"},
    )


TOPICS = ColumnMap(positions=channels("/s/q{n}", ["j1", "j2"]), outputs=channels("/w/t{n}", ["j1", "j2"]))


def test_topics_come_onto_the_clock_of_the_positions() -> None:
    found = recording(bag(), TOPICS, PENDULUM)
    wrench = bag().columns["/w/time"]
    assert found.time[0] >= wrench[0]
    assert found.time[-1] <= wrench[-1]
    assert np.allclose(np.diff(found.time), 0.01)
    assert np.array_equal(found.signals["q"][:, 0], np.sin(found.time))
    assert np.allclose(found.signals["y"], np.stack([2 * found.time + 1, -found.time], axis=1), atol=1e-12)


def test_topics_are_not_made_up_in_pauses_or_beyond_their_ends() -> None:
    table = bag()
    keep = (table.columns["/w/time"] < 0.8) | (table.columns["/w/time"] > 1.0)
    cut = {name: values[keep] if name.startswith("/w") else values for name, values in table.columns.items()}
    found = recording(Table("bag", cut, table.clocks), TOPICS, PENDULUM)
    pause = np.isnan(found.signals["y"]).all(axis=1)
    stamps = cut["/w/time"]
    ends = stamps[stamps < 0.9].max(), stamps[stamps > 0.9].min()
    assert np.array_equal(pause, (found.time > ends[0]) & (found.time < ends[1]))
    assert 18 <= pause.sum() <= 21
    assert not np.isnan(found.signals["q"]).any()
    with pytest.raises(ec.InputError, match="no time in common"):
        recording(bag(10.0), TOPICS, PENDULUM)
    back = dict(table.columns)
    back["/w/time"] = back["/w/time"].copy()
    back["/w/time"][50] = 0.0
    with pytest.raises(ec.InputError, match="'/w/t1': its time stamps go backwards at row 50"):
        recording(Table("bag", back, table.clocks), TOPICS, PENDULUM)


def test_a_time_column_may_replace_the_stamps_of_its_own_topic() -> None:
    table = bag()
    stamp = {"/s/stamp": table.columns["/s/time"] * 1e3 + 7}
    clocks = {**table.clocks, "/s/stamp": "/s/time"}
    columns = ColumnMap(
        time=Channel("/s/stamp", "ms", offset=-0.007), positions=TOPICS.positions, outputs=TOPICS.outputs
    )
    found = recording(Table("bag", {**table.columns, **stamp}, clocks), columns, PENDULUM)
    assert np.allclose(found.signals["y"][:, 1], -found.time, atol=1e-12)


# -- columns by their names -------------------------------------------------------------------------------------------

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
    assert "position: j1 = q_deg_1 (deg)" in columns_text(found)


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


# -- real logs --------------------------------------------------------------------------------------------------------


def real(name: str) -> Table:
    pytest.importorskip("pyarrow")
    from pyarrow import parquet

    if not (DATA / name).is_file():
        pytest.skip(f"the measured log is not there: {DATA / name}")
    read = parquet.read_table(DATA / name)
    return Table(name, {column: read[column].to_numpy().astype(float) for column in read.column_names})


REAL = [
    ("double_pendulum/A0_20220812_061157-PM.parquet", PENDULUM, {"qd", "y"}),
    ("double_pendulum/A0_20220815_traj_11.parquet", PENDULUM, {"qd", "y", "reference"}),
    ("panda_1khz/panda_gaz_exciting_1kHz.parquet", PANDA, {"qd", "y"}),
    ("panda_30hz/panda_exciting.parquet", PANDA, {"qd", "y"}),
    ("kuka_lwr4/lwr4_measurements_3.parquet", PANDA, {"qd", "qdd", "y", "reference"}),
    ("staubli_tx40/tx40_5kHz.parquet", TX40, {"y"}),
]


@pytest.mark.parametrize(("name", "robot", "signals"), REAL)
def test_real_logs_are_understood_by_their_names(name: str, robot: ec.Mechanism, signals: set[str]) -> None:
    table = real(name)
    found = recording(table, guess_columns(list(table.columns), robot), robot)
    assert found.signals.keys() == {"q", *signals}
    assert all(np.isfinite(values).all() for values in found.signals.values())


def test_tx40_on_the_joints_side() -> None:
    table = real("staubli_tx40/tx40_5kHz.parquet")
    found = recording(table, guess_columns(list(table.columns), TX40), TX40)
    theta = np.stack([table.columns[f"q_motor_rad_{n}"] for n in range(1, 7)], axis=1)
    tau = np.stack([table.columns[f"tau_motor_Nm_{n}"] for n in range(1, 7)], axis=1)
    assert np.allclose(found.signals["q"] @ N.T, theta, atol=1e-10)
    assert np.allclose(found.signals["y"], tau @ N)
