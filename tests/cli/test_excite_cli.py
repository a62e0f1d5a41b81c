"""The commands ``excite`` and ``check-trajectory`` as a user meets them: files, exit codes, messages, silence."""

from __future__ import annotations

import csv
import json
import re
import subprocess
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest

import echelon as ec
from echelon.cli import excite_commands
from echelon.cli.destination import MANIFEST
from echelon.excite.files.trajectory_file import SUFFIXES
from echelon.formats.schema.schema_excite import ExcitationEntry
from support.command_line import run
from support.paths import EXAMPLES
from support.resampled_motions import evaluated

SETUP = """
echelon: 1
name: two links
symbols: {l1: 0.3, g: 9.81}
gravity: [0, -g, 0]
modified_dh:
  - {joint: revolute, inertial: {mass: 2, com: [0.15, 0, 0], inertia: {xx: 0.02, yy: 0.02, zz: 0.02}}}
  - {joint: revolute, a: l1, inertial: {mass: 1, com: [0.15, 0, 0], inertia: {xx: 0.01, yy: 0.01, zz: 0.01}}}
excitation:
  duration: 5
  starts: 1
  limits: {position: [-2, 2], velocity: SPEED, acceleration: 20, jerk: 400, effort: {j1: 12, j2: 5}}
  frames: [{body: j2, point: [0.3, 0, 0], box: {x: [-0.55, none]}}]
"""
FORMATS = ("csv", "parquet", "yaml")
LARGE = (
    "--criterion",
    "d_optimal",
)  # motions that are as large as their limits let them be


def setup_file(folder: Path, speed: float = 3.0) -> Path:
    file = folder / f"arm{speed:g}.yaml"
    file.write_text(SETUP.replace("SPEED", str(speed)), encoding="utf-8")
    return file


Made = tuple[Path, Path, "subprocess.CompletedProcess[str]"]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """A set-up, the folder that the command wrote, and what it said."""
    folder = tmp_path_factory.mktemp("excite")
    file = setup_file(folder)
    formats = [word for name in FORMATS for word in ("--format", name)]
    done = run(
        "excite",
        str(file),
        "-o",
        str(folder / "out"),
        *formats,
        "--rate",
        "500",
        "--json",
        *LARGE,
    )
    assert done.returncode == 0, done.stderr
    return file, folder / "out", done


def judged(*arguments: object) -> tuple[int, dict[str, Any]]:
    done = run("check-trajectory", *arguments, "--json")
    assert done.stderr == ""
    return done.returncode, json.loads(done.stdout)


# -- what is written ---------------------------------------------------------------------------------------------------


def test_all_files_are_written_and_said(made: Made) -> None:
    _, out, done = made
    names = {
        "trajectory.json",
        "preview.html",
        *(f"trajectory.{name}" for name in FORMATS),
    }
    assert {path.name for path in out.iterdir()} == names | {MANIFEST}
    document = json.loads(done.stdout)
    assert {Path(path).name for path in document["files"]} == names
    assert document["safe"] is True
    written = json.loads((out / "trajectory.json").read_text())
    assert written == {key: value for key, value in document.items() if key != "files"}
    page = (out / "preview.html").read_text()
    assert page.lstrip().lower().startswith("<!doctype html>")
    assert "two links" in page


def test_a_pipe_gets_no_escape_codes_and_no_progress(made: Made) -> None:
    assert made[2].stderr == ""
    assert "\x1b" not in made[2].stdout


def test_samples_are_the_formula_of_the_file_and_keep_all_limits(made: Made) -> None:
    _, out, _ = made
    document = json.loads((out / "trajectory.json").read_text())
    with (out / "trajectory.csv").open(newline="") as lines:
        header, *rows = csv.reader(lines)
    table = np.array(rows, dtype=float)
    assert len(table) == 2501
    t = table[:, 0]
    np.testing.assert_allclose(t, np.arange(2501) / 500, atol=1e-12)
    for order, (prefix, limit) in enumerate(
        zip(("q", "qd", "qdd"), (2, 3, 20), strict=True)
    ):
        values = table[:, [header.index(f"{prefix}_{name}") for name in ("j1", "j2")]]
        assert np.abs(values).max() <= limit
        np.testing.assert_allclose(
            values, evaluated(document["motion"], ["j1", "j2"], t, order), atol=1e-9
        )


def test_torques_and_points_by_hand_keep_their_limits_and_use_one(made: Made) -> None:
    """Two links in a plane, Lagrange's equations with numbers, at 10 kHz."""
    document = json.loads((made[1] / "trajectory.json").read_text())
    t = np.linspace(0, 5, 50_001)
    (q1, q2), (v1, v2), (a1, a2) = (
        evaluated(document["motion"], ["j1", "j2"], t, order).T for order in range(3)
    )
    m1, m2, l1, c, g = 2.0, 1.0, 0.3, 0.15, 9.81
    I1, I2 = 0.02 + m1 * c**2, 0.01 + m2 * c**2
    h = m2 * l1 * c
    both = I2 * (a1 + a2) + m2 * c * g * np.cos(q1 + q2)
    tau2 = both + h * (np.cos(q2) * a1 + np.sin(q2) * v1**2)
    tau1 = both + (I1 + m2 * l1**2) * a1 + (m1 * c + m2 * l1) * g * np.cos(q1)
    tau1 += h * (np.cos(q2) * (2 * a1 + a2) - np.sin(q2) * (2 * v1 * v2 + v2**2))
    used = [np.abs(tau1).max() / (0.9 * 12), np.abs(tau2).max() / (0.9 * 5)]
    assert max(used) <= 1
    assert max(used) >= 0.98
    tip = 0.3 * np.cos(q1) + 0.3 * np.cos(q1 + q2)
    assert tip.min() >= -0.55
    labels = {m["label"]: m for m in document["margins"]}
    assert labels["torque of j1"]["largest"] >= tau1.max() - 1e-9
    assert any(m["active"] for m in document["margins"])


def test_text_for_people(tmp_path: Path) -> None:
    done = run("excite", str(setup_file(tmp_path)), "--iterations", "20", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert "\x1b" not in done.stdout
    lines = done.stdout.splitlines()
    assert (
        lines[0] == "two links: 2 coordinates move for 5 s and show 6 base parameters"
    )
    assert "limits are kept at every time" in done.stdout
    assert re.search(
        r"^criterion: smallest condition number; condition number [\d.]+; log det",
        done.stdout,
        re.M,
    )
    figures = (
        r"^scaled condition number [\d.]+, worst standard deviation [\d.]+ \S+ \(\w+\)$"
    )
    assert re.search(figures, done.stdout, re.M)
    assert "best of 24 random motions: scaled condition number" in done.stdout
    assert [path.name for path in tmp_path.iterdir()] == [
        "arm3.yaml"
    ]  # without -o nothing is written


def test_options_replace_the_section(tmp_path: Path) -> None:
    file = setup_file(tmp_path)
    file.write_text(file.read_text().replace("{j1: 12, j2: 5}", "12"), encoding="utf-8")
    options = "--duration 4 --family bspline --segments 6 --criterion condition --seed 3 --iterations 20 --move j2"
    done = run("excite", str(file), *options.split(), "--json")
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    assert document["coordinates"] == ["j2"]
    assert document["held"] == {"j1": 0.0}
    assert document["criterion"] == "condition"
    motion = document["motion"]
    assert (motion["family"], motion["knots"][-1], len(set(motion["knots"]))) == (
        "splines",
        4.0,
        7,
    )
    assert document["settings"]["seed"] == 3


# -- trajectories that are read again ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name", ["trajectory.json", *(f"trajectory.{kind}" for kind in FORMATS)]
)
def test_every_written_format_is_judged_safe_with_the_same_condition(
    made: Made, name: str
) -> None:
    file, out, done = made
    code, found = judged(file, out / name)
    assert code == 0
    assert found["safe"] is True
    expected = json.loads(done.stdout)["condition_numbers"]
    assert found["condition_numbers"]["plain"] == pytest.approx(
        expected["plain"], rel=1e-5
    )
    assert found["condition_numbers"]["scaled"] == pytest.approx(
        expected["scaled"], rel=1e-5
    )
    assert found["starts"] == []


def test_broken_limits_are_named_with_exit_code_1(made: Made, tmp_path: Path) -> None:
    tight = setup_file(tmp_path, 2.0)
    done = run(
        "check-trajectory",
        str(tight),
        str(made[1] / "trajectory.csv"),
        "-o",
        str(tmp_path / "page.html"),
    )
    assert (done.returncode, done.stderr) == (1, "")
    assert "broken limits: velocity of j1, velocity of j2" in done.stdout
    assert (
        (tmp_path / "page.html")
        .read_text()
        .lstrip()
        .lower()
        .startswith("<!doctype html>")
    )
    code, found = judged(tight, made[1] / "trajectory.csv")
    assert code == 1
    assert [m["label"] for m in found["margins"] if not m["kept"]] == [
        "velocity of j1",
        "velocity of j2",
    ]


def test_repeats_of_a_periodic_motion(made: Made, tmp_path: Path) -> None:
    file, *_ = made
    done = run(
        "excite",
        str(file),
        "-o",
        str(tmp_path),
        "--iterations",
        "20",
        "--rate",
        "100",
        "--repeats",
        "2",
    )
    assert done.returncode == 0, done.stderr
    table = np.genfromtxt(tmp_path / "trajectory.csv", delimiter=",", skip_header=1)
    assert len(table) == 1001
    np.testing.assert_allclose(table[:501, 1:], table[500:, 1:], atol=1e-9)


# -- logs at hand ------------------------------------------------------------------------------------------------------


def test_a_log_at_hand_is_complemented(tmp_path: Path) -> None:
    """A log in which only the first joint moves: the design sees more with it than without."""
    file = setup_file(tmp_path)
    text = file.read_text() + 'log: {time: t, position: "q{n}", output: "tau{n}"}\n'
    file.write_text(text, encoding="utf-8")
    t = np.arange(2000) / 200
    q1 = 0.8 * np.sin(2 * np.pi * 0.5 * t) + 0.3 * np.sin(2 * np.pi * 0.9 * t)
    a1 = -0.8 * np.pi**2 * np.sin(np.pi * t) - 0.3 * (1.8 * np.pi) ** 2 * np.sin(
        1.8 * np.pi * t
    )
    weight = 9.81 * np.cos(q1)
    tau2 = (0.01 + 0.15**2) * a1 + 0.15 * weight + 0.3 * 0.15 * a1
    tau1 = tau2 + (0.02 + 2 * 0.15**2 + 0.09 + 0.045) * a1 + 0.6 * weight
    rows = np.stack([t, q1, np.zeros_like(t), tau1, tau2], axis=1)
    np.savetxt(
        tmp_path / "log.csv",
        rows,
        delimiter=",",
        header="t,q1,q2,tau1,tau2",
        comments="",
    )
    arguments = "excite", str(file), "--iterations", "20", "--json"
    plain, done = (
        run(*arguments),
        run(*arguments, "--prior-log", str(tmp_path / "log.csv")),
    )
    assert done.returncode == 0, done.stderr
    assert (plain.returncode, done.stderr) == (0, "")
    first, second = json.loads(plain.stdout), json.loads(done.stdout)
    assert second["safe"] is True
    assert second["log_det"] > first["log_det"]
    assert second["motion"] != first["motion"]
    deviations = first["standard_deviations"], second["standard_deviations"]
    assert deviations[0].keys() == deviations[1].keys()
    held = run(*arguments, "--prior-log", str(tmp_path / "log.csv"), "--move", "j1")
    assert held.returncode in (0, 2)
    assert "Traceback" not in held.stderr


# -- what is refused ---------------------------------------------------------------------------------------------------


def test_choices_are_those_of_the_section() -> None:
    """They are stated once more for the command line, so that ``--help`` is instant."""
    for ours, name in (
        (excite_commands.Optimality, "criterion"),
        (excite_commands.Family, "family"),
    ):
        assert ours == ExcitationEntry.model_fields[name].annotation
    formats = get_args(excite_commands.SampleFormat)
    assert {f".{name}" for name in formats} == {*SUFFIXES} - {".json"}


def refused(*arguments: object) -> str:
    done = run(*arguments)
    assert done.returncode == 2, done.stdout + done.stderr
    assert done.stdout == ""
    assert "Traceback" not in done.stderr
    assert "\x1b" not in done.stderr
    return done.stderr


def test_wrong_input_is_one_line_and_nothing_is_written(tmp_path: Path) -> None:
    file = setup_file(tmp_path)
    out = tmp_path / "out"
    cases = {
        (
            "--family",
            "bspline",
            "--repeats",
            "2",
            "--iterations",
            "20",
        ): "not periodic cannot be run 2 times",
        ("--move", "j3"): "there is no coordinate 'j3'",
        ("--rate", "0", "--iterations", "20"): "not a sampling rate",
        ("--duration", "-1"): "excitation.duration",
        ("--prior-log", str(tmp_path / "no.csv")): "no.csv",
    }
    for options, message in cases.items():
        text = refused("excite", file, "-o", out, *options)
        assert message in text
        assert len(text.strip().splitlines()) == 1
        assert not out.exists()
    for option, value in {
        "--criterion": "best",
        "--format": "cvs",
        "--family": "sines",
    }.items():
        assert option in refused("excite", file, "-o", out, option, value)
        assert not out.exists()


def test_an_output_directory_that_is_a_file_is_refused(tmp_path: Path) -> None:
    file = setup_file(tmp_path)
    (tmp_path / "out").write_text("mine")
    text = refused("excite", file, "-o", tmp_path / "out", "--iterations", "20")
    assert len(text.strip().splitlines()) == 1
    assert "out" in text
    assert (tmp_path / "out").read_text() == "mine"


def test_a_gain_of_the_drives_does_not_enter_the_design(tmp_path: Path) -> None:
    """Which gain is meant, is not for the base parameters: a trajectory cannot be judged by an unknown factor."""
    file = setup_file(tmp_path)
    file.write_text(
        file.read_text() + "effects: [{type: drive_gain, at: all}]\n", encoding="utf-8"
    )
    done = run("excite", str(file), "--iterations", "20", "--json")
    assert done.returncode in (0, 2)
    assert "Traceback" not in done.stderr
    if done.returncode:
        assert len(done.stderr.strip().splitlines()) == 1


def test_files_that_are_no_trajectory_are_refused(made: Made, tmp_path: Path) -> None:
    file, out, _ = made
    (tmp_path / "t.txt").write_text("0")
    assert "names no kind of trajectory; valid are .json" in refused(
        "check-trajectory", file, tmp_path / "t.txt"
    )
    assert "gone.csv" in refused("check-trajectory", file, tmp_path / "gone.csv")
    text = refused("check-trajectory", EXAMPLES / "panda.yaml", out / "trajectory.json")
    assert "the coordinate 'j3' is missing; there are 'j1', 'j2'" in text


# -- help --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", ["excite", "check-trajectory"])
def test_help_has_an_example(command: str) -> None:
    done = run(command, "--help", COLUMNS="200", TERM="dumb")
    assert done.returncode == 0
    assert f"Example: echelon {command} examples/" in done.stdout
    assert "\x1b" not in done.stdout


# -- the example -------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_example_from_end_to_end(tmp_path: Path) -> None:
    file = EXAMPLES / "excite/ur10.yaml"
    done = run(
        "excite", str(file), "-o", str(tmp_path / "out"), "--starts", "1", "--json"
    )
    assert (done.returncode, done.stderr) == (0, "")
    document = json.loads(done.stdout)
    assert document["safe"] is True
    near = [m["label"] for m in document["margins"] if m["active"]]
    assert sum(label.startswith("velocity") for label in near) >= 3
    assert any(label.startswith("distance") for label in near)
    code, found = judged(file, tmp_path / "out/trajectory.csv")
    assert code == 0
    # dry friction at both ends has the sign of what rounding leaves of a speed of zero
    assert found["condition_numbers"]["plain"] == pytest.approx(
        document["condition_numbers"]["plain"], rel=0.02
    )


@pytest.mark.slow
def test_the_library_says_the_same_as_the_command(made: Made) -> None:
    file, _, done = made
    found = ec.exciting_trajectory(ec.load_setup(file))
    assert (
        found.conditioning.condition
        == json.loads(done.stdout)["condition_numbers"]["plain"]
    )


def test_limits_that_nothing_can_reach(tmp_path: Path) -> None:
    """One harmonic from rest to rest is no motion at all: its speed is zero whatever the coefficients."""
    text = "echelon: 1\nname: slide\ngravity: none\nbodies:\n  - {name: slide, joint: {type: prismatic, axis: x}}\n"
    limits = "{position: [-1, 1], velocity: 2, acceleration: 20}"
    entry = f"excitation: {{duration: 2, starts: 1, family: fourier, harmonics: 1, limits: {limits}}}\n"
    (tmp_path / "slide.yaml").write_text(text + entry)
    done = run("excite", tmp_path / "slide.yaml", "--json")
    assert (done.returncode, done.stderr) == (0, "")
    assert json.loads(done.stdout)["safe"] is True
