"""A function as machine code over batches of samples; where LLVM is not installed, NumPy evaluates it more slowly.

>>> from echelon.algebra.program.tape import Program
>>> from echelon.algebra.program.function import Argument, Function
>>> program = Program()
>>> x = program.input("x")
>>> argument = Argument("x", (x.node,), ("x",), ("rad",))
>>> wave = Kernel(Function("wave", program, (argument,), {(0,): (x.sin() * x).node}, (("y",),)))
>>> wave({"x": [[0.0], [2.0]]}).round(3)
array([[0.   ],
       [1.819]])
"""

from __future__ import annotations

import ctypes
import os
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from math import prod
from typing import Any

import numpy as np
import numpy.typing as npt

from echelon.algebra import Argument, FloatArithmetic, Function, Schedule
from echelon.compute.machine.kernel_text import (
    DOUBLE,
    LINE,
    KernelBlock,
    kernel_text,
    prepare_text,
)
from echelon.compute.machine.operations_text import (
    Lowered,
    Vector,
    lowered,
    module_text,
)
from echelon.compute.machine.rows_text import rows_of, rows_text
from echelon.compute.machine.target import (
    Library,
    Target,
    cached_object,
    compiles,
    host,
    object_code,
)
from echelon.shared import Floats, InputError, SlowWarning


@dataclass(frozen=True)
class BatchArguments:
    """Arguments of many samples."""

    samples: int
    columns: tuple[
        Floats, ...
    ]  # arguments that vary, of shape (samples, size), each row contiguous
    uniform: Floats  # the others, one after another

    def part(self, first: int, end: int) -> BatchArguments:
        """Some of the samples, in place."""
        return BatchArguments(
            end - first,
            tuple(column[first:end] for column in self.columns),
            self.uniform,
        )

    def copy(self) -> BatchArguments:
        """A copy of the samples, which no other code can change."""
        return BatchArguments(
            self.samples, tuple(column.copy() for column in self.columns), self.uniform
        )

    @staticmethod
    def joined(pieces: Sequence[BatchArguments]) -> BatchArguments:
        """The samples of several batches of the same function; those of one stay where they are."""
        if len(pieces) == 1:
            return pieces[0]
        columns = zip(*(piece.columns for piece in pieces), strict=True)
        joined = tuple(np.concatenate(some) for some in columns)
        return BatchArguments(
            sum(piece.samples for piece in pieces), joined, pieces[0].uniform
        )


def batch(
    arguments: Sequence[Argument], values: Mapping[str, npt.ArrayLike]
) -> BatchArguments:
    """Check and arrange values of arguments: of shape (samples, size), or (size,) for one sample and uniform ones."""
    columns, uniform = [], [np.zeros(0)]
    for argument in arguments:
        array = real_array(argument.name, value_of(argument, values))
        _check_shape(argument, array.shape)
        if argument.uniform:
            uniform.append(array)
            continue
        array = np.atleast_2d(array)
        whole = array.strides[1] == DOUBLE or len(argument) < 2
        columns.append(
            array if whole and array.flags.aligned else np.ascontiguousarray(array)
        )
    return BatchArguments(
        _sample_count(arguments, [len(c) for c in columns]),
        tuple(columns),
        np.concatenate(uniform),
    )


def value_of(argument: Argument, values: Mapping[str, Any]) -> Any:
    """The value of an argument."""
    if argument.name not in values:
        raise InputError(f"{argument.name} is missing; it holds {_contents(argument)}")
    return values[argument.name]


def _check_shape(argument: Argument, shape: tuple[int, ...]) -> None:
    """Check that an array fits an argument: (size,) for uniform ones and single samples, else (samples, size)."""
    size = len(argument)
    if shape != (size,) and (argument.uniform or len(shape) != 2 or shape[1] != size):
        expected = f"({size},)" if argument.uniform else f"(samples, {size})"
        raise InputError(
            f"{argument.name} has shape {shape}; expected {expected}: {_contents(argument)}"
        )


def _sample_count(arguments: Sequence[Argument], lengths: Sequence[int]) -> int:
    """The number of samples, given that of each argument that varies; 1 if none does."""
    counts = dict(
        zip((a.name for a in arguments if not a.uniform), lengths, strict=True)
    )
    if len(set(lengths)) > 1:
        shown = ", ".join(f"{name} {count}" for name, count in counts.items())
        raise InputError(f"arguments have different numbers of samples: {shown}")
    return lengths[0] if lengths else 1


def real_array(name: str, values: npt.ArrayLike) -> Floats:
    """An array in double precision; one that already is stays where it is."""
    if np.ma.is_masked(values):
        raise InputError(
            f"{name} has masked values; leave out samples that are not complete"
        )
    try:
        array = np.asarray(values)
    except ValueError as error:
        raise InputError(f"{name} is not an array of numbers: {error}") from None
    if array.dtype.kind not in "fiu":
        raise InputError(f"{name} holds {array.dtype} values; expected real numbers")
    return array.astype(np.float64, copy=False)


def result_array(
    shape: tuple[int, ...], out: Floats | None, inputs: Sequence[Floats]
) -> Floats:
    """The array to write a result to: a new one, or the caller's after a check."""
    if out is None:
        return aligned(shape)
    if not isinstance(out, np.ndarray):
        raise InputError(f"out is a {type(out).__name__}; expected a NumPy array")
    if out.dtype != np.float64 or not out.dtype.isnative:
        raise InputError(f"out holds {out.dtype} values; expected float64")
    if out.shape != shape:
        raise InputError(f"out has shape {out.shape}; expected {shape}")
    if not out.flags.writeable:
        raise InputError("out is read-only")
    if not (out.flags.c_contiguous and out.flags.aligned):
        raise InputError(
            "out is not contiguous in C order; rows are written one after another"
        )
    if any(np.may_share_memory(out, array) for array in inputs):
        raise InputError("out overlaps an input, which would change while it is read")
    return out


def aligned(
    shape: tuple[int, ...], *, zero: bool = False, boundary: int = LINE * DOUBLE
) -> Floats:
    """A new array that starts on a cache line, or on another multiple of bytes."""
    count = prod(shape)
    raw = (np.zeros if zero else np.empty)(count * DOUBLE + boundary, dtype=np.uint8)
    start = -raw.ctypes.data % boundary
    return raw[start : start + count * DOUBLE].view(np.float64).reshape(shape)


def _contents(argument: Argument) -> str:
    shown = ", ".join(argument.labels[:12])
    return shown + (", …" if len(argument) > 12 else "") if shown else "nothing"


# -- without LLVM ------------------------------------------------------------------------------------------------------

_TOGETHER = 1 << 17
"""Values of nodes that are computed together, which stay in the cache."""
_LARGE = 10**9
"""Operations that take several seconds."""
_SLOW = 'NumPy computes this; machine code takes a tenth of the time or less: pip install "echelon-robotics[fast]"'


class Interpreted:
    """A function's entries, for some samples at a time."""

    def __init__(self, function: Function) -> None:
        self.function = function

    def __call__(
        self, given: BatchArguments, together: int | None = None
    ) -> Iterator[tuple[int, Floats]]:
        """The first sample of each piece of a batch, with the entries there, of shape (entries, samples)."""
        schedule = self._schedule
        if schedule.size * given.samples > _LARGE:
            warnings.warn(_SLOW, SlowWarning, stacklevel=3)
        together = together or max(_TOGETHER // max(schedule.size, 1), 1)
        for first in range(0, given.samples, together):
            piece = given.part(first, min(first + together, given.samples))
            with np.errstate(all="ignore"):
                yield (
                    first,
                    schedule.run(FloatArithmetic(), self._values(piece), piece.samples),
                )

    @cached_property
    def _schedule(self) -> Schedule:
        return Schedule(self.function.program, self.function.outputs)

    def _values(self, piece: BatchArguments) -> dict[int, Floats]:
        """Values of the inputs by node."""
        uniform = [
            node for a in self.function.arguments if a.uniform for node in a.nodes
        ]
        varying = [
            node for a in self.function.arguments if not a.uniform for node in a.nodes
        ]
        columns = [column for array in piece.columns for column in array.T]
        return dict(zip(uniform, piece.uniform, strict=True)) | dict(
            zip(varying, columns, strict=True)
        )


# -- machine code ------------------------------------------------------------------------------------------------------

_POINTER, _INTEGER = ctypes.c_void_p, ctypes.c_int64
_COMPUTE = (_POINTER, _POINTER, _POINTER, _INTEGER, _INTEGER, _POINTER)
_RUN = (*_COMPUTE, _POINTER)
_CACHED_BYTES = 1 << 22
"""Size of results beyond which they leave the caches before anyone reads them."""
_PAGE = 4096
"""Bytes of a page of memory."""
_FEWEST = 512
"""Samples that are worth a thread of their own."""
_SHARES = 4
"""Pieces per thread, so that a thread that is held up does not hold up all."""


class Kernel:
    """Machine code of a function: compiled when it is first called, or taken from the cache on disk.

    Results of a sparse kernel hold the function's entries in their order, and no structural zeros.
    """

    def __init__(
        self, function: Function, *, sparse: bool = False, target: Target | None = None
    ) -> None:
        self.function, self.sparse = function, sparse
        self._asked = target
        self._codes: dict[bool, _Code] = {}
        self._interpreted = Interpreted(function)

    @property
    def target(self) -> Target:
        """The processor that code is made for."""
        return self._asked or host()

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the result for one sample."""
        return (len(self.function.entries),) if self.sparse else self.function.shape

    def __call__(
        self,
        values: Mapping[str, npt.ArrayLike],
        out: Floats | None = None,
        threads: int | None = None,
    ) -> Floats:
        r"""Evaluate the function; returns an array of shape (samples, \*shape).

        Arguments are of shape (samples, size), or (size,) for uniform ones.  ``out`` is where to write; to reuse an
        array is several times faster than a new one for results beyond the caches, because the system clears new memory
        page by page.  Results do not depend on the number of threads, by default that of the processors.
        """
        given = batch(self.function.arguments, values)
        result = result_array((given.samples, *self.shape), out, given.columns)
        if not compiles():
            self._interpret(given, result)
            return result
        run, workers = self._runner(given, result), _threads(threads, given.samples)
        if workers == 1:
            run((0, given.samples))
            return result
        with ThreadPoolExecutor(workers) as pool:
            list(pool.map(run, _pieces(given.samples, workers, self.target.lanes)))
        return result

    def _interpret(self, given: BatchArguments, result: Floats) -> None:
        """Evaluate a batch without machine code."""
        places = np.array(self._places(), dtype=np.intp)
        flat = result.reshape(given.samples, len(places))
        flat[:, places < 0] = 0.0
        for first, entries in self._interpreted(given):
            flat[first : first + entries.shape[1], places >= 0] = entries[
                places[places >= 0]
            ].T

    def _runner(
        self, given: BatchArguments, result: Floats
    ) -> Callable[[tuple[int, int]], None]:
        """Function that computes a piece of a batch, from its first sample to its end."""
        code = self._code(big=result.nbytes > _CACHED_BYTES)
        arrays = code.inputs(given)

        def run(piece: tuple[int, int]) -> None:
            with code.scratch() as scratch:
                pointers = (array.ctypes.data for array in arrays)
                code.run(*pointers, *piece, scratch.ctypes.data, result.ctypes.data)

        return run

    def _code(self, *, big: bool) -> _Code:
        """Code for results beyond the caches, or within."""
        if big not in self._codes:
            rows = rows_of(
                lowered(self.function),
                Vector(self.target.lanes),
                self._places(),
                big=big,
            )
            text = module_text(kernel_text(rows.block), rows_text(rows))
            self._codes[big] = _Code(
                rows.block.lowered, text, ("run", _RUN), rows.doubles, self.target
            )
        return self._codes[big]

    def _places(self) -> tuple[int, ...]:
        if self.sparse:
            return tuple(range(len(self.function.entries)))
        flat = np.full(int(np.prod(self.function.shape)), -1)
        for entry, index in enumerate(self.function.entries):
            flat[np.ravel_multi_index(index, self.function.shape)] = entry
        return tuple(flat.tolist())

    def __getstate__(self) -> dict[str, object]:
        """Copies compile their own code: it belongs to one process, and perhaps to one processor."""
        return {**vars(self), "_codes": {}}

    def __repr__(self) -> str:
        made_for = (
            f"{self.target.cpu}, {self.target.lanes} lanes" if compiles() else "NumPy"
        )
        return f"Kernel({self.function}, {made_for})"


class Columns:
    """A function's entries for a block of samples at a time, each entry's values one after another."""

    def __init__(
        self, function: Function, samples: int, target: Target | None = None
    ) -> None:
        self.function, self.samples, self._asked = function, samples, target
        self._made: _Code | None = None
        self._interpreted = Interpreted(function)

    def __call__(self, given: BatchArguments) -> Iterator[Floats]:
        """Arrays of shape (entries, samples); each is valid until the next one is asked for."""
        if not compiles():
            yield from (
                entries for _, entries in self._interpreted(given, self.samples)
            )
            return
        code, entries = self._code(), len(self.function.entries)
        arrays = code.inputs(given)
        with code.scratch() as scratch:
            table = scratch[: entries * self.samples].reshape(entries, self.samples)
            for first in range(0, given.samples, self.samples):
                count = min(self.samples, given.samples - first)
                code.run(
                    *(array.ctypes.data for array in arrays),
                    first,
                    count,
                    scratch.ctypes.data,
                )
                yield table[:, :count]

    def _code(self) -> _Code:
        if self._made is None:
            target = self._asked or host()
            block = KernelBlock(
                lowered(self.function), Vector(target.lanes), self.samples
            )
            self._made = _Code(
                block.lowered,
                kernel_text(block),
                ("compute", _COMPUTE),
                block.doubles,
                target,
            )
        return self._made

    def __getstate__(self) -> dict[str, object]:
        """Copies compile their own code."""
        return {**vars(self), "_made": None}


class _Code:
    """Compiled text in this process, with the memory that it works in."""

    def __init__(
        self,
        function: Lowered,
        text: str,
        entry: tuple[str, tuple[Any, ...]],
        doubles: int,
        target: Target,
    ) -> None:
        library = loaded(module_text(prepare_text(function), text), target)
        self.run = library.function(*entry)
        self._prepare = library.function("prepare", (_POINTER, _POINTER))
        self._uniform, self._doubles = max(len(function.uniform), 1), doubles
        self._scratch: list[
            Floats
        ] = []  # of threads that have done their work; its zeros are still zero

    def inputs(self, given: BatchArguments) -> tuple[npt.NDArray[Any], ...]:
        """Inputs of the code: addresses and strides of arguments, and values that all samples share."""
        prepared = aligned((self._uniform,))
        self._prepare(given.uniform.ctypes.data, prepared.ctypes.data)
        addresses = np.array(
            [column.ctypes.data for column in given.columns], dtype=np.uint64
        )
        return (
            addresses,
            np.array([column.strides[0] for column in given.columns], dtype=np.int64),
            prepared,
        )

    @contextmanager
    def scratch(self) -> Iterator[Floats]:
        """Memory that no other thread works in."""
        try:
            memory = self._scratch.pop()
        except IndexError:
            # by pages, because some relative places of the parts cost a tenth, and chance should not choose them
            memory = aligned((self._doubles,), zero=True, boundary=_PAGE)
        yield memory
        self._scratch.append(memory)


def loaded(text: str, target: Target) -> Library:
    """A module's machine code in this process, through the cache on disk."""
    return Library(
        cached_object(target.identity, text, lambda: object_code(text, target)), target
    )


def _threads(wanted: int | None, samples: int) -> int:
    """How many threads are worth starting."""
    if wanted is not None and wanted < 1:
        raise InputError(f"threads is {wanted}; expected at least 1")
    return max(1, min(wanted or processors(), samples // _FEWEST))


def processors() -> int:
    """Processors that this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:
        return os.cpu_count() or 1


def _pieces(samples: int, threads: int, lanes: int) -> Iterator[tuple[int, int]]:
    """First and end of pieces of a batch, each a whole number of vectors but the last."""
    size = -(-samples // (threads * _SHARES * lanes)) * lanes
    for first in range(0, samples, size):
        yield first, min(first + size, samples)
