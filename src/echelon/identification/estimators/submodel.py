"""A least-squares model with some of the parameters, from the R-factor alone.

Taking a parameter out deletes a column of the triangle and makes it triangular again, which costs k³ at most and loses
no digits, unlike updating (WᵀW)⁻¹.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from echelon.arrays import Floats
from echelon.observe.triangle import upper_triangle


@dataclass(frozen=True)
class Submodel:
    """The parameters that are left, and the triangle of [W y] in their columns.

    Attributes
    ----------
    kept : tuple of int
        Numbers of the k parameters among those of the full model.
    triangle : array of shape (k + 1, k + 1)
        R-factor of [W y] in their columns, rows weighted; W has full rank.
    rows : float
        Rows of W, as many as count as independent.
    """

    kept: tuple[int, ...]
    triangle: Floats
    rows: float

    @property
    def values(self) -> Floats:
        """Least-squares estimates, shape (k,)."""
        solution: Floats = self._inverse @ self.triangle[:-1, -1]
        return solution

    @property
    def squares(self) -> float:
        """Sum of squares of the weighted residual."""
        return float(self.triangle[-1, -1] ** 2)

    @property
    def cofactor(self) -> Floats:
        """(WᵀW)⁻¹, shape (k, k)."""
        inverse = self._inverse
        return inverse @ inverse.T

    @property
    def degrees(self) -> float:
        """Residual degrees of freedom, at least 1."""
        return max(self.rows - len(self.kept), 1.0)

    @property
    def variance(self) -> float:
        """Of the weighted residual; tiny where the data are fitted to rounding."""
        return max(self.squares, float(np.finfo(float).tiny)) / self.degrees

    @property
    def growth(self) -> Floats:
        """By how much the sum of squares grows when one parameter is taken out, shape (k,)."""
        grown: Floats = self.values**2 / np.diagonal(self.cofactor)
        return grown

    @property
    def relative(self) -> Floats:
        """Relative standard deviations, shape (k,)."""
        deviations = np.sqrt(self.variance * np.diagonal(self.cofactor))
        with np.errstate(divide="ignore"):
            found: Floats = deviations / np.abs(self.values)
        return found

    @cached_property
    def _inverse(self) -> Floats:
        R = self.triangle[:-1, :-1]
        scales = np.linalg.norm(R, axis=0)
        inverse: Floats = np.linalg.inv(R / scales) / scales[:, None]
        return inverse

    def without(self, place: int) -> Submodel:
        """The model without one of its parameters.

        Parameters
        ----------
        place : int
            Its place among those kept.
        """
        kept = self.kept[:place] + self.kept[place + 1 :]
        return Submodel(kept, upper_triangle(np.delete(self.triangle, place, axis=1)), self.rows)
