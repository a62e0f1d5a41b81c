"""Recorded forms in double precision: the plain NumPy reference evaluator."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from echelon.algebra import BLOCK, FloatArithmetic, Schedule
from echelon.dynamics.linear_forms import LinearForms
from echelon.robot import Mechanism, state_inputs, symbol_values
from echelon.shared import Floats, InputError

if TYPE_CHECKING:
    from echelon.loops import Assembly


def evaluate_floats(
    forms: LinearForms,
    mechanism: Mechanism,
    q: npt.ArrayLike,
    qd: npt.ArrayLike,
    qdd: npt.ArrayLike,
    symbols: Mapping[str, float] | None = None,
    inputs: Mapping[str, npt.ArrayLike] | None = None,
    assembly: Assembly | None = None,
) -> Floats:
    """Evaluate forms at states of all coordinates of a mechanism, at which loops are closed."""
    # shapes: q (N, positions); qd, qdd (N, velocities); inputs (N,); returns (N, rows, columns)
    q, qd, qdd = (
        np.atleast_2d(np.asarray(values, dtype=float)) for values in (q, qd, qdd)
    )
    measured = {
        name: np.atleast_1d(np.asarray(values, dtype=float))
        for name, values in (inputs or {}).items()
    }
    counts = {len(values) for values in (q, qd, qdd, *measured.values())}
    if len(counts) != 1:
        raise InputError(
            f"q, qd, qdd and inputs have different numbers of samples: {sorted(counts)}"
        )
    schedule = Schedule(forms.program, list(forms.entries.values()))
    used = [forms.program.inputs[n] for n in schedule.leaves]
    constants = symbol_values(
        mechanism, [i.name for i in used if i.role == "symbol"], symbols
    )
    named = {name: np.full(len(q), value) for name, value in constants.items()}
    named |= {f"i[{name}]": values for name, values in measured.items()}
    if forms.loops is None:
        return _evaluated(
            forms, schedule, named | state_inputs(mechanism, q, qd, qdd), len(q)
        )
    from echelon.loops import Assembly  # robots without loops do without it

    named |= state_inputs(mechanism, q, qd, qdd)
    speeds = _virtual_speeds(
        assembly or Assembly(mechanism, symbols, forms.loops.equations), q
    )
    rows = [_evaluated(forms, schedule, named | given, len(q)) for given in speeds]
    return np.concatenate(rows, axis=1)


def _evaluated(
    forms: LinearForms, schedule: Schedule, named: Mapping[str, Floats], samples: int
) -> Floats:
    """The forms as they stand, from values of all inputs by name."""
    names = {node: forms.program.inputs[node].name for node in schedule.leaves}
    missing = next((name for name in names.values() if name not in named), None)
    if missing is not None:
        raise InputError(
            f"the measured input {missing} is needed; give it as inputs={{'{missing[2:-1]}': ...}}"
        )
    result = np.zeros((samples, *forms.shape))
    for start in range(0, samples, BLOCK):
        block = slice(start, min(start + BLOCK, samples))
        leaves = {node: named[name][block] for node, name in names.items()}
        values = schedule.run(FloatArithmetic(), leaves, block.stop - block.start)
        for (row, column), value in zip(forms.entries, values, strict=True):
            result[block, row, column] = value
    return result


def _virtual_speeds(assembly: Assembly, q: Floats) -> Iterator[dict[str, Floats]]:
    """Values of the inputs ``u[...]`` and ``v[...]`` that make the virtual power each output."""
    mechanism = assembly.mechanism
    moved = assembly.virtual_velocities(q)
    for k, output in enumerate(mechanism.outputs):
        speeds = {
            f"v[{name}]": moved[:, column, k]
            for column, name in enumerate(mechanism.velocities)
        }
        yield speeds | {
            f"u[{other.name}]": np.full(len(q), float(other is output))
            for other in mechanism.outputs
        }
