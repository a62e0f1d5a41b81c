"""First and second derivatives of sampled signals.

Three ways, because logs differ.  Central differences after a zero-phase low-pass are the field's custom and good when
the rate is far above the band.  Savitzky–Golay fits a polynomial to every window, which smooths and differentiates at
once.  A periodic motion is a Fourier series: its derivatives are exact, and all periods vote.
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


def central(values: Floats, rate: float) -> Motion:
    """Derivatives by central differences, and one-sided ones of second order at the ends.

    The second derivative is the first one differentiated again, so that both are attenuated alike.

    Parameters
    ----------
    values : array of shape (N, …)
    rate : float
        Samples per second.

    Returns
    -------
    x, xd, xdd : arrays of shape (N, …)

    Raises
    ------
    InputError
        If there are fewer than three samples.

    Examples
    --------
    >>> import numpy as np
    >>> x, xd, xdd = central(np.arange(6) ** 2.0, rate=1)
    >>> xd.tolist(), xdd.tolist()
    ([0.0, 2.0, 4.0, 6.0, 8.0, 10.0], [2.0, 2.0, 2.0, 2.0, 2.0, 2.0])
    """
    values = np.asarray(values, dtype=np.float64)
    if len(values) < 3:
        raise InputError(f"{len(values)} samples cannot be differentiated: at least 3 are needed")
    first = np.gradient(values, 1 / rate, axis=0, edge_order=2)
    return values, first, np.gradient(first, 1 / rate, axis=0, edge_order=2)


def savitzky_golay_window(cutoff: float, rate: float, degree: int = DEGREE) -> int:
    """Samples of the window of a Savitzky–Golay filter that takes 3 dB at a frequency.

    Schafer's formula (IEEE Signal Processing Magazine 28(4), 2011): with n the degree and 2M + 1 samples,
    cut-off = (n + 1) / (3.2 M − 4.6) of half the rate, right to a tenth.

    Parameters
    ----------
    cutoff, rate : float
        Hz, and samples per second.
    degree : int
        Of the polynomials; the formula is for even ones.

    Returns
    -------
    int
        Odd, and large enough for the degree.

    Raises
    ------
    InputError
        If the cut-off is not between zero and half the rate.

    Examples
    --------
    >>> savitzky_golay_window(cutoff=20, rate=1000)
    81
    """
    check_cutoff(cutoff, rate)
    half = round(((degree + 1) * rate / (2 * cutoff) + 4.6) / 3.2)
    return 2 * max(half, degree // 2 + 1) + 1


def savitzky_golay(values: Floats, rate: float, cutoff: float, degree: int = DEGREE) -> Motion:
    """Smoothed values and derivatives from polynomials that are fitted to a window around every sample.

    Parameters
    ----------
    values : array of shape (N, …)
    rate : float
        Samples per second.
    cutoff : float
        Where smoothing takes 3 dB, Hz; see :func:`savitzky_golay_window`.
    degree : int

    Returns
    -------
    x, xd, xdd : arrays of shape (N, …)
        At the ends from the polynomials of the first and last whole window.

    Raises
    ------
    InputError
        If the cut-off is impossible or there are fewer samples than the window has.
    """
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
    """Values and derivatives of the Fourier series that fits a periodic signal best.

    The signal may cover any time from one period on, and a period need not be a whole number of samples.

    Parameters
    ----------
    values : array of shape (N, …)
    rate : float
        Samples per second.
    period : float
        Seconds.
    cutoff : float
        Highest harmonic's frequency, Hz; at most just below half the rate.

    Returns
    -------
    x, xd, xdd : arrays of shape (N, …)

    Raises
    ------
    InputError
        If the samples do not cover a period.
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
