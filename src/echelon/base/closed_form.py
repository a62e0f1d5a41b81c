"""B in closed form, column by column, while the budget lasts, and in numbers where it does not.

The coefficients of every kernel are interpolated, the cheapest first, and brought to all places in the robot where the
kernel occurs.  Then, going from the base to the tips, the dependent columns among the sources are substituted.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from echelon.base.dependent import Kernel, Relation, relations
from echelon.base.matrix import BaseMatrix, StatedNumbers, reordered
from echelon.base.stated_columns import StatedColumns
from echelon.base.structure import Structure
from echelon.conventions import PER_BODY
from echelon.errors import ClosedFormError
from echelon.exact.interpolation import interpolate
from echelon.exact.rational import ONE, RationalFunction, cost_of_products, sum_of_products
from echelon.exact.unknown import Work
from echelon.mechanism.mechanism import Mechanism

Combination = dict[int, RationalFunction]
"""A column as a combination of other columns: coefficient by column."""

_SHARE = 0.5
"""What one kernel may take of the work that is left."""


def closed_columns(
    found: Sequence[Relation],
    zero: Sequence[int],
    rng: np.random.Generator,
    work: Work,
    report: Callable[[str], None],
    share: float = _SHARE,
) -> dict[int, Combination]:
    """The dependent columns with closed forms as combinations of pivot columns; each kernel may take a share."""
    raw: dict[int, Combination] = {column: {} for column in zero}
    kernels: dict[Kernel, list[Relation]] = {}
    for relation in found:
        kernels.setdefault(relation.kernel, []).append(relation)
    total = sum(len(relation.targets) for relation in found)
    for kernel in sorted(kernels, key=lambda k: k.cost * (1 + len(k.sampler.symbols))):
        report(f"closed forms: {len(raw) - len(zero)} of {total} columns")
        combinations = _interpolated(kernel, rng, work, share)
        for relation in kernels[kernel]:
            raw |= _placed(relation, combinations, work)
    dependent = {column for relation in found for column in relation.targets} | set(zero)
    solved: dict[int, Combination] = {}
    for column in sorted(raw):
        if all(c in solved for c in raw[column] if c in dependent):
            result = _substituted(raw[column], solved, work)
            if result is not None:
                solved[column] = result
    return solved


def _interpolated(kernel: Kernel, rng: np.random.Generator, work: Work, most: float) -> dict[int, Combination]:
    """The targets whose coefficients all have closed forms within a share of the work."""
    share = work.share(most)
    try:
        functions = interpolate(kernel.unknown(rng), rng, share)
    except ClosedFormError:
        return {}
    finally:
        work.give_back(share)
    columns: dict[int, Combination | None] = {target: {} for target in kernel.targets}
    for (source, target), function in zip(kernel.pairs, functions, strict=True):
        column = columns[target]
        if function is None:
            columns[target] = None
        elif column is not None and function:
            column[source] = function
    return {target: column for target, column in columns.items() if column is not None}


def _placed(relation: Relation, combinations: Mapping[int, Combination], work: Work) -> dict[int, Combination]:
    """The targets as combinations of columns of X, without those that take too much work."""
    kinds = {k for combination in combinations.values() for k in combination if k < PER_BODY}
    changes = relation.changes(kinds, RationalFunction)
    placed: dict[int, Combination] = {}
    for target, combination in combinations.items():
        changed = _substituted(combination, changes, work)
        if changed is not None:
            placed[relation.columns[target]] = {relation.columns[k]: c for k, c in changed.items()}
    return placed


def _substituted(combination: Combination, solved: Mapping[int, Combination], work: Work) -> Combination | None:
    """A combination of columns as one of others, or None if it takes too much work."""
    products: dict[int, list[tuple[RationalFunction, RationalFunction]]] = {}
    for column, coefficient in combination.items():
        if column not in solved:
            products.setdefault(column, []).append((ONE, coefficient))
            continue
        first = ONE if coefficient.is_one else coefficient  # so that what moves unchanged remains one object
        for pivot, inner in solved[column].items():
            products.setdefault(pivot, []).append((first, inner))
    true = [terms for terms in products.values() if len(terms) > 1 or terms[0][0] is not ONE]
    if not work.take(sum(map(cost_of_products, true))):
        return None
    total = {pivot: sum_of_products(terms) for pivot, terms in sorted(products.items())}
    if any(len(c.numerator.terms) > work.terms for c in total.values()):
        return None
    return {pivot: c for pivot, c in total.items() if c.numerator.terms}


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
        matrix = assembled(mechanism.parameters, structure.pivots, closed, classical)
        other = matrix if order == classical else reordered(matrix, order, rng, work)
        if other is not None:
            return other
    report("numbers in place of closed forms")
    stated = StatedColumns(mechanism, found, zero, order, rng)
    if order != classical:  # an exchange of representatives mixes the columns
        pivots = set(stated.pivots)
        closed, open_columns = {}, [c for c in classical if c not in pivots]
    numbers, meaning = stated.numbers(open_columns)
    return assembled(mechanism.parameters, stated.pivots, closed | numbers, order, meaning)


def assembled(
    parameters: tuple[str, ...],
    pivots: tuple[int, ...],
    columns: dict[int, Combination],
    order: tuple[int, ...],
    numbers: StatedNumbers | None = None,
) -> BaseMatrix:
    """B from its dependent columns as combinations of pivots."""
    rows: dict[int, dict[int, RationalFunction]] = {p: {p: RationalFunction(1)} for p in pivots}
    for column, combination in columns.items():
        for pivot, coefficient in combination.items():
            rows[pivot][column] = coefficient
    ordered = tuple(dict(sorted(rows[p].items())) for p in pivots)
    return BaseMatrix(parameters, pivots, ordered, order, numbers)
