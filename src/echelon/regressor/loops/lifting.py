"""From a closed pose to closed curves: Newton's iteration over power series modulo p."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from echelon.errors import SingularPoseError
from echelon.exact import series
from echelon.exact.elimination import reduced_echelon
from echelon.exact.field import PrimeField, Residues

OfSeries = Callable[[Residues], Residues]
"""From local coordinates (samples, coordinates, order) to the equations (samples, equations, order), or to their
derivatives by local coordinates (samples, equations, coordinates, order)."""


@dataclass(frozen=True)
class Choice:
    """A square non-singular part of a Jacobian.

    Attributes
    ----------
    rows : tuple of int
        Equations that the others follow from, to first order.
    dependent, independent : tuple of int
        Columns: those that the equations are solved for, and the others.
    """

    rows: tuple[int, ...]
    dependent: tuple[int, ...]
    independent: tuple[int, ...]


def choose(jacobian: Residues, field: PrimeField, preferred: Sequence[int] = ()) -> Choice:
    """Choose equations, and the columns to solve them for.

    Parameters
    ----------
    jacobian : array of shape (equations, columns)
        At one pose.
    field : PrimeField
    preferred : sequence of int
        Columns that should be independent, the most wanted first.
    """
    columns = jacobian.shape[1]
    # pivots are the leftmost columns possible, so what should be independent comes last
    wanted = list(dict.fromkeys(preferred))
    order = [c for c in range(columns) if c not in wanted][::-1] + wanted[::-1]
    _, pivots = reduced_echelon(jacobian[:, order], field)
    dependent = tuple(sorted(order[k] for k in pivots))
    _, rows = reduced_echelon(jacobian[:, dependent].T, field)
    independent = tuple(c for c in range(columns) if c not in dependent)
    return Choice(tuple(rows), dependent, independent)


def lift(equations: OfSeries, slopes: OfSeries, choice: Choice, free: Residues, field: PrimeField) -> Residues:
    """Continue random series of the independent coordinates to closed series of all.

    Parameters
    ----------
    equations, slopes : callable
        The equations and their derivatives.
    choice : Choice
        At the pose where the curves begin.
    free : array of shape (samples, independent, order)
        Local coordinates; zero at t = 0.
    field : PrimeField

    Returns
    -------
    array of shape (samples, coordinates, order)

    Raises
    ------
    DegenerateSampleError
        If the Jacobian of a sample is singular where that of the choice is not.
    SingularPoseError
        If an equation that was left out does not hold along the curves: the pose is singular, or it is isolated.
    """
    samples, _, order = free.shape
    dependent, independent = list(choice.dependent), list(choice.independent)
    square = np.ix_(range(samples), choice.rows, dependent)
    local = np.zeros((samples, len(dependent) + len(independent), order), dtype=np.int64)
    known, inverse = 1, None
    while known < order:
        target = min(2 * known, order)
        local[:, independent, :target] = free[..., :target]
        values = equations(local[..., :target])
        if values[..., :known].any():
            raise SingularPoseError("the loops do not stay closed")
        # half the coefficients of the derivatives do, for what is added begins with the power t^known
        inverse = series.matrix_inverse(slopes(local[..., :known])[square], field, inverse)
        residual = values[:, list(choice.rows), known:target]
        change = series.matrix_product(inverse[..., : target - known], residual[:, :, None], field)[:, :, 0]
        local[:, dependent, known:target] = -change % field.p
        known = target
    return local


def tangent(jacobian: Residues, choice: Choice, free: Residues, field: PrimeField) -> Residues:
    """All velocities that keep the loops closed, from those of the independent columns.

    Parameters
    ----------
    jacobian : array of shape (samples, equations, columns, order)
    choice : Choice
    free : array of shape (samples, independent, order)
    field : PrimeField
    """
    dependent, independent = list(choice.dependent), list(choice.independent)
    samples, order = free.shape[0], free.shape[-1]
    result = np.zeros((samples, jacobian.shape[2], order), dtype=np.int64)
    result[:, independent] = free
    if dependent:
        rows = range(samples)
        driven = series.matrix_product(jacobian[np.ix_(rows, choice.rows, independent)], free[:, :, None], field)
        inverse = series.matrix_inverse(jacobian[np.ix_(rows, choice.rows, dependent)], field)
        result[:, dependent] = -series.matrix_product(inverse, driven, field)[:, :, 0] % field.p
    return result
