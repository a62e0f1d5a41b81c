"""Symmetric finite filters that are computed only where samples remain.

A block of results is a banded matrix times a block of the signal, so the work is done by the fastest routine there is:
a million samples of 250 columns take about half a second on one processor.  Kaiser's window, because its length has a
formula and its attenuation can be asked for.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import ceil

import numpy as np

from echelon.arrays import Floats, Integers
from echelon.errors import InputError
from echelon.signals.filters import LOWEST, check_cutoff

ATTENUATION = 80.0
"""Of what lies above the band, dB: noise is rarely a ten-thousandth of the signal."""

WIDEST = 0.5
"""Widest transition from what passes to what does not, as a share of the cut-off."""

_ROWS = 8
"""Results of a block, at least; more than a third of the filter's length is mostly zeros."""
_QUICK = 1 << 18
"""Products of a block: beyond as many, libraries use several threads, which cost more than they gain where others need
the processors too, such as the thread that reads the next piece of a log."""


@dataclass(frozen=True, eq=False)
class Finite:
    """A symmetric finite filter, computed where samples remain.

    Attributes
    ----------
    taps : array of shape (2 reach + 1,)
        Symmetric, with sum 1.
    factor : int
    """

    taps: Floats
    factor: int = 1

    @property
    def reach(self) -> int:
        """Samples on either side that a result depends on."""
        return len(self.taps) // 2

    def kept(self, count: int) -> Integers:
        """Which of so many samples remain."""
        return np.arange(0, count, self.factor, dtype=np.intp)

    def apply(self, values: Floats) -> Floats:
        """The filtered values at the samples that remain.

        Near its ends, where a part of the filter lies outside the signal, the part inside is scaled to sum 1: a mean of
        what is there.  Both sides of an equation are still filtered alike, so no row is spoilt.

        Parameters
        ----------
        values : array of shape (N, …)

        Returns
        -------
        array of shape (kept, …)
        """
        values = np.asarray(values, dtype=np.float64)
        table = values.reshape(len(values), -1)
        results = len(self.kept(len(values)))
        found = np.empty((results, table.shape[1]))
        rows = len(self._band)
        width = max(1, _QUICK // self._band.size)
        for first in range(0, results, rows):
            last = min(first + rows, results)
            start = first * self.factor - self.reach
            stop = (last - 1) * self.factor + self.reach + 1
            band = self._band[: last - first, : stop - start]
            if start < 0 or stop > len(table):
                band = band[:, max(0, -start) : len(table) - start]
                band = band / band.sum(axis=1, keepdims=True)
            part = table[max(0, start) : stop]
            for left in range(0, table.shape[1], width):
                some = slice(left, left + width)
                np.matmul(band, part[:, some], out=found[first:last, some])
        return found.reshape(results, *values.shape[1:])

    @cached_property
    def _band(self) -> Floats:
        """The filter as a banded matrix for a block of results, a quarter of it zero."""
        rows = max(_ROWS, len(self.taps) // self.factor // 3)
        band = np.zeros((rows, (rows - 1) * self.factor + len(self.taps)))
        for row in range(rows):
            band[row, row * self.factor : row * self.factor + len(self.taps)] = self.taps
        return band


def finite(
    cutoff: float, rate: float, factor: int = 1, attenuation: float = ATTENUATION, *, width: float | None = None
) -> Finite:
    """A symmetric finite low-pass by Kaiser's window, with decimation.

    What lies below the cut-off passes; what lies above one and a half times the cut-off, or would be folded below it
    by the decimation, is attenuated.

    Parameters
    ----------
    cutoff : float
        End of the pass-band, Hz.
    rate : float
        Samples per second.
    factor : int
        Decimation.
    attenuation : float
        Least attenuation in the stop-band and largest error in the pass-band, dB.
    width : float, optional
        Of the transition from what passes to what does not, Hz; half the cut-off, or what decimation leaves, if less.

    Raises
    ------
    InputError
        If the cut-off is not between zero and half the rate after decimation.
    """
    from scipy.signal import firwin, kaiser_beta

    check_cutoff(cutoff, rate / factor)
    if width is None:
        width = min(WIDEST * cutoff, rate / factor - 2 * cutoff)
    if width < LOWEST * rate:
        raise InputError(f"a filter whose edge is {width:g} Hz wide is too long at {rate:g} samples per second")
    half = ceil((attenuation - 7.95) / (2.285 * 2 * np.pi * width / rate) / 2)  # Kaiser's formula
    taps = firwin(2 * half + 1, cutoff + width / 2, window=("kaiser", kaiser_beta(attenuation)), fs=rate)
    taps = (taps + taps[::-1]) / 2
    return Finite(taps / taps.sum(), factor)
