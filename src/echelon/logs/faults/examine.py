"""Faults of a log: what sensors, drives and loggers do wrong, found channel by channel and named.

Only what is certainly no measurement is taken out: values that are not finite, quaternions of length zero, spikes of
one or two samples, sensors that stand still while the robot moves.  Everything else is reported, because only the user
knows whether it is a fault.

A joint that rests and a sensor that is stuck look alike for as long as they stand.  What tells them apart is how they
get there: joints slow down and start again smoothly, sensors stop at full speed or jump when they wake up, or
contradict the velocity that was logged beside them.  An extreme that a channel only reaches is passed like any other
value; at one where it is pinned, samples pile up, far more than on the levels next to it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from echelon.arrays import Flags, Floats, Integers
from echelon.errors import InputError
from echelon.logs.columns.column_map import (
    WRAP,
    Series,
    motion_of,
    quaternion_columns,
    series,
)
from echelon.logs.faults.plausibility import contradictions
from echelon.logs.finding import (
    Finding,
    Severity,
    counted,
    listed,
    note,
    seconds,
    warning,
)
from echelon.logs.recording import Recording
from echelon.mechanism.joint import MotionKind
from echelon.mechanism.mechanism import Mechanism
from echelon.signals.clock import nominal_period, round_rate
from echelon.signals.spectrum import white_noise

Found = list[Finding]

_FAR_FROM_UNIT = 0.1
_NOT_UNIT = 1e-3
_COARSE = 0.3
_NO_ENCODER = 2e-9  # rad or m: one of 26 bits per turn has steps of 9e-8 rad
_ORDER = 8  # of the differences that leave noise: they take away motion down to some 30 samples per period
_SAMPLED = 101  # of so many samples one is compared first, to tell which channels may be the same


def examine(
    recording: Recording,
    mechanism: Mechanism,
    *,
    whole: bool = True,
    named: bool = True,
) -> tuple[tuple[Finding, ...], Flags]:
    """Findings about a recording, and which of its samples (N,) are usable.

    Of a piece of a log, ``whole=False``, nothing is said about channels that never change.  Where nobody asks for
    findings, ``named=False``, only what takes samples out is looked for.
    """
    if not len(recording.time):
        raise InputError("the log has no samples", source=recording.source)
    findings: Found = []
    usable = _not_finite(recording, list(series(recording, mechanism)), whole, findings)
    recording = _without_infinities(recording)
    channels = list(series(recording, mechanism))
    usable &= _quaternions(recording, mechanism, findings)
    y = recording.signals.get("y")
    if whole and y is not None and y.size and usable.any() and not np.any(y[usable]):
        problem = "all measured outputs are zero, so there is nothing to identify: are these the right columns?"
        raise InputError(problem, source=recording.source)
    moving = _constant(recording, channels, usable, whole, findings)
    _spikes(recording, moving, mechanism, usable, findings)
    _jumps(recording, moving, mechanism, usable, findings)
    asleep: Found = []
    awake = _stuck(recording, moving, usable, asleep)
    if not named:
        return (), usable & awake
    _duplicates(recording, moving, usable, findings)
    _saturation(recording, moving, usable, findings)
    findings += asleep
    usable &= awake
    _resolution(recording, moving, usable, findings)
    _smooth(recording, moving, usable, findings)
    _held(recording, moving, usable, findings)
    findings += contradictions(recording, mechanism, usable)
    return tuple(findings), usable


def _not_finite(
    recording: Recording, channels: Sequence[Series], whole: bool, findings: Found
) -> Flags:
    usable = np.isfinite(recording.time)
    if not usable.all():
        count = int(np.sum(~usable))
        where = f"{recording.source}, time, row {int(np.argmin(usable))}"
        findings.append(
            warning(
                "not finite",
                where,
                f"{counted(count, 'sample')} without a time; left out",
            )
        )
    timeless = ~usable
    for channel in channels:
        good = np.isfinite(channel.values) | timeless
        if good.all():
            continue
        if whole and not np.isfinite(channel.values).any():
            raise InputError(
                "it holds no numbers, only NaN",
                source=recording.source,
                element=channel.label,
            )
        starts, stops = runs(~good)
        text = (
            f"{counted(int(np.sum(~good)), 'sample')} not finite (NaN or infinite), in "
            f"{counted(len(starts), 'run')} of up to {int((stops - starts).max())}; left out"
        )
        findings.append(_at(recording, channel, "not finite", int(starts[0]), text))
        usable &= good
    return usable


def _without_infinities(recording: Recording) -> Recording:
    """NaN for all that is not finite: differences of infinities would warn."""

    def clean(values: Floats) -> Floats:
        return (
            values
            if np.isfinite(values).all()
            else np.where(np.isfinite(values), values, np.nan)
        )

    signals = {name: clean(values) for name, values in recording.signals.items()}
    inputs = {name: clean(values) for name, values in recording.inputs.items()}
    return replace(
        recording, time=clean(recording.time), signals=signals, inputs=inputs
    )


def _quaternions(recording: Recording, mechanism: Mechanism, findings: Found) -> Flags:
    usable = np.ones(len(recording.time), dtype=bool)
    q = recording.signals["q"]
    positions = list(series(recording, mechanism, "q"))
    for first in quaternion_columns(mechanism, "q", q.shape[1]):
        length = np.linalg.norm(q[:, first : first + 4], axis=1)
        off = np.abs(length - 1)
        name = positions[first].name.removesuffix(".w")
        ball = Series("q", name, length)
        wrong = (
            off > _FAR_FROM_UNIT
        )  # false where it is NaN, which is reported elsewhere
        if wrong.any():
            usable &= ~wrong
            text = (
                f"{counted(int(wrong.sum()), 'sample')} with a quaternion of length {length[wrong].min():.3g} to "
                f"{length[wrong].max():.3g} instead of 1; left out.  Are these columns w, x, y, z?"
            )
            findings.append(
                _at(recording, ball, "quaternion", int(np.argmax(wrong)), text)
            )
        elif np.any(off > _NOT_UNIT):
            text = f"quaternions have lengths from {np.nanmin(length):.6g} to {np.nanmax(length):.6g}; normalised"
            findings.append(
                _at(
                    recording,
                    ball,
                    "quaternion",
                    int(np.argmax(off > _NOT_UNIT)),
                    text,
                    Severity.NOTE,
                )
            )
    return usable


def _constant(
    recording: Recording,
    channels: Sequence[Series],
    usable: Flags,
    whole: bool,
    findings: Found,
) -> list[Series]:
    """Report channels that never change; the others."""
    moving = []
    for channel in channels:
        values = channel.values[_rows(usable)]
        if len(values) and np.ptp(values) > 0:
            moving.append(channel)
        elif whole and len(values) > 1:
            what = {
                "q": "parameters that only its motion excites cannot be identified; without them it is  locked: "
                f"{{{channel.name}: {values[0]:.6g}}}",
                "y": "is the sensor connected, and is this its column?",
            }.get(channel.signal, "is this its column?")
            text = f"is {values[0]:.6g} in all {len(values)} samples: {what}"
            findings.append(
                warning("constant", f"{recording.source}, {channel.label}", text)
            )
    return moving


def _duplicates(
    recording: Recording, channels: Sequence[Series], usable: Flags, findings: Found
) -> None:
    alike: dict[bytes, list[Series]] = {}
    for channel in channels:
        alike.setdefault(
            channel.values[_rows(usable)][::_SAMPLED].tobytes(), []
        ).append(channel)
    groups: dict[bytes, list[Series]] = {}
    for channel in (
        channel for group in alike.values() if len(group) > 1 for channel in group
    ):
        groups.setdefault(channel.values[usable].tobytes(), []).append(channel)
    for group in groups.values():
        # two joints may well be asked to move alike, but they will not
        told = {channel.signal for channel in group}
        # of friction that grows with the load, its input is the output
        loads = told == {"y", "input"} and len({channel.name for channel in group}) == 1
        if len(group) > 1 and told != {"reference"} and not loads:
            others = listed(channel.label for channel in group[1:])
            text = f"has the same values as {others} in every sample: was one column taken twice?"
            findings.append(
                warning("duplicate", f"{recording.source}, {group[0].label}", text)
            )


def _saturation(
    recording: Recording, channels: Sequence[Series], usable: Flags, findings: Found
) -> None:
    motion = _motion(channels)
    for channel in channels:
        if channel.signal != "y":
            continue
        for limit, starts, stops in pinned(channel.values, usable):
            moved = any(
                np.ptp(m[a:b]) > 0
                for m in motion
                for a, b in zip(starts[:50], stops[:50], strict=True)
            )
            if not moved:
                continue
            count = int((stops - starts).sum())
            text = (
                f"is pinned at its extreme {limit:.6g} in {counted(count, 'sample')} ({count / len(usable):.2%}), in "
                f"runs of up to {int((stops - starts).max())}: rows of this output are left out there"
            )
            findings.append(_at(recording, channel, "saturation", int(starts[0]), text))


def _stuck(
    recording: Recording, channels: Sequence[Series], usable: Flags, findings: Found
) -> Flags:
    kept = np.ones(len(usable), dtype=bool)
    speeds = {
        channel.name: channel.values for channel in channels if channel.signal == "qd"
    }
    for channel in channels:
        if channel.signal not in ("q", "y"):
            continue
        others = [c.values for c in channels if c.signal == "q" and c is not channel]
        speed = speeds.get(channel.name) if channel.signal == "q" else None
        for start, stop in stuck(
            recording.time, channel.values, others, speed, usable, channel.signal == "y"
        ):
            kept[start:stop] = False
            text = (
                f"stays at exactly {channel.values[start]:.6g} until {seconds(recording.time[stop - 1])} s "
                f"({counted(stop - start, 'sample')}) while the robot moves: stuck; left out"
            )
            findings.append(_at(recording, channel, "stuck", start, text))
    return kept


def _spikes(
    recording: Recording,
    channels: Sequence[Series],
    mechanism: Mechanism,
    usable: Flags,
    findings: Found,
) -> None:
    """Samples that leave the course of a channel and return at once, as damaged messages do; taken out."""
    for channel in (channel for channel in channels if channel.signal in _TALL):
        motion = motion_of(mechanism, channel.name) if channel.signal == "q" else None
        turns = motion is not None and motion.kind is MotionKind.ROTATION
        places = spikes(channel.values[_rows(usable)], _TALL[channel.signal], turns)
        if len(places):
            places = np.flatnonzero(usable)[places]
            usable[places] = False
            text = f"{counted(len(places), 'sample lies', 'samples lie')} far off the course before and after; left out"
            findings.append(_at(recording, channel, "spikes", int(places[0]), text))


def spikes(values: Floats, tall: float, turns: bool) -> Integers:
    """Samples, one or two in a row, that lie off the others by more than a share of their range."""
    steps = np.abs(np.diff(values))
    if len(values) < 10 * _FEWEST or not steps.max() > 0.5 * tall / (1 + tall) * np.ptp(
        values
    ):
        return np.zeros(0, dtype=np.intp)
    values = np.unwrap(values, discont=WRAP) if turns else values
    course = _medians(values, 5)
    off = np.abs(values - course)
    usual = max(float(np.percentile(off, _MOSTLY)), float(np.median(steps[steps > 0])))
    around = _medians(off, 9)  # what rings or trembles for a while is no spike
    return np.flatnonzero(
        (off > _LEAP * np.maximum(around, usual)) & (off > tall * np.ptp(course))
    )


def _medians(values: Floats, width: int) -> Floats:
    """Medians of so many neighbouring values, an odd number."""
    return np.median(
        sliding_window_view(np.pad(values, width // 2, mode="edge"), width), axis=1
    )


def _jumps(
    recording: Recording,
    channels: Sequence[Series],
    mechanism: Mechanism,
    usable: Flags,
    findings: Found,
) -> None:
    """Positions that no joint can pass between two samples, as where an encoder was set to another zero; taken out."""
    found: dict[int, list[Series]] = {}
    for channel in channels:
        motion = motion_of(mechanism, channel.name) if channel.signal == "q" else None
        if motion is not None and motion.kind is not MotionKind.BALL:
            for place in jumps(
                recording.time,
                channel.values,
                usable,
                motion.kind is MotionKind.ROTATION,
            ).tolist():
                found.setdefault(place, []).append(channel)
    for place, where in found.items():
        size, kind = (
            where[0].values[place + 1] - where[0].values[place],
            "contradiction",
        )
        text = (
            f"jumps by {size:.4g} between two samples: was the encoder set to another zero?  Use the part before or "
            "after it, or give each part as a file of its own, with the offset of each"
        )
        if len(where) > 1:
            others = listed(channel.name for channel in where[1:])
            kind, text = (
                "gap",
                f"jumps by {size:.4g} between two samples, with {others}: are samples missing?",
            )
        findings.append(_at(recording, where[0], kind, place + 1, text))
        usable[max(place - _CUT, 0) : place + _CUT + 2] = False


def jumps(time: Floats, values: Floats, usable: Flags, turns: bool) -> Integers:
    """Samples after which a position is elsewhere, though it goes on as before."""
    apart = np.diff(time)
    good = usable[1:] & usable[:-1] & (apart > 0)
    if good.sum() < 10 * _FEWEST:
        return np.zeros(0, dtype=np.intp)
    step, least = (
        np.where(good, np.diff(values), 0.0),
        _LEAST_JUMP * np.ptp(values[usable]),
    )
    if np.abs(step).max() <= least:  # as nearly always
        return np.zeros(0, dtype=np.intp)
    step /= np.maximum(apart / np.median(apart[good]), 1.0)
    if turns:
        whole = np.rint(step / (2 * np.pi))
        step = np.where(np.abs(step) > WRAP, step - 2 * np.pi * whole, step)
    before, after = np.append(step[0], step[:-1]), np.append(step[1:], step[-1])
    off = np.abs(step - 0.5 * (before + after))
    usual = float(np.sort(off)[-max(_FEWEST, len(off) // 500)])
    alone = np.abs(step) > _LEAP * np.maximum(np.abs(before), np.abs(after))
    alone &= np.abs(step) > least
    # a sensor that wakes up goes on elsewhere, too
    return np.flatnonzero(
        alone & (off > _LEAP * max(usual, _NO_ENCODER)) & (before != 0)
    )


def _resolution(
    recording: Recording, channels: Sequence[Series], usable: Flags, findings: Found
) -> None:
    for channel in channels:
        if channel.signal != "q":
            continue
        values = channel.values[_rows(usable)]
        step = resolution(values)
        if step and step > _COARSE * float(np.sqrt(np.mean(np.diff(values) ** 2))):
            text = f"comes in steps of {step:.4g}, coarse for its motion: derivatives need a low cut-off"
            where = f"{recording.source}, {channel.label}"
            findings.append(note("resolution", where, text))


def _smooth(
    recording: Recording, channels: Sequence[Series], usable: Flags, findings: Found
) -> None:
    """Positions without the noise or the steps that every encoder has."""
    noise = {
        channel.name: white_noise(channel.values[_rows(usable)], _ORDER)
        for channel in channels
        if channel.signal == "q" and usable.sum() > 10 * _ORDER
    }
    if noise and max(noise.values()) < _NO_ENCODER:
        text = (
            f"their noise is at most {max(noise.values()):.1g} (rad, m), less than any encoder has: they were "
            "smoothed, commanded or simulated, and tell less of the robot's motion than they seem to"
        )
        findings.append(note("smooth", f"{recording.source}, positions", text))


def _held(
    recording: Recording, channels: Sequence[Series], usable: Flags, findings: Found
) -> None:
    count = held([values[_rows(usable)] for values in _motion(channels)])
    steps = np.diff(recording.time[usable])
    if count > 1 and np.any(steps > 0):
        rate = round_rate(nominal_period(recording.time[usable]) * count)
        text = (
            f"change only every {count} samples: they were taken at {rate:g} Hz and held, so derivatives show the "
            f"steps; resample (rate: {rate:g}), or log at that rate"
        )
        findings.append(warning("held", f"{recording.source}, positions", text))


def _rows(usable: Flags) -> Flags | slice:
    """The usable rows; as a slice, which copies nothing, where that is all of them."""
    return slice(None) if usable.all() else usable


def _motion(channels: Sequence[Series]) -> list[Floats]:
    return [channel.values for channel in channels if channel.signal == "q"]


def _at(
    recording: Recording,
    channel: Series,
    kind: str,
    row: int,
    text: str,
    severity: Severity = Severity.WARNING,
) -> Finding:
    where = f"{recording.source}, {channel.label}, from {seconds(float(recording.time[row]))} s"
    return Finding(severity, kind, where, text)


_LONG = 0.2
_FEWEST = 20
_USUAL = 20
_ABRUPT = 0.3
_JUMP = 5.0
_MOVED = 0.02
_STEPS = 2.0
_FEW_LEVELS = 30
_LEAP = 5.0
_LEAST_JUMP = 5e-3
_TALL = {
    "q": 0.02,
    "qd": 0.5,
    "y": 0.5,
}  # share of its range by which a spike of a signal is off; forces may be rough
_MOSTLY = 98.0  # per cent of the samples that are no spikes at least
_CUT = 6  # samples on both sides, so that stretches end there

_PINNED_RUN = 5
_PINNED = 10
_PILE = 5
_BAND = 1 / 200

_RHYTHM = 0.9
_CREEP = 3.0

_SORTED = 20_000  # samples that show a resolution; sorting more costs time


def runs(flags: Flags) -> tuple[Integers, Integers]:
    """Starts and stops of the stretches where flags (N,) are set."""
    edges = np.diff(np.concatenate([[0], flags.astype(np.int8), [0]]))
    return np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)


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
    least = max(_FEWEST, _LONG / nominal_period(time[usable]))
    if output:
        # coarse sensors repeat values as a rule; the extremes are the business of pinned()
        short = (stops - starts)[stops - starts < least]
        least = max(
            least, _USUAL * float(np.percentile(short, 95)) if len(short) else 0.0
        )
        extremes = (np.min(values[usable]), np.max(values[usable]))
        levels = np.unique(values[usable])
        level = float(np.diff(levels).max()) if 1 < len(levels) <= _FEW_LEVELS else 0.0
    steps = np.abs(np.diff(values))
    steps = steps[np.isfinite(steps) & (steps > 0)]
    usual, fast = (
        (float(np.percentile(steps, p)) for p in (95, 99)) if len(steps) else (0.0, 0.0)
    )
    for start, stop in zip(starts.tolist(), stops.tolist(), strict=True):
        if stop - start < least or not _moves(others, speed, start, stop, usable):
            continue
        if output:
            # a sensor with few levels stays at one of them until the next one is reached
            beside = values[[max(start - 1, 0), min(stop, len(values) - 1)]]
            if (
                values[start] not in extremes
                and not np.abs(beside - values[start]).max() <= level
            ):
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


def _moves(
    others: Sequence[Floats], speed: Floats | None, start: int, stop: int, usable: Flags
) -> bool:
    moved = any(np.ptp(v[start:stop]) > _MOVED * np.ptp(v[usable]) for v in others)
    return moved or (speed is not None and bool(np.any(speed[start:stop])))


def _contradicted(
    time: Floats,
    values: Floats,
    speed: Floats | None,
    start: int,
    stop: int,
    usable: Flags,
    step: float,
) -> bool:
    """Whether the velocity says that a held position moved further than the steps of its sensor explain."""
    if speed is None:
        return False
    travelled = float(
        np.sum(
            0.5
            * (speed[start + 1 : stop] + speed[start : stop - 1])
            * np.diff(time[start:stop])
        )
    )
    return abs(travelled) > max(_MOVED * float(np.ptp(values[usable])), _STEPS * step)


def _abrupt(values: Floats, start: int, stop: int, usual: float, fast: float) -> bool:
    """Whether a position stops at speed, or jumps when it goes on."""
    jumps = stop < len(values) and abs(values[stop] - values[stop - 1]) > _JUMP * usual
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
    usual = float(np.percentile(stops - starts, 99)) if len(starts) else 0.0
    for limit in (high, low):
        at = usable & (np.abs(values - limit) <= 1e-9 * span)
        if at.sum() < _PINNED:
            continue
        # the level next to the extreme counts as a neighbour, however coarse the sensor is
        next_level = float(
            good[good < high].max() if limit == high else good[good > low].min()
        )
        width = max(_BAND * span, 1.5 * abs(limit - next_level))
        near = usable & (np.abs(values - limit) <= width) & ~at
        starts, stops = runs(at)
        long = stops - starts >= _PINNED_RUN
        clear = long.sum() > 1 or (stops - starts).max() > 2 * usual
        if long.any() and clear and at.sum() > _PILE * near.sum():
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
    levels = np.unique(values[:: max(1, len(values) // _SORTED)])
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
