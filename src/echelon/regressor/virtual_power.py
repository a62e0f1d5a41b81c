"""Virtual power: random combinations of the rows of X at the cost of one inverse dynamics.

For a virtual velocity u of the independent coordinates, uᵀ X ζ is the power of the bodies' inertial wrenches in the
virtual motion (Jourdain's principle).  One such row holds every row of X, because u is arbitrary, but costs O(bodies)
operations instead of O(bodies · depth).  So X · N = 0 and the rank of X can be checked on X itself at little cost.
"""

from __future__ import annotations

from echelon.conventions import PER_BODY
from echelon.mechanism.mechanism import GROUND, Mechanism
from echelon.program.tape import Program, Scalar
from echelon.regressor.accelerations import Wrench, forward_accelerations, unit_wrenches
from echelon.regressor.linear import LinearForms
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
        One row with columns ``mechanism.parameters``.  Inputs are ``u[...]`` for every velocity coordinate beside those
        of :func:`echelon.regressor.newton_euler.inverse_dynamics_regressor`.
    """
    program = Program()
    recorder = Recorder(mechanism, program)
    steps = {index: recorder.steps(index) for index in range(len(mechanism.bodies))}
    accelerations = forward_accelerations(mechanism, recorder, steps)
    virtual = _virtual_rates(mechanism, program)
    twists: dict[int, Twist] = {GROUND: (recorder.zeros, recorder.zeros)}
    for index, body in enumerate(mechanism.bodies):
        current = twists[body.parent]
        for step in steps[index]:
            current = _advance(current, step, virtual)
        twists[index] = current
    entries: dict[tuple[int, int], int] = {}
    for block, index in enumerate(mechanism.carriers):
        for k, wrench in enumerate(unit_wrenches(accelerations[index], program)):
            power = _power(twists[index], wrench)
            if not power.is_zero:
                entries[0, PER_BODY * block + k] = power.node
    return LinearForms(program, entries, (1, len(mechanism.parameters)))


def _virtual_rates(mechanism: Mechanism, program: Program) -> dict[str, Scalar]:
    """Virtual velocity of every freedom; dependent ones follow their couplings."""
    rates = {name: program.input(f"u[{name}]") for name in mechanism.velocities}
    for coupling in mechanism.couplings:
        terms = (rates[name] * program.polynomial(ratio) for name, ratio in coupling.terms)
        rates[coupling.coordinate] = sum(terms, program.zero)
    return rates


def _advance(twist: Twist, step: Step, virtual: dict[str, Scalar]) -> Twist:
    angular, linear = twist
    if step.shift is not None:
        linear = add(linear, cross(angular, step.shift))
    angular, linear = into_frame(step, angular), into_frame(step, linear)
    for freedom in step.freedoms:
        angular = add(angular, scale(freedom.angular, virtual[freedom.name]))
        linear = add(linear, scale(freedom.linear, virtual[freedom.name]))
    return angular, linear


def _power(twist: Twist, wrench: Wrench) -> Scalar:
    return dot(twist[0], wrench[0]) + dot(twist[1], wrench[1])
