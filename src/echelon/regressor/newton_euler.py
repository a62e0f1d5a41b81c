"""The regressor y = X(q, q̇, q̈) ζ of the measured outputs, by recursive Newton–Euler.

Forward: angular velocity, angular acceleration and linear acceleration (minus gravity) of every frame.  Backward: for
each parameter of a body the wrench that a unit of it needs about the body's origin is carried back along the chain;
each freedom on the way, sensors included, reads its generalised force off it.  Outputs are combinations of these.
"""

from __future__ import annotations

from collections.abc import Mapping

from echelon.errors import InputError
from echelon.mechanism.effect import Side
from echelon.mechanism.mechanism import GROUND, Mechanism
from echelon.program.tape import Program, Scalar
from echelon.regressor.accelerations import Wrench, forward_accelerations, unit_wrenches
from echelon.regressor.effects import EffectRecorder
from echelon.regressor.linear import LinearForms
from echelon.regressor.probes import Probes, VirtualMotion, virtual_motion
from echelon.regressor.spatial import add, apply, cross, dot
from echelon.regressor.steps import Recorder, Step

Weights = dict[str, list[tuple[int, Scalar]]]
"""For each freedom, the rows it contributes to and how much."""


def inverse_dynamics_regressor(mechanism: Mechanism) -> LinearForms:
    """Record X with y = X ζ.

    Parameters
    ----------
    mechanism : Mechanism

    Returns
    -------
    LinearForms
        Rows are ``mechanism.outputs`` (N·m or N), columns ``mechanism.parameters``.  Inputs are ``q[...]``,
        ``qd[...]``, ``qdd[...]``, the geometry symbols, and ``i[...]`` where effects use measured inputs.

    Raises
    ------
    InputError
        If the mechanism has loops, where the rows of X are not functions of the coordinates alone.
    """
    if mechanism.closures:
        raise InputError("X of a mechanism with loops is not recorded row by row; use virtual_power_form")
    program = Program()
    recorder = Recorder(mechanism, program)
    probes = Probes(mechanism, recorder)
    motions = [virtual_motion(mechanism, program, probes, {o.name: program.one}) for o in mechanism.outputs]
    sums: dict[tuple[int, int], Scalar] = {}
    _add_bodies(sums, mechanism, recorder, probes, _weights([m.freedoms for m in motions]))
    _add_effects(sums, mechanism, recorder, motions)
    entries = {key: value.node for key, value in sums.items() if not value.is_zero}
    return LinearForms(program, entries, (len(mechanism.outputs), len(mechanism.parameters)))


def _weights(motions: list[Mapping[str, Scalar]]) -> Weights:
    """y = Tᵀ τ, where row k moves freedoms as motion k says."""
    weights: Weights = {}
    for row, motion in enumerate(motions):
        for name, speed in motion.items():
            weights.setdefault(name, []).append((row, speed))
    return weights


def _add_bodies(
    sums: dict[tuple[int, int], Scalar], mechanism: Mechanism, recorder: Recorder, probes: Probes, weights: Weights
) -> None:
    program = recorder.program
    steps = {index: recorder.steps(index) for index in range(len(mechanism.bodies))}
    accelerations = forward_accelerations(mechanism, recorder, steps)
    chain = {k: [*probes.steps(k, True), *own, *probes.steps(k, False)] for k, own in steps.items()}
    chain[GROUND] = probes.steps(GROUND, on_parent=False)
    for index, first in mechanism.first_column.items():
        wrenches = unit_wrenches(accelerations[index], program)
        for offset, kind in enumerate(mechanism.bodies[index].carried):
            for name, effort in _backward(mechanism, chain, index, wrenches[kind]):
                for row, weight in weights.get(name, ()):
                    key = (row, first + offset)
                    sums[key] = sums.get(key, program.zero) + effort * weight


def _add_effects(
    sums: dict[tuple[int, int], Scalar], mechanism: Mechanism, recorder: Recorder, motions: list[VirtualMotion]
) -> None:
    effects = EffectRecorder(mechanism, recorder)
    first = len(mechanism.parameters) - len(mechanism.effects)
    for column, effect in enumerate(mechanism.effects, first):
        for side, at, force in effects.forces(effect):
            for row, motion in enumerate(motions):
                speeds = motion.freedoms if side is Side.JOINT else motion.drives
                if at in speeds:
                    sums[row, column] = sums.get((row, column), recorder.program.zero) + force * speeds[at]


def _backward(
    mechanism: Mechanism, chain: dict[int, list[Step]], index: int, wrench: Wrench
) -> list[tuple[str, Scalar]]:
    """Generalised force at every freedom between the ground and a body that carries a wrench."""
    moment, force = wrench
    efforts: list[tuple[str, Scalar]] = []
    while True:
        for step in reversed(chain[index]):
            efforts += [(f.name, dot(f.angular, moment) + dot(f.linear, force)) for f in step.freedoms]
            if step.rotation is not None:
                moment, force = apply(step.rotation, moment), apply(step.rotation, force)
            if step.shift is not None:
                moment = add(moment, cross(step.shift, force))
        if index == GROUND:
            return efforts
        index = mechanism.bodies[index].parent
