"""A robot's regressor, ready to take logs in without building the observation matrix."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from echelon.dynamics.closed_states import ClosedStates
from echelon.dynamics.values import Values, function_values
from echelon.mechanism.mechanism import Mechanism
from echelon.observe.accumulate import Observer
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
    loops : ClosedStates, optional
        What completes the states of a mechanism with loops.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        function: Function,
        observer: Observer | None = None,
        loops: ClosedStates | None = None,
    ) -> None:
        self.mechanism, self.function, self._loops = mechanism, function, loops
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
        return self._observer(self._values(log, symbols), block=block, threads=threads)

    def normal_equations(
        self, log: Log | Iterable[Log], symbols: Mapping[str, float] | None, block: int | None, threads: int | None
    ) -> NormalEquations:
        """Gram matrices of [W y]; arguments as for :meth:`observation`."""
        block = BLOCK if block is None else block
        return self._observer.normal_equations(self._values(log, symbols), block=block, threads=threads)

    def _values(self, log: Log | Iterable[Log], symbols: Mapping[str, float] | None) -> Iterator[Values]:
        for piece in [log] if isinstance(log, Mapping) else log:
            state = {name: value for name, value in piece.items() if name != "inputs"}
            yield function_values(self.mechanism, self.function, state, symbols, piece.get("inputs"), self._loops)
