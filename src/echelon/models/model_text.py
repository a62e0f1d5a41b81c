"""What a user gives as a model (sympy, text, numbers, functions) as recorded scalars, taken apart into a regressor.

Every recorded value is written as a polynomial in the parameters whose coefficients are values without parameters.
What cancels is recognised exactly, at a random point of a large prime field.  Outputs that are not linear in the
parameters are refused with the reason.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from echelon.errors import DegenerateSampleError, InputError
from echelon.exact.expressions import parse
from echelon.exact.field import CERTIFICATE_BITS, PrimeField
from echelon.exact.numbers import Rational, Surd
from echelon.program.sampling import FieldSampler
from echelon.program.sympy_bridge import from_sympy
from echelon.program.tape import Op, Program, Scalar, exact
from echelon.program.text import record_expression
from echelon.seeds import DEFAULT_SEED, random_generator


def names_of(items: Iterable[Any], kind: str) -> tuple[str, ...]:
    """Names of symbols given as texts or sympy symbols."""
    if isinstance(items, str):
        raise InputError(f"the {kind}s are a list of names, not one text")
    return tuple(_name(item, kind) for item in items)


def _name(item: Any, kind: str) -> str:
    if isinstance(item, str) and item.strip():
        return item.strip()
    if getattr(item, "is_Symbol", False):
        return str(item.name)
    raise InputError(f"'{item}' is not the name of a {kind}")


def constant_values(constants: Mapping[Any, Any] | Sequence[Any] | None) -> dict[str, Rational | None]:
    """Names of constants with their exact values, None where unknown."""
    if constants is None:
        return {}
    if not isinstance(constants, Mapping):
        return dict.fromkeys(names_of(constants, "constant"))
    return {_name(key, "constant"): _value(_name(key, "constant"), value) for key, value in constants.items()}


def _value(name: str, value: Any) -> Rational | None:
    if value is None:
        return None
    try:
        found = parse(value).number if isinstance(value, str) else exact(value)
    except (ValueError, InputError):
        found = None
    if found is None:
        raise InputError(f"'{value}' is not a number such as 0.5 or 2/3", element=f"constant '{name}'") from None
    if isinstance(found, Surd):
        raise InputError(f"'{value}' is not a rational number", element=f"constant '{name}'")
    return found


def free_names(X: Any, declared: set[str]) -> list[str]:
    """Constants that a model implies: free symbols of its sympy expressions, other arguments of its function."""
    if callable(X) and not hasattr(X, "free_symbols"):
        return [n for n in _arguments(X) if n not in declared]
    symbols = getattr(X, "free_symbols", None)
    if symbols is None:
        symbols = {s for e in np.array(X, dtype=object).ravel() for s in getattr(e, "free_symbols", ())}
    return sorted({s.name for s in symbols} - declared)


def _arguments(function: Any) -> list[str]:
    parameters = inspect.signature(function).parameters.values()
    if any(p.kind in (p.VAR_POSITIONAL, p.VAR_KEYWORD, p.POSITIONAL_ONLY) for p in parameters):
        raise InputError("a model function names its arguments: def X(x, y): ...")
    return [p.name for p in parameters]


def record_rows(program: Program, X: Any, scalars: Mapping[str, Scalar], columns: int | None) -> list[list[Scalar]]:
    """The entries of a matrix as recorded scalars."""
    if callable(X) and not hasattr(X, "free_symbols"):
        X = _traced(X, scalars)
    table = np.array(X.tolist() if hasattr(X, "tolist") else X, dtype=object)
    if table.ndim == 1 and any(isinstance(row, list | tuple) for row in table):
        raise InputError("the rows of X have different lengths")
    if columns is None:
        table = table.reshape(-1, 1)
    if table.ndim != 2 or not len(table) or (columns is not None and table.shape[1] != columns):
        raise InputError(f"X has shape {table.shape}; expected (outputs, {columns})")
    letter = "y" if columns is None else "X"

    def place(i: int, j: int) -> str:
        return f"{letter}[{i}]" if columns is None else f"{letter}[{i}, {j}]"

    return [
        [_recorded(program, entry, scalars, place(i, j)) for j, entry in enumerate(row)] for i, row in enumerate(table)
    ]


def _traced(function: Any, scalars: Mapping[str, Scalar]) -> Any:
    """What a function returns for recording scalars."""
    try:
        return function(**{name: scalars[name] for name in _arguments(function)})
    except InputError as error:
        raise InputError(error.problem, element=f"function '{getattr(function, '__name__', 'X')}'") from None
    except (TypeError, AttributeError, ValueError) as error:
        problem = f"cannot be recorded: {error} (use + - * / **, abs and NumPy's elementary functions)"
        raise InputError(problem, element=f"function '{getattr(function, '__name__', 'X')}'") from None


def _recorded(program: Program, entry: Any, scalars: Mapping[str, Scalar], place: str) -> Scalar:
    if isinstance(entry, Scalar):
        return entry
    if isinstance(entry, str):
        return record_expression(entry, scalars, place, program)
    try:
        if hasattr(entry, "free_symbols"):
            return from_sympy(program, entry, scalars)
        return program.constant(exact(entry))
    except InputError as error:
        raise InputError(str(error), element=place) from None


_Powers = tuple[int, ...]  # parameter nodes, sorted, with repetition
_Parts = dict[_Powers, Scalar]
_LARGEST_DEGREE = 8
_ATTEMPTS = 16
_STATES = 16


def linear_rows(
    program: Program, outputs: Sequence[Scalar], parameters: Sequence[int], names: Sequence[str]
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


def _taken_apart(program: Program, node: int, parts: Mapping[int, _Parts], where: str) -> _Parts:
    op, a = Op(program.ops[node]), parts.get(program.lhs[node], {})
    b = parts.get(program.rhs[node], {})
    involved = [powers for powers in (*a, *b) if powers]
    if not involved:
        return {(): Scalar(program, node)}
    if op is Op.NEG:
        return {powers: -c for powers, c in a.items()}
    if op in (Op.ADD, Op.SUB):
        return _sum(program, a, b if op is Op.ADD else {powers: -c for powers, c in b.items()})
    name = program.inputs[involved[0][0]].name
    if op is Op.MUL:
        return _product(program, a, b, where)
    if op is Op.DIV and not any(b):
        return {powers: c / b[()] for powers, c in a.items()}
    place = "a denominator" if op is Op.DIV else f"the argument of {op.name.lower()}"
    raise InputError(f"not linear in the parameters: '{name}' is in {place}", element=where)


def _sum(program: Program, a: _Parts, b: _Parts) -> _Parts:
    return {k: a.get(k, program.zero) + b.get(k, program.zero) for k in {**a, **b}}


def _product(program: Program, a: _Parts, b: _Parts, where: str) -> _Parts:
    total: _Parts = {}
    for left, x in a.items():
        for right, y in b.items():
            powers = tuple(sorted(left + right))
            if len(powers) > _LARGEST_DEGREE:
                raise InputError(_problem(program, powers), element=where)
            total[powers] = total.get(powers, program.zero) + x * y
    return total


def _problem(program: Program, powers: _Powers) -> str:
    if not powers:
        return "not linear in the parameters: it has a part without any; give that part a parameter of its own"
    return f"not linear in the parameters: it holds {'·'.join(program.inputs[p].name for p in powers)}"


def _vanishes(value: Scalar) -> bool:
    """Whether a value is zero everywhere, by its residue at a random point."""
    if value.number is not None:
        return value.is_zero
    sampler, rng = FieldSampler(value.program, [value.node]), random_generator(DEFAULT_SEED)
    for _ in range(_ATTEMPTS):
        field = PrimeField.random(rng, CERTIFICATE_BITS)
        try:
            geometry = {name: field.draw(rng, (1,)) for name in sampler.symbols}
            return not sampler.evaluate(field, rng, max(_STATES, sampler.regions), geometry).any()
        except DegenerateSampleError:
            continue
    raise InputError("division by zero at every point")
