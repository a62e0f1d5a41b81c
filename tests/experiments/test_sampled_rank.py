"""Ranks of motions that were driven, against singular values of Pinocchio's rows."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import echelon as ec
from support.command_line import run
from support.paths import EXAMPLES
from support.pinocchio_regressor import pinocchio_regressor
from support.selection import one_in
from support.stacked_rows import GAP, random_urdf

Motion = dict[str, np.ndarray]


def harmonics(
    rng: np.random.Generator, moving: np.ndarray, samples: int = 120
) -> Motion:
    """Two harmonics for each joint that moves; others stand somewhere."""
    t = np.linspace(0, 3, samples)[:, None]
    start, a, b = rng.uniform(-1, 1, (3, len(moving)))
    a, b = a * moving, b * moving
    return {
        "q": start + a * np.sin(2 * t) + b * np.cos(5 * t),
        "qd": 2 * a * np.cos(2 * t) - 5 * b * np.sin(5 * t),
        "qdd": -4 * a * np.sin(2 * t) - 25 * b * np.cos(5 * t),
    }


@pytest.mark.parametrize("seed", one_in(6, range(36)))
def test_ranks_are_those_of_stacked_rows(seed: int) -> None:
    """Joints that stand, few samples, and motions that repeat themselves."""
    pin = pytest.importorskip("pinocchio")
    rng = np.random.default_rng(seed)
    text = random_urdf(rng, int(rng.integers(2, 6)))
    robot = ec.load(text)
    base = ec.base_parameters(robot)
    moving = rng.random(len(robot.positions)) < rng.choice([0.4, 0.7, 1.0])
    motion = harmonics(rng, moving, int(rng.choice([3, 8, 120])))
    if seed % 3 == 0:
        motion = {name: np.tile(part, (2, 1)) for name, part in motion.items()}
    model = pin.buildModelFromXML(text)
    rows = pinocchio_regressor(robot, model, *motion.values())
    rows = rows.reshape(-1, rows.shape[2])
    sizes = np.linalg.norm(rows, axis=0)
    sizes[sizes < 1e-12 * sizes.max()] = np.inf
    shown = np.linalg.svd(rows / sizes, compute_uv=False)
    falls = shown[:-1] / np.maximum(shown[1:], 1e-16)
    found = ec.sampled_rank(base, motion)
    if found.rank < len(shown):
        assert falls[found.rank - 1] == falls.max() > GAP
    assert found.most == found.rank
    assert not found.doubt
    assert found.gap > GAP
    # what is not seen changes no row
    X = base.regressor(*motion.values()).reshape(-1, base.rank)
    assert np.abs(X @ found.unseen.T).max(initial=0.0) < 1e-9 * np.abs(X).max()
    assert len(found.unseen) == base.rank - found.rank


def test_rounding_of_a_log_hides_what_is_small(tmp_path: Path) -> None:
    """Links that swing by 0.05 rad show one combination by the square of that: three decimals do not suffice."""
    base = ec.base_parameters(EXAMPLES / "double_pendulum.yaml")
    t = np.linspace(0, 10, 500)[:, None]
    w = np.array([3.0, 5.0])
    q, qd = 0.05 * np.sin(w * t), 0.05 * w * np.cos(w * t)
    names = base.mechanism.positions
    heads = [f"{kind}_{name}" for kind in ("q", "qd", "qdd") for name in names]
    columns = np.hstack([t, q, qd, -(w**2) * q])
    ranks = {}
    for decimals in (12, 7, 5, 3):
        file = tmp_path / f"{decimals}.csv"
        np.savetxt(
            file,
            columns,
            fmt=f"%.{decimals}f",
            delimiter=",",
            header=",".join(["t", *heads]),
            comments="",
        )
        ranks[decimals] = ec.sampled_rank(base, file)
    exact = dict(zip(("q", "qd", "qdd"), (q, qd, -(w**2) * q), strict=True))
    assert ec.sampled_rank(base, exact).rank == 6
    assert {d: (r.rank, r.most) for d, r in ranks.items()} == {
        12: (6, 6),
        7: (6, 6),
        5: (5, 6),
        3: (5, 5),
    }
    assert ranks[7].gap < ranks[12].gap
    assert "5 to 6 combinations" in ranks[5].doubt
    assert not ranks[3].doubt
    assert ranks[3].unseen.shape == (1, 6)


def test_positions_alone_give_rates_by_a_spline(tmp_path: Path) -> None:
    base = ec.base_parameters(EXAMPLES / "double_pendulum.yaml")
    t = np.linspace(0, 10, 800)[:, None]
    q = np.sin(np.array([1.0, 2.3]) * t)
    head = ",".join(["t", *base.mechanism.positions, "tau_1"])
    table = np.hstack([t, q, 0 * t])
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header=head, comments="")
    found = ec.sampled_rank(base, tmp_path / "log.csv")
    assert found.rank == found.most == 6


def test_experiments_are_stacked(tmp_path: Path) -> None:
    """The table shows 43 combinations of an arm, and a wall two more, whatever is driven there."""
    rng = np.random.default_rng(1)
    whole = harmonics(rng, np.ones(7))
    robot = ec.load(EXAMPLES / "panda.yaml")
    still = {name: part[:1] for name, part in whole.items()}
    table = ec.Experiment(robot, "table", motion=whole)
    wall = ec.Experiment(robot, "wall", gravity=(9.81, 0, 0), motion=still)
    assert ec.sampled_rank([table]).rank == 43
    both = ec.sampled_rank([table, wall])
    assert (both.rank, both.base.rank) == (44, 45)
    text = (EXAMPLES / "panda.yaml").read_text()
    entries = "experiments:\n  - {name: table, motion: whole.csv}\n"
    entries += "  - {name: wall, gravity: [9.81, 0, 0], motion: whole.csv}\n"
    (tmp_path / "set.yaml").write_text(text + entries)
    names = [f"{kind}_{n}" for kind in whole for n in robot.positions]
    columns = np.hstack([np.linspace(0, 3, 120)[:, None], *whole.values()])
    head = ",".join(["t", *names])
    np.savetxt(tmp_path / "whole.csv", columns, delimiter=",", header=head, comments="")
    found = run("sensors", "set.yaml", cwd=tmp_path)
    assert "driven: 240 samples show 45 of 45 base parameters" in found.stdout
    record = json.loads(run("sensors", "set.yaml", "--json", cwd=tmp_path).stdout)
    assert record["driven"]["rank"] == 45


def test_forces_at_a_foot_are_left_out() -> None:
    """Poses of a body on one point foot, which does not slip if nothing moves."""
    text = (EXAMPLES / "floating_tree.yaml").read_text()
    base = ec.base_parameters(ec.load(text + "contacts: [{body: hand}]\n"))
    rng = np.random.default_rng(3)
    q = rng.normal(size=(80, len(base.mechanism.positions)))
    for k, name in enumerate(base.mechanism.positions):
        if name.endswith(".w"):
            q[:, k : k + 4] /= np.linalg.norm(q[:, k : k + 4], axis=1, keepdims=True)
    still = np.zeros((80, len(base.mechanism.velocities)))
    rows = base.without_contact_forces(q) @ base.regressor(q, still, still)
    sizes = np.linalg.svd(rows.reshape(-1, base.rank), compute_uv=False)
    found = ec.sampled_rank(base, {"q": q, "qd": still, "qdd": still})
    assert 0 < found.rank < base.rank
    assert sizes[found.rank - 1] > GAP * sizes[found.rank]


def test_what_does_not_fit_is_refused(tmp_path: Path) -> None:
    robot = ec.load(EXAMPLES / "double_pendulum.yaml")
    with pytest.raises(ec.InputError, match="no motion is stated"):
        ec.sampled_rank(robot)
    with pytest.raises(ec.InputError, match="the motion lacks qdd"):
        ec.sampled_rank(robot, {"q": np.zeros((3, 2)), "qd": np.zeros((3, 2))})
    (tmp_path / "log.csv").write_text("t,q1\n0,0\n")
    with pytest.raises(ec.InputError, match="no column"):
        ec.sampled_rank(robot, tmp_path / "log.csv")


def test_samples_that_are_no_numbers_are_refused() -> None:
    base = ec.base_parameters("examples/double_pendulum.yaml")
    q = np.random.default_rng(0).normal(size=(9, 2))
    qd = np.where(np.arange(9)[:, None] == 5, np.nan, q)
    with pytest.raises(ec.InputError, match="qd of sample 5 is no number"):
        ec.sampled_rank(base, {"q": q, "qd": qd, "qdd": q})
