"""Functions of robots in plain double precision."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from echelon.mechanism.mechanism import Mechanism
from echelon.mechanism.values import symbol_values
from echelon.program.function import Function
from echelon.program.schedule import FloatArithmetic, Schedule

FloatArray = npt.NDArray[np.float64]


def evaluate(
    function: Function,
    mechanism: Mechanism,
    values: Mapping[str, npt.ArrayLike],
    arithmetic: FloatArithmetic | None = None,
) -> FloatArray:
    """A function's result, shape (samples, ...), from the values of its arguments by name.

    Those of uniform arguments have one axis, others the axis of samples before it; the symbols are the mechanism's own
    unless they are given.
    """
    arithmetic = arithmetic or FloatArithmetic()
    samples = max(len(np.atleast_2d(values[a.name])) for a in function.arguments if not a.uniform)
    leaves: dict[int, FloatArray] = {}
    for argument in function.arguments:
        given = values.get(argument.name)
        if given is None:
            assert argument.name == "symbols"
            given = list(symbol_values(mechanism, argument.labels).values())
        columns = np.broadcast_to(np.asarray(given, dtype=arithmetic.dtype), (samples, len(argument)))
        leaves |= dict(zip(argument.nodes, columns.T, strict=True))
    schedule = Schedule(function.program, function.outputs)
    found = schedule.run(arithmetic, {node: leaves[node] for node in schedule.leaves}, samples)
    result = np.zeros((samples, *function.shape), dtype=arithmetic.dtype)
    for index, value in zip(function.entries, found, strict=True):
        result[(slice(None), *index)] = value
    return result
