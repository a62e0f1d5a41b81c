"""Batches: R-factors of the rows of stretches of time, from which estimates, intervals and held-out stretches are made.

A batch's pull on the parameters Wᵀ(y − Wζ) and its WᵀW follow from its R-factor, so that one pass over the logs, in any
process, replaces one for every estimate.  How long a log will be is not known while it streams: batches begin short,
and whenever there are twice as many as wanted neighbours are merged.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce
from itertools import pairwise

import numpy as np

from echelon.compute import Layout, Observation
from echelon.identification.cluster import tree
from echelon.identification.rows.rows import RowBlock, observed, stacked
from echelon.shared import Floats, InputError, Integers

BATCHES = 40  # batches that the data are cut into at least, if they are long enough


@dataclass(frozen=True, repr=False)
class TimeBatch:
    """R-factors of the rows of a stretch of time, or of several logs."""

    sources: tuple[str, str]  # the first and the last log
    start: float  # time of the first row of the first log, s
    stop: float  # time of the last row of the last log, s
    seconds: float  # how much time is covered
    observation: Observation

    @property
    def name(self) -> str:
        """For messages."""
        first, last = self.sources
        if first == last:
            return f"{first} from {self.start:g} to {self.stop:g} s"
        return f"{first} to {last}"

    def __add__(self, other: TimeBatch) -> TimeBatch:
        """Both, of which the other one follows."""
        sources = (self.sources[0], other.sources[1])
        whole = stacked(self.observation, other.observation)
        return TimeBatch(
            sources, self.start, other.stop, self.seconds + other.seconds, whole
        )

    def __repr__(self) -> str:
        return f"Batch({self.name}: {self.observation.rows} rows)"


class Batcher:
    """Cuts the rows of one log into batches of equal time as they arrive: at least a number, or of some width, s."""

    def __init__(self, count: int = BATCHES, width: float = 0.0) -> None:
        if count < 1:
            raise InputError(f"{count} batches; expected at least 1")
        self._count, self._width, self._grows = count, width, not width
        self._origin: float | None = None
        self._found: dict[int, TimeBatch] = {}

    def begin(self, start: float, seconds: float) -> None:
        """State where the log begins and how long its first piece is; what is said later does not count."""
        if self._origin is None:
            self._origin = start
            self._width = (
                self._width or max(seconds, np.finfo(float).tiny) / self._count
            )

    def cuts(self, start: float, stop: float) -> list[float]:
        """Where batches end within a stretch of time, with the ends of the stretch, s."""
        low, high = (self._number(time) for time in (start, stop))
        inner = [
            (self._origin or 0.0) + k * self._width for k in range(low + 1, high + 1)
        ]
        return [start, *(time for time in inner if start < time < stop), stop]

    def take(self, block: RowBlock, layout: Layout) -> None:
        """Take in rows, as R-factors of those of each batch."""
        ends = [
            time
            for times in block.times
            if times.size
            for time in (times[0], times[-1])
        ]
        if not ends:
            return
        self.begin(min(ends), max(ends) - min(ends))
        low, high = (self._number(time) for time in (min(ends), max(ends)))
        bounds = [
            np.searchsorted(self._numbers(times), range(low, high + 2))
            for times in block.times
        ]
        for begins in pairwise(zip(*bounds, strict=True)):
            piece = block.taken(
                [slice(first, last) for first, last in zip(*begins, strict=True)]
            )
            ends = [
                time
                for times in piece.times
                if times.size
                for time in (times[0], times[-1])
            ]
            if ends:
                self.add(block.source, min(ends), max(ends), observed(layout, piece))

    def add(
        self, source: str, start: float, stop: float, observation: Observation
    ) -> None:
        """Take in the factors of rows that lie within one batch."""
        self._put(
            self._number(0.5 * (start + stop)),
            TimeBatch((source, source), start, stop, stop - start, observation),
        )
        while self._grows and len(self._found) > 2 * self._count:
            found, self._found = self._found, {}
            self._width *= 2
            for old in sorted(found):
                self._put(old // 2, found[old])

    def batches(self) -> tuple[TimeBatch, ...]:
        """The batches of all rows so far, in the order of time."""
        return tuple(self._found[number] for number in sorted(self._found))

    def _numbers(self, times: Floats) -> Integers:
        return np.asarray((times - (self._origin or 0.0)) // self._width, dtype=np.intp)

    def _number(self, time: float) -> int:
        return int((time - (self._origin or 0.0)) // self._width)

    def _put(self, number: int, batch: TimeBatch) -> None:
        there = self._found.get(number)
        if there is not None:
            batch = replace(there + batch, seconds=batch.stop - there.start)
        self._found[number] = batch


def grouped(batches: Sequence[TimeBatch], count: int) -> list[TimeBatch]:
    """Neighbouring batches merged into ``count`` or fewer."""
    bounds = [round(k * len(batches) / count) for k in range(count + 1)]
    return [
        reduce(TimeBatch.__add__, batches[low:high])
        for low, high in pairwise(bounds)
        if high > low
    ]


def joined(
    first: Sequence[TimeBatch], second: Sequence[TimeBatch]
) -> tuple[TimeBatch, ...]:
    """All batches merged into one; none if there are none."""
    batches = (*first, *second)
    return (reduce(TimeBatch.__add__, batches),) if batches else ()


def total(batches: Sequence[TimeBatch]) -> Observation:
    """The factors of all batches together, merged in a tree, so that rounding does not pile up."""
    found: Observation = tree((batch.observation for batch in batches), stacked)
    return found
