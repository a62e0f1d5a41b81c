"""First and second derivatives of sampled signals.

The derivatives of a polynomial of degree 8 through nine neighbouring samples: of all differentiators of its length the
flattest.  Up to a sixth of the rate their gain is right to two thousandths, where three samples miss the first one
by a sixth; so they fit logs of 30 Hz as well as of 5 kHz, and cost four samples at each end.  They smooth nothing:
noise is the business of the low-pass before them.  Weights: Fornberg, Math. Comp. 51, 1988.

Orientations are unit quaternions.  A quaternion and its negative are the same orientation, and logs jump between them:
the sign is made continuous first.  Then the four entries are filtered and differentiated like any signals.  What the
filter does to their length is undone by dividing by it; for motions far below the cut-off this is the smoothing on the
manifold itself, since the two differ by a term of third order in the angle turned within the filter's memory.
"""

from __future__ import annotations

import numpy as np

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.extras import extra

_WEIGHTS = {
    1: np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280]),
    2: np.array([-1 / 560, 8 / 315, -1 / 5, 8 / 5, -205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560]),
}

REACH = 4
"""Samples on either side that derivatives depend on."""

_FAR_FROM_UNIT = 0.1
"""Largest deviation of a quaternion's length from 1 that rounding of a log can explain."""


def derivative(values: Floats, rate: float, order: int = 1) -> Floats:
    """First or second derivative of values (N, …), which beyond their ends continue turned about them."""
    with extra("identify"):
        from scipy.ndimage import correlate1d

    widths = [(REACH, REACH)] + [(0, 0)] * (np.ndim(values) - 1)
    longer = np.pad(np.asarray(values, dtype=np.float64), widths, mode="reflect", reflect_type="odd")
    found: Floats = correlate1d(longer, _WEIGHTS[order] * rate**order, axis=0)[REACH:-REACH]
    return found


def derivatives(values: Floats, rate: float) -> tuple[Floats, Floats]:
    """First and second derivative of values (N, …)."""
    return derivative(values, rate), derivative(values, rate, 2)


def continuous(q: Floats, before: Floats | None = None) -> Floats:
    """Unit quaternions (N, 4) as w, x, y, z, whose sign does not jump, nor from the one before."""
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
    """Unit quaternions (N, 4), angular velocities and accelerations (N, 3), rad/s, rad/s², in the moved body's axes.

    ω = 2 q* ⊗ q̇ and its derivative, of which the parts along q, that is changes of length, count for nothing.
    """
    square = np.sum(q * q, axis=1, keepdims=True)
    conjugate = q * np.array([1.0, -1.0, -1.0, -1.0])
    first = multiply(conjugate, qd) / square
    second = multiply(conjugate, qdd) / square
    growth = 2 * first[:, :1]
    omega = 2 * first[:, 1:]
    return q / np.sqrt(square), omega, 2 * second[:, 1:] - growth * omega
