"""The mass matrix of all freedoms, and what they hold at rest, by composite bodies (Walker and Orin 1982).

Subtree a joint that alone moves, all bodies are one.  A unit of its acceleration needs a wrench that follows from the
composite inertia; carried to the ground, it makes efforts in all freedoms on the way, and these are the entries of the
symmetric matrix.  A frame's share costs one turn of an inertia, where inverse dynamics at unit accelerations would move
every body for every joint.  By the same symmetry the effort at rest is the force of that wrench times gravity.  Sensors
are freedoms like others.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from echelon.dynamics.recursion import BackwardPass, ForwardPass, Transform, Wrench
from echelon.dynamics.reframing import MASS
from echelon.inertia.spatial import Array
from echelon.program.scalar import Scalar
from echelon.regressor.spatial import Mat, Vec, add, apply, cross, dot, scale
from echelon.regressor.steps import Freedom, backward

Symmetric = dict[tuple[str, str], Scalar]
"""Entries by pairs of freedoms, in both orders; zero where absent."""


def mass_matrix(inertias: Mapping[int, Array], motion: ForwardPass) -> Symmetric:
    """Effort of every freedom per unit of acceleration of every other, sensors included, from pseudo-inertias."""
    found: Symmetric = {}

    def before(behind: tuple[Array, dict[str, CarriedWrench]], index: int) -> tuple[Array, dict[str, CarriedWrench]]:
        composite, carried = behind
        for transform in reversed(motion.transforms[index]):
            for freedom in transform.step.freedoms:
                carried[freedom.name] = CarriedWrench(motion.recorder.zeros, _unit_wrench(freedom, composite))
            for name, wrench in carried.items():
                for other, effort in wrench.carry(transform).items():
                    found[name, other] = found[other, name] = effort
            composite = inertia_before(transform, composite)
        return composite, carried

    composites = _composites(inertias, motion)
    own: dict[int, tuple[Array, dict[str, CarriedWrench]]] = {index: (c, {}) for index, c in composites.items()}
    backward(motion.mechanism, own, before, lambda a, b: (a[0] + b[0], a[1] | b[1]))
    return found


def efforts_at_rest(inertias: Mapping[int, Array], motion: ForwardPass) -> dict[str, Scalar]:
    """Effort of every freedom that holds the bodies' weight, sensors included, from pseudo-inertias."""
    found: dict[str, Scalar] = {}

    def before(composite: Array, index: int) -> Array:
        for transform in reversed(motion.transforms[index]):
            for freedom in transform.step.freedoms:
                found[freedom.name] = dot(_unit_wrench(freedom, composite)[1], transform.end.linear)
            composite = inertia_before(transform, composite)
        return composite

    backward(motion.mechanism, _composites(inertias, motion), before, np.add)
    return found


def _composites(inertias: Mapping[int, Array], motion: ForwardPass) -> dict[int, Array]:
    """Pseudo-inertias of all bodies alone, which become those of all that is behind them."""
    nothing = np.full((4, 4), motion.recorder.program.zero, dtype=object)
    return {index: inertias.get(index, nothing) for index in motion.motions}


class CarriedWrench:
    """A wrench on its way to the ground."""

    def __init__(self, zeros: Vec, wrench: Wrench) -> None:
        self._down, self._wrench = BackwardPass(zeros), wrench

    def carry(self, transform: Transform) -> dict[str, Scalar]:
        """Take one step, and the efforts of the freedoms there."""
        self._down.efforts.clear()
        self._wrench = self._down.carry([transform], self._wrench)
        return dict(self._down.efforts)


def _unit_wrench(freedom: Freedom, pseudo: Array) -> Wrench:
    """Wrench about the origin that a unit of a freedom's acceleration needs: J α + h × a, and m a + α × h."""
    angular, linear = freedom.angular, freedom.linear
    first: Vec = (pseudo[0, MASS], pseudo[1, MASS], pseudo[2, MASS])
    moment = apply(tensor(pseudo), angular)
    return add(moment, cross(first, linear)), add(scale(linear, pseudo[MASS, MASS]), cross(angular, first))


def tensor(pseudo: Array) -> Mat:
    """The inertia tensor."""
    rows: list[Vec] = []
    for k in range(3):
        row = [-pseudo[k, j] for j in range(3)]
        row[k] = pseudo[(k + 1) % 3, (k + 1) % 3] + pseudo[(k + 2) % 3, (k + 2) % 3]
        rows.append((row[0], row[1], row[2]))
    return (rows[0], rows[1], rows[2])


def inertia_before(transform: Transform, pseudo: Array) -> Array:
    """A pseudo-inertia about the frame before a step."""
    step, rotated = transform.step, pseudo
    if step.rotation is not None:
        matrix = np.array(step.rotation, dtype=object)
        rotated = pseudo.copy()
        rotated[:3, MASS] = rotated[MASS, :3] = matrix @ pseudo[:3, MASS]
        half = matrix @ pseudo[:3, :3]
        for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
            rotated[i, j] = rotated[j, i] = half[i] @ matrix[j]
        if transform.rotation is not None:
            # the sum of the second moments across the axis stays
            i, j = (transform.axis + 1) % 3, (transform.axis + 2) % 3
            rotated[j, j] = (pseudo[i, i] + pseudo[j, j]) - rotated[i, i]
    return rotated if step.shift is None else _shifted(rotated, step.shift)


def _shifted(pseudo: Array, shift: Vec) -> Array:
    """Σ + h pᵀ + p h'ᵀ, where h' = h + m p are the new first moments."""
    moved = pseudo.copy()
    first = pseudo[:3, MASS]
    moved[:3, MASS] = moved[MASS, :3] = first + np.array(shift, dtype=object) * pseudo[MASS, MASS]
    for i in range(3):
        for j in range(i, 3):
            later = moved[j, MASS]
            extra = (first[i] + later) * shift[i] if i == j else first[i] * shift[j] + later * shift[i]
            moved[i, j] = moved[j, i] = pseudo[i, j] + extra
    return moved
