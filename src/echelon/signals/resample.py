"""Signals on another clock: interpolation, and a low-pass first where the new clock is slower.

Positions of a robot are smooth on the scale of a sample, so a cubic spline through them has an error of fourth order
in the period; schemes that never overshoot (Akima, monotone Hermite) fall back to the second order at every turning
point, where accelerations are largest.  A slower clock would fold what lies above half its rate into the band of the
motion, so a symmetric windowed-sinc filter (no phase, stop band at −80 dB) takes that away first.
"""

from __future__ import annotations

import numpy as np

from echelon.arrays import Floats

SLOWER = 0.99
"""Rates below this share of the old one need the low-pass."""

_ATTENUATION = 80.0
_PASSED = 0.8


def grid(first: float, last: float, rate: float) -> Floats:
    """Uniform times from the first on, not beyond the last, as offsets from the first.

    Parameters
    ----------
    first, last : float
        In s.
    rate : float
        In Hz.

    Examples
    --------
    >>> grid(5.0, 5.35, 10.0).tolist()
    [0.0, 0.1, 0.2, 0.3]
    """
    rounding = 1e-6 + 4 * rate * float(np.spacing(max(abs(first), abs(last))))
    times: Floats = np.arange(int((last - first) * rate + rounding) + 1) / rate
    return times


def interpolated(time: Floats, values: Floats, wanted: Floats) -> Floats:
    """Values between samples by a cubic spline (lines and parabolas where there are fewer than four).

    Parameters
    ----------
    time : array of shape (N,)
        Increasing.
    values : array of shape (N, …)
        Finite.
    wanted : array of shape (M,)
        Within the span of ``time``, to rounding.

    Returns
    -------
    array of shape (M, …)
    """
    from scipy.interpolate import make_interp_spline

    if len(time) < 2:
        return np.broadcast_to(values[:1], (len(wanted), *values.shape[1:])).copy()
    # an odd degree, because not-a-knot splines need one knot less per degree than there are samples
    degree = 3 if len(time) > 3 else 1
    result: Floats = np.asarray(make_interp_spline(time, values, degree)(np.clip(wanted, time[0], time[-1])))
    return result


def low_passed(values: Floats, ratio: float) -> Floats:
    """Take away what a slower clock could not show, without phase.

    Passes up to 0.8 of half the new rate; at half the new rate, and beyond, the gain is below 1e-4.  The ends are
    continued by point reflection.

    Parameters
    ----------
    values : array of shape (N, …)
    ratio : float
        New rate by old rate, below one.

    Returns
    -------
    array of the same shape
    """
    from scipy.signal import firwin, kaiserord, oaconvolve

    taps, beta = kaiserord(_ATTENUATION, (1 - _PASSED) * ratio)
    half = taps // 2
    window = firwin(2 * half + 1, (1 + _PASSED) / 2 * ratio, window=("kaiser", beta))
    widths = [(half, half)] + [(0, 0)] * (values.ndim - 1)
    longer = np.pad(values, widths, mode="reflect", reflect_type="odd") if len(values) > 1 else values
    if len(values) < 2:
        return values.copy()
    shape = (-1, *[1] * (values.ndim - 1))
    result: Floats = oaconvolve(longer, window.reshape(shape), mode="valid", axes=0)
    return result
