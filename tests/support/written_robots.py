"""Helpers for tests of written robots: parameters, reading again, and what Pinocchio makes of them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from echelon.formats.robot_file import RobotFile
from echelon.formats.snapping import ReadingOptions
from echelon.formats.writers.robot_writer import WrittenRobot
from echelon.robot.inertia import from_pseudo_inertia
from echelon.robot.joint import ALL
from echelon.robot.mechanism import Mechanism
from echelon.shared.conventions import PER_BODY
from support.robot_files import PinocchioState, pinocchio_state

EXACT = ReadingOptions(snap_tolerance=0, independent_mimics=True)


def random_parameters(mechanism: Mechanism, seed: int = 7) -> np.ndarray:
    """Standard parameters of random solid bodies; what is carried alone, and effects, positive."""
    rng = np.random.default_rng(seed)
    values = rng.uniform(0.1, 1.0, len(mechanism.parameters))
    for index, body in enumerate(mechanism.bodies):
        if body.carried == ALL:
            root = np.tril(rng.uniform(-0.3, 0.3, (4, 4))) + np.diag(
                [0.2, 0.2, 0.2, 1.0]
            )
            first = mechanism.first_column[index]
            values[first : first + PER_BODY] = from_pseudo_inertia(root @ root.T)
    return values


def reread(
    written: WrittenRobot,
    options: ReadingOptions = EXACT,
    directory: Path | None = None,
) -> Mechanism:
    return RobotFile.of(written.text.encode(), written.name, directory).mechanism(
        options
    )


def standard(mechanism: Mechanism) -> np.ndarray:
    return np.array(
        [0.0 if value is None else value for value in mechanism.standard_values()]
    )


def geometry(mechanism: Mechanism) -> Mechanism:
    """The mechanism without inertial values."""
    return replace(
        mechanism,
        bodies=tuple(replace(body, inertial=None) for body in mechanism.bodies),
    )


def assert_near(found: np.ndarray, expected: np.ndarray, tolerance: float) -> None:
    np.testing.assert_allclose(
        found, expected, rtol=0, atol=tolerance * np.abs(expected).max()
    )


def pinocchio_efforts(
    mechanism: Mechanism, text: str, states: tuple[np.ndarray, ...], floating: bool
) -> np.ndarray:
    """Pinocchio's inverse dynamics of a URDF text at our states, in our coordinates."""
    import pinocchio as pin

    model = (
        pin.buildModelFromXML(text, pin.JointModelFreeFlyer())
        if floating
        else pin.buildModelFromXML(text)
    )
    gravity = mechanism.gravity
    model.gravity.linear = np.array(
        [0.0] * 3 if gravity is None else [float(part.number) for part in gravity]
    )
    data = model.createData()
    efforts = []
    for q, qd, qdd in zip(*states, strict=True):
        state: PinocchioState = pinocchio_state(mechanism, model, q, qd, qdd)
        efforts.append(state.to_ours(pin.rnea(model, data, state.q, state.v, state.a)))
    return np.array(efforts)


def solid(mass: float, x: float) -> list[float]:
    """A body with a round centre of mass and moments 1, 2, 2.5 about it."""
    return [1.0, 0, 0, 2 + mass * x * x, 0, 2.5 + mass * x * x, mass * x, 0, 0, mass]
