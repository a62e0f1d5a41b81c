"""Values of the arguments of a robot's functions: states, geometry, measured inputs, virtual velocities.

In a mechanism with loops a function gives the power in a virtual motion that keeps the loops closed.  It is evaluated
once for each output, with the virtual velocities that make the power that output; they follow from the closures in
double precision.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import numpy.typing as npt

from echelon.dynamics.arguments import STATE
from echelon.errors import InputError
from echelon.machine.batch import Floats, real_array, value_of
from echelon.mechanism.mechanism import Mechanism
from echelon.mechanism.values import symbol_values
from echelon.program.function import Argument, Function
from echelon.regressor.loops.assembly import Assembly

Values = dict[str, npt.ArrayLike]


def function_values(
    mechanism: Mechanism,
    function: Function,
    state: Mapping[str, npt.ArrayLike],
    symbols: Mapping[str, float] | None,
    inputs: Mapping[str, npt.ArrayLike] | None,
) -> Values:
    """Values of a function's arguments, by name.

    Parameters
    ----------
    mechanism : Mechanism
    function : Function
    state : mapping of str to array
        Values that are passed on: ``q``, ``qd``, ``qdd``, ``parameters``.
    symbols : mapping of str to float, optional
        Values that replace or complete those of the mechanism.
    inputs : mapping of str to array of shape (N,), optional
        Measured inputs, by name.

    Raises
    ------
    InputError
        If a state, a symbol or a measured input is missing, or there is nothing of an input's name.
    """
    values: Values = dict(state)
    arguments = {argument.name: argument for argument in function.arguments}
    for name in arguments.keys() & {*STATE, "parameters"}:
        value_of(arguments[name], values)
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


def along_loops(
    mechanism: Mechanism, values: Values, symbols: Mapping[str, float] | None
) -> tuple[Values, Iterator[Values]]:
    """Values at closed states, and for each output the arguments ``u`` and ``v`` that make the power that output.

    Parameters
    ----------
    mechanism : Mechanism
        With loops.
    values : mapping of str to array
        Where each of ``q``, ``qd``, ``qdd`` may be that of the independent coordinates only.
    symbols : mapping of str to float, optional

    Raises
    ------
    InputError
        If states are not closed or cannot be closed, or an output is not determined by the motion.
    """
    assembly = Assembly(mechanism, symbols)
    moving = {name: np.atleast_2d(real_array(name, values[name])) for name in STATE if name in values}
    if len({array.shape[:-1] for array in moving.values()}) > 1 or moving["q"].ndim != 2:
        shown = ", ".join(f"{name} {array.shape}" for name, array in moving.items())
        raise InputError(f"expected states of shape (samples, size), as many of each kind; got {shown}")
    still = np.zeros((len(moving["q"]), len(mechanism.velocities)))
    closed = assembly.completed(moving["q"], moving.get("qd", still), moving.get("qdd", still))
    found = values | {name: array for name, array in zip(STATE, closed, strict=True) if name in moving}
    return found, _virtual_speeds(assembly, closed[0])


def _virtual_speeds(assembly: Assembly, q: Floats) -> Iterator[Values]:
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
