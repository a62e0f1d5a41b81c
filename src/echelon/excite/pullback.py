"""The regressor and its pullback: what derivatives by its entries are as derivatives by the state.

A criterion is a function of the entries of the regressor at all samples.  Its derivatives G by these entries, which are
cheap, become derivatives by q, q̇ and q̈ through s = Σ G_k X_k with constant G: reverse mode through the same recorded
program, which costs a few times the regressor itself and is exact.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.dynamics.arguments import STATE, geometry_values
from echelon.dynamics.functions import robot_function
from echelon.errors import InputError
from echelon.machine.kernel import Kernel
from echelon.mechanism.mechanism import Mechanism
from echelon.program.derivatives import derivatives
from echelon.program.function import Argument, Function
from echelon.program.rewriting import smooth_function
from echelon.program.tape import Scalar

ADJOINT = "adjoint"


@dataclass(frozen=True)
class Rows:
    """Entries of one output.

    Attributes
    ----------
    entries : slice
        Where they are among all entries.
    columns : array of int
        Base parameters that they belong to.
    """

    entries: slice
    columns: npt.NDArray[np.intp]


class StateRegressor:
    """The entries of a reduced regressor at states, and their pullback, in machine code.

    Parameters
    ----------
    mechanism : Mechanism
        With loops, states are those that functions take: all positions, independent velocities and accelerations.
    pivots : sequence of int
        Columns of the regressor.
    smooth : float, optional
        Velocity, rad/s or m/s, within which dry friction changes sign gradually, so that the entries have derivatives
        everywhere; with none they jump.
    symbols : mapping of str to float, optional
        Values of geometry symbols.

    Raises
    ------
    InputError
        If the regressor needs measured inputs, such as currents, which nobody knows beforehand.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        pivots: Sequence[int],
        smooth: float | None = None,
        symbols: Mapping[str, float] | None = None,
    ) -> None:
        function = _ordered(robot_function("regressor", mechanism, pivots))
        if any(argument.name == "inputs" for argument in function.arguments):
            labels = next(a.labels for a in function.arguments if a.name == "inputs")
            raise InputError(f"effects need the measured inputs of {', '.join(labels)}, which no trajectory fixes")
        self.recorded = function  # without smoothing
        self.function = function if smooth is None else smooth_function(function, smooth)
        self._symbols = geometry_values(mechanism, self.function.arguments, symbols)
        self._entries = Kernel(self.function, sparse=True)
        self._pullback = Kernel(pullback(self.function))

    @property
    def size(self) -> int:
        """Number of entries."""
        return len(self.function.entries)

    @property
    def rows(self) -> list[Rows]:
        """The entries of each output."""
        indices = np.array(list(self.function.entries), dtype=np.intp).reshape(-1, 2)
        cuts = np.searchsorted(indices[:, 0], np.arange(self.function.shape[0] + 1)).tolist()
        return [Rows(slice(a, b), indices[a:b, 1]) for a, b in pairwise(cuts)]

    def entries(self, state: Mapping[str, Floats]) -> Floats:
        """Values of all entries, shape (N, size)."""
        return self._entries({**state, **self._symbols})

    def pulled(self, state: Mapping[str, Floats], adjoint: Floats) -> tuple[Floats, Floats, Floats]:
        """Derivatives by q, q̇ and q̈, each of its shape, from those by the entries, of shape (N, size)."""
        found = self._pullback({**state, **self._symbols, ADJOINT: adjoint})
        sizes = [len(argument) for argument in self.function.arguments if argument.name in STATE]
        by_q, by_qd, by_qdd = np.split(found, np.cumsum(sizes)[:-1], axis=1)
        return by_q, by_qd, by_qdd


def pullback(function: Function) -> Function:
    """Derivatives of Σ adjoint_k · entry_k by all states.

    Parameters
    ----------
    function : Function
        Any function of some of ``q``, ``qd`` and ``qdd``; its program is extended.

    Returns
    -------
    Function
        With one more argument, ``adjoint``, one entry for each of the function's; its result has one entry for each of
        those that the function's states have together, in their order.
    """
    program = function.program
    labels = [",".join(map(str, index)) for index in function.entries]
    weights = [program.input(f"{ADJOINT}[{label}]") for label in labels]
    total = program.zero
    for weight, node in zip(weights, function.entries.values(), strict=True):
        total = total + weight * Scalar(program, node)
    states = [a for name in STATE for a in function.arguments if a.name == name]
    inputs = [node for argument in states for node in argument.nodes]
    found = derivatives(program, [total.node], inputs, reverse=True)
    adjoint = Argument(ADJOINT, tuple(w.node for w in weights), tuple(labels), ("1",) * len(labels), "weights")
    axis = tuple(f"{argument.name}[{label}]" for argument in states for label in argument.labels)
    arguments = (*function.arguments, adjoint)
    return Function(f"{function.name}_pullback", program, arguments, {(j,): n for (_, j), n in found.items()}, (axis,))


def _ordered(function: Function) -> Function:
    """The same function with its entries row by row."""
    entries = dict(sorted(function.entries.items()))
    return Function(
        function.name, function.program, function.arguments, entries, function.axes, function.units, function.meaning
    )
