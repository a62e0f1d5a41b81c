"""Weighted least squares, with noise that is known or found from the residuals (iteratively reweighted).

Joints of a robot differ in noise by orders of magnitude, and forces and torques do not even share a unit, so each
output's rows are divided by its σ_i.  When the σ_i are not known, the fixed point of

    σ_i² = ‖W_i ζ − y_i‖² / (N_i − h_i),    h_i: leverage of the output's rows

solves the equations of restricted maximum likelihood (REML; Harville, J. Am. Stat. Assoc. 72, 1977), which counts the
degrees of freedom that the parameters use up where they are used up; N_i − n/m would not.  R-factors of the outputs
suffice for all of it: the data are gone through once.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.identification.estimators.estimate import Estimate
from echelon.identification.estimators.least_squares import used_up
from echelon.identification.estimators.solution import Solution, check, estimate_of, solved
from echelon.observe.observation import Observation
from echelon.observe.triangle import column_norms

_FLOOR = 1e-8
"""Smallest noise relative to the output: no sensor is better, and weights stay within what double precision bears."""


def wls(
    observation: Observation, units: Sequence[str], noise: Sequence[float] | Floats, *, relative: bool = False
) -> Estimate:
    """Least squares with given noise.

    Parameters
    ----------
    observation : Observation
        Of m outputs and n parameters.
    units : sequence of str
        SI units of the n parameters.
    noise : array of shape (m,)
        Standard deviation of each output's noise, in its unit; infinite leaves an output out.
    relative : bool
        The noise is known up to a common factor only, which is estimated; otherwise the covariance is (Σ
        W_iᵀW_i/σ_i²)⁻¹ as it stands, and the diagnostics say by χ² whether the residuals agree with the noise.

    Raises
    ------
    InputError
        If the data do not determine all parameters, or the noise is not positive or of a wrong shape.
    """
    solution = solved(observation, units, 1.0 / checked_noise(observation, noise))
    degrees = solution.degrees
    if relative and degrees <= 0:
        raise InputError("no row is left over to estimate the common factor of the noise from; give more samples")
    squares = solution.triangle.residual**2
    factor = squares / degrees if relative else 1.0
    diagnostics: dict[str, Any] = {"iterations": 1, "converged": True, "relative": relative}
    if not relative:
        from scipy.stats import chi2

        diagnostics["chi_squared"] = float(squares)
        diagnostics["chi_squared_probability"] = float(chi2.sf(squares, degrees)) if degrees > 0 else 1.0
    return estimate_of(solution, "wls", units, factor * solution.inverse, diagnostics)


def irls(observation: Observation, units: Sequence[str], *, tolerance: float = 1e-9, limit: int = 100) -> Estimate:
    """Least squares with the noise of each output found from the residuals.

    Parameters
    ----------
    observation : Observation
        Of m outputs and n parameters.
    units : sequence of str
        SI units of the n parameters.
    tolerance : float
        Relative change of the noise at which the iteration has converged.
    limit : int
        Iterations at most; the diagnostics say ``converged: False`` if they were not enough.

    Raises
    ------
    InputError
        If the data do not determine all parameters, or an output has no row to spare for an estimate of its noise.

    Examples
    --------
    Two gauges read the same length; the mean is weighted by their noise:

    >>> from echelon.observe.layout import Layout
    >>> from echelon.observe.triangle import upper_triangle
    >>> rng = np.random.default_rng(1)
    >>> readings = [2.0 + noise * rng.standard_normal(1000) for noise in (0.1, 1e-3)]
    >>> factors = [upper_triangle(np.stack([np.ones(1000), some], axis=1)) for some in readings]
    >>> layout = Layout(("coarse", "fine"), ("length",), ((0,), (0,)))
    >>> estimate = irls(Observation(layout, tuple(factors), (1000, 1000)), ("m",))
    >>> estimate.noise.round(4), estimate.std.round(7)
    (array([0.0988, 0.001 ]), array([3.24e-05]))
    """
    check(observation, units)
    noise, change, iterations = own_noise(observation), np.inf, 0
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


def own_noise(observation: Observation) -> Floats:
    """Noise of each output when its own rows alone are fitted, shape (m,): a start that no unit or other output sways.

    Where an output has no more rows than parameters it is the root mean square of the output; infinite for outputs
    without rows.
    """
    levels = []
    for factor, count in zip(observation.factors, observation.counts, strict=True):
        n = len(factor) - 1
        scales = column_norms(factor[:, :n])
        values = np.linalg.svd(factor[:n, :n] / np.where(scales == 0, 1.0, scales), compute_uv=False)
        precision = np.finfo(float).eps * max(count, n)
        rank = int(np.sum(values > precision * values[0])) if n else 0
        free = count - rank
        size = np.linalg.norm(factor[:, n]) / np.sqrt(max(count, 1))
        # without full rank the last entry is not the whole residual: that of the best fit is
        fit = np.linalg.lstsq(factor[:, :n] / np.where(scales == 0, 1.0, scales), factor[:, n], rcond=precision)[0]
        rest = np.linalg.norm(factor[:, :n] / np.where(scales == 0, 1.0, scales) @ fit - factor[:, n])
        levels.append(np.inf if not count else rest / np.sqrt(free) if free > 0 else size)
    floors = noise_floor(observation)
    return np.maximum(levels, floors)


def noise_floor(observation: Observation) -> Floats:
    """Smallest noise that is believed, shape (m,): a tiny share of the output's root mean square.

    Raises
    ------
    InputError
        If an output's measured values are all zero although the model says that it depends on the parameters.
    """
    floors = []
    for label, factor, count in zip(observation.layout.outputs, observation.factors, observation.counts, strict=True):
        size = float(np.linalg.norm(factor[:, -1])) / np.sqrt(max(count, 1))
        if count and size == 0 and factor.any():
            raise InputError("all its measured values are zero: leave it out", element=f"output '{label}'")
        floors.append(_FLOOR * size if size else 1.0)
    return np.array(floors)


def checked_noise(observation: Observation, noise: Sequence[float] | Floats) -> Floats:
    """Noise of the outputs, shape (m,).

    Raises
    ------
    InputError
        If it has a wrong shape or is not positive.
    """
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
