"""The filter that goes over both sides of the equation: low-pass, then decimation.

A model that is linear in its parameters stays true when every column of the regressor and the outputs pass the same
linear filter (Gautier's parallel filter); noise above the band of the motion goes, and so does the work.

The usual choice is symmetric and finite (:mod:`echelon.signals.finite`); recursive filters are there to repeat what
others did.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import isfinite, prod
from typing import Protocol

import numpy as np

from echelon.arrays import Floats, Integers
from echelon.errors import InputError
from echelon.signals.filters import FAR, ZeroPhase, butterworth, chebyshev, check_cutoff
from echelon.signals.finite import WIDEST, finite

PASSED = 0.8
"""Share of the band below half the rate after decimation that is kept where no cut-off is given."""

_MOST_TAPS = 40
"""Products per sample and column beyond which two filters are worth it."""
_ROOM = 5.0
"""Rate after the first of two filters, relative to the cut-off: wide enough for a short first filter."""


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

    def kept(self, count: int) -> Integers:
        """Which of so many samples remain: every one whose number is a multiple of ``factor``."""
        ...

    def apply(self, values: Floats) -> Floats:
        """The filtered values at the samples that remain; shape (N, …) to (kept, …)."""
        ...


def _every(factor: int, count: int) -> Integers:
    return np.arange(0, count, factor, dtype=np.intp)


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

    def kept(self, count: int) -> Integers:
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

    def kept(self, count: int) -> Integers:
        """Which of so many samples remain."""
        return _every(self.factor, count)

    def apply(self, values: Floats) -> Floats:
        """The values after all stages."""
        for stage in self.stages:
            values = stage.apply(values)
        return values


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
        return _finite_stages(edge, rate, total)
    check_cutoff(edge, rate / total)
    return Recursive(butterworth(edge, rate), total)


def _finite_stages(edge: float, rate: float, total: int) -> Reduction:
    """One filter, or for a narrow band two: a short one that decimates, then a sharp one at the low rate.

    The first leaves the second's transition band alone, so together they attenuate as one filter would.
    """
    whole = finite(edge, rate, total)
    stop = (1 + WIDEST) * edge
    first = max((k for k in range(1, total + 1) if total % k == 0 and rate / k >= _ROOM * edge), default=1)
    if len(whole.taps) <= _MOST_TAPS * total or first == 1:
        return whole
    return Stages(
        (finite(stop, rate, first, width=rate / first - 2 * stop), finite(edge, rate / first, total // first))
    )


def _chebyshev_stages(cutoff: float, rate: float, factors: Sequence[int]) -> Reduction:
    stages: list[Reduction] = []
    for factor in factors or [1]:
        left = PASSED * rate / factor / 2
        stages.append(Recursive(chebyshev(cutoff if factor == 1 else min(left, cutoff), rate), factor))
        rate /= factor
    return stages[0] if len(stages) == 1 else Stages(tuple(stages))
