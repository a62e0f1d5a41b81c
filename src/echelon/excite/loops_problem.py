"""The optimisation problem of a mechanism with loops: motions never lose sight of where the loops can be closed.

Other limits of the state are asked for when they are broken.  That the loops can be closed is asked for from the
beginning, and starting points keep it: beyond, nothing is seen, and what lies next to it looks better than it is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from echelon.excite.problem import Problem

Floats = npt.NDArray[np.float64]

_BLIND = 1e6
"""Criterion of a motion in which some parameter is not seen at all, because loops cannot be closed."""
_SMALLER, _TRIES = 0.8, 40  # motions are drawn towards their centre until the loops can be closed


@dataclass(frozen=True, eq=False)
class LoopProblem(Problem):
    """Minimise a criterion within limits; the first constraint is a ``LoopLimits``."""

    def first(self) -> Problem:
        """The problem with limits of positions and velocities, and loops that can be closed."""
        part = super().first()
        assert part.asked is not None
        loops = part.asked[0].copy()
        loops[:, 0] = True
        return replace(part, asked=(loops, *part.asked[1:]))

    def shrunk(self, x: Floats, share: float = 1.0) -> Floats:
        """The motion drawn towards resting at the centre until it keeps all limits, then by a share more."""
        rest, found = self.at_rest.ravel(), super().shrunk(x, share)
        for _ in range(_TRIES):
            if np.all(self.constraints[0].values(*self.state(found))[:, 0] >= self.constraints[0].low[0]):
                break
            found = rest + _SMALLER * (found - rest)
        return found

    def value(self, x: Floats) -> float:
        """The criterion."""
        return self.value_and_gradient(x)[0]

    def value_and_gradient(self, x: Floats) -> tuple[float, Floats]:
        """The criterion and its derivatives; large and zero for a motion in which some parameter is not seen."""
        seen = self.information(x.reshape(self.shape))
        if np.any(np.diag(seen.F) <= 0):
            return _BLIND, np.zeros(self.size)
        value, slope = self.criterion.evaluate(seen.F)
        return value, seen.gradient(slope).ravel()
