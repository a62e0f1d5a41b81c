"""Virtual power: combinations of the rows of X at the cost of one inverse dynamics.

In a virtual motion u of the measured freedoms, uᵀ X ζ is the power of the bodies' inertial wrenches and of the effects
(Jourdain's principle).  One row with arbitrary u holds every row of X, but costs O(bodies) operations instead of
O(bodies · depth).  So X · N = 0 and the rank of X can be checked on X itself at little cost.  With u a unit vector it
is a row of X.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from echelon.mechanism.effect import Side
from echelon.mechanism.mechanism import GROUND, Mechanism
from echelon.program.tape import Program, Scalar
from echelon.regressor.accelerations import Accelerations, Wrench, forward_accelerations, unit_wrenches
from echelon.regressor.effects import EffectRecorder
from echelon.regressor.linear import LinearForms
from echelon.regressor.loops.closures import loops_of
from echelon.regressor.loops.real_inputs import real_inputs
from echelon.regressor.probes import Probes, VirtualMotion, any_motion, virtual_motion
from echelon.regressor.spatial import Vec, add, cross, dot, scale
from echelon.regressor.steps import Recorder, Step, into_frame

Twist = tuple[Vec, Vec]
"""Angular velocity and linear velocity of the frame's origin, in the frame's axes."""


def virtual_power_form(mechanism: Mechanism) -> LinearForms:
    """Record uᵀ X(q, q̇, q̈).

    Parameters
    ----------
    mechanism : Mechanism

    Returns
    -------
    LinearForms
        One row with columns ``mechanism.parameters``.  Inputs are ``u[...]`` for every output beside those of
        :func:`echelon.regressor.newton_euler.inverse_dynamics_regressor`; with loops, also ``v[...]`` for the freedoms
        that the outputs do not determine, or for all if every force is measured.
    """
    program = Program()
    recorder = Recorder(mechanism, program)
    probes = Probes(mechanism, recorder)
    if mechanism.closures and mechanism.measures_every_force:
        motion, known = any_motion(mechanism, program), None
    else:
        speeds = {output.name: program.input(f"u[{output.name}]") for output in mechanism.outputs}
        motion = virtual_motion(mechanism, program, probes, speeds)
        known = motion.chosen
    steps = {index: recorder.steps(index) for index in range(len(mechanism.bodies))}
    accelerations = forward_accelerations(mechanism, recorder, steps)
    twists = _twists(mechanism, recorder, steps, probes, motion)
    entries: dict[tuple[int, int], int] = {}
    for column, power in enumerate(_powers(mechanism, recorder, accelerations, twists, motion)):
        if not power.is_zero:
            entries[0, column] = power.node
    loops = loops_of(mechanism, recorder, probes, known)
    if loops is not None:
        loops = replace(loops, real=partial(real_inputs, mechanism))
    return LinearForms(program, entries, (1, len(mechanism.parameters)), loops)


def _twists(
    mechanism: Mechanism, recorder: Recorder, steps: dict[int, list[Step]], probes: Probes, motion: VirtualMotion
) -> dict[int, Twist]:
    """Virtual twist of every body."""
    twists: dict[int, Twist] = {GROUND: (recorder.zeros, recorder.zeros)}
    for step in probes.steps(GROUND, on_parent=False):
        twists[GROUND] = _advance(twists[GROUND], step, motion)
    for index, body in enumerate(mechanism.bodies):
        current = twists[body.parent]
        for step in (*probes.steps(index, True), *steps[index], *probes.steps(index, False)):
            current = _advance(current, step, motion)
        twists[index] = current
    return twists


def _powers(
    mechanism: Mechanism,
    recorder: Recorder,
    accelerations: dict[int, Accelerations],
    twists: dict[int, Twist],
    motion: VirtualMotion,
) -> list[Scalar]:
    """Power per unit of every standard parameter, in column order."""
    powers: list[Scalar] = []
    for index in mechanism.first_column:
        wrenches = unit_wrenches(accelerations[index], recorder.program)
        powers += [_power(twists[index], wrenches[kind]) for kind in mechanism.bodies[index].carried]
    effects = EffectRecorder(mechanism, recorder)
    for effect in mechanism.effects:
        total = recorder.program.zero
        for side, at, force in effects.forces(effect):
            speeds = motion.freedoms if side is Side.JOINT else motion.drives
            if at in speeds:
                total = total + force * speeds[at]
        powers.append(total)
    return powers


def _advance(twist: Twist, step: Step, motion: VirtualMotion) -> Twist:
    angular, linear = twist
    if step.shift is not None:
        linear = add(linear, cross(angular, step.shift))
    angular, linear = into_frame(step, angular), into_frame(step, linear)
    for freedom in step.freedoms:
        if freedom.name in motion.freedoms:
            angular = add(angular, scale(freedom.angular, motion.freedoms[freedom.name]))
            linear = add(linear, scale(freedom.linear, motion.freedoms[freedom.name]))
    return angular, linear


def _power(twist: Twist, wrench: Wrench) -> Scalar:
    return dot(twist[0], wrench[0]) + dot(twist[1], wrench[1])
