"""Residuals along time: how far they are noise, and how far something that the model does not know.

Autocorrelations are taken over pairs of rows that are really so far apart in time: rows that were left out leave holes
in the grid of samples, not shifts, and no pair reaches across the end of a segment.  Sums are kept per lag, so
residuals may come block by block, however long the log is.

The integrated autocorrelation time 1 + 2 Σ ρ_k is summed up to the window that Sokal proposes, the first lag M that is
at least five times the time found so far (Sokal, "Monte Carlo methods in statistical mechanics", 1997).
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from echelon.errors import InputError

Floats = npt.NDArray[np.float64]

LAGS = 4096
"""Largest lag; what correlates longer is reported as at least what is summed up to there."""
WINDOW = 5.0
"""Sokal's window, in autocorrelation times: wide enough for little bias, narrow enough for little noise."""
PORTMANTEAU = 20
"""Lags of the test of whiteness; enough for resonances and hysteresis, few enough to keep its power."""


@dataclass(frozen=True)
class Correlations:
    """Autocorrelations of a residual, its mean removed.

    Attributes
    ----------
    step : float
        Time between samples, s; nan with fewer than two rows.
    rows : int
    variance : float
    values : array of shape (lags + 1,)
        ρ_0 = 1, ρ_1, …; nan where no two rows are so far apart.
    pairs : array of shape (lags + 1,)
        How many pairs of rows each is the mean over.
    """

    step: float
    rows: int
    variance: float
    values: Floats
    pairs: Floats

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
        window = min(_first(lags >= WINDOW * sums), len(sums) - 1)
        return float(max(sums[window], 0.0) * self.step)

    def whiteness(self, lags: int = PORTMANTEAU) -> float:
        """Probability that white noise has autocorrelations this large (Ljung and Box 1978).

        Parameters
        ----------
        lags : int
            How many are tested.  Lags without pairs do not count.
        """
        from scipy.stats import chi2

        rho, pairs = self.values[1 : lags + 1], self.pairs[1 : lags + 1]
        usable = (pairs > 0) & np.isfinite(rho)
        if not usable.any():
            return float("nan")
        # without holes pairs is rows − k and rho has been divided by pairs / rows: then this is N (N + 2) Σ r²/(N − k)
        statistic = (self.rows + 2) / self.rows * np.sum(pairs[usable] * rho[usable] ** 2)
        return float(chi2.sf(statistic, int(usable.sum())))


class CorrelationSums:
    """Sums from which autocorrelations follow, taken in block by block in constant memory.

    Parameters
    ----------
    lags : int
        Largest lag.
    """

    def __init__(self, lags: int = LAGS) -> None:
        self._lags = lags
        self._sums = np.zeros((4, lags + 1))  # products, later ones, earlier ones, pairs
        self._total = self._squares = 0.0
        self._rows = 0
        self._step = float("nan")
        self._segment: Hashable = None
        self._last = float("nan")
        self._tail: Floats = np.zeros((2, 0))

    def add(self, times: Floats, values: Floats, segment: Hashable = 0) -> None:
        """Take in residuals that follow those before.

        Parameters
        ----------
        times, values : array of shape (k,)
            Times ascend within a segment.
        segment : hashable
            Names the uninterrupted stretch; pairs are formed within one only.
        """
        if not len(times):
            return
        follows = segment == self._segment and times[0] > self._last
        if not np.isfinite(self._step):
            gaps = np.diff(times) if not follows else np.diff(times, prepend=self._last)
            self._step = _usual(gaps)
        self._total += float(values.sum())
        self._squares += float(values @ values)
        self._rows += len(values)
        for stretch, begins in self._stretches(times, values, follows):
            self._pair(stretch, begins)
        self._segment, self._last = segment, float(times[-1])

    def _stretches(self, times: Floats, values: Floats, follows: bool) -> Iterator[tuple[Floats, bool]]:
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
            places = np.cumsum(np.where(part == part[0], 1 if begins else steps[part], steps[part])) - 1
            grid = np.zeros((2, int(places[-1]) + 1))
            grid[0, places], grid[1, places] = values[part], 1.0
            yield grid, begins

    def _pair(self, grid: Floats, begins: bool) -> None:
        """Add the pairs whose later member lies in a grid, the earlier one there or in the tail."""
        tail = np.zeros((2, 0)) if begins else self._tail
        whole = np.concatenate([tail, grid], axis=1)
        size = 1 << int(np.ceil(np.log2(whole.shape[1] + self._lags + 1)))
        later = np.fft.rfft(np.concatenate([np.zeros_like(tail), grid], axis=1), size)
        earlier = np.conj(np.fft.rfft(whole, size))
        products = (later[:, None] * earlier[None]).reshape(4, -1)
        self._sums += np.fft.irfft(products, size)[:, : self._lags + 1]
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
    rate = 1 / _usual(np.diff(t))
    mean = e.mean()
    used = [some - mean for some in stretches if len(some) >= window]
    found = [welch(some, rate, nperseg=window, detrend=False) for some in used]
    density = np.average([part[1] for part in found], axis=0, weights=[len(some) for some in used])
    return Spectrum(found[0][0], density)


def _usual(gaps: Floats) -> float:
    """Time between samples where some are missing; the smallest gap up to rounding of time stamps, or nan."""
    positive = gaps[gaps > 0]
    return float(np.median(positive[positive < 1.5 * positive.min()])) if len(positive) else float("nan")


def _uninterrupted(times: Floats, values: Floats) -> Sequence[Floats]:
    if len(times) < 2:
        return [values]
    gaps = np.diff(times)
    return np.split(values, np.flatnonzero(gaps > 1.5 * _usual(gaps)) + 1)


def _series(times: npt.ArrayLike, residuals: npt.ArrayLike) -> tuple[Floats, Floats]:
    t, e = np.asarray(times, dtype=float), np.asarray(residuals, dtype=float)
    if t.ndim != 1 or t.shape != e.shape:
        raise InputError(f"times have shape {t.shape} and residuals {e.shape}; expected vectors of equal length")
    if (np.diff(t) <= 0).any():
        raise InputError("times do not ascend")
    return t, e


def _first(flags: npt.NDArray[np.bool_]) -> int:
    """Place of the first true flag, or their number."""
    found = np.flatnonzero(flags)
    return int(found[0]) if len(found) else len(flags)
