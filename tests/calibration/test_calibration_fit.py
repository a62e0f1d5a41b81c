"""Planted errors of geometry are found again, with intervals that hold, for every kind of measurement."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import echelon as ec
from echelon.calibration import calibration_document
from echelon.calibration.calibrating import error_model, setup_for
from echelon.calibration.fit import GeometryFit
from echelon.calibration.log import observed
from echelon.identification import log_paths
from echelon.robot import Mechanism
from support.random_arms import random_arm
from support.simulated_poses import (
    body_frames,
    moved_onto,
    pinocchio_model,
    twist,
)

Floats = np.ndarray
NOISE, TURNED = 1e-4, 5e-4
"""Standard deviations of simulated noise, m and rad."""

TORSO = """
echelon: 1
name: torso
modified_dh:
  - {name: lift, joint: prismatic, d: 0.6}
  - {name: waist, joint: revolute, d: 0.1}
  - {name: shoulder, joint: revolute, alpha: -pi/2, a: 0.2}
  - {name: upper, joint: revolute, alpha: pi/2, d: 0.4}
  - {name: elbow, joint: revolute, alpha: -pi/2, a: 0.04}
  - {name: fore, joint: revolute, alpha: pi/2, d: 0.35}
  - {name: hand, joint: revolute, alpha: -pi/2}
"""


@dataclass(frozen=True)
class Truth:
    """A robot with planted errors, a tracker and a tool."""

    mechanism: Mechanism
    errors: Mapping[int, Floats]
    outer: Floats
    tool: Floats

    def seen(self, q: Floats) -> Floats:
        """The tool seen by the tracker, shape (N, 4, 4)."""
        frames = np.array(body_frames(pinocchio_model(self.mechanism), q, self.errors))
        return np.linalg.inv(self.outer) @ frames[:, -1] @ self.tool


def planted(
    mechanism: Mechanism, rng: np.random.Generator, size: float = 1e-3
) -> Truth:
    errors = {k: twist(rng, size, size) for k in range(len(mechanism.bodies))}
    outer, tool = (pin.SE3.Random().homogeneous for _ in range(2))
    tool[:3, 3] = rng.uniform(-0.15, 0.15, 3)
    return Truth(mechanism, errors, outer, tool)


def poses(mechanism: Mechanism, count: int, rng: np.random.Generator) -> Floats:
    return rng.uniform(-1.5, 1.5, (count, len(mechanism.positions)))


def table(mechanism: Mechanism, q: Floats, **columns: Floats) -> dict[str, Floats]:
    return {f"q_{n}": q[:, k] for k, n in enumerate(mechanism.positions)} | columns


def xyz(
    points: Floats, rng: np.random.Generator, before: str = ""
) -> dict[str, Floats]:
    noisy = points + rng.normal(scale=NOISE, size=points.shape)
    return {f"{before}{axis}": noisy[:, k] for k, axis in enumerate("xyz")}


def pose_log(truth: Truth, q: Floats, rng: np.random.Generator) -> dict[str, Floats]:
    seen = truth.seen(q)
    turned = np.array(
        [r @ pin.exp3(rng.normal(scale=TURNED, size=3)) for r in seen[:, :3, :3]]
    )
    matrix = {f"r{i + 1}{j + 1}": turned[:, i, j] for i in range(3) for j in range(3)}
    return table(truth.mechanism, q, **xyz(seen[:, :3, 3], rng), **matrix)


def camera_log(truth: Truth, q: Floats, rng: np.random.Generator) -> dict[str, Floats]:
    seen = np.linalg.inv(truth.seen(q))
    vectors = np.array([pin.log3(r) for r in seen[:, :3, :3]])
    vectors += rng.normal(scale=TURNED, size=vectors.shape)
    turns = {f"r{axis}": vectors[:, k] for k, axis in enumerate("xyz")}
    return table(truth.mechanism, q, **xyz(seen[:, :3, 3], rng), **turns)


def position_log(
    truth: Truth, q: Floats, rng: np.random.Generator
) -> dict[str, Floats]:
    return table(truth.mechanism, q, **xyz(truth.seen(q)[:, :3, 3], rng))


MARKERS = {
    "m1": [0.1, 0, 0],
    "m2": [-0.1, 0.05, 0],
    "m3": [0, 0.1, 0.05],
    "m4": [0, -0.1, 0.1],
}


def marker_log(truth: Truth, q: Floats, rng: np.random.Generator) -> dict[str, Floats]:
    columns: dict[str, Floats] = {}
    for name, point in MARKERS.items():
        columns |= xyz((truth.seen(q) @ [*point, 1])[:, :3], rng, f"{name}_")
    return table(truth.mechanism, q, **columns)


def distance_log(
    truth: Truth, q: Floats, rng: np.random.Generator
) -> dict[str, Floats]:
    length = np.linalg.norm(truth.seen(q)[:, :3, 3], axis=1)
    return table(truth.mechanism, q, bar=length + rng.normal(scale=NOISE, size=len(q)))


CENTRE, RADIUS = np.array([0.5, 0.2, 0.4]), 0.2
"""Point that is touched, or centre of a touched sphere, and its radius, m."""


def touching_log(kind: str) -> Log:
    """Logs of positions at which a tool touches a plane, a sphere or a point, but for noise."""

    def log(truth: Truth, q: Floats, rng: np.random.Generator) -> dict[str, Floats]:
        model = pinocchio_model(truth.mechanism)

        def off(one: Floats) -> Floats:
            frame = np.array(body_frames(model, one[None], truth.errors))[0, -1]
            place = (frame @ truth.tool)[:3, 3]
            if kind == "plane":
                return np.linalg.solve(truth.outer, [*place, 1])[2:3]
            gap = place - CENTRE
            return gap if kind == "contact" else np.linalg.norm(gap)[None] - RADIUS

        def noise() -> Floats:
            return rng.normal(scale=NOISE, size=off(q[0]).shape)

        return table(truth.mechanism, moved_onto(off, q, noise))

    return log


Log = Callable[[Truth, Floats, np.random.Generator], dict[str, Floats]]
CASES: dict[str, tuple[str, dict[str, Any], Log, int]] = {
    "UR10, poses": ("ur10", {"pose": "TIP"}, pose_log, 60),
    "UR10, camera in the hand": (
        "ur10",
        {"pose": "TIP", "inverse": True},
        camera_log,
        60,
    ),
    "KUKA, positions": ("kuka", {"position": "TIP"}, position_log, 120),
    "torso, four markers": (
        "torso",
        {"position": "TIP", "points": MARKERS},
        marker_log,
        60,
    ),
    "UR10, ball bar": (
        "ur10",
        {"distance": "TIP", "columns": "bar"},
        distance_log,
        200,
    ),
    "UR10, contact": ("ur10", {"contact": "TIP"}, touching_log("contact"), 150),
    "UR10, plane": ("ur10", {"plane": "TIP"}, touching_log("plane"), 150),
    "UR10, sphere": (
        "ur10",
        {"sphere": "TIP", "length": RADIUS},
        touching_log("sphere"),
        150,
    ),
}


def mechanism_of(name: str) -> Mechanism:
    if name == "torso":
        return ec.load(TORSO)
    if name == "kuka":
        return random_arm(np.random.default_rng(12), 7, slides=0)
    return ec.load("examples/ur10.yaml")


def found_for(name: str, seed: int) -> tuple[Truth, ec.Calibration]:
    robot, entry, log, count = CASES[name]
    rng = np.random.default_rng(seed)
    pin.seed(seed)
    mechanism = mechanism_of(robot)
    truth = planted(mechanism, rng)
    tip = mechanism.bodies[-1].name
    entry = {k: tip if v == "TIP" else v for k, v in entry.items()}
    data = log(truth, poses(mechanism, count, rng), rng)
    return truth, ec.calibrate(mechanism, data, measure=[entry])


def covered(truth: Truth, base: ec.LinearBase, intervals: Floats) -> list[bool]:
    """Whether intervals of combinations of the robot's errors alone hold the planted values."""
    own = {
        f"{part}{truth.mechanism.bodies[k].label}": value
        for k, errors in truth.errors.items()
        for part, value in zip(
            ("px", "py", "pz", "rx", "ry", "rz"), errors, strict=True
        )
    }
    names = base.parameters
    return [
        bool(
            low <= sum(c * own[n] for c, n in zip(row, names, strict=True) if c) <= high
        )
        for row, (low, high) in zip(base.B_float(), intervals, strict=True)
        if all(n in own for c, n in zip(row, names, strict=True) if c)
    ]


def coverage(name: str, seeds: Iterable[int]) -> Iterator[list[bool]]:
    """Whether intervals hold, for logs of one robot with other errors, poses and noise each.

    The set of combinations and the frames are those of the first log, since tracker and tool stay where they are.
    """
    robot, entry, log, count = CASES[name]
    mechanism = mechanism_of(robot)
    tip = mechanism.bodies[-1].name
    entry = {k: tip if v == "TIP" else v for k, v in entry.items()}
    setup = setup_for(mechanism)
    model = error_model(setup, [entry], ("frames",))
    base, state = None, None
    for seed in seeds:
        rng = np.random.default_rng(seed)
        pin.seed(0)
        truth = planted(mechanism, rng)
        truth.tool[:3, 3] = [0.1, -0.05, 0.12]
        rows = log(truth, poses(mechanism, count, rng), rng)
        data = observed(model, setup, log_paths(rows))
        fit = GeometryFit(model, data, seed)
        state = fit.start() if state is None else fit.framed(state)
        touched = data.q[:1] if model.sights[0].constrains else None
        base = model.base(state.frames, touched) if base is None else base
        yield covered(truth, base, fit.intervals(fit.fitted(state, base)))


@pytest.mark.parametrize("name", CASES)
def test_planted_errors_are_found(name: str) -> None:
    truth, found = found_for(name, 1)
    for score in found.scores:
        noise = TURNED if score.unit == "rad" else NOISE
        assert score.after < 3 * noise
        assert score.after < score.before
        assert 0.7 * noise < score.noise < 1.3 * noise
    inside = covered(truth, found.base, found.intervals)
    assert len(inside) > 8
    assert np.mean(inside) > 0.8


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_intervals_hold(name: str) -> None:
    inside = [x for some in coverage(name, range(200)) for x in some]
    assert 0.93 < np.mean(inside) < 0.97


def test_the_calibrated_robot_moves_as_the_true_one() -> None:
    truth, found = found_for("UR10, poses", 5)
    q = poses(truth.mechanism, 20, np.random.default_rng(8))
    from echelon.dynamics import Kinematics

    frames = Kinematics(found.robot.mechanism).frames(q)[:, -1]
    tool = (
        np.linalg.inv(found.frames["base"])
        @ np.concatenate([frames, np.tile([[[0, 0, 0, 1.0]]], (20, 1, 1))], axis=1)
        @ found.tools["tool"]
    )
    gap = np.linalg.norm(tool[:, :3, 3] - truth.seen(q)[:, :3, 3], axis=1)
    assert gap.max() < 3 * NOISE


def test_outliers_are_named_and_left_out() -> None:
    rng = np.random.default_rng(2)
    pin.seed(2)
    arm = mechanism_of("ur10")
    truth = planted(arm, rng)
    data = pose_log(truth, poses(arm, 60, rng), rng)
    for row in (7, 30, 31):
        data["x"][row] += 0.02
    found = ec.calibrate(arm, data)
    assert found.outliers == ("pose1: row 8, 31, 32",)
    assert found.left_out == 3
    assert np.mean(covered(truth, found.base, found.intervals)) > 0.8


def test_what_few_poses_do_not_show_stays_nominal() -> None:
    rng = np.random.default_rng(4)
    pin.seed(4)
    arm = mechanism_of("ur10")
    truth = planted(arm, rng)
    q = poses(arm, 60, rng)
    q[:, 3] = 0.3  # a joint that never moves hides the frames around it
    found = ec.calibrate(arm, pose_log(truth, q, rng))
    assert found.hidden
    assert all(np.isfinite(found.values))


def test_fewer_numbers_than_combinations_are_refused() -> None:
    rng = np.random.default_rng(4)
    pin.seed(4)
    arm = mechanism_of("ur10")
    data = position_log(planted(arm, rng), poses(arm, 8, rng), rng)
    with pytest.raises(ec.InputError, match="measure more poses"):
        ec.calibrate(arm, data, measure=[{"position": arm.bodies[-1].name}])


def test_offsets_and_ratios() -> None:
    rng = np.random.default_rng(6)
    arm = mechanism_of("ur10")
    q = poses(arm, 60, rng)
    offsets, ratios = rng.normal(scale=3e-3, size=(2, 6))
    true = q * (1 + ratios) + offsets
    pin.seed(6)
    truth = planted(arm, rng, 0.0)
    data = pose_log(truth, true, rng)
    data |= {f"q_{n}": q[:, k] for k, n in enumerate(arm.positions)}
    found = ec.calibrate(arm, data, errors=("offsets", "gears"))
    for k in range(1, 5):
        name = arm.bodies[k].label
        assert found.errors[f"ratio{name}"] == pytest.approx(ratios[k], abs=1e-3)
        assert found.errors[f"offset{name}"] == pytest.approx(offsets[k], abs=1e-3)


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_exact_logs_that_leave_combinations_open() -> None:
    rng = np.random.default_rng(4)
    pin.seed(4)
    arm = mechanism_of("ur10")
    truth = planted(arm, rng)
    q = poses(arm, 40, rng)
    q[:, 3] = 0.3
    seen = truth.seen(q)
    columns = {axis: seen[:, k, 3] for k, axis in enumerate("xyz")}
    columns |= {f"r{i + 1}{j + 1}": seen[:, i, j] for i in range(3) for j in range(3)}
    found = ec.calibrate(arm, table(arm, q, **columns))
    assert found.hidden
    assert np.isfinite(found.deviations).all()
    assert calibration_document(found)["rank"] == found.base.rank
