"""Pseudo-inertias: when ten parameters are those of a body that can exist, and how far two bodies are apart.

A rigid body has a density of mass that is not negative, so J = ∫ [x; 1] [x; 1]ᵀ dm is positive semidefinite, and every
J ≻ 0 belongs to some density (Wensing, Kim & Slotine, "Linear matrix inequalities for physically consistent inertial
parameter identification", 2018).  The map between the ten parameters and J is a linear bijection, so constraints on
bodies are linear matrix inequalities.  The Bregman divergence of −log det (Lee, Wensing & Park 2020) compares bodies
independently of units and frames: it sees only the eigenvalues of J J₀⁻¹.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.conventions import PER_BODY
from echelon.errors import InputError
from echelon.inertia.spatial import frame_change, parameter_array, pseudo_inertia

Array = npt.NDArray[Any]

SIZE = 4
"""Rows of a pseudo-inertia."""

_XX, _XY, _XZ, _YY, _YZ, _ZZ, _MX, _MY, _MZ, _M = range(PER_BODY)


def dual_matrix(coefficients: Array) -> Array:
    """The matrix S of a linear function of the ten parameters: c · ζ = tr(S J(ζ)).

    A function is not negative on all bodies that can exist exactly if S ⪰ 0.

    Parameters
    ----------
    coefficients : array of shape (..., 10)
        Floats, or objects that are exact and can be divided by 2.

    Returns
    -------
    array of shape (..., 4, 4)

    Examples
    --------
    >>> import numpy as np
    >>> from echelon.inertia.spatial import pseudo_inertia
    >>> c, body = np.arange(10.0), np.array([3, 0.1, 0, 4, 0, 5, 0.2, 0, 0, 2])
    >>> bool(np.isclose(c @ body, np.trace(dual_matrix(c) @ pseudo_inertia(body))))
    True
    """
    c = np.moveaxis(coefficients, -1, 0)
    rows = [
        [c[_YY] + c[_ZZ], -c[_XY] / 2, -c[_XZ] / 2, c[_MX] / 2],
        [-c[_XY] / 2, c[_XX] + c[_ZZ], -c[_YZ] / 2, c[_MY] / 2],
        [-c[_XZ] / 2, -c[_YZ] / 2, c[_XX] + c[_YY], c[_MZ] / 2],
        [c[_MX] / 2, c[_MY] / 2, c[_MZ] / 2, c[_M]],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def divergence(values: npt.ArrayLike, reference: npt.ArrayLike) -> Floats:
    """Bregman divergence of −log det: tr(J J₀⁻¹) − log det(J J₀⁻¹) − 4.

    Zero for equal bodies, infinite where J is not positive definite; convex in ``values``, the same in all frames.

    Parameters
    ----------
    values, reference : array of shape (..., 10)

    Returns
    -------
    array of shape (...)

    Raises
    ------
    InputError
        If a reference is not a body that can exist.

    Examples
    --------
    >>> ball = [0.4, 0, 0, 0.4, 0, 0.4, 0, 0, 0, 1]
    >>> float(divergence(ball, ball)), round(float(divergence([2 * x for x in ball], ball)), 6)
    (0.0, 1.227411)
    """
    whitened = whiten(values, factor(reference))
    eigenvalues = np.linalg.eigvalsh(whitened)
    with np.errstate(invalid="ignore", divide="ignore"):
        parts = np.where(eigenvalues > 0, eigenvalues - np.log(eigenvalues) - 1, np.inf)
    return np.asarray(np.maximum(parts.sum(axis=-1), 0.0))


def factor(values: npt.ArrayLike) -> Floats:
    """Lower triangle L with J = L Lᵀ, shape (..., 4, 4), in the body frame's units (m√kg, √kg).

    Raises
    ------
    InputError
        If a body cannot exist: its pseudo-inertia is not positive definite.
    """
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


def unwhitening(root: Floats) -> Floats:
    """The matrix that takes the ten parameters of K to those of J = L K Lᵀ, shape (10, 10)."""
    return np.asarray(frame_change(root), dtype=np.float64)


def margins(values: npt.ArrayLike, reference: npt.ArrayLike) -> Floats:
    """Smallest eigenvalue of each body's J relative to a reference body's, shape (...); not positive: cannot exist.

    Parameters
    ----------
    values, reference : array of shape (..., 10)
    """
    return np.asarray(np.linalg.eigvalsh(whiten(values, factor(reference)))[..., 0], dtype=np.float64)


def is_physical(values: npt.ArrayLike) -> npt.NDArray[np.bool_]:
    """Whether bodies can exist, with J ≻ 0 beyond rounding; shape (...).

    Parameters
    ----------
    values : array of shape (..., 10)
    """
    array = parameter_array(values)
    flat = array.reshape(-1, PER_BODY)
    return np.array([_definite(body) for body in flat], dtype=bool).reshape(array.shape[:-1])


def _definite(body: Floats) -> bool:
    try:
        unit = factor(body)
    except InputError:
        return False
    # the squares of L's diagonal are the exact pivots; those beneath rounding decide nothing
    pivots = np.square(np.diagonal(unit)) / np.diagonal(pseudo_inertia(body))
    return bool(pivots.min() > 16 * np.finfo(float).eps)


def exact_pseudo_inertia(body: Sequence[Any]) -> list[list[Any]]:
    """J of ten exact numbers of any kind that can be divided by 2, rows of shape (4, 4)."""
    xx, xy, xz, yy, yz, zz, mx, my, mz, m = body
    return [
        [(yy + zz - xx) / 2, -xy, -xz, mx],
        [-xy, (xx + zz - yy) / 2, -yz, my],
        [-xz, -yz, (xx + yy - zz) / 2, mz],
        [mx, my, mz, m],
    ]


def is_semidefinite(matrix: Sequence[Sequence[Any]] | Array, *, definite: bool = False) -> bool:
    """Whether an exact symmetric matrix is positive semidefinite, decided by LDLᵀ without any rounding.

    Parameters
    ----------
    matrix : array of shape (n, n)
        Fractions, FLINT rationals, or balls: with balls True is a proof, and False only means that none was found.
    definite : bool
        Ask for positive definite.
    """
    rest = [list(row) for row in matrix]
    for k in range(len(rest)):
        pivot = rest[k][k]
        if not pivot > 0:
            # a zero on the diagonal of a semidefinite matrix stands in a row of zeros
            if definite or not all(map(is_zero, rest[k][k:])):
                return False
            continue
        for i in range(k + 1, len(rest)):
            share = rest[i][k] / pivot
            for j in range(k + 1, len(rest)):
                rest[i][j] = rest[i][j] - share * rest[k][j]
    return True


def is_zero(x: Any) -> bool:
    """Whether a number is exactly zero; a ball around zero is not."""
    return bool(x == 0)
