"""Accelerations from forces: by articulated bodies, and by factors of the mass matrix.

Articulated bodies (Featherstone 1983): what is behind a joint resists a change of its motion like one body, with an
inertia I of shape (6, 6) and a wrench p.  A free joint along S with the force τ passes on I − U Uᵀ/D and p + U u/D,
with U = I S, D = Sᵀ U and u = τ − Sᵀ p.  Its acceleration is (u − Uᵀ a)/D, where a is that of the frame before the
freedom.  With J = [[I, p], [pᵀ, ·]] and v = J S − τ e₇ this is J − v vᵀ/D and −vᵀ [a, 1]/D: one elimination does both.

All of it is added to the motion at zero joint accelerations, so that velocities and gravity enter in p of single bodies
alone.  D are pivots of the mass matrix.  Base parameters determine them, and with base parameters, too, they are
positive wherever the mass matrix is positive definite, whatever single bodies look like.

Mass matrices of branched robots have zeros between branches.  Elimination from the tips keeps them (Featherstone 2005).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from echelon.algebra import Program, Scalar
from echelon.dynamics.composite import tensor
from echelon.dynamics.recursion import MASS, ForwardPass, body_wrench
from echelon.robot import Array, Freedom, RecordedStep, Vec, backward, forward


def solved(matrix: Array, right: Array) -> Array:
    """The solution of M X = B for a regular M, eliminated from the last row to the first."""
    left, right = matrix.copy(), right.copy()
    for k in reversed(range(len(left))):
        inverse = 1 / left[k, k]
        left[k], right[k] = left[k] * inverse, right[k] * inverse
        for i in range(k):
            right[i] = right[i] - right[k] * left[i, k]
            left[i, :k] = left[i, :k] - left[k, :k] * left[i, k]
    for k in range(1, len(left)):
        right[k] = right[k] - left[k, :k] @ right[:k]
    return right


def articulated_accelerations(
    inertias: Mapping[int, Array],
    motion: ForwardPass,
    forces: Mapping[str, Scalar],
    rotors: Mapping[str, Scalar],
) -> dict[str, Scalar]:
    """Accelerations of all freedoms of a tree, from pseudo-inertias and the motion without accelerations.

    ``rotors`` are further inertias that only the freedom itself moves.
    """
    program = motion.recorder.program
    empty = np.full((7, 7), program.zero, dtype=object)
    own = dict.fromkeys(motion.motions, empty)
    for index, pseudo in inertias.items():
        wrench = body_wrench(motion.motions[index], pseudo)
        own[index] = _form(empty, pseudo, (*wrench[0], *wrench[1]))
    shares: dict[str, Array] = {}
    found: dict[str, Scalar] = {}

    def before(form: Array, index: int) -> Array:
        for transform in reversed(motion.transforms[index]):
            for freedom in reversed(transform.step.freedoms):
                name = freedom.name
                rotor = rotors.get(name, program.zero)
                form, shares[name] = _freed(form, freedom, forces[name], rotor)
            for matrix in _frame_changes(transform.step, program):
                form = _mirrored(matrix @ form @ matrix.T)
        return form

    def behind(twist: Array, index: int) -> Array:
        for transform in motion.transforms[index]:
            for matrix in reversed(_frame_changes(transform.step, program)):
                twist = matrix.T @ twist
            for freedom in transform.step.freedoms:
                moved = (shares[freedom.name] * twist).sum()
                found[freedom.name] = -moved
                twist = twist - _axis(freedom) * moved
        return twist

    backward(motion.mechanism, own, before, np.add)
    forward(motion.mechanism, np.array([program.zero] * 6 + [program.one]), behind)
    return found


def _form(empty: Array, pseudo: Array, wrench: Sequence[Scalar]) -> Array:
    """[[I, p], [pᵀ, 0]] of a rigid body, about its frame's origin."""
    form = empty.copy()
    form[:3, :3] = tensor(pseudo)
    form[:3, 3:6] = _hat((pseudo[0, MASS], pseudo[1, MASS], pseudo[2, MASS]))
    form[3:6, :3] = form[:3, 3:6].T
    form[[3, 4, 5], [3, 4, 5]] = pseudo[MASS, MASS]
    form[:6, 6] = form[6, :6] = wrench
    return form


def _hat(v: Vec) -> Array:
    x, y, z = v
    zero = x * 0
    return np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]])


def _axis(freedom: Freedom) -> Array:
    return np.array((*freedom.angular, *freedom.linear, freedom.rate * 0))


def _freed(
    form: Array, freedom: Freedom, force: Scalar, rotor: Scalar
) -> tuple[Array, Array]:
    """The form before a freedom, and v/D, from which the acceleration follows."""
    axis = _axis(freedom)
    slopes = form @ axis
    slopes[6] = slopes[6] - force
    share = slopes * (1 / (axis @ slopes + rotor))
    left = _mirrored(form - np.outer(slopes, share))
    places = [k for k in range(6) if not axis[k].is_zero]
    if len(places) == 1 and rotor.is_zero:
        # along a coordinate axis nothing resists, and the force goes through
        (k,) = places
        left[k] = left[:, k] = rotor
        left[k, 6] = left[6, k] = force * axis[k]
    return left, share


def _frame_changes(step: RecordedStep, program: Program) -> list[Array]:
    """Matrices that take wrenches to the frame before a step: they turn it, and they shift its origin."""
    unit = np.full((7, 7), program.zero, dtype=object)
    np.fill_diagonal(unit, program.one)
    found = []
    if step.rotation is not None:
        turn = unit.copy()
        turn[:3, :3] = turn[3:6, 3:6] = step.rotation
        found.append(turn)
    if step.shift is not None:
        unit[:3, 3:6] = _hat(step.shift)
        found.append(unit)
    return found


def _mirrored(form: Array) -> Array:
    """A symmetric matrix whose entries below the diagonal are those above it."""
    return np.where(np.tri(len(form), k=-1, dtype=bool), form.T, form)
