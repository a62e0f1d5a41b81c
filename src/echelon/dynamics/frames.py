"""Body frames that cost least: origins slide along the axes of rotations.

A rotation and a shift along its axis commute.  So an offset along an axis, such as d in Denavit–Hartenberg tables, can
wait until behind the joint, where it often meets an offset that it can be added to, or need not be taken at all because
no body further out is shifted.  On arms with parallel axes this saves up to a tenth of all operations.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from echelon.exact.polynomial import Polynomial
from echelon.inertia.spatial import Array
from echelon.mechanism.joint import Joint, MotionKind, Step, merge
from echelon.mechanism.mechanism import GROUND, Mechanism
from echelon.mechanism.output import Cut
from echelon.mechanism.placement import ORIGIN, Placement, Vector
from echelon.program.tape import Program


@dataclass(frozen=True)
class Reframed:
    """A mechanism whose bodies have other frames, with the same motion and the same forces.

    Attributes
    ----------
    mechanism : Mechanism
    origins : mapping of int to 3 of Polynomial
        New origin of a body's frame in its old one, where it has moved.
    """

    mechanism: Mechanism
    origins: dict[int, Vector]

    def inertia(self, body: int, pseudo: Array, program: Program) -> Array:
        """A body's pseudo-inertia about its new frame, from that about its old one."""
        if body not in self.origins:
            return pseudo
        change = np.array([[program.constant(int(i == j)) for j in range(4)] for i in range(4)])
        change[:3, 3] = [-program.polynomial(entry) for entry in self.origins[body]]
        moved: Array = change @ pseudo @ change.T
        return moved


def slid(mechanism: Mechanism) -> Reframed:
    """Move the frames of rotating bodies along their axes to where the joint has no offset along the axis.

    A mechanism with sensors between bodies stays as it is, because these are placed in its frames.
    """
    if any(isinstance(channel, Cut) for output in mechanism.outputs for channel, _ in output.terms):
        return Reframed(mechanism, {})
    origins: dict[int, Vector] = {}
    bodies = []
    for index, body in enumerate(mechanism.bodies):
        steps: tuple[Step, ...] = body.joint.steps
        if body.parent != GROUND and body.parent in origins:
            x, y, z = origins[body.parent]
            steps = merge((Placement(translation=(-x, -y, -z)), *steps))
        offset = _offset(body.joint, steps)
        if any(offset):
            origins[index] = offset
            steps = merge((*steps[:-1], Placement(translation=offset), steps[-1]))
        bodies.append(replace(body, joint=replace(body.joint, steps=steps)))
    return Reframed(replace(mechanism, bodies=tuple(bodies)), origins)


def _offset(joint: Joint, steps: tuple[Step, ...]) -> Vector:
    """What takes a joint's offset along its axis away, if the axis is along a coordinate axis of the parent."""
    if len(steps) != 2 or len(joint.motions) != 1 or joint.motions[0].kind is not MotionKind.ROTATION:
        return ORIGIN
    placed, motion = steps
    if not isinstance(placed, Placement) or motion is not joint.motions[0]:
        return ORIGIN
    axis = motion.axis
    direction = [row[axis] for row in placed.rotation]
    if sum(1 for entry in direction if entry) != 1:
        return ORIGIN
    along = Polynomial.sum(a * b for a, b in zip(direction, placed.translation, strict=True))
    x, y, z = (-along if k == axis else Polynomial({}) for k in range(3))
    return (x, y, z)
