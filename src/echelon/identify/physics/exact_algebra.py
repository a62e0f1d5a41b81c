"""Linear algebra over the rationals that proofs need; numbers are FLINT's rationals, or balls where it says so."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import flint
import numpy as np
import numpy.typing as npt

from echelon.conventions import PER_BODY
from echelon.identify.physics.pseudo_inertia import dual_matrix, is_zero


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
    """Basis of the solutions of homogeneous equations, as columns, exactly."""
    if not equations:
        return _identity(size)
    reduced, rank = flint.fmpq_mat([[flint.fmpq(0) + v for v in row] for row in equations]).rref()
    pivots = [next(j for j in range(size) if reduced[i, j] != 0) for i in range(rank)]
    free = [j for j in range(size) if j not in pivots]
    basis = np.full((size, len(free)), flint.fmpq(0), dtype=object)
    for column, j in enumerate(free):
        basis[j, column] = flint.fmpq(1)
        for i, pivot in enumerate(pivots):
            basis[pivot, column] = -reduced[i, j]
    return basis


def single_zeros(equations: list[list[Any]], size: int) -> npt.NDArray[Any] | None:
    """The same where entries are balls: only equations that say that one λ is zero can be met exactly."""
    gone = set()
    for row in equations:
        involved = [k for k, entry in enumerate(row) if not is_zero(entry)]
        if len(involved) > 1:
            continue
        gone.update(involved)
    for row in equations:
        if any(not is_zero(entry) and k not in gone for k, entry in enumerate(row)):
            return None
    return _identity(size)[:, [k for k in range(size) if k not in gone]]


def _identity(size: int) -> npt.NDArray[Any]:
    basis = np.full((size, size), flint.fmpq(0), dtype=object)
    for k in range(size):
        basis[k, k] = flint.fmpq(1)
    return basis


def as_fraction(value: Any) -> Fraction:
    """A FLINT rational as Python's."""
    return Fraction(int(value.p), int(value.q))
