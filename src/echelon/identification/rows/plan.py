"""Plan: how logs become rows, with everything decided before the first one is made.

A plan is all that another process needs to take in a log, so that logs can be spread over several.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal

from echelon.base.model import BaseModel
from echelon.errors import InputError
from echelon.identification.rows.holdout import split
from echelon.identification.rows.model_rows import ModelRows
from echelon.logs.columns.column_map import ColumnMap
from echelon.logs.preparation.prepare import prepare
from echelon.logs.preparation.settings import Preparation
from echelon.logs.read_log import read_log
from echelon.logs.recording import Samples, Segment

Part = Literal["all", "first", "last"]
"""Which part of a log: all of it, what is fitted, or what is held out."""


@dataclass(frozen=True)
class Plan:
    """How logs become rows.

    Attributes
    ----------
    base : BaseModel
    columns : tuple of ColumnMap
        What columns mean; see :func:`echelon.logs.read_log.read_log`.
    preparation : Preparation
        With every choice made.
    holdout : float
        Share of each stretch that is held out, 0 to 1.
    symbols : mapping of str to float, optional
        Values of geometry symbols that replace or complete those of the file.
    """

    base: BaseModel
    columns: tuple[ColumnMap, ...]
    preparation: Preparation
    holdout: float = 0.0
    symbols: Mapping[str, float] | None = None

    def samples(
        self,
        path: str | Path,
        part: Part = "all",
        *,
        outputs: bool = True,
        reference: bool = False,
    ) -> Iterator[Samples]:
        """Prepared samples of a log, stretch by stretch.

        Parameters
        ----------
        path : path
        part : "all", "first" or "last"
            What is wanted of it: everything, what is fitted, or what is held out.
        outputs : bool
            Whether measured outputs must be there.
        reference : bool
            States along the positions that the controller was asked for, at the same samples.

        Raises
        ------
        InputError
            If the log cannot be read or is not one of this robot.
        """
        mechanism = self.base.mechanism
        rate = self.preparation.rate
        for piece in read_log(path, mechanism, self.columns, rate=rate, symbols=self.symbols, outputs=outputs):
            for segment in piece.segments:
                samples = prepare(segment, self.preparation, mechanism)
                if reference:
                    asked = prepare(_along_reference(segment), self.preparation, mechanism)
                    samples = replace(asked, moving=samples.moving, first=samples.first, stop=samples.stop)
                yield from self.parts(samples, part)

    def rows(self, paths: Sequence[str | Path], part: Part = "all", *, reference: bool = False) -> ModelRows:
        """The rows of some logs, along the measured or the reference positions; they are read again in every pass."""
        return ModelRows(self.base, partial(self._samples, tuple(paths), part, reference), self.symbols)

    def _samples(self, paths: Sequence[str | Path], part: Part, reference: bool) -> Iterator[Samples]:
        for path in paths:
            yield from self.samples(path, part, reference=reference)

    def __getstate__(self) -> dict[str, object]:
        # what was recorded and compiled here is of no use to another process
        return {**self.__dict__, "base": replace(self.base)}

    def parts(self, samples: Samples, part: Part) -> Iterator[Samples]:
        """What is wanted of prepared samples; nothing if they have no such part.

        Parameters
        ----------
        samples : Samples
        part : "all", "first" or "last"
        """
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
    """The segment with the positions that were asked for in place of the measured ones.

    Raises
    ------
    InputError
        If the log has none.
    """
    if "reference" not in segment.signals:
        problem = "instruments are made from reference positions, and the log has none: map them under 'reference'"
        raise InputError(problem, source=segment.source)
    kept = {name: values for name, values in segment.signals.items() if name == "y"}
    return replace(segment, signals={**kept, "q": segment.signals["reference"]})
