"""Functions over batches of states.

One thread computes one sample.  Its entries go to memory with the samples of one entry together, because neighbouring
threads then write neighbouring numbers; a second kernel turns them into rows, with structural zeros.  What lies between
the two is a block of fixed size.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np

from echelon.codegen.numbers import Precision
from echelon.dynamics.closed_states import ClosedStates
from echelon.dynamics.values import Values, function_values
from echelon.gpu.arguments import arranged, passed
from echelon.gpu.device import Array, Device
from echelon.gpu.text import ENTRIES, ROWS, entries_text, rows_text
from echelon.machine.batch import Batch
from echelon.mechanism.mechanism import Mechanism
from echelon.program.function import Function

THREADS = 128
"""Threads of a block that compute entries: few, because each needs many registers."""

_SCRATCH = 1 << 28
_FEWEST = 1024
_TILE = 32


class DeviceFunction:
    """One function on the device.

    Parameters
    ----------
    device : Device
    function : Function
    precision : Precision
    """

    def __init__(self, device: Device, function: Function, precision: Precision) -> None:
        self.device, self.function, self.precision = device, function, precision
        self.dtype = np.dtype(np.float64 if precision is Precision.DOUBLE else np.float32)
        entry_size = self.dtype.itemsize * max(len(function.entries), 1)
        self.block = max(_FEWEST, _SCRATCH // entry_size // _TILE * _TILE)

    @cached_property
    def _entries(self) -> Any:
        return self.device.kernel(entries_text(self.function, self.precision), ENTRIES)

    @cached_property
    def _rows(self) -> Any:
        return self.device.kernel(rows_text(self.precision), ROWS)

    @cached_property
    def _entry_at(self) -> Array:
        """For every place of a row its entry, or −1."""
        places = np.full(self.function.shape, -1, dtype=np.int64)
        for entry, index in enumerate(self.function.entries):
            places[index] = entry
        return self.device.sent(places.ravel())

    def entries(self, values: Mapping[str, Any]) -> Array:
        """The entries that are not structurally zero.

        Parameters
        ----------
        values : mapping of str to array
            The function's arguments by name.

        Returns
        -------
        CuPy array of shape (entries, N)
        """
        given = arranged(self.device, self.function.arguments, values)
        return self._computed(given, 0, given.samples)

    def __call__(self, values: Mapping[str, Any], out: Array | None = None) -> Array:
        """The function's results.

        Parameters
        ----------
        values : mapping of str to array
            The function's arguments by name, of shape (N, size), or (size,) for uniform ones.
        out : CuPy array of shape (N, *shape), optional

        Returns
        -------
        CuPy array of shape (N, *shape)
        """
        given = arranged(self.device, self.function.arguments, values)
        shape = (given.samples, *self.function.shape)
        result = self.device.result(shape, self.dtype, out, given.columns)
        for first in range(0, given.samples if result.size else 0, self.block):
            end = min(first + self.block, given.samples)
            self._write_rows(self._computed(given, first, end), result[first:end])
        return result

    def _computed(self, given: Batch, first: int, end: int) -> Array:
        """The entries of some samples, shape (entries, samples)."""
        result = self.device.empty((len(self.function.entries), end - first), self.dtype)
        if result.size:
            arguments = passed(self.device, self.function.arguments, given, first, end, self.dtype)
            blocks = -(-(end - first) // THREADS)
            self._entries((blocks,), (THREADS,), (np.int64(end - first), *arguments, result))
        return result

    def _write_rows(self, entries: Array, rows: Array) -> None:
        count, width = len(rows), self._entry_at.size
        grid = (-(-count // _TILE), -(-width // _TILE))
        self._rows(grid, (_TILE, _TILE // 4), (np.int64(count), np.int64(width), self._entry_at, entries, rows))


class DeviceEvaluator:
    """One function of a mechanism on the device, called with states, parameters and values of symbols.

    Parameters
    ----------
    device : Device
    mechanism : Mechanism
    function : Function
        As :func:`echelon.dynamics.functions.robot_function` records it.
    precision : Precision
    loops : ClosedStates, optional
        What completes the states of a mechanism with loops.
    """

    def __init__(
        self,
        device: Device,
        mechanism: Mechanism,
        function: Function,
        precision: Precision,
        loops: ClosedStates | None = None,
    ) -> None:
        self.device, self.mechanism, self._loops = device, mechanism, loops
        self.made = DeviceFunction(device, function, precision)

    def values(
        self, state: Mapping[str, Any], symbols: Mapping[str, float] | None, inputs: Mapping[str, Any] | None
    ) -> Values:
        """Values of the function's arguments; see :func:`echelon.dynamics.values.function_values`."""
        fetched = {name: self.device.fetched(array) for name, array in (inputs or {}).items()}
        if self._loops is not None:  # states are completed in double precision, on the processor
            state = {name: self.device.fetched(array) for name, array in state.items()}
        return function_values(self.mechanism, self.made.function, state, symbols, fetched, self._loops)

    def __call__(
        self,
        state: Mapping[str, Any],
        symbols: Mapping[str, float] | None = None,
        inputs: Mapping[str, Any] | None = None,
        out: Array | None = None,
    ) -> Array:
        """Evaluate at states.

        Parameters
        ----------
        state : mapping of str to array
            ``q``, ``qd``, ``qdd`` of shape (N, size) or (size,), and ``parameters`` of shape (size,), as far as the
            function has them; of NumPy or on the device.
        symbols : mapping of str to float, optional
        inputs : mapping of str to array of shape (N,), optional
        out : CuPy array of shape (N, …), optional

        Returns
        -------
        CuPy array of shape (N, …)
        """
        return self.made(self.values(state, symbols, inputs), out)
