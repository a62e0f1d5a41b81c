"""A robot's function as machine code, called with states, parameters, values of symbols and measured inputs."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.dynamics.arguments import STANDARD, STATE
from echelon.dynamics.closed_states import ClosedStates
from echelon.errors import InputError
from echelon.machine.batch import real_array, value_of
from echelon.machine.kernel import Kernel
from echelon.mechanism.mechanism import Mechanism
from echelon.mechanism.stated import symbol_values
from echelon.program.function import Argument, Function

Values = dict[str, npt.ArrayLike]


def function_values(
    mechanism: Mechanism,
    function: Function,
    state: Mapping[str, npt.ArrayLike],
    symbols: Mapping[str, float] | None,
    inputs: Mapping[str, npt.ArrayLike] | None,
    loops: ClosedStates | None = None,
) -> Values:
    """Values of a function's arguments, by name.

    ``state`` is passed on (``q``, ``qd``, ``qdd``, ``parameters``); symbols replace or complete those of the mechanism,
    ``inputs`` are measured ones of shape (N,), and ``loops`` completes the states of a mechanism with loops.
    """
    values: Values = dict(state)
    arguments = {argument.name: argument for argument in function.arguments}
    for name in arguments.keys() & {*STATE, "parameters", STANDARD}:
        value_of(arguments[name], values)
    if loops is not None:
        values |= loops.independent_state({name: state[name] for name in STATE if name in arguments}, symbols)
    labels = arguments["symbols"].labels if "symbols" in arguments else ()
    if labels or symbols:
        known = symbol_values(mechanism, labels, symbols)
        values |= {"symbols": list(known.values())} if labels else {}
    if inputs:
        _check_inputs(mechanism, inputs)
    if "inputs" in arguments:
        values["inputs"] = _measured(arguments["inputs"], inputs or {})
    return values


def _check_inputs(mechanism: Mechanism, inputs: Mapping[str, npt.ArrayLike]) -> None:
    """Refuse measured inputs of coordinates and actuators that there are not; others may belong to other functions."""
    valid = [*mechanism.velocities, *(a.name for a in mechanism.transmission.actuators)]
    strange = next((name for name in inputs if name not in valid), None)
    if strange is not None:
        raise InputError(f"inputs has '{strange}'; expected names of {', '.join(dict.fromkeys(valid))}")


def _measured(argument: Argument, inputs: Mapping[str, npt.ArrayLike]) -> Floats:
    """Measured inputs as columns."""
    missing = next((name for name in argument.labels if name not in inputs), None)
    if missing is not None:
        raise InputError(f"the measured input i[{missing}] is needed; give it as inputs={{'{missing}': ...}}")
    columns = [np.atleast_1d(real_array(f"inputs['{name}']", inputs[name])) for name in argument.labels]
    if any(column.ndim != 1 or len(column) != len(columns[0]) for column in columns):
        shapes = ", ".join(str(column.shape) for column in columns)
        raise InputError(f"measured inputs must be vectors of equal length; got shapes {shapes}")
    return np.stack(columns, axis=1)


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
