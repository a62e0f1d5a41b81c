"""B in numbers: what balls hold at real states and stated values of the symbols, for any order of columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import flint
import numpy as np

from echelon.algebra import Number, RationalFunction
from echelon.base.ball_tables import exact_number, in_decimals, supported, vanishes
from echelon.base.elimination import Independent
from echelon.base.matrix import BaseMatrix, StatedNumbers
from echelon.shared import InputError

LARGEST_ERROR = 0.5
"""Error that rounding leaves of coefficients, beside columns of size one, at which they say nothing."""


def in_numbers(
    parameters: tuple[str, ...],
    independent: Independent,
    order: Sequence[int],
    at: Mapping[str, str],
    irrational: tuple[bool, bool],
    *,
    named: bool,
    known: Mapping[int, Mapping[int, RationalFunction]] | None = None,
) -> BaseMatrix:
    """B from independent columns at stated values of the symbols: short exact numbers, or bounded decimals.

    Parameters
    ----------
    parameters : tuple of str
        Names of the columns.
    independent : Independent
        Of all columns, at the values.
    order : sequence of int
        Columns from most to least preferred as representative.
    at : mapping of str to str
        The values.
    irrational : (bool, bool)
        Whether √2 and √3 may occur.
    named : bool
        Whether symbols have names, so that all columns are columns of stated numbers.
    known : mapping of int to mapping of int to RationalFunction, optional
        Columns with closed forms, as combinations of representatives.

    Returns
    -------
    BaseMatrix

    Raises
    ------
    InputError
        If rounding of the file leaves the coefficients open.
    """
    if independent.error:
        if independent.error > LARGEST_ERROR:
            raise InputError(
                f"the intended set has {len(independent.pivots)} base parameters, but the file's last decimals "
                "leave their coefficients open: state the geometry with more digits, or ask for the rank only"
            )
        found = independent.without_faint(len(independent.pivots), order)
        order = found.order_of(order)
    else:
        found = independent.in_order(order)
    known = known or {}
    rows = {pivot: {pivot: RationalFunction(1)} for pivot in found.pivots}
    if not {pivot for row in known.values() for pivot in row} <= rows.keys():
        known = {}  # closed forms in terms of other representatives
    stated, radius = (
        set[int](),
        0.0,
    )  # columns whose coefficients are decimals, or belong to values of symbols
    for column, combination in known.items():
        for pivot, coefficient in combination.items():
            rows[pivot][column] = coefficient
    with flint.ctx.workprec(found.bits):
        for column, coefficients in zip(
            found.others, np.transpose(found.solution), strict=True
        ):
            for pivot, ball in zip(found.pivots, coefficients, strict=True):
                if column in known or vanishes(ball, found.bits):
                    continue
                exact = exact_number(ball, irrational)
                number: Number
                if independent.error:
                    error = float(ball.rad())
                    number = supported(float(ball.mid()), error)
                elif exact is not None:
                    number, error = exact, 0.0
                else:
                    number, error = in_decimals(ball)
                radius = max(radius, error)
                if named or exact is None or independent.error:
                    stated.add(column)
                rows[pivot][column] = RationalFunction(number)
    numbers = (
        StatedNumbers(tuple(sorted(stated)), at, radius, bool(independent.error))
        if stated
        else None
    )
    ordered = tuple(dict(sorted(rows[pivot].items())) for pivot in found.pivots)
    return BaseMatrix(parameters, found.pivots, ordered, tuple(order), numbers)
