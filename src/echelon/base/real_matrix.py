"""B of mechanisms with loops in numbers: what balls hold at real closed states, for any order of columns."""

from __future__ import annotations

from collections.abc import Sequence

import flint
import numpy as np

from echelon.base.ball_tables import exact_number, in_decimals, supported, vanishes
from echelon.base.elimination import Independent
from echelon.base.matrix import BaseMatrix, StatedNumbers
from echelon.errors import InputError
from echelon.exact.polynomial import Number
from echelon.exact.rational import RationalFunction
from echelon.mechanism.mechanism import Mechanism
from echelon.mechanism.stated import all_symbols, named_symbols, symbol_roles, value_texts

_MOST_OPEN = 0.5
"""What rounding may leave open of coefficients, beside columns of size one, before they say nothing."""


def in_numbers(mechanism: Mechanism, independent: Independent, order: Sequence[int]) -> BaseMatrix:
    """B from independent columns at the stated values of the symbols: short exact numbers, or bounded decimals."""
    named, irrational = bool(named_symbols(mechanism)), symbol_roles(mechanism).irrational
    if independent.error:
        if independent.error > _MOST_OPEN:
            raise InputError(
                f"{len(independent.pivots)} base parameters are meant, but the file's last decimals leave their "
                "coefficients open: state the geometry with more digits, or ask for the rank only"
            )
        found = independent.without_faint(len(independent.pivots), order)
        order = found.order_of(order)
    else:
        found = independent.in_order(order)
    rows = {pivot: {pivot: RationalFunction(1)} for pivot in found.pivots}
    stated, radius = set[int](), 0.0  # columns whose coefficients are decimals, or belong to values of symbols
    with flint.ctx.workprec(found.bits):
        for column, coefficients in zip(found.others, np.transpose(found.solution), strict=True):
            for pivot, ball in zip(found.pivots, coefficients, strict=True):
                if vanishes(ball, found.bits):
                    continue
                exact = exact_number(ball, irrational)
                number: Number
                if independent.error:
                    number, error = supported(float(ball.mid()), independent.error), independent.error
                elif exact is not None:
                    number, error = exact, 0.0
                else:
                    number, error = in_decimals(ball)
                radius = max(radius, error)
                if named or exact is None or independent.error:
                    stated.add(column)
                rows[pivot][column] = RationalFunction(number)
    at = value_texts(mechanism, all_symbols(mechanism))
    numbers = StatedNumbers(tuple(sorted(stated)), at, radius, bool(independent.error)) if stated else None
    ordered = tuple(dict(sorted(rows[pivot].items())) for pivot in found.pivots)
    return BaseMatrix(mechanism.parameters, found.pivots, ordered, tuple(order), numbers)
