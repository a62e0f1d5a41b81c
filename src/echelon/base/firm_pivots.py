"""Representatives that work in doubles.

A column that is nearly zero, or nearly depends on earlier ones, is independent of them all the same.  As a
representative it gives other columns coefficients of the size of 1/(what is left of it), and X̄ B is then a difference
of numbers far larger than X.  Where B has such coefficients at the stated values, the largest one changes places: its
column becomes a representative instead of that of its row.  Each exchange multiplies the volume that the
representatives span by that coefficient, so that few of them end with moderate ones (Goreinov, Tyrtyshnikov and
Zamarashkin 1997, on submatrices of maximal volume).

Balls only tell which columns to take; for these B is derived again, exactly.
"""

from __future__ import annotations

from typing import Any

import flint
import numpy as np

from echelon.algebra import BALL_BITS, DEFAULT_SEED, ball, random_generator
from echelon.base.ball_rows import stated_generators
from echelon.base.matrix import BaseMatrix
from echelon.base.numeric_ranks import reconstruction_error
from echelon.dynamics import LinearForms
from echelon.robot import Mechanism, characteristic_length, known_values, value_texts
from echelon.shared import Floats, InputError

LARGEST_COEFFICIENT = 1e6
"""Coefficient of B from which other representatives are tried: it leaves ten of the 16 digits of X̄ B."""

MODERATE_COEFFICIENT = 1e3
"""Coefficient of B up to which an exchange of representatives ends: X̄ B loses three digits."""


Rows = dict[int, dict[int, Any]]
"""Balls by representative and column."""


def firm_order(mechanism: Mechanism, matrix: BaseMatrix) -> tuple[int, ...] | None:
    """An order of columns for representatives with moderate coefficients; None where those of B have them.

    Coefficients are compared with lengths as multiples of the robot's, so that the unit of length makes no difference.
    """
    at = value_texts(mechanism, matrix.symbols)
    if len(at) < len(matrix.symbols):
        return None
    if _scaled(matrix, mechanism) < LARGEST_COEFFICIENT:
        return None
    with flint.ctx.workprec(2 * BALL_BITS):
        rows = _balls(matrix, mechanism, at)
        while (largest := _largest(rows)) is not None:
            _exchange(rows, *largest)
    entering = set(rows) - set(matrix.pivots)
    if not entering:
        return None
    leaving = {
        p
        for p in matrix.pivots
        if mechanism.columns[p].kind is not None and p not in rows
    }
    firm = (set(matrix.pivots) - leaving) | entering
    return (
        *(c for c in matrix.order if c in firm),
        *(c for c in matrix.order if c not in firm),
    )


def exchange_note(
    mechanism: Mechanism, classical: BaseMatrix, matrix: BaseMatrix
) -> str:
    """Which representatives were taken instead of the first independent ones, and why."""
    names = matrix.parameters
    taken, left = (
        " ".join(names[p] for p in one.pivots if p not in other.pivots)
        for one, other in ((matrix, classical), (classical, matrix))
    )
    before, now = (_scaled(one, mechanism) for one in (classical, matrix))
    return (
        f"the representatives {taken} replace {left}, which have a weak effect: coefficients would reach "
        f"{before:.0e}, and now reach {now:.2g}"
    )


def doubt_of_coefficients(
    mechanism: Mechanism, matrix: BaseMatrix, forms: LinearForms
) -> str:
    """Why X̄ B is not X in doubles; empty where it is."""
    known = known_values(mechanism)
    if not set(matrix.symbols) <= known.keys():
        return ""
    largest = _scaled(matrix, mechanism)
    if largest < MODERATE_COEFFICIENT:
        return ""
    if largest >= LARGEST_COEFFICIENT:
        return f"coefficients of B reach {largest:.0e}, so X̄ B loses that factor of double precision"
    if forms.loops is not None:
        return ""
    error = reconstruction_error(
        mechanism,
        forms,
        matrix.pivots,
        matrix.floats(known),
        random_generator(DEFAULT_SEED),
    )
    if error < 1 / LARGEST_COEFFICIENT:
        return ""
    return f"in doubles X̄ B misses {error:.0e} of a column of X: its coefficients reach {largest:.0e}"


def _weights(mechanism: Mechanism) -> Floats:
    """The power of the robot's length in each inertial parameter; nan for parameters of effects.

    These have units and gear ratios of their own, which make coefficients large without harm.
    """
    length = characteristic_length(mechanism)
    return np.array(
        [
            np.nan if c.kind is None else length**c.length_degree
            for c in mechanism.columns
        ]
    )


def _scaled(matrix: BaseMatrix, mechanism: Mechanism) -> float:
    """The largest coefficient, with lengths as multiples of the robot's; infinite where B has no doubles."""
    weights = _weights(mechanism)
    try:
        values = np.abs(matrix.floats(known_values(mechanism)))
    except InputError:
        return np.inf
    return float(
        np.nanmax(values * weights / weights[list(matrix.pivots), None], initial=0.0)
    )


def _balls(matrix: BaseMatrix, mechanism: Mechanism, at: dict[str, str]) -> Rows:
    """The inertial part of B at the stated values, with lengths as multiples of the robot's."""
    values, weights = stated_generators(matrix.generators, at), _weights(mechanism)
    known = {id(c): c.evaluate(values, ball) for c in matrix.coefficients}
    rows: Rows = {}
    for pivot, row in zip(matrix.pivots, matrix.rows, strict=True):
        if np.isfinite(weights[pivot]):
            inertial = {c: known[id(v)] for c, v in row.items() if weights[c] < np.inf}
            own = weights[pivot]
            rows[pivot] = {c: v * float(weights[c] / own) for c, v in inertial.items()}
    return rows


def _largest(rows: Rows) -> tuple[int, int] | None:
    """Representative and column of the largest coefficient that is not moderate."""
    sizes = (
        (float(abs(v).mid()), pivot, column)
        for pivot, row in rows.items()
        for column, v in row.items()
    )
    size, pivot, column = max(sizes)
    if size > MODERATE_COEFFICIENT and np.isfinite(size):
        return pivot, column
    return None


def _exchange(rows: Rows, pivot: int, column: int) -> None:
    """A column becomes the representative of a row."""
    row = rows.pop(pivot)
    lead = row[column]
    scaled = {c: value / lead for c, value in row.items()}
    for other in rows.values():
        factor = other.pop(column, None)
        if factor is not None:
            for c, value in scaled.items():
                if c != column:
                    other[c] = other.get(c, flint.arb(0)) - factor * value
    rows[column] = scaled
