"""Signals and residuals of logs, packed for plots.

Of a long signal the smallest and the largest value of every stretch of time remain.  Taking every k-th sample loses
peaks, and averaging flattens them; both make a fit look better than it is.  When each stretch is no wider than a pixel,
its extremes are all that a plot of the full signal would show there.  Stretches get wider where a page with many
outputs would become too large to open quickly.

Residuals have gaps, because samples near rest are left out and logs are interrupted.  An autocorrelation counts only
pairs of samples that are there, so gaps do not bias it; its Fourier transform (Blackman & Tukey) then is a spectrum
that needs no unbroken stretch, as an averaged periodogram would.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any

import numpy as np
import numpy.typing as npt

from echelon.identification import Trace, Validation
from echelon.report.page import packed, stretches_for
from echelon.shared import Floats, extra, one_line

LONGEST_LOG = 1e6
"""Time, s, beyond which a clock shows a calendar's time; plots then count from the first sample."""
GAP = 4.0
"""Usual steps between neighbouring samples beyond which a line breaks."""
FEWEST_SAMPLES = 8
"""Samples that a mean, a deviation or a distribution needs."""
PROBABILITY_OF_BAND = 0.95
"""Probability that an autocorrelation of white noise lies within the band that is drawn."""


@dataclass(frozen=True)
class _Resolution:
    """How finely residuals are shown."""

    bins: int = 48  # of the histogram
    deviations: float = 4.0  # standard deviations to either side of the histogram
    speeds: int = 40  # bins of speed
    lags: int = 512  # of the autocorrelation that the spectrum is computed from
    drawn_lags: int = 120
    frequencies: int = 256


_RESOLUTION = _Resolution()


def outputs_of(validations: Sequence[Validation]) -> list[tuple[str, str]]:
    """Names and units of all outputs with traces, in order."""
    return list(
        {
            trace.output: (trace.output, trace.unit)
            for v in validations
            for trace in v.traces
        }.values()
    )


def buckets_for(validations: Sequence[Validation]) -> int:
    """Stretches into which every plotted signal is cut."""
    views = [
        view
        for validation in validations
        for trace in validation.traces
        for view in (trace, trace.raw)
        if view is not None
    ]
    return stretches_for([len(v.time) for v in views for _ in _curves(v)])


def payload(validations: Sequence[Validation]) -> dict[str, Any]:
    """All plots, JSON-able."""
    places = {name: i for i, (name, _) in enumerate(outputs_of(validations))}
    buckets = buckets_for(validations)
    traces = {
        f"{number}/{places[trace.output]}": _packed(trace, buckets)
        for number, validation in enumerate(validations)
        for trace in validation.traces
    }
    return {"buckets": buckets, "traces": traces}


def _packed(trace: Trace, buckets: int) -> dict[str, Any]:
    first = trace.time[np.isfinite(trace.time)][:1]
    start = float(first[0]) if len(first) else 0.0
    calendar = abs(start) > LONGEST_LOG
    difference = trace.measured - trace.predicted
    return {
        "unit": one_line(trace.unit),
        "start": 0.0 if calendar else start,
        "since": start if calendar else None,
        "fitted": _view(trace, start, buckets),
        "raw": None if trace.raw is None else _view(trace.raw, start, buckets),
        "residual": _residual(trace.time, difference),
        "speeds": _by_speed(trace, difference),
    }


def _curves(trace: Trace) -> dict[str, Floats]:
    """Signals of a plot by name."""
    found = {
        "measured": trace.measured,
        "predicted": trace.predicted,
        "residual": trace.measured - trace.predicted,
    }
    return found if trace.prior is None else {**found, "prior": trace.prior}


def _view(trace: Trace, start: float, buckets: int) -> dict[str, Any]:
    """Signals after the filter of both sides, or without it; times count from a start."""
    kept = {
        name: envelope(trace.time, values, buckets)
        for name, values in _curves(trace).items()
    }
    return {
        "samples": len(trace.time),
        "lost": max(e.lost for e in kept.values()),
        "drawn": max(int(np.isfinite(e.values).sum()) for e in kept.values()),
        "signals": {
            name: [packed(e.time - start), packed(e.values)] for name, e in kept.items()
        },
    }


def _by_speed(trace: Trace, difference: Floats) -> dict[str, Any] | None:
    """Means and standard deviations of a residual in bins of speed that hold as many samples; None without speeds."""
    if trace.speed is None:
        return None
    finite = np.isfinite(trace.speed) & np.isfinite(difference)
    order = np.argsort(trace.speed[finite], kind="stable")
    speed, left = trace.speed[finite][order], difference[finite][order]
    bins = min(_RESOLUTION.speeds, len(speed) // FEWEST_SAMPLES)
    if not bins:
        return None
    speeds, residuals = np.array_split(speed, bins), np.array_split(left, bins)
    middle = np.array([part.mean() for part in speeds])
    mean = np.array([part.mean() for part in residuals])
    deviation = np.array([part.std() for part in residuals])
    unit = "m/s" if trace.unit == "N" else "rad/s"
    arrays = {
        "speed": middle,
        "mean": mean,
        "low": mean - deviation,
        "high": mean + deviation,
    }
    return {name: packed(values) for name, values in arrays.items()} | {"unit": unit}


def _residual(time: Floats, values: Floats) -> dict[str, Any] | None:
    found = residual(time, values)
    if found is None:
        return None
    arrays = (
        "edges",
        "density",
        "normal",
        "lags",
        "correlation",
        "frequency",
        "amplitude",
    )
    return {name: packed(getattr(found, name)) for name in arrays} | {
        "band": found.band,
        "white": found.white,
    }


@dataclass(frozen=True)
class Envelope:
    """Plotted points of a signal."""

    time: Floats  # shape (k,), in order, s
    values: Floats  # shape (k,); nan where a line must not be drawn
    samples: int  # how many there were
    lost: int  # how many of these were not finite


def envelope(time: Floats, values: Floats, buckets: int) -> Envelope:
    """The extremes of a signal in stretches of equal time; the signal itself if it is short."""
    # lines break at gaps: where neighbours are further apart than four usual steps, and than a stretch is wide
    finite = np.isfinite(values) & np.isfinite(time)
    kept = np.flatnonzero(finite)
    t, y = time[kept], values[kept]
    chosen, width = np.arange(len(t)), 0.0
    if len(t) > 2 * buckets:
        places = np.minimum(
            (t - t[0]) * (buckets / max(t[-1] - t[0], 1e-300)), buckets - 1
        ).astype(np.intp)
        chosen, width = _extremes(y, places), float(t[-1] - t[0]) / buckets
    broken = _after_gaps(kept, t, width)
    return Envelope(
        *_with_breaks(t, y, chosen, broken), len(values), int(len(values) - len(kept))
    )


def _extremes(y: Floats, places: npt.NDArray[np.intp]) -> npt.NDArray[np.intp]:
    """First places of the smallest and largest value of every bucket, and the ends, ascending."""
    starts = np.flatnonzero(np.diff(places, prepend=-1))
    number = np.cumsum(
        np.diff(places, prepend=places[0]) != 0
    )  # buckets without samples do not count
    found = [np.array([0, len(y) - 1])]
    for extreme in (np.minimum.reduceat(y, starts), np.maximum.reduceat(y, starts)):
        hits = np.flatnonzero(y == extreme[number])
        found.append(hits[np.unique(number[hits], return_index=True)[1]])
    return np.unique(np.concatenate(found))


def _after_gaps(
    kept: npt.NDArray[np.intp], t: Floats, width: float
) -> npt.NDArray[np.bool_]:
    """Which samples have a gap or a value that is not finite before them."""
    steps = np.diff(t)
    usual = float(np.median(steps)) if len(steps) else 0.0
    far = steps > max(GAP * usual, width)
    lost = (np.diff(kept) > 1) & (width == 0)
    return np.concatenate([[False], far | lost]) if len(t) else np.zeros(0, dtype=bool)


def _with_breaks(
    t: Floats, y: Floats, chosen: npt.NDArray[np.intp], broken: npt.NDArray[np.bool_]
) -> tuple[Floats, Floats]:
    """The chosen samples, with nan between those that a gap separates."""
    count = np.cumsum(broken)[chosen] if len(chosen) else np.zeros(0, dtype=np.intp)
    breaks = np.flatnonzero(np.diff(count) > 0) + 1
    return (
        np.insert(t[chosen], breaks, t[chosen[breaks]] if len(breaks) else []),
        np.insert(y[chosen], breaks, np.nan),
    )


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
    """Pictures of a residual at ascending times, s; None below eight finite values, or without duration or variance."""
    finite = np.isfinite(time) & np.isfinite(values)
    t, y = time[finite], values[finite]
    if len(t) < FEWEST_SAMPLES or not t[-1] > t[0]:
        return None
    std = float(y.std())
    if not 0 < std < np.inf:
        return None
    step = float(np.median(np.diff(t)))
    step = step if step > 0 else float(t[-1] - t[0]) / (len(t) - 1)
    lags = int(min(_RESOLUTION.lags, len(t) // 2))
    correlation = _autocorrelation(t, y - y.mean(), step, lags)
    frequency, amplitude = _spectrum(correlation, std, step)
    edges, density, normal = _histogram(y, std)
    shown = slice(1, min(_RESOLUTION.drawn_lags, lags) + 1)  # at lag 0 it is 1, always
    return Residual(
        std,
        edges,
        density,
        normal,
        (step * np.arange(lags + 1, dtype=np.float64))[shown],
        correlation[shown],
        NormalDist().inv_cdf((1 + PROBABILITY_OF_BAND) / 2) / float(np.sqrt(len(y))),
        frequency,
        amplitude,
        std * float(np.sqrt(2 * step)),
    )


def _histogram(y: Floats, std: float) -> tuple[Floats, Floats, Floats]:
    with extra("identify"):
        from scipy.special import ndtr

    width = _RESOLUTION.deviations
    scaled = np.linspace(-width, width, _RESOLUTION.bins + 1)
    edges = float(y.mean()) + std * scaled
    # values beyond are counted in the outer bins, so that no sample is hidden
    counts = np.histogram(np.clip(y, edges[0], edges[-1]), edges)[0]
    inner = ndtr(scaled)
    inner[0], inner[-1] = 0.0, 1.0
    return edges, 100 * counts / len(y), 100 * np.diff(inner)


def _autocorrelation(t: Floats, y: Floats, step: float, lags: int) -> Floats:
    """Autocorrelation of samples on a grid with holes, shape (lags + 1,)."""
    # gaps longer than the longest lag need not be longer: no pair spans them
    jumps = np.clip(np.rint(np.diff(t) / step), 1, lags + 1).astype(np.intp)
    place = np.concatenate([[0], np.cumsum(jumps)])
    size = 1 << int(np.ceil(np.log2(place[-1] + lags + 2)))
    signal, there = np.zeros(size), np.zeros(size)
    signal[place], there[place] = y, 1.0
    products, pairs = (
        np.fft.irfft(np.abs(np.fft.rfft(x)) ** 2, size)[: lags + 1]
        for x in (signal, there)
    )
    mean = products / np.maximum(np.rint(pairs), 1.0)
    correlation: Floats = mean / mean[0]
    return correlation


def _spectrum(correlation: Floats, std: float, step: float) -> tuple[Floats, Floats]:
    """One-sided amplitude spectral density by a Parzen window, which keeps it positive where nothing is missing."""
    lags = len(correlation) - 1
    u = np.arange(lags + 1) / (lags + 1)
    window = np.where(u <= 0.5, 1 - 6 * u**2 + 6 * u**3, 2 * (1 - u) ** 3)
    frequency = np.linspace(0.0, 0.5 / step, _RESOLUTION.frequencies + 1)[1:]
    weighted = window * correlation * np.where(np.arange(lags + 1) == 0, 1.0, 2.0)
    density = (
        2
        * step
        * std**2
        * np.cos(2 * np.pi * step * np.outer(frequency, np.arange(lags + 1)))
        @ weighted
    )
    return frequency, np.sqrt(np.maximum(density, 0.0))
