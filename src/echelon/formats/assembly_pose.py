"""Where the loops of a robot file are assembled: at its reference pose, or at a keyframe that closes them better."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from echelon.arrays import Floats
from echelon.mechanism.joint import MotionKind
from echelon.mechanism.mechanism import Mechanism
from echelon.regressor.loops.closed_motion import ClosedMotion, largest, normalised

_CLOSED = 1e-9  # of the characteristic length, or rad: rounding of doubles, and nobody wants to know
_NEAR = 0.02  # a pose that is this near to closing is taken for the one that is meant


def chosen_pose(mechanism: Mechanism, poses: Mapping[str, Mapping[str, float]]) -> tuple[dict[str, float], str]:
    """The pose near which loops are assembled, and what the user should know about it, if anything."""
    known = [{n: v for n, v in pose.items() if n in mechanism.positions} for pose in poses.values()]
    motion = ClosedMotion(mechanism)
    values, _ = motion.closures.at(normalised(mechanism, np.array([_positions(mechanism, pose) for pose in known])))
    open_by = largest(values)
    best = 0 if open_by[0] < _NEAR else int(open_by.argmin())
    names = list(poses)
    if best:
        at_first = f"at {names[0]} {motion.opening(values[0])}"
        return known[best], f"the loops are assembled near {names[best]}, because {at_first}"
    if open_by[0] > _CLOSED:
        return known[0], f"at {names[0]} {motion.opening(values[0])}: the loops are assembled near it"
    return known[0], ""


def _positions(mechanism: Mechanism, pose: Mapping[str, float]) -> Floats:
    upright = {m.positions[0]: 1.0 for m in mechanism.motions if m.kind is MotionKind.BALL}
    return np.array([pose.get(name, upright.get(name, 0.0)) for name in mechanism.positions])
