"""Least squares: ordinary, weighted, iteratively reweighted, and of smallest norm.

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
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.identification.estimators.estimate import (
    Estimate,
    Solution,
    check,
    direction_text,
    estimate_of,
    open_directions,
    solved,
)
from echelon.observe.observation import Observation
from echelon.observe.triangle import column_norms


def ols(observation: Observation, units: Sequence[str]) -> Estimate:
    """Ordinary least squares."""
    solution = solved(observation, units)
    if solution.degrees <= 0:
        raise InputError(
            f"{solution.triangle.rows} rows for {len(units)} parameters leave nothing over to estimate the noise from; "
            "give more samples"
        )
    variance = solution.triangle.residual**2 / solution.degrees
    diagnostics = {"iterations": 1, "converged": True, "deviation": float(np.sqrt(variance))}
    return estimate_of(solution, "ols", units, variance * solution.inverse, diagnostics)


def used_up(rows: int) -> str:
    """What to say of an output whose noise cannot be estimated."""
    return (
        f"its {rows} rows are all used up by parameters that only it shows, so its noise cannot be estimated: "
        "give more samples, leave it out, or give the noise to wls()"
    )


_FLOOR = 1e-8
"""Smallest noise relative to the output: no sensor is better, and weights stay within what double precision bears."""


def wls(
    observation: Observation, units: Sequence[str], noise: Sequence[float] | Floats, *, relative: bool = False
) -> Estimate:
    """Least squares with given noise."""
    solution = solved(observation, units, 1.0 / checked_noise(observation, noise))
    degrees = solution.degrees
    if relative and degrees <= 0:
        raise InputError("no row is left over to estimate the common factor of the noise from; give more samples")
    factor = solution.triangle.residual**2 / degrees if relative else 1.0
    diagnostics = {"iterations": 1, "converged": True, "relative": relative}
    return estimate_of(solution, "wls", units, factor * solution.inverse, diagnostics)


def irls(observation: Observation, units: Sequence[str], *, tolerance: float = 1e-9, limit: int = 100) -> Estimate:
    """Least squares with the noise of each output found from the residuals."""
    check(observation, units)
    noise, change, iterations = noise_estimate(observation), np.inf, 0
    while change > tolerance and iterations < limit:
        iterations += 1
        new, _ = _updated(solved(observation, units, 1.0 / noise))
        with np.errstate(invalid="ignore"):
            change = float(np.nanmax(np.abs(np.log(new / noise)), initial=0.0))
        noise = new
    solution = solved(observation, units, 1.0 / noise)
    _, exact = _updated(solution)
    diagnostics = {"iterations": iterations, "converged": bool(change <= tolerance), "exact_outputs": exact}
    return estimate_of(solution, "irls", units, solution.inverse, diagnostics)


def noise_estimate(observation: Observation) -> Floats:
    """Noise of each output when its own rows alone are fitted, shape (m,): a start that no unit or other output sways.

    Where an output has no more rows than parameters it is the root mean square of the output; infinite for outputs
    without rows.
    """
    levels = []
    for factor, count in zip(observation.factors, observation.counts, strict=True):
        n = len(factor) - 1
        scales = column_norms(factor[:, :n])
        columns, y = factor[:, :n] / np.where(scales == 0, 1.0, scales), factor[:, n]
        # without full rank the last entry is not the whole residual: that of the best fit is
        fit, _, rank, _ = np.linalg.lstsq(columns, y, rcond=np.finfo(float).eps * max(count, n))
        free, size = count - rank, np.linalg.norm(y) / np.sqrt(max(count, 1))
        rest = np.linalg.norm(columns @ fit - y)
        levels.append(np.inf if not count else rest / np.sqrt(free) if free > 0 else size)
    return np.maximum(levels, noise_floor(observation))


def noise_floor(observation: Observation) -> Floats:
    """Smallest noise that is believed, shape (m,): a tiny share of the output's root mean square."""
    floors = []
    for label, factor, count in zip(observation.layout.outputs, observation.factors, observation.counts, strict=True):
        size = float(np.linalg.norm(factor[:, -1])) / np.sqrt(max(count, 1))
        if count and size == 0 and factor.any():
            raise InputError("all its measured values are zero: leave it out", element=f"output '{label}'")
        floors.append(_FLOOR * size if size else 1.0)
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
            "the noise must be a positive number, or infinite to leave it out", element=f"output '{wrong}'"
        )
    return given


def _updated(solution: Solution) -> tuple[Floats, list[str]]:
    """Noise from the residuals, and the outputs that are fitted to rounding."""
    observation, floors = solution.observation, noise_floor(solution.observation)
    found, exact = solution.noise.copy(), []
    for i, (label, count) in enumerate(zip(observation.layout.outputs, observation.counts, strict=True)):
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
    if degrees <= 0:
        raise InputError("no row is left over to estimate the noise from; give more samples")
    scales = np.where(triangle.scales == 0, 1.0, triangle.scales)
    left, singular, right = np.linalg.svd(triangle.R / scales)
    rank = triangle.rank
    root = right[:rank].T / singular[:rank] / scales[:, None]
    beta = left.T @ triangle.qty
    values = root @ beta[:rank]
    rest = float(np.sum(beta[rank:] ** 2)) + triangle.residual**2
    directions = open_directions(triangle)
    covariance = rest / degrees * root @ root.T
    involved = np.flatnonzero(directions.any(axis=0))
    covariance[involved, involved] = np.inf
    solution = Solution(observation, np.ones(len(observation.counts)), triangle, values, root)
    texts = [direction_text(some, triangle.parameters) for some in directions]
    diagnostics = {
        "iterations": 1,
        "converged": True,
        "rank": rank,
        "open": texts,
        "condition": None if texts else triangle.condition,
        "scaled_condition": float(singular[0] / singular[rank - 1]) if rank else 1.0,
    }
    return replace(estimate_of(solution, "minimum norm", units, covariance, diagnostics), degrees=degrees)
