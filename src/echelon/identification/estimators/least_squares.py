"""Least squares: ordinary, weighted, iteratively reweighted, of smallest norm, and Huber's robust kind.

Ordinary least squares is the estimate that tables are published for: every row counts alike, and its classical
covariance σ²(WᵀW)⁻¹ takes all outputs to have the same noise.

Joints of a robot differ in noise by orders of magnitude, and forces and torques do not even share a unit, so each
output's rows are divided by its σ_i.  When the σ_i are not known, the fixed point of

    σ_i² = ‖W_i ζ − y_i‖² / (N_i − h_i),    h_i: leverage of the output's rows

solves the equations of restricted maximum likelihood (REML; Harville, J. Am. Stat. Assoc. 72, 1977), which counts the
degrees of freedom that the parameters use up where they are used up; N_i − n/m would not.  R-factors of the outputs
suffice for all of it: the data are gone through once.

For data that leave directions open there is the solution of smallest norm: not an estimate of the parameters but the
shortest of all that fit equally well, with columns scaled to norm 1 so that units do not matter.  Predictions of the
same motions need no more.  Variances of parameters that take part in an open direction are infinite: the data say
nothing, and a pseudo-inverse would claim certainty.

Huber's M-estimate: gross errors of the outputs pull with a bounded force.

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

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import erf, exp, pi, sqrt

import numpy as np

from echelon.compute import Observation, Triangle, safe_norms
from echelon.identification.estimators.estimate import (
    ROUNDING,
    Estimate,
    WeightedSolution,
    check,
    check_rest,
    direction_text,
    estimate_of,
    open_directions,
    pseudo_root,
    solved,
)
from echelon.identification.rows.rows import RowStream
from echelon.shared import Floats, InputError


def ols(observation: Observation, units: Sequence[str]) -> Estimate:
    """Ordinary least squares."""
    solution = solved(observation, units)
    if solution.degrees <= 0:
        raise InputError(
            f"{solution.triangle.rows} rows for {len(units)} parameters leave nothing over to estimate the noise from; "
            "give more samples"
        )
    variance = solution.triangle.residual**2 / solution.degrees
    diagnostics = {"deviation": float(np.sqrt(variance))}
    return estimate_of(solution, "ols", units, variance * solution.inverse, diagnostics)


def least_squares(triangle: Triangle) -> Floats:
    """Parameters of a triangle that fit best, also where it does not determine all, shape (n,)."""
    return np.asarray(
        np.linalg.lstsq(triangle.scaled, triangle.qty, rcond=None)[0]
        / triangle.safe_scales
    )


def used_up(rows: float, estimator: str = "wls()") -> str:
    """Message for an output whose noise cannot be estimated."""
    return (
        f"its {rows:.3g} rows are all used up by parameters that only it shows, so its noise cannot be estimated: "
        f"give more samples, leave it out, or give {estimator} the noise"
    )


def wls(
    observation: Observation, units: Sequence[str], noise: Sequence[float] | Floats
) -> Estimate:
    """Least squares with given ratios of noise; a common factor is estimated."""
    solution = solved(observation, units, 1.0 / checked_noise(observation, noise))
    check_rest(solution.degrees)
    factor = solution.triangle.residual**2 / solution.degrees
    return estimate_of(solution, "wls", units, factor * solution.inverse, {})


def irls(
    observation: Observation,
    units: Sequence[str],
    *,
    tolerance: float = 1e-9,
    limit: int = 100,
) -> Estimate:
    """Least squares with the noise of each output found from the residuals."""
    check(observation, units)

    def updated(noise: Floats) -> Floats:
        return _updated(solved(observation, units, 1.0 / noise))[0]

    noise, iterations, converged = fixed_noise(
        updated, noise_estimate(observation), tolerance, limit
    )
    solution = solved(observation, units, 1.0 / noise)
    diagnostics = {
        "iterations": iterations,
        "converged": converged,
        "exact_outputs": _updated(solution)[1],
    }
    return estimate_of(solution, "irls", units, solution.inverse, diagnostics)


def fixed_noise(
    updated: Callable[[Floats], Floats],
    noise: Floats,
    tolerance: float = 1e-9,
    limit: int = 100,
) -> tuple[Floats, int, bool]:
    """Noise that fits which are weighted by it find again: where its logarithms change by no more than a tolerance.

    Beside it how many fits were made, and whether that sufficed.
    """
    for iteration in range(1, limit + 1):
        before, noise = noise, updated(noise)
        if log_change(before, noise) <= tolerance:
            return noise, iteration, True
    return noise, limit, False


def log_change(before: Floats, after: Floats) -> float:
    """Largest change of the logarithms of noise; outputs without rows have none."""
    with np.errstate(invalid="ignore"):
        return float(np.nanmax(np.abs(np.log(after / before)), initial=0.0))


def noise_estimate(observation: Observation) -> Floats:
    """Noise of each output when its own rows alone are fitted, shape (m,): a start that no unit or other output sways.

    Where an output has no more rows than parameters it is the root mean square of the output; infinite for outputs
    without rows.
    """
    levels = []
    for factor, count in zip(observation.factors, observation.counts, strict=True):
        n = len(factor) - 1
        columns, y = factor[:, :n] / safe_norms(factor[:, :n]), factor[:, n]
        # without full rank the last entry is not the whole residual: that of the best fit is
        fit, _, rank, _ = np.linalg.lstsq(
            columns, y, rcond=np.finfo(float).eps * max(count, n)
        )
        free, size = count - rank, np.linalg.norm(y) / np.sqrt(max(count, 1))
        rest = np.linalg.norm(columns @ fit - y)
        levels.append(
            np.inf if not count else rest / np.sqrt(free) if free > 0 else size
        )
    return np.maximum(levels, noise_floor(observation))


def noise_floor(observation: Observation) -> Floats:
    """Smallest noise that is believed, shape (m,): a tiny share of the output's root mean square."""
    floors = []
    for label, factor, count in zip(
        observation.layout.outputs, observation.factors, observation.counts, strict=True
    ):
        size = float(np.linalg.norm(factor[:, -1])) / np.sqrt(max(count, 1))
        if count and size == 0 and factor.any():
            raise InputError(
                "all its measured values are zero: leave it out",
                element=f"output '{label}'",
            )
        floors.append(ROUNDING * size if size else 1.0)
    return np.array(floors)


def checked_noise(observation: Observation, noise: Sequence[float] | Floats) -> Floats:
    """Noise of the outputs, shape (m,)."""
    given = np.asarray(noise, dtype=float)
    outputs = observation.layout.outputs
    if given.shape != (len(outputs),):
        raise InputError(
            f"noise has shape {given.shape}; expected ({len(outputs)},), one for each of {', '.join(outputs)}"
        )
    if not (given > 0).all():
        wrong = outputs[int(np.argmin(given > 0))]
        raise InputError(
            "the noise must be a positive number, or infinite to leave it out",
            element=f"output '{wrong}'",
        )
    return given


def _updated(solution: WeightedSolution) -> tuple[Floats, list[str]]:
    """Noise from the residuals, and the outputs that are fitted to rounding."""
    observation, floors = solution.observation, noise_floor(solution.observation)
    found, exact = solution.noise.copy(), []
    for i, (label, count) in enumerate(
        zip(observation.layout.outputs, observation.counts, strict=True)
    ):
        if not count:
            found[i] = np.inf
        elif not np.isfinite(found[i]):
            raise InputError(used_up(count), element=f"output '{label}'")
        elif found[i] < floors[i]:
            found[i] = floors[i]
            exact.append(label)
    return found, exact


def minimum_norm(observation: Observation, units: Sequence[str]) -> Estimate:
    """Least squares with the smallest norm of ζ in scaled columns."""
    check(observation, units)
    triangle = observation.combined()
    degrees = float(triangle.rows - triangle.rank)
    check_rest(degrees)
    singular, rank = triangle.scaled_singular_values, triangle.rank
    root = pseudo_root(triangle.R, triangle.rows)
    values = root @ (triangle.R @ root).T @ triangle.qty
    left_over = triangle.R @ values - triangle.qty
    rest = float(left_over @ left_over) + triangle.residual**2
    directions = open_directions(triangle)
    covariance = rest / degrees * root @ root.T
    involved = np.flatnonzero(directions.any(axis=0))
    covariance[involved, involved] = np.inf
    solution = WeightedSolution(
        observation, np.ones(len(observation.counts)), triangle, values, root
    )
    texts = [direction_text(some, triangle.parameters) for some in directions]
    diagnostics = {
        "rank": rank,
        "open": texts,
        "condition": None if texts else triangle.condition,
        "scaled_condition": float(singular[0] / singular[rank - 1]) if rank else 1.0,
    }
    return replace(
        estimate_of(solution, "minimum norm", units, covariance, diagnostics),
        degrees=degrees,
    )


LEAST_SHARE = 0.6
"""Share of the rows within the clip, at least, that divides steps: above a half, so that they do not overshoot."""


def huber(
    rows: RowStream, *, clip: float = 1.345, tolerance: float = 1e-3, limit: int = 100
) -> Estimate:
    """Robust estimate with a scale for each output."""
    if not clip > 0:
        raise InputError(
            f"clip is {clip}; expected a positive number of standard deviations, such as 1.345"
        )
    observation = rows.observation()
    start = irls(observation, rows.units)
    values = start.values
    noise = np.where(
        np.isfinite(start.noise),
        np.maximum(start.noise, noise_floor(observation)),
        np.inf,
    )
    change, iterations = np.inf, 0
    while change > tolerance and iterations < limit:
        iterations += 1
        sweep = _swept(rows, values, noise, clip)
        share = np.maximum(sweep.share, LEAST_SHARE)
        bread = solved(observation, rows.units, np.sqrt(share) / noise)
        white = bread.root.T @ sweep.pull
        values = values + bread.root @ white
        new = _noise(sweep, solved(observation, rows.units, 1.0 / noise), noise, clip)
        change = max(
            float(np.linalg.norm(white)) / sqrt(len(values)), log_change(noise, new)
        )
        noise = new
    estimate = _finished(
        _swept(rows, values, noise, clip), observation, rows.units, values, noise, clip
    )
    course = {"iterations": iterations, "converged": bool(change <= tolerance)}
    return replace(estimate, diagnostics={**estimate.diagnostics, **course})


@dataclass(frozen=True)
class _ClippedSums:
    """Sums over all rows with clipped residuals, at given parameters and noise."""

    pull: Floats  # Σ Wᵀψ(r/σ)/σ, shape (n,)
    squares: Floats  # Σ ψ(r/σ)² of each output, shape (m,)
    share: Floats  # of each output's rows within the clip, shape (m,)


def _swept(rows: RowStream, values: Floats, noise: Floats, clip: float) -> _ClippedSums:
    m = len(noise)
    pull = np.zeros(len(values))
    squares = np.zeros(m)
    inside = np.zeros(m)
    counts = np.zeros(m)
    for block in rows.blocks():
        for i, (matrix, y) in enumerate(zip(block.matrices, block.y, strict=True)):
            columns = list(rows.layout.columns[i])
            residual = (y - matrix @ values[columns]) / noise[i]
            bounded = np.clip(residual, -clip, clip)
            pull[columns] += bounded @ matrix / noise[i]
            squares[i] += bounded @ bounded
            inside[i] += np.sum(np.abs(residual) <= clip)
            counts[i] += len(y)
    return _ClippedSums(
        pull, squares, np.where(counts > 0, inside / np.maximum(counts, 1.0), 1.0)
    )


def _noise(
    sweep: _ClippedSums, used: WeightedSolution, noise: Floats, clip: float
) -> Floats:
    """Proposal 2: the noise at which the mean of ψ² is what it is for Gaussian noise, shape (m,)."""
    counts = np.array(used.observation.counts, dtype=float)
    free = np.where(counts > 0, counts - used.leverages, 1.0)
    for label, count, rest in zip(
        used.observation.layout.outputs, used.observation.counts, free, strict=True
    ):
        if rest < ROUNDING * count:
            raise InputError(used_up(count), element=f"output '{label}'")
    some = np.isfinite(noise)
    found = np.where(some, noise, 1.0) * np.sqrt(
        sweep.squares / (free * gaussian_square(clip))
    )
    return np.where(some, np.maximum(found, noise_floor(used.observation)), np.inf)


def gaussian_square(clip: float) -> float:
    """Mean of min(z², clip²) for standard normal z."""
    inner = erf(clip / sqrt(2))
    return inner - clip * sqrt(2 / pi) * exp(-(clip**2) / 2) + clip**2 * (1 - inner)


def _finished(
    sweep: _ClippedSums,
    plain: Observation,
    units: Sequence[str],
    values: Floats,
    noise: Floats,
    clip: float,
) -> Estimate:
    """Values, and Huber's asymptotic covariance A⁻¹BA⁻¹ with the correction K for the number of parameters."""
    counts = np.maximum(np.array(plain.counts, dtype=float), 1.0)
    used = solved(plain, units, 1.0 / noise)
    share = sweep.share
    some = np.isfinite(noise)
    if (some & (share == 0)).any():
        label = plain.layout.outputs[int(np.argmax(some & (share == 0)))]
        raise InputError(
            f"no residual is within {clip} standard deviations; use a larger clip",
            element=f"output '{label}'",
        )
    correction = 1.0 + used.leverages / counts * (1.0 - share) / np.where(
        share > 0, share, 1.0
    )
    slopes = np.where(some, share / correction, 1.0)
    spread = sweep.squares / (counts - used.leverages)
    bread = solved(plain, units, np.sqrt(slopes) / noise)
    parts = [np.sqrt(spread[i]) * used.whitened(i) for i in range(len(noise))]
    # the rows of `parts` are whitened by `used`; R of `used` takes that back
    root = np.vstack(parts) @ used.triangle.R @ bread.inverse
    found = WeightedSolution(plain, 1.0 / noise, used.triangle, values, used.root)
    labels = plain.layout.outputs
    diagnostics = {
        "clip": clip,
        "clips": (clip * np.where(some, noise, 0.0)).tolist(),
        "slopes": slopes.tolist(),
        "downweighted": {
            label: float(1.0 - s)
            for label, s, there in zip(labels, share, some, strict=True)
            if there
        },
    }
    estimate = estimate_of(found, "huber", units, root.T @ root, diagnostics)
    return replace(estimate, noise=np.where(some, noise, np.nan))
