"""Recorded forms in double precision: the plain NumPy reference evaluator."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from echelon.errors import InputError
from echelon.mechanism.mechanism import Mechanism
from echelon.mechanism.values import symbol_values
from echelon.program.schedule import FloatArithmetic, Schedule
from echelon.regressor.linear import LinearForms

_BLOCK = 1024  # samples evaluated together, so that the table of intermediate values stays small


def evaluate_floats(
    forms: LinearForms,
    mechanism: Mechanism,
    q: npt.ArrayLike,
    qd: npt.ArrayLike,
    qdd: npt.ArrayLike,
    symbols: Mapping[str, float] | None = None,
    inputs: Mapping[str, npt.ArrayLike] | None = None,
) -> npt.NDArray[np.float64]:
    """Evaluate forms at states of a mechanism.

    Parameters
    ----------
    forms : LinearForms
        With inputs ``q[...]``, ``qd[...]``, ``qdd[...]`` and geometry symbols.
    mechanism : Mechanism
    q : array of shape (N, positions)
    qd, qdd : arrays of shape (N, velocities)
    symbols : mapping of str to float, optional
        Values that replace or complete those of the mechanism.
    inputs : mapping of str to array of shape (N,), optional
        Measured inputs that effects use, such as the currents of drives with unknown gains, by coordinate or actuator.

    Returns
    -------
    array of shape (N, rows, columns)

    Raises
    ------
    InputError
        If shapes do not fit, or a symbol or a measured input has no value.
    """
    named = {
        **{f"i[{name}]": np.atleast_1d(np.asarray(values, dtype=float)) for name, values in (inputs or {}).items()},
        **_columns(q, "q", mechanism.positions),
        **_columns(qd, "qd", mechanism.velocities),
        **_columns(qdd, "qdd", mechanism.velocities),
    }
    counts = {len(np.atleast_2d(np.asarray(x))) for x in (q, qd, qdd)} | {len(v) for v in named.values()}
    if len(counts) != 1:
        raise InputError(f"q, qd, qdd and inputs have different numbers of samples: {sorted(counts)}")
    samples = counts.pop()
    schedule = Schedule(forms.program, list(forms.entries.values()))
    wanted = [forms.program.inputs[n].name for n in schedule.leaves if forms.program.inputs[n].role == "symbol"]
    constants = symbol_values(mechanism, wanted, symbols)
    result = np.zeros((samples, *forms.shape))
    for start in range(0, samples, _BLOCK):
        block = slice(start, min(start + _BLOCK, samples))
        size = block.stop - block.start
        leaves = {}
        for node in schedule.leaves:
            name = forms.program.inputs[node].name
            if name not in constants and name not in named:
                raise InputError(f"the measured input {name} is needed; give it as inputs={{'{name[2:-1]}': ...}}")
            leaves[node] = np.full(size, constants[name]) if name in constants else named[name][block]
        for (row, column), value in zip(forms.entries, schedule.run(FloatArithmetic(), leaves, size), strict=True):
            result[block, row, column] = value
    return result


def _columns(values: npt.ArrayLike, kind: str, names: tuple[str, ...]) -> dict[str, npt.NDArray[np.float64]]:
    array = np.atleast_2d(np.asarray(values, dtype=float))
    if array.ndim != 2 or array.shape[1] != len(names):
        raise InputError(f"{kind} has shape {array.shape}; expected (samples, {len(names)}): {', '.join(names)}")
    return {f"{kind}[{name}]": array[:, k] for k, name in enumerate(names)}
