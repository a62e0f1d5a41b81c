"""Rows that a logger lost without a gap in its time stamps: all positions move twice as far at once.

From one row to the next a robot moves by about what it moved before and after.  Where a row is missing between
two, all joints move by twice that.  Steps are compared with their neighbours for all joints together, each by the noise
of its own, so that neither noise nor a single joint's jerk looks like a lost row.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from echelon.identification.logs.finding import Finding, seconds, warning
from echelon.identification.logs.recording import FEWEST, Recording
from echelon.identification.signals.chance import CLEAR, normal_deviation
from echelon.shared import Flags, Floats

_OFF = 0.4
"""Difference of the ratio of two steps from 2, up to which a row is missing: accelerations and noise make as much."""

_JERKS = 0.002
"""Share of clear steps that may be twice as long as those beside them for other reasons, such as jerks."""

_BETWEEN = 0.25
"""Steps of other lengths, by those that are twice as long: where rows are lost there are fewer."""


def with_lost_rows(recording: Recording) -> tuple[Recording, list[Finding]]:
    """A recording whose time stamps are later by a period after every row that is missing, and a finding about it."""
    q, gaps = recording.signals["q"], np.diff(recording.time)
    period = float(np.median(gaps)) if len(gaps) > 10 * FEWEST else 0.0
    even = bool(period) and bool(np.all(np.abs(gaps - period) < 0.5 * period))
    if not even or not np.isfinite(q).all():
        return recording, []
    before, after, clear = _ratios(np.diff(q, axis=0))
    twice = clear & (np.abs(before - 2) < _OFF) & (np.abs(after - 2) < _OFF)
    other = clear & (np.minimum(before, after) > 2 - 2 * _OFF) & ~twice
    if twice.sum() <= _JERKS * clear.sum() or other.sum() > _BETWEEN * twice.sum():
        return recording, []
    late = np.concatenate([[0, 0], np.cumsum(twice), [twice.sum()]])
    where = f"{recording.source}, from {seconds(float(recording.time[int(np.argmax(late > 0))]))} s"
    text = (
        f"about {twice.sum() / len(q):.1%} of the rows are missing, though time stamps are equidistant: all joints "
        "move twice as far there from one row to the next.  Time stamps were moved on by a period each time; log the "
        "time of each sample, not the number of its row"
    )
    return replace(recording, time=recording.time + period * late), [
        warning("lost rows", where, text)
    ]


def _ratios(steps: Floats) -> tuple[Floats, Floats, Flags]:
    """Steps of all joints together by those before and after them, and where both are clear; shape (rows − 3,).

    A sample that is held makes the steps beside it twice as long as the mean of their neighbours, but not as each.
    """
    before, here, after = steps[:-2], steps[1:-1], steps[2:]
    noise = normal_deviation(here - (before + after) / 2, 0.5)
    told = noise > 0
    before, here, after = (
        some[:, told] / noise[told] for some in (before, here, after)
    )
    sizes = [np.sum(some**2, axis=1) for some in (before, after)]
    ratios = [
        np.sum(some * here, axis=1) / np.maximum(size, np.finfo(float).tiny)
        for some, size in zip((before, after), sizes, strict=True)
    ]
    return ratios[0], ratios[1], np.minimum(*sizes) > (CLEAR / _OFF) ** 2
