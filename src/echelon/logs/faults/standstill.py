"""Channels that stand still: stuck sensors, saturation, and resolution.

A joint that rests and a sensor that is stuck look alike for as long as they stand.  What tells them apart is how they
get there: joints slow down and start again smoothly, sensors stop at full speed or jump when they wake up, or
contradict the velocity that was logged beside them.  An extreme that a channel only reaches is passed like any other
value; at one where it is pinned, samples pile up, far more than on the levels next to it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from echelon.arrays import Flags, Floats, Integers
from echelon.signals.clock import nominal_period

_LONG = 0.2
_FEWEST = 20
_USUAL = 20
_ABRUPT = 0.3
_JUMP = 5.0
_MOVED = 0.02
_STEPS = 2.0

_PINNED_RUN = 5
_PINNED = 10
_PILE = 5
_BAND = 1 / 200

_RHYTHM = 0.9
_CREEP = 3.0

_SAMPLED = 20_000
"""Samples that show a resolution; sorting more costs time."""


def runs(flags: Flags) -> tuple[Integers, Integers]:
    """Starts and stops of the stretches where flags (N,) are set."""
    edges = np.diff(np.concatenate([[0], flags.astype(np.int8), [0]]))
    return np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)


def stuck(
    time: Floats, values: Floats, others: Sequence[Floats], speed: Floats | None, usable: Flags, output: bool
) -> Iterator[tuple[int, int]]:
    """First and last-but-one samples of stretches in which a sensor was stuck.

    ``others`` are the other positions, or all for an output, which never rests while the robot moves; ``speed`` is the
    measured velocity of the same coordinate.
    """
    starts, stops = _equal_runs(values, usable)
    if not len(starts) or not np.any(np.diff(time[usable]) > 0):
        return
    least = max(_FEWEST, _LONG / nominal_period(time[usable]))
    if output:
        # coarse sensors repeat values as a rule; the extremes are the business of pinned()
        short = (stops - starts)[stops - starts < least]
        least = max(least, _USUAL * float(np.percentile(short, 95)) if len(short) else 0.0)
        extremes = (np.min(values[usable]), np.max(values[usable]))
    steps = np.abs(np.diff(values))
    steps = steps[np.isfinite(steps) & (steps > 0)]
    usual, fast = (float(np.percentile(steps, p)) for p in (95, 99)) if len(steps) else (0.0, 0.0)
    for start, stop in zip(starts.tolist(), stops.tolist(), strict=True):
        if stop - start < least or not _moves(others, speed, start, stop, usable):
            continue
        if output:
            if values[start] not in extremes:
                yield start, stop
        elif _contradicted(time, values, speed, start, stop, usable, usual) or _abrupt(
            values, start, stop, usual, fast
        ):
            yield start, stop


def _equal_runs(values: Floats, usable: Flags) -> tuple[Integers, Integers]:
    """Stretches of equal values, of two samples or more."""
    same = np.concatenate([(np.diff(values) == 0) & usable[1:] & usable[:-1], [False]])
    starts, stops = runs(same)
    return starts, stops + 1


def _moves(others: Sequence[Floats], speed: Floats | None, start: int, stop: int, usable: Flags) -> bool:
    moved = any(np.ptp(v[start:stop]) > _MOVED * np.ptp(v[usable]) for v in others)
    return moved or (speed is not None and bool(np.any(speed[start:stop])))


def _contradicted(
    time: Floats, values: Floats, speed: Floats | None, start: int, stop: int, usable: Flags, step: float
) -> bool:
    """Whether the velocity says that a held position moved further than the steps of its sensor explain."""
    if speed is None:
        return False
    travelled = float(np.sum(0.5 * (speed[start + 1 : stop] + speed[start : stop - 1]) * np.diff(time[start:stop])))
    return abs(travelled) > max(_MOVED * float(np.ptp(values[usable])), _STEPS * step)


def _abrupt(values: Floats, start: int, stop: int, usual: float, fast: float) -> bool:
    """Whether a position stops at speed, or jumps when it goes on."""
    jumps = stop < len(values) and abs(values[stop] - values[stop - 1]) > _JUMP * usual
    before = np.abs(np.diff(values[max(start - 2, 0) : start + 1]))
    return bool(jumps or (len(before) == 2 and before.min() > _ABRUPT * fast))


def pinned(values: Floats, usable: Flags) -> Iterator[tuple[float, Integers, Integers]]:
    """Extremes at which samples of a channel that changes pile up, with starts and stops of their stretches."""
    good = values[usable]
    span = float(np.ptp(good))
    low, high = float(good.min()), float(good.max())
    for limit in (high, low):
        at = usable & (np.abs(values - limit) <= 1e-9 * span)
        if at.sum() < _PINNED:
            continue
        # the level next to the extreme counts as a neighbour, however coarse the sensor is
        next_level = float(good[good < high].max() if limit == high else good[good > low].min())
        width = max(_BAND * span, 1.5 * abs(limit - next_level))
        near = usable & (np.abs(values - limit) <= width) & ~at
        starts, stops = runs(at)
        long = stops - starts >= _PINNED_RUN
        if long.any() and at.sum() > _PILE * near.sum():
            yield limit, starts[long], stops[long]


def held(positions: Sequence[Floats]) -> int:
    """Samples for which moving positions are held, as where a slow signal was logged at a high rate; else 1."""
    if not positions:
        return 1
    steps = np.stack([np.diff(values) for values in positions])
    places = np.flatnonzero(np.any(steps != 0, axis=0))
    if len(places) < _FEWEST:
        return 1
    apart = np.diff(places)
    rhythm = int(np.median(apart))
    if rhythm < 2 or np.mean(apart % rhythm == 0) < _RHYTHM:
        return 1
    for values, changes in zip(positions, np.abs(steps), strict=True):
        smallest = resolution(values)
        if smallest is None or np.median(changes[changes > 0]) > _CREEP * smallest:
            return rhythm
    return 1


def resolution(values: Floats) -> float | None:
    """The step of a quantised channel (N,); None if it has none."""
    levels = np.unique(values[:: max(1, len(values) // _SAMPLED)])
    if len(levels) < 3:
        return None
    gaps = np.diff(levels)
    gaps = gaps[gaps > 1e-9 * (levels[-1] - levels[0])]
    step = float(gaps.min())
    step = float(np.median(gaps[gaps < 1.5 * step]))  # rounding of single levels averages out
    off = np.abs(gaps / step - np.rint(gaps / step))
    return float(f"{step:.9g}") if np.all(off < 0.05) else None
