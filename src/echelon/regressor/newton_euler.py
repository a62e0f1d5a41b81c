"""The regressor of the inverse dynamics, y = X(q, q̇, q̈) ζ, by recursive Newton–Euler.

Forward: angular velocity, angular acceleration and linear acceleration (minus gravity) of every frame.  Backward: for
each of a body's ten parameters the wrench that a unit of it needs about the body's origin is carried back along the
chain; each freedom on the way reads its generalised force off it.
"""

from __future__ import annotations

from echelon.mechanism.mechanism import GROUND, Mechanism
from echelon.program.tape import Program, Scalar
from echelon.regressor.accelerations import Wrench, forward_accelerations, unit_wrenches
from echelon.regressor.linear import LinearForms
from echelon.regressor.spatial import add, apply, cross, dot
from echelon.regressor.steps import Recorder, Step


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
    accelerations = forward_accelerations(mechanism, recorder, steps)
    outputs = _output_weights(mechanism, program)
    sums: dict[tuple[int, int], Scalar] = {}
    for block, index in enumerate(mechanism.carriers):
        for k, wrench in enumerate(unit_wrenches(accelerations[index], program)):
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


def _backward(
    mechanism: Mechanism, steps: dict[int, list[Step]], index: int, wrench: Wrench
) -> list[tuple[str, Scalar]]:
    """Generalised force at every freedom between the base and a body that carries a wrench."""
    moment, force = wrench
    efforts: list[tuple[str, Scalar]] = []
    while index != GROUND:
        for step in reversed(steps[index]):
            efforts += [(f.name, dot(f.angular, moment) + dot(f.linear, force)) for f in step.freedoms]
            if step.rotation is not None:
                moment, force = apply(step.rotation, moment), apply(step.rotation, force)
            if step.shift is not None:
                moment = add(moment, cross(step.shift, force))
        index = mechanism.bodies[index].parent
    return efforts
