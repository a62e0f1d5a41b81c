"""Samples in, factors out: in blocks, on several threads, in constant memory.

Samples are cut into blocks of a fixed length counted from the first sample of all.  Every block gives factors of its
own, and these are merged in the order of the blocks; so neither the number of threads nor the way in which the samples
arrive changes a bit of the result.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np
import numpy.typing as npt

from echelon.errors import InputError
from echelon.machine.batch import Batch, batch
from echelon.machine.kernel import processors
from echelon.observe.engine import Engine

Floats = npt.NDArray[np.float64]

BLOCK = 16_416
"""Samples in a block: long enough that merging costs less than 1 %, short enough to keep several threads busy."""


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
        self._waiting: list[Batch] = []  # fewer samples than a block, copied

    def add(self, values: Mapping[str, npt.ArrayLike]) -> None:
        """Take samples in.

        Parameters
        ----------
        values : mapping of str to array
            The function's arguments by name, of shape (samples, size), or (size,) for uniform ones, which must be the
            same every time.

        Raises
        ------
        InputError
            If arrays do not fit, or values are not finite.  Then the stream must not be used any more.
        """
        given = batch(self.engine.function.arguments, values)
        _check_uniform(self.engine, given)
        if self._waiting and not np.array_equal(self._waiting[0].uniform, given.uniform):
            raise InputError("arguments that are the same for all samples have changed between two pieces")
        start = self.samples
        ready = sum(piece.samples for piece in self._waiting)
        taken = 0
        pieces: list[tuple[Batch, int, int, int]] = []  # batch, first, count, number of the first sample
        if ready and ready + given.samples >= self.block:
            taken = self.block - ready
            whole = _joined([*self._waiting, _part(given, 0, taken)])
            pieces.append((whole, 0, self.block, start - ready))
            self._waiting = []
            ready = 0
        if not ready:
            stop = taken + (given.samples - taken) // self.block * self.block
            pieces += [(given, first, self.block, start + first) for first in range(taken, stop, self.block)]
            taken = stop
        if taken < given.samples:
            self._waiting.append(_copied(_part(given, taken, given.samples)))
        self._run(pieces)
        self.samples += given.samples

    def factors(self) -> tuple[Floats, ...]:
        """Each output's factor of all samples so far; more may be added afterwards."""
        total = self._total.copy()
        if self._waiting:
            rest = _joined(self._waiting)
            self._merge(total, self._observed(rest, 0, rest.samples, self.samples - rest.samples))
        return tuple(R.copy() for R in self.engine.factors(total))

    # -- blocks ------------------------------------------------------------------------------------------------

    def _run(self, pieces: list[tuple[Batch, int, int, int]]) -> None:
        tasks = (lambda piece=piece: self._observed(*piece) for piece in pieces)
        for part in _in_order(tasks, min(self.threads, len(pieces))):
            self._merge(self._total, part)

    def _merge(self, total: Floats, part: Floats) -> None:
        self.engine.merge(total, part)

    def _observed(self, given: Batch, first: int, count: int, number: int) -> Floats:
        """The factors of one block."""
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
            part = self.engine.observe(given, first, count)
        if not np.isfinite(part).all():
            raise _not_finite(self.engine, given, first, count, number)
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


def _not_finite(engine: Engine, given: Batch, first: int, count: int, number: int) -> InputError:
    """The error for a block whose factors are not finite."""
    varying = [a for a in engine.function.arguments if not a.uniform]
    found = []
    for argument, column in zip(varying, given.columns, strict=True):
        wrong = np.argwhere(~np.isfinite(column[first : first + count]))
        if len(wrong):
            row, k = (int(i) for i in wrong[0])
            found.append((row, argument.name, argument.labels[k], float(column[first + row, k])))
    if found:
        row, name, label, value = min(found)
        return InputError(
            f"{name} of '{label}' is {value} in sample {number + row}; leave out samples that are not complete"
        )
    return InputError(
        f"the regressor is not finite, or too large to be squared, in some sample from {number} to "
        f"{number + count - 1}, though all its arguments are finite; check their units"
    )
