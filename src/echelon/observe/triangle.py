"""The R-factor of a whole observation matrix: all that least squares needs to know of it.

    [W y] = Q [R  Qᵀy; 0  ρ],   ‖W ζ − y‖² = ‖R ζ − Qᵀy‖² + ρ²

so ρ is the norm of the residual that no ζ can remove, and R has the singular values and the column norms of W.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.errors import InputError

_SHOWN = 6


@dataclass(frozen=True, repr=False)
class Triangle:
    """R, Qᵀy and the residual of a least-squares problem.

    Attributes
    ----------
    parameters : tuple of str
        Labels of the n columns.
    R : array of shape (n, n)
        Upper triangular, with a diagonal that is not negative.
    qty : array of shape (n,)
        The first n entries of Qᵀy.
    residual : float
        Norm of W ζ − y at the least-squares solution, in the unit of the (weighted) outputs.
    samples, rows : int
        Samples, and rows of W.
    """

    parameters: tuple[str, ...]
    R: Floats
    qty: Floats
    residual: float
    samples: int
    rows: int

    @cached_property
    def scales(self) -> Floats:
        """Norms of the columns of W, shape (n,)."""
        return column_norms(self.R)

    @cached_property
    def singular_values(self) -> Floats:
        """Singular values of W, descending, shape (n,)."""
        return np.asarray(np.linalg.svd(self.R, compute_uv=False), dtype=np.float64)

    @cached_property
    def scaled_singular_values(self) -> Floats:
        """Singular values of W with columns scaled to norm 1 (zero columns stay), descending, shape (n,)."""
        return np.asarray(np.linalg.svd(self._scaled, compute_uv=False), dtype=np.float64)

    @property
    def condition(self) -> float:
        """Condition number of W in the 2-norm; it depends on the units of the parameters."""
        return _condition(self.singular_values)

    @property
    def scaled_condition(self) -> float:
        """Condition number of W with columns scaled to norm 1, within √n of the best column scaling (van der Sluis)."""
        return _condition(self.scaled_singular_values)

    @property
    def precision(self) -> float:
        """Relative size below which a singular value of the scaled W cannot be told from zero."""
        return float(np.finfo(float).eps) * max(self.rows, len(self.parameters))

    @property
    def rank(self) -> int:
        """Numerical rank of W with scaled columns."""
        values = self.scaled_singular_values
        return int(np.sum(values > self.precision * values[0])) if values.size else 0

    def solve(self) -> Floats:
        """The least-squares solution.

        Returns
        -------
        array of shape (n,)

        Raises
        ------
        InputError
            If the data do not determine all parameters.
        """
        if self.rank < len(self.parameters):
            raise InputError(self._undetermined())
        # LU with row exchanges of a triangle exchanges nothing, so this is back substitution
        solution: Floats = np.linalg.solve(self._scaled, self.qty) / self.scales
        return solution

    @cached_property
    def _scaled(self) -> Floats:
        scaled: Floats = self.R / np.where(self.scales == 0, 1.0, self.scales)
        return scaled

    def _undetermined(self) -> str:
        n, rank = len(self.parameters), self.rank
        start = f"the data determine {rank} of {n} parameters"
        if self.rows < n:
            return f"{start}: there are only {self.rows} rows; give more samples"
        directions = np.linalg.svd(self._scaled)[2][rank:]
        weight = np.abs(directions).max(axis=0)
        involved = [self.parameters[k] for k in np.argsort(-weight, kind="stable") if weight[k] > 1e-3]
        shown = ", ".join(involved[:_SHOWN]) + (", …" if len(involved) > _SHOWN else "")
        return f"{start}; those they leave open involve {shown}: excite them, or leave parameters out with select()"

    def __repr__(self) -> str:
        return (
            f"Triangle({self.rows} × {len(self.parameters)}, {self.samples} samples, "
            f"condition {self.condition:.3g}, scaled {self.scaled_condition:.3g}, residual {self.residual:.6g})"
        )


def column_norms(matrix: Floats) -> Floats:
    """Norms of the columns, safe from overflow and underflow; shape (n,)."""
    if not matrix.size:
        return np.zeros(matrix.shape[1])
    largest = np.abs(matrix).max(axis=0)
    safe = np.where((largest == 0) | ~np.isfinite(largest), 1.0, largest)
    norms: Floats = safe * np.sqrt(((matrix / safe) ** 2).sum(axis=0))
    return norms


def upper_triangle(matrix: Floats) -> Floats:
    """R of a matrix, square, with a diagonal that is not negative.

    Parameters
    ----------
    matrix : array of shape (rows, n)
        Any number of rows; missing ones count as zero.

    Returns
    -------
    array of shape (n, n)
    """
    rows, n = matrix.shape
    if rows < n:
        matrix = np.vstack([matrix, np.zeros((n - rows, n))])
    R = np.linalg.qr(matrix, mode="r") if n else np.zeros((0, 0))
    return positive(np.asarray(R, dtype=np.float64))


def positive(R: Floats) -> Floats:
    """A triangle with its rows' signs chosen so that the diagonal is not negative."""
    signs = np.where(np.diagonal(R) < 0, -1.0, 1.0)
    # zeros below the diagonal written anew, so that none of them is −0
    result: Floats = np.where(_upper(*R.shape), R * signs[:, None], 0.0)
    return result


@lru_cache(maxsize=64)
def _upper(rows: int, columns: int) -> npt.NDArray[np.bool_]:
    """Where a triangle is not structurally zero: long logs make thousands of triangles of few sizes."""
    return np.triu(np.ones((rows, columns), dtype=bool))


def _condition(values: Floats) -> float:
    if not values.size:
        return 1.0
    return float(values[0] / values[-1]) if values[-1] > 0 else float("inf")
