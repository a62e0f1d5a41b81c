"""Inputs of a robot's functions that are replaced by numbers: known geometry, and parameters on request.

Values are exact, so what cancels for this robot disappears; functions of numbers become numbers.  Chains of constant
factors and of constant summands become one each, which products of parameters and lengths leave behind.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction

import numpy as np

from echelon.algebra import (
    Argument,
    FloatArithmetic,
    Function,
    Number,
    Op,
    Program,
    Scalar,
    Surd,
    exact_number,
    parts_of,
    recorded,
    replayed,
)
from echelon.base import BaseModel
from echelon.dynamics import parameter_input
from echelon.robot import Mechanism, Symbol, all_symbols, symbol_values
from echelon.shared import InputError, in_quotes, one_line

FROM_FILE = "file"  # the parameters that the robot's file states

SHARED = ("inputs", "symbols")  # arguments of which a function holds only what it uses

MOST_BITS = 512
"""Bits of an exact number, beyond which the nearest double stands for it."""


@dataclass(frozen=True)
class Constants:
    """Numbers to put in."""

    numbers: Mapping[str, Number] = field(
        default_factory=dict
    )  # by the name of the program's input
    # the same for people to read, where they did not give it themselves
    texts: Mapping[str, str] = field(default_factory=dict)
    values: tuple[float, ...] | None = None  # base parameters
    # values of symbols that are not put in although they have one
    stated: Mapping[str, str] = field(default_factory=dict)


def kept_symbols(
    mechanism: Mechanism, keep: bool | Sequence[str], given: Mapping[str, float] | None
) -> tuple[str, ...]:
    """Symbols that stay arguments although they have values."""
    valid = sorted(all_symbols(mechanism))
    kept = tuple(valid) if keep is True else tuple(keep or ())
    strange = next((name for name in kept if name not in valid), None)
    if strange is not None:
        raise InputError(
            f"there is no symbol '{one_line(strange)}' to keep (valid: {', '.join(valid) or 'none'})"
        )
    both = next((name for name in given or {} if name in kept), None)
    if both is not None:
        raise InputError(
            f"the symbol '{one_line(both)}' is kept as an argument, so it takes no value here"
        )
    return kept


def symbol_constants(
    mechanism: Mechanism, given: Mapping[str, float] | None, kept: Collection[str] = ()
) -> Constants:
    """All symbols with a value, from the file or given, except those that are kept."""
    overrides = symbol_values(mechanism, given or {}, given)
    stated = {
        name: symbol
        for name, symbol in mechanism.symbols.items()
        if symbol.value is not None
    }
    listed = {
        name: symbol.exact or repr(symbol.value) for name, symbol in stated.items()
    }
    stated = {name: symbol for name, symbol in stated.items() if name not in kept}
    numbers = {name: _number(symbol) for name, symbol in stated.items()}
    numbers |= {name: exact_number(value) for name, value in overrides.items()}
    texts = {name: listed[name] for name in stated} | {
        name: repr(value) for name, value in overrides.items()
    }
    return Constants(
        numbers,
        texts,
        stated={name: text for name, text in listed.items() if name in kept},
    )


def _number(symbol: Symbol) -> Number:
    """The exact value, where it lies in the field of exact numbers, else the decimal."""
    return exact_number(symbol.value) if symbol.number is None else symbol.number


def parameter_constants(
    base: BaseModel,
    given: str | Mapping[str, float] | None,
    symbols: Mapping[str, float] | None,
) -> Constants:
    """Values of the base parameters."""
    if given is None:
        return Constants()
    standard: Sequence[float] = ()
    if isinstance(given, str):
        if given != FROM_FILE:
            raise InputError(
                f"parameters are 'file' or values by name, not '{one_line(given)}'"
            )
        standard = base.standard_values().tolist()
        values = base.values(standard, symbols)
    elif len(given) == len(base.pivots) and set(given) == set(base.pivots):
        values = np.array([given[name] for name in base.pivots], dtype=float)
    else:
        _check_names(base, given)
        standard = [given[name] for name in base.parameters]
        values = base.values(standard, symbols)
    numbers = {
        parameter_input(name): exact_number(float(v))
        for name, v in zip(base.pivots, values, strict=True)
    }
    pairs = zip(base.parameters, standard, strict=True) if standard else ()
    numbers |= {
        parameter_input(n, standard=True): exact_number(float(v)) for n, v in pairs
    }
    return Constants(numbers, values=tuple(map(float, values)))


def _check_names(base: BaseModel, given: Mapping[str, float]) -> None:
    strange = [name for name in given if name not in base.parameters]
    if strange:
        raise InputError(f"there are no parameters {in_quotes(map(one_line, strange))}")
    missing = [name for name in base.pivots if name not in given] or [
        n for n in base.parameters if n not in given
    ]
    if missing:
        raise InputError(
            f"values are missing for {in_quotes(map(one_line, missing))}: give all {len(base.pivots)} base "
            "parameters by the names of their representatives and nothing else, or all "
            f"{len(base.parameters)} standard parameters"
        )


# -- put in ------------------------------------------------------------------------------------------------------------


def specialised(
    function: Function,
    values: Mapping[str, Number],
    layout: Mapping[str, Sequence[str]] | None = None,
) -> Function:
    """Copy of a function on a program of its own, with values in place of the uniform inputs that are named.

    ``layout`` holds labels of the arguments in :data:`SHARED`, so that several functions take the same vectors.
    Arguments that are constant altogether are left out.
    """
    copy, program = Program(), function.program
    known = {
        n: copy.constant(values[i.name]).node
        for n, i in program.inputs.items()
        if i.name in values
    }
    nodes = replayed(program, function.outputs, copy, known, _folded)
    entries = {
        index: node
        for index, node in zip(function.entries, nodes, strict=True)
        if node != copy.zero.node
    }
    arguments = (
        _argument(function, argument, copy, values, layout or {})
        for argument in function.arguments
    )
    kept = tuple(argument for argument in arguments if len(argument))
    return replace(function, program=copy, arguments=kept, entries=entries)


def _argument(
    function: Function,
    argument: Argument,
    copy: Program,
    values: Mapping[str, Number],
    layout: Mapping[str, Sequence[str]],
) -> Argument:
    inputs = {
        label: function.program.inputs[node]
        for label, node in zip(argument.labels, argument.nodes, strict=True)
    }
    units = dict(zip(argument.labels, argument.units, strict=True))
    labels = [label for label in argument.labels if inputs[label].name not in values]
    if argument.name in layout and labels:
        labels = list(layout[argument.name])
    nodes = []
    for label in labels:
        # an input that only other functions use needs a node too, so that vectors are the same for all
        name, role = (
            (inputs[label].name, inputs[label].role)
            if label in inputs
            else (f"unused[{label}]", "state")
        )
        nodes.append(copy.input(name, role).node)
    kept = tuple(units.get(label, "SI") for label in labels)
    return replace(argument, nodes=tuple(nodes), labels=tuple(labels), units=kept)


def _folded(copy: Program, op: Op, a: int, b: int) -> int:
    """An operation with its constants gathered, and functions of numbers as numbers."""
    if op >= Op.SIN:
        return _function(copy, op, a)
    if op is Op.DIV and b == copy.zero.node:
        raise InputError(
            "with the values put in a divisor is zero: is the mechanism always in a singular pose?"
        )
    if op in (Op.ADD, Op.MUL):
        a, b = _gathered(copy, op, a, b)
    made = recorded(copy, op, a, b)
    value = copy.constants.get(made)
    return made if value is None else copy.constant(_bounded(value)).node


def _gathered(copy: Program, op: Op, a: int, b: int) -> tuple[int, int]:
    """Operands of c∘(d∘x) as those of x∘(c∘d)."""
    if a in copy.constants:
        a, b = b, a
    if b not in copy.constants or copy.ops[a] != op:
        return a, b
    inner, outer = (copy.lhs[a], copy.rhs[a]), copy.constants[b]
    for x, d in (inner, inner[::-1]):
        if d in copy.constants:
            value = copy.constants[d]
            return x, copy.constant(
                _bounded(outer * value if op is Op.MUL else outer + value)
            ).node
    return a, b


def _function(copy: Program, op: Op, a: int) -> int:
    made = copy.function(op, Scalar(copy, a)).node
    if a not in copy.constants or made in copy.constants:
        return made
    value = FloatArithmetic().unary(op, np.asarray(float(copy.constants[a])))
    return copy.constant(exact_number(float(value))).node


def _bounded(value: Number) -> Number:
    """The number itself, or the nearest double if it has become very long."""
    longest = max(
        max(abs(part.numerator), part.denominator).bit_length()
        for part in parts_of(value)
    )
    if longest <= MOST_BITS:
        return value
    try:
        return Fraction(float(value)) if isinstance(value, Surd | Fraction) else value
    except OverflowError:
        raise InputError(
            "products of the values put in are beyond the range of floating-point numbers"
        ) from None
