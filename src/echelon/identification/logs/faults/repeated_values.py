"""Values that repeat: sensors that are stuck or at a limit, signals that were held, and the steps of encoders.

A joint that rests and a sensor that is stuck look alike for as long as they stand.  What tells them apart is how they
get there: joints slow down and start again smoothly, sensors stop at full speed or jump when they wake up, or
contradict the velocity that was logged beside them.  An extreme that a channel only reaches is passed like any other
value; at one where it is pinned, samples pile up, far more than on the levels next to it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from echelon.identification.logs.recording import FEWEST
from echelon.identification.signals.chance import CLEAR, LITTLE, SHARE, usual
from echelon.identification.signals.clock import nominal_period
from echelon.identification.signals.spectrum import SHOWING
from echelon.shared import Flags, Floats, Integers

MOVED = 0.02
"""Share of a channel's range beyond which it has moved: encoders and vibrations change by less."""

_STANDING = 0.2
"""Shortest time, s, for which a sensor is stuck: joints that turn back slowly stand for less."""

_ABRUPT = 0.3
"""Share of the fastest steps of a channel from which it cannot stop within a sample."""

_PINNED = 5
"""Samples at an extreme, one after the other, that no course of a motion explains."""


def runs(flags: Flags) -> tuple[Integers, Integers]:
    """Starts and stops of the stretches where flags (N,) are set."""
    edges = np.diff(np.concatenate([[0], flags.astype(np.int8), [0]]))
    return np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)


def _equal_runs(values: Floats, usable: Flags) -> tuple[Integers, Integers]:
    """Starts and stops of the stretches of equal values, of two samples or more."""
    same = np.concatenate([(np.diff(values) == 0) & usable[1:] & usable[:-1], [False]])
    starts, stops = runs(same)
    return starts, stops + 1


def stuck(
    time: Floats,
    values: Floats,
    others: Sequence[Floats],
    speed: Floats | None,
    usable: Flags,
    output: bool,
) -> Iterator[tuple[int, int]]:
    """First and last-but-one samples of stretches in which a sensor was stuck.

    ``others`` are the other positions, or all for an output, which never rests while the robot moves; ``speed`` is the
    measured velocity of the same coordinate.
    """
    starts, stops = _equal_runs(values, usable)
    if not len(starts) or not np.any(np.diff(time[usable]) > 0):
        return
    standing = _STANDING / nominal_period(time[usable])
    lengths = stops - starts
    # coarse outputs repeat values as a rule
    repeated = usual(lengths[lengths < max(FEWEST, standing)]) if output else 1.0
    candidates = np.flatnonzero(lengths >= max(FEWEST * max(repeated, 1.0), standing))
    if not len(candidates):
        return
    steps = np.diff(values)
    steps = steps[np.isfinite(steps) & (steps != 0)]
    step = usual(steps)
    fast = float(np.percentile(np.abs(steps), 99)) if len(steps) else 0.0
    level = (resolution(values[usable]) or 0.0) if output else 0.0
    for start, stop in zip(
        starts[candidates].tolist(), stops[candidates].tolist(), strict=True
    ):
        if not _moves(others, speed, start, stop, usable):
            continue
        if output:
            is_stuck = _leaves(values, start, stop, usable, level)
        else:
            # within a level a joint moves by one step, and by another one as velocities err
            most = max(MOVED * float(np.ptp(values[usable])), 2 * step)
            is_stuck = _travelled(time, speed, start, stop) > most
            is_stuck |= _abrupt(values, start, stop, step, fast)
        if is_stuck:
            yield start, stop


def _moves(
    others: Sequence[Floats], speed: Floats | None, start: int, stop: int, usable: Flags
) -> bool:
    """Whether something moves in a stretch: another joint, or by its velocity the same one."""
    moved = any(np.ptp(v[start:stop]) > MOVED * np.ptp(v[usable]) for v in others)
    return moved or (speed is not None and bool(np.any(speed[start:stop])))


def _leaves(values: Floats, start: int, stop: int, usable: Flags, level: float) -> bool:
    """Whether an output goes on elsewhere than at the next level; at its extremes :func:`pinned` looks for it."""
    if values[start] in (np.min(values[usable]), np.max(values[usable])):
        return False
    beside = values[[max(start - 1, 0), min(stop, len(values) - 1)]]
    return not np.abs(beside - values[start]).max() <= 1.5 * level


def _travelled(time: Floats, speed: Floats | None, start: int, stop: int) -> float:
    """The way of a held position by its velocity; 0 where none was measured."""
    if speed is None:
        return 0.0
    return abs(
        float(
            np.sum(
                0.5
                * (speed[start + 1 : stop] + speed[start : stop - 1])
                * np.diff(time[start:stop])
            )
        )
    )


def _abrupt(values: Floats, start: int, stop: int, step: float, fast: float) -> bool:
    """Whether a position stops at speed, or jumps when it goes on."""
    jumps = stop < len(values) and abs(values[stop] - values[stop - 1]) > CLEAR * step
    before = np.diff(values[max(start - 2, 0) : start + 1])
    # up to a level and back again, as coarse sensors do where the motion turns, is no speed
    onwards = len(before) == 2 and before[0] * before[1] > 0
    return bool(jumps or (onwards and np.abs(before).min() > _ABRUPT * fast))


def pinned(values: Floats, usable: Flags) -> Iterator[tuple[float, Integers, Integers]]:
    """Extremes at which samples of a channel that changes pile up, with starts and stops of their stretches."""
    good = values[usable]
    span = float(np.ptp(good)) if len(good) else 0.0
    if not span:
        return
    low, high = float(good.min()), float(good.max())
    # a coarse sensor repeats every value for a while, so that one visit to an extreme proves nothing
    starts, stops = _equal_runs(values, usable & (values > low) & (values < high))
    repeated = usual(stops - starts)
    for limit in (high, low):
        at = usable & (
            np.abs(values - limit) <= 1e-9 * span
        )  # rounding of interpolated values
        starts, stops = runs(at)
        long = stops - starts >= _PINNED
        if not long.any() or (
            long.sum() == 1 and (stops - starts).max() <= CLEAR * repeated
        ):
            continue
        # the level next to the extreme counts as a neighbour, however coarse the sensor is
        next_level = float(
            good[good < high].max() if limit == high else good[good > low].min()
        )
        width = max(LITTLE * span, 1.5 * abs(limit - next_level))
        near = usable & (np.abs(values - limit) <= width) & ~at
        if (stops - starts).sum() > CLEAR * near.sum():
            yield limit, starts[long], stops[long]


def held(positions: Sequence[Floats]) -> int:
    """Samples for which moving positions are held, as where a slow signal was logged at a high rate; else 1."""
    changes = np.any([np.diff(values) != 0 for values in positions], axis=0)
    places = np.flatnonzero(changes)
    if len(places) < FEWEST:
        return 1
    apart = np.diff(places)
    rhythm = int(np.median(apart))
    if rhythm < 2 or np.mean(apart % rhythm == 0) < SHARE:
        return 1
    return rhythm if any(not _creeps(values) for values in positions) else 1


def _creeps(values: Floats) -> bool:
    """Whether a position goes from level to level of its encoder, so that it changes seldom by itself."""
    smallest, steps = resolution(values), np.abs(np.diff(values))
    return smallest is not None and bool(
        np.median(steps[steps > 0]) <= CLEAR * smallest
    )


def resolution(values: Floats) -> float | None:
    """The step of a quantised channel (N,); None if it has none."""
    levels = np.unique(values[:: max(1, len(values) // SHOWING)])
    if len(levels) < 3:
        return None
    gaps = np.diff(levels)
    gaps = gaps[gaps > 1e-9 * (levels[-1] - levels[0])]
    step = float(gaps.min())
    step = float(
        np.median(gaps[gaps < 1.5 * step])
    )  # rounding of single levels averages out
    off = np.abs(gaps / step - np.rint(gaps / step))
    return float(f"{step:.9g}") if np.all(off < 0.05) else None
