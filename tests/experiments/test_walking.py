"""A walking robot is identified although nobody measures the forces at its feet."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import echelon as ec
from echelon.identification import with_logs
from echelon.identification.logs.columns.conversion import in_own_axes
from support.command_line import run
from support.walking_robot import (
    JOINTS,
    LEGS,
    robot_mjcf,
    trot,
    trots,
    write_log,
)

NOISE = np.repeat(
    [0.05, 0.1], [6, 12]
)  # N and N·m; nothing pushes the trunk, but feet are not quite points


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("quadruped")
    (folder / "quadruped.xml").write_text(robot_mjcf(np.random.default_rng(0)))
    feet = "".join(
        f"  - {{name: {leg}, body: {leg}_shank, at: {{xyz: [0, 0, -0.2]}}}}\n"
        for leg in LEGS
    )
    file = folder / "quadruped.yaml"
    file.write_text(
        f"echelon: 1\nrobot: quadruped.xml\ncontacts:\n{feet}"
        "experiments:\n  - {name: stand}\n  - {name: one, contacts: [fl, rr]}\n  - {name: other, contacts: [fr, rl]}\n"
    )
    return file


def test_a_trot_recovers_all_that_moves(robot: Path) -> None:
    base = ec.base_parameters(ec.load(robot))
    assert base.rank == 94
    model = base.experiment("stand")
    walk = trots((robot.parent / "quadruped.xml").read_text(), 5)
    measured = walk.torque + NOISE[6:] * np.random.default_rng(1).normal(
        size=walk.torque.shape
    )
    y = np.hstack([np.zeros((len(walk.q), 6)), measured])
    X = model.regressor(walk.q, walk.v, walk.a)
    T = model.without_contact_forces(walk.q, walk.touching, NOISE)
    rows = (T @ X).reshape(-1, base.rank)
    found = np.linalg.lstsq(rows, (T @ y[:, :, None]).ravel(), rcond=None)[0]
    std = np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))
    off = np.abs(found - model.values()) / std
    assert np.mean(off < 1.96) > 0.85
    assert off.max() < 5
    # contact forces are no small thing: without the projection they spoil everything
    spoilt = np.linalg.lstsq(X.reshape(-1, base.rank), y.ravel(), rcond=None)[0]
    assert np.median(np.abs(spoilt - model.values()) / std) > 20


LOG = """effects: none
log:
  time: t
  position: {trunk.tx: x, trunk.ty: y, trunk.tz: z, trunk.r.w: qw, trunk.r.x: qx, trunk.r.y: qy, trunk.r.z: qz,
             all: "q_{name}"}
  velocity: {trunk.tx: vx, trunk.ty: vy, trunk.tz: vz, trunk.r.x: wx, trunk.r.y: wy, trunk.r.z: wz, all: "v_{name}"}
  output: "tau_{name}"
  contact: "contact_{name}"
"""


@pytest.fixture(scope="module")
def trotted(robot: Path) -> list[str]:
    """Logs of trots and a set-up beside the robot; contacts and nothing of experiments in it."""
    text, rng = robot.read_text(), np.random.default_rng(1)
    (robot.parent / "logged.yaml").write_text(text[: text.index("experiments:")] + LOG)
    model, names = (robot.parent / "quadruped.xml").read_text(), list[str]()
    for seed in range(1, 7):
        names.append(f"trot{seed}.csv")
        write_log(trot(model, 1.8, seed), robot.parent / names[-1], rng)
    return names


@pytest.mark.slow
def test_logs_of_trots_are_identified_by_one_command(
    robot: Path, trotted: list[str]
) -> None:
    command = ("identify", "logged.yaml", *trotted, "-o", "out", "--json")
    ended = run(*command, cwd=robot.parent)
    assert ended.returncode == 0, ended.stderr
    document = json.loads(ended.stdout)
    base = ec.load_identified(robot.parent / "out/model.json").base
    assert base.rank == 94
    rows = zip(document["estimate"]["parameters"], base.values(), strict=True)
    inside = [row["low"] < value < row["high"] for row, value in rows]
    assert np.mean(inside) > 0.9
    scores = document["validations"][-1]["scores"]
    assert {score["output"] for score in scores} >= set(JOINTS)
    assert (robot.parent / "out/identified.xml").exists()
    ended = run("predict", "out/model.json", trotted[0], cwd=robot.parent)
    assert ended.returncode == 2
    assert "forces at contacts" in ended.stderr


def test_what_touches_together_is_an_experiment(
    robot: Path, trotted: list[str]
) -> None:
    paths = [robot.parent / name for name in trotted]
    setup, _, _ = with_logs(ec.load_setup(robot.parent / "logged.yaml"), paths)
    sets = {e.name for e in setup.experiments}
    assert {"fl_fr_rl_rr", "fl_rr", "fr_rl"} <= sets
    assert len(sets) < 7
    # stated experiments must hold what touches
    stated = ec.load_setup(robot.parent / "logged.yaml")
    mechanism = stated.mechanism
    few = [ec.Experiment(mechanism, "one", contacts=["fl", "rr"]),
           ec.Experiment(mechanism, "none", contacts=[])]  # fmt: skip
    with pytest.raises(ec.InputError, match="touch together, and no experiment has"):
        ec.identify(stated.of_experiments(few), paths[0])


@pytest.mark.parametrize("twist", ["body", "world"])
def test_a_twist_is_turned_to_the_axes_of_the_robot(robot: Path, twist: str) -> None:
    import mujoco

    rng, model = np.random.default_rng(0), ec.load(robot.parent / "quadruped.xml")
    q = np.zeros((3, 19))
    q[:, 3:7] = rng.normal(size=(3, 4))
    expected = rng.normal(size=(3, 18))
    given = expected.copy()
    for k in range(3):
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, q[k, 3:7] / np.linalg.norm(q[k, 3:7]))
        R = turn.reshape(3, 3)
        if twist == "body":
            given[k, :3] = R.T @ expected[k, :3]
        else:
            given[k, 3:6] = R @ expected[k, 3:6]
    found = in_own_axes(model, {"q": q, "qd": given}, twist)
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_shapes_are_checked(robot: Path) -> None:
    model = ec.base_parameters(ec.load(robot)).experiment("stand")
    q = np.zeros((2, 19))
    q[:, 3] = 1
    with pytest.raises(
        ec.InputError, match=r"touching has shape \(2, 3\); expected \(2, 4\)"
    ):
        model.without_contact_forces(q, np.ones((2, 3), dtype=bool))
    with pytest.raises(ec.InputError, match="expected 18, above zero"):
        model.without_contact_forces(q, noise=np.zeros(18))
