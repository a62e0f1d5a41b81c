"""Residuals along time: how far they are noise, and how far something that the model does not know."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from echelon.errors import InputError
from echelon.identification.validation.correlation import LAGS, Correlations, CorrelationSums, usual_step

Floats = npt.NDArray[np.float64]


def correlations(times: npt.ArrayLike, residuals: npt.ArrayLike, lags: int = LAGS) -> Correlations:
    """Autocorrelations of one stretch of residuals.

    Parameters
    ----------
    times : array of shape (k,)
        Ascending, s; multiples of the time between samples, of which some may be missing.
    residuals : array of shape (k,)
    lags : int

    Returns
    -------
    Correlations

    Raises
    ------
    InputError
        If shapes differ or times do not ascend.

    Examples
    --------
    >>> found = correlations(np.arange(4.0), [1.0, -1.0, 1.0, -1.0], lags=2)
    >>> found.values.round(9).tolist()
    [1.0, -1.0, 1.0]
    """
    t, e = _series(times, residuals)
    sums = CorrelationSums(lags)
    sums.add(t, e)
    return sums.result()


@dataclass(frozen=True)
class Spectrum:
    """Power spectral density of a residual.

    Attributes
    ----------
    frequency : array of shape (f,)
        Hz.
    density : array of shape (f,)
        One-sided, unit of the residual squared per Hz; it integrates to the variance.
    """

    frequency: Floats
    density: Floats


def spectrum(times: npt.ArrayLike, residuals: npt.ArrayLike, points: int = 1024) -> Spectrum:
    """Welch's estimate, averaged over the stretches between gaps.

    Parameters
    ----------
    times : array of shape (k,)
        Ascending, s.  A gap is where more than one and a half of the usual time between samples passes.
    residuals : array of shape (k,)
    points : int
        Samples of a window; shorter stretches are left out, unless all are shorter.

    Returns
    -------
    Spectrum

    Raises
    ------
    InputError
        If shapes differ, times do not ascend, or there are fewer than eight rows without a gap.
    """
    from scipy.signal import welch

    t, e = _series(times, residuals)
    stretches = _uninterrupted(t, e)
    longest = max((len(some) for some in stretches), default=0)
    if longest < 8:
        raise InputError(f"a spectrum needs at least 8 rows without a gap; the longest stretch has {longest}")
    window = min(points, longest)
    rate = 1 / usual_step(np.diff(t))
    mean = e.mean()
    used = [some - mean for some in stretches if len(some) >= window]
    found = [welch(some, rate, nperseg=window, detrend=False) for some in used]
    density = np.average([part[1] for part in found], axis=0, weights=[len(some) for some in used])
    return Spectrum(found[0][0], density)


def _uninterrupted(times: Floats, values: Floats) -> Sequence[Floats]:
    if len(times) < 2:
        return [values]
    gaps = np.diff(times)
    return np.split(values, np.flatnonzero(gaps > 1.5 * usual_step(gaps)) + 1)


def _series(times: npt.ArrayLike, residuals: npt.ArrayLike) -> tuple[Floats, Floats]:
    t, e = np.asarray(times, dtype=float), np.asarray(residuals, dtype=float)
    if t.ndim != 1 or t.shape != e.shape:
        raise InputError(f"times have shape {t.shape} and residuals {e.shape}; expected vectors of equal length")
    if (np.diff(t) <= 0).any():
        raise InputError("times do not ascend")
    return t, e
