"""Batches: R-factors of stretches of time, all that estimates and their covariance need of the rows.

A batch's pull on the parameters Wᵀ(y − Wζ) and its WᵀW follow from its R-factor, so that one pass over the logs, in
any process, replaces one for every estimate.  How long a log will be is not known while it streams: batches begin
short, and whenever there are twice as many as wanted neighbours are merged.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from itertools import pairwise

import numpy as np

from echelon.errors import InputError
from echelon.identification.rows.rows import RowBlock, stacked
from echelon.observe.observation import Observation

BATCHES = 40
"""Batches that the data are cut into at least, if they are long enough."""


@dataclass(frozen=True, repr=False)
class Batch:
    """A stretch of time, or several logs."""

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

    def __add__(self, other: Batch) -> Batch:
        """Both, of which the other one follows."""
        sources = (self.sources[0], other.sources[1])
        whole = stacked(self.observation, other.observation)
        return Batch(sources, self.start, other.stop, self.seconds + other.seconds, whole)

    def __repr__(self) -> str:
        return f"Batch({self.name}: {self.observation.rows} rows)"


class Batcher:
    """Cuts the rows of one log into batches of equal time as they arrive."""

    def __init__(self, count: int = BATCHES) -> None:
        if count < 1:
            raise InputError(f"{count} batches; expected at least 1")
        self._count = count
        self._origin = self._width = 0.0
        self._found: dict[int, Batch] = {}

    def begin(self, start: float, seconds: float) -> None:
        """State where the log begins and how long its first piece is; what is said later does not count."""
        if not self._width:
            self._origin, self._width = start, max(seconds, 1e-12) / self._count

    def cuts(self, start: float, stop: float) -> list[float]:
        """Where batches end within a stretch of time, with the ends of the stretch, s."""
        low, high = (int((time - self._origin) // self._width) for time in (start, stop))
        inner = [self._origin + k * self._width for k in range(low + 1, high + 1)]
        return [start, *(time for time in inner if start < time < stop), stop]

    def pieces(self, block: RowBlock) -> Iterator[RowBlock]:
        """A block of rows cut where batches end."""
        ends = [time for times in block.times if times.size for time in (times[0], times[-1])]
        if not ends:
            return
        numbers = [((times - self._origin) // self._width).astype(int) for times in block.times]
        low, high = (int((time - self._origin) // self._width) for time in (min(ends), max(ends)))
        bounds = [np.searchsorted(some, range(low, high + 2)) for some in numbers]
        for begins in pairwise(zip(*bounds, strict=True)):
            cuts = [slice(first, last) for first, last in zip(*begins, strict=True)]
            if any(cut.stop > cut.start for cut in cuts):
                yield block.taken(cuts)

    def add(self, source: str, start: float, stop: float, observation: Observation) -> None:
        """Take in the factors of rows that lie within one batch."""
        number = int((0.5 * (start + stop) - self._origin) // self._width)
        self._put(number, Batch((source, source), start, stop, stop - start, observation))
        while len(self._found) > 2 * self._count:
            found, self._found = self._found, {}
            self._width *= 2
            for old in sorted(found):
                self._put(old // 2, found[old])

    def batches(self) -> tuple[Batch, ...]:
        """What has been found, in the order of time."""
        return tuple(self._found[number] for number in sorted(self._found))

    def _put(self, number: int, batch: Batch) -> None:
        there = self._found.get(number)
        if there is not None:
            batch = replace(there + batch, seconds=batch.stop - there.start)
        self._found[number] = batch


def grouped(batches: Sequence[Batch], count: int) -> list[Batch]:
    """Neighbouring batches merged into ``count`` or fewer."""
    bounds = [round(k * len(batches) / count) for k in range(count + 1)]
    return [reduce(Batch.__add__, batches[low:high]) for low, high in pairwise(bounds) if high > low]


def joined(first: Sequence[Batch], second: Sequence[Batch]) -> tuple[Batch, ...]:
    """All batches merged into one; none if there are none."""
    batches = (*first, *second)
    return (reduce(Batch.__add__, batches),) if batches else ()


def total(batches: Sequence[Batch]) -> Observation:
    """The factors of all batches together, merged in a tree, so that rounding does not pile up."""
    level = [batch.observation for batch in batches]
    while len(level) > 1:
        pairs = [stacked(a, b) for a, b in zip(level[::2], level[1::2], strict=False)]
        level = pairs + level[2 * len(pairs) :]
    return level[0]
