"""Time stamps as they come: where they break, how far they are from a uniform clock, and what its rate is.

Filters and derivatives need uniform samples, and logs rarely have them: computers are late, packets are lost, runs are
appended to one file.  What can be said about the stamps alone is said here.  The nominal period is the median of the
intervals, which lost and late samples do not move.  The mean of the intervals near it is used instead where it differs
by no more than chance, because jitter that comes and goes cancels in it; and where stamps are much coarser than the
clock (milliseconds for 300 Hz: 3, 3, 4 ms), so that the median misses it by several percent.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from echelon.arrays import Floats, Integers
from echelon.errors import InputError

PERIODS = (1e-9, 1e6)
"""Intervals between samples that a log of a robot may have, s; others are another column, or another unit."""

GAP = 10.0
"""Intervals of more periods than this are gaps.

What is shorter is bridged: a motion far below half the rate hardly changes its course in ten samples, and every cut
costs the ends that filters spoil.
"""

JITTER = 0.01
"""Share of a period that stamps may be off a uniform clock; the error of a position is that of 1 % of a sample."""

_COARSE = 0.05
_ERRORS = 4.0
_REPEATED = 0.2
_UNORDERED = 50
_ROUND = 2e-3


@dataclass(frozen=True)
class Stretches:
    """Where a clock runs on.

    Attributes
    ----------
    period : float
        Nominal interval, s.
    pieces : tuple of array of int
        Numbers of the samples of each stretch, whose stamps increase without gaps.
    duplicates : array of int
        Samples with the stamp of the one before; they are in no piece.
    backward : array of int
        Samples before which the clock jumps back.
    gaps : array of int
        Samples before which there is a gap.
    """

    period: float
    pieces: tuple[Integers, ...]
    duplicates: Integers
    backward: Integers
    gaps: Integers


@dataclass(frozen=True)
class Regularity:
    """How a stretch compares with a uniform clock.

    Attributes
    ----------
    rate : float
        Samples per second of the uniform clock.
    uniform : bool
        Whether the stamps are on that clock, to :data:`JITTER` of a period and rounding.
    shortest, longest : float
        Intervals, s.
    spread : float
        Standard deviation of the intervals, s.
    missing : int
        Samples that the intervals leave room for, one in an interval of two periods, and that the whole stretch lacks.
    """

    rate: float
    uniform: bool
    shortest: float
    longest: float
    spread: float
    missing: int


def stretches(time: Floats, gap: float = GAP) -> Stretches:
    """Cut a sequence of time stamps where it jumps.

    Parameters
    ----------
    time : array of shape (N,)
        Time stamps, s, finite.
    gap : float
        Periods beyond which an interval is a gap.

    Returns
    -------
    Stretches

    Raises
    ------
    InputError
        If the stamps never advance, most repeat, or they are in no order; names the sample.

    Examples
    --------
    >>> found = stretches(np.array([0, 1, 2, 2, 3, 50, 51, 0, 1.0]))
    >>> [piece.tolist() for piece in found.pieces]
    [[0, 1, 2, 4], [5, 6], [7, 8]]
    """
    if not gap >= 1:
        raise InputError(f"a gap must be at least one period, got {gap:g}", element="gap")
    intervals = np.diff(time)
    if not np.any(intervals > 0):
        raise InputError("time never advances" if len(time) > 1 else "one sample is too few for a clock")
    duplicates = np.flatnonzero(intervals == 0) + 1
    if len(duplicates) > _REPEATED * len(time):
        raise InputError(
            f"{len(duplicates)} of {len(time)} time stamps repeat the one before, first at row {duplicates[0]}: they "
            "are coarser than the samples; if these came at a constant rate, give rate instead of time"
        )
    kept = np.delete(np.arange(len(time)), duplicates)
    steps = np.diff(time[kept])
    back = np.flatnonzero(steps < 0)
    if len(back) > max(1, len(time) // _UNORDERED):
        row = kept[back[0] + 1]
        raise InputError(
            f"time goes backwards {len(back)} times in {len(time)} rows, first at row {row} from {time[row - 1]:.9g} s "
            f"to {time[row]:.9g} s: is this the column with time stamps?"
        )
    period = nominal_period(time)
    if not PERIODS[0] <= period <= PERIODS[1]:
        raise InputError(
            f"time stamps are usually {period:.3g} s apart (valid: {PERIODS[0]:g} s to {PERIODS[1]:g} s): is this the "
            "column with time stamps, and is its unit right?"
        )
    late = np.flatnonzero(steps > gap * period)
    pieces = np.split(kept, np.union1d(back, late) + 1)
    return Stretches(period, tuple(pieces), duplicates, kept[back + 1], kept[late + 1])


def nominal_period(time: Floats) -> float:
    """The usual interval between time stamps, s.

    Parameters
    ----------
    time : array of shape (N,)
        With at least two stamps, one of which is later than the one before.
    """
    steps = np.diff(time)
    steps = steps[steps > 0]
    median = float(np.median(steps))
    near = steps[np.abs(steps - median) < 0.5 * median]
    if not len(near):  # two kinds of intervals, far apart, in equal numbers
        return median
    with np.errstate(over="ignore"):
        mean, error = float(np.mean(near)), float(np.std(near)) / np.sqrt(len(near))
    off = abs(mean - median)
    return mean if off > _COARSE * median or off < _ERRORS * error else median


def round_rate(period: float) -> float:
    """The rate of a period, Hz, as a number of two or three digits where that is within 0.2 %.

    Parameters
    ----------
    period : float
        In s.

    Examples
    --------
    >>> round_rate(0.0033338), round_rate(0.005), round_rate(0.00123987)
    (300.0, 200.0, 807.0)
    """
    rate = 1 / period
    for digits in (1, 2):
        nearby = float(f"{rate:.{digits}e}")
        if abs(nearby - rate) <= _ROUND * rate:
            return nearby
    return rate


def regularity(time: Floats, period: float) -> Regularity:
    """Compare a stretch with a uniform clock.

    Parameters
    ----------
    time : array of shape (N,)
        Increasing time stamps, s, without gaps.
    period : float
        Nominal interval, s.

    Returns
    -------
    Regularity
        Of the clock of a round rate near the nominal one if the stamps keep to it, else of the one that fits them
        best if they keep to that; otherwise of the first.

    Examples
    --------
    >>> regularity(np.arange(100) / 300, 1 / 300).uniform
    True
    """
    steps = np.diff(time) if len(time) > 1 else np.array([period])
    since = time - time[0]
    count = np.arange(len(time))
    rounding = 4 * np.spacing(np.abs(time).max())
    nominal = round_rate(period)
    fitted = 1 / float(np.polyfit(count, since, 1)[0]) if len(time) > 2 else nominal
    rate, uniform = nominal, False
    for candidate in (nominal, fitted):
        off = since - count / candidate
        if np.ptp(off) / 2 <= JITTER / candidate + rounding:
            rate, uniform = candidate, True
            break
    # late stamps leave room as lost samples do, but early ones after them take it back
    room = np.sum(np.maximum(np.rint(steps * rate) - 1, 0))
    missing = int(min(room, max(np.rint(since[-1] * rate) + 1 - len(time), 0)))
    return Regularity(rate, uniform, float(steps.min()), float(steps.max()), float(steps.std()), missing)
