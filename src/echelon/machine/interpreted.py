"""A function evaluated by NumPy, where LLVM is not installed: the same numbers but for the last digits, more slowly."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from functools import cached_property

import numpy as np

from echelon.arrays import Floats
from echelon.errors import SlowWarning
from echelon.machine.batch import Batch
from echelon.program.function import Function
from echelon.program.schedule import FloatArithmetic, Schedule

_TOGETHER = 1 << 17  # values of nodes that are computed together, which stay in the cache
_LARGE = 10**9  # operations: several seconds
_SLOW = 'NumPy computes this; machine code takes a tenth of the time or less: pip install "echelon-robotics[fast]"'


class Interpreted:
    """A function's entries, for some samples at a time."""

    def __init__(self, function: Function) -> None:
        self.function = function

    def __call__(self, given: Batch, together: int | None = None) -> Iterator[tuple[int, Floats]]:
        """The first sample of each piece of a batch, with the entries there, of shape (entries, samples)."""
        schedule = self._schedule
        if schedule.size * given.samples > _LARGE:
            warnings.warn(_SLOW, SlowWarning, stacklevel=3)
        together = together or max(_TOGETHER // max(schedule.size, 1), 1)
        for first in range(0, given.samples, together):
            piece = given.part(first, min(first + together, given.samples))
            with np.errstate(all="ignore"):
                yield first, schedule.run(FloatArithmetic(), self._values(piece), piece.samples)

    @cached_property
    def _schedule(self) -> Schedule:
        return Schedule(self.function.program, self.function.outputs)

    def _values(self, piece: Batch) -> dict[int, Floats]:
        """Values of the inputs by node."""
        uniform = [node for a in self.function.arguments if a.uniform for node in a.nodes]
        varying = [node for a in self.function.arguments if not a.uniform for node in a.nodes]
        columns = [column for array in piece.columns for column in array.T]
        return dict(zip(uniform, piece.uniform, strict=True)) | dict(zip(varying, columns, strict=True))
