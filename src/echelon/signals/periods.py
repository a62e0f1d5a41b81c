"""Periodic motions: finding the period, and the mean over the periods.

Repeating a motion is the cheapest way to less noise.  The period comes from the autocorrelation: its first high peak
says about how long it is, and the peak that is as many periods away as there are says it precisely.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.errors import InputError

ALIKE = 0.9
"""Correlation of a motion with itself one period later, below which it is not called periodic."""

_NEARLY = 0.98
"""How near to the highest peak the first one comes, so that it is the period and the other a multiple."""


def find_period(values: npt.ArrayLike, rate: float) -> float:
    """Period of a periodic motion (N, channels) that is at least two periods long, s."""
    table = np.asarray(values, dtype=np.float64).reshape(len(np.asarray(values)), -1)
    table = table - table.mean(axis=0)
    spread = table.std(axis=0)
    if len(table) < 8 or not np.any(spread > 0):
        raise InputError("no period can be found: nothing moves")
    table = table[:, spread > 0] / spread[spread > 0]
    alike = _likeness(table)
    longest = len(table) // 2
    below = np.flatnonzero(alike[: longest + 1] < 0.5)
    start = int(below[0]) if len(below) else longest
    highest = float(alike[start : longest + 1].max(initial=-1.0))
    if highest < ALIKE:
        raise InputError(
            f"the motion does not repeat itself within half of the log: its best correlation with itself is "
            f"{max(highest, 0.0):.2f}; give the period, or choose another derivative"
        )
    high = alike >= _NEARLY * highest
    high[:start] = False
    first = int(np.argmax(high))
    end = first + int(np.argmin(high[first:])) if not high[first:].all() else longest
    peak = first + int(np.argmax(alike[first:end])) if end > first else first
    return _refined(alike, peak) / rate


def _likeness(table: Floats) -> Floats:
    """Correlation of a motion with itself at every lag, over what overlaps."""
    count = len(table)
    size = 1 << (2 * count - 1).bit_length()
    transform = np.fft.rfft(table, size, axis=0)
    product = np.fft.irfft((np.abs(transform) ** 2).sum(axis=1), size)[:count]
    energy = np.concatenate([[0.0], np.cumsum((table**2).sum(axis=1))])
    both = energy[count:0:-1] + energy[count] - energy[:count]
    return np.asarray(2 * product / np.maximum(both, np.finfo(float).tiny))


def _refined(alike: Floats, peak: int) -> float:
    """Lag of one period, from the furthest of its multiples that is in the first three quarters."""
    period = _parabola(alike, peak)
    for multiple in range(2, int(0.75 * len(alike) / period) + 1):
        near = round(multiple * period)
        around = slice(max(1, near - 2), near + 3)
        best = around.start + int(np.argmax(alike[around]))
        if alike[best] < ALIKE * alike[peak]:
            break
        period = _parabola(alike, best) / multiple
    return period


def _parabola(values: Floats, peak: int) -> float:
    """Where the parabola through a peak and its neighbours is highest."""
    if not 0 < peak < len(values) - 1:
        return float(peak)
    before, at, after = values[peak - 1 : peak + 2]
    bend = before - 2 * at + after
    return float(peak + 0.5 * (before - after) / bend) if bend < 0 else float(peak)


def average(values: npt.ArrayLike, rate: float, period: float) -> tuple[Floats, float]:
    """Mean over the whole periods of a signal (N, channels), and its rate, a whole number of samples per period.

    Between samples the signal is interpolated by splines of degree 5.
    """
    from scipy.interpolate import make_interp_spline

    table = np.asarray(values, dtype=np.float64)
    periods = int(len(table) / rate / period + 1e-9) if period > 0 else 0
    if periods < 2:
        raise InputError(
            f"{len(table) / rate:.4g} s of samples do not hold two periods of {period:.4g} s: nothing can be averaged"
        )
    count = round(period * rate)
    if abs(count / rate - period) * periods * rate < 1e-6:
        folded = table[: periods * count]
    else:
        times = np.arange(periods * count) * (period / count)
        folded = make_interp_spline(np.arange(len(table)) / rate, table, k=5, axis=0)(times)
    folded = folded.reshape(periods, count, *table.shape[1:])
    return folded.mean(axis=0), count / period
