"""First and second derivatives of sampled signals.

Three ways, because logs differ.  Central differences after a zero-phase low-pass are the field's custom and good when
the rate is far above the band.  Savitzky–Golay fits a polynomial to every window, which smooths and differentiates at
once.  A periodic motion is a Fourier series: its derivatives are exact, and all periods count.

Orientations are unit quaternions.  A quaternion and its negative are the same orientation, and logs jump between them:
the sign is made continuous first.  Then the four entries are filtered and differentiated like any signals.  What the
filter does to their length is undone by dividing by it; for motions far below the cut-off this is the smoothing on the
manifold itself, since the two differ by a term of third order in the angle turned within the filter's memory.
"""

from __future__ import annotations

from math import ceil

import numpy as np

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.signals.filters import by_channel, check_cutoff

Motion = tuple[Floats, Floats, Floats]

DEGREE = 4
"""Of Savitzky–Golay polynomials: the lowest even one that leaves room in the second derivative."""

CENTRAL_REACH = 2
"""Samples on either side that the second derivative by central differences depends on."""

_BLOCK = 1 << 14

_FAR_FROM_UNIT = 0.1
"""Largest deviation of a quaternion's length from 1 that rounding of a log can explain."""


def central(values: Floats, rate: float) -> Motion:
    """Values (N, …) and two derivatives by central differences, with one-sided ones of second order at the ends.

    The second derivative is the first one differentiated again, so that both are attenuated alike.
    """
    values = np.asarray(values, dtype=np.float64)
    if len(values) < 3:
        raise InputError(f"{len(values)} samples cannot be differentiated: at least 3 are needed")
    first = np.gradient(values, 1 / rate, axis=0, edge_order=2)
    return values, first, np.gradient(first, 1 / rate, axis=0, edge_order=2)


def savitzky_golay_window(cutoff: float, rate: float, degree: int = DEGREE) -> int:
    """Samples, an odd number, of the window of a Savitzky–Golay filter that takes 3 dB at the cut-off, Hz.

    Schafer's formula (IEEE Signal Processing Magazine 28(4), 2011) for even degrees n and 2M + 1 samples:
    cut-off = (n + 1) / (3.2 M − 4.6) of half the rate, right to a tenth.
    """
    check_cutoff(cutoff, rate)
    half = round(((degree + 1) * rate / (2 * cutoff) + 4.6) / 3.2)
    return 2 * max(half, degree // 2 + 1) + 1


def savitzky_golay(values: Floats, rate: float, cutoff: float, degree: int = DEGREE) -> Motion:
    """Smoothed values (N, …) and two derivatives from polynomials through a window around every sample."""
    from scipy.signal import savgol_filter

    window = savitzky_golay_window(cutoff, rate, degree)
    if len(values) < window:
        raise InputError(
            f"a Savitzky–Golay filter with a cut-off of {cutoff:g} Hz needs {window} samples, there are {len(values)}"
        )

    def derivative(order: int) -> Floats:
        def along_time(rows: Floats) -> Floats:
            found: Floats = savgol_filter(rows, window, degree, deriv=order, delta=1 / rate, axis=-1)
            return found

        return by_channel(along_time, values)

    return derivative(0), derivative(1), derivative(2)


def fourier(values: Floats, rate: float, period: float, cutoff: float = np.inf) -> Motion:
    """Values (N, …) and two derivatives of the Fourier series that fits a signal of this period, s, best.

    The signal covers at least a period, which need not be a whole number of samples.  The cut-off, Hz, ends the series.
    """
    values = np.asarray(values, dtype=np.float64)
    table = values.reshape(len(values), -1)
    if len(values) < period * rate - 1e-6:
        raise InputError(f"{len(values) / rate:g} s of samples do not cover the period of {period:g} s")
    harmonics = min(int(cutoff * period + 1e-9) if np.isfinite(cutoff) else len(values), _most(rate, period))
    omega = np.asarray(2 * np.pi / period * np.arange(1.0, harmonics + 1), dtype=np.float64)
    starts = range(0, len(table), _BLOCK)
    gram = np.zeros((2 * harmonics + 1, 2 * harmonics + 1))
    right = np.zeros((2 * harmonics + 1, table.shape[1]))
    for start in starts:
        basis = _basis(omega, start, table[start : start + _BLOCK], rate)
        gram += basis.T @ basis
        right += basis.T @ table[start : start + _BLOCK]
    series = np.asarray(np.linalg.solve(gram, right), dtype=np.float64)
    found = [np.empty_like(table) for _ in range(3)]
    for start in starts:
        basis = _basis(omega, start, table[start : start + _BLOCK], rate)
        for order, part in enumerate(found):
            part[start : start + _BLOCK] = basis @ _differentiated(series, omega, order)
    x, xd, xdd = (part.reshape(values.shape) for part in found)
    return x, xd, xdd


def _most(rate: float, period: float) -> int:
    """Harmonics below half the rate."""
    return ceil(rate * period / 2 - 1e-9) - 1


def _basis(omega: Floats, start: int, rows: Floats, rate: float) -> Floats:
    """1, cos and sin of all harmonics at the samples of a block."""
    angle = np.outer(np.arange(start, start + len(rows)) / rate, omega)
    return np.hstack([np.ones((len(rows), 1)), np.cos(angle), np.sin(angle)])


def _differentiated(series: Floats, omega: Floats, order: int) -> Floats:
    """Coefficients of 1, cos and sin after differentiation."""
    constant, cosines, sines = series[:1], series[1 : len(omega) + 1], series[len(omega) + 1 :]
    w = omega[:, None]
    if order == 0:
        return series
    if order == 1:
        return np.vstack([0 * constant, w * sines, -w * cosines])
    return np.vstack([0 * constant, -(w**2) * cosines, -(w**2) * sines])


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
