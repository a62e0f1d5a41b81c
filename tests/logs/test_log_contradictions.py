"""Velocities and accelerations that contradict positions, and what may be the cause."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

import echelon as ec
from echelon.identification.logs.faults.examine import examine
from echelon.identification.logs.faults.plausibility import contradictions
from echelon.identification.logs.faults.repeated_values import pinned
from echelon.identification.logs.recording import Recording
from support.faulty_logs import ARM, COUNT, RATE, changed, clean, one
from support.robot_files import robot_file
from support.trap_logs import ROBOTS, arm

Floats = npt.NDArray[np.float64]

FACTORS = [
    (-1.0, "wrong sign"),
    (180 / math.pi, "deg/s (unit: deg/s)"),
    (math.pi / 180, "position were in deg (unit: deg)"),
    (30 / math.pi, "rpm"),
    (-0.5 / math.pi, "rev/s), with the wrong sign"),
    (1000.0, "time were in ms"),
    (100.0, "check units, ratio (scale)"),
]


@pytest.mark.parametrize(("ratio", "hint"), FACTORS)
def test_velocities_that_contradict_positions(ratio: float, hint: str) -> None:
    recorded = clean()
    qd = recorded.signals["qd"].copy()
    qd[:, 1] *= ratio
    signals = {**recorded.signals, "qd": qd}
    del signals["qdd"]
    found = one(examine(replace(recorded, signals=signals), ARM)[0], "rates")
    assert found.where == "run, velocity of 'j2'"
    assert hint in found.text
    assert float(found.text.split()[1]) == pytest.approx(ratio, rel=1e-3)


def test_a_clock_that_all_measured_velocities_contradict() -> None:
    recorded = clean()
    slower = replace(
        recorded,
        time=recorded.time * 1.03,
        signals={n: recorded.signals[n] for n in ("q", "qd", "y")},
    )
    found = one(examine(slower, ARM)[0], "rates")
    assert found.where == "run"
    assert "velocities of all joints are 1.03 ±" in found.text
    assert "is the rate 1.03 times that of the time stamps?" in found.text


def test_outputs_that_are_constant_in_a_stretch_are_not_at_a_limit() -> None:
    assert not list(pinned(np.full(500, 5.0), np.ones(500, dtype=bool)))
    assert not list(pinned(np.zeros(0), np.ones(0, dtype=bool)))


def test_velocities_of_another_joint_and_accelerations() -> None:
    recorded = clean()
    signals = {**recorded.signals, "qd": recorded.signals["qd"][:, ::-1]}
    del signals["qdd"]
    findings, _ = examine(replace(recorded, signals=signals), ARM)
    assert [finding.kind for finding in findings] == ["rates"] * 2
    assert (
        "follows the position of 'j2', and the position of 'j1' much less: are columns exchanged?"
        in findings[0].text
    )
    flipped = changed(recorded, "qdd", -recorded.signals["qdd"])
    findings, _ = examine(flipped, ARM)
    assert {finding.where for finding in findings} == {
        "run, acceleration of 'j1'",
        "run, acceleration of 'j2'",
    }


@pytest.mark.parametrize("alike", [0.96, 0.99, 1.0])
@pytest.mark.parametrize("factor", [0.85, 1.2])
@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_velocities_of_joints_that_move_alike_are_not_exchanged(
    alike: float, factor: float, noise: float
) -> None:
    """With a gain that is off, the other joint's velocity may fit better, but not the course of the motion."""
    recorded, rng = clean(), np.random.default_rng(3)
    q, qd = (recorded.signals[name].copy() for name in ("q", "qd"))
    mixed = np.array([[1.0, alike], [0.0, math.sqrt(1 - alike**2)]])
    q, qd = q @ mixed, factor * qd @ mixed
    qd += noise * qd.std(axis=0) * rng.standard_normal(qd.shape)
    findings, _ = examine(
        replace(recorded, signals={**recorded.signals, "q": q, "qd": qd}), ARM
    )
    told = [
        finding.text
        for finding in findings
        if finding.kind == "rates" and "velocity" in finding.where
    ]
    assert len(told) == 2
    assert [float(text.split()[1]) for text in told] == pytest.approx(
        [factor] * 2, rel=0.05
    )
    assert not any("exchanged" in text for text in told)


@pytest.mark.parametrize("robot", ["ur5", "ur3"])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_what_sensors_do_is_no_contradiction_and_exchanges_are(
    robot: str, seed: int
) -> None:
    """Velocities of arms with noise, late, filtered, in steps, with an offset; two exchanged; all moved on by one."""
    moved, rng = arm(robot, seed), np.random.default_rng(seed)
    mechanism = ec.load(robot_file(ROBOTS[robot]))
    order = [moved.names.index(name) for name in mechanism.positions]
    q, qd = 1e-5 * np.round(moved.q[:, order] / 1e-5), moved.qd[:, order]
    noise = qd.std(axis=0) * rng.standard_normal(qd.shape)
    late, mean = np.roll(qd, 6, axis=0), np.cumsum(qd, axis=0)
    filtered, swapped = (
        (mean[10:] - mean[:-10]) / 10,
        qd[:, [1, 0, *range(2, qd.shape[1])]],
    )
    filtered = np.vstack([qd[:10], filtered])
    fine = (
        qd,
        qd + 0.5 * noise,
        qd + 3 * noise,
        late,
        filtered,
        qd + 0.05,
        0.02 * np.round(qd / 0.02),
    )
    usable = np.ones(len(q), dtype=bool)

    def told(velocities: Floats) -> list[str]:
        recorded = Recording("run", moved.time, {"q": q, "qd": velocities})
        return [finding.text for finding in contradictions(recorded, mechanism, usable)]

    assert not [text for velocities in fine for text in told(velocities)]
    assert ["exchanged" in text for text in told(swapped + 0.3 * noise)] == [True] * 2
    assert ["exchanged" in text for text in told(np.roll(qd, 1, axis=1))] == [
        True
    ] * qd.shape[1]


def test_wrapped_angles_do_not_contradict_their_velocity() -> None:
    time = np.arange(COUNT) / RATE
    q = np.stack([3 * time + 0.2 * np.sin(5 * time), np.sin(time)], axis=1)
    qd = np.stack([3 + np.cos(5 * time), np.cos(time)], axis=1)
    wrapped = np.stack([(q[:, 0] + np.pi) % math.tau - np.pi, q[:, 1]], axis=1)
    found = examine(Recording("run", time, {"q": wrapped, "qd": qd}), ARM)[0]
    assert {finding.kind for finding in found} <= {
        "smooth"
    }  # the positions have no noise, and that is said
