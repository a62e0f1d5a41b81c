"""Linear algebra over the rationals that proofs need; numbers are FLINT's rationals, or balls where it says so."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import flint
import numpy as np
import numpy.typing as npt

from echelon.conventions import PER_BODY
from echelon.identification.physics.pseudo_inertia import dual_matrix, is_zero


def exact_dual(entries: list[Any]) -> list[list[Any]]:
    """The dual matrix of ten exact coefficients; zeros stay exact."""
    c = [flint.fmpq(0) + entry if isinstance(entry, int) else entry for entry in entries]
    array = np.empty(PER_BODY, dtype=object)
    array[:] = c
    return [list(row) for row in dual_matrix(array)]


def times(entry: Any, factor: Fraction) -> Any:
    """An exact number times a fraction."""
    return entry * flint.fmpq(factor.numerator, factor.denominator)


def null_space(equations: list[list[Any]], size: int) -> npt.NDArray[Any]:
    """Rational solutions of homogeneous equations, exactly.

    Where an equation has balls for coefficients, no solution is known exactly but those whose entries there are zero;
    only these are given.

    Parameters
    ----------
    equations : list of rows of ``size`` numbers
    size : int

    Returns
    -------
    array of shape (size, k)
        Basis of the solutions, as columns of FLINT rationals.
    """
    rows = []
    for row in equations:
        if any(isinstance(entry, flint.arb) for entry in row):
            rows += [_unit(k, size) for k, entry in enumerate(row) if not is_zero(entry)]
        else:
            rows.append([flint.fmpq(0) + entry for entry in row])
    if not rows:
        rows = [[flint.fmpq(0)] * size]
    reduced, rank = flint.fmpq_mat(rows).rref()
    pivots = [next(j for j in range(size) if reduced[i, j] != 0) for i in range(rank)]
    free = [j for j in range(size) if j not in pivots]
    basis = np.full((size, len(free)), flint.fmpq(0), dtype=object)
    for column, j in enumerate(free):
        basis[j, column] = flint.fmpq(1)
        for i, pivot in enumerate(pivots):
            basis[pivot, column] = -reduced[i, j]
    return basis


def _unit(place: int, size: int) -> list[Any]:
    return [flint.fmpq(int(k == place)) for k in range(size)]


def as_fraction(value: Any) -> Fraction:
    """A FLINT rational as Python's."""
    return Fraction(int(value.p), int(value.q))
