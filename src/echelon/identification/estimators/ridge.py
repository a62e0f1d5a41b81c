"""Ridge regression towards a prior, in Bayes's reading: a prior distribution, a posterior, and a weight from the data.

The prior of each parameter is as wide as what one unit of the outputs tells of it, ζ ~ N(ζ₀, P/λ), with √P the
inverses of the columns' norms, so that units do not matter.  With the R-factor of the rows, one singular value
decomposition R √P = U S Vᵀ makes everything diagonal: the estimate, its posterior covariance and its evidence for
every weight λ cost a few vector operations, so the weight is found by a search that looks at the whole range.  Data
that leave directions open are no obstacle: there the prior speaks, and the diagnostics say how much of each
parameter's variance the data removed.

Source: MacKay, Neural Computation 4, 1992 (evidence).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from echelon.compute import Observation
from echelon.identification.estimators.estimate import (
    Estimate,
    WeightedSolution,
    check,
    check_rest,
    estimate_of,
)
from echelon.shared import Floats, InputError, extra

# ratios of variances that are searched, relative to the largest squared singular value
RANGE = (1e-16, 1e8)


def ridge(
    observation: Observation,
    units: Sequence[str],
    prior: Sequence[float] | Floats,
    *,
    weight: float | Literal["evidence"] = "evidence",
) -> Estimate:
    """Least squares with a Gaussian prior."""
    check(observation, units)
    triangle, mean = observation.combined(), np.asarray(prior, dtype=float)
    if mean.shape != (len(units),) or not np.isfinite(mean).all():
        raise InputError(
            f"the prior must be {len(units)} finite numbers, one for each parameter"
        )
    if (triangle.scales == 0).any():
        unseen = triangle.parameters[int(np.argmin(triangle.scales))]
        raise InputError(
            "the data do not show it at all: fix its value",
            element=f"parameter '{unseen}'",
        )
    left, singular, right = np.linalg.svd(triangle.R / triangle.scales)
    beta = left.T @ (triangle.qty - triangle.R @ mean)
    spectrum = _Spectrum(singular**2, beta, triangle.residual**2, triangle.rows)
    ratio, at_bound = _ratio(spectrum, weight)
    variance, shrink = spectrum.variance(ratio), 1.0 / (spectrum.squares + ratio)
    directions = right.T / triangle.scales[:, None]
    values = mean + directions @ (singular * shrink * beta)
    covariance = variance * (directions * shrink) @ directions.T
    effective = float(np.sum(spectrum.squares * shrink))
    determined = triangle.rank == len(mean)
    diagnostics = {
        "chosen_by": weight if isinstance(weight, str) else "given",
        "weight": float(ratio / variance),
        "weight_at_bound": at_bound,
        "effective_parameters": effective,
        "from_data": np.clip(
            1.0 - np.diagonal(covariance) * triangle.scales**2 * ratio / variance,
            0.0,
            1.0,
        ).tolist(),
        "log_evidence": spectrum.log_evidence(ratio, variance),
        "deviation": float(np.sqrt(variance)),
        "condition": triangle.condition if determined else None,
        "scaled_condition": triangle.scaled_condition if determined else None,
    }
    solution = WeightedSolution(
        observation,
        np.ones(len(observation.counts)),
        triangle,
        values,
        directions * np.sqrt(shrink),
    )
    estimate = estimate_of(solution, "ridge", units, covariance, diagnostics)
    return replace(estimate, degrees=float(triangle.rows - effective))


@dataclass(frozen=True)
class _Spectrum:
    """The problem in coordinates in which prior and data are both diagonal."""

    squares: Floats  # shape (n,); squared singular values of R √P
    beta: Floats  # shape (n,); Uᵀ of the outputs that the prior does not explain
    rest: float  # squared norm of what no parameters explain
    rows: int

    def variance(self, ratio: float) -> float:
        """σ² from the misfit, per row that the effective parameters leave over.

        Where the evidence is stationary this is its most likely value.
        """
        misfit = (
            float(np.sum((self.beta * ratio / (self.squares + ratio)) ** 2)) + self.rest
        )
        free = float(self.rows - np.sum(self.squares / (self.squares + ratio)))
        return misfit / free

    def profile(self, ratio: float) -> float:
        """Logarithm of the evidence at the most likely σ² when the prior variance is σ²/ratio."""
        variance = (
            float(np.sum(self.beta**2 * ratio / (self.squares + ratio))) + self.rest
        ) / self.rows
        return self.log_evidence(ratio, variance)

    def log_evidence(self, ratio: float, variance: float) -> float:
        """Logarithm of the probability density of the outputs."""
        squares = np.sum(self.beta**2 * ratio / (self.squares + ratio)) + self.rest
        scale = np.log(2 * np.pi * variance)
        volume = np.sum(np.log1p(self.squares / ratio)) + self.rows * scale
        return float(-(squares / variance + volume) / 2)


def _ratio(spectrum: _Spectrum, weight: float | str) -> tuple[float, bool]:
    """Noise variance over prior variance, and whether the search ended at the bound of its range."""
    check_rest(spectrum.rest)
    if weight == "evidence":
        whole = float(spectrum.squares.max(initial=0.0)) or 1.0
        return _minimised(
            lambda r: -spectrum.profile(r), whole * RANGE[0], whole * RANGE[1]
        )
    if isinstance(weight, str) or not (np.isfinite(weight) and weight > 0):
        raise InputError(
            f"weight is {weight!r}; expected a positive number or 'evidence'"
        )
    # the derivative of the evidence by σ² is positive below and negative above these
    least = spectrum.rest / spectrum.rows
    most = spectrum.rest + float(np.sum(spectrum.beta**2))
    ratio, _ = _minimised(
        lambda r: -spectrum.log_evidence(r, r / weight), weight * least, weight * most
    )
    return ratio, False


def _minimised(
    score: Callable[[float], float], low: float, high: float, count: int = 401
) -> tuple[float, bool]:
    """Minimum over a range of orders of magnitude, and whether it is at an end of it.

    It is looked for beside the least of many values, since evidence may have several maxima.
    """
    with extra("identify"):
        from scipy.optimize import minimize_scalar

    exponents = np.linspace(np.log(low), np.log(high), count)
    scores = np.array([score(float(np.exp(e))) for e in exponents])
    best = int(np.argmin(scores))
    ends = (
        float(exponents[max(best - 1, 0)]),
        float(exponents[min(best + 1, count - 1)]),
    )
    found = minimize_scalar(
        lambda e: score(float(np.exp(e))),
        bounds=ends,
        method="bounded",
        options={"xatol": 1e-9},
    )
    return float(np.exp(found.x)), best in (0, count - 1)
