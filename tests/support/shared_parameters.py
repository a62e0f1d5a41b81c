"""Mechanisms whose bodies share parameters, and their regressors from Pinocchio."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import yaml

import echelon as ec
from echelon.formats.robot_file import RobotFile
from echelon.formats.snapping import ReadingOptions
from support import float_regressor as oracles
from support.closed_states import states
from support.float_regressor import FloatArray
from support.paths import ROOT
from support.pinocchio_loops import Constrained

LOOPS = ROOT / "examples" / "loops"


def identical_legs(name: str) -> ec.Mechanism:
    """A robot of the examples whose legs, which end in numbers, share their parameters."""
    data = yaml.safe_load((LOOPS / f"{name}.yaml").read_text())
    for body in data["bodies"]:
        body["label"] = body["name"].rstrip("0123456789")
    return RobotFile.of(
        yaml.safe_dump(data, sort_keys=False).encode(), "robot.yaml"
    ).mechanism(ReadingOptions())


CAR = """
symbols: {a: 0.3, b: 0.2}
bodies:
  - {name: chassis, joint: {type: floating}}
  - {name: w1, label: wheel, parent: chassis, joint: {type: revolute, axis: y, origin: {xyz: [a, b, 0]}}}
  - {name: w2, label: wheel, parent: chassis, joint: {type: revolute, axis: y, origin: {xyz: [a, -b, 0]}}}
  - {name: w3, label: wheel, parent: chassis, joint: {type: revolute, axis: y, origin: {xyz: [-a, b, 0]}}}
  - {name: w4, label: wheel, parent: chassis, joint: {type: revolute, axis: y, origin: {xyz: [-a, -b, 0]}}}
"""

LINK = "joint: {type: revolute, axis: z, origin: {xyz: [0.4, 0, 0]}}"
PENDULUM = f"""
gravity: [0, -9.81, 0]
bodies:
  - {{name: one, label: link, joint: {{type: revolute, axis: z}}}}
  - {{name: two, label: link, parent: one, {LINK}}}
"""


def chain(count: int, *shared: int) -> str:
    """Links on joints about different axes, some of which are alike."""
    rows = []
    for k in range(count):
        label = "link" if k in shared else f"l{k}"
        parent = f"parent: b{k - 1}, " if k else ""
        origin = f"origin: {{xyz: [0.{k + 1}, 0.2, 0.1], rpy: [pi/{k % 3 + 3}, 0, 0]}}"
        joint = f"joint: {{type: revolute, axis: {'zy'[k % 2]}, {origin}}}"
        rows.append(f"  - {{name: b{k}, label: {label}, {parent}{joint}}}\n")
    return "bodies:\n" + "".join(rows)


def pinocchio_regressor(
    mechanism: ec.Mechanism, count: int
) -> tuple[FloatArray, tuple[FloatArray, ...]]:
    """Forces by a unit of every parameter, shape (samples, outputs, parameters), and the states.

    A parameter of several bodies is given to all of them at once.
    """
    state = (
        states(mechanism, count)
        if mechanism.closures
        else oracles.random_states(mechanism, count)
    )
    bodies = mechanism.bodies
    ones = np.ones(10 * len(bodies))
    labels = list(dict.fromkeys(body.label for body in bodies))
    models = [Constrained(mechanism, ones)]
    for label in labels:
        for kind in range(10):
            zeta = ones.copy()
            zeta[
                [10 * k + kind for k, body in enumerate(bodies) if body.label == label]
            ] += 1
            models.append(Constrained(mechanism, zeta))
    forces = np.array(
        [
            [_forces(model, *sample) for model in models]
            for sample in zip(*state, strict=True)
        ]
    )
    return (forces[:, 1:] - forces[:, :1]).transpose(0, 2, 1), state


def _forces(
    model: Constrained, q: FloatArray, qd: FloatArray, qdd: FloatArray
) -> FloatArray:
    if model.mechanism.closures:
        return model.dynamics(q, qd, qdd)[0]
    rates = (model.couplings @ qd, model.couplings @ qdd)
    effort: FloatArray = model.couplings.T @ pin.rnea(
        model.model, model.data, model.joint_positions(q), *rates
    )
    return effort


def rank_of(matrix: FloatArray) -> int:
    sizes = np.linalg.norm(matrix, axis=0)
    singular = np.linalg.svd(
        matrix / np.maximum(sizes, 1e-2 * sizes.max()), compute_uv=False
    )
    return int((singular > 1e-7 * singular[0]).sum())
