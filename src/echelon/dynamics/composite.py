"""The mass matrix of all freedoms, and what they hold at rest, by composite bodies (Walker and Orin 1982).

Behind a joint that alone moves, all bodies are one.  A unit of its acceleration needs a wrench that follows from the
composite inertia; carried to the ground, it makes efforts in all freedoms on the way, and these are the entries of the
symmetric matrix.  A frame's share costs one turn of an inertia, where inverse dynamics at unit accelerations would move
every body for every joint.  By the same symmetry the effort at rest is the force of that wrench times gravity.  Sensors
are freedoms like others.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from echelon.dynamics.grouping import MASS
from echelon.dynamics.recursion import Descent, Passage, Recursion
from echelon.dynamics.wrenches import Wrench
from echelon.inertia.spatial import Array
from echelon.mechanism.mechanism import GROUND, Mechanism
from echelon.program.tape import Scalar
from echelon.regressor.spatial import Mat, Vec, add, apply, cross, dot, scale
from echelon.regressor.steps import Freedom, Recorder

Symmetric = dict[tuple[str, str], Scalar]
"""Entries by pairs of freedoms, in both orders; zero where absent."""


def mass_matrix_of_freedoms(
    mechanism: Mechanism, recorder: Recorder, recursion: Recursion, inertias: Mapping[int, Array]
) -> Symmetric:
    """Effort of every freedom per unit of acceleration of every other, sensors included.

    Parameters
    ----------
    mechanism : Mechanism
    recorder : Recorder
        Of positions, with zero rates.
    recursion : Recursion
        Knows the steps between the bodies.
    inertias : mapping of int to array of shape (4, 4) of Scalar
        Pseudo-inertias.
    """
    nothing = np.full((4, 4), recorder.program.zero, dtype=object)
    found: Symmetric = {}
    passages, _ = recursion.passages(recorder.zeros)
    composites = {index: inertias.get(index, nothing) for index in range(GROUND, len(mechanism.bodies))}
    columns: dict[int, dict[str, Falling]] = {index: {} for index in composites}
    for index in reversed(range(GROUND, len(mechanism.bodies))):
        composite, carried = composites[index], columns[index]
        for passage in reversed(passages[index]):
            for freedom in passage.step.freedoms:
                carried[freedom.name] = Falling(recorder.zeros, _unit_wrench(freedom, composite))
            for name, column in carried.items():
                for other, effort in column.carry(passage).items():
                    found[name, other] = found[other, name] = effort
            composite = before(passage, composite)
        if index != GROUND:
            parent = mechanism.bodies[index].parent
            composites[parent] = composites[parent] + composite
            columns[parent] |= carried
    return found


def efforts_at_rest(
    mechanism: Mechanism, recorder: Recorder, recursion: Recursion, inertias: Mapping[int, Array], gravity: Vec
) -> dict[str, Scalar]:
    """Effort of every freedom that holds the bodies' weight, sensors included.

    Parameters
    ----------
    mechanism, recorder, recursion, inertias
        As for :func:`mass_matrix_of_freedoms`.
    gravity : 3 of Scalar
        In the base frame, m/s².
    """
    nothing = np.full((4, 4), recorder.program.zero, dtype=object)
    found: dict[str, Scalar] = {}
    passages, _ = recursion.passages(gravity)
    composites = {index: inertias.get(index, nothing) for index in range(GROUND, len(mechanism.bodies))}
    for index in reversed(range(GROUND, len(mechanism.bodies))):
        composite = composites[index]
        for passage in reversed(passages[index]):
            for freedom in passage.step.freedoms:
                found[freedom.name] = dot(_unit_wrench(freedom, composite)[1], passage.end.linear)
            composite = before(passage, composite)
        if index != GROUND:
            composites[mechanism.bodies[index].parent] = composites[mechanism.bodies[index].parent] + composite
    return found


class Falling:
    """A wrench on its way to the ground."""

    def __init__(self, zeros: Vec, wrench: Wrench) -> None:
        self._descent, self._wrench = Descent(zeros), wrench

    def carry(self, passage: Passage) -> dict[str, Scalar]:
        """Take one step, and the efforts of the freedoms there."""
        self._descent.efforts.clear()
        self._wrench = self._descent.carry([passage], self._wrench)
        return dict(self._descent.efforts)


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


def before(passage: Passage, pseudo: Array) -> Array:
    """A pseudo-inertia about the frame before a step."""
    step, turned = passage.step, pseudo
    if step.rotation is not None:
        matrix = np.array(step.rotation, dtype=object)
        turned = pseudo.copy()
        turned[:3, MASS] = turned[MASS, :3] = matrix @ pseudo[:3, MASS]
        half = matrix @ pseudo[:3, :3]
        for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
            turned[i, j] = turned[j, i] = half[i] @ matrix[j]
        if passage.rotation is not None:
            # the sum of the second moments across the axis stays
            i, j = (passage.axis + 1) % 3, (passage.axis + 2) % 3
            turned[j, j] = (pseudo[i, i] + pseudo[j, j]) - turned[i, i]
    return turned if step.shift is None else _shifted(turned, step.shift)


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
