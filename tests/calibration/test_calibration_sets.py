"""Sets of geometric errors, against singular values of Jacobians by Pinocchio, and counts of the literature."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import echelon as ec
from echelon.robot import Mechanism, MotionKind
from support.random_arms import random_arm
from support.simulated_poses import body_frames, moved_onto, pinocchio_model

POINT = (0.13, -0.04, 0.21)
GAP = 1e3
"""Ratio of the singular values on both sides of the rank at least."""


def generators() -> np.ndarray:
    """Shifts along x, y, z and turns about them as 4 × 4 matrices, shape (6, 4, 4)."""
    found = np.zeros((6, 4, 4))
    for k in range(3):
        found[k, k, 3] = 1
        i, j = (k + 1) % 3, (k + 2) % 3
        found[3 + k, j, i], found[3 + k, i, j] = 1, -1
    return found


def slopes(mechanism: Mechanism, q: np.ndarray, outer: np.ndarray, tool: np.ndarray):
    """The tool's frame seen from an outer one, and its slopes by outer, joint and tool errors."""
    frames = np.array(body_frames(pinocchio_model(mechanism), q, {}))
    seen, by_error = [], []
    for chain in frames:
        x = np.linalg.inv(outer) @ chain[-1] @ tool
        columns = [-np.linalg.inv(outer) @ g @ outer @ x for g in generators()]
        for frame in chain:
            rest = np.linalg.solve(frame, chain[-1]) @ tool
            columns += [np.linalg.inv(outer) @ frame @ g @ rest for g in generators()]
        columns += [np.linalg.inv(outer) @ chain[-1] @ g @ tool for g in generators()]
        seen.append(x)
        by_error.append(columns)
    return np.array(seen), np.array(by_error)


def measured_rows(kind: str, x: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Rows of a kind of measurement, shape (rows, errors), from frames (N, 4, 4) and slopes (N, errors, 4, 4)."""
    point, points = (
        np.array([*POINT, 1]),
        np.eye(4)[:, [0, 1, 2]] * 0.1 + np.eye(4)[:, 3:],
    )
    moves = d @ point
    if kind == "pose":
        return d[:, :, :3, :].transpose(0, 2, 3, 1).reshape(-1, d.shape[1])
    if kind == "inverse":
        back = np.linalg.inv(x)[:, None]
        return measured_rows("pose", x, -back @ d @ back)
    if kind == "position":
        return moves[:, :, :3].transpose(0, 2, 1).reshape(-1, d.shape[1])
    if kind == "points":
        return (d @ points)[:, :, :3].transpose(0, 2, 3, 1).reshape(-1, d.shape[1])
    at = (x @ point)[:, :3]
    return np.einsum("ni,nei->ne", at, moves[:, :, :3])


ENTRIES: dict[str, dict[str, Any]] = {
    "pose": {"pose": "TIP"},
    "inverse": {"pose": "TIP", "inverse": True},
    "position": {"position": "TIP", "point": POINT},
    "points": {
        "position": "TIP",
        "points": {"a": [0.1, 0, 0], "b": [0, 0.1, 0], "c": [0, 0, 0.1]},
    },
    "distance": {"distance": "TIP", "point": POINT},
}


def rank_by_gap(rows: np.ndarray, expected: int) -> None:
    """Check that singular values fall by orders of magnitude behind the expected rank."""
    sizes = np.linalg.svd(rows, compute_uv=False)
    left = sizes[expected] if expected < len(sizes) else 0.0
    assert sizes[expected - 1] > GAP * max(left, 1e-13 * sizes[0])


@pytest.mark.parametrize("kind", ENTRIES)
@pytest.mark.parametrize("seed", range(6))
def test_sets_have_the_rank_of_jacobians(kind: str, seed: int) -> None:
    check(kind, seed)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ENTRIES)
@pytest.mark.parametrize("seed", range(6, 30))
def test_more_sets_have_the_rank_of_jacobians(kind: str, seed: int) -> None:
    check(kind, seed)


def check(kind: str, seed: int) -> None:
    """Compare rank and every relation of a random arm's set."""
    rng = np.random.default_rng(seed)
    arm = random_arm(rng)
    tip = arm.bodies[-1].name
    entry = {k: tip if v == "TIP" else v for k, v in ENTRIES[kind].items()}
    base = ec.calibration_base(arm, measure=[entry])
    q = rng.uniform(-2, 2, (80, len(arm.positions)))
    outer = np.eye(4)
    if kind == "distance":  # from a point in general position
        outer[:3, 3] = [base.model.values[f"{axis}_distance1"] for axis in "xyz"]
    x, d = slopes(arm, q, outer, np.eye(4))
    rows = measured_rows(kind, x, d)
    names = [
        f"{c}{label}"
        for label in (
            "_base" if kind != "distance" else "_distance1",
            *(b.label for b in arm.bodies),
            "_tool",
        )
        for c in ("px", "py", "pz", "rx", "ry", "rz")
    ]
    assert set(base.parameters) <= set(names)
    rank_by_gap(rows, base.rank)  # errors that are no parameters add nothing
    order = [names.index(name) for name in base.parameters]
    rows = rows[:, order]
    rank_by_gap(rows, base.rank)
    # every relation holds: rows are those of the pivots times B
    pivots = [base.parameters.index(name) for name in base.pivots]
    b = base.B_float()
    np.testing.assert_allclose(
        rows[:, pivots] @ b, rows, atol=1e-9 * np.abs(rows).max()
    )


RADIUS = 0.3


def touched_rows(kind: str, arm: Mechanism, rng: np.random.Generator) -> np.ndarray:
    """Slopes of what vanishes where a tool touches something, at states that touch it."""
    model, point = pinocchio_model(arm), np.array([*POINT, 1])

    def seen(q: np.ndarray) -> np.ndarray:
        return (np.array(body_frames(model, q[None], {}))[0, -1] @ point)[:3]

    q = rng.uniform(-2, 2, (1, len(arm.positions)))
    outer = np.eye(4)
    outer[:3, :3] = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    outer[:3, 3] = seen(q[0]) - (RADIUS if kind == "sphere" else 0) * outer[:3, 0]

    def off(one: np.ndarray) -> np.ndarray:
        away = outer[:3, :3].T @ (seen(one) - outer[:3, 3])
        if kind == "sphere":
            return np.linalg.norm(away)[None] - RADIUS
        return away[2:] if kind == "plane" else away

    at = q[:1]
    for _ in range(60):  # a walk, since other modes may show more
        near = at[-1:] + rng.uniform(-0.1, 0.1, (1, q.shape[1]))
        at = np.vstack([at, moved_onto(off, near, lambda: np.zeros(1))])
    x, d = slopes(arm, at, outer, np.eye(4))
    moves = (d @ point)[:, :, :3]
    if kind == "sphere":
        return np.einsum("ni,nei->ne", (x @ point)[:, :3], moves)
    rows = moves[:, :, 2:] if kind == "plane" else moves
    return rows.transpose(0, 2, 1).reshape(-1, d.shape[1])


def check_touched(kind: str, seed: int) -> None:
    """Compare the rank of a random arm that touches something with that of slopes by Pinocchio."""
    rng = np.random.default_rng(seed)
    arm = random_arm(rng, 5)
    entry: dict[str, Any] = {kind: arm.bodies[-1].name, "point": POINT}
    if kind == "sphere":
        entry["length"] = RADIUS
    rank_by_gap(
        touched_rows(kind, arm, rng), ec.calibration_base(arm, measure=[entry]).rank
    )


SURFACES = ("plane", "sphere", "contact")


@pytest.mark.parametrize("kind", SURFACES)
def test_touched_surfaces_show_what_jacobians_show(kind: str) -> None:
    check_touched(kind, 1)


@pytest.mark.slow
@pytest.mark.parametrize("kind", SURFACES)
@pytest.mark.parametrize("seed", range(2, 31))
def test_more_touched_surfaces_show_what_jacobians_show(kind: str, seed: int) -> None:
    check_touched(kind, seed)


def test_panda() -> None:
    panda = "examples/panda.yaml"
    pose = ec.calibration_base(panda)
    position = ec.calibration_base(panda, measure=[{"position": "j7"}])
    assert (pose.rank, len(pose.parameters)) == (34, 54)
    assert (position.rank, len(position.parameters)) == (29, 54)
    assert "px1" in pose.pivots
    assert "py2 − pz3 + a4·rz4" in [str(e) for e in pose.expressions]


@pytest.mark.parametrize("seed", range(4))
def test_poses_show_four_per_revolute_and_two_per_prismatic_joint(seed: int) -> None:
    """4R + 2P + 6 (Everett et al. 1987), in general position."""
    rng = np.random.default_rng(100 + seed)
    lines = ["echelon: 1", "name: general", "bodies:"]
    kinds = rng.choice(["revolute", "prismatic"], size=5, p=[0.7, 0.3])
    for k, kind in enumerate(kinds, 1):
        numbers = [f"{v:.2f}" for v in rng.uniform(-1, 1, 6)]
        parent = f"parent: b{k - 1}, " if k > 1 else ""
        origin = f"{{xyz: [{', '.join(numbers[:3])}], rpy: [{', '.join(numbers[3:])}]}}"
        joint = f"{{type: {kind}, name: j{k}, axis: z, origin: {origin}}}"
        lines.append(f"  - {{name: b{k}, {parent}joint: {joint}}}")
    arm = ec.load("\n".join(lines) + "\n")
    slides = sum(m.kind is MotionKind.TRANSLATION for m in arm.motions)
    expected = 4 * (5 - slides) + 2 * slides + 6
    assert ec.calibration_base(arm).rank == expected


@pytest.mark.parametrize(
    ("errors", "rank"),
    [
        (("modified_dh",), 34),
        (("offsets",), 17),
        (("offsets", "gears"), 24),
        (("frames", "gears"), 41),
    ],
)
def test_other_errors_of_panda(errors: tuple[str, ...], rank: int) -> None:
    assert ec.calibration_base("examples/panda.yaml", errors=errors).rank == rank


def test_frames_that_no_table_has_are_refused() -> None:
    with pytest.raises(ec.InputError, match="not those of a table"):
        ec.calibration_base("examples/so101.urdf", errors=("modified_dh",))


def test_masses_that_nobody_states_bend_nothing() -> None:
    with pytest.raises(ec.InputError, match="its mass is unknown"):
        ec.calibration_base("examples/panda.yaml", errors=("frames", "stiffness"))


@pytest.mark.parametrize("ending", ["yaml", "xml"])
def test_loops_measure_themselves(ending: str) -> None:
    robot = f"examples/loops/four_bar.{ending}"
    loop = ec.calibration_base(robot, measure=[{"pose": "coupler"}])
    assert "closed states" in str(loop.certificate)
    assert any("pin_first" in name or "_first" in name for name in loop.parameters)


def test_surfaces_are_touched_at_numbers() -> None:
    arm = "echelon: 1\nsymbols: {l: null}\nmodified_dh: [{joint: revolute}, {joint: revolute, a: l}]\n"
    with pytest.raises(ec.InputError, match="give all symbols values"):
        ec.calibration_base(arm, measure=[{"plane": "j2"}])


def arms(torso: bool) -> str:
    """Two arms on the base, or on a turning torso."""
    lines = ["echelon: 1", "name: arms", "bodies:"]
    if torso:
        lines.append("  - {name: torso, joint: {type: revolute, name: w, axis: z}}")
    for side, y in (("a", 0.2), ("b", -0.2)):
        for k, (place, turn) in enumerate(
            [
                ([0, y, 0.3], [0, 0, 0]),
                ([0.1, 0, 0.2], ["-pi/2", 0, 0]),
                ([0.4, 0, 0], [0, 0, "pi/2"]),
                ([0, 0.1, 0.3], ["pi/2", 0, 0]),
            ],
            1,
        ):
            first = "parent: torso, " if torso else ""
            parent = f"parent: {side}l{k - 1}, " if k > 1 else first
            turns = ", ".join(map(str, turn))
            origin = f"{{xyz: {place}, rpy: [{turns}]}}"
            joint = f"{{type: revolute, name: {side}{k}, axis: z, origin: {origin}}}"
            lines.append(f"  - {{name: {side}l{k}, {parent}joint: {joint}}}")
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    ("torso", "together", "rank"),
    [(False, False, 38), (False, True, 44), (True, False, 38), (True, True, 48)],
)
def test_mounts_of_branches_are_errors(torso: bool, together: bool, rank: int) -> None:
    """Ranks of singular values; a torso under both arms is nothing to one seen from the other."""
    measure = [{"pose": "al4", "on": "bl4"}]
    if together:
        measure = [{"pose": "al4", "name": "A"}, {"pose": "bl4", "name": "B"}]
    assert ec.calibration_base(arms(torso), measure=measure).rank == rank
