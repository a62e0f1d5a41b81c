"""Closure equations in machine code, with derivatives: what a solver asks for at every step.

The closure equations c(q) of a motion vanish, and so do their derivatives by time, J q̇ and J q̈ + b.  A function s of
the whole state then changes with the independent coordinates through multipliers λ of these equations, one set for each
(the implicit function theorem).  What that takes beside J and b are the derivatives of Σ A_ij J_ij and λᵀ b by the
state, for constant A and λ: reverse mode through the recorded equations.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from echelon.excite.pullback import pullback
from echelon.machine.kernel import Kernel
from echelon.mechanism.mechanism import Mechanism
from echelon.mechanism.values import symbol_values
from echelon.regressor.loops.closure_values import ClosureValues

Floats = npt.NDArray[np.float64]
Index = tuple[int, ...]


class ClosureKernels(ClosureValues):
    """The same values as of :class:`ClosureValues`, sooner, and derivatives of them.

    Parameters
    ----------
    mechanism : Mechanism
        With loops.
    symbols : mapping of str to float, optional
        Values that replace or complete those of the mechanism.
    """

    def __init__(self, mechanism: Mechanism, symbols: Mapping[str, float] | None = None) -> None:
        super().__init__(mechanism, symbols)
        recorded = _Recorded(mechanism, self.freedoms)
        self.rows = np.where(self.is_length, self.length, 1.0)
        """Unit of each equation."""
        self._places = tuple(np.array(list(recorded.jacobian), dtype=np.intp).reshape(-1, 2).T)
        self._scales = self.units[self._places[1]] / self.rows[self._places[0]]
        made = recorded.equations(), recorded.of_jacobian(), recorded.of_bias()
        self._kernels = tuple(Kernel(function, sparse=True) for function in made)
        self._pullbacks = tuple(Kernel(pullback(function)) for function in made[1:])
        self._biased = [row for (row,) in made[2].entries]
        self._symbols = [
            {
                a.name: np.array(list(symbol_values(mechanism, a.labels, symbols).values()))
                for a in f.arguments
                if a.uniform
            }
            for f in made
        ]

    def at(self, q: Floats) -> tuple[Floats, Floats]:
        """Values of the equations, shape (N, equations), and their Jacobian by freedoms, (N, equations, freedoms)."""
        return self._values(q), self.jacobian(q)

    def _values(self, q: Floats) -> Floats:
        found: Floats = Kernel.__call__(self._kernels[0], {"q": q, **self._symbols[0]})
        return found / self.rows

    def jacobian(self, q: Floats) -> Floats:
        """The Jacobian alone."""
        found = np.zeros((len(q), len(self.rows), len(self.freedoms)))
        found[:, *self._places] = self._kernels[1]({"q": q, **self._symbols[1]}) * self._scales
        return found
