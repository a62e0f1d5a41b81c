"""A robot's function as machine code, called with states, parameters and values of symbols.

In a mechanism with loops a function gives the power in a virtual motion that keeps the loops closed.  It is evaluated
once for each output, with the virtual velocities that make the power that output; they follow from the closures in
double precision.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import numpy.typing as npt

from echelon.errors import InputError
from echelon.machine.batch import Floats, real_array, result_array
from echelon.machine.kernel import Kernel
from echelon.mechanism.mechanism import Mechanism
from echelon.mechanism.values import symbol_values
from echelon.program.function import Argument, Function
from echelon.regressor.loops.assembly import Assembly

Values = dict[str, npt.ArrayLike]


class Evaluator:
    """Machine code of one function of a mechanism.

    Parameters
    ----------
    mechanism : Mechanism
    function : Function
        As :func:`echelon.dynamics.functions.robot_function` records it.
    sparse : bool
        Results hold the entries that are not structurally zero, one after another.
    """

    def __init__(self, mechanism: Mechanism, function: Function, *, sparse: bool = False) -> None:
        self.mechanism, self.function = mechanism, function
        self.kernel = Kernel(function, sparse=sparse)

    def __call__(
        self,
        state: Mapping[str, npt.ArrayLike],
        symbols: Mapping[str, float] | None = None,
        inputs: Mapping[str, npt.ArrayLike] | None = None,
        out: Floats | None = None,
        threads: int | None = None,
    ) -> Floats:
        """Evaluate at states.

        Parameters
        ----------
        state : mapping of str to array
            ``q``, ``qd``, ``qdd`` of shape (N, size) or (size,), and ``parameters`` of shape (size,), as far as the
            function has them.  With loops, each of the three may be that of the independent coordinates only.
        symbols : mapping of str to float, optional
            Values that replace or complete those of the mechanism.
        inputs : mapping of str to array of shape (N,), optional
            Measured inputs, by name.
        out : array of shape (N, …), optional
        threads : int, optional

        Returns
        -------
        array of shape (N, …)

        Raises
        ------
        InputError
            If values are missing or do not fit.
        """
        values: Values = dict(state)
        arguments = {argument.name: argument for argument in self.function.arguments}
        if "symbols" in arguments or symbols:
            labels = arguments["symbols"].labels if "symbols" in arguments else ()
            values["symbols"] = list(symbol_values(self.mechanism, labels, symbols).values())
        if "inputs" in arguments:
            values["inputs"] = _measured(arguments["inputs"], inputs or {})
        if not self.mechanism.closures:
            return self.kernel(values, out, threads)
        return self._along_loops(values, symbols, out, threads)

    def _along_loops(
        self, values: Values, symbols: Mapping[str, float] | None, out: Floats | None, threads: int | None
    ) -> Floats:
        assembly = Assembly(self.mechanism, symbols)
        moving = {name: np.atleast_2d(real_array(name, values[name])) for name in ("q", "qd", "qdd") if name in values}
        still = np.zeros((len(moving["q"]), len(self.mechanism.velocities)))
        closed = assembly.completed(moving["q"], moving.get("qd", still), moving.get("qdd", still))
        values |= {name: array for name, array in zip(("q", "qd", "qdd"), closed, strict=True) if name in moving}
        shape = (len(closed[0]), len(self.mechanism.outputs), *self.kernel.shape[1:])
        result = result_array(shape, out, closed)
        for row, speeds in enumerate(virtual_speeds(assembly, closed[0])):
            result[:, row] = self.kernel({**values, **speeds}, None, threads)[:, 0]
        return result


def virtual_speeds(assembly: Assembly, q: Floats) -> Iterator[Values]:
    """For each output, the arguments ``u`` and ``v`` that make the virtual power that output.

    Parameters
    ----------
    assembly : Assembly
    q : array of shape (N, positions)
        Closed configurations.
    """
    moved = assembly.virtual_velocities(q)
    count = moved.shape[2]
    for row in range(count):
        chosen = np.broadcast_to(np.eye(count)[row], (len(q), count))
        yield {"u": chosen, "v": np.ascontiguousarray(moved[:, :, row])}


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
