"""Autocorrelations of residuals, in one pass and in constant memory.

They are taken over pairs of rows that are really so far apart in time: rows that were left out leave holes in the grid
of samples, not shifts, and no pair reaches across the end of a segment.  The integrated autocorrelation time
1 + 2 Σ ρ_k is summed up to the window that Sokal proposes, the first lag M that is at least five times the time found
so far (Sokal, "Monte Carlo methods in statistical mechanics", 1997).
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from echelon.shared import Floats, extra

SOKAL_WINDOW = 5.0
"""Length of Sokal's window, in autocorrelation times: wide enough for little bias, narrow enough for little noise."""


@dataclass(frozen=True)
class Correlations:
    """Autocorrelations of a residual, its mean removed."""

    step: float  # time between samples, s; nan with fewer than two rows
    rows: int
    variance: float
    values: Floats  # shape (lags + 1,); ρ_0 = 1, ρ_1, …; nan where no two rows are so far apart
    pairs: Floats  # shape (lags + 1,); how many pairs of rows each is the mean over

    @property
    def time(self) -> float:
        """Integrated autocorrelation time, s: the time between samples for white noise."""
        rho = self.values[1:]
        known = rho[: _first(~np.isfinite(rho))]
        if not np.isfinite(self.step):
            return float("nan")
        sums = 1 + 2 * np.cumsum(known)
        lags = np.arange(1, len(known) + 1)
        if not len(sums):
            return self.step
        window = min(_first(lags >= SOKAL_WINDOW * sums), len(sums) - 1)
        return float(max(sums[window], 0.0) * self.step)

    def whiteness(self, lags: int = 20) -> float:
        """Probability that white noise has autocorrelations this large (Ljung and Box 1978).

        Twenty lags are enough for resonances and hysteresis, and few enough for the test to keep its power.
        """
        with extra("identify"):
            from scipy.stats import chi2

        rho, pairs = self.values[1 : lags + 1], self.pairs[1 : lags + 1]
        usable = (pairs > 0) & np.isfinite(rho)
        if not usable.any():
            return float("nan")
        # without holes pairs is rows − k and rho has been divided by pairs / rows: then this is N (N + 2) Σ r²/(N − k)
        statistic = (
            (self.rows + 2) / self.rows * np.sum(pairs[usable] * rho[usable] ** 2)
        )
        return float(chi2.sf(statistic, int(usable.sum())))


class CorrelationSums:
    """Sums from which autocorrelations follow, taken in block by block in constant memory.

    Of residuals that correlate over more than the largest lag, the time that is reported is a lower bound.
    """

    def __init__(self, lags: int = 4096) -> None:
        self._lags = lags
        # products, later ones, earlier ones, pairs
        self._sums = np.zeros((4, lags + 1))
        self._total = self._squares = 0.0
        self._rows = 0
        self._step = float("nan")
        self._segment: Hashable = None
        self._last = float("nan")
        self._tail: Floats = np.zeros((2, 0))

    def add(self, times: Floats, values: Floats, segment: Hashable = 0) -> None:
        """Take in residuals that follow those before."""
        if not len(times):
            return
        follows = segment == self._segment and times[0] > self._last
        if not np.isfinite(self._step):
            gaps = np.diff(times) if not follows else np.diff(times, prepend=self._last)
            self._step = usual_step(gaps)
        self._total += float(values.sum())
        self._squares += float(values @ values)
        self._rows += len(values)
        for stretch, begins in self._stretches(times, values, follows):
            self._pair(stretch, begins)
        self._segment, self._last = segment, float(times[-1])

    def _stretches(
        self, times: Floats, values: Floats, follows: bool
    ) -> Iterator[tuple[Floats, bool]]:
        """Values and flags on a grid of samples, shape (2, samples), cut at holes that no lag reaches across."""
        if not np.isfinite(self._step):
            yield np.stack([values, np.ones_like(values)]), True
            return
        gaps = np.diff(times, prepend=self._last if follows else times[0] - self._step)
        # steps are rounded one by one, so that errors of time stamps do not add up
        steps = np.maximum(np.rint(gaps / self._step).astype(np.int64), 1)
        cuts = np.flatnonzero(steps > self._lags)
        for part in np.split(np.arange(len(times)), cuts):
            if not len(part):
                continue
            begins = bool(steps[part[0]] > self._lags) or (part[0] == 0 and not follows)
            places = (
                np.cumsum(
                    np.where(part == part[0], 1 if begins else steps[part], steps[part])
                )
                - 1
            )
            grid = np.zeros((2, int(places[-1]) + 1))
            grid[0, places], grid[1, places] = values[part], 1.0
            yield grid, begins

    def _pair(self, grid: Floats, begins: bool) -> None:
        """Add the pairs whose later member lies in a grid, the earlier one there or in the tail."""
        tail = np.zeros((2, 0)) if begins else self._tail
        whole = np.concatenate([tail, grid], axis=1)
        later = np.concatenate([np.zeros_like(tail), grid], axis=1)
        if whole[1].all():
            self._sums[:1] += _crossed(later[:1], whole[:1], self._lags)
            self._sums[1:] += _running(whole[0], tail.shape[1], self._lags)
        else:
            self._sums += _crossed(later, whole, self._lags)
        self._tail = whole[:, -self._lags :]

    def result(self) -> Correlations:
        """Autocorrelations of all that was taken in."""
        rows = self._rows
        mean = self._total / rows if rows else 0.0
        variance = max(self._squares / rows - mean**2, 0.0) if rows else 0.0
        products, later, earlier, pairs = self._sums
        pairs = np.rint(pairs)
        centred = products - mean * (earlier + later) + mean**2 * pairs
        with np.errstate(divide="ignore", invalid="ignore"):
            values: Floats = np.where(pairs > 0, centred / pairs / variance, np.nan)
        return Correlations(self._step, rows, variance, values, pairs)


def _crossed(later: Floats, earlier: Floats, lags: int) -> Floats:
    """Sums of products of every row of one array with every row of the other, earlier by 0 … lags places."""
    with extra("identify"):
        from scipy.fft import irfft, next_fast_len, rfft

    size = next_fast_len(later.shape[1] + lags + 1, real=True)
    products = rfft(later, size)[:, None] * np.conj(rfft(earlier, size))[None]
    return irfft(products.reshape(-1, products.shape[-1]), size)[:, : lags + 1]


def _running(whole: Floats, tail: int, lags: int) -> Floats:
    """Later values, earlier values and pairs where no row is missing: differences of running sums, shape (3, lags + 1).

    A pair's later member stands behind the tail.
    """
    total = np.append(0.0, np.cumsum(whole))
    lag = np.arange(lags + 1)
    begin, end = np.minimum(np.maximum(tail, lag), len(whole)), len(whole)
    earlier = total[np.maximum(end - lag, 0)] - total[begin - np.minimum(lag, begin)]
    return np.stack(
        [total[end] - total[begin], np.where(lag < end, earlier, 0.0), end - begin]
    )


def usual_step(gaps: Floats) -> float:
    """Time between samples where some are missing; the smallest gap up to rounding of time stamps, or nan."""
    positive = gaps[gaps > 0]
    if len(positive):
        return float(np.median(positive[positive < 1.5 * positive.min()]))
    return float("nan")


def _first(flags: npt.NDArray[np.bool_]) -> int:
    """Place of the first true flag, or their number."""
    found = np.flatnonzero(flags)
    return int(found[0]) if len(found) else len(flags)
