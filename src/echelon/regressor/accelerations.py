"""Forward recursion of Newton–Euler, and what a unit of each parameter needs.

Angular velocity, angular acceleration and linear acceleration (minus gravity) of every body, in its own axes; from
them the wrench about the body's origin that a unit of each of its ten standard parameters needs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from echelon.mechanism.mechanism import GROUND, Mechanism
from echelon.program.tape import Program, Scalar
from echelon.regressor.spatial import Vec, add, cross, scale
from echelon.regressor.steps import Recorder, Step, into_frame

Wrench = tuple[Vec, Vec]
"""Moment about the frame's origin and force, in the frame's axes."""


@dataclass(frozen=True)
class Accelerations:
    """Angular velocity, angular acceleration, and linear acceleration of the origin minus gravity."""

    angular: Vec
    angular_rate: Vec
    linear: Vec


def forward_accelerations(
    mechanism: Mechanism, recorder: Recorder, steps: Mapping[int, list[Step]]
) -> dict[int, Accelerations]:
    """Accelerations of every body, by index; the ground has those that gravity stands for."""
    gx, gy, gz = recorder.gravity()
    known = {GROUND: Accelerations(recorder.zeros, recorder.zeros, (-gx, -gy, -gz))}
    for index, body in enumerate(mechanism.bodies):
        current = known[body.parent]
        for step in steps[index]:
            current = _advance(current, step)
        known[index] = current
    return known


def _advance(now: Accelerations, step: Step) -> Accelerations:
    linear = now.linear
    if step.shift is not None:
        swing = add(cross(now.angular_rate, step.shift), cross(now.angular, cross(now.angular, step.shift)))
        linear = add(linear, swing)
    before = into_frame(step, now.angular)
    angular, angular_rate, linear = before, into_frame(step, now.angular_rate), into_frame(step, linear)
    for freedom in step.freedoms:
        turning, sliding = scale(freedom.angular, freedom.rate), scale(freedom.linear, freedom.rate)
        angular = add(angular, turning)
        angular_rate = add(angular_rate, add(cross(before, turning), scale(freedom.angular, freedom.acceleration)))
        coriolis = cross(before, sliding)
        linear = add(linear, add(add(coriolis, coriolis), scale(freedom.linear, freedom.acceleration)))
    return Accelerations(angular, angular_rate, linear)


def unit_wrenches(at: Accelerations, program: Program) -> list[Wrench]:
    """Wrench about the body's origin needed by a unit of each of XX … M."""
    zero, one = program.zero, program.one
    zeros: Vec = (zero, zero, zero)
    wrenches: list[Wrench] = []
    for i in range(3):
        for j in range(i, 3):
            rate = _symmetric_unit(i, j, at.angular_rate, zero)
            momentum = _symmetric_unit(i, j, at.angular, zero)
            wrenches.append((add(rate, cross(at.angular, momentum)), zeros))
    for k in range(3):
        x, y, z = (one if k == axis else zero for axis in range(3))
        unit: Vec = (x, y, z)
        force = add(cross(at.angular_rate, unit), cross(at.angular, cross(at.angular, unit)))
        wrenches.append((cross(unit, at.linear), force))
    wrenches.append((zeros, at.linear))
    return wrenches


def _symmetric_unit(i: int, j: int, v: Vec, zero: Scalar) -> Vec:
    """E v, where E is the symmetric matrix with ones at (i, j) and (j, i)."""
    entries = [zero, zero, zero]
    entries[i] = v[j]
    entries[j] = v[i]
    return (entries[0], entries[1], entries[2])
