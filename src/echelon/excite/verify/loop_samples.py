"""Limits of mechanisms with loops at samples of a motion.

Interval arithmetic says nothing useful of dependent coordinates, because quotients of intervals grow.  So a motion is
looked at so often that a parabola through three samples gives its extremes, and margins say that they are no bounds.
"""

from __future__ import annotations

import numpy as np

from echelon.arrays import Floats
from echelon.excite.problem.closed_loops import FULL_WEIGHT, LoopLimits
from echelon.excite.problem.loop_motion import Closed, LoopMotion
from echelon.excite.problem.trajectory import Trajectory
from echelon.excite.verify.margins import Margin
from echelon.regressor.loops.assembly import LARGEST_CORRECTION
from echelon.regressor.loops.closed_motion import largest, position_rates

PER_PERIOD = 200
"""Samples per period of the highest frequency: between them a sine rises by 0.01 % of its amplitude."""


def loop_margins(trajectory: Trajectory, limits: LoopLimits) -> list[Margin]:
    """How far a trajectory stays from the limits at samples, in their order.

    Where the loops cannot be closed, or another way of assembly turns up, no margin is left to singular poses, and all
    others count as broken.
    """
    count = max(int(np.ceil(PER_PERIOD * trajectory.basis.frequency * trajectory.duration)), 2)
    times = np.linspace(0.0, trajectory.duration, count + 1)
    states = trajectory.states(times)
    low = np.array([FULL_WEIGHT, *limits.low[1:]])
    fields = zip(limits.labels, limits.units, low.tolist(), limits.high.tolist(), strict=True)
    if not connected(limits.motion, limits.motion.at(*states), times[1]):
        return [Margin(*field, -np.inf if k else 0.0, np.inf, sampled=True) for k, field in enumerate(fields)]
    values = limits.values(*states)
    reached = zip(fields, (-_peaks(-values)).tolist(), _peaks(values).tolist(), strict=True)
    return [Margin(*field, least, most, sampled=True) for field, least, most in reached]


def connected(motion: LoopMotion, closed: Closed, step: float) -> bool:
    """Whether loops stay closed in one way of assembly: each sample is where the velocities about it lead."""
    if not closed.done.all():
        return False
    middle, rates = (closed.q[1:] + closed.q[:-1]) / 2, (closed.qd[1:] + closed.qd[:-1]) / 2
    moved = position_rates(motion.mechanism, middle, step * rates)
    away = largest((np.diff(closed.q, axis=0) - moved) / motion.position_units)
    return bool(np.all(away < LARGEST_CORRECTION))


def _peaks(values: Floats) -> Floats:
    """Largest value of each column: of the samples, and of parabolas through samples and their neighbours."""
    before, here, after = values[:-2], values[1:-1], values[2:]
    bend = 2 * here - before - after
    top = (here >= before) & (here >= after) & (bend > 0)
    rise = np.where(top, (after - before) ** 2 / (8 * np.where(top, bend, 1.0)), 0.0)
    found: Floats = np.maximum(values.max(axis=0), (here + rise).max(axis=0))
    return found
