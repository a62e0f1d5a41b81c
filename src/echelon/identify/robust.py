"""Huber's M-estimate: gross errors of the outputs pull with a bounded force.

Residuals up to k σ_i count squared, larger ones by their absolute value, so that spikes, collisions and lost samples do
not ruin the fit while Gaussian noise costs next to nothing (95 % efficiency at k = 1.345).  The noise σ_i of each
output comes from Huber's Proposal 2 rather than from the median of the residuals: it needs sums only, so the data
stream by in constant memory, and for one output the criterion is jointly convex in ζ and σ, so that the start does not
matter.  Errors in the regressor itself (leverage points) are not resisted by any M-estimate.

Sources: Huber, Annals of Statistics 1, 1973 (covariance with correction); Huber, Robust Statistics, 1981, chapter 7.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import erf, exp, pi, sqrt

import numpy as np
import numpy.typing as npt

from echelon.errors import InputError
from echelon.identify.estimate import Estimate
from echelon.identify.least_squares import used_up
from echelon.identify.rows import Rows
from echelon.identify.solution import Solution, estimate_of, solved
from echelon.identify.weighted import irls, noise_floor
from echelon.observe.observation import Observation
from echelon.observe.triangle import upper_triangle

Floats = npt.NDArray[np.float64]


def huber(rows: Rows, *, clip: float = 1.345, tolerance: float = 1e-3, limit: int = 100) -> Estimate:
    """Robust estimate with a scale for each output.

    Parameters
    ----------
    rows : Rows
        They are gone through once per iteration.
    clip : float
        Residuals above ``clip`` times the output's noise are down-weighted.
    tolerance : float
        Change of the parameters, in standard deviations, and relative change of the noise at which the iteration has
        converged.
    limit : int
        Iterations at most; the diagnostics say ``converged: False`` if they were not enough.

    Returns
    -------
    Estimate
        ``noise`` is that of the good rows.  Diagnostics: ``downweighted``, the share of each output's rows beyond the
        clip (0.18 is normal for Gaussian noise and the default), ``iterations``, ``converged``.

    Raises
    ------
    InputError
        If the data do not determine all parameters, an output has no row to spare, or the clip is not positive.
    """
    if not clip > 0:
        raise InputError(f"clip is {clip}; expected a positive number of standard deviations, such as 1.345")
    observation = rows.observation()
    start = irls(observation, rows.units)
    values, noise = start.values, np.where(np.isfinite(start.noise), start.noise, np.inf)
    noise = np.maximum(noise, noise_floor(observation))
    change, iterations = np.inf, 0
    while change > tolerance and iterations < limit:
        iterations += 1
        sweep = _swept(rows, values, noise, clip)
        solution = solved(sweep.weighted, rows.units, 1.0 / noise)
        new = _noise(sweep, solution, noise, clip, noise_floor(observation))
        step = solution.triangle.R @ (solution.values - values) / sqrt(len(values))
        with np.errstate(invalid="ignore"):
            scale = np.nanmax(np.abs(np.log(new / noise)), initial=0.0)
        change = max(float(np.linalg.norm(step)), float(scale))
        values, noise = solution.values, new
    estimate = _finished(_swept(rows, values, noise, clip), observation, rows.units, values, noise, clip)
    course = {"iterations": iterations, "converged": bool(change <= tolerance)}
    return replace(estimate, diagnostics={**estimate.diagnostics, **course})


@dataclass(frozen=True)
class _Sweep:
    """What one pass over the rows finds at given parameters and noise."""

    weighted: Observation  # rows times the root of their Huber weight
    squares: Floats  # Σ ψ(r/σ)², shape (m,)
    inside: Floats  # rows within the clip, shape (m,)


def _swept(rows: Rows, values: Floats, noise: Floats, clip: float) -> _Sweep:
    layout = rows.layout
    factors = [np.zeros((size, size)) for size in layout.sizes]
    counts = np.zeros(len(factors), dtype=int)
    squares, inside = np.zeros(len(factors)), np.zeros(len(factors))
    for block in rows.blocks():
        for i, (matrix, y) in enumerate(zip(block.matrices, block.y, strict=True)):
            size = np.abs(matrix @ values[list(layout.columns[i])] - y) / noise[i]
            weight = np.sqrt(clip / np.maximum(size, clip))
            squares[i] += np.sum(np.minimum(size, clip) ** 2)
            inside[i] += np.sum(size <= clip)
            counts[i] += len(y)
            factors[i] = upper_triangle(np.vstack([factors[i], weight[:, None] * np.column_stack([matrix, y])]))
    return _Sweep(Observation(layout, tuple(factors), tuple(map(int, counts))), squares, inside)


def _noise(sweep: _Sweep, solution: Solution, noise: Floats, clip: float, floors: Floats) -> Floats:
    """Proposal 2: the noise at which the mean of ψ² is what it is for Gaussian noise, shape (m,)."""
    free = np.array(sweep.weighted.counts) - solution.leverages
    for label, count, rest in zip(sweep.weighted.layout.outputs, sweep.weighted.counts, free, strict=True):
        if count and rest < 1e-8 * count:
            raise InputError(used_up(count), element=f"output '{label}'")
    ratio = np.sqrt(sweep.squares / (np.maximum(free, 1e-300) * gaussian_square(clip)))
    some = np.isfinite(noise)
    return np.where(some, np.maximum(np.where(some, noise, 1.0) * ratio, floors), np.inf)


def gaussian_square(clip: float) -> float:
    """Mean of min(z², clip²) for standard normal z.

    Examples
    --------
    >>> round(gaussian_square(1.345), 4), round(gaussian_square(40.0), 4)
    (0.7102, 1.0)
    """
    inner = erf(clip / sqrt(2))
    return inner - clip * sqrt(2 / pi) * exp(-(clip**2) / 2) + clip**2 * (1 - inner)


def _finished(
    sweep: _Sweep, plain: Observation, units: Sequence[str], values: Floats, noise: Floats, clip: float
) -> Estimate:
    """Values, and Huber's asymptotic covariance A⁻¹BA⁻¹ with the correction K for the number of parameters."""
    counts = np.maximum(np.array(plain.counts, dtype=float), 1.0)
    used = solved(plain, units, 1.0 / noise)
    share = sweep.inside / counts
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
