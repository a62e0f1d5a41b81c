"""What was wrong with the clock of a log, in sentences with figures."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from echelon.arrays import Floats, Integers
from echelon.logs.finding import Finding, Severity
from echelon.logs.wording import seconds
from echelon.signals.clock import Regularity, Stretches
from echelon.signals.resample import SLOWER


def break_findings(
    source: str, time: Floats, found: Stretches, gap: float, short: Sequence[Integers]
) -> tuple[Finding, ...]:
    """Duplicates, jumps back, gaps, and stretches that are too short.

    Parameters
    ----------
    source : str
    time : array of shape (N,)
        The stamps in which they were found, s.
    found : Stretches
    gap : float
        Periods beyond which an interval counts as a gap.
    short : sequence of array of int
        Stretches that were left out because they have too few samples.
    """
    findings = []
    if len(found.duplicates):
        where = f"{source}, from {seconds(time[found.duplicates[0]])} s"
        text = f"{_times(len(found.duplicates), 'time stamp repeats', 'time stamps repeat')} the one before; left out"
        findings.append(Finding(Severity.WARNING, "duplicates", where, text))
    if len(found.backward):
        jumps = ", ".join(f"{seconds(time[row - 1])} → {seconds(time[row])} s" for row in found.backward[:3])
        text = (
            f"the clock jumps back {_times(len(found.backward), 'time', 'times')} ({jumps}), "
            "as where runs were joined; segments end there"
        )
        findings.append(
            Finding(Severity.WARNING, "backward", f"{source}, {seconds(time[found.backward[0] - 1])} s", text)
        )
    if len(found.gaps):
        lengths = time[found.gaps] - _before(time, found)
        text = (
            f"{_times(len(found.gaps), 'gap', 'gaps')} of more than {gap:g} periods, up to {lengths.max():.4g} s; "
            "segments end there"
        )
        findings.append(Finding(Severity.WARNING, "gap", f"{source}, from {seconds(_before(time, found)[0])} s", text))
    if short:
        lost = sum(map(len, short))
        text = (
            f"{_times(len(short), 'stretch is', 'stretches are')} too short to use, with up to "
            f"{_times(max(map(len, short)), 'sample', 'samples')}; left out ({lost} in all)"
        )
        findings.append(Finding(Severity.WARNING, "short", f"{source}, from {seconds(time[short[0][0]])} s", text))
    return tuple(findings)


def rate_findings(
    source: str, starts: Sequence[float], found: Stretches, regular: Sequence[Regularity], rate: float | None
) -> tuple[Finding, ...]:
    """Lost samples that were bridged, jitter, and a lower rate.

    Parameters
    ----------
    source : str
    starts : sequence of float
        Time of the first sample of each segment, s.
    found : Stretches
    regular : sequence of Regularity
        Of the stretches that became segments.
    rate : float, optional
        Rate that was asked for, Hz.
    """
    findings = []
    uneven = [(start, one) for start, one in zip(starts, regular, strict=True) if not one.uniform]
    where = f"{source}, from {seconds(uneven[0][0])} s" if uneven else source
    missing = sum(one.missing for _, one in uneven)
    if missing:
        longest = max(one.longest for _, one in uneven)
        text = (
            f"{_times(missing, 'sample is', 'samples are')} missing (intervals up to {longest * 1e3:.4g} ms); "
            "interpolated"
        )
        findings.append(Finding(Severity.NOTE, "missing", where, text))
    if uneven:
        shortest, longest = min(one.shortest for _, one in uneven), max(one.longest for _, one in uneven)
        spread = max(one.spread for _, one in uneven)
        text = (
            f"time stamps are usually {found.period * 1e3:.4g} ms apart, but {shortest * 1e3:.4g} to "
            f"{longest * 1e3:.4g} ms, with a standard deviation of {spread * 1e3:.2g} ms; resampled at "
            f"{uneven[0][1].rate:g} Hz by cubic interpolation"
        )
        findings.append(Finding(Severity.NOTE, "jitter", where, text))
    if rate is not None and any(rate < SLOWER * one.rate for one in regular):
        text = f"resampled from {regular[0].rate:.6g} Hz to {rate:g} Hz, after a low-pass at {0.4 * rate:.4g} Hz"
        findings.append(Finding(Severity.NOTE, "rate", source, text))
    return tuple(findings)


def _before(time: Floats, found: Stretches) -> Floats:
    """Stamps before the gaps: those of the last samples that were kept."""
    lasts = np.array([piece[-1] for piece in found.pieces])
    return np.asarray(time[lasts[np.searchsorted(lasts, found.gaps) - 1]])


def _times(count: int, one: str, many: str) -> str:
    return f"{count} {one if count == 1 else many}"
