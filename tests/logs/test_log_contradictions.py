"""Velocities and accelerations that contradict positions, and what may be the cause."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from echelon.logs.faults.examine import examine
from echelon.logs.recording import Recording
from support.faulty_logs import ARM, COUNT, RATE, changed, clean, one

FACTORS = [
    (-1.0, "wrong sign"),
    (180 / math.pi, "deg/s (unit: deg/s)"),
    (math.pi / 180, "position were in degrees (unit: deg)"),
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
    found = one(examine(replace(recorded, signals=signals), ARM)[0], "contradiction")
    assert found.where == "run, velocity of 'j2'"
    assert hint in found.text
    assert float(found.text.split()[1]) == pytest.approx(ratio, rel=1e-3)


def test_velocities_of_another_joint_and_accelerations() -> None:
    recorded = clean()
    signals = {**recorded.signals, "qd": recorded.signals["qd"][:, ::-1]}
    del signals["qdd"]
    findings, _ = examine(replace(recorded, signals=signals), ARM)
    assert [finding.kind for finding in findings] == ["contradiction"] * 2
    assert "follows the position of 'j2', and the velocity of 'j2' this one: they are exchanged" in findings[0].text
    flipped = changed(recorded, "qdd", -recorded.signals["qdd"])
    findings, _ = examine(flipped, ARM)
    assert {finding.where for finding in findings} == {"run, acceleration of 'j1'", "run, acceleration of 'j2'"}


def test_wrapped_angles_do_not_contradict_their_velocity() -> None:
    time = np.arange(COUNT) / RATE
    q = np.stack([3 * time + 0.2 * np.sin(5 * time), np.sin(time)], axis=1)
    qd = np.stack([3 + np.cos(5 * time), np.cos(time)], axis=1)
    wrapped = np.stack([(q[:, 0] + np.pi) % math.tau - np.pi, q[:, 1]], axis=1)
    found = examine(Recording("run", time, {"q": wrapped, "qd": qd}), ARM)[0]
    assert {finding.kind for finding in found} <= {"smooth"}  # the positions have no noise, and that is said
