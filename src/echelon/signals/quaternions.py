"""Orientations: unit quaternions as signals, and the angular velocity that they imply.

A quaternion and its negative are the same orientation, and logs jump between them: the sign is made continuous first.
Then the four entries can be filtered and differentiated like any signals.  What the filter does to their length is
undone by dividing by it; for motions far below the cut-off this is the smoothing on the manifold itself, since the
deviation between the two is of third order in the angle turned within the filter's memory.
"""

from __future__ import annotations

import numpy as np

from echelon.arrays import Floats
from echelon.errors import InputError

_FAR_FROM_UNIT = 0.1
"""Largest deviation of a quaternion's length from 1 that rounding of a log can explain."""


def continuous(q: Floats, before: Floats | None = None) -> Floats:
    """Quaternions of unit length whose sign does not jump.

    Parameters
    ----------
    q : array of shape (N, 4)
        w, x, y, z.
    before : array of shape (4,), optional
        The quaternion before the first one, whose sign is continued.

    Raises
    ------
    InputError
        If a quaternion is far from unit length.

    Examples
    --------
    >>> import numpy as np
    >>> continuous(np.array([[0.6, 0.8, 0, 0], [-0.6, -0.8, 0, 0]]))[:, :2].tolist()
    [[0.6, 0.8], [0.6, 0.8]]
    """
    length = np.linalg.norm(q, axis=1)
    wrong = np.flatnonzero(~(np.abs(length - 1) < _FAR_FROM_UNIT))
    if len(wrong):
        worst = f"sample {wrong[0]} has a quaternion of length {length[wrong[0]]:.3g}"
        raise InputError(f"{worst}: expected unit quaternions (w, x, y, z)")
    unit = q / length[:, None]
    first = unit[0] if before is None else before
    inner = np.einsum("ij,ij->i", unit, np.vstack([first, unit[:-1]]))
    signs = np.cumprod(np.where(inner < 0, -1.0, 1.0))
    return np.asarray(unit * signs[:, None], dtype=np.float64)


def multiply(a: Floats, b: Floats) -> Floats:
    """Products of quaternions, shape (N, 4); the rotation b comes first."""
    w, v = a[..., :1], a[..., 1:]
    u, t = b[..., :1], b[..., 1:]
    scalar = w * u - np.sum(v * t, axis=-1, keepdims=True)
    return np.concatenate([scalar, w * t + u * v + np.cross(v, t)], axis=-1)


def body_rates(q: Floats, qd: Floats, qdd: Floats) -> tuple[Floats, Floats, Floats]:
    """Unit quaternions with the angular velocity and acceleration in the moved body's axes.

    ω = 2 q* ⊗ q̇ and its derivative, of which the parts along q, that is changes of length, count for nothing.

    Parameters
    ----------
    q, qd, qdd : arrays of shape (N, 4)
        Entries w, x, y, z of the quaternions (child in parent) and their derivatives; of any length.

    Returns
    -------
    q : array of shape (N, 4)
        Of unit length.
    omega : array of shape (N, 3)
        rad/s.
    alpha : array of shape (N, 3)
        rad/s².

    Examples
    --------
    >>> import numpy as np
    >>> q, qd, qdd = np.array([[1.0, 0, 0, 0]]), np.array([[0, 0, 0, 0.5]]), np.array([[-0.25, 0, 0, 0]])
    >>> body_rates(q, qd, qdd)[1].tolist(), body_rates(q, qd, qdd)[2].tolist()    # 1 rad/s about z
    ([[0.0, 0.0, 1.0]], [[0.0, 0.0, 0.0]])
    """
    square = np.sum(q * q, axis=1, keepdims=True)
    conjugate = q * np.array([1.0, -1.0, -1.0, -1.0])
    first = multiply(conjugate, qd) / square
    second = multiply(conjugate, qdd) / square
    growth = 2 * first[:, :1]
    omega = 2 * first[:, 1:]
    return q / np.sqrt(square), omega, 2 * second[:, 1:] - growth * omega
