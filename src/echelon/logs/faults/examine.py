"""Faults of a log: what sensors, drives and loggers do wrong, found channel by channel and named.

Only what is certainly no measurement is taken out: values that are not finite, quaternions of length zero, sensors that
stand still while the robot moves.  Everything else is reported, because only the user knows whether it is a fault.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from echelon.arrays import Flags, Floats
from echelon.errors import InputError
from echelon.logs.columns.quantities import Series, quaternion_columns, series
from echelon.logs.faults.plausibility import contradictions
from echelon.logs.faults.standstill import held, pinned, resolution, runs, stuck
from echelon.logs.finding import Finding, Severity, counted, listed, note, seconds, warning
from echelon.logs.recording import Recording
from echelon.mechanism.mechanism import Mechanism
from echelon.signals.clock import nominal_period, round_rate
from echelon.signals.spectrum import white_noise

Found = list[Finding]

_FAR_FROM_UNIT = 0.1
_NOT_UNIT = 1e-3
_COARSE = 0.3
_NO_ENCODER = 2e-9  # rad or m: one of 26 bits per turn has steps of 9e-8 rad
_ORDER = 8  # of the differences that leave noise: they take away motion down to some 30 samples per period
_SAMPLED = 101
"""Of so many samples one is compared first, to tell which channels may be the same."""


def examine(recording: Recording, mechanism: Mechanism, *, whole: bool = True) -> tuple[tuple[Finding, ...], Flags]:
    """Findings about a recording, and which of its samples (N,) are usable.

    Of a piece of a log, ``whole=False``, nothing is said about channels that never change.
    """
    if not len(recording.time):
        raise InputError("the log has no samples", source=recording.source)
    findings: Found = []
    usable = _not_finite(recording, list(series(recording, mechanism)), whole, findings)
    recording = _without_infinities(recording)
    channels = list(series(recording, mechanism))
    usable &= _quaternions(recording, mechanism, findings)
    if whole:
        _refuse_silence(recording, usable)
    moving = _constant(recording, channels, usable, whole, findings)
    _duplicates(recording, moving, usable, findings)
    _saturation(recording, moving, usable, findings)
    usable &= _stuck(recording, moving, usable, findings)
    _resolution(recording, moving, usable, findings)
    _smooth(recording, moving, usable, findings)
    _held(recording, moving, usable, findings)
    findings += contradictions(recording, mechanism, usable)
    return tuple(findings), usable


def _not_finite(recording: Recording, channels: Sequence[Series], whole: bool, findings: Found) -> Flags:
    usable = np.isfinite(recording.time)
    if not usable.all():
        count = int(np.sum(~usable))
        where = f"{recording.source}, time, row {int(np.argmin(usable))}"
        findings.append(warning("not finite", where, f"{counted(count, 'sample')} without a time; left out"))
    for channel in channels:
        good = np.isfinite(channel.values)
        if good.all():
            continue
        if whole and not good.any():
            raise InputError("it holds no numbers, only NaN", source=recording.source, element=channel.label)
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
        return values if np.isfinite(values).all() else np.where(np.isfinite(values), values, np.nan)

    signals = {name: clean(values) for name, values in recording.signals.items()}
    inputs = {name: clean(values) for name, values in recording.inputs.items()}
    return replace(recording, time=clean(recording.time), signals=signals, inputs=inputs)


def _quaternions(recording: Recording, mechanism: Mechanism, findings: Found) -> Flags:
    usable = np.ones(len(recording.time), dtype=bool)
    q = recording.signals["q"]
    positions = list(series(recording, mechanism, "q"))
    for first in quaternion_columns(mechanism, "q", q.shape[1]):
        length = np.linalg.norm(q[:, first : first + 4], axis=1)
        off = np.abs(length - 1)
        name = positions[first].name.removesuffix(".w")
        ball = Series("q", name, length)
        wrong = off > _FAR_FROM_UNIT  # false where it is NaN, which is reported elsewhere
        if wrong.any():
            usable &= ~wrong
            text = (
                f"{counted(int(wrong.sum()), 'sample')} with a quaternion of length {length[wrong].min():.3g} to "
                f"{length[wrong].max():.3g} instead of 1; left out.  Are these columns w, x, y, z?"
            )
            findings.append(_at(recording, ball, "quaternion", int(np.argmax(wrong)), text))
        elif np.any(off > _NOT_UNIT):
            text = f"quaternions have lengths from {np.nanmin(length):.6g} to {np.nanmax(length):.6g}; normalised"
            findings.append(_at(recording, ball, "quaternion", int(np.argmax(off > _NOT_UNIT)), text, Severity.NOTE))
    return usable


def _refuse_silence(recording: Recording, usable: Flags) -> None:
    y = recording.signals.get("y")
    if y is not None and y.size and usable.any() and not np.any(y[usable]):
        problem = "all measured outputs are zero, so there is nothing to identify: are these the right columns?"
        raise InputError(problem, source=recording.source)


def _constant(
    recording: Recording, channels: Sequence[Series], usable: Flags, whole: bool, findings: Found
) -> list[Series]:
    """Report channels that never change; the others."""
    moving = []
    for channel in channels:
        values = channel.values[_rows(usable)]
        if len(values) and np.ptp(values) > 0:
            moving.append(channel)
        elif whole and len(values) > 1:
            what = {
                "q": "parameters that only its motion excites cannot be identified",
                "y": "is the sensor connected, and is this its column?",
            }.get(channel.signal, "is this its column?")
            text = f"is {values[0]:.6g} in all {len(values)} samples: {what}"
            findings.append(warning("constant", f"{recording.source}, {channel.label}", text))
    return moving


def _duplicates(recording: Recording, channels: Sequence[Series], usable: Flags, findings: Found) -> None:
    alike: dict[bytes, list[Series]] = {}
    for channel in channels:
        alike.setdefault(channel.values[_rows(usable)][::_SAMPLED].tobytes(), []).append(channel)
    groups: dict[bytes, list[Series]] = {}
    for channel in (channel for group in alike.values() if len(group) > 1 for channel in group):
        groups.setdefault(channel.values[usable].tobytes(), []).append(channel)
    for group in groups.values():
        # two joints may well be asked to move alike, but they will not
        if len(group) > 1 and any(channel.signal != "reference" for channel in group):
            others = listed(channel.label for channel in group[1:])
            text = f"has the same values as {others} in every sample: was one column taken twice?"
            findings.append(warning("duplicate", f"{recording.source}, {group[0].label}", text))


def _saturation(recording: Recording, channels: Sequence[Series], usable: Flags, findings: Found) -> None:
    motion = _motion(channels)
    for channel in channels:
        if channel.signal != "y":
            continue
        for limit, starts, stops in pinned(channel.values, usable):
            moved = any(np.ptp(m[a:b]) > 0 for m in motion for a, b in zip(starts[:50], stops[:50], strict=True))
            if not moved:
                continue
            count = int((stops - starts).sum())
            text = (
                f"is pinned at its extreme {limit:.6g} in {counted(count, 'sample')} ({count / len(usable):.2%}), in "
                f"runs of up to {int((stops - starts).max())}: if the sensor is saturated there, leave these times out"
            )
            findings.append(_at(recording, channel, "saturation", int(starts[0]), text))


def _stuck(recording: Recording, channels: Sequence[Series], usable: Flags, findings: Found) -> Flags:
    kept = np.ones(len(usable), dtype=bool)
    speeds = {channel.name: channel.values for channel in channels if channel.signal == "qd"}
    for channel in channels:
        if channel.signal not in ("q", "y"):
            continue
        others = [c.values for c in channels if c.signal == "q" and c is not channel]
        speed = speeds.get(channel.name) if channel.signal == "q" else None
        for start, stop in stuck(recording.time, channel.values, others, speed, usable, channel.signal == "y"):
            kept[start:stop] = False
            text = (
                f"stays at exactly {channel.values[start]:.6g} until {seconds(recording.time[stop - 1])} s "
                f"({counted(stop - start, 'sample')}) while the robot moves: stuck; left out"
            )
            findings.append(_at(recording, channel, "stuck", start, text))
    return kept


def _resolution(recording: Recording, channels: Sequence[Series], usable: Flags, findings: Found) -> None:
    for channel in channels:
        if channel.signal != "q":
            continue
        values = channel.values[_rows(usable)]
        step = resolution(values)
        if step and step > _COARSE * float(np.sqrt(np.mean(np.diff(values) ** 2))):
            text = f"comes in steps of {step:.4g}, coarse for its motion: derivatives need a low cut-off"
            where = f"{recording.source}, {channel.label}"
            findings.append(note("resolution", where, text))


def _smooth(recording: Recording, channels: Sequence[Series], usable: Flags, findings: Found) -> None:
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


def _held(recording: Recording, channels: Sequence[Series], usable: Flags, findings: Found) -> None:
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
    recording: Recording, channel: Series, kind: str, row: int, text: str, severity: Severity = Severity.WARNING
) -> Finding:
    where = f"{recording.source}, {channel.label}, from {seconds(float(recording.time[row]))} s"
    return Finding(severity, kind, where, text)
