"""Symmetric matrices as vectors of their triangles, as cone solvers want them: inner products stay the same."""

from __future__ import annotations

from typing import Any

import numpy as np

from echelon.arrays import Floats
from echelon.conventions import PER_BODY
from echelon.inertia.spatial import pseudo_inertia


def svec(matrix: Floats) -> Floats:
    """Upper triangle by columns, off-diagonal entries times √2; shape (n (n + 1)/2,)."""
    n = len(matrix)
    return np.array([matrix[i, j] * (1.0 if i == j else np.sqrt(2)) for j in range(n) for i in range(j + 1)])


def order(length: int) -> int:
    """Rows of the matrix whose triangle has so many entries."""
    return round((float(np.sqrt(8 * length + 1)) - 1) / 2)


def unpacked(triangle: Floats) -> Floats:
    """The matrix of :func:`svec`, shape (n, n)."""
    n = order(len(triangle))
    matrix = np.zeros((n, n))
    places = [(i, j) for j in range(n) for i in range(j + 1)]
    for value, (i, j) in zip(triangle, places, strict=True):
        matrix[i, j] = matrix[j, i] = value if i == j else value / np.sqrt(2)
    return matrix


def _svec_of_parameters() -> Floats:
    return np.stack([svec(pseudo_inertia(unit)) for unit in np.eye(PER_BODY)], axis=1)


SVEC = _svec_of_parameters()
"""svec(J) = SVEC · (XX … M), shape (10, 10)."""


def sparse_diagonal(entries: Floats) -> Any:
    """A sparse diagonal matrix."""
    from scipy.sparse import diags_array

    return diags_array(entries, format="csc")
