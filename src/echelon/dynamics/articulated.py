"""Accelerations from forces: by articulated bodies, and by factors of the mass matrix.

Articulated bodies (Featherstone 1983): what is behind a joint resists a change of its motion like one body, whose
inertia is a symmetric 6 × 6 matrix I.  A free joint along S passes on I − U Uᵀ/D, with U = I S and D = Sᵀ U, and the
wrench p + U u/D, with u = τ − Sᵀ p.  Back outward its acceleration is (u − Uᵀ a)/D, where a is that of the frame before
the freedom.  All of it is added to the motion at zero joint accelerations, so that velocities and gravity enter in the
bodies' wrenches p alone.  D are pivots of the mass matrix.  Base parameters determine them, and with base parameters,
too, they are positive wherever the mass matrix is positive definite, whatever single bodies look like.

Mass matrices of branched robots have zeros between branches.  Elimination from the tips keeps them (Featherstone 2005).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from echelon.algebra import Program, Scalar
from echelon.dynamics.composite import rotated_spread, tensor
from echelon.dynamics.recursion import (
    MASS,
    ForwardPass,
    Transform,
    body_wrench,
)
from echelon.robot import (
    Array,
    Freedom,
    Vec,
    add,
    apply,
    backward,
    cross,
    forward,
    into_frame,
    scale,
)


class TipFactor:
    """A regular matrix that is eliminated from the last row to the first, ready to solve M x = b."""

    def __init__(
        self, program: Program, matrix: Mapping[tuple[int, ...], Scalar]
    ) -> None:
        size = 1 + max((index[0] for index in matrix), default=-1)
        left = [
            [matrix.get((row, column), program.zero) for column in range(size)]
            for row in range(size)
        ]
        pairs = [(i, j) for i in range(size) for j in range(i)]
        symmetric = all(left[i][j].node == left[j][i].node for i, j in pairs)
        self._zero = program.zero
        self._inverse = [program.zero] * size
        self._rows: list[list[Scalar]] = [[] for _ in range(size)]
        self._columns: list[list[Scalar]] = [[] for _ in range(size)]
        for k in reversed(range(size)):
            inverse = self._inverse[k] = 1 / left[k][k]
            self._rows[k] = [entry * inverse for entry in left[k][:k]]
            self._columns[k] = [row[k] * inverse for row in left[:k]]
            for i in range(k):
                for j in range(i + 1 if symmetric else k):
                    left[i][j] = left[i][j] - self._columns[k][i] * left[k][j]
                    if symmetric:
                        left[j][i] = left[i][j]

    def solve(self, right: Sequence[Scalar]) -> list[Scalar]:
        """The solution x for one right-hand side b."""
        left = list(right)
        for k in reversed(range(len(left))):
            for i, entry in enumerate(self._columns[k]):
                left[i] = left[i] - entry * left[k]
        found: list[Scalar] = []
        for row, inverse, value in zip(self._rows, self._inverse, left, strict=True):
            terms = (entry * x for entry, x in zip(row, found, strict=True))
            found.append(value * inverse - sum(terms, self._zero))
        return found


@dataclass(frozen=True)
class _Articulated:
    """All that is behind a joint: its inertia, and the wrench that it needs while joints behind do not accelerate."""

    inertia: (
        Array  # of shape (6, 6): moment and force by angular and linear acceleration
    )
    wrench: Array  # of shape (6,)

    def plus(self, other: _Articulated) -> _Articulated:
        return _Articulated(self.inertia + other.inertia, self.wrench + other.wrench)


@dataclass(frozen=True)
class _Share:
    """What the acceleration of one freedom follows from: (rest − slopes · a) · inverse."""

    slopes: Array
    rest: Scalar
    inverse: Scalar


def articulated_accelerations(
    inertias: Mapping[int, Array],
    motion: ForwardPass,
    forces: Mapping[str, Scalar],
    rotors: Mapping[str, Scalar],
) -> dict[str, Scalar]:
    """Accelerations of all freedoms of a tree, from pseudo-inertias and the motion without accelerations.

    ``rotors`` are further inertias that only the freedom itself moves.
    """
    zero, shares = motion.recorder.program.zero, dict[str, _Share]()
    empty = _Articulated(np.full((6, 6), zero), np.full(6, zero))
    own = dict.fromkeys(motion.motions, empty)
    for index, pseudo in inertias.items():
        moment, force = body_wrench(motion.motions[index], pseudo)
        own[index] = _Articulated(_spatial(pseudo), np.array((*moment, *force)))

    def before(body: _Articulated, index: int) -> _Articulated:
        for transform in reversed(motion.transforms[index]):
            for freedom in reversed(transform.step.freedoms):
                rotor = rotors.get(freedom.name, zero)
                force = forces[freedom.name]
                body, shares[freedom.name] = _freed(body, freedom, force, rotor)
            body = _before(transform, body)
        return body

    backward(motion.mechanism, own, before, _Articulated.plus)
    found: dict[str, Scalar] = {}

    def behind(parent: tuple[Vec, Vec], index: int) -> tuple[Vec, Vec]:
        angular, linear = parent
        for transform in motion.transforms[index]:
            step = transform.step
            if step.shift is not None:
                linear = add(linear, cross(angular, step.shift))
            angular, linear = into_frame(step, angular), into_frame(step, linear)
            for freedom in step.freedoms:
                share = shares[freedom.name]
                moved = share.slopes @ np.array((*angular, *linear))
                rate = (share.rest - moved) * share.inverse
                found[freedom.name] = rate
                angular = add(angular, scale(freedom.angular, rate))
                linear = add(linear, scale(freedom.linear, rate))
        return angular, linear

    zeros = motion.recorder.zeros
    forward(motion.mechanism, (zeros, zeros), behind)
    return found


def _spatial(pseudo: Array) -> Array:
    """A rigid body's inertia of shape (6, 6), about its frame's origin."""
    hat = _hat(pseudo[:3, MASS])
    mass = np.diag([pseudo[MASS, MASS]] * 3)
    # numpy's zeros off the diagonal are no scalars
    mass = np.where(np.eye(3, dtype=bool), mass, hat[0, 0])
    return np.block([[np.array(tensor(pseudo)), hat], [hat.T, mass]])


def _hat(v: Array) -> Array:
    x, y, z = v
    zero = x * 0
    return np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]])


def _freed(
    body: _Articulated, freedom: Freedom, force: Scalar, rotor: Scalar
) -> tuple[_Articulated, _Share]:
    """What is behind a freedom as seen from before it."""
    axis = np.array((*freedom.angular, *freedom.linear))
    slopes = body.inertia @ axis
    inverse = 1 / (axis @ slopes + rotor)
    rest = force - axis @ body.wrench
    inertia = body.inertia - np.outer(slopes, slopes * inverse)
    wrench = body.wrench + slopes * (rest * inverse)
    places = [k for k in range(6) if not axis[k].is_zero]
    if len(places) == 1 and rotor.is_zero:
        # along a coordinate axis nothing resists, and the force goes through
        (k,) = places
        inertia[k], inertia[:, k] = rotor, rotor
        wrench[k] = force * axis[k]
    return _Articulated(_mirrored(inertia), wrench), _Share(slopes, rest, inverse)


def _before(transform: Transform, body: _Articulated) -> _Articulated:
    """What is behind a step as seen from the frame before it."""
    step, inertia, wrench = transform.step, body.inertia, body.wrench
    if step.rotation is not None:
        inertia = inertia.copy()
        for rows in (slice(0, 3), slice(3, 6)):
            x, y, z = wrench[rows]
            wrench = wrench.copy()
            wrench[rows] = apply(step.rotation, (x, y, z))
            for columns in (slice(0, 3), slice(3, 6)):
                inertia[rows, columns] = rotated_spread(
                    transform, inertia[rows, columns]
                )
    if step.shift is not None:
        hat, inertia, wrench = _hat(np.array(step.shift)), inertia.copy(), wrench.copy()
        inertia[:3] = inertia[:3] + hat @ inertia[3:]
        inertia[:, :3] = inertia[:, :3] + inertia[:, 3:] @ hat.T
        wrench[:3] = wrench[:3] + hat @ wrench[3:]
    return _Articulated(_mirrored(inertia), wrench)


def _mirrored(matrix: Array) -> Array:
    """A symmetric matrix whose entries below the diagonal are those above it."""
    return np.where(np.tri(6, k=-1, dtype=bool), matrix.T, matrix)
