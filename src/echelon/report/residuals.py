"""What a residual is like: its distribution, its memory and its spectrum.

Residuals have gaps, because samples near rest are left out and logs are interrupted.  An autocorrelation counts only
pairs of samples that are there, so gaps do not bias it; its Fourier transform (Blackman & Tukey) then is a spectrum
that needs no unbroken stretch, as an averaged periodogram would.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from echelon.arrays import Floats

_BINS = 48
_WIDTH = 4.0  # standard deviations to either side of a histogram
_LAGS, _SHOWN = 512, 120  # of the autocorrelation, and how many of them are drawn
_FREQUENCIES = 256
_WHITE = 1.96  # of a standard normal variable, two-sided 95 %


@dataclass(frozen=True)
class Residual:
    """Pictures of one residual."""

    std: float  # standard deviation, unit of the output
    edges: Floats  # shape (bins + 1,): of the histogram, unit of the output; the outer bins also hold what lies beyond
    # shape (bins,): share of samples in each bin, in per cent, and what a normal distribution would give
    density: Floats
    normal: Floats
    lags: Floats  # shape (lags,): autocorrelation against lag, s, from the first sample on
    correlation: Floats  # shape (lags,): autocorrelation against lag, s, from the first sample on
    band: float  # within ± band lie 95 % of the autocorrelations of white noise
    frequency: Floats  # shape (frequencies,): spectrum: Hz, unit of the output per √Hz
    amplitude: Floats  # shape (frequencies,): spectrum: Hz, unit of the output per √Hz
    white: float  # amplitude that white noise of the same variance would have


def residual(time: Floats, values: Floats) -> Residual | None:
    """Pictures of a residual."""
    finite = np.isfinite(time) & np.isfinite(values)
    t, y = time[finite], values[finite]
    if len(t) < 8 or not t[-1] > t[0]:
        return None
    std = float(y.std())
    if not 0 < std < np.inf:
        return None
    step = float(np.median(np.diff(t)))
    step = step if step > 0 else float(t[-1] - t[0]) / (len(t) - 1)
    lags = int(min(_LAGS, len(t) // 2))
    correlation = _autocorrelation(t, y - y.mean(), step, lags)
    frequency, amplitude = _spectrum(correlation, std, step)
    edges, density, normal = _histogram(y, std)
    shown = slice(1, min(_SHOWN, lags) + 1)  # at lag 0 it is 1, always
    return Residual(
        std,
        edges,
        density,
        normal,
        (step * np.arange(lags + 1, dtype=np.float64))[shown],
        correlation[shown],
        _WHITE / float(np.sqrt(len(y))),
        frequency,
        amplitude,
        std * float(np.sqrt(2 * step)),
    )


def _histogram(y: Floats, std: float) -> tuple[Floats, Floats, Floats]:
    from scipy.stats import norm

    mean = float(y.mean())
    edges = mean + std * np.linspace(-_WIDTH, _WIDTH, _BINS + 1)
    # values beyond are counted in the outer bins, so that no sample is hidden
    counts = np.histogram(np.clip(y, edges[0], edges[-1]), edges)[0]
    inner = norm.cdf(np.linspace(-_WIDTH, _WIDTH, _BINS + 1))
    inner[0], inner[-1] = 0.0, 1.0
    return edges, 100 * counts / len(y), 100 * np.diff(inner)


def _autocorrelation(t: Floats, y: Floats, step: float, lags: int) -> Floats:
    """Of samples on a grid with holes, shape (lags + 1,)."""
    # gaps longer than the longest lag need not be longer: no pair spans them
    jumps = np.clip(np.rint(np.diff(t) / step), 1, lags + 1).astype(np.intp)
    place = np.concatenate([[0], np.cumsum(jumps)])
    size = 1 << int(np.ceil(np.log2(place[-1] + lags + 2)))
    signal, there = np.zeros(size), np.zeros(size)
    signal[place], there[place] = y, 1.0
    products, pairs = (np.fft.irfft(np.abs(np.fft.rfft(x)) ** 2, size)[: lags + 1] for x in (signal, there))
    mean = products / np.maximum(np.rint(pairs), 1.0)
    correlation: Floats = mean / mean[0]
    return correlation


def _spectrum(correlation: Floats, std: float, step: float) -> tuple[Floats, Floats]:
    """One-sided amplitude spectral density by a Parzen window, which keeps it positive where nothing is missing."""
    lags = len(correlation) - 1
    u = np.arange(lags + 1) / (lags + 1)
    window = np.where(u <= 0.5, 1 - 6 * u**2 + 6 * u**3, 2 * (1 - u) ** 3)
    frequency = np.linspace(0.0, 0.5 / step, _FREQUENCIES + 1)[1:]
    weighted = window * correlation * np.where(np.arange(lags + 1) == 0, 1.0, 2.0)
    density = 2 * step * std**2 * np.cos(2 * np.pi * step * np.outer(frequency, np.arange(lags + 1))) @ weighted
    return frequency, np.sqrt(np.maximum(density, 0.0))
