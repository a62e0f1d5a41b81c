"""PassesOverData over the logs: one for the fit, and another for validation where samples did not fit into memory.

On a cluster both are spread, log by log: what comes back are R-factors of batches and scores, never samples.  From as
many logs as batches are wanted each log is a part of one batch, and R-factors are merged where they were made.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

from echelon.errors import InputError
from echelon.identification.cluster import each, summed
from echelon.identification.rows.ingest import BATCHES, MEMORY, Batch, KeptRows, grouped, ingest, joined, size_of, total
from echelon.identification.rows.plan import Part, Plan
from echelon.identification.rows.rows import ModelRows, Rows
from echelon.identification.validation import LIMIT, Models, Validation, validated
from echelon.logs.recording import Samples
from echelon.observe.observation import Observation

if TYPE_CHECKING:
    from distributed import Client

Task = tuple[Path, Part, str]
"""A log, the part of it that is judged, and its role."""

_FEWEST = 24
"""Rows of a trace that are kept at least, however many logs there are."""


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
            parts = iter(summed(self.client, partial(function, 1), joined, self.plan, self.paths, BATCHES))
        found = list(chain.from_iterable(parts))
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
        return KeptRows(ModelRows(self.plan.base, self.fitted))

    def validations(
        self, models: Models, tasks: Sequence[Task], reference: Validation | None = None
    ) -> Iterator[Validation]:
        """Measured against predicted outputs."""
        limit = max(LIMIT // max(len(tasks), 1), _FEWEST)
        kept = self.samples if self.client is None else None
        return each(self.client, partial(_judged, models, reference, limit, kept), self.plan, tasks)

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
    found = validated(plan.rows([path]), samples, models, role=role, identification=reference, limit=limit)
    return replace(found, source=f"{path} ({part} part)" if plan.holdout and part != "all" else str(path))
