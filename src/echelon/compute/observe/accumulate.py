"""Least squares over many samples without the observation matrix W.

Samples are cut into blocks of a fixed length, counted from the first sample of all.  Within a block the regressor is
evaluated for a few hundred samples at a time, which stay in the cache, and LAPACK brings each output's factor up to
date with them.  Factors of blocks are merged in order; so neither the number of threads nor the way in which samples
arrive changes a bit of the result.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np
import numpy.typing as npt

from echelon.algebra import Argument, Function
from echelon.compute.machine.kernel import BatchArguments, Columns, batch, processors
from echelon.compute.machine.target import Target
from echelon.compute.observe.observation import (
    NormalEquations,
    Observation,
    layout_of,
    measured,
)
from echelon.compute.observe.triangle import ROWS, update_triangle, upper_triangle
from echelon.shared import Floats, InputError, one_thread

BLOCK = 32 * ROWS
"""Samples in a block by default: long enough that merging costs little, short enough to keep all threads busy."""

_AHEAD = 4  # blocks for each thread whose factors wait to be merged

Data = Mapping[str, npt.ArrayLike]
Factors = list[Floats]  # a matrix for each output: its R, or its Gram matrix


@dataclass(frozen=True)
class _Method:
    """Functions that add transposed rows to a factor, in place, and merge two factors."""

    add: Callable[[Floats, Floats], None]
    merge: Callable[[Floats, Floats], Floats]


class Observer:
    """A regressor ready to take samples in: compiled once, used for many logs.

    ``outputs`` names the argument with the measured outputs, of shape (samples, outputs).

    >>> from echelon.algebra.program.tape import Program
    >>> program = Program()
    >>> x = program.input("x")
    >>> argument = Argument("x", (x.node,), ("x",), ("rad",))
    >>> entries = {(0, 0): program.one.node, (0, 1): x.node}
    >>> line = Function("line", program, (argument,), entries, (("force",), ("offset", "slope")))
    >>> Observer(line)({"x": [[0.0], [1.0], [2.0]], "y": [[1.0], [3.0], [5.0]]}).combined().solve().round(9)
    array([1., 2.])
    """

    def __init__(
        self, function: Function, *, outputs: str = "y", target: Target | None = None
    ) -> None:
        self.function = measured(function, outputs)
        self.layout, columns = layout_of(self.function)
        self._places = np.split(columns, np.cumsum(self.layout.sizes)[:-1])
        self._columns = Columns(self.function, ROWS, target)

    def __call__(
        self,
        data: Data | Iterable[Data],
        *,
        block: int | None = None,
        threads: int | None = None,
    ) -> Observation:
        """R-factors of [W y].

        ``data`` holds the regressor's arguments and the measured outputs by name, of shape (samples, size), or (size,)
        where they are the same for all samples; pieces of an iterable follow one another.
        """
        factors, samples = self._reduced(
            data, _Method(update_triangle, upper_triangle), block, threads
        )
        return Observation.of(self.layout, factors, samples)

    def normal_equations(
        self,
        data: Data | Iterable[Data],
        *,
        block: int | None = None,
        threads: int | None = None,
    ) -> NormalEquations:
        """Gram matrices of [W y]: faster, with half the digits; arguments are those of a call."""
        factors, samples = self._reduced(
            data, _Method(_add_products, np.add), block, threads
        )
        return NormalEquations(self.layout, tuple(factors), samples)

    def _reduced(
        self,
        data: Data | Iterable[Data],
        method: _Method,
        block: int | None,
        threads: int | None,
    ) -> tuple[Factors, int]:
        """All outputs' factors, and the number of samples."""
        block = BLOCK if block is None else block
        if block < 1 or (threads is not None and threads < 1):
            raise InputError(
                f"block is {block} and threads is {threads}; expected at least 1 of each"
            )
        block, threads = -(-block // ROWS) * ROWS, threads or processors()
        total, samples, factored = self._nothing(), 0, partial(self._factored, method)
        with one_thread(), ThreadPoolExecutor(threads) as pool:
            for blocks in _rounds(self.function.arguments, data, block, threads):
                for start in range(0, len(blocks), _AHEAD * threads):
                    for part in pool.map(
                        factored, blocks[start : start + _AHEAD * threads]
                    ):
                        total = [
                            method.merge(a, b) for a, b in zip(total, part, strict=True)
                        ]
                samples += sum(piece.batch.samples for piece in blocks)
        return total, samples

    def _nothing(self) -> Factors:
        return [np.zeros((size, size), order="F") for size in self.layout.sizes]

    def _factored(self, method: _Method, block: _Block) -> Factors:
        """The factors of one block."""
        factors = self._nothing()
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
            for table in self._columns(block.batch):
                for factor, places in zip(factors, self._places, strict=True):
                    method.add(factor, table[places])
        if not all(np.isfinite(factor).all() for factor in factors):
            raise _not_finite(self.function.arguments, block)
        return factors

    def __repr__(self) -> str:
        return f"Observer({self.function})"


def _add_products(gram: Floats, columns: Floats) -> None:
    gram += columns @ columns.T


# -- blocks ------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Block:
    """Samples that are factored together, and the number of the first of them among all."""

    batch: BatchArguments
    number: int


def _rounds(
    arguments: tuple[Argument, ...],
    data: Data | Iterable[Data],
    length: int,
    threads: int,
) -> Iterator[list[_Block]]:
    """Blocks, as soon as there are enough for all threads; what waits for more samples is copied."""
    waiting: list[BatchArguments] = []
    number = ready = 0
    for values in [data] if isinstance(data, Mapping) else data:
        given = batch(arguments, values)
        _check_uniform(arguments, given, waiting)
        waiting.append(given)
        ready += given.samples
        whole = ready // length * length if ready >= threads * length else 0
        if whole:
            joined = BatchArguments.joined(waiting)
            yield [
                _Block(joined.part(k, k + length), number + k)
                for k in range(0, whole, length)
            ]
            waiting = [joined.part(whole, ready)]
            number = number + whole
            ready = ready - whole
        waiting[-1] = waiting[-1].copy()
    if ready:
        rest = BatchArguments.joined(waiting)
        yield [
            _Block(rest.part(k, min(k + length, ready)), number + k)
            for k in range(0, ready, length)
        ]


def _check_uniform(
    arguments: tuple[Argument, ...],
    given: BatchArguments,
    earlier: list[BatchArguments],
) -> None:
    names = [(a.name, label) for a in arguments if a.uniform for label in a.labels]
    for (name, label), value in zip(names, given.uniform.tolist(), strict=True):
        if not np.isfinite(value):
            raise InputError(
                f"{name} of '{label}' is {value}; expected a finite number"
            )
    if earlier and not np.array_equal(earlier[0].uniform, given.uniform):
        raise InputError(
            "uniform arguments, such as symbols, have changed between two pieces"
        )


def _not_finite(arguments: tuple[Argument, ...], block: _Block) -> InputError:
    """The error for a block whose factors are not finite: the first value that is not, or what else may be wrong."""
    found = []
    for argument, column in zip(
        (a for a in arguments if not a.uniform), block.batch.columns, strict=True
    ):
        wrong = np.argwhere(~np.isfinite(column))
        if len(wrong):
            row, k = wrong[0].tolist()
            found.append(
                (row, argument.name, argument.labels[k], float(column[row, k]))
            )
    if found:
        row, name, label, value = min(found)
        sample = block.number + row
        return InputError(
            f"{name} of '{label}' is {value} in sample {sample}; leave out samples that are not complete"
        )
    last = block.number + block.batch.samples - 1
    return InputError(
        f"the regressor is not finite, or too large to be squared, in some sample from {block.number} to {last}, "
        "though all its arguments are finite; check their units"
    )
