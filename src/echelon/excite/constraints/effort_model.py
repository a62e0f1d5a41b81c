"""A model that predicts torques and forces before they are measured, and how far they may be from that."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.mechanism.mechanism import Mechanism
from echelon.program.intervals import Interval

SIGNS = ("plus", "minus")
"""Of the deviations, in the order of :meth:`EffortModel.extremes`."""

_LEAST = 1e-6
"""N·m or N, which are added to every deviation in squares: a root has no derivative at zero."""
_ROUNDING = 1e-12


@dataclass(frozen=True, eq=False)
class EffortModel:
    """Parameters by which efforts x̄ᵀζ are predicted, x̄ a row of the regressor.

    Attributes
    ----------
    values : array of shape (c,)
        ζ, SI units.
    columns : sequence of int, optional
        Columns of the regressor that they belong to, while all other parameters count as zero: the pivots for base
        parameters.  All standard parameters if omitted.
    covariance : array of shape (c, c), optional
        Σ, of the values, where these were identified.
    deviations : float
        How many standard deviations √(x̄ᵀ Σ x̄) of a predicted effort are kept free.
    """

    values: Floats
    columns: Sequence[int] | None = None
    covariance: Floats | None = None
    deviations: float = 0.0

    @property
    def certain(self) -> bool:
        """Whether efforts are taken as predicted."""
        return self.covariance is None or not self.deviations

    def places(self, mechanism: Mechanism) -> Sequence[int]:
        """Columns of a mechanism's regressor."""
        return range(len(mechanism.parameters)) if self.columns is None else self.columns

    def part(self, columns: npt.NDArray[np.intp]) -> EffortModel:
        """The model of some of the values."""
        covariance = None if self.covariance is None else self.covariance[np.ix_(columns, columns)]
        return EffortModel(self.values[columns], None, covariance, self.deviations)

    def extremes(self, x: Floats) -> Floats:
        """Efforts plus, then minus the deviations that are kept free.

        Parameters
        ----------
        x : array of shape (N, c)

        Returns
        -------
        array of shape (N, 2)
        """
        mean, free = x @ self.values, self.deviations * self._std(x)
        return np.stack([mean + free, mean - free], axis=1)

    def adjoints(self, x: Floats) -> Floats:
        """Derivatives of :meth:`extremes` by x, shape (2, N, c)."""
        free = self.deviations * (x @ self._factor) @ self._factor.T / self._std(x)[:, None]
        return np.stack([self.values + free, self.values - free])

    def enclosed(self, x: Interval) -> Interval:
        """Bounds of :meth:`extremes` while x stays in intervals, each of shape (cells, 2)."""
        middle, radius = (x[0] + x[1]) / 2, (x[1] - x[0]) / 2
        radius = radius + _ROUNDING * np.abs(middle)
        mean, wide = middle @ self.values, radius @ np.abs(self.values)
        along, across = np.abs(middle @ self._factor), radius @ np.abs(self._factor)
        least = self.deviations * np.linalg.norm(np.maximum(along - across, 0.0), axis=1)
        most = self.deviations * np.sqrt(np.sum((along + across) ** 2, axis=1) + _LEAST**2)
        low = np.stack([mean - wide + least, mean - wide - most], axis=1)
        high = np.stack([mean + wide + most, mean + wide - least], axis=1)
        return low, high

    def _std(self, x: Floats) -> Floats:
        found: Floats = np.sqrt(np.sum((x @ self._factor) ** 2, axis=1) + _LEAST**2)
        return found

    @cached_property
    def _factor(self) -> Floats:
        """L with L Lᵀ = Σ, without directions in which nothing varies."""
        assert self.covariance is not None
        sizes = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        units = np.where(sizes > 0, sizes, 1.0)
        values, vectors = np.linalg.eigh(self.covariance / np.outer(units, units))
        kept = values > 0
        found: Floats = units[:, None] * vectors[:, kept] * np.sqrt(values[kept])
        return found
