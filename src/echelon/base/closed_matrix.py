"""B in closed form while the budget lasts, and in numbers where it does not."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from echelon.base.closed_form import Combination, closed_columns
from echelon.base.dependent import relations
from echelon.base.matrix import BaseMatrix, StatedNumbers
from echelon.base.order import reordered
from echelon.base.stated_columns import StatedColumns
from echelon.base.structure import Structure
from echelon.exact.rational import RationalFunction
from echelon.exact.work import Work
from echelon.mechanism.mechanism import Mechanism


def base_matrix(
    mechanism: Mechanism,
    structure: Structure,
    order: tuple[int, ...],
    rng: np.random.Generator,
    budget: float,
    report: Callable[[str], None],
) -> BaseMatrix:
    """B for a column order."""
    work = Work.of(budget)
    found = relations(mechanism, structure)
    zero = [column for column, support in structure.by_robot.items() if not support]
    classical = tuple(range(structure.parameters))
    closed = closed_columns(found, zero, rng, work, report)
    open_columns = [c for relation in found for c in relation.targets if c not in closed]
    if not open_columns:
        matrix = _assembled(mechanism, structure.pivots, closed, classical)
        other = matrix if order == classical else reordered(matrix, order, rng, work)
        if other is not None:
            return other
    report("numbers in place of closed forms")
    stated = StatedColumns(mechanism, found, zero, order, rng)
    if order != classical:  # an exchange of representatives mixes the columns
        pivots = set(stated.pivots)
        closed, open_columns = {}, [c for c in classical if c not in pivots]
    numbers, meaning = stated.numbers(open_columns)
    return _assembled(mechanism, stated.pivots, closed | numbers, order, meaning)


def _assembled(
    mechanism: Mechanism,
    pivots: tuple[int, ...],
    columns: dict[int, Combination],
    order: tuple[int, ...],
    numbers: StatedNumbers | None = None,
) -> BaseMatrix:
    rows: dict[int, dict[int, RationalFunction]] = {p: {p: RationalFunction(1)} for p in pivots}
    for column, combination in columns.items():
        for pivot, coefficient in combination.items():
            rows[pivot][column] = coefficient
    ordered = tuple(dict(sorted(rows[p].items())) for p in pivots)
    return BaseMatrix(mechanism.parameters, pivots, ordered, order, numbers)
