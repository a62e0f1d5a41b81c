"""The optimisation problem of a mechanism with loops: motions never lose sight of where the loops can be closed.

Other limits of the state are asked for when they are broken.  That the loops can be closed is asked for from the
beginning: beyond, nothing is seen, and what lies next to it looks better than it is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from echelon.arrays import Floats
from echelon.excite.problem import Problem

_BLIND = 1e6
"""Criterion of a motion that does not see some parameter at all, because loops cannot be closed."""


@dataclass(frozen=True, eq=False)
class LoopProblem(Problem):
    """Minimise a criterion within limits; the first constraint is a :class:`LoopLimits`."""

    def first(self) -> Problem:
        """The problem with limits of positions and velocities, and loops that can be closed."""
        part = super().first()
        assert part.asked is not None
        loops = part.asked[0].copy()
        loops[:, 0] = True
        return replace(part, asked=(loops, *part.asked[1:]))

    def value(self, x: Floats) -> float:
        """The criterion."""
        return self.value_and_gradient(x)[0]

    def value_and_gradient(self, x: Floats) -> tuple[float, Callable[[], Floats]]:
        """The criterion, and what gives its derivatives; large and zero for a motion that does not see a parameter."""
        seen = self.information(x.reshape(self.shape))
        if np.any(np.diag(seen.F) <= 0):
            return _BLIND, lambda: np.zeros(self.size)
        value, slope = self.criterion.evaluate(seen.F)
        return value, lambda: seen.gradient(slope).ravel()
