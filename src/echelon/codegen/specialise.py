"""Functions with constants put in: known geometry, and parameters where their values are wanted in the code.

Values are exact, so what cancels for this robot disappears; functions of numbers become numbers.  Chains of constant
factors and of constant summands become one each, which products of parameters and lengths leave behind.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction

import numpy as np

from echelon.errors import InputError
from echelon.exact.numbers import Number, Surd, parts_of
from echelon.program.function import Argument, Function
from echelon.program.operations import Op
from echelon.program.scalar import Scalar, exact
from echelon.program.schedule import FloatArithmetic
from echelon.program.tape import Program

SHARED = ("inputs", "symbols")
"""Arguments of which a function holds only what it uses."""

_MOST_BITS = 512


def specialised(
    function: Function, values: Mapping[str, Number], layout: Mapping[str, Sequence[str]] | None = None
) -> Function:
    """The same function with some uniform inputs replaced by numbers.

    Parameters
    ----------
    function : Function
    values : mapping of str to Number
        By the name of the program's input.
    layout : mapping of str to sequence of str, optional
        Labels of the arguments in :data:`SHARED`, so that several functions take the same vectors; labels that the
        function does not use are added.

    Returns
    -------
    Function
        On a program of its own.  Arguments that are constant altogether are left out.
    """
    copy, known = Program(), function.program
    new = {known.zero.node: copy.zero.node}
    for node in function.needed:
        new[node] = _copied(known, node, copy, new, values)
    arguments = [_argument(function, argument, copy, values, layout or {}) for argument in function.arguments]
    entries = {index: new[node] for index, node in function.entries.items() if new[node] != copy.zero.node}
    kept = tuple(argument for argument in arguments if len(argument))
    return Function(function.name, copy, kept, entries, function.axes, function.units, function.meaning)


def _argument(
    function: Function,
    argument: Argument,
    copy: Program,
    values: Mapping[str, Number],
    layout: Mapping[str, Sequence[str]],
) -> Argument:
    inputs = {label: function.program.inputs[node] for label, node in zip(argument.labels, argument.nodes, strict=True)}
    units = dict(zip(argument.labels, argument.units, strict=True))
    labels = [label for label in argument.labels if inputs[label].name not in values]
    if argument.name in layout and labels:
        labels = list(layout[argument.name])
    nodes = []
    for label in labels:
        # an input that only other functions use needs a node too, so that vectors are the same for all
        name, role = (inputs[label].name, inputs[label].role) if label in inputs else (f"unused[{label}]", "state")
        nodes.append(copy.input(name, role).node)
    kept = tuple(units.get(label, "SI") for label in labels)
    return Argument(argument.name, tuple(nodes), tuple(labels), kept, argument.meaning, argument.uniform)


def _copied(known: Program, node: int, copy: Program, new: Mapping[int, int], values: Mapping[str, Number]) -> int:
    op = Op(known.ops[node])
    if op is Op.INPUT:
        given = known.inputs[node]
        return (
            copy.constant(values[given.name]).node if given.name in values else copy.input(given.name, given.role).node
        )
    if op is Op.CONSTANT:
        return copy.constant(known.constants[node]).node
    a = new[known.lhs[node]]
    if op is Op.NEG:
        return copy.negate(a)
    if op >= Op.SIN:
        return _function(copy, op, a)
    return _binary(copy, op, a, new[known.rhs[node]])


def _binary(copy: Program, op: Op, a: int, b: int) -> int:
    if op is Op.DIV:
        if b == copy.zero.node:
            raise InputError("with the values put in a divisor is zero: is the mechanism always in a singular pose?")
        made = copy.divide(a, b)
    elif op is Op.MUL:
        made = copy.multiply(*_gathered(copy, Op.MUL, a, b))
    else:
        made = copy.subtract(a, b) if op is Op.SUB else copy.add(*_gathered(copy, Op.ADD, a, b))
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
            return x, copy.constant(_bounded(outer * value if op is Op.MUL else outer + value)).node
    return a, b


def _function(copy: Program, op: Op, a: int) -> int:
    made = copy.function(op, Scalar(copy, a)).node
    if a not in copy.constants or made in copy.constants:
        return made
    value = FloatArithmetic().unary(op, np.asarray(float(copy.constants[a])))
    return copy.constant(exact(float(value))).node


def _bounded(value: Number) -> Number:
    """The number itself, or the nearest double if it has become very long."""
    longest = max(max(abs(part.numerator), part.denominator).bit_length() for part in parts_of(value))
    if longest <= _MOST_BITS:
        return value
    try:
        return Fraction(float(value)) if isinstance(value, Surd | Fraction) else value
    except OverflowError:
        raise InputError("products of the values put in are beyond the range of floating-point numbers") from None
