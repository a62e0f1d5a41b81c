"""Elimination in ball arithmetic: which columns of a table are independent, and what the others are beside them.

A QR factorisation in doubles tells which columns show most.  What the others are beside these is then known in balls:
it is zero to all digits, or it is small and shows columns that doubles do not, of which the factorisation tells which
show most, and so on.  So independent columns are found however little they show, and how much each shows is known: the
spectrum, in which rounding of a file stands apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from typing import Any

import flint
import numpy as np

from echelon.base.ball_tables import (
    Balls,
    doubles,
    left_of,
    solved,
    solved_for,
    vanishes,
)
from echelon.shared import Floats, Integers, independent_columns, pivoted_qr

_FIRM = (1e-6, 1e-4, 1e-2)
"""Share of the largest pivot above which doubles show a column to be independent; more where balls deny it."""
SMALLEST_SHARE = 1e-3
"""Share of the largest column, in comparable units, below which a column is not made as large."""
FAINT_SHARE = 1e-2
"""Residual of a column, relative to its size, up to which a file's rounding may have made it."""
SHOWN_BY_DOUBLES = 1e-9
"""Residual of a column, relative to its size, that double precision surely shows."""


@dataclass(frozen=True)
class ColumnRelations:
    """Columns of a table, each divided by its size, as combinations of others."""

    table: Balls
    sizes: Balls
    auxiliary: int
    pivots: Sequence[int]
    others: Sequence[int]
    solution: Balls

    def hold(self, rows: Balls, bits: int) -> bool:
        """Whether nothing is left of the columns in some rows."""
        with flint.ctx.workprec(bits):
            left = left_of(rows / self.sizes, self.pivots, self.others, self.solution)
            return all(vanishes(x, bits) for x in left.flat)


@dataclass(frozen=True)
class Independent:
    """Independent columns of a table, and the others as combinations of them.

    Attributes
    ----------
    pivots : tuple of int
        Independent columns, those that show most first.
    shown : tuple of float
        For each, what is left of it beside those before, as a share of the first one; columns count as of size one.
    others : tuple of int
        The other columns.
    solution : array of arb, shape (pivots, others)
    bits : int
        Precision of the balls.
    relations : ColumnRelations
        The same with auxiliary columns and scales.
    error : float
        What rounding of a file leaves open of coefficients, beside columns of size one; 0 where these are exact.
    """

    pivots: tuple[int, ...]
    shown: tuple[float, ...]
    others: tuple[int, ...]
    solution: Balls
    bits: int
    relations: ColumnRelations
    error: float = 0.0

    def without_faint(self, count: int, order: Sequence[int]) -> Independent:
        """Result without the columns of least residual, whose rounded relations to the others count as exact.

        Coefficients are those of least squares, with what rounding leaves open of each.  Pivots come first in the order
        where that keeps them firm.
        """
        relations = self.relations
        auxiliary, rows = relations.auxiliary, doubles(relations.table)
        chosen = self.pivots[:count]
        spanned, _ = _least_squares(rows, auxiliary, chosen)
        ranked = [
            order[k] for k in independent_columns(spanned[:, list(order)], FAINT_SHARE)
        ]
        pivots = (
            tuple(ranked)
            if len(ranked) == count
            else tuple(column for column in order if column in set(chosen))
        )
        solution, error = _least_squares(rows, auxiliary, pivots)
        others = tuple(column for column in order if column not in set(pivots))
        sizes = np.array([float(x) for x in relations.sizes[auxiliary:]])
        found = solution[:, list(others)]
        place = {column: k for k, column in enumerate(order)}
        before = np.array(
            [[place[c] < place[p] for c in others] for p in pivots]
        ).reshape(found.shape)
        found[(np.abs(found) <= error) | (before & (np.abs(found) <= FAINT_SHARE))] = (
            0.0
        )
        scales = sizes[list(others)] / sizes[list(pivots)][:, None]
        left_open = np.where(found, error, 0.0) * scales
        balls = (
            np.frompyfunc(flint.arb, 2, 1)(found * scales, left_open)
            .astype(object)
            .reshape(found.shape)
        )
        return Independent(
            pivots, self.shown[:count], others, balls, self.bits, relations, error
        )

    def order_of(self, order: Sequence[int]) -> tuple[int, ...]:
        """An order in which the basis is in echelon form: the given one, or else that with the pivots first."""
        place = {column: k for k, column in enumerate(order)}
        early = any(
            place[column] < place[pivot] and not value.contains(0)
            for pivot, row in zip(self.pivots, self.solution, strict=True)
            for column, value in zip(self.others, row, strict=True)
        )
        return (*self.pivots, *self.others) if early else tuple(order)

    def holds(self, rows: Balls) -> bool:
        """Whether the combinations hold in further rows, auxiliary columns included."""
        return self.relations.hold(rows, self.bits)

    @property
    def basis(self) -> Balls:
        """Rows that span all rows of the table, (pivots, columns): the identity in the columns of the pivots."""
        count = len(self.pivots)
        rows = np.full((count, count + len(self.others)), flint.arb(0), dtype=object)
        rows[range(count), list(self.pivots)] = flint.arb(1)
        rows[:, list(self.others)] = self.solution
        return rows

    def in_order(self, order: Sequence[int]) -> Independent:
        """Result whose pivots are the first independent columns in an order, so that the basis is in echelon form."""
        place = {column: k for k, column in enumerate(order)}
        count = len(self.pivots)
        with flint.ctx.workprec(self.bits):
            basis = self.basis
            chosen = sorted(self.pivots, key=place.__getitem__)
            firm = [
                order[k]
                for k in independent_columns(
                    _of_size_one(basis[:, list(order)])[0], SHOWN_BY_DOUBLES
                )
            ]
            if (
                len(firm) == count
                and (exchanged := solved_for(basis, firm)) is not None
            ):
                basis, chosen = exchanged, firm
            while (swap := _too_late(basis, chosen, order, self.bits)) is not None:
                row, column = swap
                chosen[row] = column
                chosen.sort(key=place.__getitem__)
                found = solved_for(self.basis, chosen)
                assert (
                    found is not None
                )  # an exchange for a column with a coefficient keeps them independent
                basis = found
        others = tuple(column for column in order if column not in set(chosen))
        return Independent(
            tuple(chosen), (), others, basis[:, list(others)], self.bits, self.relations
        )


def _least_squares(
    rows: Floats, auxiliary: int, pivots: Sequence[int]
) -> tuple[Floats, float]:
    """All columns behind the auxiliary ones as combinations of some, (pivots, columns), and how much they are open."""
    left = rows[:, [*range(auxiliary), *(auxiliary + column for column in pivots)]]
    inverse = np.linalg.pinv(left)
    solution = inverse @ rows[:, auxiliary:]
    missed = np.abs(rows[:, auxiliary:] - left @ solution).max(initial=0.0)
    error = float(missed * np.abs(inverse[auxiliary:]).sum(axis=1).max(initial=0.0))
    return solution[auxiliary:], error


def _too_late(
    basis: Balls, chosen: Sequence[int], order: Sequence[int], bits: int
) -> tuple[int, int] | None:
    """The first column that depends on a pivot behind it in the order, and the row of the last such pivot."""
    rows = {column: row for row, column in enumerate(chosen)}
    passed = 0
    for column in order:
        if column in rows:
            passed = rows[column] + 1
            continue
        for row in reversed(range(passed, len(chosen))):
            if vanishes(basis[row, column], bits) is False:
                return row, column
    return None


def sizes_shown(
    table: Balls, bits: int, auxiliary: int, units: Sequence[float] | None
) -> list[float]:
    """Residual norms of the independent columns, relative to the largest, descending."""
    shown = list[float]()
    eliminated(table, bits, auxiliary, units, shown)
    ranked = sorted(shown, reverse=True)
    return [size / ranked[0] for size in ranked] if ranked and ranked[0] else ranked


def eliminated(
    table: Balls,
    bits: int,
    auxiliary: int = 0,
    units: Sequence[float] | None = None,
    shown: list[float] | None = None,
) -> Independent | None:
    """Independent columns of a table of balls; auxiliary columns, which come first, are taken to be independent.

    None if the precision does not tell.  The auxiliary columns are left out of the result.  With units in which the
    columns are comparable, those that hold little beside others are not taken for as large: rounding may have made it.
    What every pivot shows is added to ``shown``.
    """
    table, sizes = _scaled(table, units)
    pivots, rows = list[int](), list[int]()
    shown = [] if shown is None else shown
    left = list(range(table.shape[1]))
    first = list(range(auxiliary))
    state = (
        _with_more(table, table, pivots, rows, first) if first else (table[:0], table)
    )
    if first:
        pivots, left = first, left[auxiliary:]
    while state is not None:
        solution, rest = state
        verdicts = {vanishes(x, bits) for x in rest.flat}
        if verdicts <= {True}:
            return _independent(
                table, pivots, shown, left, solution, sizes, auxiliary, bits
            )
        if False not in verdicts:
            return None
        lengths, ranked, size = _most_independent(rest)
        state = None
        for firm in _FIRM:
            count = int((lengths > firm * lengths[0]).sum())
            new = [left[k] for k in ranked[:count]]
            state = _with_more(table, rest, pivots, rows, new)
            if state is not None:
                values = np.linalg.svd(_as_doubles(rest), compute_uv=False)
                shown += [float(value * size) for value in values[:count]]
                pivots = [*pivots, *new]
                left = [column for column in left if column not in set(new)]
                break
    return None


def _with_more(
    table: Balls, rest: Balls, pivots: list[int], rows: list[int], new: list[int]
) -> tuple[Balls, Balls] | None:
    """The other columns as combinations of old and new pivots, and what is left of them in the rows that are unused.

    Rows in which the new pivots are most independent are used beside the old ones, and added to them.  None if the
    precision does not show that.
    """
    left = [column for column in range(table.shape[1]) if column not in set(pivots)]
    unused = [row for row in range(len(table)) if row not in set(rows)]
    places = [left.index(column) for column in new]
    chosen = [
        unused[k] for k in pivoted_qr(_as_doubles(rest[:, places]).T)[1][: len(new)]
    ]
    used, solved_by = [*rows, *chosen], [*pivots, *new]
    others = [column for column in left if column not in set(new)]
    solution = solved(table, used, solved_by, others)
    if solution is None:
        return None
    rows[:] = used
    remaining = [row for row in unused if row not in set(chosen)]
    return solution, left_of(table[remaining], solved_by, others, solution)


def _independent(
    table: Balls,
    pivots: Sequence[int],
    shown: Sequence[float],
    left: Sequence[int],
    solution: Balls,
    sizes: Balls,
    auxiliary: int,
    bits: int,
) -> Independent:
    """The result in terms of the columns as they were given."""
    own = list(pivots[auxiliary:])
    unscaled = solution[auxiliary:] * sizes[list(left)] / sizes[own][:, None]
    largest = max(shown, default=1.0)
    return Independent(
        tuple(column - auxiliary for column in own),
        tuple(share / largest for share in shown),
        tuple(column - auxiliary for column in left),
        unscaled,
        bits,
        ColumnRelations(table, sizes, auxiliary, pivots, left, solution),
    )


def _most_independent(rest: Balls) -> tuple[Floats, Integers, float]:
    """Pivots and order of a QR factorisation in doubles, of a table divided by its largest entry, and that entry."""
    sizes, order = pivoted_qr(_as_doubles(rest))
    return sizes, order, float(_largest(rest))


def _as_doubles(table: Balls) -> Floats:
    """A table divided by its largest entry, in doubles."""
    return doubles(table / _largest(table))


def _largest(table: Balls) -> Any:
    """The largest entry of a table that does not vanish."""
    return max((abs(x).mid() for x in table.flat), default=flint.arb(1))


def _scaled(table: Balls, units: Sequence[float] | None = None) -> tuple[Balls, Balls]:
    """The table with columns of about size one, and their sizes, powers of two; 1 for columns that may vanish."""
    sizes = np.array([_power_of_two(column) for column in table.T], dtype=object)
    if units is not None:
        comparable = [
            (float(size) / unit, unit) for size, unit in zip(sizes, units, strict=True)
        ]
        largest = max((size for size, unit in comparable if unit != inf), default=0.0)
        least = [
            SMALLEST_SHARE * largest * unit if unit != inf else 0.0
            for _, unit in comparable
        ]
        sizes = np.array(
            [max(size, flint.arb(x)) for size, x in zip(sizes, least, strict=True)],
            dtype=object,
        )
    return table / sizes, sizes


def _power_of_two(column: Balls) -> Any:
    largest = max((x.abs_lower() for x in column), default=flint.arb(0))
    if not largest > 0:
        return flint.arb(1)
    mantissa, exponent = largest.man_exp()
    return flint.arb(2) ** (int(exponent) + int(mantissa).bit_length())


def _of_size_one(table: Balls) -> tuple[Floats, Balls]:
    scaled, sizes = _scaled(table)
    return doubles(scaled), sizes
