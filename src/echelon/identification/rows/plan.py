"""Plan: how logs become rows, and which part of them the fit does not see.

Data are held out by time or by trajectory, never by random samples.  Neighbouring samples share their noise, their
filters and their place on the trajectory, so that a random sample held out is all but known to the fit.  What is held
out here is contiguous, and each part is filtered on its own: near its ends the filter over both sides treats regressor
and outputs alike, whatever it lacks, so no measured output enters both parts and none is lost.

In a plan everything is decided before the first row is made.  It is all that another process needs to take in a log, so
that logs can be spread over several.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np

from echelon.base import BaseModel
from echelon.identification.logs.columns.column_map import ColumnMap
from echelon.identification.logs.finding import counted
from echelon.identification.logs.preparation.prepare import (
    Preparation,
    PreparationPlan,
    prepare,
)
from echelon.identification.logs.read_log import read_log
from echelon.identification.logs.recording import Samples, Segment
from echelon.identification.rows.rows import ModelRows
from echelon.identification.rows.travels import Travel
from echelon.identification.signals.clock import low_passed
from echelon.identification.signals.filters import reduction
from echelon.shared import Flags, Floats, InputError


def split(samples: Samples, share: float) -> tuple[Samples, Samples]:
    """The first part of a segment for the fit, the last for validation."""
    if not 0 < share < 1:
        raise InputError(f"a share of {share:g}; expected a number between 0 and 1")
    stop = samples.end
    cut = samples.first + int(np.floor((1 - share) * (stop - samples.first)))
    if cut - samples.first < samples.factor or stop - cut < samples.factor:
        raise InputError(
            f"{counted(stop - samples.first, 'sample')} cannot be split {1 - share:.0%} to {share:.0%}; give a longer "
            "log, or hold out a log of its own",
            source=samples.source,
        )
    held = replace(part_of(samples, cut, len(samples)), first=0, stop=stop - cut)
    return replace(part_of(samples, 0, cut), stop=cut), held


def part_of(samples: Samples, begin: int, end: int) -> Samples:
    """Some of the samples, as a segment that knows nothing of the others."""
    return replace(
        samples.cut(slice(begin, end)),
        start=samples.start + begin / samples.rate,
        first=max(samples.first - begin, 0),
        stop=None if samples.stop is None else min(samples.stop, end) - begin,
    )


LOOKED_AT = 8_000
"""Samples, on a clock that is no faster than a band needs, that preparation is chosen from: enough rows for any arm's
parameters."""

SAMPLED = 12.0  # rate at which a band is looked at, by its edge: filters of states pass a quarter of it unchanged


def spread_out(
    samples: Iterable[Samples],
    band: float,
    count: int,
    parts: int,
    seen: Callable[[Samples], Samples] = lambda some: some,
    beside: Callable[[Samples, int], Floats] | None = None,
) -> list[Samples]:
    """About ``count`` samples from all parts of some stretches, on clocks no faster than a band needs, Hz.

    All of them if they are fewer; else windows that are ``count / parts`` long, evenly spaced in time.  What is
    looked at of samples on the clock of the log is what ``seen`` makes of them.  ``beside`` makes further columns of y,
    of one in a number of samples.
    """
    kept: list[Samples] = []
    length, every, number = count // parts, 0, 0  # no windows yet
    for stretch in samples:
        factor = max(1, int(stretch.rate / (SAMPLED * band)))
        slow = _slower(seen(stretch), factor, band)
        if beside is not None:
            assert slow.y is not None
            columns = beside(stretch, factor)
            slow = replace(slow, y=np.hstack([slow.y, columns]))
        if every == 0 and sum(map(len, kept)) + len(slow) <= count:
            kept.append(slow)
            continue
        if every == 0:
            kept = [window for some in kept for window in _windows(some, length)]
            number, every = len(kept), 1
        for window in _windows(slow, length):
            if number % every == 0:
                kept.append(window)
            number += 1
            if len(kept) > 2 * parts:
                kept, every = kept[::2], 2 * every
    if every == 0 or len(kept) <= parts:
        return kept
    return [kept[k * len(kept) // parts] for k in range(parts)]


def _windows(samples: Samples, length: int) -> Iterator[Samples]:
    """Samples cut into windows of one length, the last one shorter."""
    for begin in range(0, samples.end, length):
        window = part_of(samples, begin, min(begin + length, len(samples)))
        if window.end - window.first > length // 2 or begin == 0:
            yield window


def _slower(samples: Samples, factor: int, band: float) -> Samples:
    """Samples on a clock that is a whole number of times slower, whose states the preparation has filtered enough."""
    if factor == 1:
        return samples
    rate = samples.rate / factor
    assert samples.y is not None
    return replace(
        samples.cut(slice(None, None, factor)),
        pinned=None if samples.pinned is None else _any_of(samples.pinned, factor),
        rate=rate,
        y=low_passed(samples.y, 1 / factor)[::factor],
        reduction=reduction(band, rate),
        first=-(-samples.first // factor),
        stop=-(-samples.end // factor),
    )


def _any_of(flags: Flags, factor: int) -> Flags:
    """Whether any of some samples in a row is flagged, shape (samples / factor, outputs)."""
    return np.asarray(
        np.logical_or.reduceat(flags, np.arange(0, len(flags), factor), axis=0)
    )


# which part of a log: all of it, what is fitted, or what is held out
Part = Literal["all", "first", "last"]


@dataclass(frozen=True)
class LogPlan:
    """How logs become rows."""

    base: BaseModel
    columns: tuple[ColumnMap, ...]  # what columns mean; see read_log
    preparation: Preparation  # with every choice made
    holdout: float = 0.0  # share of each stretch that is held out, 0 to 1
    # what the model was fitted to; None if nobody knows
    travels: tuple[Travel, ...] | None = None

    def samples(
        self,
        path: str | Path,
        part: Part = "all",
        *,
        outputs: bool = True,
        reference: bool = False,
    ) -> Iterator[Samples]:
        """Prepared samples of a log, stretch by stretch; what is too short is left out, unless it is all there is."""
        short, any_left = None, False
        rate = self.preparation.rate
        # the survey does it
        reading = partial(read_log, rate=rate, outputs=outputs, named=False)
        for piece in reading(path, self.base.mechanism, self.columns):
            mechanism, own = piece.mechanism, self.preparation.of(piece.experiment)
            for segment in piece.segments:
                plan = PreparationPlan(own, mechanism, segment.rate)
                if plan.is_short(segment):
                    short = (plan, segment)
                    continue
                any_left = True
                samples = prepare(segment, own, mechanism)
                if reference:
                    asked = prepare(_along_reference(segment), own, mechanism)
                    samples = replace(
                        asked,
                        moving=samples.moving,
                        pinned=samples.pinned,
                        first=samples.first,
                        stop=samples.stop,
                    )
                samples = replace(samples, experiment=piece.experiment)
                yield from self.parts(samples, part)
        if short is not None and not any_left:
            plan, segment = short
            plan.check(segment)

    def rows(
        self,
        paths: Sequence[str | Path],
        part: Part = "all",
        *,
        reference: bool = False,
    ) -> ModelRows:
        """The rows of some logs, along the measured or the reference positions; they are read again in every pass."""
        return ModelRows(
            self.base, partial(self._samples, tuple(paths), part, reference)
        )

    def _samples(
        self, paths: Sequence[str | Path], part: Part, reference: bool
    ) -> Iterator[Samples]:
        for path in paths:
            yield from self.samples(path, part, reference=reference)

    def __getstate__(self) -> dict[str, object]:
        # what was recorded and compiled here is of no use to another process
        return {**self.__dict__, "base": replace(self.base)}

    def parts(self, samples: Samples, part: Part) -> Iterator[Samples]:
        """Parts of prepared samples that are asked for; nothing if they have no such part."""
        if part == "all" or self.holdout == 0:
            if part != "last":
                yield samples
            return
        try:
            first, last = split(samples, self.holdout)
        except InputError:  # a stretch too short to be split is fitted as a whole
            if part == "first":
                yield samples
            return
        yield first if part == "first" else last


def _along_reference(segment: Segment) -> Segment:
    """The segment with the positions that were asked for in place of the measured ones."""
    if "reference" not in segment.signals:
        problem = "instruments are made from reference positions, and the log has none: map them under 'reference'"
        raise InputError(problem, source=segment.source)
    kept = {name: values for name, values in segment.signals.items() if name == "y"}
    return replace(segment, signals={**kept, "q": segment.signals["reference"]})
