"""The ten standard parameters of a body as matrices and about another frame; which bodies can exist, and how far apart.

The pseudo-inertia J = ∫ [x; 1] [x; 1]ᵀ dm is a linear bijection of the ten parameters (Wensing, Kim & Slotine, "Linear
matrix inequalities for physically consistent inertial parameter identification", 2018).  A change of frame is a
congruence, J' = H J Hᵀ with the homogeneous H, so one short function serves floats and exact numbers alike.  A rigid
body has a density of mass that is not negative, so J is positive semidefinite, and every J ≻ 0 belongs to some density:
constraints on bodies are linear matrix inequalities.  The Bregman divergence of −log det (Lee, Wensing & Park 2020)
compares bodies independently of units and frames: it sees only the eigenvalues of J J₀⁻¹.
"""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.conventions import PER_BODY
from echelon.errors import InputError

Array = npt.NDArray[Any]

UPPER = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
"""Places of XX XY XZ YY YZ ZZ in the inertia tensor."""


def parameter_array(values: npt.ArrayLike) -> Floats:
    """Values as an array of floats with ten parameters in the last axis."""
    array = np.asarray(values, dtype=float)
    if array.ndim == 0 or array.shape[-1] != PER_BODY:
        raise InputError(f"expected {PER_BODY} parameters per body in the last axis, got shape {array.shape}")
    return array


def tensor_and_moment(values: Array) -> tuple[Array, Array, Array]:
    """Inertia tensor (..., 3, 3), first moments (..., 3) and mass (...) of standard parameters (..., 10)."""
    tensor = np.zeros((*values.shape[:-1], 3, 3), dtype=values.dtype)
    for k, (i, j) in enumerate(UPPER):
        tensor[..., i, j] = tensor[..., j, i] = values[..., k]
    return tensor, values[..., 6:9], values[..., 9]


def from_tensor(tensor: Array, moment: Array, mass: Array) -> Array:
    """Standard parameters (..., 10) of an inertia tensor about the frame's origin, first moments and mass."""
    return np.stack(
        [*(tensor[..., i, j] for i, j in UPPER), *(moment[..., k] for k in range(3)), np.asarray(mass)], axis=-1
    )


def pseudo_inertia(values: Array) -> Array:
    """Pseudo-inertia J = [[Σ, h], [hᵀ, m]] of standard parameters, with Σ = ½ tr(I) 1 − I."""
    # shapes: values (..., 10), floats or exact objects; returns (..., 4, 4)
    tensor, moment, mass = tensor_and_moment(values)
    half = Fraction(1, 2) if values.dtype == object else 0.5
    trace = (tensor[..., 0, 0] + tensor[..., 1, 1] + tensor[..., 2, 2]) * half
    pseudo = np.zeros((*values.shape[:-1], 4, 4), dtype=values.dtype)
    pseudo[..., :3, :3] = -tensor
    for k in range(3):
        pseudo[..., k, k] = trace - tensor[..., k, k]
    pseudo[..., :3, 3] = pseudo[..., 3, :3] = moment
    pseudo[..., 3, 3] = mass
    return pseudo


def from_pseudo_inertia(pseudo: Array) -> Array:
    """Standard parameters (..., 10) of a pseudo-inertia (..., 4, 4)."""
    second = pseudo[..., :3, :3]
    trace = second[..., 0, 0] + second[..., 1, 1] + second[..., 2, 2]
    tensor = -second
    for k in range(3):
        tensor[..., k, k] = trace - second[..., k, k]
    return from_tensor(tensor, pseudo[..., :3, 3], pseudo[..., 3, 3])


def spatial_inertia(values: npt.ArrayLike) -> Floats:
    """Featherstone's spatial inertia of standard parameters, as in spatial_v2: [[I, h×], [(h×)ᵀ, m 1]]."""
    # shapes: values (..., 10); returns (..., 6, 6)
    tensor, moment, mass = tensor_and_moment(parameter_array(values))
    spatial = np.zeros((*mass.shape, 6, 6))
    spatial[..., :3, :3] = tensor
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        spatial[..., i, 3 + j] = spatial[..., 3 + j, i] = -moment[..., k]
        spatial[..., j, 3 + i] = spatial[..., 3 + i, j] = moment[..., k]
        spatial[..., 3 + i, 3 + i] = mass
    return spatial


def from_spatial_inertia(spatial: npt.ArrayLike) -> Floats:
    """Standard parameters (..., 10) of a spatial inertia (..., 6, 6), angular part first."""
    array = np.asarray(spatial, dtype=float)
    moment = np.stack([array[..., 2, 4], array[..., 0, 5], array[..., 1, 3]], axis=-1)
    return from_tensor(array[..., :3, :3], moment, array[..., 3, 3])


def move(values: Array, homogeneous: Array) -> Array:
    """Parameters of the same body about the frame in which its own frame is placed: x_new = R x + t, m."""
    # shapes: values (..., 10); homogeneous (4, 4); returns (..., 10)
    return from_pseudo_inertia(homogeneous @ pseudo_inertia(values) @ homogeneous.T)


def frame_change(homogeneous: Array) -> Array:
    """The matrix T of :func:`move`: new parameters = T · parameters.  Shapes: homogeneous (4, 4); returns (10, 10)."""
    units = np.eye(PER_BODY, dtype=int).astype(homogeneous.dtype)
    return move(units, homogeneous).T


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
