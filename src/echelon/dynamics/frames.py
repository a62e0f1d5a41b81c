"""Body frames that cost least: directly behind the joint, with the origin where the axis has no offset.

A constant placement behind a joint, as in standard Denavit–Hartenberg tables, belongs to the joints that follow: then a
body's frame has a coordinate axis on the axis of its joint, where a third of its parameters count to its parent.

A rotation and a shift along its axis commute.  So an offset along an axis, such as d in Denavit–Hartenberg tables, can
wait until behind the joint, where it often meets an offset that it can be added to, or need not be taken at all because
no body further out is shifted.  On arms with parallel axes this saves up to a tenth of all operations.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from echelon.exact.polynomial import Polynomial
from echelon.mechanism.joint import Joint, MotionKind, Step, merge
from echelon.mechanism.mechanism import Mechanism
from echelon.mechanism.output import Cut
from echelon.mechanism.placement import ORIGIN, Placement, Vector


@dataclass(frozen=True)
class Reframed:
    """A mechanism whose bodies have other frames, with the same motion and the same forces.

    Attributes
    ----------
    mechanism : Mechanism
    frames : mapping of int to Placement
        A body's new frame in its old one, where it is another.
    """

    mechanism: Mechanism
    frames: dict[int, Placement]


def reframed(mechanism: Mechanism) -> Reframed:
    """Put bodies' frames directly behind their joints, and along rotation axes to where the joint has no offset.

    A mechanism with sensors between bodies stays as it is, because these are placed in its frames.
    """
    if any(isinstance(channel, Cut) for output in mechanism.outputs for channel, _ in output.terms):
        return Reframed(mechanism, {})
    frames: dict[int, Placement] = {}
    bodies = []
    for index, body in enumerate(mechanism.bodies):
        steps: tuple[Step, ...] = body.joint.steps
        if body.parent in frames:
            steps = merge((frames[body.parent].inverse(), *steps))
        steps, behind = _without_placement_behind(steps)
        offset = _offset(body.joint, steps)
        if any(offset):
            steps = merge((*steps[:-1], Placement(translation=offset), steps[-1]))
        frame = behind.inverse() @ Placement(translation=offset)
        if not frame.is_identity:
            frames[index] = frame
        bodies.append(replace(body, joint=replace(body.joint, steps=steps)))
    return Reframed(replace(mechanism, bodies=tuple(bodies)), frames)


def _without_placement_behind(steps: tuple[Step, ...]) -> tuple[tuple[Step, ...], Placement]:
    """Steps up to the last motion, and the placement that follows it."""
    if len(steps) > 1 and isinstance(steps[-1], Placement):
        return steps[:-1], steps[-1]
    return steps, Placement()


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
