"""Samples off the course of a channel: spikes that damaged messages leave, and jumps of encoders that are set anew."""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from echelon.identification.logs.columns.column_map import WRAP
from echelon.identification.logs.faults.repeated_values import MOVED
from echelon.identification.logs.recording import FEWEST
from echelon.identification.signals.chance import CLEAR, LITTLE, usual
from echelon.shared import Flags, Floats, Integers

NO_ENCODER = 2e-9
"""Noise, rad or m, that is less than any encoder has: one of 26 bits per turn has steps of 9e-8 rad."""

TALL = {"q": MOVED, "qd": 0.5, "y": 0.5}
"""Share of its range by which a spike of a signal is off; velocities and forces may be rough."""

_SHORTEST = 10 * FEWEST
"""Samples of a channel, fewer of which do not tell what its course is."""


def spikes(values: Floats, tall: float, turns: bool) -> Integers:
    """Samples, one or two in a row, that lie off the others by more than a share of their range."""
    steps = np.abs(np.diff(values))
    if len(values) < _SHORTEST or not steps.max() > 0.5 * tall / (1 + tall) * np.ptp(
        values
    ):
        return np.zeros(0, dtype=np.intp)
    values = np.unwrap(values, discont=WRAP) if turns else values
    course = _medians(values, 5)
    off = np.abs(values - course)
    around = _medians(off, 9)  # what rings or trembles for a while is no spike
    most = np.maximum(around, max(usual(off), float(np.median(steps[steps > 0]))))
    return np.flatnonzero((off > CLEAR * most) & (off > tall * np.ptp(course)))


def _medians(values: Floats, width: int) -> Floats:
    """Running medians over an odd number of values."""
    return np.median(
        sliding_window_view(np.pad(values, width // 2, mode="edge"), width), axis=1
    )


def jumps(time: Floats, values: Floats, usable: Flags, turns: bool) -> Integers:
    """Samples after which a position is elsewhere, though it goes on as before."""
    apart = np.diff(time)
    good = usable[1:] & usable[:-1] & (apart > 0)
    least = LITTLE * np.ptp(values[usable]) if usable.any() else 0.0
    step = np.where(good, np.diff(values), 0.0)
    if good.sum() < _SHORTEST or np.abs(step).max() <= least:  # as nearly always
        return np.zeros(0, dtype=np.intp)
    step /= np.maximum(apart / np.median(apart[good]), 1.0)
    if turns:
        whole_turns = 2 * np.pi * np.rint(step / (2 * np.pi))
        step = np.where(np.abs(step) > WRAP, step - whole_turns, step)
    before, after = np.append(step[0], step[:-1]), np.append(step[1:], step[-1])
    off = np.abs(step - 0.5 * (before + after))
    beside = np.maximum(np.abs(before), np.abs(after))
    alone = (np.abs(step) > CLEAR * beside) & (np.abs(step) > least)
    # a sensor that wakes up goes on elsewhere, too
    return np.flatnonzero(
        alone & (off > CLEAR * max(usual(off), NO_ENCODER)) & (before != 0)
    )
