"""Errors in the regressor: total least squares and instrumental variables.

Total least squares: errors in the columns of W as well as in the outputs.

Noise of differentiated positions enters the regressor, and unknown drive gains put measured currents among its columns;
least squares is then biased towards zero.  The solution is read from the smallest singular vector of the R-factor of
[W y], its columns divided by the size of their errors: the same share of every column as of y.

Sources: Van Huffel & Vandewalle, The Total Least Squares Problem, SIAM, 1991; Fuller, Measurement Error Models, 1987,
chapter 2 (covariance).

Instrumental variables: consistent although noise of the measured motion enters the regressor (IDIM-IV).

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

from echelon.compute import Layout, Observation, Triangle, column_norms, upper_triangle
from echelon.identification.estimators.estimate import (
    ROUNDING,
    Estimate,
    WeightedSolution,
    augmented,
    check_rest,
    estimate_of,
    inverse_triangle,
    solved,
)
from echelon.identification.estimators.least_squares import (
    fixed_noise,
    irls,
    noise_floor,
    used_up,
)
from echelon.identification.rows.rows import RowBlock, RowStream
from echelon.shared import Floats, InputError, extra


def tls(observation: Observation, units: Sequence[str]) -> Estimate:
    """Total least squares."""
    plain = solved(observation, units)
    check_rest(plain.degrees)
    triangle = plain.triangle
    size = float(np.hypot(np.linalg.norm(triangle.qty), triangle.residual))
    if size == 0:
        raise InputError("all measured values are zero; there is nothing to estimate")
    scale = triangle.scales / size
    values, singular, gap = _smallest(triangle, scale)
    K = np.eye(len(scale)) - singular[-1] ** 2 * (scale[:, None] * plain.root).T @ (
        scale[:, None] * plain.root
    )
    variance = float(singular[-1] ** 2 / plain.degrees)
    covariance = _tls_covariance(plain.root, K, values, scale, variance, triangle.rows)
    diagnostics = {
        "errors": scale.tolist(),
        "deviation": float(np.sqrt(variance)),
        "smallest_singular_values": singular[::-1][:3].tolist(),
        "gap": gap,
    }
    return estimate_of(
        replace(plain, values=values), "tls", units, covariance, diagnostics
    )


def _smallest(triangle: Triangle, scale: Floats) -> tuple[Floats, Floats, float | None]:
    """Values by the smallest singular vector, all singular values, and by how much those without y are larger."""
    whole = augmented(triangle) / np.append(scale, 1.0)
    singular, vectors = np.linalg.svd(whole)[1:]
    alone = np.linalg.svd(whole[:, :-1], compute_uv=False)[-1]
    if not alone > singular[-1] * (1 + ROUNDING) or abs(vectors[-1, -1]) < ROUNDING:
        names = [
            triangle.parameters[k] for k in np.argsort(-np.abs(vectors[-1, :-1]))[:3]
        ]
        raise InputError(
            f"total least squares has no solution here: columns ({', '.join(names)}, …) are as close to dependence "
            f"without y as with it (smallest singular value {singular[-1]:.3g}); use ridge() towards a prior"
        )
    values = -vectors[-1, :-1] / vectors[-1, -1] / scale
    return values, singular, float(alone / singular[-1]) if singular[-1] > 0 else None


def _tls_covariance(
    root: Floats, K: Floats, values: Floats, scale: Floats, variance: float, rows: int
) -> Floats:
    """M⁻¹σ_v² + N M⁻¹(Σ_uu σ_v² − Σ_uv Σ_vu)M⁻¹ with M = WᵀW less the errors' share and v the error of W ζ − y."""
    bias = scale**2 * values
    total = 1.0 + float(values @ bias)
    inverse = root @ np.linalg.solve(K, root.T)
    inner = rows * variance**2 * (np.diag(scale**2) * total - np.outer(bias, bias))
    return variance * total * inverse + inverse @ inner @ inverse


def instrumental(
    rows: RowStream,
    instruments: RowStream | Callable[[Floats], RowStream],
    *,
    tolerance: float = 1e-2,
    limit: int = 20,
) -> Estimate:
    """Instrumental-variable estimate; instruments may be those that the last estimate simulates.

    These are simulated until values change by no more than a tolerance, in standard deviations.
    """
    observation = rows.observation()
    level = irls(observation, rows.units).noise
    level = np.where(
        np.isfinite(level), np.maximum(level, noise_floor(observation)), np.inf
    )
    values = solved(observation, rows.units, 1.0 / level).values
    for iteration in range(1, limit + 1):
        factors = _factors(
            rows, instruments(values) if callable(instruments) else instruments
        )
        found = _settled(observation, factors, level)
        change = float(
            np.linalg.norm(found.Rzw @ (found.values - values)) / np.sqrt(len(values))
        )
        values, level = found.values, found.noise
        course = {"iterations": iteration, "change": change}
        done = change <= tolerance or not callable(instruments)
        if done:
            break
    plain = solved(observation, rows.units, 1.0 / level)
    return _iv_estimate(
        plain, found, rows.units, {**course, "converged": bool(done and found.settled)}
    )


@dataclass(frozen=True)
class _Instrumented:
    """Solution for given instruments."""

    values: Floats
    noise: Floats
    residuals: Floats
    Rzw: Floats
    Rww: Floats
    rest: float
    settled: bool = True  # the noise agrees with the residuals


def _factors(rows: RowStream, instruments: RowStream) -> list[Floats]:
    """R-factors of [Z_i W_i y_i], output by output."""
    layout = rows.layout
    if instruments.layout != layout:
        raise InputError(
            "the instruments have other outputs or parameters than the rows"
        )
    factors = [np.zeros((2 * size - 1, 2 * size - 1)) for size in layout.sizes]
    for block, other in zip_longest(rows.blocks(), instruments.blocks()):
        if block is None or other is None:
            raise InputError(
                "the instruments come in more or fewer blocks than the rows"
            )
        _same_rows(layout, block, other)
        for i, (Z, W, y) in enumerate(
            zip(other.matrices, block.matrices, block.y, strict=True)
        ):
            factors[i] = upper_triangle(
                np.vstack([factors[i], np.column_stack([Z, W, y])])
            )
    for label, factor in zip(layout.outputs, factors, strict=True):
        if not np.isfinite(factor).all():
            raise InputError(
                "rows or instruments contain numbers that are not finite",
                element=f"output '{label}'",
            )
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


def _settled(
    observation: Observation, factors: list[Floats], level: Floats
) -> _Instrumented:
    """Solve and weigh anew until the weights agree with the residuals."""

    def updated(noise: Floats) -> Floats:
        return _solved_with(observation, factors, noise).noise

    noise, _, settled = fixed_noise(updated, level)
    return replace(_solved_with(observation, factors, noise), settled=settled)


def _solved_with(
    observation: Observation, factors: list[Floats], level: Floats
) -> _Instrumented:
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
    for i, (columns, factor, count) in enumerate(
        zip(layout.columns, factors, observation.counts, strict=True)
    ):
        some = len(columns)
        leverage = np.sum((factor[:some, :some] / level[i] @ root[list(columns)]) ** 2)
        spare[i] = count - leverage
        if count:
            if spare[i] < ROUNDING * count:
                raise InputError(
                    used_up(count), element=f"output '{layout.outputs[i]}'"
                )
            noise[i] = max(misfits[i] / np.sqrt(spare[i]), floors[i])
    residuals = np.where(
        np.isfinite(noise), misfits / np.sqrt(np.maximum(spare, ROUNDING)), np.nan
    )
    return _Instrumented(
        values, noise, residuals, Rzw, T[n : 2 * n, n : 2 * n], float(T[2 * n, 2 * n])
    )


def _check_strength(
    layout: Layout, Rzz: Floats, Rzw: Floats, scales: Floats, rows: int
) -> None:
    """Refuse instruments that are dependent, or not correlated with some combination of the parameters' columns."""
    precision = float(np.finfo(float).eps) * max(rows, len(scales))
    own = column_norms(Rzz)
    if (own == 0).any() or np.linalg.svd(Rzz / own, compute_uv=False)[
        -1
    ] <= precision * len(own):
        raise InputError(
            "the instruments do not determine all parameters: their motion excites too little"
        )
    singular, directions = np.linalg.svd(Rzw / scales)[1:]
    if singular[-1] <= precision * singular[0]:
        worst = np.argsort(-np.abs(directions[-1]))[:3]
        names = ", ".join(layout.parameters[k] for k in worst)
        raise InputError(
            f"the instruments do not determine a combination of {names}: they do not follow the measured motion"
        )


def _iv_estimate(
    plain: WeightedSolution,
    found: _Instrumented,
    units: Sequence[str],
    course: dict[str, Any],
) -> Estimate:
    scales = column_norms(found.Rzw)
    root = np.linalg.inv(found.Rzw / scales) / scales[:, None]
    correlations = np.linalg.svd(found.Rzw @ plain.root, compute_uv=False)
    diagnostics = {
        **course,
        **_hausman(plain, found),
        "weakest_correlation": float(correlations[-1]),
    }
    estimate = estimate_of(
        replace(plain, values=found.values),
        "instrumental",
        units,
        root @ root.T,
        diagnostics,
    )
    return replace(estimate, noise=found.residuals)


def _hausman(plain: WeightedSolution, found: _Instrumented) -> dict[str, Any]:
    """Wu's form of the test: whether Z adds to what W explains of y."""
    with extra("identify"):
        from scipy.stats import f

    new = np.linalg.svd(found.Rww / plain.triangle.scales, compute_uv=False)
    q = int(np.sum(new > ROUNDING))
    rest = plain.triangle.rows - len(plain.values) - q
    explained = max(plain.triangle.residual**2 - found.rest**2, 0.0)
    if q == 0 or rest <= 0 or found.rest == 0:
        return {
            "hausman": 0.0,
            "hausman_degrees": [q, rest],
            "hausman_probability": 1.0,
        }
    statistic = explained / q / (found.rest**2 / rest)
    return {
        "hausman": float(statistic),
        "hausman_degrees": [q, rest],
        "hausman_probability": float(f.sf(statistic, q, rest)),
    }
