"""Set-ups that are written for a robot and a log: at most two commands to a first result."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd
import pytest

import echelon as ec
from echelon.identification.logs.read_log import opened
from echelon.identification.setup.skeleton import skeleton
from support.command_line import run
from support.selection import one_in
from support.swinging_arm import ARM, Motion, swinging

Floats = npt.NDArray[np.float64]

PENDULUM = """echelon: 1
name: pendulum
gravity: [0, -9.81, 0]
modified_dh: [{joint: revolute}, {joint: revolute, a: 0.3}]
effects: [offset]
"""


@pytest.fixture(scope="module")
def motion() -> Motion:
    return swinging()


def written(folder: Path, log: pd.DataFrame, robot: str = ARM, **options: bool) -> str:
    """The set-up for a robot and a log; both are in the folder."""
    path = folder / ("arm.urdf" if robot.startswith("<") else "arm.yaml")
    path.write_text(robot)
    log.to_csv(folder / "log.csv", index=False, **options)  # type: ignore[call-overload]
    return skeleton(path, [folder / "log.csv"], folder).text


@pytest.mark.parametrize(
    ("angle", "moment"), one_in(2, [("Winkel {}", "Moment {}"), ("a_{}", "b_{}")])
)
def test_two_commands_lead_from_strange_columns_to_a_model(
    angle: str, moment: str, motion: Motion, tmp_path: Path
) -> None:
    (tmp_path / "arm.urdf").write_text(ARM)
    names = {
        "Uhr": motion["t"],
        angle.format("A"): motion["q"][:, 0],
        angle.format("B"): motion["q"][:, 1],
    }
    names |= {
        moment.format("A"): motion["tau"][:, 0],
        moment.format("B"): motion["tau"][:, 1],
        "Temperatur": 20 + motion["t"],
        "Modus": "AUTO",
    }
    log, setup = tmp_path / "log.csv", tmp_path / "setup.yaml"
    pd.DataFrame(names).to_csv(log, index=False)
    said = run("setup", str(tmp_path / "arm.urdf"), str(log), "-o", str(setup))
    assert said.returncode == 0, said.stderr
    assert "log.csv: 10 s at 300 Hz in 1 stretch" in said.stdout
    assert f"next:  echelon identify {setup} {log} -o result/" in said.stdout
    assert "  # columns that are not used: Temperatur, Modus" in setup.read_text()
    result = ec.identify(setup, log)
    assert min(score.r2 for score in result.validations[-1].scores) > 0.99
    refused = run("setup", str(tmp_path / "arm.urdf"), str(log), "-o", str(log))
    assert refused.returncode == 2


@pytest.mark.parametrize(
    ("pattern", "stated"),
    [
        ("q{n}", "position: 'q{n}'"),
        ("actual_q_{i}", "position: 'actual_q_{i}'"),
        ("{name} angle", "position: '{name} angle'"),
        ("q{n+3} deg", "position: {all: {column: 'q{n+3} deg', unit: deg}}"),
    ],
)
def test_patterns_units_and_questions(
    pattern: str, stated: str, motion: Motion, tmp_path: Path
) -> None:
    log = pd.DataFrame({"time [ms]": 1e3 * motion["t"]})
    for k, name in enumerate(("shoulder_joint", "elbow_joint")):
        column = (
            pattern.replace("{n}", str(k + 1))
            .replace("{i}", str(k))
            .replace("{name}", name)
        )
        column = column.replace("{n+3}", str(k + 4))
        log[column] = motion["q"][:, k] * (180 / np.pi if "deg" in column else 1)
        log[f"tau_{k}"] = motion["tau"][:, k]
    if (
        "{n+3}" in pattern
    ):  # numbers that begin with neither 0 nor 1 are those of a family by its values
        log.columns = [column.replace(" deg", " Grad") for column in log.columns]
        stated = "position: {all: {column: 'q{n+3} Grad', unit: deg}}"
    text = written(tmp_path, log)
    assert f"  {stated}\n" in text
    assert "  time: {column: 'time [ms]', unit: ms}\n" in text
    assert "open:\n#   - check that outputs are in N·m" in text
    columns = ec.load_setup(tmp_path / "arm.urdf").columns
    assert columns == ()


def test_what_is_missing_is_asked_for(motion: Motion, tmp_path: Path) -> None:
    log = pd.DataFrame(
        {"q1": motion["q"][:, 0], "q2": motion["q"][:, 1], "x": motion["t"], "y": 1.0}
    )
    text = written(tmp_path, log)
    assert "no output columns of arm recognised" in " ".join(
        text.replace("#", "").split()
    )
    assert '  # output: "…_{n}"' in text


def test_words_count_beside_words_that_nobody_knows(
    motion: Motion, tmp_path: Path
) -> None:
    """Torques of viscous friction look like velocities."""
    log = pd.DataFrame({"Zeit": motion["t"]})
    for k in (0, 1):
        log[f"GVL.Axis{k + 1}.NcToPlc.ActPos"] = motion["q"][:, k]
        log[f"GVL.Axis{k + 1}.NcToPlc.ActTorque"] = 5 * motion["qd"][:, k]
        log[f"GVL.Axis{k + 1}.NcToPlc.MotorTemperature"] = 30 + 0.1 * motion["t"]
    found = written(tmp_path, log)
    assert "output: 'GVL.Axis{n}.NcToPlc.ActTorque'" in found
    assert "\n  velocity:" not in found


def joint_after_joint(motion: Motion, names: Sequence[object]) -> pd.DataFrame:
    """A log with a row for every joint and time."""
    signals = {"position": "q", "velocity": "qd", "effort": "tau"}
    parts = (
        pd.DataFrame(
            {"time": motion["t"], "joint": name}
            | {word: motion[key][:, k] for word, key in signals.items()}
        )
        for k, name in enumerate(names)
    )
    return pd.concat(parts, ignore_index=True)


@pytest.mark.parametrize(
    "labels", one_in(3, [["Achse A", "Achse B"], ["shoulder", "elbow"], [1, 2]])
)
@pytest.mark.parametrize("order", one_in(2, ["none", "by joint", "by time"]))
def test_rows_of_one_time_are_put_side_by_side(
    order: str, labels: list[object], motion: Motion, tmp_path: Path
) -> None:
    log = joint_after_joint(motion, labels)
    log = {"by joint": log, "by time": log.sort_values("time", kind="stable")}.get(
        order, log.sample(frac=1)
    )
    text = written(tmp_path, log)
    assert "rows of one 'time' are put side by side by 'joint'" in text
    assert "tried:\n#   - log.csv: 10 s at 300 Hz in 1 stretch" in text
    (tmp_path / "setup.yaml").write_text(text)
    result = ec.identify(tmp_path / "setup.yaml", tmp_path / "log.csv")
    assert min(score.r2 for score in result.validations[-1].scores) > 0.99


def test_a_table_with_one_column_of_values_names_its_columns_by_their_labels(
    motion: Motion, tmp_path: Path
) -> None:
    columns = {
        f"{word}{k + 1}": motion[word][:, k] for word in ("q", "tau") for k in (0, 1)
    }
    text = written(
        tmp_path, pd.DataFrame({"time": motion["t"], **columns}).melt(id_vars="time")
    )
    assert "  position: 'q{n}'\n  output: 'tau{n}'" in text


def test_long_parquet_files_lack_what_was_not_logged(
    motion: Motion, tmp_path: Path
) -> None:
    log = joint_after_joint(motion, ["shoulder", "elbow"]).drop(index=[5])
    log.astype({"joint": "category"}).to_parquet(tmp_path / "log.parquet", index=False)
    table = read_table_of(tmp_path / "log.parquet")
    assert list(np.flatnonzero(np.isnan(table["position/shoulder"]))) == [5]
    np.testing.assert_array_equal(table["effort/elbow"], motion["tau"][:, 1])


def read_table_of(path: Path) -> Mapping[str, Floats]:
    """The columns of a log."""
    return next(opened(path).tables()).columns


def test_rows_without_a_label_and_rows_that_are_cut_off_count_for_nothing(
    motion: Motion, tmp_path: Path
) -> None:
    log = joint_after_joint(motion, ["shoulder", None])
    log.to_csv(tmp_path / "log.csv", index=False)
    assert opened(tmp_path / "log.csv").names[:3] == (
        "time",
        "position/shoulder",
        "velocity/shoulder",
    )
    with (tmp_path / "log.csv").open("a") as file:
        file.write("9.99,shoul")
    assert len(read_table_of(tmp_path / "log.csv")["position/shoulder"]) == len(
        motion["t"]
    )


def test_columns_of_inclinometers_are_asked_about(
    motion: Motion, tmp_path: Path
) -> None:
    log = pd.DataFrame({"t": motion["t"]})
    for k, name in enumerate(("shoulder", "elbow")):
        log[f"{name}_incl"] = motion["q"][:, k]
        log[f"{name}_torque"] = motion["tau"][:, k]
    text = " ".join(written(tmp_path, log).replace("#", "").split())
    assert "check that 'elbow_incl' is the angle of the joint 'elbow_joint'" in text
    assert "position: {tilt: elbow_incl}" in text


def channel_after_channel(
    motion: Motion, every: int, later: float, scale: float = 1.0
) -> pd.DataFrame:
    """A log with a row for every channel and time; torques come more seldom, and later, s."""
    columns = {"q1": ("q", 0), "q2": ("q", 1), "tau1": ("tau", 0), "tau2": ("tau", 1)}
    parts = []
    for name, (key, k) in columns.items():
        is_torque = key == "tau"
        step, delay = (every, later) if is_torque else (1, 0.0)
        values = np.interp(motion["t"] + delay, motion["t"], motion[key][:, k])[::step]
        times = scale * (motion["t"] + delay)[::step]
        parts.append(pd.DataFrame({"time": times, "name": name, "value": values}))
    return pd.concat(parts).sort_values("time", kind="stable")


@pytest.mark.parametrize(
    ("every", "later", "scale"), [(1, 0.0003, 1), (4, 0, 1), (4, 0.0003, 1e3)]
)
@pytest.mark.parametrize("header", [True, False])
def test_channels_of_long_tables_have_clocks_of_their_own(
    every: int, later: float, scale: float, header: bool, motion: Motion, tmp_path: Path
) -> None:
    log = channel_after_channel(motion, every, later, scale)
    text = written(tmp_path, log, header=header)
    assert "  position: 'q{n}'\n  output: 'tau{n}'" in text
    assert "s at 300 Hz in 1 stretch" in text
    (tmp_path / "setup.yaml").write_text(text)
    result = ec.identify(tmp_path / "setup.yaml", tmp_path / "log.csv")
    assert min(score.r2 for score in result.validations[-1].scores) > 0.99


def test_tables_without_a_header_begin_with_their_first_row(
    motion: Motion, tmp_path: Path
) -> None:
    log = channel_after_channel(motion, 1, 0.0)
    log.to_csv(tmp_path / "log.csv", index=False, header=False)
    found = read_table_of(tmp_path / "log.csv")
    assert set(found) == {"0", "q1", "q2", "tau1", "tau2"}
    np.testing.assert_allclose(found["q1"], motion["q"][:, 0])


@pytest.mark.parametrize(
    ("name", "labels"),
    [
        (
            "mode",
            np.where(np.arange(3000) % 900 < 450, "AUTO", "MANUAL"),
        ),  # at other times
        ("run", np.repeat(["first", "second"], 1500)),
        (
            "note",
            np.repeat(["first", "second"], 1500),
        ),  # beside q1, which is of one joint
    ],
)
def test_words_that_change_with_time_are_no_labels_of_rows(
    name: str, labels: np.ndarray, motion: Motion, tmp_path: Path
) -> None:
    time = motion["t"] if name == "mode" else np.tile(motion["t"][:1500], 2)
    position = "q1" if name == "note" else "position"
    pd.DataFrame({"time": time, name: labels, position: motion["q"][:, 0]}).to_csv(
        tmp_path / "log.csv", index=False
    )
    assert opened(tmp_path / "log.csv").names == ("time", name, position)


CART_POLE = """echelon: 1
name: cart-pole
gravity: [0, 0, -9.81]
bodies:
  - {name: cart, joint: {name: rail, type: prismatic, axis: [1, 0, 0]}}
  - {name: pole, parent: cart, joint: {name: hinge, type: revolute, axis: [0, 1, 0]}}
effects: [offset]
"""


@pytest.mark.parametrize(
    ("names", "places"),
    [
        ("x theta xdot thetadot force", [0, 1]),
        ("theta theta_dot x x_dot u", [1, 0]),
        ("p v alpha omega u", [0, 1]),
        ("cart_pos pole_angle cart_vel pole_vel F", [0, 1]),
    ],
)
def test_joints_with_names_of_their_own_are_told_by_their_rates(
    names: str, places: list[int], tmp_path: Path
) -> None:
    """One of them is not driven."""
    t = np.arange(3000) / 200
    rate = np.array([1.3, 2.9])
    q, qd = (
        np.array([0.3, 0.8]) * np.sin(np.outer(t, rate)),
        np.array([0.39, 2.32]) * np.cos(np.outer(t, rate)),
    )
    force = np.random.default_rng(0).normal(size=len(t)) + 5 * np.sin(7 * t)
    columns, words = {"t": t}, names.split()
    pairs = [(q[:, k], qd[:, k]) for k in places]
    beside = "dot" in words[1] or words[1] == "v"
    values = (
        [v for pair in pairs for v in pair]
        if beside
        else [part[k] for k in (0, 1) for part in pairs]
    )
    text = written(
        tmp_path,
        pd.DataFrame(columns | dict(zip(words, [*values, force], strict=True))),
        CART_POLE,
    )
    angle = next(word for word in words if word in ("theta", "alpha", "pole_angle"))
    length = next(word for word in words if word in ("x", "p", "cart_pos"))
    assert f"  position:\n    rail: {length}\n    hinge: {angle}\n" in text
    assert f"  output:\n    rail: {words[-1]}\n" in text
    assert "no measured output for hinge" in text


def test_logs_without_time_ask_for_the_rate(motion: Motion, tmp_path: Path) -> None:
    log = pd.DataFrame(np.hstack([motion["q"], motion["tau"]]))
    text = written(tmp_path, log, header=False)
    assert "no column is the time: state the rate" in text
    assert "  rate: 1000" in text
    assert "  output: '{n+1}'" in text


def test_currents_are_taken_for_torques_and_said_to_be(
    motion: Motion, tmp_path: Path
) -> None:
    log = pd.DataFrame({"timestamp": motion["t"]})
    for k in (0, 1):
        log[f"actual_q_{k}"], log[f"actual_current_{k}"] = (
            motion["q"][:, k],
            motion["tau"][:, k],
        )
    text = written(tmp_path, log)
    assert "  output: 'actual_current_{i}'" in text
    said = " ".join(text.replace("#", "").split())
    assert "give the torque per ampere at the joint" in said
    assert "name the currents under input" in said
    assert "{type: drive_gain, at: all}" in said
    assert "ec.gains_from_logs in Python" in said


def test_identify_points_from_unknown_gains_to_what_finds_them(
    motion: Motion, tmp_path: Path
) -> None:
    """Currents with nothing known have no scale; the example of the message runs."""
    log = pd.DataFrame({"t": motion["t"]})
    for k in (0, 1):
        log[f"q{k + 1}"] = motion["q"][:, k]
        log[f"i{k + 1}"] = motion["tau"][:, k] / (2.0, 0.5)[k]
    log.to_csv(tmp_path / "log.csv", index=False)
    (tmp_path / "arm.urdf").write_text(ARM)
    setup = tmp_path / "gains.yaml"
    setup.write_text(
        "echelon: 1\nrobot: arm.urdf\neffects: [usual, {type: drive_gain, at: all}]\n"
        "log: {time: t, position: 'q{n}', input: 'i{n}'}\n"
    )
    with pytest.raises(ec.InputError, match="known=") as error:
        ec.identify(setup, tmp_path / "log.csv")
    found = re.search(
        r"ec\.gains_from_logs\((.*), \[(.*)\], known=\{'(Kt\d)'", str(error.value)
    )
    assert found is not None
    assert found[1].strip("'").endswith("gains.yaml")
    gains = ec.gains_from_logs(
        setup, [tmp_path / found[2].strip("'")], known={found[3]: 2.0}
    )
    assert gains.gains == pytest.approx([2.0, 0.5], rel=0.1)


@pytest.mark.parametrize(
    ("entry", "doubted"),
    [
        ("'actual_current_{n}'", True),
        ("{all: {column: 'actual_current_{n}', scale: -1}}", True),
        ("{all: {column: 'actual_current_{n}', scale: 12}}", False),
        ("{all: {column: 'actual_current_{n}', unit: N·m}}", False),
    ],
)
def test_currents_without_a_scale_are_a_doubt_of_a_fit(
    entry: str, doubted: bool, motion: Motion, tmp_path: Path
) -> None:
    (tmp_path / "arm.urdf").write_text(ARM)
    log = {"t": motion["t"]}
    for k in (0, 1):
        log[f"q{k + 1}"] = motion["q"][:, k]
        log[f"actual_current_{k + 1}"] = motion["tau"][:, k]
    pd.DataFrame(log).to_csv(tmp_path / "log.csv", index=False)
    text = f"echelon: 1\nrobot: arm.urdf\nlog: {{time: t, position: 'q{{n}}', output: {entry}}}\n"
    (tmp_path / "setup.yaml").write_text(text)
    result = ec.identify(tmp_path / "setup.yaml", tmp_path / "log.csv")
    doubts = [f for f in result.findings if "names of currents" in f.text]
    assert [f.severity for f in doubts] == ["warning"] * doubted
    reasons = [reason for reason in result.reasons if "units of currents" in reason]
    assert len(reasons) == doubted
    assert (result.judgement.badge == "do not use") == doubted
    assert doubted or result.judgement.badge == "good"
    files = "setup.yaml", "log.csv", "-o", "result"
    printed = run("identify", *files, cwd=tmp_path).stdout
    assert ("N·m stands for A" in " ".join(printed.split())) == doubted
    robot = (tmp_path / "result" / "identified.urdf").read_text()
    assert ("names of currents" in robot) == doubted
    page = (tmp_path / "result" / "report.html").read_text()
    assert page.count("N·m stands for A") == 5 * doubted


def test_commands_without_torques_make_a_fit_of_servos(
    motion: Motion, tmp_path: Path
) -> None:
    log = pd.DataFrame({"timestamp": motion["t"]})
    for k in (0, 1):
        log[f"observation.state_{k}"] = np.degrees(motion["q"][:, k])
        log[f"action_{k}"] = np.degrees(motion["q"][:, k] + 0.01)
    text = written(tmp_path, log)
    assert "  - {type: servo, at: all}\n" in text
    assert "  input: {all: {column: 'action_{i}', unit: deg}}\n" in text
    assert "log.csv: 10 s at 300 Hz in 1 stretch" in text
    (tmp_path / "setup.yaml").write_text(text)
    assert not ec.load_setup(tmp_path / "setup.yaml").columns[0].outputs
    with pytest.raises(
        ec.InputError,
        match=r"the log has position commands .* servos .*; echelon setup",
    ):
        ec.identify(ARM, tmp_path / "log.csv")


def test_gears_that_a_urdf_states_are_offered(motion: Motion, tmp_path: Path) -> None:
    gear = """<transmission name="t"><joint name="elbow_joint"/><actuator name="motor2">
    <mechanicalReduction>100</mechanicalReduction></actuator></transmission></robot>"""
    log = pd.DataFrame(
        {"t": motion["t"], "q1": motion["q"][:, 0], "q2": motion["q"][:, 1]}
    )
    text = written(tmp_path, log, ARM.replace("</robot>", gear))
    assert "\n# actuators: {motor2: 100*elbow_joint}\n" in text


def test_forces_of_actuators_of_mujoco_pass_their_gears(
    motion: Motion, tmp_path: Path
) -> None:
    hinge = '<joint name="{}" axis="0 1 0"/><geom type="box" size=".1 .1 .1" mass="1" pos=".1 0 0"/>'
    bodies = f"<body>{hinge.format('up')}<body pos='.3 0 0'>{hinge.format('low')}</body></body>"
    drives = '<motor name="m_low" joint="low" gear="20"/><motor name="m_up" joint="up" gear="50"/>'
    text = (
        f"<mujoco><worldbody>{bodies}</worldbody><actuator>{drives}</actuator></mujoco>"
    )
    (tmp_path / "arm.xml").write_text(text)
    names = {"up": motion["q"][:, 0], "low": motion["q"][:, 1]}
    names |= {
        "m_up": motion["tau"][:, 0],
        "m_low": motion["tau"][:, 1],
        "time": motion["t"],
    }
    pd.DataFrame(names).to_csv(tmp_path / "log.csv", index=False)
    found = skeleton(tmp_path / "arm.xml", [tmp_path / "log.csv"], tmp_path)
    assert "# actuators: {m_low: 20*low, m_up: 50*up}" in found.text
    (tmp_path / "setup.yaml").write_text(found.text)
    outputs = ec.load_setup(tmp_path / "setup.yaml").columns[0].outputs
    assert {
        name: (channel.column, channel.scale) for name, channel in outputs.items()
    } == {
        "up": ("m_up", 50.0),
        "low": ("m_low", 20.0),
    }


def test_a_description_gets_a_section(motion: Motion, tmp_path: Path) -> None:
    log = pd.DataFrame(
        {"t": motion["t"], "q1": motion["q"][:, 0], "q2": motion["q"][:, 1]}
    )
    log["tau1"], log["tau2"] = motion["tau"].T
    text = written(tmp_path, log, PENDULUM)
    assert "\n" + PENDULUM + "log:\n  time: t\n" in text
    (tmp_path / "setup.yaml").write_text(text)
    with pytest.raises(ec.InputError, match="has a section log already"):
        skeleton(tmp_path / "setup.yaml", [tmp_path / "log.csv"], tmp_path)


@pytest.mark.parametrize(
    ("stated", "moved"),
    [
        ("robot: arm.urdf  # ours", "robot: ../arm.urdf  # ours"),
        ("robot: {file: 'arm.urdf'}", "robot: {file: '../arm.urdf'}"),
        ("robot:\n  file: arm.urdf", "robot:\n  file: ../arm.urdf"),
        ("robot:\n  arm.urdf", "robot:\n  ../arm.urdf"),
        (
            "identification: {prior: {file: arm.urdf}}\nrobot: arm.urdf",
            "identification: {prior: {file: ../arm.urdf}}\nrobot: ../arm.urdf",
        ),
    ],
)
def test_a_section_in_another_folder_names_the_robot_from_there(
    stated: str, moved: str, motion: Motion, tmp_path: Path
) -> None:
    log = pd.DataFrame(
        {"t": motion["t"], "q1": motion["q"][:, 0], "q2": motion["q"][:, 1]}
    )
    log["tau1"], log["tau2"] = motion["tau"].T
    log.to_csv(tmp_path / "log.csv", index=False)
    (tmp_path / "arm.urdf").write_text(ARM)
    description = tmp_path / "own.yaml"
    description.write_text(f"echelon: 1\nname: arm\n{stated}\n")
    folder = tmp_path / "setups"
    folder.mkdir()
    made = skeleton(description, [tmp_path / "log.csv"], folder)
    assert moved in made.text
    (folder / "setup.yaml").write_text(made.text)
    (columns,) = ec.load_setup(folder / "setup.yaml").columns
    assert {channel.column for channel in columns.outputs.values()} == {"tau1", "tau2"}


def test_rates_come_from_velocities_or_coarse_stamps(
    motion: Motion, tmp_path: Path
) -> None:
    both = {
        f"{name}{k}": motion[name][:, k] for name in ("q", "qd", "tau") for k in (0, 1)
    }
    for first, why in (
        ({}, "positions and velocities agree"),
        ({"t": np.floor(50 * motion["t"]) / 50}, "coarser than"),
    ):
        written(tmp_path, pd.DataFrame(first | both))
        found = skeleton(tmp_path / "arm.urdf", [tmp_path / "log.csv"], tmp_path)
        assert "  rate: 300 " in found.text
        assert any(why in line for line in found.report)
        assert not any("time" in question for question in found.undecided)
    still = {**both, "qd0": 0 * both["qd0"], "qd1": 0 * both["qd1"]}
    for damaged in (
        {"t": 0 * motion["t"]} | both,
        still,
    ):  # a clock that stands, velocities that say nothing
        written(tmp_path, pd.DataFrame(damaged))
        assert (
            "rate: 300 "
            not in skeleton(
                tmp_path / "arm.urdf", [tmp_path / "log.csv"], tmp_path
            ).text
        )


@pytest.mark.parametrize("order", ["quantities", "joints"])
def test_names_of_their_own_are_told_by_values_and_order(
    order: str, motion: Motion, tmp_path: Path
) -> None:
    q, tau = motion["q"], motion["tau"]
    columns = {"alpha": q[:, 0], "beta": q[:, 1], "Mx": tau[:, 0], "lift": tau[:, 1]}
    names = (
        ["alpha", "beta", "Mx", "lift"]
        if order == "quantities"
        else ["alpha", "Mx", "beta", "lift"]
    )
    count = np.arange(len(q))
    table = {
        "n": count,
        "when": motion["t"],
        **{name: columns[name] for name in names},
        "warm": 30 + 0 * count,
    }
    (tmp_path / "setup.yaml").write_text(written(tmp_path, pd.DataFrame(table)))
    read = ec.load_setup(tmp_path / "setup.yaml").columns[0]
    assert [channel.column for channel in read.positions.values()] == ["alpha", "beta"]
    assert [channel.column for channel in read.outputs.values()] == ["Mx", "lift"]


@pytest.mark.parametrize("vector", ["ctrl_{}", "ctrl[{}]", "data.actuator_force[{}]"])
def test_vectors_of_actuators_of_mujoco_are_joint_torques_by_their_gears(
    vector: str, motion: Motion, tmp_path: Path
) -> None:
    hinge = '<joint name="{}" axis="0 1 0"/><geom type="box" size=".1 .1 .1" mass="1" pos=".1 0 0"/>'
    bodies = f"<body>{hinge.format('up')}<body pos='.3 0 0'>{hinge.format('low')}</body></body>"
    drives = (
        '<motor name="m_low" joint="low"/><motor name="m_up" joint="up" gear="50"/>'
    )
    text = f"<mujoco><default><motor gear='20'/></default><worldbody>{bodies}</worldbody><actuator>{drives}</actuator>"
    (tmp_path / "arm.xml").write_text(f"{text}</mujoco>")
    names = {
        "time": motion["t"],
        "qpos_0": motion["q"][:, 0],
        "qpos_1": motion["q"][:, 1],
    }
    names |= {
        vector.format(0): motion["tau"][:, 1] / 20,
        vector.format(1): motion["tau"][:, 0] / 50,
    }
    pd.DataFrame(names).to_csv(tmp_path / "log.csv", index=False)
    (tmp_path / "setup.yaml").write_text(
        skeleton(tmp_path / "arm.xml", [tmp_path / "log.csv"], tmp_path).text
    )
    outputs = ec.load_setup(tmp_path / "setup.yaml").columns[0].outputs
    assert {
        name: (channel.column, channel.scale) for name, channel in outputs.items()
    } == {
        "up": (vector.format(1), 50.0),
        "low": (vector.format(0), 20.0),
    }


def test_of_two_robots_in_one_file_the_first_is_taken_and_the_other_named(
    motion: Motion, tmp_path: Path
) -> None:
    log = pd.DataFrame({"time": motion["t"]})
    for side, sign in (("left", 1), ("right", -1)):
        for k in range(2):
            log[f"{side}_q_{k + 1}"], log[f"{side}_tau_{k + 1}"] = (
                sign * motion["q"][:, k],
                sign * motion["tau"][:, k],
            )
    text = written(tmp_path, log)
    assert "  position: 'left_q_{n}'\n" in text
    assert (
        "several sets of columns, left_…, right_…: those of left_… are used"
        in " ".join(text.replace("#", "").split())
    )
    with pytest.raises(
        ec.InputError, match=r"left_…, right_…: name the columns of arm under log"
    ):
        ec.identify(tmp_path / "arm.urdf", tmp_path / "log.csv")


def test_motors_and_links_are_not_two_robots(motion: Motion, tmp_path: Path) -> None:
    log = pd.DataFrame({"time": motion["t"]})
    for side, gear in (("motor", 50), ("link", 1)):
        for k in range(2):
            log[f"{side}_q_{k + 1}"], log[f"{side}_tau_{k + 1}"] = (
                gear * motion["q"][:, k],
                motion["tau"][:, k] / gear,
            )
    assert "several sets" not in written(tmp_path, log)


def test_units_after_names_that_say_nothing_count(
    motion: Motion, tmp_path: Path
) -> None:
    log = pd.DataFrame({"sec": motion["t"]})
    for k, name in enumerate(("shoulder", "elbow")):
        log[f"{name}_deg"], log[f"{name}_load_kg.cm"] = (
            np.degrees(motion["q"][:, k]),
            10.197 * motion["tau"][:, k],
        )
    assert "elbow_joint: {column: elbow_load_kg.cm, unit: kgf·cm}" in written(
        tmp_path, log
    )


def test_gravity_and_inertia_tell_the_rate_of_a_log_without_a_clock(
    motion: Motion, tmp_path: Path
) -> None:
    (tmp_path / "arm.urdf").write_text(ARM)
    log = pd.DataFrame(
        np.hstack([motion["q"], motion["tau"]]), columns=["q1", "q2", "tau1", "tau2"]
    )
    log.to_csv(tmp_path / "log.csv", index=False)
    said = run(
        "setup",
        str(tmp_path / "arm.urdf"),
        str(tmp_path / "log.csv"),
        "-o",
        str(tmp_path / "setup.yaml"),
    )
    assert said.returncode == 0, said.stderr
    assert "explains the outputs if the rate is 300 Hz" in said.stdout
    assert "  rate: 300 " in (tmp_path / "setup.yaml").read_text()
