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
window, because its length has a formula and its attenuation can be asked for.  Recursive filters are there to repeat
what others did.
"""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import ceil, isfinite, prod

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats, Integers
from echelon.errors import InputError

Complexes = npt.NDArray[np.complex128]

LOWEST = 1e-6
"""Cut-off, relative to the rate, below which a filter would be longer than any log."""

FAR = 1e-9
"""Influence of a sample, as a share of its value, below which a result does not depend on it."""

NEAR = 1e-2
"""Influence of what lies beyond the end of a signal, below which a result is not spoilt by it."""

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
"""Share of the band below half the rate after decimation that is kept where no cut-off is given."""
_MOST_TAPS = 40
"""Products per sample and column beyond which two filters are worth it."""
_ROOM = 5.0
"""Rate after the first of two filters, relative to the cut-off: wide enough for a short first filter."""


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

    def apply(self, values: Floats, padding: int | None = None, every: int = 1) -> Floats:
        """The filtered values (N, …), every k-th of them; ``padding`` samples continue each end, turned about it."""
        from scipy.signal import sosfiltfilt, zpk2sos

        sections = zpk2sos(self.zeros, self.poles, self.gain)  # type: ignore[arg-type]  # complex, as they must be
        length = 3 * (2 * len(sections) + 1 - _at_origin(sections)) if padding is None else padding
        length = min(length, len(values) - 1)

        def along_time(rows: Floats) -> Floats:
            found: Floats = sosfiltfilt(sections, rows, axis=-1, padlen=length)
            return found

        return by_channel(along_time, values, every)

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


def _at_origin(sections: Floats) -> int:
    """How many sections are of first order, as scipy counts them for the length of its padding."""
    return int(min((sections[:, 2] == 0).sum(), (sections[:, 5] == 0).sum()))


def by_channel(function: Callable[[Floats], Floats], values: Floats, every: int = 1) -> Floats:
    """Apply a function of rows (channels, N) along time to values (N, …), on all processors.

    Channels are laid along time in memory for it: recursions then read one number after another, and they free the
    interpreter while they run.
    """
    values = np.asarray(values, dtype=np.float64)
    table = values.reshape(len(values), -1)
    result = np.empty((-(-len(values) // every), table.shape[1]))
    processors = os.cpu_count() or 1
    group = max(1, min(16, -(-table.shape[1] // processors)))

    def work(first: int) -> None:
        some = slice(first, first + group)
        result[:, some] = function(np.ascontiguousarray(table[:, some].T)).T[::every]

    starts = range(0, table.shape[1], group)
    if values.size < 1 << 17 or len(starts) == 1:
        for start in starts:
            work(start)
    else:
        from concurrent.futures import ThreadPoolExecutor

        with ThreadPoolExecutor(processors) as pool:
            list(pool.map(work, starts))
    return result.reshape(len(result), *values.shape[1:])


def butterworth(cutoff: float, rate: float, order: int = 4) -> ZeroPhase:
    """A Butterworth low-pass forwards and backwards; one pass takes 3 dB at the cut-off, Hz."""
    from scipy.signal import butter

    check_cutoff(cutoff, rate)
    if not 1 <= order <= 12:
        raise InputError(f"order {order} of a Butterworth filter: expected a whole number from 1 to 12")
    zeros, poles, gain = butter(order, cutoff, fs=rate, output="zpk")
    return ZeroPhase(np.asarray(zeros, complex), np.asarray(poles, complex), float(gain))


def chebyshev(edge: float, rate: float) -> ZeroPhase:
    """A Chebyshev low-pass of order 8 with 0.05 dB ripple, forwards and backwards; ``edge`` ends the pass-band, Hz."""
    from scipy.signal import cheby1

    check_cutoff(edge, rate)
    zeros, poles, gain = cheby1(8, 0.05, 2 * edge / rate, output="zpk")
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


class Reduction(ABC):
    """A linear filter along time that keeps every k-th sample."""

    @property
    @abstractmethod
    def factor(self) -> int:
        """Samples before, per sample after."""

    @property
    @abstractmethod
    def reach(self) -> int:
        """Samples on either side that a result depends on."""

    @abstractmethod
    def apply(self, values: Floats) -> Floats:
        """The filtered values at the samples that remain; shape (N, …) to (kept, …)."""

    def kept(self, count: int) -> Integers:
        """Indices of the samples, of ``count``, that remain: the multiples of ``factor``."""
        return np.arange(0, count, self.factor, dtype=np.intp)


@dataclass(frozen=True, eq=False)
class FirFilter(Reduction):
    """A symmetric finite filter, computed where samples remain."""

    taps: Floats  # shape (2 reach + 1,); symmetric, with sum 1
    factor: int = 1

    @property
    def reach(self) -> int:
        """Samples on either side that a result depends on."""
        return len(self.taps) // 2

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


@dataclass(frozen=True, eq=False)
class Recursive(Reduction):
    """A recursive filter forwards and backwards, then decimation."""

    both: ZeroPhase
    factor: int = 1

    @cached_property
    def reach(self) -> int:
        """Samples on either side that a result depends on, to within 1e-9 of the signal."""
        return self.both.reach(FAR)

    def apply(self, values: Floats) -> Floats:
        """The filtered values at the samples that remain."""
        return self.both.apply(values, every=self.factor)


@dataclass(frozen=True, eq=False)
class Stages(Reduction):
    """Several reductions, one after another."""

    stages: tuple[Reduction, ...]

    @property
    def factor(self) -> int:
        """Samples before, per sample after all stages."""
        return prod(stage.factor for stage in self.stages)

    @property
    def reach(self) -> int:
        """Samples on either side that a result depends on."""
        total = 0
        for stage in reversed(self.stages):
            total = stage.reach + stage.factor * total
        return total

    def apply(self, values: Floats) -> Floats:
        """The values after all stages."""
        for stage in self.stages:
            values = stage.apply(values)
        return values


def reduction(kind: str, cutoff: float, rate: float, factors: Sequence[int]) -> Reduction | None:
    """The filter over both sides of the equation that settings describe; None if nothing is to be done.

    ``fir`` and ``butterworth`` (order 4, both ways) are one filter for all factors.  ``chebyshev`` (order 8, 0.05 dB,
    both ways) is one for every factor, with 0.8 of the band that it leaves: the ``decimate`` of MATLAB and scipy.  An
    infinite cut-off stands for what the decimation needs.
    """
    if kind not in ("fir", "butterworth", "chebyshev"):
        raise InputError(f"there is no filter '{kind}'; expected fir, butterworth or chebyshev")
    wrong = next((factor for factor in factors if factor < 1 or factor != int(factor)), None)
    if wrong is not None:
        raise InputError(f"decimation by {wrong}: expected whole numbers from 1 on")
    factors = [int(factor) for factor in factors if factor > 1]
    if not factors and cutoff == np.inf:
        return None
    if kind == "chebyshev":
        return _chebyshev_stages(cutoff, rate, factors)
    total = prod(factors)
    edge = cutoff if isfinite(cutoff) else PASSED * rate / total / 2
    if kind == "fir":
        return _fir_stages(edge, rate, total)
    check_cutoff(edge, rate / total)
    return Recursive(butterworth(edge, rate), total)


def _fir_stages(edge: float, rate: float, total: int) -> Reduction:
    """One filter, or for a narrow band two: a short one that decimates, then a sharp one at the low rate.

    The first leaves the second's transition band alone, so together they attenuate as one filter would.
    """
    whole = fir_lowpass(edge, rate, total)
    stop = (1 + WIDEST) * edge
    first = max((k for k in range(1, total + 1) if total % k == 0 and rate / k >= _ROOM * edge), default=1)
    if len(whole.taps) <= _MOST_TAPS * total or first == 1:
        return whole
    return Stages(
        (fir_lowpass(stop, rate, first, width=rate / first - 2 * stop), fir_lowpass(edge, rate / first, total // first))
    )


def _chebyshev_stages(cutoff: float, rate: float, factors: Sequence[int]) -> Reduction:
    stages: list[Reduction] = []
    for factor in factors or [1]:
        left = PASSED * rate / factor / 2
        stages.append(Recursive(chebyshev(cutoff if factor == 1 else min(left, cutoff), rate), factor))
        rate /= factor
    return stages[0] if len(stages) == 1 else Stages(tuple(stages))
