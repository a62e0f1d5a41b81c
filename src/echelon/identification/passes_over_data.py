"""Passes over the logs: one for the fit, as R-factors of batches; a second for validation where memory is short.

Reading, looking for faults and preparing cost more than factoring, so that a log is gone through once: its R-factors
are kept, which are small, and its prepared samples for as long as there is memory for them.  Where there is not,
validation reads the log again.

On a cluster both passes are spread, log by log: what comes back are R-factors of batches and scores, never samples.
From as many logs as batches are wanted each log is a part of one batch, and R-factors are merged where they were made.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import chain, pairwise
from pathlib import Path
from typing import TYPE_CHECKING

from echelon.compute import Layout, Observation
from echelon.identification.batches import (
    BATCHES,
    Batcher,
    TimeBatch,
    grouped,
    joined,
    total,
)
from echelon.identification.cluster import each, summed
from echelon.identification.logs.recording import Samples
from echelon.identification.rows.plan import LogPlan, Part
from echelon.identification.rows.rows import (
    ModelRows,
    Numbering,
    RowBlock,
    RowStream,
    plain,
    prefetched,
)
from echelon.identification.scores import Validation
from echelon.identification.traces import BUCKET, LIMIT
from echelon.identification.validation import Models, validated
from echelon.shared import InputError

if TYPE_CHECKING:
    from distributed import Client

MEMORY = 1 << 28
"""Bytes of samples that are kept between passes over the logs unless said otherwise; what goes beyond is read again."""


@dataclass
class KeptRows(RowStream):
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
    plan: LogPlan, path: Path, count: int, memory: int = 0
) -> tuple[tuple[TimeBatch, ...], tuple[Samples, ...] | None]:
    """R-factors of what is fitted of a log, in stretches of time; and all its samples, if there is memory for them.

    Of a single stretch they are one batch, which can be merged with those of other logs.
    """
    ingestion = _Ingestion(plan, count, memory)
    for block in prefetched(ingestion.blocks(prefetched(plan.samples(path)))):
        ingestion.batcher.take(block, ingestion.model.layout)
    batches = ingestion.batcher.batches()
    return joined(batches, ()) if count == 1 else batches, ingestion.samples


class _Ingestion:
    def __init__(self, plan: LogPlan, count: int, memory: int) -> None:
        self._plan, self._memory = plan, memory
        self.model = plan.rows([])
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
                if plain(piece) and self.model.is_plain:
                    self._fused(piece, stop)
                else:
                    yield from self.model.blocks_of(piece, self._numbering.of(piece))

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

# rows of a trace that are kept at least, however many logs there are
LEAST_TRACE = 2 * BUCKET


@dataclass
class PassesOverData:
    """Logs that a model is fitted to."""

    plan: LogPlan
    paths: Sequence[Path]  # at least one
    client: Client | None = None  # of a cluster over which the logs are spread
    memory: int = MEMORY  # bytes of samples that are kept in this process
    _kept: dict[Path, tuple[Samples, ...]] = field(default_factory=dict, init=False)

    @cached_property
    def batches(self) -> list[TimeBatch]:
        """Batches of all that is fitted: stretches of time or, of many logs, groups of logs."""
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
                "no samples left to fit: filters, gaps or slow motion removed all"
            )
        return found

    @cached_property
    def observation(self) -> Observation:
        """The R-factors of all that is fitted."""
        return total(self.batches)

    def pieces(self, count: int) -> list[Observation]:
        """Observations of at most ``count`` stretches of time."""
        return [batch.observation for batch in grouped(self.batches, count)]

    def rows(self) -> RowStream:
        """The rows of what is fitted, for methods that go through them again and again."""
        return KeptRows(ModelRows(self.plan.base, self.fitted))

    def validations(
        self, models: Models, tasks: Sequence[Task], reference: Validation | None = None
    ) -> Iterator[Validation]:
        """Measured against predicted outputs."""
        limit = max(LIMIT // max(len(tasks), 1), LEAST_TRACE)
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

    def _taken_here(
        self, count: int, plan: LogPlan, path: Path
    ) -> tuple[TimeBatch, ...]:
        batches, samples = ingest(plan, path, count, self.memory)
        if samples is not None:
            self.memory -= sum(map(size_of, samples))
            self._kept[path] = samples
        return batches


def _taken(count: int, plan: LogPlan, path: Path) -> tuple[TimeBatch, ...]:
    """A log, by a worker; its samples are not kept."""
    return ingest(plan, path, count)[0]


def _judged(
    models: Models,
    reference: Validation | None,
    limit: int,
    kept: Callable[[Path, Part], Iterable[Samples]] | None,
    plan: LogPlan,
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
