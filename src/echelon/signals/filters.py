"""Filters without phase: over positions, and over both sides of the equation.

Recursive filters run forwards and then backwards, because positions, velocities and torques must keep their common
time.  Butterworth for signals, because its pass-band is flat, so that amplitudes and with them parameters stay.
Sections of second order because one polynomial of order 4 already loses its digits at a cut-off of a thousandth of the
rate.  As everywhere in the field a cut-off is that of one pass (−3 dB), so that both together take 6 dB there.  How
far a result depends on its neighbours has a closed form: the response to an impulse is Σ c p^|lag| over the poles p,
with residues c of H(z) H(1/z), and so is its tail.

A model that is linear in its parameters stays true when every column of the regressor and the outputs pass the same
linear filter (Gautier's parallel filter); noise above the band of the motion goes, and so does the work.  The usual
choice is a symmetric finite filter that is computed only where samples remain: a block of results is a banded matrix
times a block of the signal, so a million samples of 250 columns take about half a second on one processor.  Kaiser's
window, because its length has a formula and its attenuation can be asked for.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from math import ceil, isfinite

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats, Integers
from echelon.errors import InputError
from echelon.extras import extra

Complexes = npt.NDArray[np.complex128]

LOWEST = 1e-6
"""Cut-off, relative to the rate, below which a filter would be longer than any log."""

FAR = 1e-9
"""Influence of a sample, as a share of its value, below which a result does not depend on it."""

NEAR = 3e-2
"""Influence of what lies beyond the end of a signal, below which a result is not spoilt by it: the signal turned about
its end, which is taken for it there, is far from wrong."""

_ORIGIN = 1e-9
"""Radius within which a pole forgets everything in one sample; exactly zero has no residue of the same form."""

ATTENUATION = 80.0
"""Of what lies above the band, dB: noise is rarely a ten-thousandth of the signal."""
WIDEST = 0.5
"""Widest transition from what passes to what does not, as a share of the cut-off."""
_ROWS = 8
"""Results of a block, at least; more than a third of the filter's length is mostly zeros."""
_QUICK = 1 << 18
"""Products of a block: beyond as many, libraries use several threads, which cost more than they gain where others need
the processors too, such as the thread that reads the next piece of a log."""
PASSED = 0.8
"""Share of the band below half the rate after decimation that is kept."""
WORTH = 0.4
"""Highest edge that is worth a filter, as a share of the rate."""


@dataclass(frozen=True, eq=False)
class ZeroPhase:
    """A recursive filter that runs forwards and backwards."""

    zeros: Complexes  # of one pass, in the z-plane
    poles: Complexes
    gain: float

    def reach(self, influence: float = FAR) -> int:
        """Samples on either side, beyond which all others together count for less than this share of the largest."""
        size = np.abs(self.poles)
        weights = np.abs(self._residues()) / (1 - size)
        low, high = 0, 1
        while 2 * float(weights @ size**high) > influence:
            low, high = high, 2 * high
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if 2 * float(weights @ size**middle) > influence else (low, middle)
        return high

    def apply(self, values: Floats, padding: int) -> Floats:
        """The filtered values (N, …); ``padding`` samples continue each end, turned about it."""
        with extra("identify"):
            from scipy.signal import sosfiltfilt, zpk2sos

        sections = zpk2sos(self.zeros, self.poles, self.gain)  # type: ignore[arg-type]  # complex, as they must be
        length = min(padding, len(values) - 1)

        def along_time(rows: Floats) -> Floats:
            found: Floats = sosfiltfilt(sections, rows, axis=-1, padlen=length)
            return found

        return by_channel(along_time, values)

    def _residues(self) -> Complexes:
        """Coefficients c of the response Σ c p^|lag| to an impulse."""
        found = np.empty(len(self.poles), complex)
        poles = np.where(np.abs(self.poles) < _ORIGIN, _ORIGIN, self.poles)
        for k, pole in enumerate(poles):
            others = np.delete(poles, k)
            forwards = self.gain * np.prod(pole - self.zeros) / np.prod(pole - others)
            backwards = self.gain * np.prod(1 / pole - self.zeros) / np.prod(1 / pole - poles)
            found[k] = forwards * backwards / pole
        return found


def by_channel(function: Callable[[Floats], Floats], values: Floats) -> Floats:
    """Apply a function of rows (channels, N) along time to values (N, …), on all processors.

    Channels are laid along time in memory for it: recursions then read one number after another, and they free the
    interpreter while they run.
    """
    values = np.asarray(values, dtype=np.float64)
    table = values.reshape(len(values), -1)
    result = np.empty(table.shape)
    processors = os.cpu_count() or 1
    group = max(1, min(16, -(-table.shape[1] // processors)))

    def work(first: int) -> None:
        some = slice(first, first + group)
        result[:, some] = function(np.ascontiguousarray(table[:, some].T)).T

    starts = range(0, table.shape[1], group)
    if values.size < 1 << 17 or len(starts) == 1:
        for start in starts:
            work(start)
    else:
        from concurrent.futures import ThreadPoolExecutor

        with ThreadPoolExecutor(processors) as pool:
            list(pool.map(work, starts))
    return result.reshape(values.shape)


def butterworth(cutoff: float, rate: float, order: int = 4) -> ZeroPhase:
    """A Butterworth low-pass forwards and backwards; one pass takes 3 dB at the cut-off, Hz."""
    with extra("identify"):
        from scipy.signal import butter

    check_cutoff(cutoff, rate)
    if not 1 <= order <= 12:
        raise InputError(f"order {order} of a Butterworth filter: expected a whole number from 1 to 12")
    zeros, poles, gain = butter(order, cutoff, fs=rate, output="zpk")
    return ZeroPhase(np.asarray(zeros, complex), np.asarray(poles, complex), float(gain))


def lowpass(values: Floats, cutoff: float, rate: float, order: int = 4) -> Floats:
    """Butterworth low-pass of values (N, …) without delay; cut-off in Hz, ``inf`` for no filter."""
    if cutoff == np.inf:
        return np.array(values, dtype=np.float64)
    both = butterworth(cutoff, rate, order)
    return both.apply(values, 2 * both.reach(NEAR))


def check_cutoff(cutoff: float, rate: float) -> None:
    """Refuse a cut-off, Hz, that is not between a millionth of the rate and half of it."""
    if not (isfinite(cutoff) and LOWEST * rate <= cutoff < rate / 2):
        raise InputError(
            f"a cut-off of {cutoff:g} Hz is impossible at {rate:g} samples per second: expected more than "
            f"{LOWEST * rate:g} Hz and less than {rate / 2:g} Hz, or inf for no filter"
        )


@dataclass(frozen=True, eq=False)
class FirFilter:
    """A symmetric finite filter that keeps every k-th sample, and is computed where samples remain."""

    taps: Floats  # shape (2 reach + 1,); symmetric, with sum 1
    factor: int = 1

    @property
    def reach(self) -> int:
        """Samples on either side that a result depends on."""
        return len(self.taps) // 2

    def kept(self, count: int) -> Integers:
        """Indices of the samples, of ``count``, that remain: the multiples of ``factor``."""
        return np.arange(0, count, self.factor, dtype=np.intp)

    def apply(self, values: Floats) -> Floats:
        """The filtered values at the samples that remain, shape (N, …) to (kept, …).

        Near its ends, where a part of the filter lies outside the signal, the part inside is scaled to sum 1: a mean of
        what is there.  Both sides of an equation are still filtered alike, so no row is spoilt.
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


def fir_lowpass(cutoff: float, rate: float, factor: int = 1, *, width: float | None = None) -> FirFilter:
    """A symmetric finite low-pass by Kaiser's window, with decimation.

    The pass-band ends at the cut-off, Hz.  The stop-band begins ``width`` Hz above it; by default that is half the
    cut-off, or as much as decimation leaves.
    """
    with extra("identify"):
        from scipy.signal import firwin, kaiser_beta

    check_cutoff(cutoff, rate / factor)
    if width is None:
        width = min(WIDEST * cutoff, rate / factor - 2 * cutoff)
    if width < LOWEST * rate:
        raise InputError(f"a filter whose edge is {width:g} Hz wide is too long at {rate:g} samples per second")
    half = ceil((ATTENUATION - 7.95) / (2.285 * 2 * np.pi * width / rate) / 2)  # Kaiser's formula
    taps = firwin(2 * half + 1, cutoff + width / 2, window=("kaiser", kaiser_beta(ATTENUATION)), fs=rate)
    taps = (taps + taps[::-1]) / 2
    return FirFilter(taps / taps.sum(), factor)


def reduction(edge: float, rate: float) -> FirFilter | None:
    """The filter over both sides of the equation that keeps the band up to an edge, Hz, and samples enough for it.

    None where the edge is so near half the rate that no filter is worth it.
    """
    return None if edge > WORTH * rate else fir_lowpass(edge, rate, max(1, int(PASSED * rate / 2 / edge)))
