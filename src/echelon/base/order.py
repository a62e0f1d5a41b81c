"""Other representatives: B for another column order.

B is unique for a given order, so another choice of representatives is an exact change of basis: exchange pivots, one at
a time, as in the simplex method.  Which columns become pivots is decided modulo a prime; the exchange itself is exact
and brings denominators where it must.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from typing import get_args

import numpy as np

from echelon.base.matrix import BaseMatrix
from echelon.choices import Order
from echelon.conventions import PARAMETERS
from echelon.errors import EchelonError, InputError
from echelon.exact.elimination import reduced_echelon
from echelon.exact.field import PrimeField
from echelon.exact.rational import RationalFunction, cost_of_products
from echelon.exact.unknown import Work
from echelon.mechanism.output import Parameter

ORDERS = get_args(Order)
_EXCHANGE = 5.0
"""What a product takes in an exchange beside one in a sum, because every sum is reduced on its own."""


def column_order(columns: Sequence[Parameter], order: str, prefer: Sequence[str] = ()) -> tuple[int, ...]:
    """Columns from most to least preferred as representative."""
    if order not in ORDERS:
        raise InputError(f"unknown order '{order}' (valid: {', '.join(ORDERS)})")
    numbers = list(range(len(columns)))
    if order == "tip-to-base":  # parameters of effects, which belong to no body, stay last
        numbers.sort(key=lambda c: inf if (body := columns[c].body) is None else -body)
    position = {parameter.name: i for i, parameter in enumerate(columns)}
    first: list[int] = []
    for name in (prefer,) if isinstance(prefer, str) else prefer:
        if name in position:
            first.append(position[name])
        elif name in PARAMETERS:
            first += [c for c in numbers if columns[c].kind == PARAMETERS.index(name)]
        else:
            raise InputError(f"'{name}' is neither a standard parameter of this model nor one of {PARAMETERS}")
    first = list(dict.fromkeys(first))
    return (*first, *(c for c in numbers if c not in set(first)))


def reordered(matrix: BaseMatrix, order: tuple[int, ...], rng: np.random.Generator, work: Work) -> BaseMatrix | None:
    """The reduced echelon form for another column order."""
    wanted = _pivots(matrix, order, rng)
    rows = dict(zip(matrix.pivots, (dict(row) for row in matrix.rows), strict=True))
    entering = [c for c in wanted if c not in rows]
    leaving = {c for c in rows if c not in set(wanted)}
    while entering:
        column, pivot = _exchange(rows, entering, leaving)
        entering.remove(column)
        leaving.remove(pivot)
        if not _pivot(rows, column, pivot, work):
            return None
    return BaseMatrix(matrix.parameters, wanted, tuple(rows[c] for c in wanted), order)


def _pivots(matrix: BaseMatrix, order: tuple[int, ...], rng: np.random.Generator) -> tuple[int, ...]:
    field = PrimeField.random(rng)
    symbols = {name: field.draw(rng, (1,)) for name in matrix.symbols}
    dense = np.zeros(matrix.shape, dtype=np.int64)
    for i, row in enumerate(matrix.modulo(symbols, field)):
        for column, value in row.items():
            dense[i, column] = value
    _, pivots = reduced_echelon(dense[:, list(order)], field)
    return tuple(order[k] for k in pivots)


def _exchange(rows: dict[int, dict[int, RationalFunction]], entering: list[int], leaving: set[int]) -> tuple[int, int]:
    """The cheapest next exchange: the simplest non-zero entry of a leaving row in an entering column."""
    choices = [
        (_complexity(rows[pivot][column]), column, pivot)
        for pivot in leaving
        for column in entering
        if column in rows[pivot]
    ]
    if not choices:
        raise EchelonError("the chosen representatives are dependent; please report this model")
    _, column, pivot = min(choices)
    return column, pivot


def _complexity(coefficient: RationalFunction) -> int:
    constant = coefficient.is_polynomial and coefficient.numerator.number is not None
    return 0 if constant else len(coefficient.numerator.terms) + 10 * len(coefficient.denominator.terms)


def _pivot(rows: dict[int, dict[int, RationalFunction]], column: int, pivot: int, work: Work) -> bool:
    """Exchange a representative; whether the budget allows it."""
    row = rows.pop(pivot)
    lead = row[column]
    across = [other[column] for other in rows.values() if column in other]
    if not work.take(_EXCHANGE * sum(cost_of_products([(a, b)]) for b in row.values() for a in (lead, *across))):
        return False
    scaled = {c: value / lead for c, value in row.items()}
    for other in rows.values():
        factor = other.pop(column, None)
        if factor is None:
            continue
        for c, value in scaled.items():
            if c != column:
                total = other[c] - factor * value if c in other else -(factor * value)
                other[c] = total
                if not total:
                    del other[c]
    rows[column] = scaled
    return True
