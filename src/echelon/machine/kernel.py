"""A function as machine code over batches of samples.

>>> from echelon.program.tape import Program
>>> from echelon.program.function import Argument, Function
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
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.machine.batch import Batch, aligned, batch, result_array
from echelon.machine.cache import cached_object
from echelon.machine.compiler import Library, object_code
from echelon.machine.kernel_text import kernel_text
from echelon.machine.layout import Rows, rows_of
from echelon.machine.lowering import lowered
from echelon.machine.prepare_text import prepare_text
from echelon.machine.rows_text import rows_text
from echelon.machine.target import Target, host
from echelon.machine.text import Vector, module_text
from echelon.program.function import Function

_POINTER, _INTEGER = ctypes.c_void_p, ctypes.c_int64
_RUN = (_POINTER, _POINTER, _POINTER, _INTEGER, _INTEGER, _POINTER, _POINTER)
_CACHED_BYTES = 1 << 22  # results beyond this size leave the caches before anyone reads them
_PAGE = 4096  # bytes
_FEWEST = 512  # samples worth a thread of their own
_SHARES = 4  # pieces per thread, so that a thread that is held up does not hold up all


class Kernel:
    """Machine code of a function.

    Compiled when it is first called, or taken from the cache on disk.

    Parameters
    ----------
    function : Function
    sparse : bool
        Results hold the function's entries in their order, and no structural zeros.
    target : Target, optional
        The processor at hand if omitted.
    """

    def __init__(self, function: Function, *, sparse: bool = False, target: Target | None = None) -> None:
        self.function, self.sparse = function, sparse
        self._asked = target
        self._codes: dict[bool, _Code] = {}

    @property
    def target(self) -> Target:
        """The processor that code is made for."""
        return self._asked or host()

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the result for one sample."""
        return (len(self.function.entries),) if self.sparse else self.function.shape

    def __call__(
        self, values: Mapping[str, npt.ArrayLike], out: Floats | None = None, threads: int | None = None
    ) -> Floats:
        """Evaluate the function.

        Parameters
        ----------
        values : mapping of str to array
            The arguments by name, of shape (samples, size), or (size,) for uniform ones.
        out : array of shape (samples, *shape), optional
            Where to write; C-contiguous float64.  Reusing an array is several times faster than a new one for results
            beyond the caches, because the system clears new memory page by page.
        threads : int, optional
            At most so many; as many as there are processors if omitted.  Results do not depend on it.

        Returns
        -------
        array of shape (samples, *shape)

        Raises
        ------
        InputError
            If arrays do not fit.
        """
        given = batch(self.function.arguments, values)
        result = result_array((given.samples, *self.shape), out, given.columns)
        code = self._code(big=result.nbytes > _CACHED_BYTES)
        run, workers = code.runner(given, result), _threads(threads, given.samples)
        if workers == 1:
            run((0, given.samples))
            return result
        with ThreadPoolExecutor(workers) as pool:
            list(pool.map(run, _pieces(given.samples, workers, self.target.lanes)))
        return result

    def _code(self, *, big: bool) -> _Code:
        """Code for results beyond the caches, or within."""
        if big not in self._codes:
            rows = rows_of(lowered(self.function), Vector(self.target.lanes), self._places(), big=big)
            self._codes[big] = _Code(rows, self.target)
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
        return f"Kernel({self.function}, {self.target.cpu}, {self.target.lanes} lanes)"


class _Code:
    """Compiled rows."""

    def __init__(self, rows: Rows, target: Target) -> None:
        self._rows = rows
        text = module_text(prepare_text(rows.block.lowered), kernel_text(rows.block), rows_text(rows))
        library = loaded(text, target)
        self._run = library.function("run", _RUN)
        self._prepare = library.function("prepare", (_POINTER, _POINTER))
        self._scratch: list[Floats] = []  # of threads that have done their work; its zeros are still zero

    def runner(self, given: Batch, result: Floats) -> Callable[[tuple[int, int]], None]:
        """What computes a piece of a batch, from its first sample to its end."""
        prepared = aligned((max(len(self._rows.block.lowered.uniform), 1),))
        self._prepare(given.uniform.ctypes.data, prepared.ctypes.data)
        arrays = (given.addresses, given.strides, prepared)

        def run(piece: tuple[int, int]) -> None:
            scratch = self._scratch_memory()
            pointers = (array.ctypes.data for array in arrays)
            self._run(*pointers, *piece, scratch.ctypes.data, result.ctypes.data)
            self._scratch.append(scratch)

        return run

    def _scratch_memory(self) -> Floats:
        """Memory that no other thread works in."""
        try:
            return self._scratch.pop()
        except IndexError:
            # by pages, because some relative places of the parts cost a tenth, and chance should not choose them
            return aligned((self._rows.doubles,), zero=True, boundary=_PAGE)


def loaded(text: str, target: Target, level: int = 1) -> Library:
    """A module's machine code in this process, through the cache on disk.

    Parameters
    ----------
    text : str
        LLVM's textual representation.
    target : Target
    level : int
        The code generator's effort.
    """
    code = cached_object(f"{target.identity} {level}", text, lambda: object_code(text, target, level))
    return Library(code, target)


def _threads(wanted: int | None, samples: int) -> int:
    """How many threads are worth starting.

    Raises
    ------
    InputError
        If fewer than one is wanted.
    """
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
