"""A walking robot is identified although nobody measures the forces at its feet."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import echelon as ec
from support.walking_robot import LEGS, robot_mjcf, trots

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
