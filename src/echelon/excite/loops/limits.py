"""Limits of mechanisms with loops as constraints of the independent state.

All of them ask for the same closed states, so they are one constraint: that the loops can be closed and stay away from
singular configurations, and then what the whole state has to keep: forces, points, distances.  What happens between
samples: :mod:`echelon.excite.loops.verification`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from echelon.arrays import Floats
from echelon.excite.constraints.state import Slopes as StateSlopes
from echelon.excite.loops.motion import LoopMotion
from echelon.excite.loops.parts import LoopEfforts, LoopPart
from echelon.excite.loops.positions import Closed

OPEN = 0.15
"""Least openness that a solver has to keep, as a share of :attr:`LoopMotion.reference`."""


class LoopLimits:
    """What a motion of the independent coordinates has to keep; a :class:`StateConstraint`.

    The first function is the openness of the loops as a share of the usual one; where they cannot be closed, it is
    negative, by how far it is back to where they can.  All others count as kept there.

    Parameters
    ----------
    motion : LoopMotion
    parts : sequence of LoopPart or LoopEfforts
    """

    def __init__(self, motion: LoopMotion, parts: Sequence[LoopPart | LoopEfforts] = ()) -> None:
        self.motion, self.parts = motion, tuple(parts)

    @property
    def labels(self) -> tuple[str, ...]:
        """What each function is, for messages."""
        return ("distance of the loops from singular poses", *(label for part in self.parts for label in part.labels))

    @property
    def units(self) -> tuple[str, ...]:
        """SI units of the functions."""
        return ("1", *(unit for part in self.parts for unit in part.units))

    @property
    def low(self) -> Floats:
        """Least values, shape (m,)."""
        return np.concatenate([[OPEN], *(part.low for part in self.parts)])

    @property
    def high(self) -> Floats:
        """Largest values, shape (m,)."""
        return np.concatenate([[np.inf], *(part.high for part in self.parts)])

    def values(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """The functions at independent states of shape (N, k), shape (N, m)."""
        return self._at(self.motion.at(q, qd, qdd))

    def _at(self, closed: Closed) -> Floats:
        away = np.linalg.norm(closed.missing, axis=1)
        found = np.column_stack(
            [
                np.where(closed.done, closed.openness / self.motion.reference, -away),
                *(part.values(self.motion, closed) for part in self.parts),
            ]
        )
        kept = np.clip(0.0, self.low, self.high)
        return np.where(closed.done[:, None] | (np.arange(len(kept)) == 0), found, kept)

    def slopes(self, q: Floats, qd: Floats, qdd: Floats) -> StateSlopes:
        """Their derivatives, each of shape (N, m, k)."""
        closed = self.motion.at(q, qd, qdd)
        opening = self.motion.openness_slopes(closed, np.full(len(q), 1 / self.motion.reference))
        away = np.linalg.norm(closed.missing, axis=1, keepdims=True)
        back = -closed.missing / np.maximum(away, 1e-300) / self.motion.independent_units
        by_q, nothing = self.motion.along(closed, opening), np.zeros_like(qd)
        first = (np.where(closed.done[:, None], by_q, back), nothing, nothing)
        rows = [first, *(row for part in self.parts for row in part.slopes(self.motion, closed))]
        by_q, by_qd, by_qdd = (np.stack([row[order] for row in rows], axis=1) for order in range(3))
        return by_q, by_qd, by_qdd
