"""Whether configurations along a trajectory are one motion, and not pieces of several ways of assembly."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.excite.cells import PER_PERIOD, ranges
from echelon.excite.loops.enclosures import LoopEnclosures
from echelon.excite.loops.motion import LoopMotion
from echelon.excite.trajectory import Trajectory
from echelon.program.intervals import Interval

_HALVINGS = 10
_ROUNDING = 1e-8  # of closed configurations, rad or characteristic lengths


def connected(motion: LoopMotion, trajectory: Trajectory) -> bool:
    """Whether the loops stay closed from the start to the end, in one way of assembly.

    A box about the configuration in the middle of a short time holds the only configurations of this way of assembly
    then; those that are found at its ends, also by the neighbours, have to lie in it.

    Parameters
    ----------
    motion : LoopMotion
    trajectory : Trajectory
        Of the independent coordinates.
    """
    count = max(int(np.ceil(PER_PERIOD * trajectory.basis.frequency * trajectory.duration)), 1)
    times = np.linspace(0.0, trajectory.duration, count + 1)
    at = motion.positioned(trajectory(times)).q  # what neighbours have in common is found once
    begins, ends, first, last = times[:-1], times[1:], at[:-1], at[1:]
    enclosures = LoopEnclosures(motion)
    for _ in range(_HALVINGS):
        middles, halves = (begins + ends) / 2, (ends - begins) / 2
        located = enclosures.located(ranges(trajectory, middles, halves))
        if not located.closed.done.all():
            return False
        open_ = ~(located.found & _within(first, located.q) & _within(last, located.q))
        if not open_.any():
            return True
        middle, between = middles[open_], located.closed.q[open_]
        begins, ends = np.concatenate([begins[open_], middle]), np.concatenate([middle, ends[open_]])
        first, last = np.concatenate([first[open_], between]), np.concatenate([between, last[open_]])
    return False


def _within(q: Floats, box: Interval) -> npt.NDArray[np.bool_]:
    found: npt.NDArray[np.bool_] = np.all((q > box[0] - _ROUNDING) & (q < box[1] + _ROUNDING), axis=1)
    return found
