"""LinearModel: any model y = X(x) ζ that is linear in its parameters ζ, and its values in double precision.

What a user gives (sympy, text, numbers, functions) is recorded, and every recorded value is written as a polynomial in
the parameters whose coefficients are values without parameters.  What cancels is recognised in ball arithmetic, at
random real points.  Outputs that are not linear in the parameters are refused with the reason.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from dataclasses import replace
from fractions import Fraction
from typing import Any

import flint
import numpy as np
import numpy.typing as npt

from echelon.algebra import (
    BALL_BITS,
    DEFAULT_SEED,
    BallArithmetic,
    FloatArithmetic,
    Op,
    Polynomial,
    Program,
    Rational,
    RealPoints,
    Scalar,
    Schedule,
    Surd,
    count_of,
    exact_number,
    from_sympy,
    parse,
    random_generator,
    record_expression,
    stated_ball,
    with_values,
)
from echelon.dynamics.linear_forms import LinearForms
from echelon.robot import Mechanism, Readable, loaded, mechanism_of
from echelon.shared import (
    Floats,
    InputError,
    check_distinct,
    check_identifier,
    check_text,
    check_title,
    public,
)


def names_of(items: Iterable[Any], kind: str) -> tuple[str, ...]:
    """Names of symbols given as texts or sympy symbols."""
    return tuple(_name(item, kind) for item in items)


def _name(item: Any, kind: str) -> str:
    symbolic = getattr(item, "is_Symbol", False)
    if not (symbolic or (isinstance(item, str) and item.strip())):
        raise InputError(f"'{item}' is not the name of a {kind}")
    name = str(item.name) if symbolic else item.strip()
    check_identifier(name, f"{kind} '{name}'", composed=True)
    return name


def constant_values(
    constants: Mapping[Any, Any] | Sequence[Any] | None,
) -> dict[str, Rational | None]:
    """Names of constants with their exact values, None where unknown."""
    if constants is None:
        return {}
    if not isinstance(constants, Mapping):
        return dict.fromkeys(names_of(constants, "constant"))
    return {
        _name(key, "constant"): _value(_name(key, "constant"), value)
        for key, value in constants.items()
    }


def _value(name: str, value: Any) -> Rational | None:
    if value is None:
        return None
    try:
        found = parse(value).number if isinstance(value, str) else exact_number(value)
    except (ValueError, InputError):
        found = None
    if found is None:
        raise InputError(
            f"'{value}' is not a number such as 0.5 or 2/3",
            element=f"constant '{name}'",
        ) from None
    if isinstance(found, Surd):
        raise InputError(
            f"'{value}' is not a rational number", element=f"constant '{name}'"
        )
    return found


def free_names(X: Any, declared: set[str]) -> list[str]:
    """Constants that a model implies: free symbols of its sympy expressions, other arguments of its function."""
    if callable(X) and not hasattr(X, "free_symbols"):
        return [n for n in _arguments(X) if n not in declared]
    symbols = getattr(X, "free_symbols", None)
    if symbols is None:
        symbols = {
            s
            for e in np.array(X, dtype=object).ravel()
            for s in getattr(e, "free_symbols", ())
        }
    return sorted({s.name for s in symbols} - declared)


def _arguments(function: Any) -> list[str]:
    parameters = inspect.signature(function).parameters.values()
    if any(
        p.kind in (p.VAR_POSITIONAL, p.VAR_KEYWORD, p.POSITIONAL_ONLY)
        for p in parameters
    ):
        raise InputError("a model function names its arguments: def X(x, y): ...")
    return [p.name for p in parameters]


def record_rows(
    program: Program, X: Any, scalars: Mapping[str, Scalar], columns: int | None
) -> list[list[Scalar]]:
    """The entries of a matrix as recorded scalars."""
    if callable(X) and not hasattr(X, "free_symbols"):
        X = _traced(X, scalars)
    table = np.array(X.tolist() if hasattr(X, "tolist") else X, dtype=object)
    if table.ndim == 1 and any(isinstance(row, list | tuple) for row in table):
        raise InputError("the rows of X have different lengths")
    if columns is None:
        table = table.reshape(-1, 1)
    if (
        table.ndim != 2
        or not len(table)
        or (columns is not None and table.shape[1] != columns)
    ):
        raise InputError(f"X has shape {table.shape}; expected (outputs, {columns})")
    letter = "y" if columns is None else "X"

    def place(i: int, j: int) -> str:
        return f"{letter}[{i}]" if columns is None else f"{letter}[{i}, {j}]"

    return [
        [_recorded(program, entry, scalars, place(i, j)) for j, entry in enumerate(row)]
        for i, row in enumerate(table)
    ]


def _traced(function: Any, scalars: Mapping[str, Scalar]) -> Any:
    """Result of a user's function for recording scalars."""
    try:
        return function(**{name: scalars[name] for name in _arguments(function)})
    except InputError as error:
        raise InputError(
            error.problem, element=f"function '{getattr(function, '__name__', 'X')}'"
        ) from None
    except (TypeError, AttributeError, ValueError) as error:
        problem = f"cannot be recorded: {error} (use + - * / **, abs and NumPy's elementary functions)"
        raise InputError(
            problem, element=f"function '{getattr(function, '__name__', 'X')}'"
        ) from None


def _recorded(
    program: Program, entry: Any, scalars: Mapping[str, Scalar], place: str
) -> Scalar:
    if isinstance(entry, Scalar):
        return entry
    if isinstance(entry, str):
        return record_expression(entry, scalars, place, program)
    try:
        if hasattr(entry, "free_symbols"):
            return from_sympy(program, entry, scalars)
        return program.constant(exact_number(entry))
    except InputError as error:
        raise InputError(str(error), element=place) from None


_Powers = tuple[int, ...]  # parameter nodes, sorted, with repetition
_Parts = dict[_Powers, Scalar]
LARGEST_DEGREE = 8
"""Degree in the speeds up to which terms are separated."""
STATES = 16
"""Random states at which balls show what is zero."""
"""Precision at which what cancels is told from what does not: half of it is left of values of one."""


def linear_rows(
    program: Program,
    outputs: Sequence[Scalar],
    parameters: Sequence[int],
    names: Sequence[str],
) -> list[list[Scalar]]:
    """The coefficients of the parameters in every output."""
    parts: dict[int, _Parts] = {p: {(p,): program.one} for p in parameters}
    rows = []
    for output, name in zip(outputs, names, strict=True):
        for node in program.needed([output.node], parts):
            if node not in parts:
                parts[node] = _taken_apart(program, node, parts, f"output '{name}'")
        found = parts[output.node]
        for powers, coefficient in found.items():
            if len(powers) != 1 and not _vanishes(coefficient):
                raise InputError(_problem(program, powers), element=f"output '{name}'")
        rows.append([found.get((p,), program.zero) for p in parameters])
    return rows


def _taken_apart(
    program: Program, node: int, parts: Mapping[int, _Parts], where: str
) -> _Parts:
    op, a = Op(program.ops[node]), parts.get(program.lhs[node], {})
    b = parts.get(program.rhs[node], {})
    involved = [powers for powers in (*a, *b) if powers]
    if not involved:
        return {(): Scalar(program, node)}
    if op is Op.NEG:
        return {powers: -c for powers, c in a.items()}
    if op in (Op.ADD, Op.SUB):
        return _sum(
            program, a, b if op is Op.ADD else {powers: -c for powers, c in b.items()}
        )
    name = program.inputs[involved[0][0]].name
    if op is Op.MUL:
        return _product(program, a, b, where)
    if op is Op.DIV and not any(b):
        return {powers: c / b[()] for powers, c in a.items()}
    place = "a denominator" if op is Op.DIV else f"the argument of {op.name.lower()}"
    raise InputError(
        f"not linear in the parameters: '{name}' is in {place}", element=where
    )


def _sum(program: Program, a: _Parts, b: _Parts) -> _Parts:
    return {k: a.get(k, program.zero) + b.get(k, program.zero) for k in {**a, **b}}


def _product(program: Program, a: _Parts, b: _Parts, where: str) -> _Parts:
    total: _Parts = {}
    for left, x in a.items():
        for right, y in b.items():
            powers = tuple(sorted(left + right))
            if len(powers) > LARGEST_DEGREE:
                raise InputError(_problem(program, powers), element=where)
            total[powers] = total.get(powers, program.zero) + x * y
    return total


def _problem(program: Program, powers: _Powers) -> str:
    if not powers:
        return "not linear in the parameters: it has a part without any; give that part a parameter of its own"
    return f"not linear in the parameters: it holds {'·'.join(program.inputs[p].name for p in powers)}"


def _vanishes(value: Scalar) -> bool:
    """Whether a value is zero everywhere, by its balls at random real points."""
    if value.number is not None:
        return value.is_zero
    points, rng = (
        RealPoints(value.program, [value.node]),
        random_generator(DEFAULT_SEED),
    )
    schedule = points.rows
    with flint.ctx.workprec(BALL_BITS):
        states = points.draw(rng, max(STATES, points.count))
        leaves = points.leaves(schedule.leaves, states, [{}])
        found = schedule.run(BallArithmetic(), leaves, count_of(states))[0]
        real = [x for x in found if x.is_finite()]
        if not real:
            raise InputError("division by zero at every point")
        return all(
            x.contains(0) and x.rad() < flint.arb(2) ** (-BALL_BITS // 2) for x in real
        )


@public
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

    generic: Mapping[str, str] = {}

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
            If an output is not linear in the parameters; names the output, the parameter and the reason.

        Examples
        --------
        >>> model = LinearModel.from_outputs(["(p + q)*x + q*log(x)"], ["x"], ["p", "q"])
        >>> model
        LinearModel(model: 1 output, 2 parameters)
        """
        model = cls.__new__(cls)
        model._declare(y, variables, parameters, constants, units, name)
        program, scalars = model._inputs(
            (*model.variables, *model.parameters), model.constants
        )
        column = record_rows(program, y, scalars, None)
        names = model._output_names(outputs, len(column))
        nodes = [scalars[p].node for p in model.parameters]
        rows = linear_rows(program, [row[0] for row in column], nodes, names)
        model._keep(program, rows, outputs)
        return model

    @classmethod
    def recorded(
        cls,
        program: Program,
        rows: Sequence[Sequence[Scalar]],
        units: Mapping[str, str],
        constants: Mapping[str, Rational | None],
        generic: Mapping[str, str],
        name: str,
    ) -> LinearModel:
        """A model whose entries are recorded already, with the units of its parameters by their names.

        ``generic`` holds texts of values of constants that count as generic, such as a unit of decimal angles.
        """
        model = cls.__new__(cls)
        states = [i.name for i in program.inputs.values() if i.role == "state"]
        model.variables, model.name = tuple(states), name
        model.parameters, model.units = tuple(units), tuple(units.values())
        model.constants, model.generic = dict(constants), dict(generic)
        model._keep(program, rows, None)
        return model

    def _declare(
        self,
        X: Any,
        variables: Sequence[Any],
        parameters: Sequence[Any],
        constants: Any,
        units: Any,
        name: str,
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
            raise InputError(
                f"'{twice[0]}' is declared twice among variables, parameters and constants"
            )
        if not self.parameters:
            raise InputError("a model needs at least one parameter")
        check_distinct(everything, "variables, parameters and constants")
        self.units = tuple(units) if units is not None else ("",) * len(self.parameters)
        if len(self.units) != len(self.parameters):
            raise InputError(
                f"{len(self.units)} units for {len(self.parameters)} parameters"
            )
        for parameter, unit in zip(self.parameters, self.units, strict=True):
            check_text(unit, f"unit of parameter '{parameter}'")

    def _inputs(
        self, states: Sequence[str], constants: Mapping[str, object]
    ) -> tuple[Program, dict[str, Scalar]]:
        program = Program()
        scalars = {name: program.input(name) for name in states}
        return program, scalars | {
            name: program.input(name, "symbol") for name in constants
        }

    def _output_names(
        self, outputs: Sequence[str] | None, count: int
    ) -> tuple[str, ...]:
        names = (
            tuple(outputs)
            if outputs is not None
            else tuple(f"y{i + 1}" for i in range(count))
        )
        if len(names) != count or len(set(names)) != count:
            raise InputError(
                f"{count} different names of outputs are needed, got {len(set(names))}"
            )
        for name in names:
            check_title(name, f"output '{name}'", (*self.parameters, *self.constants))
        check_distinct(names, "outputs")
        return names

    def _keep(
        self,
        program: Program,
        rows: Sequence[Sequence[Scalar]],
        outputs: Sequence[str] | None,
    ) -> None:
        self.outputs = self._output_names(outputs, len(rows))
        entries = {
            (i, j): e.node
            for i, row in enumerate(rows)
            for j, e in enumerate(row)
            if not e.is_zero
        }
        stated = {
            name: str(value)
            for name, value in self.constants.items()
            if value is not None
        } | dict(self.generic)
        self.regressor = LinearForms(
            program, entries, (len(rows), len(self.parameters)), values=stated
        )

    @property
    def values(self) -> dict[str, float]:
        """Values of the constants that have one."""
        generic = {
            n: float(stated_ball(text).mid()) for n, text in self.generic.items()
        }
        return generic | {
            name: float(Fraction(v))
            for name, v in self.constants.items()
            if v is not None
        }

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
        program, nodes = with_values(
            forms.program, list(forms.entries.values()), values
        )
        entries = {
            key: n
            for key, n in zip(forms.entries, nodes, strict=True)
            if n != program.zero.node
        }
        found.constants = {
            name: value for name, value in self.constants.items() if name not in values
        }
        found.regressor = replace(forms, program=program, entries=entries)
        return found

    def __repr__(self) -> str:
        m, n = self.regressor.shape
        return f"LinearModel({self.name}: {m} output{'s' * (m != 1)}, {n} parameter{'s' * (n != 1)})"


def model_of(source: Mechanism | LinearModel | Readable) -> Mechanism | LinearModel:
    """A robot or linear model, read from its file if it is not there yet; of a saved set, what it is of."""
    if isinstance(source, Mechanism | LinearModel):
        return source
    found = loaded(source)
    model = getattr(found, "model", found)  # that of a saved set of a linear model
    return (
        model
        if isinstance(model, LinearModel)
        else mechanism_of(getattr(found, "mechanism", found))
    )


_NAME = re.compile(r"[^\W\d]\w*")


def evaluate_model(
    model: LinearModel,
    forms: LinearForms,
    variables: Mapping[str, npt.ArrayLike],
    constants: Mapping[str, float] | None = None,
) -> Floats:
    """Columns of a model's regressor at given samples.

    Shapes: variables (N,), or () for one sample; returns (N, outputs, columns), or (outputs, columns) for one sample.
    """
    known: dict[str, npt.ArrayLike] = {**model.values, **(constants or {}), **variables}
    schedule = Schedule(forms.program, list(forms.entries.values()))
    names = {node: forms.program.inputs[node].name for node in schedule.leaves}
    missing = sorted(set(names.values()) - set(known))
    if missing:
        raise InputError(f"no value for '{missing[0]}'")
    try:
        given = [np.asarray(v, dtype=float) for v in variables.values()]
        shape = np.broadcast_shapes(*(v.shape for v in given))
        samples = np.broadcast_shapes((1,), shape)[0]
        leaves = {
            n: np.broadcast_to(np.asarray(known[name], dtype=float), (samples,))
            for n, name in names.items()
        }
    except ValueError:
        raise InputError("the variables are arrays of one length") from None
    result = np.zeros((samples, *forms.shape))
    values = schedule.run(FloatArithmetic(), leaves, samples)
    for (row, column), value in zip(forms.entries, values, strict=True):
        result[:, row, column] = value
    return result if shape else result[0]
