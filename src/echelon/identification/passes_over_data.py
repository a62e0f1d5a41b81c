"""PassesOverData over the logs: one for the fit, and another for validation where rows did not fit into memory.

On a cluster both are spread, log by log: what comes back are R-factors of batches and scores, never samples.  From as
many logs as batches are wanted each log is a part of one batch, and R-factors are merged where they were made.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.identification.cluster import each, summed
from echelon.identification.rows.batches import BATCHES, Batch, grouped, joined, total
from echelon.identification.rows.ingest import MEMORY, Ingested, KeptRows, PredictedRows, chained, ingest
from echelon.identification.rows.plan import Part, Plan
from echelon.identification.rows.rows import Rows, ScoredRows
from echelon.identification.validation import LIMIT, Validation, validate
from echelon.observe.observation import Observation

if TYPE_CHECKING:
    from distributed import Client

Task = tuple[Path, Part, str]
"""A log, the part of it that is judged, and its role."""

_Part = tuple[tuple[Batch, ...], tuple[tuple[Path, int], ...]]
"""Batches of some logs, and those of the logs whose rows are few, with their bytes."""

_FEWEST = 24
"""Rows of a trace that are kept at least, however many logs there are."""


@dataclass
class PassesOverData:
    """Logs that a model is fitted to."""

    plan: Plan
    paths: Sequence[Path]  # at least one
    client: Client | None = None  # of a cluster over which the logs are spread
    memory: int = MEMORY  # bytes of rows that are kept in this process
    _kept: dict[tuple[Path, Part], KeptRows] = field(default_factory=dict, init=False)
    _small: set[Path] = field(default_factory=set, init=False)  # logs whose rows one process would have kept

    @cached_property
    def batches(self) -> list[Batch]:
        """What is fitted, in stretches of time or, of many logs, in groups of logs."""
        count = max(-(-BATCHES // len(self.paths)), 1)
        function = self._taken_here if self.client is None else partial(_taken, self.memory)
        if len(self.paths) < BATCHES:
            parts = each(self.client, partial(function, count), self.plan, self.paths)
        else:
            parts = iter(summed(self.client, partial(function, 1), _merged, self.plan, self.paths, BATCHES))
        found: list[Batch] = []
        for batches, sizes in parts:
            found += batches
            self._count(sizes)
        if not found:
            raise InputError("nothing of the logs is left to fit: filters, gaps or slow motion took all samples")
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
        kept = [self._kept.get((path, "first")) for path in self.paths] if self.batches else []
        if all(kept):
            return chained([rows for rows in kept if rows])
        return self.plan.rows(self.paths, "first")

    def validations(
        self, values: Floats, prior: Floats | None, tasks: Sequence[Task], reference: Validation | None = None
    ) -> Iterator[Validation]:
        """Measured against predicted outputs."""
        limit = max(LIMIT // max(len(tasks), 1), _FEWEST)
        judged = _Judged(values, prior, reference, limit, self.plan.holdout > 0)
        if self.client is None:
            return each(None, partial(self._validated_here, judged), self.plan, tasks)
        small = frozenset(self._small)
        return each(self.client, partial(_validated, judged, small), self.plan, tasks)

    def _taken_here(self, count: int, plan: Plan, path: Path) -> _Part:
        ingested = ingest(plan, path, count, self.memory)
        self.memory -= ingested.bytes
        self._kept |= {(path, part): rows for part, rows in ingested.kept.items()}
        return _few(ingested, count), ()

    def _count(self, sizes: Sequence[tuple[Path, int]]) -> None:
        """Note which logs would have been kept, in the order of logs, had one process taken them in."""
        for path, size in sizes:
            if size <= self.memory:
                self.memory -= size
                self._small.add(path)

    def _validated_here(self, judged: _Judged, plan: Plan, task: Task) -> Validation:
        kept = self._kept.get(task[:2])
        if kept is None:
            return _validated(judged, frozenset(), plan, task)
        return judged.validation(kept, judged.values, judged.prior, task)


@dataclass(frozen=True)
class _Judged:
    """Models to be judged, and how."""

    values: Floats
    prior: Floats | None
    reference: Validation | None
    limit: int
    parted: bool

    def validation(self, rows: ScoredRows, values: Floats, prior: Floats | None, task: Task) -> Validation:
        path, part, role = task
        found = validate(rows, values, role=role, prior_values=prior, identification=self.reference, limit=self.limit)
        return replace(found, source=f"{path} ({part} part)" if self.parted and part != "all" else str(path))


def _taken(memory: int, count: int, plan: Plan, path: Path) -> _Part:
    """A log, by a worker; its rows are not kept, but how many there are decides how it is judged."""
    ingested = ingest(plan, path, count, memory)
    return _few(ingested, count), ((path, ingested.bytes),) if ingested.kept else ()


def _merged(a: _Part, b: _Part) -> _Part:
    return joined(a[0], b[0]), a[1] + b[1]


def _few(ingested: Ingested, count: int) -> tuple[Batch, ...]:
    """The batches of a log; where logs are to be merged, at most one."""
    return joined(ingested.batches, ()) if count == 1 else ingested.batches


def _validated(judged: _Judged, small: Collection[Path], plan: Plan, task: Task) -> Validation:
    """A log, read once more: predictions alone are filtered, but where another process has rows, rows are formed."""
    path, part, _ = task
    if path in small and part != "all":
        return judged.validation(plan.rows([path], part), judged.values, judged.prior, task)
    models = (judged.values,) if judged.prior is None else (judged.values, judged.prior)
    rows = PredictedRows(plan.rows([path], part), models)
    chosen = np.eye(len(models))
    return judged.validation(rows, chosen[0], chosen[1] if len(models) > 1 else None, task)
