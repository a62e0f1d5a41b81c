"""Time stamps as they come, uniform clocks, and the way from one to the other.

Filters and derivatives need uniform samples, and logs rarely have them: computers are late, packets are lost, runs are
appended to one file.  The nominal period is the median of the intervals, which lost and late samples do not move.  The
mean of the intervals near it is used instead where it differs by no more than chance, because jitter that comes and
goes cancels in it; and where stamps are much coarser than the clock (milliseconds for 300 Hz: 3, 3, 4 ms), so that the
median misses it by several percent.

Positions of a robot are smooth on the scale of a sample, so a cubic spline through them has an error of fourth order
in the period; schemes that never overshoot (Akima, monotone Hermite) fall back to the second order at every turning
point, where accelerations are largest.  A slower clock would fold what lies above half its rate into the band of the
motion, so a symmetric windowed-sinc filter (no phase, stop band at −80 dB) takes that away first.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, floor

import numpy as np

from echelon.identification.signals.chance import CLEAR, SHARE
from echelon.identification.signals.filters import PASSED, REACH, fir_lowpass
from echelon.shared import Floats, InputError, Integers, extra

PERIODS = (1e-9, 1e6)
"""Intervals between samples that a log of a robot may have, s; others are another column, or another unit."""

GAP = 10.0
"""Intervals of more periods than this are gaps.

What is shorter is bridged: a motion far below half the rate hardly changes its course in ten samples, and every cut
costs the ends that filters spoil.
"""

JITTER = 0.01
"""Share of a period that stamps may be off a uniform clock; the error of a position is that of 1 % of a sample."""

SLOWER = 1 - JITTER
"""Rates below this share of the old one are lower, not the same to jitter, and need a low-pass."""

REPEATED = 0.2
"""Share of time stamps that may repeat the one before; with more, stamps are coarser than the samples."""

_COARSE = 0.05
"""Relative difference of the mean interval from the median that only stamps coarser than the clock explain."""

_ROUND = 2e-3
"""Relative error of a rate that is taken to be a round number: clocks of computers are better, and users' notes too."""


@dataclass(frozen=True)
class Stretches:
    """Where a clock runs on."""

    period: float  # nominal interval, s
    pieces: tuple[
        Integers, ...
    ]  # numbers of the samples of each stretch, whose stamps increase without gaps
    duplicates: (
        Integers  # samples with the stamp of the one before; they are in no piece
    )
    backward: Integers  # samples before which the clock jumps back
    gaps: Integers  # samples before which there is a gap


@dataclass(frozen=True)
class Regularity:
    """How a stretch compares with a uniform clock."""

    rate: float  # samples per second of the uniform clock
    uniform: bool  # whether the stamps are on that clock, to :data:`JITTER` of a period and rounding
    shortest: float  # intervals, s
    longest: float
    spread: float  # standard deviation of the intervals, s
    # samples that the intervals leave room for, one in an interval of two periods, and that the whole stretch lacks
    missing: int


def stretches(time: Floats, gap: float = GAP) -> Stretches:
    """Cut time stamps (N,), s, where they jump back or leave a gap of more than ``gap`` periods."""
    if not gap >= 1:
        raise InputError(
            f"a gap must be at least one period, got {gap:g}", element="gap"
        )
    intervals = np.diff(time)
    if not np.any(intervals > 0):
        never = (
            "time runs backwards: sort the rows by time"
            if np.any(intervals < 0)
            else "time never advances"
        )
        raise InputError(
            never if len(time) > 1 else "one sample is too few for a clock"
        )
    duplicates = np.flatnonzero(intervals == 0) + 1
    if len(duplicates) > REPEATED * len(time):
        raise InputError(
            f"{len(duplicates)} of {len(time)} time stamps repeat the one before, first at row {duplicates[0]}: if rows "
            "are of several recordings or joints, give each a file of its own; if stamps are coarser than the samples, "
            "which came at a constant rate, give rate instead of time"
        )
    kept = np.delete(np.arange(len(time)), duplicates)
    steps = np.diff(time[kept])
    back = np.flatnonzero(steps < 0)
    if len(back) > max(1, (1 - SHARE) * len(time)):
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
    """The usual interval between time stamps, s; one of them at least must be later than the one before."""
    steps = np.diff(time)
    steps = steps[steps > 0]
    median = float(np.median(steps))
    near = steps[np.abs(steps - median) < 0.5 * median]
    if not len(near):  # two kinds of intervals, far apart, in equal numbers
        return median
    with np.errstate(over="ignore"):
        mean, error = float(np.mean(near)), float(np.std(near)) / np.sqrt(len(near))
    off = abs(mean - median)
    return mean if off > _COARSE * median or off < CLEAR * error else median


def round_rate(period: float) -> float:
    """The rate of a period in s, Hz, as a number of two or three digits where that is within 0.2 %."""
    rate = 1 / period
    for digits in (1, 2):
        nearby = float(f"{rate:.{digits}e}")
        if abs(nearby - rate) <= _ROUND * rate:
            return nearby
    return rate


def regularity(time: Floats, period: float) -> Regularity:
    """Compare increasing stamps (N,), s, with a uniform clock of a round rate near 1/period, or of the best rate."""
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
    return Regularity(
        rate,
        uniform,
        float(steps.min()),
        float(steps.max()),
        float(steps.std()),
        missing,
    )


def grid(first: float, last: float, rate: float) -> Floats:
    """Uniform times from the first on, not beyond the last, s, as offsets from the first; the rate is in Hz."""
    rounding = 1e-6 + 4 * rate * float(np.spacing(max(abs(first), abs(last))))
    return np.arange(int((last - first) * rate + rounding) + 1) / rate


def interpolated(time: Floats, values: Floats, wanted: Floats) -> Floats:
    """Values (N, …) at the wanted times by a cubic spline; lines where there are fewer than four samples."""
    with extra("identify"):
        from scipy.interpolate import make_interp_spline

    if len(time) < 2:
        return np.broadcast_to(values[:1], (len(wanted), *values.shape[1:])).copy()
    # an odd degree, because not-a-knot splines need one knot less per degree than there are samples
    degree = 3 if len(time) > 3 else 1
    return np.asarray(
        make_interp_spline(time, values, degree)(np.clip(wanted, time[0], time[-1]))
    )


def low_passed(values: Floats, ratio: float) -> Floats:
    """Take away what a slower clock cannot show, without phase; ``ratio`` is the new rate by the old one.

    Passes up to 0.8 of half the new rate; from half the new rate on the gain is below 1e-4.
    """
    with extra("identify"):
        from scipy.signal import oaconvolve

    if len(values) < 2:
        return values.copy()
    half_rate = ratio / 2
    window = fir_lowpass(PASSED * half_rate, 1.0, width=(1 - PASSED) * half_rate)
    ends = [(window.reach, window.reach)] + [(0, 0)] * (values.ndim - 1)
    longer = np.pad(values, ends, mode="reflect", reflect_type="odd")
    shape = (-1, *[1] * (values.ndim - 1))
    return oaconvolve(longer, window.taps.reshape(shape), mode="valid", axes=0)


def shift_reach(samples: float) -> int:
    """Samples on either side that a shifted signal depends on."""
    return 0 if samples == 0 else ceil(abs(samples)) + REACH


def shifted(values: Floats, samples: float) -> Floats:
    """The signal (N, …) some samples later: row k is the signal at k + samples, by Lagrange's polynomials.

    They go through nine samples, so that waves below a sixth of the rate are right to 1e-4.
    """
    with extra("identify"):
        from scipy.ndimage import correlate1d

    values = np.asarray(values, dtype=np.float64)
    whole = floor(samples + 0.5)
    rest = samples - whole
    rows = np.clip(np.arange(len(values)) + whole, 0, len(values) - 1)
    moved = values[rows]
    if abs(rest) < 1e-12:
        return moved
    places = np.arange(-REACH, REACH + 1)
    taps = np.array(
        [np.prod([(rest - m) / (k - m) for m in places if m != k]) for k in places]
    )
    return correlate1d(moved, taps, axis=0, mode="nearest")
