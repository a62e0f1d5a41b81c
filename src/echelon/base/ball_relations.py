"""Relations between columns of X in ball arithmetic, at real closed states of mechanisms with loops.

Rows of X at real closed states are known to hundreds of digits.  Columns that are independent in double precision are
representatives.  What the others are beside them is zero to all digits, or it shows columns that double precision does
not: then those of them that are independent are representatives, too, and so on.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass

import flint
import numpy as np

from echelon.arrays import Floats, independent_columns
from echelon.base.ball_rows import Balls
from echelon.base.ball_tables import combinations_of, doubles, left_of, rounded, vanishes
from echelon.base.matrix import StatedNumbers
from echelon.base.near_pose import BITS, NearPose
from echelon.errors import SingularPoseError
from echelon.exact.rational import RationalFunction
from echelon.mechanism.closed_pose import shown_loops
from echelon.mechanism.mechanism import Mechanism
from echelon.mechanism.stated import all_symbols, value_texts
from echelon.regressor.linear_forms import rows_of

_FIRM = (1e-6, 1e-4, 1e-2)  # of a column, what double precision surely shows; more where it does not
_SMALLEST = 1e-4  # of columns, about the largest one
_CHECKED = 40  # rows in which a column that depends on others has to vanish beside them
_FAINT = 1e-9  # of what others show, what a file with many digits does not mean
_WIDE = 2.0  # how far states stray from the pose that show whether it is rounding that shows little


@dataclass(frozen=True)
class BallRelations:
    """Dependent columns as combinations of representatives, in numbers.

    Attributes
    ----------
    pivots : tuple of int
        Columns of the representatives, those that show most first.
    columns : mapping of int to dict
        For every other column its coefficients by pivot, without zeros.
    meaning : StatedNumbers
        At which values of symbols the numbers are true, and how exact they are.
    faint : int
        How many of the representatives, the last ones, show less than a file with many digits means.
    size : float
        How much shows of these, beside the others; 0 if there are none.
    singular : bool
        Whether more motions are possible at the pose itself than near it, so that modes of assembly may meet there.
    """

    pivots: tuple[int, ...]
    columns: Mapping[int, dict[int, RationalFunction]]
    meaning: StatedNumbers
    faint: int
    size: float
    singular: bool = False

    @property
    def doubt(self) -> str:
        """What speaks against the number of representatives, whatever the pose; empty if nothing does."""
        if not self.faint:
            return ""
        count = len(self.pivots)
        return (
            f"{self.faint} of {count} base parameters hardly show ({self.size:.0e} of what others do): if rounding has "
            f"broken what is special about the loops, there are {count - self.faint}; state them with more digits"
        )


def ball_relations(mechanism: Mechanism, most: int, order: Sequence[int] | None = None) -> BallRelations:
    """The relations near the pose at which the loops close, with no more than some number of representatives.

    Of some columns the first ones in an order are preferred.

    Raises
    ------
    SingularPoseError
        If the loops are not proved to close, or precision does not tell.
    """
    count = len(mechanism.parameters)
    wanted, rows = range(count) if order is None else order, rows_of(mechanism)
    pose = NearPose(mechanism, rows, range(count))
    found, bits = eliminated(pose, most, wanted)
    if found.faint:  # near the pose, much of what few motions change is smooth and shows little
        with suppress(SingularPoseError):
            wide = eliminated(NearPose(mechanism, rows, range(count), _WIDE), most, wanted)
            if len(wide[0].pivots) == len(found.pivots) and wide[0].faint < found.faint:
                found, bits = wide
    with flint.ctx.workprec(bits):
        return _relations(found, value_texts(mechanism, all_symbols(mechanism)), pose.is_singular)


@dataclass(frozen=True)
class Found:
    """Columns by others; see :class:`BallRelations`."""

    pivots: list[int]
    others: list[int]
    solution: Balls  # (pivots, others)
    faint: int
    size: float


def eliminated(pose: NearPose, most: int, order: Sequence[int]) -> tuple[Found, int]:
    """Relations between columns near a pose that hold at other poses, too, and the bits that they are known to.

    Several motions at a pose show as much as several poses, unless much changes along few ways.
    """
    several = max(1, len(pose.mechanism.independent_velocities))
    for bits, motions in dict.fromkeys(((BITS[0], several), *((bits, 1) for bits in BITS))):
        table, others = pose.balls(most, bits, motions), pose.other_balls(bits)
        if table is None or others is None:
            break
        with flint.ctx.workprec(bits):
            found = Elimination(table, bits).done(order, others)
        if found is not None:
            return found, bits
    raise SingularPoseError(f"{shown_loops(pose.mechanism)} are not known to close in ball arithmetic")


class Elimination:
    """Columns of a table in balls by others; those before the parameters, auxiliary ones, come first."""

    def __init__(self, table: Balls, bits: int) -> None:
        self.table, self.bits = table, bits

    def done(self, order: Sequence[int], others: Balls | None = None) -> Found | None:
        """The relations; None if the precision does not tell, or they do not hold in other rows."""
        first = self.table.shape[1] - len(order)
        left = [*range(first), *(first + column for column in order)]
        pivots, rest, largest, faint, size = list[int](), self.table[:, left], 0.0, 0, 0.0
        while True:
            new, solved = self._shown(rest, pivots, left)
            if solved is None:
                return None
            shown = float(np.abs(doubles(rest)).max(initial=0.0))
            largest = largest or shown
            if shown < _FAINT * largest:
                faint, size = faint + len(new), max(size, shown / largest)
            pivots += new
            left = [column for column in left if column not in new]
            solution, rest = solved
            zero = [vanishes(x, self.bits) for x in rest.flat]
            if all(zero):
                if others is not None and not self._vanish(left_of(others, pivots, left, solution)):
                    return None
                own = [pivot - first for pivot in pivots[first:]]
                return Found(own, [column - first for column in left], solution[first:], faint, size)
            if not new or False not in zero:
                return None

    def _shown(self, rest: Balls, pivots: list[int], left: list[int]) -> tuple[list[int], tuple[Balls, Balls] | None]:
        """Columns that are independent beside others, and the rest as combinations of both; None if none is firm."""
        for firm in _FIRM:
            new = [left[k] for k in independent_columns(_scaled(rest), firm)]
            others = [column for column in left if column not in new]
            if (solved := combinations_of(self.table, [*pivots, *new], others, _CHECKED)) is not None:
                return new, solved
        return [], None

    def _vanish(self, table: Balls) -> bool:
        return all(vanishes(x, self.bits) for x in table.flat)


def _scaled(balls: Balls) -> Floats:
    """Columns in doubles of size one, but for those that vanish."""
    table = doubles(balls)
    sizes = np.abs(table).max(axis=0, initial=0.0)
    scaled: Floats = table / np.maximum(sizes, max(_SMALLEST * sizes.max(initial=0.0), np.finfo(float).tiny))
    return scaled


def _relations(found: Found, at: Mapping[str, str], singular: bool) -> BallRelations:
    values, radius = rounded(found.solution.ravel().tolist())
    table = np.array(values, dtype=object).reshape(found.solution.shape)
    columns = {
        column: {pivot: RationalFunction(x) for pivot, x in zip(found.pivots, table[:, k], strict=True) if x}
        for k, column in enumerate(found.others)
    }
    meaning = StatedNumbers(tuple(sorted(found.others)), at, radius)
    return BallRelations(tuple(found.pivots), columns, meaning, found.faint, found.size, singular)
