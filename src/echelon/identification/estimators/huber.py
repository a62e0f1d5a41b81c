"""Huber's M-estimate: gross errors of the outputs pull with a bounded force.

Residuals up to k σ_i count squared, larger ones by their absolute value, so that spikes, collisions and lost samples do
not ruin the fit while Gaussian noise costs next to nothing (95 % efficiency at k = 1.345).  The noise σ_i of each
output comes from Huber's Proposal 2 rather than from the median of the residuals: it needs sums only, so the data
stream by in constant memory, and for one output the criterion is jointly convex in ζ and σ, so that the start does not
matter.  A pass over the rows only adds up Wᵀψ, the pull of the clipped residuals; the R-factors of the plain rows turn
it into a step (Huber's modified residuals), so an iteration costs no factorisation.  Errors in the regressor itself
(leverage points) are not resisted by any M-estimate.

Sources: Huber, Annals of Statistics 1, 1973 (covariance with correction); Huber, Robust Statistics, 1981, chapter 7.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import erf, exp, pi, sqrt

import numpy as np

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.identification.estimators.estimate import Estimate, Solution, estimate_of, solved
from echelon.identification.estimators.least_squares import irls, noise_floor, used_up
from echelon.identification.rows.rows import Rows
from echelon.observe.observation import Observation

_LEAST_SHARE, _USED_UP = 0.6, 1e-8


def huber(rows: Rows, *, clip: float = 1.345, tolerance: float = 1e-3, limit: int = 100) -> Estimate:
    """Robust estimate with a scale for each output."""
    if not clip > 0:
        raise InputError(f"clip is {clip}; expected a positive number of standard deviations, such as 1.345")
    observation = rows.observation()
    start = irls(observation, rows.units)
    values = start.values
    noise = np.where(np.isfinite(start.noise), np.maximum(start.noise, noise_floor(observation)), np.inf)
    change, iterations = np.inf, 0
    while change > tolerance and iterations < limit:
        iterations += 1
        sweep = _swept(rows, values, noise, clip)
        # more than half the curvature, so that steps cannot overshoot
        share = np.maximum(sweep.share, _LEAST_SHARE)
        bread = solved(observation, rows.units, np.sqrt(share) / noise)
        white = bread.root.T @ sweep.pull
        values = values + bread.root @ white
        new = _noise(sweep, solved(observation, rows.units, 1.0 / noise), noise, clip)
        with np.errstate(invalid="ignore"):
            scale = float(np.nanmax(np.abs(np.log(new / noise)), initial=0.0))
        change, noise = max(float(np.linalg.norm(white)) / sqrt(len(values)), scale), new
    estimate = _finished(_swept(rows, values, noise, clip), observation, rows.units, values, noise, clip)
    course = {"iterations": iterations, "converged": bool(change <= tolerance)}
    return replace(estimate, diagnostics={**estimate.diagnostics, **course})


@dataclass(frozen=True)
class _Sweep:
    """What one pass over the rows finds at given parameters and noise."""

    pull: Floats  # Σ Wᵀψ(r/σ)/σ, shape (n,)
    squares: Floats  # Σ ψ(r/σ)² of each output, shape (m,)
    share: Floats  # of each output's rows within the clip, shape (m,)


def _swept(rows: Rows, values: Floats, noise: Floats, clip: float) -> _Sweep:
    m = len(noise)
    pull, squares, inside, counts = np.zeros(len(values)), np.zeros(m), np.zeros(m), np.zeros(m)
    for block in rows.blocks():
        for i, (matrix, y) in enumerate(zip(block.matrices, block.y, strict=True)):
            columns = list(rows.layout.columns[i])
            residual = (y - matrix @ values[columns]) / noise[i]
            bounded = np.clip(residual, -clip, clip)
            pull[columns] += bounded @ matrix / noise[i]
            squares[i] += bounded @ bounded
            inside[i] += np.sum(np.abs(residual) <= clip)
            counts[i] += len(y)
    return _Sweep(pull, squares, np.where(counts > 0, inside / np.maximum(counts, 1.0), 1.0))


def _noise(sweep: _Sweep, used: Solution, noise: Floats, clip: float) -> Floats:
    """Proposal 2: the noise at which the mean of ψ² is what it is for Gaussian noise, shape (m,)."""
    counts = np.array(used.observation.counts, dtype=float)
    free = np.where(counts > 0, counts - used.leverages, 1.0)
    for label, count, rest in zip(used.observation.layout.outputs, used.observation.counts, free, strict=True):
        if rest < _USED_UP * count:
            raise InputError(used_up(count), element=f"output '{label}'")
    some = np.isfinite(noise)
    found = np.where(some, noise, 1.0) * np.sqrt(sweep.squares / (free * gaussian_square(clip)))
    return np.where(some, np.maximum(found, noise_floor(used.observation)), np.inf)


def gaussian_square(clip: float) -> float:
    """Mean of min(z², clip²) for standard normal z."""
    inner = erf(clip / sqrt(2))
    return inner - clip * sqrt(2 / pi) * exp(-(clip**2) / 2) + clip**2 * (1 - inner)


def _finished(
    sweep: _Sweep, plain: Observation, units: Sequence[str], values: Floats, noise: Floats, clip: float
) -> Estimate:
    """Values, and Huber's asymptotic covariance A⁻¹BA⁻¹ with the correction K for the number of parameters."""
    counts = np.maximum(np.array(plain.counts, dtype=float), 1.0)
    used = solved(plain, units, 1.0 / noise)
    share = sweep.share
    some = np.isfinite(noise)
    if (some & (share == 0)).any():
        label = plain.layout.outputs[int(np.argmax(some & (share == 0)))]
        raise InputError(
            f"no residual is within {clip} standard deviations; use a larger clip", element=f"output '{label}'"
        )
    correction = 1.0 + used.leverages / counts * (1.0 - share) / np.where(share > 0, share, 1.0)
    slopes = np.where(some, share / correction, 1.0)
    spread = sweep.squares / (counts - used.leverages)
    bread = solved(plain, units, np.sqrt(slopes) / noise)
    parts = [np.sqrt(spread[i]) * used.whitened(i) for i in range(len(noise))]
    # the rows of `parts` are whitened by `used`; R of `used` takes that back
    root = np.vstack(parts) @ used.triangle.R @ bread.inverse
    found = Solution(plain, 1.0 / noise, used.triangle, values, used.root)
    labels = plain.layout.outputs
    diagnostics = {
        "clip": clip,
        "clips": (clip * np.where(some, noise, 0.0)).tolist(),
        "slopes": slopes.tolist(),
        "downweighted": {label: float(1.0 - s) for label, s, there in zip(labels, share, some, strict=True) if there},
    }
    estimate = estimate_of(found, "huber", units, root.T @ root, diagnostics)
    return replace(estimate, noise=np.where(some, noise, np.nan))
