"""Linear models in double precision."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.models.linear_model import LinearModel
from echelon.program.schedule import FloatArithmetic, Schedule
from echelon.program.tape import Program
from echelon.program.text import FUNCTION_NAMES, record_expression
from echelon.regressor.linear import LinearForms

_NAME = re.compile(r"[^\W\d]\w*")


def evaluate_model(
    model: LinearModel,
    forms: LinearForms,
    variables: Mapping[str, npt.ArrayLike],
    constants: Mapping[str, float] | None = None,
) -> Floats:
    """Columns of a model's regressor at given samples.  Shapes: variables (N,); returns (N, outputs, columns)."""
    known: dict[str, npt.ArrayLike] = {**model.values, **(constants or {}), **variables}
    schedule = Schedule(forms.program, list(forms.entries.values()))
    names = {node: forms.program.inputs[node].name for node in schedule.leaves}
    missing = sorted(set(names.values()) - set(known))
    if missing:
        raise InputError(f"no value for '{missing[0]}'")
    try:
        given = [np.asarray(v, dtype=float) for v in variables.values()]
        samples = np.broadcast_shapes((1,), *(v.shape for v in given))[0]
        leaves = {n: np.broadcast_to(np.asarray(known[name], dtype=float), (samples,)) for n, name in names.items()}
    except ValueError:
        raise InputError("the variables are arrays of one length") from None
    result = np.zeros((samples, *forms.shape))
    values = schedule.run(FloatArithmetic(), leaves, samples)
    for (row, column), value in zip(forms.entries, values, strict=True):
        result[:, row, column] = value
    return result


def recorded_definitions(definitions: Mapping[str, str]) -> tuple[Program, dict[str, int]]:
    """Functions of constants on a program, by name."""
    program = Program()
    names = {n for text in definitions.values() for n in _NAME.findall(text)} - set(FUNCTION_NAMES)
    scalars = {n: program.input(n, "symbol") for n in sorted(names)}
    return program, {name: record_expression(d, scalars, name, program).node for name, d in definitions.items()}


def definition_values(definitions: Mapping[str, str], constants: Mapping[str, float]) -> dict[str, float]:
    """Values of functions of constants."""
    if not definitions:
        return {}
    program, nodes = recorded_definitions(definitions)
    schedule = Schedule(program, list(nodes.values()))
    values = {n: np.array([constants[program.inputs[n].name]]) for n in schedule.leaves}
    return {n: float(v[0]) for n, v in zip(nodes, schedule.run(FloatArithmetic(), values, 1), strict=True)}
