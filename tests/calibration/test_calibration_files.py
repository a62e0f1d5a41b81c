"""Logs, robot files and the command of calibrations, and poses to measure at."""

from __future__ import annotations

import json
from pathlib import Path

import jsonschema
import numpy as np
import pinocchio as pin
import pytest

import echelon as ec
from echelon.calibration import calibration_document, calibration_schema
from echelon.dynamics import Kinematics
from support.command_line import run
from support.measured_logs import measured
from support.paths import ROOT
from support.simulated_poses import body_frames, pinocchio_model, twist

ARM, LOG = "examples/calibration/arm.yaml", "examples/calibration/tracker.csv"
URDF = """<robot name="arm">
  <!-- a comment of the user's -->
  <link name="base"/>
  <link name="one"/><link name="two"/><link name="three"/><link name="flange"/>
  <joint name="a" type="revolute"><parent link="base"/><child link="one"/>
    <origin xyz="0 0 0.3" rpy="0 0 0"/><axis xyz="0 0 1"/>
    <limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
  <joint name="b" type="revolute"><parent link="one"/><child link="two"/>
    <origin xyz="0.05 0 0.1" rpy="1.5708 0 0"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="c" type="revolute"><parent link="two"/><child link="three"/>
    <origin xyz="0.4 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
  <joint name="tool" type="fixed"><parent link="three"/><child link="flange"/>
    <origin xyz="0.1 0 0.2"/></joint>
</robot>
"""
MJCF = """<mujoco model="arm"><!-- a comment of the user's -->
<worldbody><body name="one" pos="0 0 0.3"><joint name="a" axis="0 0 1"/><geom size="0.1"/>
<body name="two" pos="0.05 0 0.1" euler="90 0 0"><joint name="b" axis="0 0 1"/><geom size="0.1"/>
<body name="three" pos="0.4 0 0"><joint name="c" axis="0 1 0"/><geom size="0.1"/>
</body></body></body></worldbody></mujoco>
"""


def pose_log(robot: ec.Mechanism) -> dict[str, np.ndarray]:
    """Exact poses of the last body with planted errors."""
    rng = np.random.default_rng(3)
    q = rng.uniform(-1, 1, (40, 3))
    errors = {k: twist(rng, 1e-3, 2e-3) for k in range(3)}
    seen = np.array(body_frames(pinocchio_model(robot), q, errors))[:, -1]
    noise = rng.normal(scale=1e-5, size=(40, 3))
    log = {f"q_{name}": q[:, k] for k, name in enumerate(robot.positions)}
    log |= {axis: seen[:, k, 3] + noise[:, k] for k, axis in enumerate("xyz")}
    vectors = np.array([pin.log3(one[:3, :3]) for one in seen])
    return log | {f"r{axis}": vectors[:, k] for k, axis in enumerate("xyz")}


@pytest.mark.parametrize(("text", "ending"), [(URDF, "urdf"), (MJCF, "xml")])
def test_the_calibrated_file_is_the_users_with_other_origins(
    text: str, ending: str, tmp_path: Path
) -> None:
    path = tmp_path / f"arm.{ending}"
    path.write_text(text)
    robot = ec.load(path)
    found = ec.calibrate(path, pose_log(robot), measure=[{"pose": "three"}])
    assert found.written.name == f"calibrated.{ending}"
    assert "a comment of the user's" in found.written.text
    again = tmp_path / found.written.name
    again.write_text(found.written.text)
    read = ec.load(again, snap_tolerance=0)
    q = np.random.default_rng(5).uniform(-1, 1, (10, 3))
    expected = Kinematics(found.robot.mechanism).frames(q)
    np.testing.assert_allclose(Kinematics(read).frames(q), expected, atol=1e-5)
    assert found.scores[0].after < 1e-4 < found.scores[0].before


def test_the_command_writes_what_its_schema_says(tmp_path: Path) -> None:
    done = run("calibrate", ARM, LOG, "-o", tmp_path / "out", "--json", cwd=ROOT)
    assert done.returncode == 0, done.stderr
    files = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"calibration.json", "calibration.html", "calibrated.yaml"} <= files
    document = json.loads((tmp_path / "out" / "calibration.json").read_text())
    jsonschema.Draft202012Validator(calibration_schema()).validate(document)
    assert document["rank"] == 33
    page = (tmp_path / "out" / "calibration.html").read_text()
    assert "<circle" in page
    assert "held-out rows" in page
    # what a user edited stays
    (tmp_path / "out" / "calibrated.yaml").write_text("mine")
    again = run("calibrate", ARM, LOG, "-o", tmp_path / "out", cwd=ROOT)
    assert again.returncode == 2
    assert (tmp_path / "out" / "calibrated.yaml").read_text() == "mine"


def test_the_calibrated_description_needs_no_calibration(tmp_path: Path) -> None:
    found = ec.calibrate(ARM, LOG)
    (tmp_path / "calibrated.yaml").write_text(found.written.text)
    entry = {"position": "hand", "points": {"m1": None, "m2": None, "m3": None}}
    setup = ec.load_setup(tmp_path / "calibrated.yaml", snap_tolerance=0)
    again = ec.calibrate(setup, LOG, measure=[entry])
    assert all(score.before < 3e-4 for score in again.scores)


MISTAKES = {
    "no body": ([{"pose": "nothing"}], "no body or link 'nothing'"),
    "no rotation": ([{"pose": "hand", "columns": "m1_"}], "the rotation is missing"),
    "no column": ([{"distance": "hand"}], "there is no column 'distance1'"),
    "points of a pose": (
        [{"pose": "hand", "points": {"a": None}}],
        "points belong to a position",
    ),
    "nothing between": ([{"pose": "hand", "on": "hand"}], "nothing moves between"),
    "no row": (
        [{"position": "hand", "columns": "m1_", "where": {"m1_x [mm]": -7}}],
        "no row measures it",
    ),
}


@pytest.mark.parametrize("case", MISTAKES)
def test_mistakes_are_told(case: str) -> None:
    measure, message = MISTAKES[case]
    with pytest.raises(ec.InputError, match=message):
        ec.calibrate(ARM, LOG, measure=measure)


def test_unknown_errors_are_refused() -> None:
    done = run("calibrate", ARM, "--errors", "frame", cwd=ROOT)
    assert done.returncode == 2
    assert "frames" in done.stderr


def test_redundant_measurements_are_named() -> None:
    robot = ec.load(URDF)
    log = pose_log(robot)
    q = np.column_stack([log[f"q_{name}"] for name in robot.positions])
    elbow = np.array(body_frames(pinocchio_model(robot), q, {}))[:, 1, :3, 3]
    log |= {f"e_{axis}": elbow[:, k] for k, axis in enumerate("xyz")}
    second = {"position": "two", "columns": "e_", "tool": "elbow"}
    found = ec.calibrate(robot, log, measure=[{"pose": "three"}, second])
    assert found.redundant == ("position2",)


def test_chosen_poses_show_more_than_random_ones_within_limits(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(URDF)
    found = ec.calibration_poses(path, 12, measure=[{"pose": "three"}])
    assert (np.abs(found.q) <= [2, 1, 2]).all()
    assert found.to_csv().startswith("q_a,q_b,q_c\n")
    assert len(found.to_csv().splitlines()) == 13
    more = ec.calibration_poses(path, 24, measure=[{"pose": "three"}])
    assert (more.deviations < found.deviations).all()


def test_touched_surfaces_choose_their_own_poses() -> None:
    with pytest.raises(ec.InputError, match="choose the poses"):
        ec.calibration_poses("examples/panda.yaml", 5, measure=[{"plane": "j7"}])


def test_a_real_arm() -> None:
    """As good as the reference, which fitted all 34 combinations that singular values show."""
    log = measured("panda_calibration/panda_camera_poses.parquet")
    found = ec.calibrate("examples/panda.yaml", log)
    place, turn = found.scores
    assert found.base.rank == 34
    assert place.rows == turn.rows == 57
    assert place.after < 1.39e-3
    assert turn.after < np.radians(0.212)
    assert place.before > 3e-3
    assert "113" in found.outliers[0]


def test_rounded_angles_stay_in_the_calibrated_file(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(URDF.replace("1.5708", "1.57"))
    log = pose_log(ec.load(path, snap_tolerance=0))
    found = ec.calibrate(path, log, measure=[{"pose": "three"}])
    again = tmp_path / "again.urdf"
    again.write_text(found.written.text)
    q = np.random.default_rng(5).uniform(-1, 1, (10, 3))
    expected = Kinematics(found.robot.mechanism).frames(q)
    read = ec.load(again, snap_tolerance=0)
    np.testing.assert_allclose(Kinematics(read).frames(q), expected, atol=1e-7)


def test_mounts_of_branches_are_written(tmp_path: Path) -> None:
    branch = """<link name="arm"/><joint name="d" type="revolute"><parent link="base"/>
    <child link="arm"/><origin xyz="0 0.2 0.1" rpy="0.3 0 0"/><axis xyz="1 0 0"/>
    <limit lower="-2" upper="2" effort="1" velocity="1"/></joint></robot>"""
    path = tmp_path / "arms.urdf"
    path.write_text(URDF.replace("</robot>", branch))
    robot = ec.load(path)
    model = pinocchio_model(robot)
    rng = np.random.default_rng(3)
    q = rng.uniform(-1, 1, (40, 4))
    seen = np.array(body_frames(model, q, {3: twist(rng, 1e-3, 2e-3)}))
    arm = [b.name for b in robot.bodies].index("arm")
    three = [b.name for b in robot.bodies].index("three")
    relative = np.linalg.inv(seen[:, arm]) @ seen[:, three]
    log = {f"q_{name}": q[:, k] for k, name in enumerate(robot.positions)}
    log |= {axis: relative[:, k, 3] for k, axis in enumerate("xyz")}
    vectors = np.array([pin.log3(one[:3, :3]) for one in relative])
    log |= {f"r{axis}": vectors[:, k] for k, axis in enumerate("xyz")}
    for axis in "xyz":
        log[axis] = log[axis] + 1e-5 * rng.normal(size=40)
    found = ec.calibrate(path, log, measure=[{"pose": "three", "on": "arm"}])
    again = tmp_path / "again.urdf"
    again.write_text(found.written.text)
    expected = Kinematics(found.robot.mechanism).frames(q)
    read = Kinematics(ec.load(again, snap_tolerance=0)).frames(q)
    np.testing.assert_allclose(read, expected, atol=1e-5)
    assert any(name.endswith("b") and value for name, value in found.errors.items())


READ_WRONGLY: dict[str, tuple[list[dict[str, object]], str]] = {
    "one column twice": (
        [{"position": "three", "name": "a"}, {"position": "two", "name": "b"}],
        "reads the column 'x', as 'a' does",
    ),
    "another order": (
        [{"pose": "three", "columns": ["x", "y", "z", "qx", "qy", "qz", "qw"]}],
        "list them in that order",
    ),
    "columns of one distance": (
        [{"distance": "three", "columns": ["x", "y", "z"]}],
        "3 columns do not make a distance",
    ),
    "columns of a known length": (
        [{"distance": "three", "length": 0.5, "columns": "x"}],
        "no column is read",
    ),
    "unknown key": ([{"pose": "three", "foo": 1}], "unknown key 'foo'"),
}


@pytest.mark.parametrize("case", READ_WRONGLY)
def test_nothing_is_read_as_what_it_is_not(case: str) -> None:
    measure, message = READ_WRONGLY[case]
    log = pose_log(ec.load(URDF)) | dict.fromkeys(
        ("qx", "qy", "qz", "qw"), np.full(40, 0.5)
    )
    with pytest.raises(ec.InputError, match=message):
        ec.calibrate(URDF, log, measure=measure)


def test_columns_of_one_name_are_refused() -> None:
    log = pose_log(ec.load(URDF))
    log["x [mm]"] = log["x"] * 1e3 + 50
    with pytest.raises(ec.InputError, match="have one name"):
        ec.calibrate(URDF, log, measure=[{"pose": "three"}])


def test_what_explains_nothing_is_doubted() -> None:
    log = pose_log(ec.load(URDF))
    for axis in "xyz":
        log[axis] = log[axis] * 1e3  # mm without a unit
    with pytest.warns(ec.DoubtWarning, match="mm as m"):
        found = ec.calibrate(URDF, log, measure=[{"pose": "three"}])
    assert found.doubts
    assert calibration_document(found)["doubts"] == list(found.doubts)


def test_every_measurement_is_held_out_in_part() -> None:
    log = pose_log(ec.load(URDF))
    log["kind"] = np.arange(40) % 2
    measure = [
        {"pose": "three", "name": name, "frame": name, "where": {"kind": k}}
        for k, name in enumerate("ab")
    ]
    found = ec.calibrate(URDF, log, measure=measure)
    assert {score.name: score.rows for score in found.scores} == {"a": 10, "b": 10}


def test_nothing_is_written_without_a_log(tmp_path: Path) -> None:
    done = run("calibrate", ARM, "-o", tmp_path / "out", cwd=ROOT)
    assert done.returncode == 2
    assert "-o needs a log" in done.stderr


def test_many_outliers_are_doubted() -> None:
    log = pose_log(ec.load(URDF))
    log["x"][:12] += np.linspace(0.05, 0.2, 12)
    with pytest.warns(ec.DoubtWarning, match="too many for outliers"):
        found = ec.calibrate(URDF, log, measure=[{"pose": "three"}])
    assert any("all are kept" in doubt for doubt in found.doubts)


TILTED = """
echelon: 1
name: digger
log: {sensors: {tilt: boom + arm}, position: {boom: q1, tilt: t2}}
measure: [{position: arm, point: [0.3, 0, 0]}]
modified_dh:
  - {name: boom, joint: revolute}
  - {name: arm, joint: revolute, alpha: 0.3, a: 0.5}
"""


def test_inclinometers_measure_still_poses() -> None:
    rng = np.random.default_rng(4)
    robot = ec.load(TILTED)
    q = rng.uniform(-1, 1, (40, 2))
    frame = np.array(body_frames(pinocchio_model(robot), q, {1: [2e-3] * 3 + [0] * 3}))
    at = (frame[:, -1] @ [0.3, 0, 0, 1])[:, :3] + rng.normal(scale=1e-4, size=(40, 3))
    log = {"q1": q[:, 0], "t2": q.sum(axis=1)}
    log |= {axis: at[:, k] for k, axis in enumerate("xyz")}
    found = ec.calibrate(ec.load_setup(TILTED), log)
    assert found.scores[0].after < 3e-4
    # coefficients in powers of cos 0.1 are numbers to a reader
    shown = str(found.base)
    assert "unit_of_decimals)" not in shown
    assert "constants: unit_of_decimals" in shown


def test_logs_of_loops_name_all_joints() -> None:
    sections = (
        "log: {position: {crank: A, coupler: {column: B, unit: deg}, rocker: C}}\n"
    )
    text = (ROOT / "examples/loops/four_bar.yaml").read_text() + sections
    rng = np.random.default_rng(1)
    a = rng.uniform(0, 6, 40)
    crank, rod, rocker, ground = 0.151, 0.3495, 0.3004, 0.4
    x, y = ground - crank * np.cos(a), -crank * np.sin(a)
    far, away = np.hypot(x, y), np.arctan2(y, x)
    bend = np.arccos((rod**2 + far**2 - rocker**2) / (2 * rod * far))
    b = away + bend - a
    c = np.arctan2(rod * np.sin(a + b) - y, rod * np.cos(a + b) - x)
    log = {"A": a, "B": np.degrees(b), "C": c}
    for name, scale in (("A", 1e-4), ("C", 1e-4)):
        log[name] = log[name] + rng.normal(scale=scale, size=40)
    seen = {"x": crank * np.cos(a), "y": crank * np.sin(a), "z": 0 * a}
    found = ec.calibrate(
        ec.load_setup(text), log | seen, measure=[{"position": "coupler"}]
    )
    loop = next(s for s in found.scores if s.name == "pin" and s.unit == "m")
    assert loop.after < loop.before / 3


def test_large_errors_are_doubted() -> None:
    log = pose_log(ec.load(URDF))
    log["q_b"] = log["q_b"] + 0.4
    with pytest.warns(ec.DoubtWarning, match="more than 5 times what is usual"):
        ec.calibrate(URDF, log, measure=[{"pose": "three"}])
