"""Criteria of optimal experiments: functions of the information matrix alone, with their slopes.

F = Σ Wᵀ diag(1/σ²) W is the inverse covariance of the parameters that least squares will find.  Every criterion is
minimised; the slope M of a criterion φ is the symmetric matrix with dφ = tr(M dF).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from echelon.arrays import Floats

Name = Literal["d_optimal", "a_optimal", "condition"]
Slope = tuple[float, Floats]

_SHARPNESS = 8
"""Exponent of the norms that stand for the largest and the smallest eigenvalue: high ones follow them closely, low ones
are smooth.  The result is a bound of the condition number, and reported is the number itself."""

_NOTHING = 1e-100
"""Information that counts as none: squares of its inverse are still numbers."""


@dataclass(frozen=True, eq=False)
class Criterion:
    """A function of the information matrix that is minimised.

    Attributes
    ----------
    name : "d_optimal", "a_optimal" or "condition"
        Minus log det of F per parameter, the logarithm of the trace of its inverse, or of the condition number of the
        observation matrix, which is smoothed.
    scales : array of shape (r,)
        Units in which parameters are measured: one of size ``scales[k]`` counts as one.  Of no influence on where the
        first one is least.
    """

    name: Name
    scales: Floats

    def evaluate(self, F: Floats) -> Slope:
        """The value, and the slope M of shape (r, r).

        Parameters
        ----------
        F : array of shape (r, r)
            Information matrix.
        """
        units = np.outer(self.scales, self.scales)
        value, slope = _FUNCTIONS[self.name](F * units)
        return value, slope * units


def condition_number(F: Floats) -> float:
    """Condition number of an observation matrix with this information; infinite if columns depend on one another."""
    values = np.linalg.eigvalsh(F)
    return float(np.sqrt(values[-1] / values[0])) if values[0] > 1e-15 * values[-1] else float("inf")


def log_det(F: Floats) -> float:
    """Of an information matrix; −∞ if it is singular."""
    sign, value = np.linalg.slogdet(F)
    return float(value) if sign > 0 else -float("inf")


def _d_optimal(F: Floats) -> Slope:
    values, vectors = _spectrum(F)
    n = len(values)
    return -float(np.sum(np.log(values))) / n, -(vectors / values) @ vectors.T / n


def _a_optimal(F: Floats) -> Slope:
    values, vectors = _spectrum(F)
    trace = float(np.sum(1 / values))
    return float(np.log(trace)), -(vectors / values**2) @ vectors.T / trace


def _condition(F: Floats) -> Slope:
    values, vectors = _spectrum(F)
    if values[-1] <= _NOTHING:  # nothing is seen, which is not well conditioned
        return -0.5 * float(np.log(np.finfo(float).eps)), np.zeros_like(F)
    large, small = values / values[-1], values[0] / values
    p = _SHARPNESS
    up, down = np.sum(large**p), np.sum(small**p)
    value = 0.5 * (np.log(values[-1] / values[0]) + (np.log(up) + np.log(down)) / p)
    slopes = 0.5 * (large**p / up - small**p / down) / values
    return float(value), (vectors * slopes) @ vectors.T


def _spectrum(F: Floats) -> tuple[Floats, Floats]:
    """Eigenvalues, ascending, and eigenvectors; what is lost in rounding counts as the least that is not."""
    values, vectors = np.linalg.eigh(F)
    return np.maximum(values, max(np.finfo(float).eps * float(values[-1]), _NOTHING)), vectors


_FUNCTIONS: dict[str, Callable[[Floats], Slope]] = {
    "d_optimal": _d_optimal,
    "a_optimal": _a_optimal,
    "condition": _condition,
}
