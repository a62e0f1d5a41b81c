"""How a measured rate follows the signal that it should be the rate of: a slope with an error that can be believed.

A rate is integrated over windows, and its integrals are regressed on how far the signal moves meanwhile.  Integrals of
measured velocities are noisy, travels of encoders hardly are, so the slope of travels against integrals, the other way
round, would be too small.  What noise travels have, as of coarse encoders, is kept out by an instrument: how far the
signal moves over a window and its two neighbours, which shares no sample with the travel over the window itself.

Residuals of neighbouring windows depend on one another: velocities are filtered and late, forces follow the course of a
motion.  So the error comes from sums over blocks of windows, and so does that of the difference between two signals
that a rate could be of.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np

from echelon.identification.signals.chance import CLEAR, usual
from echelon.identification.signals.clock import GAP
from echelon.shared import Floats

_WINDOWS = 400
"""Windows over a log: in a minute's motion one is a tenth of the time that a joint takes to turn back."""

_BLOCKS = 16
"""Blocks of windows: enough for an error of 20 % of a standard error."""

NEAR = 0.1
"""Relative error up to which a slope is told, and difference from that of a unit that filters and delays explain."""

_INTEGRALS = 1e-4
"""Relative error of integrals of sampled velocities, which no slope is surer than."""


@dataclass(frozen=True)
class Rate:
    """How a signal follows another one as its rate."""

    slope: float  # its integral by the travel of the other one: 1 for a rate in the same units; nan where nothing moves
    error: float  # standard error of the slope
    squares: Floats  # of what the slope leaves of the integrals, by blocks of windows

    @property
    def relative(self) -> float:
        """Standard error of the slope as a share of it; inf where nothing moves."""
        if np.isfinite(self.slope) and self.slope:
            return self.error / abs(self.slope)
        return np.inf

    def explains_more(self, other: Rate) -> bool:
        """Whether this leaves less than the other, by more than chance; in each block by its own size."""
        least = np.finfo(float).tiny
        gained = np.log(
            np.maximum(other.squares, least) / np.maximum(self.squares, least)
        )
        return bool(gained.mean() > CLEAR * gained.std(ddof=1) / np.sqrt(len(gained)))


def rate(signal: Floats, measured: Floats, time: Floats) -> Rate:
    """The slope of integrals of ``measured`` (N,) against travels of ``signal`` (N,) at times (N,), s or samples.

    Windows with values that are not finite, or across gaps, are left out.
    """
    nothing = Rate(np.nan, np.nan, np.zeros(_BLOCKS))
    step = np.diff(time)
    width = max(2, len(step) // _WINDOWS)
    ends = np.arange(0, len(time), width)
    if len(ends) < _BLOCKS + 3:
        return nothing
    # by cubics through four samples: at 50 Hz, trapezoids would miss a fast joint's travel by a thousandth
    wider = np.pad(measured, 1, mode="edge")
    integrals = (
        (13 * (measured[1:] + measured[:-1]) - wider[:-3] - wider[3:]) / 24 * step
    )
    integrals[(step < 0) | (step > GAP * np.median(step[ends[:-1]]))] = np.nan
    area = np.add.reduceat(integrals[: ends[-1]], ends[:-1])[1:-1]
    places = signal[ends]
    moved, around = np.diff(places)[1:-1], places[3:] - places[:-3]
    inside = np.isfinite(area) & np.isfinite(moved) & np.isfinite(around)
    for travels in (
        moved,
        around,
    ):  # encoders that are set anew travel as no joint does
        inside &= np.abs(travels) <= CLEAR * usual(travels[inside])
    if inside.sum() < _BLOCKS:
        return nothing
    # means are taken off: velocities have offsets
    moved, around, area = (
        np.where(inside, some - some[inside].mean(), 0.0)
        for some in (moved, around, area)
    )
    travelled = float(around @ moved)
    if travelled <= 0:
        return nothing
    slope = float(around @ area) / travelled
    left = area - slope * moved
    sums = np.array([block.sum() for block in np.array_split(around * left, _BLOCKS)])
    squares = np.array([block @ block for block in np.array_split(left, _BLOCKS)])
    return Rate(
        slope,
        float(np.sqrt(sums @ sums * _BLOCKS / (_BLOCKS - 1))) / travelled,
        squares,
    )


def common_slope(rates: Sequence[Rate]) -> tuple[float, float]:
    """The weighted mean of some slopes and its standard error.

    Slopes that differ by more than their errors make that of the mean as much larger.
    """
    slopes = np.array([some.slope for some in rates])
    errors = np.array([max(some.error, _INTEGRALS * abs(some.slope)) for some in rates])
    weights = errors**-2.0
    mean = float(weights @ slopes / weights.sum())
    excess = float(weights @ (slopes - mean) ** 2) / max(len(slopes) - 1, 1)
    return mean, sqrt(max(excess, 1.0) / weights.sum())
