"""The regressor of the inverse dynamics, y = X(q, q̇, q̈) ζ, by recursive Newton–Euler.

Forward: angular velocity, angular acceleration and linear acceleration (minus gravity) of every frame.  Backward: for
each of a body's ten parameters the wrench that a unit of it needs about the body's origin is carried back along the
chain; each freedom on the way reads its generalised force off it.
"""

from __future__ import annotations

from dataclasses import dataclass

from echelon.mechanism.mechanism import GROUND, Mechanism
from echelon.program.tape import Program, Scalar
from echelon.regressor.linear import LinearForms
from echelon.regressor.spatial import Vec, add, apply, cross, dot, scale
from echelon.regressor.steps import Recorder, Step, into_frame

Wrench = tuple[Vec, Vec]
"""Moment about the frame's origin and force, in the frame's axes."""


@dataclass(frozen=True)
class _Accelerations:
    """Angular velocity, angular acceleration, and linear acceleration of the origin minus gravity."""

    angular: Vec
    angular_rate: Vec
    linear: Vec


def inverse_dynamics_regressor(mechanism: Mechanism) -> LinearForms:
    """Record X with y = X ζ.

    Parameters
    ----------
    mechanism : Mechanism

    Returns
    -------
    LinearForms
        Rows are the generalised forces of ``mechanism.velocities`` (N·m or N), columns ``mechanism.parameters``.
        Inputs are ``q[...]``, ``qd[...]``, ``qdd[...]`` and the geometry symbols.
    """
    program = Program()
    recorder = Recorder(mechanism, program)
    steps = {index: recorder.steps(index) for index in range(len(mechanism.bodies))}
    accelerations = _forward(mechanism, recorder, steps)
    outputs = _output_weights(mechanism, program)
    sums: dict[tuple[int, int], Scalar] = {}
    for block, index in enumerate(mechanism.carriers):
        for k, wrench in enumerate(_unit_wrenches(accelerations[index], program)):
            for name, effort in _backward(mechanism, steps, index, wrench):
                for row, weight in outputs[name]:
                    key = (row, 10 * block + k)
                    sums[key] = sums.get(key, program.zero) + effort * weight
    entries = {key: value.node for key, value in sums.items() if not value.is_zero}
    return LinearForms(program, entries, (mechanism.degrees_of_freedom, len(mechanism.parameters)))


def _output_weights(mechanism: Mechanism, program: Program) -> dict[str, list[tuple[int, Scalar]]]:
    """For each freedom, the outputs it contributes to: y = Tᵀ τ for q = T θ."""
    row = {name: i for i, name in enumerate(mechanism.velocities)}
    weights = {name: [(i, program.one)] for name, i in row.items()}
    for coupling in mechanism.couplings:
        weights[coupling.coordinate] = [(row[n], program.polynomial(ratio)) for n, ratio in coupling.terms]
    return weights


def _forward(mechanism: Mechanism, recorder: Recorder, steps: dict[int, list[Step]]) -> dict[int, _Accelerations]:
    gx, gy, gz = recorder.gravity()
    known = {GROUND: _Accelerations(recorder.zeros, recorder.zeros, (-gx, -gy, -gz))}
    for index, body in enumerate(mechanism.bodies):
        current = known[body.parent]
        for step in steps[index]:
            current = _advance(current, step)
        known[index] = current
    return known


def _advance(now: _Accelerations, step: Step) -> _Accelerations:
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
    return _Accelerations(angular, angular_rate, linear)


def _unit_wrenches(at: _Accelerations, program: Program) -> list[Wrench]:
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


def _backward(
    mechanism: Mechanism, steps: dict[int, list[Step]], index: int, wrench: Wrench
) -> list[tuple[str, Scalar]]:
    """Generalised force at every freedom between the base and a body that carries a wrench."""
    moment, force = wrench
    efforts = []
    while index != GROUND:
        for step in reversed(steps[index]):
            for freedom in step.freedoms:
                efforts.append((freedom.name, dot(freedom.angular, moment) + dot(freedom.linear, force)))
            if step.rotation is not None:
                moment, force = apply(step.rotation, moment), apply(step.rotation, force)
            if step.shift is not None:
                moment = add(moment, cross(step.shift, force))
        index = mechanism.bodies[index].parent
    return efforts
