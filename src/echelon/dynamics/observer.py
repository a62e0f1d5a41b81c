"""A robot's regressor, ready to take logs in without building the observation matrix."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from echelon.dynamics.values import Values, along_loops, function_values
from echelon.errors import InputError
from echelon.machine.batch import real_array
from echelon.mechanism.mechanism import Mechanism
from echelon.observe.accumulate import Observer
from echelon.observe.layout import Layout
from echelon.observe.normal import NormalEquations
from echelon.observe.observation import Observation
from echelon.observe.stream import BLOCK
from echelon.program.function import Function

Log = Mapping[str, Any]
"""``q``, ``qd``, ``qdd`` and ``y``, and ``inputs`` where effects use measured inputs."""


class RobotObserver:
    """Accumulates samples of a robot.

    Parameters
    ----------
    mechanism : Mechanism
    function : Function
        Its regressor.
    observer : Observer, optional
        What takes samples of the regressor in; machine code if omitted.
    """

    def __init__(self, mechanism: Mechanism, function: Function, observer: Observer | None = None) -> None:
        self.mechanism, self.function = mechanism, function
        self._observer = observer or Observer(function)

    def observation(
        self, log: Log | Iterable[Log], symbols: Mapping[str, float] | None, block: int | None, threads: int | None
    ) -> Observation:
        """R-factors of [W y].

        Parameters
        ----------
        log : mapping, or iterable of mappings
            Arrays of shape (N, …) by name; pieces follow one another.
        symbols : mapping of str to float, optional
        block : int, optional
            Samples in a block.
        threads : int, optional

        Raises
        ------
        InputError
            If arrays do not fit, or values are missing or not finite.
        """
        block = BLOCK if block is None else block
        if not self.mechanism.closures:
            return self._observer(self._values(log, symbols), block=block, threads=threads)
        parts = [self._observer(p, block=block, threads=threads) for p in self._by_output(log, symbols)]
        counts = tuple(p.samples for p in parts)
        return Observation(self._layout(parts[0].layout), tuple(p.factors[0] for p in parts), counts)

    def normal_equations(
        self, log: Log | Iterable[Log], symbols: Mapping[str, float] | None, block: int | None, threads: int | None
    ) -> NormalEquations:
        """Gram matrices of [W y]; arguments as for :meth:`observation`."""
        block = BLOCK if block is None else block
        if not self.mechanism.closures:
            return self._observer.normal_equations(self._values(log, symbols), block=block, threads=threads)
        data = self._by_output(log, symbols)
        parts = [self._observer.normal_equations(p, block=block, threads=threads) for p in data]
        return NormalEquations(self._layout(parts[0].layout), tuple(p.grams[0] for p in parts), parts[0].samples)

    def _values(self, log: Log | Iterable[Log], symbols: Mapping[str, float] | None) -> Iterator[Values]:
        for piece in [log] if isinstance(log, Mapping) else log:
            state = {name: value for name, value in piece.items() if name != "inputs"}
            yield function_values(self.mechanism, self.function, state, symbols, piece.get("inputs"))

    def _by_output(self, log: Log | Iterable[Log], symbols: Mapping[str, float] | None) -> list[list[Values]]:
        """With loops: for each output the pieces of the log, with its virtual velocities and its measured values."""
        count = len(self.mechanism.outputs)
        found: list[list[Values]] = [[] for _ in range(count)]
        for values in self._values(log, symbols):
            if "y" not in values:
                raise InputError("y is missing; it holds the measured outputs")
            y = np.atleast_2d(real_array("y", values["y"]))
            if y.ndim != 2 or y.shape[1] != count:
                names = ", ".join(output.name for output in self.mechanism.outputs)
                raise InputError(f"y has shape {y.shape}; expected (samples, {count}): {names}")
            closed, speeds = along_loops(self.mechanism, values, symbols)
            for row, chosen in enumerate(speeds):
                found[row].append({**closed, **chosen, "y": y[:, row : row + 1]})
        return found

    def _layout(self, single: Layout) -> Layout:
        outputs = tuple(output.name for output in self.mechanism.outputs)
        return Layout(outputs, single.parameters, single.columns * len(outputs))
