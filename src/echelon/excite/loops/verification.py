"""Margins of mechanisms with loops, at every time: what the whole state reaches while the independent one moves on."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from echelon.excite.cells import state_margins
from echelon.excite.collisions.certificate import clearance_margins
from echelon.excite.collisions.constraint import Clearance
from echelon.excite.constraints.state import Enclosed
from echelon.excite.loops.continuity import connected
from echelon.excite.loops.enclosures import LoopEnclosures
from echelon.excite.loops.limits import LoopLimits
from echelon.excite.loops.parts import LoopEfforts, LoopPart
from echelon.excite.loops.regressor import SEEN
from echelon.excite.loops.whole import WholeMotion
from echelon.excite.margins import Margin
from echelon.excite.trajectory import Trajectory
from echelon.program.intervals import Interval


def loop_margins(trajectory: Trajectory, limits: LoopLimits) -> list[Margin]:
    """How far a trajectory stays from the limits, in their order.

    Where the loops cannot be closed, or another way of assembly turns up, no margin is left to singular poses, and all
    others count as broken.

    Parameters
    ----------
    trajectory : Trajectory
        Of the independent coordinates.
    limits : LoopLimits
    """
    parts = limits.parts
    if not connected(limits.motion, trajectory):
        fields = zip(limits.labels, limits.units, limits.low.tolist(), limits.high.tolist(), strict=True)
        return [Margin(*field, -np.inf if k else 0.0, np.inf) for k, field in enumerate(fields)]
    bounded = [part for part in parts if isinstance(part, LoopEfforts) or isinstance(part.constraint, Enclosed)]
    found = iter(state_margins(trajectory, _Whole(limits, bounded)))
    margins = [next(found)]
    for part in parts:
        if isinstance(part, LoopPart) and isinstance(part.constraint, Clearance):
            margins += clearance_margins(WholeMotion(limits.motion, trajectory), part.constraint)
        else:
            margins += [next(found) for _ in part.labels]
    return margins


class _Whole:
    """Openness and all parts that are functions of the state; what :func:`state_margins` bounds."""

    def __init__(self, limits: LoopLimits, parts: list[LoopPart | LoopEfforts]) -> None:
        self._limits, self._enclosures = LoopLimits(limits.motion, parts), LoopEnclosures(limits.motion)
        self.labels, self.units, self.high = self._limits.labels, self._limits.units, self._limits.high
        self.low = self._limits.low
        self.low[0] = SEEN

    def enclosures(self, ranges: Mapping[str, Interval]) -> Interval:
        """Bounds of the functions while independent states stay in intervals."""
        limits, located = self._limits, self._enclosures.located(ranges)
        states = self._enclosures.states(located, ranges)
        first = tuple(end[:, None] / limits.motion.reference for end in self._enclosures.openness(located))
        found = [first, *(part.enclosures(self._enclosures, located, states) for part in limits.parts)]
        unknown = ~located.found[:, None]
        least, largest = (np.hstack([ends[k] for ends in found]) for k in (0, 1))
        return np.where(unknown, -np.inf, least), np.where(unknown, np.inf, largest)
