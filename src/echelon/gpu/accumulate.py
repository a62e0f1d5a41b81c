"""R-factors of long logs on the device, in constant memory.

Entries of [W y] are generated for a block of samples with all samples of one entry together: for each output that is
its tall matrix without structural zeros, column by column.  Chunks of it are factored in place, each by one block of
threads; their triangles, stacked, are factored again until one is left.  Everything around that (cutting logs into
blocks, merging in order, saying which sample is wrong) is what the processor uses too.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cached_property
from typing import Any

import numpy as np

from echelon.arrays import Floats
from echelon.codegen.numbers import Precision
from echelon.errors import InputError
from echelon.gpu.arguments import arranged, part_on, passed
from echelon.gpu.batches import THREADS
from echelon.gpu.device import Array, Device
from echelon.gpu.text import ENTRIES, TRIANGLES, entries_text, triangles_text
from echelon.machine.batch import Batch
from echelon.observe.accumulate import Observer
from echelon.observe.layout import layout_of
from echelon.observe.stream import Stream
from echelon.program.function import Function

_FEWEST_ROWS = 512  # of a chunk
_LEAST_RATIO = 4  # of a chunk's rows and columns: its triangle is at most a quarter of it
_WARP = 32
_FACTORING = 256  # threads of a block
_MOST_SAMPLES = 65_536
_SCRATCH = 1 << 29


class DeviceQr:
    """R-factors by Householder reflectors on the device; one of :class:`echelon.observe.engine.Engine`.

    Factors of all outputs are an array of shape (columns of all outputs, most columns of one output): row c is column c
    of its output's triangle.

    Parameters
    ----------
    device : Device
    function : Function
        A regressor with measured outputs.
    """

    unit = 1

    def __init__(self, device: Device, function: Function) -> None:
        self.device, self.function = device, function
        self.layout, order = layout_of(function)
        sizes = np.array(self.layout.sizes, dtype=np.int64)
        self._columns, self._widest = int(sizes.sum()), int(sizes.max())
        self._first = np.cumsum(sizes) - sizes
        self._where = (device.sent(sizes), device.sent(self._first))
        self._chunk = -(-max(_FEWEST_ROWS, _LEAST_RATIO * self._widest) // _WARP) * _WARP
        self._entries = device.kernel(entries_text(function, Precision.DOUBLE, order.tolist()), ENTRIES)
        self._factor = device.kernel(triangles_text(), TRIANGLES)

    @property
    def block(self) -> int:
        """Samples that make good use of a device without taking much of its memory."""
        most = min(_MOST_SAMPLES, _SCRATCH // (8 * self._columns))
        return max(most // self._chunk, 1) * self._chunk

    def start(self) -> Array:
        """The factors of no samples."""
        return self.device.zeros((self._columns, self._widest), np.float64)

    def observe(self, batch: Batch, first: int, count: int) -> Array:
        """The factors of some samples of a batch, at least one."""
        entries = self.device.empty((self._columns, count), np.float64)
        arguments = passed(self.device, self.function.arguments, batch, first, first + count, np.float64)
        self._entries((-(-count // THREADS),), (THREADS,), (np.int64(count), *arguments, entries))
        return self._triangles(entries)

    def merge(self, total: Array, part: Array) -> None:
        """Merge factors into others, in place."""
        total[...] = self._triangles(self.device.cupy.concatenate((total, part), axis=1))

    def factors(self, total: Array) -> tuple[Floats, ...]:
        """Each output's R, in NumPy's memory."""
        whole = self.device.fetched(total)
        places = zip(self._first.tolist(), self.layout.sizes, strict=True)
        return tuple(np.ascontiguousarray(whole[first : first + n, :n].T) for first, n in places)

    def _triangles(self, matrices: Array) -> Array:
        """The factors of all outputs' matrices, which are overwritten; an array of shape (columns, rows)."""
        count = matrices.shape[1]
        rows, level = [count] * len(self.layout.sizes), 0
        while True:
            chunks = [-(-length // self._chunk) for length in rows]
            rows = [number * size for number, size in zip(chunks, self.layout.sizes, strict=True)]
            target = self.device.zeros((self._columns, max(rows)), np.float64)
            numbers = (np.int64(level), np.int64(count), np.int64(self._chunk), *self._where)
            source = (np.int64(matrices.shape[1]), matrices, np.int64(target.shape[1]), target)
            self._factor((max(chunks), len(rows)), (_FACTORING,), (*numbers, *source))
            if max(chunks) == 1:
                return target
            matrices, level = target, level + 1


class DeviceObserver(Observer):
    """A regressor ready to take samples in on the device, from arrays of NumPy or there; for R-factors only.

    Blocks of :attr:`DeviceQr.block` samples make better use of a device than the processor's.

    Parameters
    ----------
    function : Function
        A regressor, of shape (outputs, parameters).
    device : Device
    """

    def __init__(self, function: Function, device: Device) -> None:
        super().__init__(function)
        self._device = device

    @cached_property
    def engine(self) -> DeviceQr:
        """What turns samples into factors."""
        return DeviceQr(self._device, self.function)

    def _filled(
        self,
        kind: str,
        data: Mapping[str, Any] | Iterable[Mapping[str, Any]],
        block: int,
        threads: int | None,  # noqa: ARG002 - of the processor
    ) -> Stream:
        if kind != "qr":
            raise InputError("normal equations are not made on the GPU: take R-factors, or base.normal_equations")
        stream = Stream(self.engine, block, threads=1)
        for piece in [data] if isinstance(data, Mapping) else data:
            whole = arranged(self._device, self.function.arguments, piece)
            for first in range(0, whole.samples, block):
                stream.take(part_on(self._device, whole, first, first + block))
        return stream
