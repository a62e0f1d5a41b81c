"""Samples in, factors out: in blocks, on several threads, in constant memory.

Samples are cut into blocks of a fixed length counted from the first sample of all.  Every block gives factors of its
own, and these are merged in the order of the blocks; so neither the number of threads nor the way in which the samples
arrive changes a bit of the result.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.machine.batch import Batch, batch
from echelon.machine.kernel import processors
from echelon.observe.engine import Engine

BLOCK = 8208
"""Samples in a block: long enough that merging costs 2 %, short enough to keep several threads busy."""


@dataclass(frozen=True)
class _Piece:
    """Samples first … first + count − 1 of a batch, whose sample 0 has a number among all."""

    batch: Batch
    first: int
    count: int
    number: int


class Stream:
    """Accumulates samples that arrive in pieces.

    Parameters
    ----------
    engine : Engine
    block : int
        Samples in a block, rounded up to a multiple of the engine's unit.
    threads : int, optional
        At most so many; as many as there are processors if omitted.

    Raises
    ------
    InputError
        If the block or the number of threads is not positive.
    """

    def __init__(self, engine: Engine, block: int = BLOCK, threads: int | None = None) -> None:
        if block < 1 or (threads is not None and threads < 1):
            raise InputError(f"block is {block} and threads is {threads}; expected at least 1 of each")
        self.engine = engine
        self.block = -(-block // engine.unit) * engine.unit
        self.threads = threads or processors()
        self.samples = 0
        self._total = engine.start()
        self._waiting: list[Batch] = []  # samples that are too few to keep all threads busy
        self._ready = 0  # how many
        self._uniform: Floats | None = None

    def add(self, values: Mapping[str, npt.ArrayLike], *, lasting: bool = False) -> None:
        """Take samples in.

        Parameters
        ----------
        values : mapping of str to array
            The function's arguments by name, of shape (samples, size), or (size,) for uniform ones, which must be the
            same every time.
        lasting : bool
            The arrays will not be changed before the result is taken, so they need not be copied.

        Raises
        ------
        InputError
            If arrays do not fit, or values are not finite.  Then the stream must not be used any more.
        """
        self.take(batch(self.engine.function.arguments, values), lasting=lasting)

    def take(self, given: Batch, *, lasting: bool = False) -> None:
        """Take the samples of a batch in; errors as for :meth:`add`.

        Parameters
        ----------
        given : Batch
            Of the arguments of the engine's function.
        lasting : bool
            Its arrays will not be changed.
        """
        _check_uniform(self.engine, given)
        if self._uniform is None:
            self._uniform = given.uniform
        elif not np.array_equal(self._uniform, given.uniform):
            raise InputError("arguments that are the same for all samples have changed between two pieces")
        start, self.samples = self.samples, self.samples + given.samples
        rest = given
        if self._ready + given.samples >= self.threads * self.block:
            missing = -self._ready % self.block
            whole = _joined([*self._waiting, _part(given, 0, missing)])
            end = missing + (given.samples - missing) // self.block * self.block
            pieces = [*self._blocks(whole, 0, start - self._ready), *self._blocks(_part(given, 0, end), missing, start)]
            self._run(pieces, self._total)
            rest, self._waiting, self._ready = _part(given, end, given.samples), [], 0
        if rest.samples:
            self._waiting.append(rest if lasting else _copied(rest))
            self._ready += rest.samples

    def factors(self) -> tuple[Floats, ...]:
        """Each output's factor of all samples so far; more may be added afterwards."""
        total = self._total.copy()
        if self._waiting:
            self._waiting = [_joined(self._waiting)]
            self._run(self._blocks(self._waiting[0], 0, self.samples - self._ready), total)
        return tuple(R.copy() for R in self.engine.factors(total))

    # -- blocks ------------------------------------------------------------------------------------------------

    def _blocks(self, given: Batch, first: int, number: int) -> list[_Piece]:
        """Blocks of a batch from one of its samples on; `number` is that of its sample 0 among all."""
        starts = range(first, given.samples, self.block)
        return [_Piece(given, start, min(self.block, given.samples - start), number) for start in starts]

    def _run(self, pieces: list[_Piece], total: Floats) -> None:
        for part in _in_order((partial(self._observed, piece) for piece in pieces), min(self.threads, len(pieces))):
            self.engine.merge(total, part)

    def _observed(self, piece: _Piece) -> Floats:
        """The factors of one block."""
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
            part = self.engine.observe(piece.batch, piece.first, piece.count)
        if not np.isfinite(part).all():
            raise _not_finite(self.engine, piece)
        return part


def _in_order(tasks: Iterator[Callable[[], Floats]], threads: int) -> Iterator[Floats]:
    """Results of tasks in their order, with few of them in memory at a time."""
    if threads <= 1:
        for task in tasks:
            yield task()
        return
    with ThreadPoolExecutor(threads) as pool:
        running: deque[Future[Floats]] = deque()
        try:
            for task in tasks:
                running.append(pool.submit(task))
                if len(running) > 2 * threads:
                    yield running.popleft().result()
            while running:
                yield running.popleft().result()
        finally:
            for future in running:
                future.cancel()


# -- pieces of batches -----------------------------------------------------------------------------------------------


def _part(given: Batch, first: int, end: int) -> Batch:
    return Batch(end - first, tuple(column[first:end] for column in given.columns), given.uniform)


def _copied(given: Batch) -> Batch:
    """A batch of its own, which the caller cannot change."""
    return Batch(given.samples, tuple(column.copy() for column in given.columns), given.uniform)


def _joined(pieces: list[Batch]) -> Batch:
    columns = tuple(np.concatenate(columns) for columns in zip(*(piece.columns for piece in pieces), strict=True))
    return Batch(sum(piece.samples for piece in pieces), columns, pieces[0].uniform)


# -- what is wrong with values -----------------------------------------------------------------------------------------


def _check_uniform(engine: Engine, given: Batch) -> None:
    names = [(a.name, label) for a in engine.function.arguments if a.uniform for label in a.labels]
    for (name, label), value in zip(names, given.uniform.tolist(), strict=True):
        if not np.isfinite(value):
            raise InputError(f"{name} of '{label}' is {value}; expected a finite number")


def _not_finite(engine: Engine, piece: _Piece) -> InputError:
    """The error for a block whose factors are not finite."""
    varying = [a for a in engine.function.arguments if not a.uniform]
    found = []
    for argument, column in zip(varying, piece.batch.columns, strict=True):
        wrong = np.argwhere(~np.isfinite(column[piece.first : piece.first + piece.count]))
        if len(wrong):
            row, k = piece.first + int(wrong[0, 0]), int(wrong[0, 1])
            found.append((row, argument.name, argument.labels[k], float(column[row, k])))
    if found:
        row, name, label, value = min(found)
        return InputError(
            f"{name} of '{label}' is {value} in sample {piece.number + row}; leave out samples that are not complete"
        )
    first = piece.number + piece.first
    return InputError(
        f"the regressor is not finite, or too large to be squared, in some sample from {first} to "
        f"{first + piece.count - 1}, though all its arguments are finite; check their units"
    )
