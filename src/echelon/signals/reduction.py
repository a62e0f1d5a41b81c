"""The filter that goes over both sides of the equation: low-pass, then decimation.

A model that is linear in its parameters stays true when every column of the regressor and the outputs pass the same
linear filter (Gautier's parallel filter); noise above the band of the motion goes, and so does the work.

The usual choice is symmetric and finite, because then only the samples that remain have to be computed: a block of
them is a banded matrix times a block of the signal, so the work is done by the fastest routine there is.  Recursive
filters are there to repeat what others did.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import ceil, isfinite, prod
from typing import Protocol

import numpy as np
import numpy.typing as npt

from echelon.errors import InputError
from echelon.signals.filters import FAR, ZeroPhase, butterworth, chebyshev, check_cutoff

Floats = npt.NDArray[np.float64]
Places = npt.NDArray[np.intp]

ATTENUATION = 80.0
"""Of what lies above the band, dB: noise is rarely a ten-thousandth of the signal."""

PASSED = 0.8
"""Share of the band below half the rate after decimation that is kept where no cut-off is given."""

WIDEST = 0.5
"""Widest transition from what passes to what does not, as a share of the cut-off."""


class Reduction(Protocol):
    """A linear filter along time that keeps every k-th sample.

    Attributes
    ----------
    factor : int
        Samples before, per sample after.
    reach : int
        Samples on either side that a result depends on (for recursive filters: to within 1e-9 of the signal).
    """

    @property
    def factor(self) -> int:
        """Samples before, per sample after."""
        ...

    @property
    def reach(self) -> int:
        """Samples on either side that a result depends on."""
        ...

    def kept(self, count: int) -> Places:
        """Which of so many samples remain: every one whose number is a multiple of ``factor``."""
        ...

    def apply(self, values: Floats) -> Floats:
        """The filtered values at the samples that remain; shape (N, …) to (kept, …)."""
        ...


def _every(factor: int, count: int) -> Places:
    return np.arange(0, count, factor, dtype=np.intp)


@dataclass(frozen=True, eq=False)
class Identity:
    """No filter and no decimation, or decimation alone.

    Attributes
    ----------
    factor : int
    """

    factor: int = 1

    @property
    def reach(self) -> int:
        """Samples on either side that a result depends on: none."""
        return 0

    def kept(self, count: int) -> Places:
        """Which of so many samples remain."""
        return _every(self.factor, count)

    def apply(self, values: Floats) -> Floats:
        """The values at the samples that remain."""
        return np.array(values[:: self.factor], dtype=np.float64)


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

    def kept(self, count: int) -> Places:
        """Which of so many samples remain."""
        return _every(self.factor, count)

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
        for first in range(0, results, rows):
            last = min(first + rows, results)
            start = first * self.factor - self.reach
            stop = (last - 1) * self.factor + self.reach + 1
            band = self._band[: last - first, : stop - start]
            if start < 0 or stop > len(table):
                band = band[:, max(0, -start) : len(table) - start]
                band = band / band.sum(axis=1, keepdims=True)
            np.matmul(band, table[max(0, start) : stop], out=found[first:last])
        return found.reshape(results, *values.shape[1:])

    @cached_property
    def _band(self) -> Floats:
        """The filter as a banded matrix for a block of results; about half of it is not zero."""
        rows = max(8, len(self.taps) // self.factor)
        band = np.zeros((rows, (rows - 1) * self.factor + len(self.taps)))
        for row in range(rows):
            band[row, row * self.factor : row * self.factor + len(self.taps)] = self.taps
        return band


@dataclass(frozen=True, eq=False)
class Recursive:
    """A recursive filter forwards and backwards, then decimation.

    Attributes
    ----------
    both : ZeroPhase
    factor : int
    """

    both: ZeroPhase
    factor: int = 1

    @cached_property
    def reach(self) -> int:
        """Samples on either side that a result depends on, to within 1e-9 of the signal."""
        return self.both.reach(FAR)

    def kept(self, count: int) -> Places:
        """Which of so many samples remain."""
        return _every(self.factor, count)

    def apply(self, values: Floats) -> Floats:
        """The filtered values at the samples that remain."""
        return self.both.apply(values, every=self.factor)


@dataclass(frozen=True, eq=False)
class Stages:
    """Several reductions, one after another.

    Attributes
    ----------
    stages : tuple of Reduction
    """

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

    def kept(self, count: int) -> Places:
        """Which of so many samples remain."""
        return _every(self.factor, count)

    def apply(self, values: Floats) -> Floats:
        """The values after all stages."""
        for stage in self.stages:
            values = stage.apply(values)
        return values


def finite(cutoff: float, rate: float, factor: int = 1, attenuation: float = ATTENUATION) -> Finite:
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

    Raises
    ------
    InputError
        If the cut-off is not between zero and half the rate after decimation.
    """
    from scipy.signal import firwin, kaiser_beta

    check_cutoff(cutoff, rate / factor)
    width = min(WIDEST * cutoff, rate / factor - 2 * cutoff)
    half = ceil((attenuation - 7.95) / (2.285 * 2 * np.pi * width / rate) / 2)  # Kaiser's formula
    taps = firwin(2 * half + 1, cutoff + width / 2, window=("kaiser", kaiser_beta(attenuation)), fs=rate)
    taps = (taps + taps[::-1]) / 2
    return Finite(taps / taps.sum(), factor)


def reduction(kind: str, cutoff: float, rate: float, factors: Sequence[int]) -> Reduction | None:
    """The filter over both sides of the equation that settings describe.

    Parameters
    ----------
    kind : str
        ``"fir"``: symmetric and finite, one filter for all factors.  ``"butterworth"``: of order 4 forwards and
        backwards, one filter for all factors.  ``"chebyshev"``: order 8, 0.05 dB, forwards and backwards, once for
        every factor, with 0.8 of the band that this factor leaves: the ``decimate`` of MATLAB and scipy.
    cutoff : float
        Hz; ``inf`` for what the decimation needs.  A finite one lowers that of the Chebyshev filters where it is less.
    rate : float
        Samples per second.
    factors : sequence of int
        Of decimation.

    Returns
    -------
    Reduction, or None if nothing is to be done

    Raises
    ------
    InputError
        If the kind is unknown, a factor is not a whole number from 1 on, or the cut-off is impossible.

    Examples
    --------
    >>> reduction("fir", 20, 1000, (10,)).kept(45).tolist()
    [0, 10, 20, 30, 40]
    >>> reduction("fir", float("inf"), 1000, ()) is None
    True
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
        return finite(edge, rate, total)
    check_cutoff(edge, rate / total)
    return Recursive(butterworth(edge, rate), total)


def _chebyshev_stages(cutoff: float, rate: float, factors: Sequence[int]) -> Reduction:
    stages: list[Reduction] = []
    for factor in factors or [1]:
        left = PASSED * rate / factor / 2
        stages.append(Recursive(chebyshev(cutoff if factor == 1 else min(left, cutoff), rate), factor))
        rate /= factor
    return stages[0] if len(stages) == 1 else Stages(tuple(stages))
