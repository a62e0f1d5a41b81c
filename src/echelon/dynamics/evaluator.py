"""A robot's function as machine code, called with states, parameters and values of symbols."""

from __future__ import annotations

from collections.abc import Mapping

import numpy.typing as npt

from echelon.arrays import Floats
from echelon.dynamics.closed_states import ClosedStates
from echelon.dynamics.values import function_values
from echelon.machine.kernel import Kernel
from echelon.mechanism.mechanism import Mechanism
from echelon.program.function import Function


class Evaluator:
    """Machine code of one function of a mechanism.

    Sparse results hold the entries that are not structurally zero.  ``loops`` completes the states of a mechanism with
    loops; without it, states are to be as the function takes them.
    """

    def __init__(
        self, mechanism: Mechanism, function: Function, *, sparse: bool = False, loops: ClosedStates | None = None
    ) -> None:
        self.mechanism, self.function, self._loops = mechanism, function, loops
        self.kernel = Kernel(function, sparse=sparse)

    def __call__(
        self,
        state: Mapping[str, npt.ArrayLike],
        symbols: Mapping[str, float] | None = None,
        inputs: Mapping[str, npt.ArrayLike] | None = None,
        out: Floats | None = None,
        threads: int | None = None,
    ) -> Floats:
        """Evaluate at states of shape (N, size) or (size,); returns an array of shape (N, …).

        With loops, each of ``q``, ``qd`` and ``qdd`` may be that of the independent coordinates only.
        """
        values = function_values(self.mechanism, self.function, state, symbols, inputs, self._loops)
        return self.kernel(values, out, threads)
