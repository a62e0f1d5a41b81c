"""Force/torque sensors in the hand of an arm that MuJoCo moves: unknown zeros beside the load, and their intervals."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import echelon as ec
from echelon.formats.writers.robot_writer import identified_robot
from echelon.identification.logs.columns.column_map import Channel
from echelon.identification.masses import body_masses
from echelon.identification.origins import inertia_origins
from echelon.identification.saved.identified import identification_to_json
from echelon.identification.setup.setup import Setup
from echelon.identification.setup.skeleton import skeleton
from echelon.report import report_html
from support.robot_files import robot_file
from support.simulated_systems import SYSTEMS, motion_of

COMPONENTS = ("fx", "fy", "fz", "tx", "ty", "tz")
ZEROS = np.array([2.0, -3.0, 5.0, 0.1, -0.05, 0.02])
NOISE = np.array([0.3, 0.3, 0.3, 0.01, 0.01, 0.01])
ARM = SYSTEMS["wrist sensor"]
SEEDS = 50
LOAD = slice(46, 50)
"""Places of MX, MY, MZ and M of the fifth body, which is the hand, among the standard parameters."""


def sensor(folder: Path, **changes: Any) -> Setup:
    """The arm with the sensor in its hand alone."""
    (_, wrench) = ARM.setup["outputs"]
    columns = {f"ft.{c}": c for c in COMPONENTS}
    log = {"time": "t", "position": "q{n}", "output": columns}
    setup = {"outputs": [wrench], "log": log}
    return (
        replace(ARM, setup=setup).load(folder, **changes).with_settings(physical=False)
    )


@cache
def truth() -> dict[str, float]:
    """Parameters of the load in the hand."""
    from tempfile import TemporaryDirectory

    with TemporaryDirectory() as folder:
        base, standard = ARM.truth(Path(folder))
    return dict(zip(base.parameters, standard.tolist(), strict=True))


def run(
    seed: int, zeros: np.ndarray = ZEROS, turn: np.ndarray | None = None
) -> dict[str, Any]:
    """A log of the sensor with noise and zeros, and with axes turned by a matrix."""
    motion = motion_of(ARM)
    rng = np.random.default_rng(seed)
    y = motion.y[:, -6:]
    if turn is not None:
        y = np.hstack([y[:, :3] @ turn, y[:, 3:] @ turn])
    y = y + zeros + NOISE * rng.normal(size=(len(motion.q), 6))
    positions = {f"q{k}": q for k, q in enumerate(motion.q.T, start=1)}
    return {"t": motion.time, **positions, **dict(zip(COMPONENTS, y.T, strict=True))}


def expected(result: ec.Identification, zeros: np.ndarray = ZEROS) -> np.ndarray:
    """True values of the base parameters, each of which is one parameter."""
    known = truth() | {f"Fo_ft_{c}": z for c, z in zip(COMPONENTS, zeros, strict=True)}
    assert [str(e) for e in result.base.expressions] == list(result.base.pivots)
    return np.array([known[name] for name in result.base.pivots])


def test_zeros_are_unknown_unless_a_set_up_says_otherwise(tmp_path: Path) -> None:
    result = ec.identify(sensor(tmp_path), run(1))
    assert result.base.rank == 16
    assert any("an unknown zero" in str(finding) for finding in result.findings)
    errors = (result.estimate.values - expected(result)) / result.estimate.std
    assert np.abs(errors).max() < 4.5
    assert not result.reasons


def test_a_set_up_without_them_is_told_of_them(tmp_path: Path) -> None:
    """Without zeros the gains of its components run away: these are tested no more, and the fit is delivered."""
    result = ec.identify(sensor(tmp_path, effects="none"), run(1))
    (found,) = (f for f in result.findings if f.kind == "missing effect")
    places = ", ".join(f"ft.{component}" for component in COMPONENTS)
    assert f"add {{type: offset, at: [{places}]}} to 'effects'" in found.text


TURNS = {
    "rpy: [0, 0, pi/2]": [[0, -1, 0], [1, 0, 0], [0, 0, 1]],
    "rpy: [pi, 0, 0]": [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
    "rpy: [pi/2, 0, pi/2]": [[0, 0, 1], [1, 0, 0], [0, 1, 0]],
}


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("rpy", TURNS)
def test_axes_that_are_turned_are_named(rpy: str, sign: int, tmp_path: Path) -> None:
    """The sensor's own frame is turned by a quarter turn against the stated one, or stands on the other side."""
    (_, wrench) = ARM.setup["outputs"]
    flat = {**wrench, "frame": {"xyz": [0, 0, "0.02"]}}
    quarter = np.array(TURNS[rpy])
    eighth = np.array([[1, -1, 0], [1, 1, 0], [0, 0, np.sqrt(2)]]) / np.sqrt(2)
    log = run(3, turn=sign * eighth.T @ quarter)
    result = ec.identify(sensor(tmp_path, outputs=[flat]), log)
    (found,) = (some for some in result.hypotheses if some.taken)
    frame = f"frame: {{xyz: [0, 0, 0.02], {rpy}}}"
    assert (
        f"the axes of the sensor 'ft' are turned by quarter turns ({frame})"
        in found.words
    )
    assert ("scale: -1" in found.words) == (sign < 0)
    assert not any("exchanged" in some.words for some in result.hypotheses)
    assert "as expected from noise" not in str(result.findings)
    assert any("the axes of the sensor" in reason for reason in result.reasons)

    stated = {**wrench, "frame": {"xyz": [0, 0, 0.02], "rpy": rpy[6:-1].split(", ")}}
    columns = {f"ft.{c}": {"column": c, "scale": sign} for c in COMPONENTS}
    mended = sensor(
        tmp_path,
        outputs=[stated],
        log={"time": "t", "position": "q{n}", "output": columns},
    )
    assert not ec.identify(mended, log).reasons


def test_axes_of_another_frame_of_the_robot_file_are_named(tmp_path: Path) -> None:
    """The file has the sensor's own frame, a site that the set-up does not state."""
    bare = {"wrench": "tool", "name": "hand"}
    columns = {f"hand.{c}": c for c in COMPONENTS}
    log = {"time": "t", "position": "q{n}", "output": columns}
    result = ec.identify(sensor(tmp_path, outputs=[bare], log=log), run(3))
    (found,) = (some for some in result.hypotheses if some.taken)
    frame = "frame: {xyz: [0, 0, 0.02], rpy: [0, 0, 0.7854]}"
    assert found.words == f"the axes of the sensor 'hand' are those of 'ft' ({frame})"


def test_set_ups_ask_which_frame_the_axes_follow(tmp_path: Path) -> None:
    setup = tmp_path / "wrist.yaml"
    robot = {"file": str(robot_file("ur5_robot"))}
    outputs = [{"wrench": "tool0"}]
    setup.write_text(json.dumps({"echelon": 1, "robot": robot, "outputs": outputs}))
    base = ec.base_parameters(ec.load(setup))
    t = np.arange(0, 20, 0.01)
    waves = [
        (np.sin(w * t), w * np.cos(w * t), -w * w * np.sin(w * t))
        for w in (0.5, 0.6, 0.8, 0.9, 1.1, 1.3)
    ]
    q, qd, qdd = (np.stack(some, axis=1) for some in zip(*waves, strict=True))
    load = [0.01, 0, 0, 0.01, 0, 0.01, 0.02, -0.01, 0.1, 1.2]
    y = base.predict(q, qd, qdd, np.array(load))
    y += 0.01 * np.random.default_rng(0).normal(size=y.shape)
    names = [
        "time",
        *(f"actual_q_{k}" for k in range(6)),
        "Fx",
        "Fy",
        "Fz",
        "Tx",
        "Ty",
        "Tz",
    ]
    log = tmp_path / "log.csv"
    table = np.column_stack([t, q, y])
    np.savetxt(log, table, "%.9g", ",", header=",".join(names), comments="")
    asked = skeleton(setup, [log], tmp_path).undecided
    (axes,) = (text for text in asked if "axes" in text)
    assert "the axes of the sensor 'tool0'" in axes
    assert "those of 'wrist_3_link' or 'ee_link', or of a sensor that is turned" in axes


def test_motions_are_planned_for_loads_and_zeros(tmp_path: Path) -> None:
    """Torques of drives have limits although the wrench alone is measured."""
    setup = tmp_path / "wrist.yaml"
    robot = {"file": str(robot_file("ur5_robot"))}
    outputs = [{"wrench": "tool0"}]
    setup.write_text(json.dumps({"echelon": 1, "robot": robot, "outputs": outputs}))
    motion = ec.exciting_trajectory(setup, starts=1, iterations=3)
    assert "Fo_tool0_fz" in motion.base.pivots


def test_a_drift_with_temperature_is_an_effect_of_the_output(tmp_path: Path) -> None:
    log = run(2)
    warmth = 5 * np.sin(0.7 * log["t"]) + log["t"] / 4
    log = {**log, "fz": log["fz"] + 0.4 * warmth, "warmth": warmth}
    drift = {"parameter": "drift", "unit": "N/K"}
    drift["acts"] = [{"at": "ft.fz", "term": "i[j4]"}]
    setup = sensor(tmp_path, effects=["usual", drift])
    columns = replace(setup.columns[0], inputs={"j4": Channel("warmth")})
    result = ec.identify(replace(setup, columns=(columns,)), log)
    place = result.estimate.parameters.index("drift")
    error = result.estimate.values[place] - 0.4
    assert abs(error) < 4 * result.estimate.std[place]


@pytest.mark.slow
def test_intervals_cover_loads_and_zeros(tmp_path: Path) -> None:
    setup = sensor(tmp_path)
    mass, centre = true_mass()
    inside, masses_inside = [], []
    for seed in range(SEEDS):
        rng = np.random.default_rng(1000 + seed)
        zeros = ZEROS * rng.uniform(-1, 1, 6)
        result = ec.identify(setup, run(seed, zeros))
        low, high = result.estimate.interval(0.95).T
        true = expected(result, zeros)
        inside.append((low <= true) & (true <= high))
        (load,) = result.masses
        masses_inside += [
            load.mass_low < mass < load.mass_high,
            *((load.centre_low < centre) & (centre < load.centre_high)),
        ]
    rates = np.mean(inside, axis=0)
    assert np.mean(inside) > 0.92, rates
    assert rates.min() > 0.8, rates
    assert 0.9 < np.mean(masses_inside) < 0.99


def true_mass() -> tuple[float, np.ndarray]:
    """Mass and centre of mass of the load in the hand."""
    *moments, mass = list(truth().values())[LOAD]
    return mass, np.array(moments) / mass


def test_mass_and_centre_of_a_load_are_written_with_intervals(tmp_path: Path) -> None:
    result = ec.identify(sensor(tmp_path), run(1))
    (load,) = result.masses
    assert load.body == result.robot.bodies[-1].name
    mass, centre = true_mass()
    assert load.mass_low < mass < load.mass_high
    assert np.abs(load.centre - centre).max() < 2e-3
    (saved,) = json.loads(identification_to_json(result))["masses"]
    assert saved["centre"] == load.centre.tolist()
    page = report_html(result)
    assert f"mass of {load.body}" in page
    assert f"numbers of bodies: {result.robot.bodies[-1].label} {load.body}" in page


def test_intervals_cover_masses_and_centres(tmp_path: Path) -> None:
    """Planted errors of the estimate's covariance leave the intervals about once in twenty times."""
    setup = sensor(tmp_path)
    result = ec.identify(setup, run(0))
    mass, centre = true_mass()
    rng = np.random.default_rng(7)
    draws = rng.multivariate_normal(
        expected(result), result.estimate.covariance, size=2000
    )
    inside = []
    for values in draws:
        (load,) = body_masses(
            result.base, replace(result.estimate, values=values), 0.95
        )
        inside.append(
            [
                load.mass_low < mass < load.mass_high,
                *((load.centre_low < centre) & (centre < load.centre_high)),
            ]
        )
    rates = np.mean(inside, axis=0)
    assert (np.abs(rates - 0.95) < 0.015).all(), rates


def test_links_that_the_sensor_does_not_see_stay_in_the_written_file(
    tmp_path: Path,
) -> None:
    setup = sensor(tmp_path).with_settings(physical=True)
    result = ec.identify(setup, run(1))
    assert result.physical is not None
    robot, file = result.robot, setup.robot_file
    assert file is not None
    values = dict(
        zip(result.physical.parameters, result.physical.standard, strict=True)
    )
    standard = [values[name] for name in robot.parameters]
    (written,) = identified_robot(robot, standard, file, [inertia_origins(result)])
    before, after = (
        re.findall(r"<inertial[^>]*>", text)
        for text in (file.data.decode(), written.text)
    )
    *unseen, hand = [body.name for body in robot.bodies]
    assert len(before) == len(after) == len(robot.bodies)
    assert before[:-1] == after[:-1]
    assert before[-1] != after[-1]
    others = ", ".join(f"'{name}'" for name in unseen)
    origins = f"inertias from the data alone: '{hand}'; as in the robot file, since no output sees them: {others}"
    assert written.text.count(origins) == 1


@pytest.mark.parametrize("most", [90.0, 91.0])
def test_limits_of_a_link_that_no_output_sees_count_more_than_its_file(
    most: float, tmp_path: Path
) -> None:
    name = ARM.load(tmp_path).mechanism.bodies[0].name
    limits = {"bodies": {name: {"mass": [90.0, most]}}}
    result = ec.identify(
        sensor(tmp_path, identification=limits).with_settings(physical=True), run(1)
    )
    assert result.physical is not None
    values = dict(
        zip(result.physical.parameters, result.physical.standard, strict=True)
    )
    assert 90 <= values[f"M{result.robot.bodies[0].label}"] <= most
    assert (
        f"from the prior, since the data do not tell them: '{name}'"
        in inertia_origins(result)
    )
