"""The lift: standard parameters that agree with given base parameters and stay near a prior.

ζ̂ = ζ₀ + B†(ζ̄ − B ζ₀) with B† = S Bᵀ (B S Bᵀ)⁻¹ is the member of {ζ : B ζ = ζ̄} nearest to ζ₀ in the norm of S⁻¹
(Theorem 1 of the paper).  The metric S never changes ζ̄ or the reduced regressor; it selects the lift.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
import numpy.typing as npt

from echelon.shared import Floats, InputError

Metric = Literal["identity", "physical"] | npt.ArrayLike


def metric_matrix(metric: Metric, degrees: Sequence[int], length: float) -> Floats:
    """The metric S as a matrix."""
    if isinstance(metric, str):
        if metric not in ("identity", "physical"):
            raise InputError(
                f"unknown metric '{metric}' (valid: identity, physical, or an array)"
            )
        if not 0 < length < np.inf:
            raise InputError(
                f"the characteristic length must be positive and finite, not {length}"
            )
        scale = [length**power if metric == "physical" else 1.0 for power in degrees]
        return np.diag(np.square(scale))
    parameters = len(degrees)
    matrix = np.asarray(metric, dtype=float)
    matrix = np.diag(matrix) if matrix.ndim == 1 else matrix
    if matrix.shape != (parameters, parameters):
        raise InputError(
            f"the metric has shape {matrix.shape}; expected ({parameters}, {parameters}) or its diagonal"
        )
    if (
        not np.allclose(matrix, matrix.T)
        or np.linalg.eigvalsh(matrix).min(initial=1.0) <= 0
    ):
        raise InputError("the metric must be symmetric and positive definite")
    return matrix


def pseudo_inverse_floats(b: Floats, metric: Floats) -> Floats:
    """B† = S Bᵀ (B S Bᵀ)⁻¹.  Shapes: b (r, n); metric (n, n); returns (n, r)."""
    # with S = L Lᵀ this is L pinv(B L), which avoids squaring the condition number
    root = np.linalg.cholesky(metric)
    found: Floats = root @ np.linalg.pinv(b @ root)
    return found


def lift(
    b: Floats,
    base_values: Floats,
    prior: Floats,
    metric: Floats,
) -> Floats:
    """Standard parameters nearest to a prior among those with given base parameters."""
    # shapes: b (r, n); base_values (r,); prior (n,); metric (n, n); returns (n,)
    # with S = L Lᵀ the correction is L pinv(B L) residual; least squares avoids squaring the condition number
    root = np.linalg.cholesky(metric)
    correction = np.linalg.lstsq(b @ root, base_values - b @ prior, rcond=None)[0]
    lifted: Floats = prior + root @ correction
    return lifted
