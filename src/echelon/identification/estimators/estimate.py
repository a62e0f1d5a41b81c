"""An estimate: values, how far they can be trusted, and how they were found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from echelon.arrays import Floats


@dataclass(frozen=True, repr=False)
class Estimate:
    """Estimated parameters.

    Attributes
    ----------
    method : str
        Name of the estimator, such as ``"ols"``.
    parameters, units : tuple of str
        Names and SI units of the n parameters.
    values : array of shape (n,)
    covariance : array of shape (n, n)
    outputs : tuple of str
    noise : array of shape (m,)
        Standard deviation of each output's residual, unit of the output, corrected for the degrees of freedom.
    rows : tuple of int
        Rows of each output.
    degrees : float
        Residual degrees of freedom of the whole problem.
    diagnostics : mapping
        JSON-able numbers and texts that belong to the method: iterations, weights, condition numbers, …
    """

    method: str
    parameters: tuple[str, ...]
    units: tuple[str, ...]
    values: Floats
    covariance: Floats
    outputs: tuple[str, ...]
    noise: Floats
    rows: tuple[int, ...]
    degrees: float
    diagnostics: Mapping[str, Any] = field(default_factory=dict)

    @property
    def std(self) -> Floats:
        """Standard deviations, shape (n,)."""
        deviations: Floats = np.sqrt(np.maximum(np.diagonal(self.covariance), 0.0))
        return deviations

    @property
    def relative_std(self) -> Floats:
        """Standard deviations in per cent of the values, shape (n,); infinite where the value is zero."""
        with np.errstate(divide="ignore", invalid="ignore"):
            percent: Floats = np.where(self.values == 0, np.inf, 100 * self.std / np.abs(self.values))
        return percent

    def interval(self, level: float = 0.95) -> Floats:
        """Confidence intervals from Student's distribution, shape (n, 2).

        Parameters
        ----------
        level : float
            Probability that an interval covers the true value.
        """
        from scipy.stats import t

        half = t.ppf(0.5 + level / 2, max(self.degrees, 1.0)) * self.std
        return np.stack([self.values - half, self.values + half], axis=1)

    def __repr__(self) -> str:
        return f"Estimate({self.method}: {len(self.values)} parameters from {sum(self.rows)} rows)"
