"""Sensors of motion that measure combinations of coordinates, such as inclinometers: s = Σ weight · q + zero.

A body that turns about level axes of one direction only tilts by the sum of its joints' angles.  A swing about the
vertical below these axes, and slides anywhere, change nothing.  So an inclinometer is one more linear equation for the
positions, as the encoder of a motor is; the angle to the vertical of any other body is no such sum.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from echelon.robot import (
    GROUND,
    Mechanism,
    Motion,
    MotionKind,
    Step,
    known_values,
    placement_matrix,
    symbol_values,
)
from echelon.shared import Floats, InputError

LARGEST_AXIS_ERROR = 1e-3
"""Angle, rad, by which an axis may miss the vertical, the level or another axis: files round their numbers."""


@dataclass(frozen=True)
class MotionSensor:
    """A sensor of positions, velocities and accelerations: the combination of coordinates that it measures."""

    weights: Mapping[str, float]  # by coordinate
    zero: float = 0.0  # what it shows where all coordinates are zero, rad or m


Sensors = Mapping[str, MotionSensor]
"""Sensors of motion by name."""

NO_SENSORS: Sensors = {}


def inclinometer(mechanism: Mechanism, name: str, axis: str) -> MotionSensor:
    """The sensor of the angle from the vertical, upwards, to an axis (x, y or z) of a body's frame, rad.

    The angle grows as the coordinate of the last joint does that tilts the body.  Raises an error where it is no sum of
    coordinates.
    """
    turns = _Turns(mechanism, _up(mechanism))
    for step in _path(mechanism, name):
        turns.add(step)
    if not turns.axes:
        raise InputError("no joint tilts this body")
    last, pointing = list(turns.axes.values())[-1], turns.frame[:, "xyz".index(axis)]
    if abs(pointing @ last) > LARGEST_AXIS_ERROR:
        other = "xyz"[int(np.argmin(np.abs(last @ turns.frame)))]
        problem = f"its {axis} axis does not lie in the plane in which the body tilts; write  axis: {other}"
        raise InputError(problem)
    weights: dict[str, float] = {}
    for joint, turned in turns.axes.items():
        direction = float(np.sign(turned @ last))
        for coordinate, ratio in _ratios(mechanism, joint).items():
            weights[coordinate] = weights.get(coordinate, 0.0) + direction * ratio
    zero = np.arctan2(np.cross(turns.up, pointing) @ last, turns.up @ pointing)
    return MotionSensor(weights, float(zero))


@dataclass
class _Turns:
    """Motions that turn a body, from the base outwards, while all coordinates are zero."""

    mechanism: Mechanism
    up: Floats  # unit vector in the base frame, shape (3,)
    frame: Floats = field(default_factory=lambda: np.eye(3))  # axes of the body, (3, 3)
    axes: dict[str, Floats] = field(default_factory=dict)  # level ones, by joint

    def add(self, step: Step) -> None:
        """Take the next placement or motion of the way to the body."""
        if not isinstance(step, Motion):
            symbols = symbol_values(self.mechanism, step.symbols())
            self.frame = self.frame @ placement_matrix(step, symbols)[:3, :3]
            return
        if step.kind is MotionKind.TRANSLATION:
            return
        axis = step.sign * self.frame[:, step.axis]
        is_ball = step.kind is MotionKind.BALL
        if not is_ball and not self.axes and _parallel(axis, self.up):
            return  # a swing
        level = abs(axis @ self.up) < LARGEST_AXIS_ERROR
        if (
            is_ball
            or not level
            or not all(_parallel(axis, a) for a in self.axes.values())
        ):
            problem = f"joint '{step.name}' turns neither about the vertical, below all joints that tilt the body, nor "
            problem += "about the level axis of these, so the angle is not a sum of coordinates: log its position"
            raise InputError(problem)
        self.axes[step.name] = axis


def _parallel(one: Floats, other: Floats) -> bool:
    return bool(np.linalg.norm(np.cross(one, other)) < LARGEST_AXIS_ERROR)


def _up(mechanism: Mechanism) -> Floats:
    """The direction against gravity in the base frame, shape (3,)."""
    known = known_values(mechanism)
    for component in mechanism.gravity or ():
        if not known.keys() >= set(component.symbols()):
            raise InputError("the direction of gravity has no value: state its symbols")
    down = np.array([float(part.at(known)) for part in mechanism.gravity or ()])
    if not down.any():
        raise InputError(
            "without gravity nothing is vertical: state it, as in  gravity: [0, 0, -9.81]"
        )
    return np.asarray(-down / np.linalg.norm(down))


def _path(mechanism: Mechanism, name: str) -> list[Step]:
    """Steps from the base to a body."""
    index = next(k for k, body in enumerate(mechanism.bodies) if body.name == name)
    steps: list[Step] = []
    while index != GROUND:
        body = mechanism.bodies[index]
        steps, index = [*body.joint.steps, *steps], body.parent
    return steps


def _ratios(mechanism: Mechanism, joint: str) -> dict[str, float]:
    """A joint's coordinate as a combination of those that no coupling makes dependent."""
    coupling = next((c for c in mechanism.couplings if c.coordinate == joint), None)
    if coupling is None:
        return {joint: 1.0}
    found = {}
    for name, function in coupling.terms:
        ratio = function.ratio
        if ratio is None:
            problem = f"'{joint}' follows from '{name}' by a nonlinear function, so the angle is not a sum"
            raise InputError(problem)
        found[name] = float(ratio.at(symbol_values(mechanism, ratio.symbols())))
    return found
