"""Inertias that parameters stand for, moved between bodies to where they cost least.

Mass on the axis of a rotation moves alike on both sides of the joint: its second moment along the axis, its first
moment and the mass itself may count to either body.  Here they count to the parent, so that a body behind a rotation
has no more than seven parameters, in whatever form parameters were given; and all of a body that cannot move against
its parent counts to the parent.  The work is done once for all samples.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from echelon.conventions import PER_BODY
from echelon.dynamics.frames import Reframed
from echelon.inertia.spatial import Array, pseudo_inertia
from echelon.mechanism.joint import Joint, MotionKind
from echelon.mechanism.mechanism import GROUND
from echelon.mechanism.output import Cut
from echelon.program.tape import Scalar
from echelon.regressor.steps import Recorder, Step

MASS = 3
"""Row of the mass and of first moments in a pseudo-inertia."""


def grouped_inertias(reframed: Reframed, recorder: Recorder, parameters: Mapping[int, Scalar]) -> dict[int, Array]:
    """Pseudo-inertias of the bodies.

    Parameters
    ----------
    reframed : Reframed
    recorder : Recorder
        Of the reframed mechanism.
    parameters : mapping of int to Scalar
        Of some columns of the regressor, about the original frames; all other parameters are zero.

    Returns
    -------
    dict of int to array of shape (4, 4)
        [[Σ, h], [hᵀ, m]] of Scalar, about the bodies' frames, for the bodies that have parameters.
    """
    zero, mechanism = recorder.program.zero, reframed.mechanism
    found = {index: np.full((4, 4), zero, dtype=object) for index in range(GROUND, len(mechanism.bodies))}
    for index, first in mechanism.first_column.items():
        values = np.full((1, PER_BODY), zero, dtype=object)
        for offset, kind in enumerate(mechanism.bodies[index].carried):
            values[0, kind] = parameters.get(first + offset, zero)
        found[index] = pseudo_inertia(values)[0]
        if index in reframed.frames:
            found[index] = _before(recorder.placement(reframed.frames[index].inverse()), found[index])
    cuts = {channel.body for output in mechanism.outputs for channel, _ in output.terms if isinstance(channel, Cut)}
    for index in reversed(range(len(mechanism.bodies))):
        body = mechanism.bodies[index]
        axes = _movable(body.joint)
        if axes and index not in cuts and not (body.parent == GROUND and GROUND in cuts):
            moved = np.full((4, 4), zero, dtype=object)
            moved[np.ix_(axes, axes)] = found[index][np.ix_(axes, axes)]
            found[index] = found[index] - moved
            for step in reversed(recorder.steps(index)):
                moved = _before(step, moved)
            found[body.parent] = found[body.parent] + moved
    return {i: pseudo for i, pseudo in found.items() if i != GROUND and not all(x.is_zero for x in pseudo.flat)}


def _movable(joint: Joint) -> list[int]:
    """Rows of a body's pseudo-inertia that may count to its parent."""
    if joint.is_fixed:
        return [0, 1, 2, MASS]
    if (
        len(joint.motions) > 1
        or joint.motions[0].kind is not MotionKind.ROTATION
        or joint.steps[-1] != joint.motions[0]
    ):
        return []
    return [joint.motions[0].axis, MASS]


def _before(step: Step, pseudo: Array) -> Array:
    """A pseudo-inertia about the frame before a placement; a rotation does not change what lies on its axis."""
    if step.freedoms or step.rotation is None or step.shift is None:
        return pseudo
    homogeneous = np.array([(*row, shift) for row, shift in zip(step.rotation, step.shift, strict=True)])
    homogeneous = np.vstack([homogeneous, [0, 0, 0, 1]])
    moved: Array = homogeneous @ pseudo @ homogeneous.T
    return moved
