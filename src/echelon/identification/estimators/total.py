"""Total least squares: errors in the columns of W as well as in the outputs.

Noise of differentiated positions enters the regressor, and unknown drive gains put measured currents among its columns;
least squares is then biased towards zero.  The solution is read from the smallest singular vector of the R-factor of
[W y], its columns divided by the size of their errors.  Columns without errors (an offset, the sign of a velocity) are
first eliminated by QR, since dividing them by zero is no option: the mixed LS–TLS method.

Sources: Golub, Hoffman & Stewart, Linear Algebra Appl. 88/89, 1987 (exact columns); Van Huffel & Vandewalle, The Total
Least Squares Problem, SIAM, 1991; Fuller, Measurement Error Models, 1987, chapter 2 (covariance).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.identification.estimators.estimate import Estimate
from echelon.identification.estimators.solution import Solution, estimate_of, solved
from echelon.identification.estimators.weighted import checked_noise
from echelon.observe.observation import Observation
from echelon.observe.triangle import upper_triangle

_DISTINCT = 1e-8
"""Relative distance of singular values below which their vectors are arbitrary: √ε."""


def tls(
    observation: Observation,
    units: Sequence[str],
    *,
    errors: Sequence[float] | Floats | None = None,
    noise: Sequence[float] | Floats | None = None,
) -> Estimate:
    """Total least squares, with columns that may be exact.

    Parameters
    ----------
    observation : Observation
        Of m outputs and n parameters.
    units : sequence of str
        SI units of the n parameters.
    errors : array of shape (n,), optional
        Standard deviation of the errors in each column of W divided by that of the errors of y, in rows that were
        divided by their output's noise; 0 for exact columns.  If omitted, all columns and y have the same relative
        error: the ratio is that of their norms.
    noise : array of shape (m,), optional
        Factor of each output's errors; 1 if omitted.

    Returns
    -------
    Estimate
        Diagnostics: ``smallest_singular_values`` of the scaled [W y], ascending; ``gap``, how many times larger the
        smallest one is without y (1: no solution); ``deviation``, the estimated standard deviation of the errors of y.

    Raises
    ------
    InputError
        If the data do not determine all parameters, or the solution does not exist: the columns alone are as close to
        dependence as with y.
    """
    weights = None if noise is None else 1.0 / checked_noise(observation, noise)
    plain = solved(observation, units, weights)
    if plain.degrees <= 0:
        raise InputError("no row is left over to estimate the errors from; give more samples")
    scale = _errors(plain, errors)
    core = _core(plain, scale)
    K = np.eye(len(scale)) - core.smallest**2 * (scale[:, None] * plain.root).T @ (scale[:, None] * plain.root)
    variance = core.smallest**2 / plain.degrees
    covariance = _covariance(plain.root, K, core.values, scale, variance, plain.triangle.rows)
    diagnostics = {
        "iterations": 1,
        "converged": True,
        "errors": scale.tolist(),
        "deviation": float(np.sqrt(variance)),
        "smallest_singular_values": core.singular_values[::-1][:3].tolist(),
        "gap": core.gap,
    }
    return estimate_of(replace(plain, values=core.values), "tls", units, covariance, diagnostics)


@dataclass(frozen=True)
class _Core:
    """What the singular value decomposition says."""

    values: Floats
    singular_values: Floats
    smallest: float
    gap: float | None


def _errors(plain: Solution, errors: Sequence[float] | Floats | None) -> Floats:
    triangle = plain.triangle
    if errors is None:
        size = float(np.hypot(np.linalg.norm(triangle.qty), triangle.residual))
        if size == 0:
            raise InputError("all measured values are zero; there is nothing to estimate")
        return triangle.scales / size
    given = np.asarray(errors, dtype=float)
    if given.shape != triangle.scales.shape:
        raise InputError(f"errors have shape {given.shape}; expected ({len(triangle.scales)},), one for each parameter")
    if not np.isfinite(given).all() or (given < 0).any():
        raise InputError("errors must be finite and not negative; 0 says that a column is exact")
    return given


def _core(plain: Solution, scale: Floats) -> _Core:
    """Eliminate the exact columns, decompose the others with y, and go back."""
    triangle, n = plain.triangle, len(scale)
    exact, noisy = np.flatnonzero(scale == 0), np.flatnonzero(scale)
    whole = np.zeros((n + 1, n + 1))
    whole[:n, :n], whole[:n, n], whole[n, n] = triangle.R, triangle.qty, triangle.residual
    T = upper_triangle(whole[:, [*exact, *noisy, n]])
    e = len(exact)
    tail = T[e:, e:] / np.append(scale[noisy], 1.0)
    singular, vectors = np.linalg.svd(tail)[1:]
    alone = np.linalg.svd(tail[:, :-1], compute_uv=False)[-1] if len(noisy) else np.inf
    smallest = float(singular[-1])
    if not alone > smallest * (1 + _DISTINCT) or abs(vectors[-1, -1]) < _DISTINCT:
        names = [triangle.parameters[noisy[k]] for k in np.argsort(-np.abs(vectors[-1, :-1]))[:3]]
        raise InputError(
            f"total least squares has no solution here: columns with errors ({', '.join(names)}, …) are as close to "
            f"dependence without y as with it (smallest singular value {smallest:.3g}); name exact columns by "
            "errors of 0, or use ridge() towards a prior"
        )
    values = np.zeros(n)
    values[noisy] = -vectors[-1, :-1] / vectors[-1, -1] / scale[noisy]
    if e:
        from scipy.linalg import solve_triangular

        columns = np.linalg.norm(T[:e, :e], axis=0)
        right = T[:e, n] - T[:e, e:n] @ values[noisy]
        values[exact] = solve_triangular(T[:e, :e] / columns, right) / columns
    gap = float(alone / smallest) if len(noisy) and smallest > 0 else None
    return _Core(values, singular, smallest, gap)


def _covariance(root: Floats, K: Floats, values: Floats, scale: Floats, variance: float, rows: int) -> Floats:
    """M⁻¹σ_v² + N M⁻¹(Σ_uu σ_v² − Σ_uv Σ_vu)M⁻¹ with M = WᵀW less the errors' share and v the error of W ζ − y."""
    bias = scale**2 * values
    total = 1.0 + float(values @ bias)
    inverse = root @ np.linalg.solve(K, root.T)
    inner = rows * variance**2 * (np.diag(scale**2) * total - np.outer(bias, bias))
    covariance: Floats = variance * total * inverse + inverse @ inner @ inverse
    return covariance
