"""Passes over the logs: one for the fit, as R-factors of batches; a second for validation where memory is short.

Reading, looking for faults and preparing cost more than factoring, so that a log is gone through once: its R-factors
are kept, which are small, and its prepared samples for as long as there is memory for them.  Where there is not,
validation reads the log again.

Batches are stretches of time.  A batch's pull on the parameters Wᵀ(y − Wζ) and its WᵀW follow from its R-factor, so
that one pass over the logs, in any process, replaces one for every estimate.  How long a log will be is not known while
it streams: batches begin short, and whenever there are twice as many as wanted neighbours are merged.

On a cluster both passes are spread, log by log: what comes back are R-factors of batches and scores, never samples.
From as many logs as batches are wanted each log is a part of one batch, and R-factors are merged where they were made.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial, reduce
from itertools import chain, pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from echelon.errors import InputError
from echelon.identification.cluster import each, summed
from echelon.identification.rows.plan import Part, Plan
from echelon.identification.rows.rows import (
    ModelRows,
    Numbering,
    RowBlock,
    Rows,
    observed,
    plain,
    prefetched,
    stacked,
)
from echelon.identification.scores import Validation
from echelon.identification.validation import LIMIT, Models, validated
from echelon.logs.recording import Samples
from echelon.observe.observation import Layout, Observation

if TYPE_CHECKING:
    from distributed import Client

BATCHES = 40  # batches that the data are cut into at least, if they are long enough


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
        return Batch(
            sources, self.start, other.stop, self.seconds + other.seconds, whole
        )

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
        low, high = (
            int((time - self._origin) // self._width) for time in (start, stop)
        )
        inner = [self._origin + k * self._width for k in range(low + 1, high + 1)]
        return [start, *(time for time in inner if start < time < stop), stop]

    def pieces(self, block: RowBlock) -> Iterator[RowBlock]:
        """A block of rows cut where batches end."""
        ends = [
            time
            for times in block.times
            if times.size
            for time in (times[0], times[-1])
        ]
        if not ends:
            return
        numbers = [
            ((times - self._origin) // self._width).astype(int) for times in block.times
        ]
        low, high = (
            int((time - self._origin) // self._width) for time in (min(ends), max(ends))
        )
        bounds = [np.searchsorted(some, range(low, high + 2)) for some in numbers]
        for begins in pairwise(zip(*bounds, strict=True)):
            cuts = [slice(first, last) for first, last in zip(*begins, strict=True)]
            if any(cut.stop > cut.start for cut in cuts):
                yield block.taken(cuts)

    def add(
        self, source: str, start: float, stop: float, observation: Observation
    ) -> None:
        """Take in the factors of rows that lie within one batch."""
        number = int((0.5 * (start + stop) - self._origin) // self._width)
        self._put(
            number, Batch((source, source), start, stop, stop - start, observation)
        )
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
    return [
        reduce(Batch.__add__, batches[low:high])
        for low, high in pairwise(bounds)
        if high > low
    ]


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


MEMORY = 1 << 28
"""Bytes of samples that are kept between passes over the logs unless said otherwise; what goes beyond is read again."""


@dataclass
class KeptRows(Rows):
    """Rows that stay in memory after the first pass, if there is room for them."""

    model: ModelRows
    memory: int = MEMORY
    _kept: tuple[RowBlock, ...] = field(default=(), init=False)

    @property
    def layout(self) -> Layout:
        """Outputs, base parameters, and which of them each output can depend on."""
        return self.model.layout

    @property
    def units(self) -> tuple[str, ...]:
        """SI units of the base parameters."""
        return self.model.units

    def blocks(self) -> Iterator[RowBlock]:
        """All rows, in the order of time."""
        if self._kept:
            yield from self._kept
            return
        kept: list[RowBlock] = []
        left = self.memory
        for block in self.model.blocks():
            left -= sum(
                some.nbytes
                for parts in (block.times, block.matrices, block.y)
                for some in parts
            )
            kept = [*kept, block] if left >= 0 else []
            yield block
        self._kept = tuple(kept) if left >= 0 else ()


def ingest(
    plan: Plan, path: Path, count: int, memory: int = 0
) -> tuple[tuple[Batch, ...], tuple[Samples, ...] | None]:
    """R-factors of what is fitted of a log, in stretches of time; and all its samples, if there is memory for them.

    Of a single stretch they are one batch, which can be merged with those of other logs.
    """
    ingestion = _Ingestion(plan, count, memory)
    for block in prefetched(ingestion.blocks(prefetched(plan.samples(path)))):
        ingestion.factor(block)
    batches = ingestion.batcher.batches()
    return joined(batches, ()) if count == 1 else batches, ingestion.samples


class _Ingestion:
    def __init__(self, plan: Plan, count: int, memory: int) -> None:
        self._plan, self._memory = plan, memory
        self._model = plan.rows([])
        self._numbering = Numbering()
        self.batcher = Batcher(count)
        self.samples: tuple[Samples, ...] | None = ()

    def blocks(self, samples: Iterable[Samples]) -> Iterator[RowBlock]:
        """Rows of what is fitted that are to be factored; those without a filter are factored without being formed."""
        for some in samples:
            self._keep(some)
            for piece in self._plan.parts(some, "first"):
                stop = piece.end
                self.batcher.begin(
                    piece.start + piece.first / piece.rate,
                    (stop - piece.first) / piece.rate,
                )
                if plain(piece):
                    self._fused(piece, stop)
                else:
                    yield from self._model.blocks_of(piece, self._numbering.of(piece))

    def factor(self, block: RowBlock) -> None:
        for piece in self.batcher.pieces(block):
            ends = [
                time
                for times in piece.times
                if times.size
                for time in (times[0], times[-1])
            ]
            self.batcher.add(
                block.source, min(ends), max(ends), observed(self._model.layout, piece)
            )

    def _fused(self, samples: Samples, stop: int) -> None:
        cuts = self.batcher.cuts(
            *(samples.start + k / samples.rate for k in (samples.first, stop))
        )
        places = [
            samples.first,
            *(round((cut - samples.start) * samples.rate) for cut in cuts[1:-1]),
            stop,
        ]
        for first, last in pairwise(places):
            if last > first:
                part = replace(samples, first=first, stop=last)
                start, end = (
                    samples.start + k / samples.rate for k in (first, last - 1)
                )
                found = ModelRows.of(self._plan.base, [part]).observation()
                self.batcher.add(samples.source, start, end, found)

    def _keep(self, samples: Samples) -> None:
        """Keep samples for as long as there is memory: all that the log has, or none."""
        if self.samples is None:
            return
        self._memory -= size_of(samples)
        self.samples = (*self.samples, samples) if self._memory >= 0 else None


def size_of(samples: Samples) -> int:
    """Bytes of memory that samples take."""
    signals = (
        samples.q,
        samples.qd,
        samples.qdd,
        samples.y,
        samples.moving,
        *samples.inputs.values(),
    )
    return sum(values.nbytes for values in signals if values is not None)


Task = tuple[Path, Part, str]  # a log, the part of it that is judged, and its role

_FEWEST = 24  # rows of a trace that are kept at least, however many logs there are


@dataclass
class PassesOverData:
    """Logs that a model is fitted to."""

    plan: Plan
    paths: Sequence[Path]  # at least one
    client: Client | None = None  # of a cluster over which the logs are spread
    memory: int = MEMORY  # bytes of samples that are kept in this process
    _kept: dict[Path, tuple[Samples, ...]] = field(default_factory=dict, init=False)

    @cached_property
    def batches(self) -> list[Batch]:
        """What is fitted, in stretches of time or, of many logs, in groups of logs."""
        count = max(-(-BATCHES // len(self.paths)), 1)
        function = self._taken_here if self.client is None else _taken
        if len(self.paths) < BATCHES:
            parts = each(self.client, partial(function, count), self.plan, self.paths)
        else:
            parts = iter(
                summed(
                    self.client,
                    partial(function, 1),
                    joined,
                    self.plan,
                    self.paths,
                    BATCHES,
                )
            )
        found = list(chain.from_iterable(parts))
        if not found:
            raise InputError(
                "nothing of the logs is left to fit: filters, gaps or slow motion took all samples"
            )
        return found

    @cached_property
    def observation(self) -> Observation:
        """The R-factors of all that is fitted."""
        return total(self.batches)

    def pieces(self, count: int) -> list[Observation]:
        """Observations of at most ``count`` stretches of time."""
        return [batch.observation for batch in grouped(self.batches, count)]

    def rows(self) -> Rows:
        """The rows of what is fitted, for methods that go through them again and again."""
        return KeptRows(ModelRows(self.plan.base, self.fitted))

    def validations(
        self, models: Models, tasks: Sequence[Task], reference: Validation | None = None
    ) -> Iterator[Validation]:
        """Measured against predicted outputs."""
        limit = max(LIMIT // max(len(tasks), 1), _FEWEST)
        kept = self.samples if self.client is None else None
        return each(
            self.client,
            partial(_judged, models, reference, limit, kept),
            self.plan,
            tasks,
        )

    def fitted(self) -> Iterable[Samples]:
        """Prepared samples of what is fitted."""
        return chain.from_iterable(self.samples(path, "first") for path in self.paths)

    def samples(self, path: Path, part: Part) -> Iterable[Samples]:
        """Samples of a part of a log, from memory if they are there."""
        kept = self._kept.get(path)
        if kept is None or part == "all":
            return self.plan.samples(path, part)
        return chain.from_iterable(self.plan.parts(samples, part) for samples in kept)

    def _taken_here(self, count: int, plan: Plan, path: Path) -> tuple[Batch, ...]:
        batches, samples = ingest(plan, path, count, self.memory)
        if samples is not None:
            self.memory -= sum(map(size_of, samples))
            self._kept[path] = samples
        return batches


def _taken(count: int, plan: Plan, path: Path) -> tuple[Batch, ...]:
    """A log, by a worker; its samples are not kept."""
    return ingest(plan, path, count)[0]


def _judged(
    models: Models,
    reference: Validation | None,
    limit: int,
    kept: Callable[[Path, Part], Iterable[Samples]] | None,
    plan: Plan,
    task: Task,
) -> Validation:
    """Scores of a log; a worker reads it once more."""
    path, part, role = task
    samples = (kept or plan.samples)(path, part)
    found = validated(
        plan.rows([path]),
        samples,
        models,
        role=role,
        identification=reference,
        limit=limit,
    )
    return replace(
        found,
        source=f"{path} ({part} part)" if plan.holdout and part != "all" else str(path),
    )
