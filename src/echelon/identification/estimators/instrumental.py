"""Instrumental variables: consistent although noise of the measured motion enters the regressor (IDIM-IV).

Instruments Z are the regressor along a motion that the noise does not touch, usually that of the model simulated with
the last estimate.  ζ = (ZᵀW)⁻¹Zᵀy is not formed from these products: with the R-factor of [Z W y],

    [Z W y] = Q [R_zz R_zw r_z; 0 R_ww r_w; 0 0 ρ],    ζ = R_zw⁻¹ r_z,    cov = σ² (R_zwᵀR_zw)⁻¹

so the condition number is not squared, and the data stream by block by block.  The same triangle holds the
Durbin–Wu–Hausman test: ρ² is what remains of y after both W and Z, and if Z explains significantly more than W alone,
the errors of W are correlated with those of y and least squares is biased.

Sources: Janot, Vandanjon & Gautier, IEEE Trans. Control Syst. Technol. 22, 2014 (IDIM-IV), and Control Eng. Practice
48, 2016 (the test, for robots); Wu, Econometrica 41, 1973; Hausman, Econometrica 46, 1978.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from typing import Any

import numpy as np

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.identification.estimators.estimate import Estimate
from echelon.identification.estimators.least_squares import used_up
from echelon.identification.estimators.solution import Solution, estimate_of, inverse_triangle, solved
from echelon.identification.estimators.weighted import checked_noise, irls, noise_floor
from echelon.identification.rows.rows import RowBlock, Rows
from echelon.observe.layout import Layout
from echelon.observe.observation import Observation
from echelon.observe.triangle import column_norms, upper_triangle

_NEW = 1e-10
_INNER, _INNER_LIMIT = 1e-9, 100


def instrumental(
    rows: Rows,
    instruments: Rows | Callable[[Floats], Rows],
    *,
    noise: Sequence[float] | Floats | None = None,
    start: Sequence[float] | Floats | None = None,
    tolerance: float = 1e-2,
    limit: int = 20,
) -> Estimate:
    """Instrumental-variable estimate.

    Parameters
    ----------
    rows : Rows
        Regressor W along the measured motion, and measured outputs.
    instruments : Rows, or function from array of shape (n,) to Rows
        Z: the same regressor along a motion without the noise of the measured one, with the same layout and the same
        rows in the same blocks; or a function that makes it from parameters, by simulating the model with them.  Their
        y is not looked at.
    noise : array of shape (m,), optional
        Standard deviation of each output's noise; found from the residuals if omitted.
    start : array of shape (n,), optional
        Parameters for the first instruments; the weighted least-squares estimate if omitted.
    tolerance : float
        Change of the parameters, in standard deviations, at which new instruments change nothing any more.
    limit : int
        Rounds of instruments at most; the diagnostics say ``converged: False`` if they were not enough.

    Returns
    -------
    Estimate
        Diagnostics: ``hausman``, the Durbin–Wu–Hausman statistic with ``hausman_degrees`` of its F distribution and
        ``hausman_probability``, the probability of a value so large if least squares had no bias;
        ``weakest_correlation``, the smallest canonical correlation of Z with W (near 0: weak instruments).

    Raises
    ------
    InputError
        If instruments do not fit the rows or do not determine all parameters.
    """
    observation = rows.observation()
    level = irls(observation, rows.units).noise if noise is None else checked_noise(observation, noise)
    level = np.where(np.isfinite(level), np.maximum(level, noise_floor(observation)), np.inf)
    values = solved(observation, rows.units, 1.0 / level).values if start is None else np.asarray(start, dtype=float)
    if values.shape != (len(rows.units),) or not np.isfinite(values).all():
        raise InputError(f"start must be {len(rows.units)} finite numbers, one for each parameter")
    for iteration in range(1, max(limit, 1) + 1):
        factors = _factors(rows, instruments(values) if callable(instruments) else instruments)
        found = _settled(observation, factors, level, fixed=noise is not None)
        change = float(np.linalg.norm(found.Rzw @ (found.values - values)) / np.sqrt(len(values)))
        values, level = found.values, found.noise
        course = {"iterations": iteration, "change": change}
        done = change <= tolerance or not callable(instruments)
        if done:
            break
    plain = solved(observation, rows.units, 1.0 / level)
    return _estimate(plain, found, rows.units, {**course, "converged": bool(done and found.settled)})


@dataclass(frozen=True)
class _Found:
    """Solution for given instruments."""

    values: Floats
    noise: Floats
    residuals: Floats
    Rzw: Floats
    Rww: Floats
    rest: float
    settled: bool = True  # the noise agrees with the residuals


def _factors(rows: Rows, instruments: Rows) -> list[Floats]:
    """R-factors of [Z_i W_i y_i], output by output."""
    layout = rows.layout
    if instruments.layout != layout:
        raise InputError("the instruments have other outputs or parameters than the rows")
    factors = [np.zeros((2 * size - 1, 2 * size - 1)) for size in layout.sizes]
    for block, other in zip_longest(rows.blocks(), instruments.blocks()):
        if block is None or other is None:
            raise InputError("the instruments come in more or fewer blocks than the rows")
        _same_rows(layout, block, other)
        for i, (Z, W, y) in enumerate(zip(other.matrices, block.matrices, block.y, strict=True)):
            factors[i] = upper_triangle(np.vstack([factors[i], np.column_stack([Z, W, y])]))
    for label, factor in zip(layout.outputs, factors, strict=True):
        if not np.isfinite(factor).all():
            raise InputError("rows or instruments contain numbers that are not finite", element=f"output '{label}'")
    return factors


def _same_rows(layout: Layout, block: RowBlock, other: RowBlock) -> None:
    for label, W, Z in zip(layout.outputs, block.matrices, other.matrices, strict=True):
        if W.shape != Z.shape:
            where = f"output '{label}' in segment {block.segment}"
            raise InputError(
                f"the instruments have {len(Z)} rows where the data have {len(W)}; expected the same rows of both",
                source=block.source,
                element=where,
            )


def _settled(observation: Observation, factors: list[Floats], level: Floats, *, fixed: bool) -> _Found:
    """Solve and, unless the noise is given, weigh anew until the weights agree with the residuals."""
    for _ in range(_INNER_LIMIT):
        found = _solved_with(observation, factors, level)
        if fixed:
            return replace(found, noise=level)
        with np.errstate(invalid="ignore"):
            change = float(np.nanmax(np.abs(np.log(found.noise / level)), initial=0.0))
        level = found.noise
        if change <= _INNER:
            return found
    return replace(found, settled=False)


def _solved_with(observation: Observation, factors: list[Floats], level: Floats) -> _Found:
    layout, n = observation.layout, len(observation.layout.parameters)
    stacked = []
    for columns, factor, sigma in zip(layout.columns, factors, level, strict=True):
        wide = np.zeros((len(factor), 2 * n + 1))
        wide[:, [*columns, *(n + c for c in columns), 2 * n]] = factor / sigma
        stacked.append(wide)
    T = upper_triangle(np.vstack(stacked))
    Rzz, Rzw, rz = T[:n, :n], T[:n, n : 2 * n], T[:n, 2 * n]
    scales = column_norms(T[: 2 * n, n : 2 * n])
    _check_strength(layout, Rzz, Rzw, scales, sum(observation.counts))
    values = np.linalg.solve(Rzw / scales, rz) / scales
    root = inverse_triangle(Rzz)
    misfits, floors = observation.misfits(values), noise_floor(observation)
    noise, spare = np.full(len(level), np.inf), np.zeros(len(level))
    for i, (columns, factor, count) in enumerate(zip(layout.columns, factors, observation.counts, strict=True)):
        some = len(columns)
        leverage = np.sum((factor[:some, :some] / level[i] @ root[list(columns)]) ** 2)
        spare[i] = count - leverage
        if count:
            if spare[i] < _NEW * count:
                raise InputError(used_up(count), element=f"output '{layout.outputs[i]}'")
            noise[i] = max(misfits[i] / np.sqrt(spare[i]), floors[i])
    residuals = np.where(np.isfinite(noise), misfits / np.sqrt(np.maximum(spare, _NEW)), np.nan)
    return _Found(values, noise, residuals, Rzw, T[n : 2 * n, n : 2 * n], float(T[2 * n, 2 * n]))


def _check_strength(layout: Layout, Rzz: Floats, Rzw: Floats, scales: Floats, rows: int) -> None:
    """Refuse instruments that are dependent, or not correlated with some combination of the parameters' columns."""
    precision = float(np.finfo(float).eps) * max(rows, len(scales))
    own = column_norms(Rzz)
    if (own == 0).any() or np.linalg.svd(Rzz / own, compute_uv=False)[-1] <= precision * len(own):
        raise InputError("the instruments do not determine all parameters: their motion excites too little")
    singular, directions = np.linalg.svd(Rzw / scales)[1:]
    if singular[-1] <= precision * singular[0]:
        worst = np.argsort(-np.abs(directions[-1]))[:3]
        names = ", ".join(layout.parameters[k] for k in worst)
        raise InputError(
            f"the instruments say nothing of a combination of {names}: they do not follow the measured motion"
        )


def _estimate(plain: Solution, found: _Found, units: Sequence[str], course: dict[str, Any]) -> Estimate:
    scales = column_norms(found.Rzw)
    root = np.linalg.inv(found.Rzw / scales) / scales[:, None]
    correlations = np.linalg.svd(found.Rzw @ plain.root, compute_uv=False)
    diagnostics = {**course, **_hausman(plain, found), "weakest_correlation": float(correlations[-1])}
    estimate = estimate_of(replace(plain, values=found.values), "instrumental", units, root @ root.T, diagnostics)
    return replace(estimate, noise=found.residuals)


def _hausman(plain: Solution, found: _Found) -> dict[str, Any]:
    """Wu's form of the test: whether Z adds to what W explains of y."""
    from scipy.stats import f

    new = np.linalg.svd(found.Rww / plain.triangle.scales, compute_uv=False)
    q = int(np.sum(new > _NEW))
    rest = plain.triangle.rows - len(plain.values) - q
    explained = max(plain.triangle.residual**2 - found.rest**2, 0.0)
    if q == 0 or rest <= 0 or found.rest == 0:
        return {"hausman": 0.0, "hausman_degrees": [q, rest], "hausman_probability": 1.0}
    statistic = explained / q / (found.rest**2 / rest)
    return {
        "hausman": float(statistic),
        "hausman_degrees": [q, rest],
        "hausman_probability": float(f.sf(statistic, q, rest)),
    }
