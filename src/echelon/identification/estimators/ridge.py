"""Ridge regression towards a prior, in Bayes's reading: a prior distribution, a posterior, and a weight from the data.

With a prior ζ ~ N(ζ₀, P/λ), P = LLᵀ, and the R-factor of the weighted rows, one singular value decomposition R L = U S
Vᵀ makes everything diagonal: the estimate, its posterior covariance and its score for every weight λ cost a few vector
operations, so the weight is found by a search that looks at the whole range.  Data that leave directions open are no
obstacle: there the prior speaks, and the diagnostics say how much of each parameter's variance the data removed.

Sources: MacKay, Neural Computation 4, 1992 (evidence); Golub, Heath & Wahba, Technometrics 21, 1979 (generalised
cross-validation).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.extras import extra
from echelon.identification.estimators.estimate import Estimate, Solution, check, estimate_of
from echelon.identification.estimators.least_squares import checked_noise
from echelon.observe.observation import Observation
from echelon.observe.triangle import Triangle

_GRID = 401
_RANGE = 1e-16, 1e8
"""Ratios of variances that are searched, relative to the largest squared singular value."""


def ridge(
    observation: Observation,
    units: Sequence[str],
    prior: Sequence[float] | Floats,
    *,
    spread: Sequence[float] | Floats | None = None,
    weight: float | Literal["evidence", "gcv"] = "evidence",
    noise: Sequence[float] | Floats | None = None,
) -> Estimate:
    """Least squares with a Gaussian prior."""
    check(observation, units)
    sigma = np.ones(len(observation.counts)) if noise is None else checked_noise(observation, noise)
    triangle = observation.combined(1.0 / sigma)
    mean = _prior(triangle, prior)
    root = _spread_root(triangle, spread)
    spectrum = _spectrum(triangle, mean, root)
    known = noise is not None
    ratio, at_bound = _ratio(spectrum, weight, known)
    variance = 1.0 if known else spectrum.variance(ratio)
    shrink = 1.0 / (spectrum.squares + ratio)
    right = root @ spectrum.right
    values = mean + right @ (np.sqrt(spectrum.squares) * shrink * spectrum.beta)
    covariance = variance * (right * shrink) @ right.T
    before = variance / ratio * np.sum(root**2, axis=1)
    effective = float(np.sum(spectrum.squares * shrink))
    diagnostics = {
        "iterations": 1,
        "converged": True,
        "chosen_by": weight if isinstance(weight, str) else "given",
        "weight": float(ratio / variance),
        "weight_at_bound": at_bound,
        "effective_parameters": effective,
        "from_data": np.clip(1.0 - np.diagonal(covariance) / before, 0.0, 1.0).tolist(),
        "log_evidence": spectrum.log_evidence(ratio, variance),
        "deviation": float(np.sqrt(variance)),
        "condition": triangle.condition if triangle.rank == len(mean) else None,
        "scaled_condition": triangle.scaled_condition if triangle.rank == len(mean) else None,
    }
    solution = Solution(observation, 1.0 / sigma, triangle, values, right * np.sqrt(shrink))
    estimate = estimate_of(solution, "ridge", units, covariance, diagnostics)
    return replace(estimate, degrees=float(triangle.rows - effective))


@dataclass(frozen=True)
class _Spectrum:
    """The problem in coordinates in which prior and data are both diagonal."""

    squares: Floats  # shape (n,); squared singular values of W L
    beta: Floats  # shape (n,); Uᵀ of the outputs that the prior does not explain
    right: Floats  # shape (n, n); V
    rest: float  # squared norm of what no parameters explain
    rows: int

    def variance(self, ratio: float) -> float:
        """σ² from the misfit, per row that the effective parameters leave over.

        Where the evidence is stationary this is its most likely value.
        """
        misfit, free = self._misfit(ratio)
        return misfit / free

    def profile(self, ratio: float) -> float:
        """Logarithm of the evidence at the most likely σ² when the prior variance is σ²/ratio."""
        variance = (float(np.sum(self.beta**2 * ratio / (self.squares + ratio))) + self.rest) / self.rows
        return self.log_evidence(ratio, variance)

    def log_evidence(self, ratio: float, variance: float) -> float:
        """Logarithm of the probability density of the weighted outputs."""
        squares = np.sum(self.beta**2 * ratio / (self.squares + ratio)) + self.rest
        volume = np.sum(np.log1p(self.squares / ratio)) + self.rows * np.log(2 * np.pi * variance)
        return float(-(squares / variance + volume) / 2)

    def cross_validation(self, ratio: float) -> float:
        """Generalised cross-validation score; smaller is better."""
        misfit, free = self._misfit(ratio)
        return float(np.log(misfit) - 2 * np.log(free))

    def _misfit(self, ratio: float) -> tuple[float, float]:
        """Squared norm of the residual, and rows less effective parameters."""
        misfit = float(np.sum((self.beta * ratio / (self.squares + ratio)) ** 2)) + self.rest
        return misfit, float(self.rows - np.sum(self.squares / (self.squares + ratio)))


def _spectrum(triangle: Triangle, mean: Floats, root: Floats) -> _Spectrum:
    left, singular, right = np.linalg.svd(triangle.R @ root)
    beta = left.T @ (triangle.qty - triangle.R @ mean)
    return _Spectrum(singular**2, beta, right.T, triangle.residual**2, triangle.rows)


def _ratio(spectrum: _Spectrum, weight: float | str, known: bool) -> tuple[float, bool]:
    """Noise variance over prior variance, and whether the search ended at the bound of its range."""
    if spectrum.rest == 0 and not known:
        raise InputError("no row is left over to estimate the noise from; give the noise, or more samples")
    whole = float(spectrum.squares.max(initial=0.0)) or 1.0
    low, high = whole * _RANGE[0], whole * _RANGE[1]
    if weight == "gcv":
        return _minimised(spectrum.cross_validation, low, high)
    if weight == "evidence":
        return _minimised(lambda r: -(spectrum.log_evidence(r, 1.0) if known else spectrum.profile(r)), low, high)
    if isinstance(weight, str) or not (np.isfinite(weight) and weight > 0):
        raise InputError(f"weight is {weight!r}; expected a positive number, 'evidence' or 'gcv'")
    if known:
        return float(weight), False
    # the derivative of the evidence by σ² is positive below and negative above these
    least, most = spectrum.rest / spectrum.rows, spectrum.rest + float(np.sum(spectrum.beta**2))
    ratio, _ = _minimised(lambda r: -spectrum.log_evidence(r, r / weight), weight * least, weight * most)
    return ratio, False


def _minimised(score: Callable[[float], float], low: float, high: float) -> tuple[float, bool]:
    """Minimum over a range of orders of magnitude, and whether it is at an end of it."""
    with extra("identify"):
        from scipy.optimize import minimize_scalar

    exponents = np.linspace(np.log(low), np.log(high), _GRID)
    scores = np.array([score(float(np.exp(e))) for e in exponents])
    best = int(np.argmin(scores))
    ends = (float(exponents[max(best - 1, 0)]), float(exponents[min(best + 1, _GRID - 1)]))
    found = minimize_scalar(lambda e: score(float(np.exp(e))), bounds=ends, method="bounded", options={"xatol": 1e-9})
    return float(np.exp(found.x)), best in (0, _GRID - 1)


def _prior(triangle: Triangle, prior: Sequence[float] | Floats) -> Floats:
    mean = np.asarray(prior, dtype=float)
    if mean.shape != (len(triangle.parameters),) or not np.isfinite(mean).all():
        raise InputError(f"the prior must be {len(triangle.parameters)} finite numbers, one for each parameter")
    return mean


def _spread_root(triangle: Triangle, spread: Sequence[float] | Floats | None) -> Floats:
    """L with P = LLᵀ, shape (n, n)."""
    n = len(triangle.parameters)
    if spread is None:
        if (triangle.scales == 0).any():
            unseen = triangle.parameters[int(np.argmin(triangle.scales))]
            raise InputError(
                "the data do not show it at all: give the spread of the prior", element=f"parameter '{unseen}'"
            )
        return np.diag(1.0 / triangle.scales)
    given = np.asarray(spread, dtype=float)
    if given.shape == (n,):
        if not (np.isfinite(given).all() and (given > 0).all()):
            raise InputError("standard deviations of the prior must be positive; fix parameters that are known exactly")
        return np.diag(given)
    if given.shape != (n, n) or not np.allclose(given, given.T):
        raise InputError(f"spread has shape {given.shape}; expected ({n},), or a symmetric array of shape ({n}, {n})")
    problem = "the covariance of the prior is not positive definite"
    if not (np.isfinite(given).all() and (np.diagonal(given) > 0).all()):
        raise InputError(problem)
    size = np.sqrt(np.diagonal(given))
    try:
        root: Floats = size[:, None] * np.linalg.cholesky(given / np.outer(size, size))
    except np.linalg.LinAlgError:
        raise InputError(problem) from None
    return root
