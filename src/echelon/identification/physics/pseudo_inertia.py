"""Pseudo-inertias: when ten parameters are those of a body that can exist, and how far two bodies are apart.

A rigid body has a density of mass that is not negative, so J = ∫ [x; 1] [x; 1]ᵀ dm is positive semidefinite, and every
J ≻ 0 belongs to some density (Wensing, Kim & Slotine, "Linear matrix inequalities for physically consistent inertial
parameter identification", 2018).  The map between the ten parameters and J is a linear bijection, so constraints on
bodies are linear matrix inequalities.  The Bregman divergence of −log det (Lee, Wensing & Park 2020) compares bodies
independently of units and frames: it sees only the eigenvalues of J J₀⁻¹.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.inertia.spatial import parameter_array, pseudo_inertia

SIZE = 4
"""Rows of a pseudo-inertia."""


def divergence(values: npt.ArrayLike, reference: npt.ArrayLike) -> Floats:
    """Bregman divergence of −log det: tr(J J₀⁻¹) − log det(J J₀⁻¹) − 4.

    Zero for equal bodies, infinite where J is not positive definite; convex in ``values``, the same in all frames.
    """
    whitened = whiten(values, factor(reference))
    eigenvalues = np.linalg.eigvalsh(whitened)
    with np.errstate(invalid="ignore", divide="ignore"):
        parts = np.where(eigenvalues > 0, eigenvalues - np.log(eigenvalues) - 1, np.inf)
    return np.asarray(np.maximum(parts.sum(axis=-1), 0.0))


def factor(values: npt.ArrayLike) -> Floats:
    """Lower triangle L with J = L Lᵀ, shape (..., 4, 4), in the body frame's units (m√kg, √kg)."""
    array = parameter_array(values)
    # masses and lengths of any size: Cholesky of the matrix with ones on its diagonal decides relatively
    matrices = pseudo_inertia(array)
    diagonal = np.diagonal(matrices, axis1=-2, axis2=-1)
    if not (np.isfinite(array).all() and (diagonal > 0).all()):
        raise InputError("a pseudo-inertia is not positive definite: no body has these inertial parameters")
    scale: Floats = np.sqrt(diagonal)
    try:
        unit = np.linalg.cholesky(matrices / (scale[..., :, None] * scale[..., None, :]))
    except np.linalg.LinAlgError:
        raise InputError("a pseudo-inertia is not positive definite: no body has these inertial parameters") from None
    return np.asarray(scale[..., :, None] * unit, dtype=np.float64)


def whiten(values: npt.ArrayLike, root: Floats) -> Floats:
    """K = L⁻¹ J L⁻ᵀ, shape (..., 4, 4): the identity for the reference body itself, without units."""
    half = np.linalg.solve(root, pseudo_inertia(parameter_array(values)))
    whitened = np.linalg.solve(root, np.swapaxes(half, -1, -2))
    return np.asarray((whitened + np.swapaxes(whitened, -1, -2)) / 2, dtype=np.float64)


def margins(values: npt.ArrayLike, reference: npt.ArrayLike) -> Floats:
    """Smallest eigenvalue of each body's J relative to a reference body's, shape (...); not positive: cannot exist."""
    return np.asarray(np.linalg.eigvalsh(whiten(values, factor(reference)))[..., 0], dtype=np.float64)
