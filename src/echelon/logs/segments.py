"""From time stamps as they were logged to uniform segments, saying everything that was done on the way.

What is not usable is taken out first.  A hole that is shorter than a gap, from a lost packet or a few bad samples, is
bridged by interpolation and counted; a longer one, like a clock that jumps back, ends a segment.  Stamps that keep to a
uniform clock are left alone; others are resampled at the nominal rate.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from echelon.arrays import Flags, Floats
from echelon.errors import InputError
from echelon.logs.clock_findings import break_findings, rate_findings
from echelon.logs.finding import Finding, Severity
from echelon.logs.recording import Recording, Segment
from echelon.logs.rotations import quaternion_columns, unwrapped
from echelon.logs.wording import seconds
from echelon.mechanism.mechanism import Mechanism
from echelon.signals.clock import GAP, Regularity, regularity, stretches
from echelon.signals.quaternions import continuous
from echelon.signals.resample import SLOWER, grid, interpolated, low_passed

FEWEST = 20
"""Samples that a segment must have; filters and derivatives make nothing of shorter ones."""


def segments(
    recording: Recording,
    mechanism: Mechanism,
    usable: Flags | None = None,
    *,
    rate: float | None = None,
    gap: float = GAP,
    whole: bool = True,
) -> tuple[tuple[Segment, ...], tuple[Finding, ...]]:
    """Cut a recording into uninterrupted stretches on uniform clocks.

    Parameters
    ----------
    recording : Recording
    mechanism : Mechanism
        Says which coordinates are angles, to undo wrapping, and which are quaternions, to keep their sign and norm.
    usable : array of bool of shape (N,), optional
        Samples to keep, as :func:`echelon.logs.faults.examine` finds them; all if omitted.  Samples that are not finite
        are left out in any case.
    rate : float, optional
        Rate of the segments, Hz; that of the log if None.  For a lower one signals pass a low-pass first.
    gap : float
        Periods beyond which an interval is a gap, which ends a segment.
    whole : bool
        Whether this is all of the log; a piece of one may be too short for a segment.

    Returns
    -------
    segments : tuple of Segment
    findings : tuple of Finding
        ``duplicates``, ``backward``, ``gap``, ``missing``, ``jitter``, ``rate``, ``wrapped``, ``short``.

    Raises
    ------
    InputError
        If no stretch of the whole log is long enough, the stamps are in no order, or the rate is above that of the log.
    """
    used = finite(recording)
    if usable is not None:
        used &= usable
    rows = np.flatnonzero(used)
    if len(rows) < FEWEST:
        return _none(recording, f"{len(rows)} usable samples of {len(used)}; at least {FEWEST} are needed", whole)
    clean = _taken(recording, rows)
    try:
        found = stretches(clean.time, gap)
    except InputError as error:
        raise error.located(recording.source) from None
    asked = _checked(rate, found.period, recording.source)
    counts = [_count(clean.time[piece], asked) for piece in found.pieces]
    if max(counts) < FEWEST:
        where = f"at {asked:g} Hz" if asked else f"{found.period:.4g} s apart"
        problem = (
            f"no stretch without gaps has {FEWEST} samples: the longest of {len(counts)} has {max(counts)}, {where}"
        )
        return _none(recording, problem, whole)
    long, short = (
        [p for p, n in zip(found.pieces, counts, strict=True) if (n >= FEWEST) is so] for so in (True, False)
    )
    signals, wrapped = unwrapped(clean, mechanism, found.pieces)
    cutter = _Cutter(replace(clean, signals=signals), mechanism, found.period, asked)
    cut, regular = zip(*map(cutter.segment, long), strict=True)
    breaks = break_findings(recording.source, clean.time, found, gap, short)
    clock = rate_findings(recording.source, [segment.start for segment in cut], found, regular, asked)
    return cut, (*breaks, *clock, *wrapped)


def _count(time: Floats, rate: float | None) -> int:
    """Samples that a stretch has, and keeps at a lower rate."""
    return len(time) if rate is None else min(len(time), int((time[-1] - time[0]) * rate) + 1)


def _none(recording: Recording, problem: str, whole: bool) -> tuple[tuple[Segment, ...], tuple[Finding, ...]]:
    if whole:
        raise InputError(problem, source=recording.source)
    start = f", from {seconds(float(recording.time[0]))} s" if len(recording.time) else ""
    return (), (Finding(Severity.WARNING, "short", f"{recording.source}{start}", f"{problem}; left out"),)


def finite(recording: Recording) -> Flags:
    """Samples of which everything is a finite number, shape (N,).

    Parameters
    ----------
    recording : Recording
    """
    found = np.isfinite(recording.time)
    for values in (*recording.signals.values(), *recording.inputs.values()):
        found &= np.isfinite(values.reshape(len(found), -1)).all(axis=1)
    return found


def _taken(recording: Recording, rows: npt.NDArray[np.intp]) -> Recording:
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
        problem = f"the log has {1 / period:.4g} samples per second; {rate:g} would only invent some"
        raise InputError(problem, source=source, element="rate")
    return rate


@dataclass(frozen=True)
class _Cutter:
    recording: Recording
    mechanism: Mechanism
    period: float
    rate: float | None

    def segment(self, piece: npt.NDArray[np.intp]) -> tuple[Segment, Regularity]:
        time = self.recording.time[piece]
        regular = regularity(time, self.period)
        own = _taken(self.recording, piece)
        signals = {
            name: self._moved(time, values, regular, quaternion_columns(self.mechanism, name, values.shape[1]))
            for name, values in own.signals.items()
        }
        inputs = {name: self._moved(time, values, regular, ()) for name, values in own.inputs.items()}
        rate = self.rate or regular.rate
        return Segment(self.recording.source, float(time[0]), rate, signals, inputs), regular

    def _moved(self, time: Floats, values: Floats, regular: Regularity, quaternions: tuple[int, ...]) -> Floats:
        """A signal on the uniform clock."""
        values = values.copy()
        for first in quaternions:
            values[:, first : first + 4] = continuous(values[:, first : first + 4])
        since, span = time - time[0], float(time[-1] - time[0])
        if regular.uniform:
            since = np.arange(len(time)) / regular.rate
        else:
            times = grid(0.0, span, regular.rate)
            since, values = times, interpolated(since, values, times)
        if self.rate is not None and abs(self.rate / regular.rate - 1) > 1e-9:
            if self.rate < SLOWER * regular.rate:
                values = low_passed(values, self.rate / regular.rate)
            values = interpolated(since, values, grid(0.0, float(since[-1]), self.rate))
        for first in quaternions:
            block = values[:, first : first + 4]
            values[:, first : first + 4] = block / np.linalg.norm(block, axis=1, keepdims=True)
        return values
