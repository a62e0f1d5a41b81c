"""Taking in a log: everything that is wanted of it, in one pass.

Reading, looking for faults and preparing cost more than factoring, so that a log is gone through once: its R-factors
are kept, which are small, and its prepared samples for as long as there is memory for them.  Where there is not,
validation reads the log again.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

from echelon.identification.rows.batches import Batch, Batcher
from echelon.identification.rows.plan import Plan
from echelon.identification.rows.rows import ModelRows, Numbering, RowBlock, observed, plain, prefetched
from echelon.logs.recording import Samples
from echelon.observe.observation import Layout, Observation

MEMORY = 1 << 28
"""Bytes of samples that are kept between passes over the logs unless said otherwise; what goes beyond is read again."""


@dataclass(frozen=True)
class Ingested:
    """A log as it was taken in."""

    path: Path
    batches: tuple[Batch, ...]  # R-factors of what is fitted, in stretches of time
    samples: tuple[Samples, ...] | None  # all that the log has; None where there is no memory for it

    @property
    def bytes(self) -> int:
        """Memory that samples take."""
        return sum(map(_bytes, self.samples or ()))


@dataclass
class KeptRows:
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

    @property
    def output_units(self) -> tuple[str, ...]:
        """SI units of the outputs."""
        return self.model.output_units

    def blocks(self) -> Iterator[RowBlock]:
        """All rows, in the order of time."""
        if self._kept:
            yield from self._kept
            return
        kept: list[RowBlock] = []
        left = self.memory
        for block in self.model.blocks():
            left -= sum(some.nbytes for parts in (block.times, block.matrices, block.y) for some in parts)
            kept = [*kept, block] if left >= 0 else []
            yield block
        self._kept = tuple(kept) if left >= 0 else ()

    def observation(self) -> Observation:
        """The R-factors of all rows."""
        return ModelRows.factored(self.layout, self.blocks())


def ingest(plan: Plan, path: Path, count: int, memory: int = 0) -> Ingested:
    """Take in a log; its samples are kept if they need no more than so many bytes."""
    ingestion = _Ingestion(plan, count, memory)
    for block in prefetched(ingestion.blocks(prefetched(plan.samples(path)))):
        ingestion.factor(block)
    return Ingested(path, ingestion.batcher.batches(), ingestion.samples)


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
                stop = len(piece) if piece.stop is None else piece.stop
                self.batcher.begin(piece.start + piece.first / piece.rate, (stop - piece.first) / piece.rate)
                if plain(piece):
                    self._fused(piece, stop)
                else:
                    yield from self._model.blocks_of(piece, self._numbering.of(piece))

    def factor(self, block: RowBlock) -> None:
        for piece in self.batcher.pieces(block):
            ends = [time for times in piece.times if times.size for time in (times[0], times[-1])]
            self.batcher.add(block.source, min(ends), max(ends), observed(self._model.layout, piece))

    def _fused(self, samples: Samples, stop: int) -> None:
        cuts = self.batcher.cuts(*(samples.start + k / samples.rate for k in (samples.first, stop)))
        places = [samples.first, *(round((cut - samples.start) * samples.rate) for cut in cuts[1:-1]), stop]
        for first, last in pairwise(places):
            if last > first:
                part = replace(samples, first=first, stop=last)
                start, end = (samples.start + k / samples.rate for k in (first, last - 1))
                found = ModelRows.of(self._plan.base, [part], self._plan.symbols).observation()
                self.batcher.add(samples.source, start, end, found)

    def _keep(self, samples: Samples) -> None:
        """Keep samples for as long as there is memory: all that the log has, or none."""
        if self.samples is None:
            return
        self._memory -= _bytes(samples)
        self.samples = (*self.samples, samples) if self._memory >= 0 else None


def _bytes(samples: Samples) -> int:
    signals = (samples.q, samples.qd, samples.qdd, samples.y, samples.moving, *samples.inputs.values())
    return sum(values.nbytes for values in signals if values is not None)
