"""What a trajectory reaches at any time: margins that hold between samples too.

Limits of the motion: between samples a function exceeds the larger one by at most h²/8 times the bound of its second
derivative, which follows from the coefficients.  Limits of the state: :mod:`echelon.excite.cells`; with loops
:mod:`echelon.excite.loops.verification`.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from echelon.errors import EchelonError
from echelon.excite.cells import SHARP, state_margins
from echelon.excite.collisions.certificate import clearance_margins
from echelon.excite.collisions.constraint import Clearance
from echelon.excite.constraints.motion import MotionLimit
from echelon.excite.constraints.state import Enclosed
from echelon.excite.loops.limits import LoopLimits
from echelon.excite.loops.verification import loop_margins
from echelon.excite.margins import Margin
from echelon.excite.task import Task
from echelon.excite.trajectory import Trajectory

_SHARPER = (SHARP, SHARP / 100, SHARP / 10_000)
"""Share of a limit's range by which bounds may be wider than what is reached: one after the other where that decides
whether a limit is kept."""
_COARSE, _MOST = 200, 1_000_000
"""Samples of a limit of the motion, at least and at most."""


def margins_of(trajectory: Trajectory, task: Task) -> list[Margin]:
    """How far a trajectory stays from all limits, first those of the motion, then those of the state in their order.

    Parameters
    ----------
    trajectory : Trajectory
    task : Task
    """
    found = motion_margins(trajectory, task.limits.motion)
    for constraint in task.constraints:
        if isinstance(constraint, Enclosed):
            found += state_margins(trajectory, constraint)
        elif isinstance(constraint, Clearance):
            found += clearance_margins(trajectory, constraint)
        elif isinstance(constraint, LoopLimits):
            found += loop_margins(trajectory, constraint)
        else:
            raise EchelonError(f"nothing bounds {', '.join(constraint.labels[:3])} between samples")
    return found


def motion_margins(trajectory: Trajectory, limits: Iterable[MotionLimit]) -> list[Margin]:
    """How far positions and their derivatives stay from limits.

    Parameters
    ----------
    trajectory : Trajectory
    limits : iterable of MotionLimit
    """
    return [_motion_margin(trajectory, limit) for limit in limits]


def _motion_margin(trajectory: Trajectory, limit: MotionLimit) -> Margin:
    combined = trajectory.coefficients @ limit.weights[:, None]
    curvature = float(trajectory.basis.bounds(combined, limit.order + 2)[0])
    span = limit.high - limit.low
    size = span if np.isfinite(span) else max(abs(x) for x in (limit.low, limit.high) if np.isfinite(x))
    for sharp in _SHARPER:
        step = np.sqrt(8 * sharp * size / curvature) if curvature > 0 and size > 0 else np.inf
        count = int(np.clip(trajectory.duration / step, _COARSE, _MOST))
        times = np.linspace(0.0, trajectory.duration, count + 1)
        values = trajectory.basis.motion(times, combined, limit.order)
        more = curvature * (trajectory.duration / count) ** 2 / 8
        least, largest = float(values.min()), float(values.max())
        # where the bound breaks a limit that the samples keep, more samples decide
        if least < limit.low or largest > limit.high or (least - more >= limit.low and largest + more <= limit.high):
            break
    return Margin(limit.label, limit.unit, limit.low, limit.high, least - more, largest + more)
