"""Which assembly mode the mechanism's own pose is in: relations must hold in real states near it.

Doubles tell where it is clear.  Where it is not, since the pose is nearly singular or modes nearly meet there, closed
states in ball arithmetic do: there the relations of a mode hold to a hundred digits, or they do not.
"""

from __future__ import annotations

from collections.abc import Sequence

import flint
import numpy as np

from echelon.base.ball_rows import Balls
from echelon.base.ball_tables import combinations_of, vanishes
from echelon.base.modes import Mode
from echelon.base.near_pose import BITS, NearPose

_HOLDS, _FAILS = 1e-8, 1e-4  # what relations miss by in doubles where they surely hold, and where they surely do not
_INDEPENDENT = 1e-7  # smallest singular value of columns that surely are
_SAME_MARK = 1e-3  # coefficients that are simple rational numbers lie farther apart


class OwnMode:
    """Tells which modes hold near a pose, by the columns that they were found with."""

    def __init__(self, near: NearPose) -> None:
        self._near = near

    def mode(self, modes: Sequence[Mode]) -> Mode | None:
        """The one of some modes that the pose is in; None if it is in none of them, as far as can be told."""
        verdicts = [self._clear(mode) for mode in modes]
        if verdicts.count(True) == 1 and None not in verdicts:
            return modes[verdicts.index(True)]
        return next((m for m, v in zip(modes, verdicts, strict=True) if v is not False and self._holds(m)), None)

    def likely(self, modes: Sequence[Mode]) -> Mode | None:
        """The first of some modes whose relations hold there, perhaps beside others."""
        return next((mode for mode in modes if self._clear(mode) is not False), None)

    def _rank(self, mode: Mode) -> int:
        return len(self._near.columns) - len(mode.dependence)

    # -- doubles ---------------------------------------------------------------------------------------------------

    def _clear(self, mode: Mode) -> bool | None:
        """Whether a mode surely holds; None if doubles do not tell."""
        table, sizes = self._near.table
        pivots, others = _split(mode, table.shape[1])
        orthogonal, triangle = np.linalg.qr(table[:, pivots])
        if np.linalg.svd(triangle, compute_uv=False).min(initial=1.0) < _INDEPENDENT:
            return None
        solution = np.linalg.solve(triangle, orthogonal.T @ table[:, others])
        missed = np.abs(table[:, others] - table[:, pivots] @ solution).max(initial=0.0)
        if missed > _HOLDS:
            return False if missed > _FAILS else None
        scaled = solution * sizes[others] / sizes[pivots][:, None]
        return all(
            _same(scaled[pivots.index(source), others.index(column)], float(mark))
            for (column, source), mark in (mode.marks or {}).items()
        )

    # -- balls -----------------------------------------------------------------------------------------------------

    def _holds(self, mode: Mode) -> bool:
        """Whether the representatives of a mode are independent there, and its relations and no others hold."""
        rank = self._rank(mode)
        # with few more rows than the rank, relations are not told from rounding; as many as there are columns always do
        enough = len(self._near.columns)
        # several motions at a pose show as much as several poses, unless much changes along few ways
        several = max(2, len(self._near.mechanism.independent_velocities))
        trials = [(min(2 * rank, enough), BITS[0], several), (enough, BITS[0], several), (enough, BITS[0], 1)]
        for wanted, bits, motions in (*trials, *((enough, bits, several) for bits in BITS[1:])):
            table = self._near.balls(wanted, bits, motions)
            if table is None:  # the loops are not proved to close
                return False
            with flint.ctx.workprec(bits):
                verdict = self._holds_in_balls(mode, table, bits)
            if verdict is not None:
                return verdict
        return False

    def _holds_in_balls(self, mode: Mode, table: Balls, bits: int) -> bool | None:
        """The same to some precision; None if it does not tell."""
        auxiliary = self._near.rows.auxiliary
        pivots, others = _split(mode, len(self._near.columns))
        kept = [*range(auxiliary), *(auxiliary + k for k in pivots)]
        found = combinations_of(table, kept, [auxiliary + k for k in others])
        if found is None:
            return None
        solution, missed = found
        zero = [vanishes(x, bits) for x in missed.flat]
        if not all(zero):
            return None if False not in zero else False
        for k, column in enumerate(others):
            vanish = {pivots[i - auxiliary]: vanishes(solution[i, k], bits) for i in range(auxiliary, len(kept))}
            if None in vanish.values():
                return None
            if {p for p, zero in vanish.items() if not zero} != set(mode.dependence[column]):
                return False
        return all(
            _same(float(solution[auxiliary + pivots.index(source), others.index(column)].mid()), float(mark))
            for (column, source), mark in (mode.marks or {}).items()
        )


def _split(mode: Mode, columns: int) -> tuple[list[int], list[int]]:
    """The columns that are representatives in a mode, and the others."""
    return [k for k in range(columns) if k not in mode.dependence], list(mode.dependence)


def _same(value: float, mark: float) -> bool:
    return abs(value - mark) < _SAME_MARK * max(1.0, abs(mark))
