"""The motion of all coordinates of a mechanism with loops, from that of the independent ones."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.errors import EchelonError
from echelon.excite.cells import reach
from echelon.excite.loops.enclosures import LoopEnclosures
from echelon.excite.loops.motion import LoopMotion
from echelon.excite.trajectory import Trajectory
from echelon.program.intervals import Interval

_SAMPLES = 500  # that tell how sharp bounds have to be


class WholeMotion:
    """All coordinates as functions of time; what :func:`least_clearances` asks of a trajectory.

    Parameters
    ----------
    motion : LoopMotion
    trajectory : Trajectory
        Of the independent coordinates, along which the loops can be closed.
    """

    def __init__(self, motion: LoopMotion, trajectory: Trajectory) -> None:
        self._motion, self._trajectory = motion, trajectory
        self.coordinates, self.duration = motion.mechanism.positions, trajectory.duration
        least, largest = reach(trajectory, _Rates(motion, trajectory))
        most = np.maximum(np.abs(least), np.abs(largest))
        if not np.isfinite(most).all():
            raise EchelonError("nothing bounds the velocities of the dependent coordinates")
        self._bounds = np.split(most, 3)

    def __call__(self, t: npt.ArrayLike, order: int = 0) -> Floats:
        """Positions at times, or velocities (order 1): shape (N, positions) or (N, velocities)."""
        closed = self._motion.at(*self._trajectory.states(t))
        return closed.qd if order else closed.q

    def bounds(self, order: int) -> Floats:
        """What no position of a single coordinate, no velocity, no acceleration exceeds, shape (velocities,)."""
        return self._bounds[order]


class _Rates:
    """Single positions, velocities and accelerations, between limits far beyond what they reach."""

    def __init__(self, motion: LoopMotion, trajectory: Trajectory) -> None:
        self._motion, self._enclosures = motion, LoopEnclosures(motion)
        n = len(motion.mechanism.velocities)
        self.labels = self.units = ("",) * (3 * n)
        closed = motion.at(*trajectory.states(np.linspace(0.0, trajectory.duration, _SAMPLES)))
        seen = np.abs(np.hstack([motion.single(closed.q), closed.qd, closed.qdd])).max(axis=0)
        self.high = 2.0 * seen + 1e-3
        self.low = -self.high

    def enclosures(self, ranges: Mapping[str, Interval]) -> Interval:
        """Their bounds while independent states stay in intervals."""
        located = self._enclosures.located(ranges)
        states = self._enclosures.states(located, ranges)
        single = tuple(self._motion.single(end) for end in states["q"])
        least, largest = (np.hstack([single[k], states["qd"][k], states["qdd"][k]]) for k in (0, 1))
        unknown = ~located.found[:, None]
        return np.where(unknown, -np.inf, least), np.where(unknown, np.inf, largest)
