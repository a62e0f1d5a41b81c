"""Sums of angles: of joints whose axes are parallel, the angle from the first one on."""

from __future__ import annotations

from echelon.mechanism.joint import MotionKind
from echelon.mechanism.mechanism import GROUND, Mechanism
from echelon.mechanism.placement import Placement

Combination = tuple[tuple[str, int], ...]
"""A sum of angles: coordinates with whole factors."""


def absolute_angles(mechanism: Mechanism) -> dict[str, Combination]:
    """For every rotation whose axis is parallel to that of the rotation before it, the sum of angles up to it."""
    found: dict[str, Combination] = {}
    ends: dict[int, tuple[Combination, int, Placement | None]] = {GROUND: ((), 0, None)}
    for index, body in enumerate(mechanism.bodies):
        angles, axis, between = ends[body.parent]
        for step in body.joint.steps:
            if isinstance(step, Placement):
                between = step if between is None else between @ step
            elif step.kind in (MotionKind.ROTATION, MotionKind.SCREW):
                parallel = _sign_along(between, axis, step.axis) if angles else 0
                before = tuple((name, sign * parallel) for name, sign in angles) if parallel else ()
                angles, axis, between = (*before, (f"q[{step.name}]", step.sign)), step.axis, None
                if len(angles) > 1 and step.name not in mechanism.dependent:
                    found[f"q[{step.name}]"] = angles
            elif step.kind is MotionKind.BALL:
                angles, between = (), None
            if not isinstance(step, Placement) and step.name in mechanism.dependent:
                angles = ()
        ends[index] = angles, axis, between
    return found


def _sign_along(between: Placement | None, first: int, second: int) -> int:
    """1 or −1 where the second axis is along the first one, else 0."""
    if between is None:
        return int(first == second)
    column = [between.rotation[row][second].number for row in range(3)]
    return next((s for s in (1, -1) if all(v == s * (row == first) for row, v in enumerate(column))), 0)
