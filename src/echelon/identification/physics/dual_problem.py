"""Linear functions λᵀζ̄ of base parameters by what they are on each body: S_b with λᵀB ζ = Σ tr(S_b J_b)."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import flint
import numpy as np

from echelon.arrays import Floats
from echelon.conventions import PER_BODY
from echelon.identification.physics.constraints import Roles
from echelon.identification.physics.exact_algebra import exact_dual, times
from echelon.identification.physics.exact_base import ExactBase
from echelon.identification.physics.pseudo_inertia import SIZE, dual_matrix
from echelon.identification.physics.triangles import svec


@dataclass(frozen=True)
class DualProblem:
    """What a separator of base parameters from robots has to satisfy.

    Attributes
    ----------
    role : Roles
    exact : ExactBase
    B : array of shape (r, p)
        The same in floats.
    values : array of shape (r,)
        Base parameters; exact as the floats they are.
    scales : array of shape (b, 4)
        Diagonal factors that give all entries of a body's S one unit: lengths for the first three, 1.
    weights : array of shape (r,)
        Sizes of the base parameters.
    solver : str
    """

    role: Roles
    exact: ExactBase
    B: Floats
    values: Floats
    scales: Floats
    weights: Floats
    solver: str

    def matrices(self, functions: Floats) -> list[Floats]:
        """For every body svec of its scaled S for each column, a λ,, shape (10, k)."""
        coefficients = self.B.T @ functions
        found = []
        for start, scale in zip(self.role.starts, self.scales, strict=True):
            matrices = dual_matrix(coefficients[start : start + PER_BODY].T) * np.outer(scale, scale)
            found.append(np.array([svec(m) for m in matrices]).reshape(-1, 10).T)
        return found

    def column(self, column: int) -> list[Any]:
        """The exact coefficients of a standard parameter in λᵀB, as a row over λ."""
        return [row.get(column, 0) for row in self.exact.rows]

    def through(self, start: int, vector: list[Fraction]) -> list[list[Any]]:
        """The four equations S_b v = 0 as rows over λ."""
        matrices = []
        for row in self.exact.rows:
            entries = [row.get(start + k, 0) for k in range(PER_BODY)]
            matrices.append(exact_dual(entries))
        return [
            [sum((times(m[i][j], vector[j]) for j in range(SIZE)), flint.fmpq(0)) for m in matrices]
            for i in range(SIZE)
        ]
