"""Logs of several experiments are identified by one command, and planted values are within their intervals."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import echelon as ec
from support.command_line import run
from support.mounted_arm import load_values, log, urdf, write

TABLE, WALL = (0.0, 0.0, -9.81), (9.81, 0.0, 0.0)
SETUP = """echelon: 1
robot: arm.urdf
effects: none
experiments:
  - {name: table}
  - {name: wall, gravity: [9.81, 0, 0], payloads: {tool: l3}}
  - {name: held, locked: {j2: 0.7}}
log: {time: t, position: "q_{n}", output: "tau_{n}"}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    found = tmp_path_factory.mktemp("arm")
    (found / "arm.urdf").write_text(urdf())
    (found / "arm.yaml").write_text(SETUP)
    write(log(TABLE, 1), found / "table.csv")
    write(log(WALL, 2, loaded=True), found / "run2_wall.csv")
    write(log(TABLE, 3, held={1: 0.7}), found / "held-1.csv")
    return found


def truth(base: ec.BaseModel) -> np.ndarray:
    """Base parameters of the arm and its load."""
    mechanism = base.mechanism
    values = dict(zip(mechanism.parameters, mechanism.standard_values(), strict=True))
    kinds = ("XX", "XY", "XZ", "YY", "YZ", "ZZ", "MX", "MY", "MZ", "M")
    values |= {f"{k}_tool": v for k, v in zip(kinds, load_values(), strict=True)}
    return base.values([values[name] for name in mechanism.parameters])


def test_two_mountings_a_load_and_a_held_joint_by_one_command(folder: Path) -> None:
    logs = ["table.csv", "run2_wall.csv", "held-1.csv"]
    ended = run("identify", "arm.yaml", *logs, "-o", "out", "--json", cwd=folder)
    assert ended.returncode == 0, ended.stderr
    document = json.loads(ended.stdout)
    base = ec.load_identified(folder / "out/model.json").base
    assert base.rank == ec.base_parameters(ec.load(folder / "arm.yaml")).rank
    assert any(name.endswith("_tool") for name in base.pivots)
    rows = document["estimate"]["parameters"]
    inside = [
        row["low"] < value < row["high"]
        for row, value in zip(rows, truth(base), strict=True)
    ]
    assert np.mean(inside) > 0.85
    outputs = {
        score["output"] for v in document["validations"] for score in v["scores"]
    }
    assert {"table.j1", "wall.j3", "held.j3"} <= outputs
    assert "held.j2" not in outputs
    assert (folder / "out/report.html").stat().st_size > 0
    # the file of the robot has the identified values, and no trees of experiments
    identified = ec.load(folder / "out/identified.urdf")
    assert identified.positions == ("j1", "j2", "j3")


def test_a_saved_set_predicts_logs_of_its_experiments(folder: Path) -> None:
    result = ec.identify(
        folder / "arm.yaml", [folder / "table.csv", folder / "run2_wall.csv"]
    )
    assert any("'held'" in finding.text for finding in result.findings)
    ec.save_identification(result, folder / "model.json")
    other = write(log(WALL, 9, loaded=True), folder / "wall_again.csv")
    ended = run("predict", str(folder / "model.json"), str(other), "--json")
    scores = json.loads(ended.stdout)["outputs"]
    assert min(scores[f"wall.j{k}"]["whole"]["r2"] for k in (1, 2, 3)) > 0.99


def test_logs_may_be_given_by_experiment_in_python(folder: Path) -> None:
    robot = ec.load(folder / "arm.urdf")
    table = ec.Experiment(robot, "table")
    wall = ec.Experiment(robot, "wall", gravity=WALL, payloads={"tool": "l3"})
    logs = {"table": log(TABLE, 1), "wall": [log(WALL, 2, loaded=True)]}
    result = ec.identify([table, wall], logs)
    low, high = result.estimate.interval(0.95).T
    expected = truth(result.base)
    assert np.mean((expected > low) & (expected < high)) > 0.85
    assert result.robot is robot


def test_one_experiment_is_identified_as_its_robot(folder: Path) -> None:
    result = ec.identify(folder / "arm.yaml", folder / "table.csv")
    plain = ec.base_parameters(folder / "arm.urdf")
    assert result.base.pivots == plain.pivots
    assert [score.output for score in result.pooled[0].scores] == ["j1", "j2", "j3"]


def test_a_wrong_sign_in_one_experiment_is_named(folder: Path) -> None:
    wrong = log(WALL, 2, loaded=True)
    wrong["q_2"] = -wrong["q_2"]
    result = ec.identify(
        folder / "arm.yaml",
        {"table": folder / "table.csv", "wall": [wrong]},
    )
    assert result.reasons
    assert any("'wall'" in finding.text for finding in result.findings)


@pytest.mark.parametrize(
    ("logs", "said"),
    [
        (["run.csv"], "which of the experiments table, wall, held"),
        (["table.csv", "wall_or_held.csv"], "which of the experiments"),
        (["table_or_wall.csv"], "which of the experiments"),
    ],
)
def test_a_log_of_no_experiment_is_refused(
    folder: Path, logs: list[str], said: str
) -> None:
    for name in logs:
        write(
            log(TABLE, 4, seconds=2.0), folder / name
        ) if name != "table.csv" else None
    ended = run("identify", "arm.yaml", *logs, cwd=folder)
    assert ended.returncode == 2
    assert said in ended.stderr


def test_an_experiment_that_is_not_fitted_is_not_validated(folder: Path) -> None:
    with pytest.raises(ec.InputError, match="of which no log is fitted"):
        ec.identify(folder / "arm.yaml", folder / "table.csv", folder / "run2_wall.csv")


def test_files_and_experiments_are_stated_by_section(folder: Path) -> None:
    sections = """log:
  - {experiment: table, files: "a*.csv", time: t, position: "q_{n}", output: "tau_{n}"}
  - {experiment: wall, files: b.csv, time: t, position: "q_{n}", output: "tau_{n}"}
"""
    head = SETUP[: SETUP.index("log:")]
    (folder / "stated.yaml").write_text(head + sections)
    maps: Any = ec.load_setup(folder / "stated.yaml").columns
    assert [(m.experiment, m.files) for m in maps] == [
        ("table", ("a*.csv",)),
        ("wall", ("b.csv",)),
    ]
    (folder / "stated.yaml").write_text(head + sections.replace("wall", "floor"))
    with pytest.raises(ec.InputError, match="no such experiment"):
        ec.load_setup(folder / "stated.yaml")


def test_a_locked_joint_keeps_the_numbers_of_the_others(folder: Path) -> None:
    maps = ec.load_setup(folder / "arm.yaml").columns
    held = next(m for m in maps if m.experiment == "held")
    assert {n: c.column for n, c in held.positions.items()} == {
        "j1": "q_1",
        "j3": "q_3",
    }


@pytest.mark.parametrize(
    ("fault", "experiment"),
    [
        ("  - {name: wall, gravity: [-9.81, 0, 0], payloads: {tool: l3}}", "table"),
        ("  - {name: held, locked: {j2: 0.2}}", "held"),
    ],
)
def test_experiments_that_contradict_one_another_are_named(
    folder: Path, fault: str, experiment: str
) -> None:
    # a free load explains gravity that is stated upside down, in the logs with the load alone
    name = fault.split(",")[0]
    lines = [fault if name in line else line for line in SETUP.splitlines()]
    (folder / "wrong.yaml").write_text("\n".join(lines))
    # a log with the position of the locked joint would be refused
    columns = log(TABLE, 3, held={1: 0.7})
    del columns["q_2"]
    write(columns, folder / "held-2.csv")
    logs = [folder / f"{name}.csv" for name in ("table", "run2_wall", "held-2")]
    result = ec.identify(folder / "wrong.yaml", logs)
    said = f"logs of '{experiment}' contradict those of other experiments"
    assert any(said in reason for reason in result.reasons)
    right = ec.identify(folder / "arm.yaml", logs)
    assert not any("contradict" in finding.text for finding in right.findings)


def test_columns_of_outputs_that_an_experiment_lacks_are_left_out(folder: Path) -> None:
    text = SETUP.replace("{name: table}", "{name: table, sensors: [j2]}")
    (folder / "few.yaml").write_text(text)
    result = ec.identify(
        folder / "few.yaml", [folder / "table.csv", folder / "run2_wall.csv"]
    )
    outputs = {score.output for score in result.pooled[0].scores}
    assert outputs == {"table.j2", "wall.j1", "wall.j2", "wall.j3"}


def test_logs_of_unknown_experiments_are_refused(folder: Path) -> None:
    logs = {"table": folder / "table.csv", "wal": folder / "run2_wall.csv"}
    with pytest.raises(ec.InputError, match="'wal', which is no experiment; did you"):
        ec.identify(folder / "arm.yaml", logs)
    with pytest.raises(ec.InputError, match="'wal' is a path"):
        ec.identify(folder / "arm.yaml", {"wal": folder / "table.csv"})


@pytest.mark.parametrize("logs", [["table.csv", "run2_wall.csv"], ["run2_wall.csv"]])
def test_a_prior_and_a_total_mass_are_those_of_the_robot_without_loads(
    folder: Path, logs: list[str]
) -> None:
    known = "identification: {prior: {file: arm.urdf}, total_mass: [7.5, 8], bodies: {l2: {mass: [3, 4]}, tool: {mass: [0, 2]}}}\n"
    (folder / "known.yaml").write_text(SETUP + known)
    result = ec.identify(folder / "known.yaml", [folder / name for name in logs])
    assert result.physical is not None
    found = dict(zip(result.base.parameters, result.physical.standard, strict=True))
    assert 7.4 < sum(found[name] for name in ("M1", "M2", "M3")) < 8.1
    assert 2.9 < found["M2"] < 4.1
