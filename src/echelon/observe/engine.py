"""Engines: what turns samples into factors, block by block.

An engine works on one array that holds the factors of all outputs, so that a block's result is one object.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.machine.batch import Batch, aligned
from echelon.machine.kernel import loaded
from echelon.machine.kernel_text import Block, kernel_text
from echelon.machine.lowering import lowered
from echelon.machine.prepare_text import prepare_text
from echelon.machine.target import Target, host
from echelon.machine.text import module_text
from echelon.observe.drive_text import observe_text
from echelon.observe.gram_text import gram_update_text
from echelon.observe.layout import Layout, layout_of
from echelon.observe.qr_text import qr_text
from echelon.observe.tiles import GROUP, Tiling, tiling
from echelon.program.function import Function

Integers = npt.NDArray[np.int64]

_POINTER, _INTEGER = ctypes.c_void_p, ctypes.c_int64
_COMPUTE = (_POINTER, _POINTER, _POINTER, _INTEGER, _INTEGER, _POINTER)
_OBSERVE = (_POINTER, *_COMPUTE, _INTEGER, _INTEGER, *[_POINTER] * 5)
_MERGE = (_POINTER, _POINTER, _INTEGER, *[_POINTER] * 5)


@dataclass(frozen=True)
class _Room:
    """Memory that a kernel works in: a block, and the reflectors of one output with their triangles T."""

    block: Floats
    v: Floats
    t: Floats


class Engine(Protocol):
    """Turns samples into factors and merges factors."""

    layout: Layout
    function: Function

    @property
    def unit(self) -> int:
        """Samples that are worked on together; blocks that are multiples of it waste nothing."""

    def start(self) -> Floats:
        """The factors of no samples."""

    def observe(self, batch: Batch, first: int, count: int) -> Floats:
        """The factors of some samples of a batch, at least one; safe to call from several threads."""

    def merge(self, total: Floats, part: Floats) -> None:
        """Merge factors into others, in place."""

    def factors(self, total: Floats) -> tuple[Floats, ...]:
        """Each output's matrix."""


class _Machine:
    """A generator and a kernel, compiled and fused."""

    def __init__(self, function: Function, text: Callable[[Tiling], str], rows: int, target: Target | None) -> None:
        """Compile.

        Parameters
        ----------
        function : Function
            A regressor with measured outputs.
        text : callable
            Writes ``@update`` and what belongs to it.
        rows : int
            Samples in a block of the kernel.
        target : Target, optional
        """
        self._asked = (rows, target)
        target = target or host()
        cut = tiling(target, rows)
        self.function = function
        self.layout, self._columns = layout_of(function)
        self._tiling = cut
        self._lowered = lowered(function)
        self._block = Block(self._lowered, cut.vector, cut.rows)
        self._generator = loaded(module_text(prepare_text(self._lowered), kernel_text(self._block)), target)
        self._kernel = loaded(module_text(text(cut), observe_text(cut)), target)
        self._prepare = self._generator.function("prepare", (_POINTER, _POINTER))
        self._observe = self._kernel.function("observe", _OBSERVE)
        self._compute = self._generator.address("compute")
        self._sizes: Integers = np.array(self.layout.sizes, dtype=np.int64)
        self._rooms: list[_Room] = []  # kept from call to call: fresh memory costs as much as a hundred samples

    def __reduce__(self) -> tuple[Any, ...]:
        """Copies compile their own code: it belongs to one process, and perhaps to one processor."""
        return type(self), (self.function, *self._asked)

    @property
    def unit(self) -> int:
        """Rows of a block of the kernel."""
        return self._tiling.rows

    def start(self) -> Floats:
        """The factors of no samples."""
        return aligned((int(np.sum(self._sizes**2)),), zero=True)

    def observe(self, batch: Batch, first: int, count: int) -> Floats:
        """The factors of some samples of a batch."""
        total = self.start()
        uniform = aligned((max(len(self._lowered.uniform), 1),))
        self._prepare(batch.uniform.ctypes.data, uniform.ctypes.data)
        addresses, strides = batch.addresses, batch.strides
        with self._room() as room:
            self._observe(
                *(self._compute, addresses.ctypes.data, strides.ctypes.data, uniform.ctypes.data, first, count),
                *(room.block.ctypes.data, self._block.entries, len(self._sizes), self._sizes.ctypes.data),
                *(self._columns.ctypes.data, total.ctypes.data, room.v.ctypes.data, room.t.ctypes.data),
            )
        return total

    @contextmanager
    def _room(self) -> Iterator[_Room]:
        """Memory that no other thread uses at the same time."""
        try:
            room = self._rooms.pop()
        except IndexError:
            groups = -(-int(self._sizes.max(initial=1)) // GROUP)
            columns = groups * GROUP * self._tiling.rows
            block = max(self._block.doubles, columns)
            room = _Room(aligned((block,), zero=True), aligned((columns,)), aligned((groups * GROUP * GROUP,)))
        try:
            yield room
        finally:
            self._rooms.append(room)


class QrEngine(_Machine):
    """R-factors by Householder reflectors, in machine code.

    Parameters
    ----------
    function : Function
        A regressor with measured outputs.
    rows : int
        Samples in a block of the kernel, a multiple of 8.
    target : Target, optional
        The processor at hand if omitted.
    """

    def __init__(self, function: Function, rows: int = 152, target: Target | None = None) -> None:
        super().__init__(function, qr_text, rows, target)
        self._merge = self._kernel.function("merge", _MERGE)
        self._counting: Integers = np.arange(self._sizes.max(initial=1), dtype=np.int64)

    def merge(self, total: Floats, part: Floats) -> None:
        """R of [total; part], in place of total."""
        with self._room() as room:
            self._merge(
                *(total.ctypes.data, part.ctypes.data, len(self._sizes), self._sizes.ctypes.data),
                *(room.block.ctypes.data, self._counting.ctypes.data, room.v.ctypes.data, room.t.ctypes.data),
            )

    def factors(self, total: Floats) -> tuple[Floats, ...]:
        """Each output's R."""
        return self.layout.split(total)


class GramEngine(_Machine):
    """Gram matrices, in machine code.

    Parameters
    ----------
    function : Function
        A regressor with measured outputs.
    rows : int
        Samples in a block of the kernel, a multiple of 8.
    target : Target, optional
        The processor at hand if omitted.
    """

    def __init__(self, function: Function, rows: int = 152, target: Target | None = None) -> None:
        super().__init__(function, gram_update_text, rows, target)
        # the kernel takes columns by fours: the last one is repeated, and what comes of it ignored
        self._sizes = -(-self._sizes // GROUP) * GROUP
        ends = np.cumsum(self.layout.sizes)[:-1]
        parts = zip(np.split(self._columns, ends), self._sizes, strict=True)
        self._columns = np.concatenate([np.pad(part, (0, size - len(part)), mode="edge") for part, size in parts])

    def merge(self, total: Floats, part: Floats) -> None:
        """Sum in place of total."""
        total += part

    def factors(self, total: Floats) -> tuple[Floats, ...]:
        """Each output's Gram matrix, both triangles."""
        found, place = [], 0
        for padded, size in zip(self._sizes.tolist(), self.layout.sizes, strict=True):
            upper = np.triu(total[place : place + padded * padded].reshape(padded, padded)[:size, :size])
            found.append(upper + np.triu(upper, 1).T)
            place += padded * padded
        return tuple(found)
