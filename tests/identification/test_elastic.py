"""Elastic drives identified from encoders on both sides: simulated arms, whose equations are written down by hand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import echelon as ec
from echelon.shared import Floats
from support.elastic_arms import ElasticArm

NOISE = {"tau": 0.01, "joint": 0.02, "q": 2e-6, "theta": 1e-4}
ARM = """
echelon: 1
name: elastic_arm
gravity: [0, -9.81, 0]
modified_dh: [{joint: revolute}, {joint: revolute, a: 0.4}]
rotors:
  - {name: m1, on: base, drives: 100*j1, elastic: true}
  - {name: m2, on: base, drives: 50*j2, elastic: true}
effects: [{type: viscous, at: all}]
"""
MOTORS = """
log:
  time: t
  position: {j1: q1, j2: q2, actuators: "theta{n}"}
  output: "tau{n}"
"""
SENSORS = """
outputs: [{actuator: all}, {joint: j1, name: joint1}, {joint: j2, name: joint2}]
log:
  time: t
  position: {j1: q1, j2: q2, actuators: "theta{n}"}
  output: {actuators: "tau{n}", joint1: joint1, joint2: joint2}
"""


def noisy(log: dict[str, Floats], seed: int) -> dict[str, Floats]:
    rng = np.random.default_rng(seed)
    return {
        name: values + NOISE.get(name[:-1], 0.0) * rng.normal(size=len(values))
        for name, values in log.items()
    }


def truth(arm: ElasticArm) -> dict[str, float]:
    names = ("ZZ1", "MX1", "ZZ2", "MX2")
    found = dict(zip(names, arm.links, strict=True)) | {"MY1": 0.0, "MY2": 0.0}
    for k in range(2):
        found |= {f"ZZ_m{k + 1}": arm.rotors[k], f"Fv{k + 1}": arm.viscous[k]}
        found |= {f"Ks{k + 1}": arm.stiffness[k], f"Ds{k + 1}": arm.damping[k]}
        found[f"Ps{k + 1}"] = 0.0
    return found


def errors(result: ec.Identification, arm: ElasticArm) -> Floats:
    """Errors of the estimate, in standard deviations."""
    estimate, true = result.estimate, truth(arm)
    assert set(estimate.parameters) == set(true)
    expected = np.array([true[name] for name in estimate.parameters])
    return (estimate.values - expected) / estimate.std


@pytest.fixture(scope="module")
def arm() -> ElasticArm:
    return ElasticArm(dry=np.zeros(2))


@pytest.fixture(scope="module")
def log(arm: ElasticArm) -> dict[str, Floats]:
    return arm.simulated(seconds=12.0, rate=500.0)


@pytest.fixture(scope="module")
def found(
    log: dict[str, Floats], tmp_path_factory: pytest.TempPathFactory
) -> ec.Identification:
    return identified(MOTORS, log, tmp_path_factory.mktemp("arm"))


def identified(
    setup: str, log: dict[str, Floats], folder: Path, seed: int = 0
) -> ec.Identification:
    path = folder / "arm.yaml"
    path.write_text(ARM + setup, encoding="utf-8")
    return ec.identify(path, noisy(log, seed))


def test_both_encoders_and_motor_torques_tell_links_and_springs(
    found: ec.Identification, arm: ElasticArm
) -> None:
    assert np.abs(errors(found, arm)).max() < 4
    stiff = found.estimate.parameters.index("Ks1")
    assert found.estimate.std[stiff] < 0.02 * arm.stiffness[0]
    assert min(score.r2 for score in found.validations[-1].scores) > 0.99
    assert not [f for f in found.findings if f.kind in ("duplicate", "angles")]


def test_a_torque_sensor_tells_the_stiffness_better(
    found: ec.Identification,
    arm: ElasticArm,
    log: dict[str, Floats],
    tmp_path: Path,
) -> None:
    sensed = identified(SENSORS, log, tmp_path)
    assert np.abs(errors(sensed, arm)).max() < 4
    place = [r.estimate.parameters.index("Ks2") for r in (found, sensed)]
    assert sensed.estimate.std[place[1]] < 0.7 * found.estimate.std[place[0]]


def test_saved_models_predict_both_forms_of_a_torque(
    found: ec.Identification, log: dict[str, Floats], tmp_path: Path
) -> None:
    ec.save_identification(found, tmp_path / "model.json")
    model = ec.load_identified(tmp_path / "model.json")
    table = np.column_stack(list(noisy(log, 1).values()))
    run = tmp_path / "run.csv"
    np.savetxt(run, table, delimiter=",", header=",".join(log), comments="")
    prediction = ec.predict_log(model.plan, model.values, run)
    assert prediction.outputs == ("m1", "m2", "m1.spring", "m2.spring")
    assert prediction.measured is not None
    np.testing.assert_array_equal(
        prediction.measured[:, :2], prediction.measured[:, 2:]
    )
    assert min(score.r2 for score in prediction.scores) > 0.99


@pytest.mark.slow
def test_intervals_hold_for_random_arms(tmp_path: Path) -> None:
    every = []
    for seed in range(30):
        scale = np.exp(np.random.default_rng(seed).uniform(-0.4, 0.4, 10))
        plain = ElasticArm(dry=np.zeros(2))
        arm = replace(
            plain,
            links=tuple(np.array(plain.links) * scale[[0, 0, 1, 1]]),
            rotors=plain.rotors * scale[2:4],
            viscous=plain.viscous * scale[4:6],
            stiffness=plain.stiffness * scale[6:8],
            damping=plain.damping * scale[8:],
        )
        log = arm.simulated(seconds=20.0, rate=500.0)
        every.append(errors(identified(MOTORS, log, tmp_path, seed), arm))
    inside = np.abs(every) < 2
    assert 0.9 < inside.mean() < 0.99
    assert np.abs(np.mean(every, axis=0)).max() < 1
