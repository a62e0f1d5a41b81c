"""LinearModel: any model y = X(x) ζ that is linear in its parameters ζ, and its values in double precision."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.exact.numbers import Rational
from echelon.exact.polynomial import Polynomial
from echelon.models.model_text import constant_values, free_names, linear_rows, names_of, record_rows
from echelon.program.rewriting import with_values
from echelon.program.schedule import FloatArithmetic, Schedule
from echelon.program.tape import Program, Scalar
from echelon.program.text import FUNCTION_NAMES, record_expression
from echelon.regressor.linear import LinearForms


class LinearModel:
    """A model y = X(x) ζ, with X recorded exactly.

    Parameters
    ----------
    X : sympy Matrix, nested sequence or function, shape (outputs, parameters)
        Entries are sympy expressions, numbers or texts such as ``"exp(-E/T)"``.  A function is called once with
        recording scalars, by the names of its arguments; NumPy functions work on them.
    variables : sequence of str or sympy Symbol
        What varies from sample to sample.
    parameters : sequence of str or sympy Symbol
        The columns of X, in the order in which representatives are preferred.
    constants : mapping of str to value, or sequence of str, optional
        What stays the same, with exact values (numbers or texts) where known.  Free symbols of sympy expressions and
        other arguments of a function are constants without being listed.  Constants are taken as positive.
    outputs : sequence of str, optional
        Names of the rows; y1, y2, … if omitted.
    units : sequence of str, optional
        Units of the parameters.
    name : str

    Raises
    ------
    InputError
        If an entry is not such an expression, or names are missing or clash; names the entry.

    Examples
    --------
    >>> import echelon as ec
    >>> model = ec.LinearModel([["x", "2*x*a", "exp(x)"]], ["x"], ["p", "q", "r"], {"a": None})
    >>> print(ec.base_parameters(model).expressions[0])
    p + 2·a·q
    """

    def __init__(
        self,
        X: Any,
        variables: Sequence[Any],
        parameters: Sequence[Any],
        constants: Mapping[Any, Any] | Sequence[Any] | None = None,
        outputs: Sequence[str] | None = None,
        units: Sequence[str] | None = None,
        name: str = "model",
    ) -> None:
        self._declare(X, variables, parameters, constants, units, name)
        program, scalars = self._inputs(self.variables, self.constants)
        rows = record_rows(program, X, scalars, len(self.parameters))
        self._keep(program, rows, outputs)

    @classmethod
    def from_outputs(
        cls,
        y: Any,
        variables: Sequence[Any],
        parameters: Sequence[Any],
        constants: Mapping[Any, Any] | Sequence[Any] | None = None,
        outputs: Sequence[str] | None = None,
        units: Sequence[str] | None = None,
        name: str = "model",
    ) -> LinearModel:
        """A model from the outputs themselves, expressions linear in the parameters.

        Parameters
        ----------
        y : sequence of expressions, or function
            As the entries of X; a function takes parameters too.
        variables, parameters, constants, outputs, units, name
            As for the constructor.

        Returns
        -------
        LinearModel

        Raises
        ------
        InputError
            If an output is not linear in the parameters; says which, in which parameter, and why.

        Examples
        --------
        >>> model = LinearModel.from_outputs(["(p + q)*x + q*log(x)"], ["x"], ["p", "q"])
        >>> model
        LinearModel(model: 1 output, 2 parameters)
        """
        model = cls.__new__(cls)
        model._declare(y, variables, parameters, constants, units, name)
        program, scalars = model._inputs((*model.variables, *model.parameters), model.constants)
        column = record_rows(program, y, scalars, None)
        names = model._output_names(outputs, len(column))
        nodes = [scalars[p].node for p in model.parameters]
        rows = linear_rows(program, [row[0] for row in column], nodes, names)
        model._keep(program, rows, outputs)
        return model

    def _declare(
        self, X: Any, variables: Sequence[Any], parameters: Sequence[Any], constants: Any, units: Any, name: str
    ) -> None:
        self.name = name
        self.variables = names_of(variables, "variable")
        self.parameters = names_of(parameters, "parameter")
        stated = constant_values(constants)
        found = free_names(X, {*self.variables, *self.parameters, *stated})
        self.constants: dict[str, Rational | None] = {**stated, **dict.fromkeys(found)}
        everything = [*self.variables, *self.parameters, *self.constants]
        twice = sorted({n for n in everything if everything.count(n) > 1})
        if twice:
            raise InputError(f"'{twice[0]}' is declared twice among variables, parameters and constants")
        if not self.parameters:
            raise InputError("a model needs at least one parameter")
        self.units = tuple(units) if units is not None else ("",) * len(self.parameters)
        if len(self.units) != len(self.parameters):
            raise InputError(f"{len(self.units)} units for {len(self.parameters)} parameters")

    def _inputs(self, states: Sequence[str], constants: Mapping[str, object]) -> tuple[Program, dict[str, Scalar]]:
        program = Program()
        scalars = {name: program.input(name) for name in states}
        return program, scalars | {name: program.input(name, "symbol") for name in constants}

    def _output_names(self, outputs: Sequence[str] | None, count: int) -> tuple[str, ...]:
        names = tuple(outputs) if outputs is not None else tuple(f"y{i + 1}" for i in range(count))
        if len(names) != count or len(set(names)) != count:
            raise InputError(f"{count} different names of outputs are needed, got {len(set(names))}")
        return names

    def _keep(self, program: Program, rows: Sequence[Sequence[Scalar]], outputs: Sequence[str] | None) -> None:
        self.outputs = self._output_names(outputs, len(rows))
        entries = {(i, j): e.node for i, row in enumerate(rows) for j, e in enumerate(row) if not e.is_zero}
        stated = {name: value for name, value in self.constants.items() if value is not None}
        self.regressor = LinearForms(program, entries, (len(rows), len(self.parameters)), values=stated)

    @property
    def values(self) -> dict[str, float]:
        """Values of the constants that have one."""
        return {name: float(Fraction(v)) for name, v in self.constants.items() if v is not None}

    def with_constants(self, values: Mapping[str, Polynomial]) -> LinearModel:
        """The model with expressions in the place of some constants.

        Parameters
        ----------
        values : mapping of str to Polynomial
            In other constants, by name.

        Raises
        ------
        InputError
            If an entry divides by zero then.
        """
        forms, found = self.regressor, copy(self)
        program, nodes = with_values(forms.program, list(forms.entries.values()), values)
        entries = {key: n for key, n in zip(forms.entries, nodes, strict=True) if n != program.zero.node}
        found.constants = {name: value for name, value in self.constants.items() if name not in values}
        found.regressor = replace(forms, program=program, entries=entries)
        return found

    def __repr__(self) -> str:
        m, n = self.regressor.shape
        return f"LinearModel({self.name}: {m} output{'s' * (m != 1)}, {n} parameter{'s' * (n != 1)})"


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
