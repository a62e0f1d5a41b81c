"""Taking in a log: everything that is wanted of it, in one pass.

Reading, looking for faults and preparing cost more than factoring, so that a log is gone through once: its R-factors
are kept, which are small, and its rows for as long as there is memory for them.  Where there is not, validation reads
the log again, and then filters predictions alone, a few signals instead of all columns of the regressor.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from echelon.arrays import Floats
from echelon.identification.rows.batches import Batch, Batcher
from echelon.identification.rows.plan import Part, Plan
from echelon.identification.rows.rows import ModelRows, Numbering, RowBlock, observed, plain, prefetched, rows_taken
from echelon.logs.recording import Samples
from echelon.observe.layout import Layout
from echelon.observe.observation import Observation

MEMORY = 1 << 28
"""Bytes of rows that are kept between passes over the logs unless said otherwise; what goes beyond is read again."""


@dataclass(frozen=True)
class Ingested:
    """A log as it was taken in."""

    path: Path
    batches: tuple[Batch, ...]  # R-factors of what is fitted, in stretches of time
    kept: dict[Part, KeptRows]  # rows of what is fitted and of what is held out

    @property
    def bytes(self) -> int:
        """Memory that rows take."""
        return sum(rows.bytes for rows in self.kept.values())


@dataclass(frozen=True)
class KeptRows:
    """Rows that are in memory; see :class:`echelon.identification.rows.rows.Rows`."""

    layout: Layout
    units: tuple[str, ...]
    output_units: tuple[str, ...]
    kept: tuple[RowBlock, ...]

    @property
    def bytes(self) -> int:
        """Memory that they take."""
        return sum(map(_bytes, self.kept))

    def blocks(self) -> Iterator[RowBlock]:
        """The rows that are fitted, in the order of time."""
        return (block.fitted for block in self.kept)

    def scored(self) -> Iterator[RowBlock]:
        """All rows, in the order of time."""
        return iter(self.kept)

    def observation(self) -> Observation:
        """The R-factors of the rows that are fitted."""
        return ModelRows.factored(self.layout, self.kept)


@dataclass(frozen=True)
class PredictedRows:
    """Predictions of a log in place of rows: what W ζ is for the model, and for the model one had before.

    They are rows of a layout with a parameter for each model, which is 1 for that model and 0 for the other.
    """

    model: ModelRows
    values: tuple[Floats, ...]  # shape (r,); base parameters of one or two models

    @property
    def layout(self) -> Layout:
        """Outputs, and the models as parameters."""
        names = ("model", "prior")[: len(self.values)]
        outputs = self.model.layout.outputs
        return Layout(outputs, names, (tuple(range(len(names))),) * len(outputs))

    @property
    def units(self) -> tuple[str, ...]:
        """The models have none."""
        return ("",) * len(self.values)

    @property
    def output_units(self) -> tuple[str, ...]:
        """SI units of the outputs."""
        return self.model.output_units

    def blocks(self) -> Iterator[RowBlock]:
        """The rows that are fitted, in the order of time."""
        return (block.fitted for block in self.scored())

    def scored(self) -> Iterator[RowBlock]:
        """All rows, in the order of time."""
        numbering = Numbering()
        for samples in prefetched(self.model.source()):
            yield self._block(samples, numbering.of(samples))

    def observation(self) -> Observation:
        """The R-factors of the rows that are fitted."""
        return ModelRows.factored(self.layout, self.blocks())

    def _block(self, samples: Samples, segment: int) -> RowBlock:
        assert samples.y is not None
        times, y, moving = rows_taken(samples, samples.y)
        predicted = [rows_taken(samples, self.model.predict(samples, some))[1] for some in self.values]
        matrices = tuple(np.stack(predicted, axis=2).transpose(1, 0, 2))
        flags = None if moving is None else tuple(moving.T)
        return RowBlock(samples.source, segment, (times,) * len(matrices), matrices, tuple(y.T), flags)


def ingest(plan: Plan, path: Path, count: int, memory: int = 0) -> Ingested:
    """Take in a log."""
    ingestion = _Ingestion(plan, count, memory)
    for block in prefetched(ingestion.blocks(prefetched(plan.samples(path)))):
        ingestion.factor(block)
    return Ingested(path, ingestion.batcher.batches(), ingestion.kept())


class _Ingestion:
    def __init__(self, plan: Plan, count: int, memory: int) -> None:
        self._plan, self._memory = plan, memory
        self._model = plan.rows([])
        self.batcher = Batcher(count)
        self._parts: tuple[Part, ...] = ("first", "last") if plan.holdout else ("first",)
        self._blocks: dict[Part, list[RowBlock]] = {part: [] for part in self._parts}
        self._numbering: dict[Part, Numbering] = {part: Numbering() for part in self._parts}

    def blocks(self, samples: Iterable[Samples]) -> Iterator[RowBlock]:
        """Rows that are to be factored; those of other samples are kept, or factored without being formed."""
        for some in samples:
            for part in self._parts:
                for piece in self._plan.parts(some, part):
                    yield from self._blocks_of(part, piece)

    def factor(self, block: RowBlock) -> None:
        for piece in self.batcher.pieces(block.fitted):
            ends = [time for times in piece.times if times.size for time in (times[0], times[-1])]
            self.batcher.add(block.source, min(ends), max(ends), observed(self._model.layout, piece))

    def kept(self) -> dict[Part, KeptRows]:
        model = self._model
        return {
            part: KeptRows(model.layout, model.units, model.output_units, tuple(blocks))
            for part, blocks in self._blocks.items()
        }

    def _blocks_of(self, part: Part, samples: Samples) -> Iterator[RowBlock]:
        if part == "first":
            stop = len(samples) if samples.stop is None else samples.stop
            start = samples.start + samples.first / samples.rate
            self.batcher.begin(start, (stop - samples.first) / samples.rate)
        if plain(samples):
            # rows of every sample would not fit into memory for long, and need not be formed to be factored
            self._blocks = {}
            if part == "first":
                self._fused(samples)
        elif part == "first" or part in self._blocks:
            for block in self._model.blocks_of(samples, self._numbering[part].of(samples)):
                self._keep(part, block)
                if part == "first":
                    yield block

    def _fused(self, samples: Samples) -> None:
        stop = len(samples) if samples.stop is None else samples.stop
        cuts = self.batcher.cuts(*(samples.start + k / samples.rate for k in (samples.first, stop)))
        places = [samples.first, *(round((cut - samples.start) * samples.rate) for cut in cuts[1:-1]), stop]
        for first, last in pairwise(places):
            if last > first:
                part = replace(samples, first=first, stop=last)
                start, end = (samples.start + k / samples.rate for k in (first, last - 1))
                found = ModelRows.of(self._plan.base, [part], self._plan.symbols).observation()
                self.batcher.add(samples.source, start, end, found)

    def _keep(self, part: Part, block: RowBlock) -> None:
        """Keep rows for as long as there is memory: of all that the log has, or of none."""
        if part not in self._blocks:
            return
        self._memory -= _bytes(block)
        if self._memory < 0:
            self._blocks = {}
        else:
            self._blocks[part].append(block)


def _bytes(block: RowBlock) -> int:
    return sum(some.nbytes for parts in (block.times, block.matrices, block.y) for some in parts)


def chained(rows: Sequence[KeptRows]) -> KeptRows:
    """Rows of several logs, one after another."""
    return replace(rows[0], kept=tuple(block for some in rows for block in some.kept))
