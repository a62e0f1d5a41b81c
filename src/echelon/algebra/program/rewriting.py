"""Programs with some functions in the place of others.

In finite fields |x| = sign(x)·x.  Functions that jump are smoothed for optimisation: sign(x) becomes tanh(x/w), and
|x| = x·tanh(x/w).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction

from echelon.algebra.exact.polynomial import Polynomial
from echelon.algebra.program.function import Function
from echelon.algebra.program.operations import FUNCTIONS, Op
from echelon.algebra.program.schedule import CIRCULAR
from echelon.algebra.program.tape import Program, Scalar
from echelon.shared import InputError


def without_absolutes(
    program: Program, outputs: Sequence[int]
) -> tuple[Program, dict[int, int]]:
    """A program with sign(x)·x in the place of |x|, and where the nodes that outputs need are there."""
    needed = program.needed(outputs)
    if not any(program.ops[n] == Op.ABS for n in needed):
        return program, {n: n for n in needed}

    def operation(copy: Program, op: Op, a: int, b: int) -> int:
        if op is not Op.ABS:
            return recorded(copy, op, a, b)
        x = Scalar(copy, a)
        return (copy.function(Op.SIGN, x) * x).node

    copy, places = Program(), dict[int, int]()
    replayed(program, outputs, copy, places, operation)
    return copy, places


def with_free_functions(
    program: Program, outputs: Sequence[int]
) -> tuple[Program, list[int]]:
    """Outputs with a free variable in place of every function that finite fields lack."""

    def operation(copy: Program, op: Op, a: int, b: int) -> int:
        if op not in FUNCTIONS or op in (*CIRCULAR, Op.SIGN, Op.ABS):
            return recorded(copy, op, a, b)
        return copy.input(f"{op.name.lower()} of node {a}", "state").node

    copy = Program()
    return copy, replayed(program, outputs, copy, {}, operation)


def smoothed(
    program: Program, outputs: Sequence[int], width: float
) -> tuple[Program, list[int]]:
    """Outputs with jumps made gradual; the program itself if it has none."""
    if not any(program.ops[n] in (Op.SIGN, Op.ABS) for n in program.needed(outputs)):
        return program, list(outputs)
    inverse = 1 / Fraction(width)

    def operation(copy: Program, op: Op, a: int, b: int) -> int:
        if op not in (Op.SIGN, Op.ABS):
            return recorded(copy, op, a, b)
        x = Scalar(copy, a)
        sign = copy.function(Op.TANH, x * inverse)
        return (sign if op is Op.SIGN else x * sign).node

    copy = Program()
    return copy, replayed(program, outputs, copy, {}, operation)


def with_values(
    program: Program, outputs: Sequence[int], values: Mapping[str, Polynomial]
) -> tuple[Program, list[int]]:
    """Outputs with expressions in place of inputs."""
    copy = Program()
    known = {
        n: copy.polynomial(values[i.name]).node
        for n, i in program.inputs.items()
        if i.name in values
    }
    return copy, replayed(program, outputs, copy, known, recorded)


def recorded(copy: Program, op: Op, a: int, b: int) -> int:
    """An operation as it is; a function has no second operand."""
    if op in _BINARY:
        return _BINARY[op](copy, a, b)
    return copy.negate(a) if op is Op.NEG else copy.function(op, Scalar(copy, a)).node


_BINARY = {
    Op.ADD: Program.add,
    Op.SUB: Program.subtract,
    Op.MUL: Program.multiply,
    Op.DIV: Program.divide,
}


def replayed(
    program: Program,
    outputs: Sequence[int],
    copy: Program,
    new: dict[int, int],
    operation: Callable[[Program, Op, int, int], int],
) -> list[int]:
    """The outputs on another program, which holds the nodes in ``new`` already, with what stands for operations."""
    for node in (n for n in program.needed(outputs, new) if n not in new):
        op, a, b = Op(program.ops[node]), program.lhs[node], program.rhs[node]
        try:
            if op is Op.INPUT:
                new[node] = _input(program, node, copy)
            elif op is Op.CONSTANT:
                new[node] = copy.constant(program.constants[node]).node
            else:
                new[node] = operation(copy, op, new[a], new.get(b, -1))
        except ZeroDivisionError:
            raise InputError("division by zero") from None
    for group in program.unit_groups:
        if any(node in new for node in group):
            copy.unit_groups.append(
                tuple(_input(program, node, copy) for node in group)
            )
    return [new[n] for n in outputs]


def _input(program: Program, node: int, copy: Program) -> int:
    return copy.input(program.inputs[node].name, program.inputs[node].role).node


def smooth_function(function: Function, width: float) -> Function:
    """Copy of a function whose signs change gradually."""
    nodes = [node for argument in function.arguments for node in argument.nodes]
    program, new = smoothed(
        function.program, [*function.entries.values(), *nodes], width
    )
    outputs, inputs = new[: len(function.entries)], iter(new[len(function.entries) :])
    arguments = tuple(
        replace(a, nodes=tuple(next(inputs) for _ in a.nodes))
        for a in function.arguments
    )
    entries = dict(zip(function.entries, outputs, strict=True))
    return replace(function, program=program, arguments=arguments, entries=entries)
