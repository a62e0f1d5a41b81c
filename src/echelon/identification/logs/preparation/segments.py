"""From time stamps as they were logged to uniform segments, saying everything that was done on the way.

What is not usable is taken out first.  A hole that is shorter than a gap, from a lost packet or a few bad samples, is
bridged by interpolation and counted; a longer one, like a clock that jumps back, ends a segment.  Stamps that keep to a
uniform clock are left alone; others are resampled at the nominal rate.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from echelon.identification.logs.columns.column_map import (
    SIGNALS,
    WRAP,
    angle_columns,
    quaternion_columns,
    signal_names,
)
from echelon.identification.logs.finding import Finding, counted, note, seconds, warning
from echelon.identification.logs.recording import FEWEST, Recording, Segment
from echelon.identification.signals.clock import (
    GAP,
    SLOWER,
    Regularity,
    Stretches,
    grid,
    interpolated,
    low_passed,
    regularity,
    stretches,
)
from echelon.identification.signals.filters import continuous
from echelon.robot import Mechanism
from echelon.shared import Flags, Floats, InputError, Integers, locating

_POSITIONS = ("q", "reference")


def unwrapped(
    recording: Recording, mechanism: Mechanism, pieces: Sequence[Integers]
) -> tuple[dict[str, Floats], tuple[Finding, ...]]:
    """Signals of a finite recording with the turns of its angles added up within each stretch, and findings."""
    signals, findings = dict(recording.signals), []
    for signal in _POSITIONS:
        if signal not in signals:
            continue
        values = signals[signal].copy()
        names = signal_names(mechanism, signal, values.shape[1])
        for column in angle_columns(mechanism, signal, values.shape[1]):
            jumps = [
                piece[np.flatnonzero(np.abs(np.diff(values[piece, column])) > WRAP) + 1]
                for piece in pieces
            ]
            found = np.concatenate([np.zeros(0, dtype=np.intp), *jumps])
            if not len(found):
                continue
            for piece in pieces:
                values[piece, column] = np.unwrap(values[piece, column], discont=WRAP)
            when = f"from {seconds(recording.time[found[0]])} s"
            where = (
                f"{recording.source}, {SIGNALS[signal]} of '{names[column]}', {when}"
            )
            text = f"jumps by a full turn {len(found)} times; the turns were added up"
            findings.append(note("wrapped", where, text))
        signals[signal] = values
    return signals, tuple(findings)


def break_findings(
    source: str, time: Floats, found: Stretches, gap: float, short: Sequence[Integers]
) -> Iterator[Finding]:
    """Findings of duplicates, jumps back, gaps, and stretches that are too short."""

    def since(stamp: float) -> str:
        return f"{source}, from {seconds(stamp)} s"

    if len(found.duplicates):
        repeated = counted(
            len(found.duplicates), "time stamp repeats", "time stamps repeat"
        )
        yield warning(
            "duplicates",
            since(time[found.duplicates[0]]),
            f"{repeated} the one before; left out",
        )
    if len(found.backward):
        jumps = ", ".join(
            f"{seconds(time[row - 1])} → {seconds(time[row])} s"
            for row in found.backward[:3]
        )
        text = f"the clock jumps back {counted(len(found.backward), 'time')} ({jumps}); segments end there"
        yield warning("backward", since(time[found.backward[0] - 1]), text)
    if len(found.gaps):
        before = _before(time, found)
        longest = (time[found.gaps] - before).max()
        gaps = f"{counted(len(found.gaps), 'gap')} of more than {gap:g} periods, up to {longest:.4g} s"
        yield warning("gap", since(before[0]), f"{gaps}; segments end there")
    if short:
        text = (
            f"{counted(len(short), 'stretch is', 'stretches are')} too short to use, with up to "
            f"{counted(max(map(len, short)), 'sample')}; left out ({sum(map(len, short))} in all)"
        )
        yield warning("short", since(time[short[0][0]]), text)


def rate_findings(
    source: str,
    starts: Sequence[float],
    found: Stretches,
    regular: Sequence[Regularity],
    rate: float | None,
) -> Iterator[Finding]:
    """Findings of lost samples that were interpolated, jitter, and a lower rate."""
    uneven = [
        (start, one)
        for start, one in zip(starts, regular, strict=True)
        if not one.uniform
    ]
    where = f"{source}, from {seconds(uneven[0][0])} s" if uneven else source
    longest = 1e3 * max((one.longest for _, one in uneven), default=0.0)
    if missing := sum(one.missing for _, one in uneven):
        lost = counted(missing, "sample is", "samples are")
        text = f"{lost} missing (intervals up to {longest:.4g} ms); interpolated"
        yield note("missing", where, text)
    if uneven:
        shortest = min(one.shortest for _, one in uneven)
        spread = max(one.spread for _, one in uneven)
        text = (
            f"time stamps are usually {found.period * 1e3:.4g} ms apart, but {shortest * 1e3:.4g} to "
            f"{longest:.4g} ms, with a standard deviation of {spread * 1e3:.2g} ms; resampled at "
            f"{uneven[0][1].rate:g} Hz by cubic interpolation"
        )
        yield note("jitter", where, text)
    if rate is not None and any(rate < SLOWER * one.rate for one in regular):
        text = f"resampled from {regular[0].rate:.6g} Hz to {rate:g} Hz, after a low-pass at {0.4 * rate:.4g} Hz"
        yield note("rate", source, text)


def _before(time: Floats, found: Stretches) -> Floats:
    """Stamps before the gaps: those of the last samples that were kept."""
    lasts = np.array([piece[-1] for piece in found.pieces])
    return np.asarray(time[lasts[np.searchsorted(lasts, found.gaps) - 1]])


def segments(
    recording: Recording,
    mechanism: Mechanism,
    usable: Flags | None = None,
    *,
    rate: float | None = None,
    gap: float = GAP,
    whole: bool = True,
) -> tuple[tuple[Segment, ...], tuple[Finding, ...]]:
    """Cut a recording into uninterrupted stretches on uniform clocks, with findings about its clock.

    Keeps the ``usable`` samples that are finite.  A gap is an interval of more than so many periods.  For a lower
    ``rate``, Hz, signals pass a low-pass first.  A piece of a log, ``whole=False``, may be too short for a segment.
    """
    used = finite(recording)
    if usable is not None:
        used &= usable
    rows = np.flatnonzero(used)
    if len(rows) < FEWEST:
        return _none(
            recording,
            f"{len(rows)} usable samples of {len(used)}; at least {FEWEST} are needed",
            whole,
        )
    clean = _taken(recording, rows)
    with locating(recording.source):
        found = stretches(clean.time, gap)
    asked = _checked(rate, found.period, recording.source)
    counts = [_count(clean.time[piece], asked) for piece in found.pieces]
    if max(counts) < FEWEST:
        where = f"at {asked:g} Hz" if asked else f"{found.period:.4g} s apart"
        longest = f"the longest of {len(counts)} has {max(counts)}, {where}"
        problem = f"no stretch without gaps has {FEWEST} samples: {longest}"
        return _none(recording, problem, whole)
    long, short = (
        [p for p, n in zip(found.pieces, counts, strict=True) if (n >= FEWEST) is so]
        for so in (True, False)
    )
    signals, wrapped = unwrapped(clean, mechanism, found.pieces)
    clean = replace(clean, signals=signals)
    regular = [regularity(clean.time[piece], found.period) for piece in long]
    cut = [
        _segment(clean, mechanism, *one, asked)
        for one in zip(long, regular, strict=True)
    ]
    breaks = break_findings(recording.source, clean.time, found, gap, short)
    clock = rate_findings(
        recording.source, [segment.start for segment in cut], found, regular, asked
    )
    return tuple(cut), (*breaks, *clock, *wrapped)


def _count(time: Floats, rate: float | None) -> int:
    """Samples that a stretch has, and keeps at a lower rate."""
    if rate is None:
        return len(time)
    return min(len(time), int((time[-1] - time[0]) * rate) + 1)


def _none(
    recording: Recording, problem: str, whole: bool
) -> tuple[tuple[Segment, ...], tuple[Finding, ...]]:
    """No segments: an error for a whole log, a finding for a piece of one."""
    if whole:
        raise InputError(problem, source=recording.source)
    start = (
        f", from {seconds(float(recording.time[0]))} s" if len(recording.time) else ""
    )
    return (), (warning("short", f"{recording.source}{start}", f"{problem}; left out"),)


def finite(recording: Recording) -> Flags:
    """Samples of which everything is a finite number, shape (N,)."""
    found = np.isfinite(recording.time)
    for values in (*recording.signals.values(), *recording.inputs.values()):
        found &= np.isfinite(values.reshape(len(found), -1)).all(axis=1)
    return found


def _taken(recording: Recording, rows: Integers) -> Recording:
    # rows without a hole between them need not be copied
    together = len(rows) > 0 and rows[-1] - rows[0] == len(rows) - 1
    some = slice(rows[0], rows[-1] + 1) if together else rows
    signals = {name: values[some] for name, values in recording.signals.items()}
    inputs = {name: values[some] for name, values in recording.inputs.items()}
    return replace(recording, time=recording.time[some], signals=signals, inputs=inputs)


def _checked(rate: float | None, period: float, source: str) -> float | None:
    if rate is None:
        return None
    if not 0 < rate < float("inf"):
        raise InputError(f"the rate must be positive, got {rate:g}", element="rate")
    if rate * period > 2 - SLOWER:
        problem = f"the log has {1 / period:.4g} samples per second; at a rate of {rate:g} the others would be invented"
        raise InputError(problem, source=source, element="rate")
    return rate


def _segment(
    recording: Recording,
    mechanism: Mechanism,
    piece: Integers,
    regular: Regularity,
    rate: float | None,
) -> Segment:
    own = _taken(recording, piece)
    signals = {
        name: _on_uniform_clock(
            own.time,
            values,
            regular,
            rate,
            quaternion_columns(mechanism, name, values.shape[1]),
        )
        for name, values in own.signals.items()
    }
    inputs = {
        name: _on_uniform_clock(own.time, values, regular, rate)
        for name, values in own.inputs.items()
    }
    return Segment(
        recording.source, float(own.time[0]), rate or regular.rate, signals, inputs
    )


def _on_uniform_clock(
    time: Floats,
    values: Floats,
    regular: Regularity,
    rate: float | None,
    quaternions: tuple[int, ...] = (),
) -> Floats:
    values = values.copy() if quaternions else values
    for first in quaternions:
        values[:, first : first + 4] = continuous(values[:, first : first + 4])
    if regular.uniform:
        since = np.arange(len(time)) / regular.rate
    else:
        since = grid(0.0, float(time[-1] - time[0]), regular.rate)
        values = interpolated(time - time[0], values, since)
    if rate is not None and abs(rate / regular.rate - 1) > 1e-9:
        if rate < SLOWER * regular.rate:
            values = low_passed(values, rate / regular.rate)
        values = interpolated(since, values, grid(0.0, float(since[-1]), rate))
    for first in quaternions:
        block = values[:, first : first + 4]
        values[:, first : first + 4] = block / np.linalg.norm(
            block, axis=1, keepdims=True
        )
    return values
