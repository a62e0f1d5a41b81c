"""Logs, models and trajectories whose numbers cannot be: one clear error, or a proper answer."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import echelon as ec
from echelon.cli.identify import _fit
from echelon.excite.files.trajectory_file import read_trajectory, trajectory_to_json
from echelon.identification.conditioning import without_rounding
from echelon.identification.logs.files.bag_file import nanoseconds
from echelon.identification.logs.preparation.prepare import Preparation
from echelon.identification.saved.identified import load_identified
from echelon.identification.scores import Score, fit
from echelon.identification.signals.clock import stretches
from echelon.shared.errors import CertificateError, InputError
from echelon.shared.inputs import plain_data
from support.paths import ROOT
from support.selection import slow_unless
from support.trajectory_motions import NAMES, UNITS, smooth

SETUP = """echelon: 1
name: pendulum
gravity: [0, -9.81, 0]
bodies:
  - {name: a, joint: {type: revolute, name: q1, axis: z}}
  - {name: b, parent: a, frame: {xyz: [0.3, 0, 0]}, joint: {type: revolute, name: q2, axis: z}}
log: {time: t, position: "q_{n}", output: "tau_{n}"}
"""


def write_log(file: Path, **changes: Any) -> Path:
    """A log of a double pendulum whose outputs are plausible; columns may be replaced."""
    t = np.arange(1500) / 200
    q = [
        0.8 * np.sin(1.3 * t) + 0.3 * np.cos(3.1 * t),
        0.9 * np.cos(1.7 * t) - 0.2 * np.sin(4.3 * t),
    ]
    rng = np.random.default_rng(3)
    tau = [np.cos(q[0]) - 3 * np.sin(2 * t) + 0.05 * rng.normal(size=t.size) for _ in q]
    columns = {
        "t": t,
        "q_1": q[0],
        "q_2": q[1],
        "tau_1": tau[0],
        "tau_2": tau[1],
    } | changes
    table = np.column_stack(
        [np.broadcast_to(column, t.shape) for column in columns.values()]
    )
    np.savetxt(
        file, table, delimiter=",", header=",".join(columns), comments="", fmt="%.17g"
    )
    return file


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A set-up, and a model identified with it."""
    folder = tmp_path_factory.mktemp("pendulum")
    (folder / "setup.yaml").write_text(SETUP)
    result = ec.identify(
        ec.load_setup(folder / "setup.yaml"), [write_log(folder / "run.csv")]
    )
    ec.save_identification(result, folder / "model.json")
    return folder


def still(noise: float) -> np.ndarray:
    return 0.7 + noise * np.random.default_rng(0).integers(-2, 3, size=1500)


@pytest.mark.parametrize("noise", slow_unless([2.0**-53], [0.0, 2.0**-53]))
def test_what_only_a_joint_at_rest_would_show_is_not_seen(
    folder: Path, tmp_path: Path, noise: float
) -> None:
    result = ec.identify(
        ec.load_setup(folder / "setup.yaml"),
        [write_log(tmp_path / "run.csv", q_1=still(noise))],
    )
    estimate = result.estimate
    values = dict(zip(estimate.parameters, estimate.values, strict=True))
    assert values["ZZ1"] == 0
    assert np.abs(estimate.values).max() < 1e3
    ec.save_identification(result, tmp_path / "model.json")
    assert load_identified(tmp_path / "model.json").base.rank == len(values)


def test_columns_of_rounding_are_zero() -> None:
    base = ec.base_parameters(ec.load(ROOT / "examples/double_pendulum.yaml"))
    rng = np.random.default_rng(1)
    q = np.column_stack([np.full(200, np.pi / 2), np.zeros(200)])
    states = {"q": q, "qd": 0 * q, "qdd": 0 * q, "y": rng.normal(size=(200, 2))}
    observation = base.accumulate(states)
    sizes = dict(zip(base.pivots, observation.combined().scales, strict=True))
    assert 0 < sizes["MX1"] < 1e-12 < sizes["MY1"]
    cleaned = without_rounding(observation, base.units).combined()
    assert cleaned.scales[list(base.pivots).index("MX1")] == 0
    assert cleaned.scales[list(base.pivots).index("MY1")] == pytest.approx(sizes["MY1"])


@pytest.mark.parametrize("level", [0.0, 5.0, 1e-300])
def test_a_constant_output_has_no_r_squared(level: float) -> None:
    measured = np.full(300, level) * (
        1 + 1e-16 * np.random.default_rng(0).normal(size=300)
    )
    found = fit(measured, measured + 0.5)
    assert found.rms == pytest.approx(0.5)
    assert np.isnan(found.r2)
    assert "no R²" in _fit(Score("j", "N·m", found, found, found))


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("preparation", "band"), -1),
        (("preparation", "band"), [1]),
        (("preparation", "trim"), "x"),
        (("preparation", "measured"), "qx"),
        (("preparation", "delays"), 3),
        (("preparation", "unknown"), 3),
        (("columns", 0, "positions"), ["q_1"]),
        (("columns", 0, "positions", "q1", "scale"), "big"),
        (("columns", 0, "positions", "q1", "scale"), float("nan")),
        (("columns", 0, "rate"), -5),
        (("columns", 0, "time"), 7),
        (("columns", 0), None),
    ],
)
def test_an_identified_model_is_typed_by_its_schema(
    folder: Path, tmp_path: Path, path: Any, value: Any
) -> None:
    document = json.loads((folder / "model.json").read_text())
    inner = document
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = value
    (tmp_path / "model.json").write_text(json.dumps(document))
    with pytest.raises(InputError, match=rf"model\.json: {path[0]}"):
        load_identified(tmp_path / "model.json")


def test_values_of_other_parameters_are_refused(folder: Path, tmp_path: Path) -> None:
    document = json.loads((folder / "model.json").read_text())
    document["values"] = dict(
        zip(reversed(document["values"]), document["values"].values(), strict=True)
    )
    (tmp_path / "model.json").write_text(json.dumps(document))
    with pytest.raises(
        InputError, match="the values are not those of the base parameters"
    ):
        load_identified(tmp_path / "model.json")


def test_records_keep_what_they_say(folder: Path) -> None:
    document = json.loads((folder / "model.json").read_text())
    loaded = load_identified(folder / "model.json")
    assert plain_data(loaded.columns) == document["columns"]
    prepared = Preparation.model_validate(
        document["preparation"] | {"band": "inf", "measured": ["qd"]}
    )
    assert (prepared.band, prepared.measured) == (float("inf"), ("qd",))


@pytest.mark.parametrize("scale", [1e300, 1e-300, 1e15, 1e-15])
def test_clocks_that_no_robot_has(scale: float) -> None:
    with pytest.raises(InputError, match="is its unit right"):
        stretches(np.arange(100) * 0.005 * scale)


@pytest.mark.parametrize("seconds", [10**30, -(10**30), 2**63])
def test_stamps_that_no_clock_says(seconds: int) -> None:
    with pytest.raises(InputError, match="292 years"):
        nanoseconds({"sec": seconds, "nanosec": 0})
    assert nanoseconds({"sec": 2, "nanosec": 7}) == 2_000_000_007


@pytest.mark.parametrize(
    ("path", "value"),
    [(("duration",), value) for value in (1e300, 1e-300, 0, -1, 1e30)]
    + [(("coefficients", "j1", "sin", 0), value) for value in (1e300, -1e300, 1e30)]
    + [(("coefficients", "j1", "constant"), 10**400)],
)
def test_trajectories_that_no_robot_follows(
    tmp_path: Path, path: Any, value: Any
) -> None:
    document = trajectory_to_json(smooth())
    inner = document["motion"]
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = value
    (tmp_path / "run.json").write_text(json.dumps(document))
    with pytest.raises(InputError, match=r"run\.json: "):
        read_trajectory(tmp_path / "run.json", NAMES, UNITS)


@pytest.mark.parametrize("change", [(1e300, 1), (1e-300, 1), (1, 1e300)])
def test_sampled_trajectories_that_no_robot_follows(
    tmp_path: Path, change: tuple[float, float]
) -> None:
    t = np.arange(50) / 25
    q = np.column_stack([np.sin(t), np.cos(t)]) * change[1]
    t = t * change[0]
    names = ",".join(["t", *(f"q_{name}" for name in NAMES)])
    np.savetxt(
        tmp_path / "run.csv",
        np.column_stack([t, q]),
        delimiter=",",
        header=names,
        comments="",
        fmt="%.17g",
    )
    with pytest.raises(
        InputError,
        match=r"run\.csv: .*(a finite number up to|must rise|no robot reaches that)",
    ):
        read_trajectory(tmp_path / "run.csv", NAMES, UNITS)


# -- budgets -----------------------------------------------------------------------------------------------------------

CROSSED = '<connect body1="a3" body2="b3" anchor="0 0 0"/><connect body1="a2" body2="b2" anchor="0.1 0 0"/>'
"""Two closures that lock each other at random points."""


def crossed_arms() -> str:
    def arm(name: str, axes: tuple[str, ...]) -> str:
        inner = ""
        for k, axis in reversed(list(enumerate(axes))):
            place = f'pos="{0.5 * (name == "b")} 0 0"' if k == 0 else 'pos="0.2 0 0.1"'
            inner = f'<body name="{name}{k}" {place}><joint axis="{axis}"/><geom size="0.05"/>{inner}</body>'
        return inner

    arms = arm("a", ("0 1 0", "1 0 0", "0 0 1", "0 1 0")) + arm(
        "b", ("1 0 0", "0 0 1", "1 1 0", "0 1 0")
    )
    return (
        f"<mujoco><worldbody>{arms}</worldbody><equality>{CROSSED}</equality></mujoco>"
    )


@pytest.mark.slow
def test_loops_that_lock_each_other_end_without_a_set(tmp_path: Path) -> None:
    """Near the pose of the file more is seen than in it, so that no set holds for both."""
    (tmp_path / "robot.xml").write_text(crossed_arms())
    with pytest.raises(CertificateError, match="representatives span only"):
        ec.base_parameters(ec.load(tmp_path / "robot.xml"))


def test_subsets_of_sensors_have_a_budget() -> None:
    robot = ec.load(ROOT / "examples/panda.yaml")
    phases: list[str] = []
    with pytest.raises(InputError, match=r"have 162 subsets of up to 4.*larger budget"):
        ec.sensor_report(robot, 4, budget=0.001, progress=phases.append)
    assert phases[0] == "structure"
    assert any("sensor 8 of 8" in phase for phase in phases)
    report = ec.sensor_report(robot, 1, budget=0.01)
    assert (report.rank, report.smallest) == (48, ("base",))
