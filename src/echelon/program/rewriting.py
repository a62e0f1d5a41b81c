"""Programs with some functions in the place of others.

Functions that are rational in others are written out for exact work: |x| = sign(x)·x, tan = sin/cos,
tanh x = (e²ˣ − 1)/(e²ˣ + 1), and e^(i·atan w) = (1 + i·w)/√(1 + w²), by which sines and cosines of integer multiples of
arc tangents, plus anything, are algebraic in their arguments.  Only sine, cosine, exponential, logarithm, square root,
sign and arc tangent remain.  Programs keep the others whole otherwise, because in floating point they are faster and do
not overflow.

Functions that jump are smoothed for optimisation: sign(x) becomes tanh(x/w), and |x| = x·tanh(x/w).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import partial

from echelon.errors import InputError
from echelon.exact.polynomial import Polynomial
from echelon.program.function import Function
from echelon.program.operations import Op
from echelon.program.tape import Program, Scalar, square_root

WRITTEN_OUT = frozenset({Op.ABS, Op.TAN, Op.TANH, Op.ATAN})
"""Functions that :func:`written_out` does without, and sines of the last."""


def written_out(program: Program, outputs: Sequence[int]) -> tuple[Program, list[int]]:
    """The same outputs without ABS, TAN, TANH and sines of arc tangents; the program itself if it has none."""
    return _rewritten(program, outputs, WRITTEN_OUT, _in_rational_terms)


def smoothed(program: Program, outputs: Sequence[int], width: float) -> tuple[Program, list[int]]:
    """The same outputs without jumps; the program itself if it has none."""
    return _rewritten(program, outputs, (Op.SIGN, Op.ABS), partial(_gradual, 1 / Fraction(width)))


def with_values(
    program: Program, outputs: Sequence[int], values: Mapping[str, Polynomial]
) -> tuple[Program, list[int]]:
    """The same outputs with expressions in the place of inputs."""
    copy = Program()
    known = {n: copy.polynomial(values[i.name]).node for n, i in program.inputs.items() if i.name in values}
    return copy, replayed(program, outputs, copy, known, recorded)


Rule = Callable[[Program, Op, Scalar], Scalar]  # what stands for a function of a scalar


def _rewritten(program: Program, outputs: Sequence[int], ops: Collection[Op], rule: Rule) -> tuple[Program, list[int]]:
    if set(ops).isdisjoint(program.ops) or not any(program.ops[n] in ops for n in program.needed(outputs)):
        return program, list(outputs)

    def operation(copy: Program, op: Op, a: int, b: int) -> int:
        return rule(copy, op, Scalar(copy, a)).node if op >= Op.SIN else recorded(copy, op, a, b)

    copy = Program()
    return copy, replayed(program, outputs, copy, {}, operation)


def recorded(copy: Program, op: Op, a: int, b: int) -> int:
    """An operation as it is; a function has no second operand."""
    if op in _BINARY:
        return _BINARY[op](copy, a, b)
    return copy.negate(a) if op is Op.NEG else copy.function(op, Scalar(copy, a)).node


_BINARY = {Op.ADD: Program.add, Op.SUB: Program.subtract, Op.MUL: Program.multiply, Op.DIV: Program.divide}


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
            copy.unit_groups.append(tuple(_input(program, node, copy) for node in group))
    return [new[n] for n in outputs]


def _input(program: Program, node: int, copy: Program) -> int:
    return copy.input(program.inputs[node].name, program.inputs[node].role).node


def _in_rational_terms(copy: Program, op: Op, x: Scalar) -> Scalar:
    if op is Op.ABS:
        return copy.function(Op.SIGN, x) * x
    if op is Op.TAN:
        return _circular(Op.SIN, x) / _circular(Op.COS, x)
    if op in (Op.SIN, Op.COS):
        return _circular(op, x)
    if op is Op.TANH:
        square = copy.function(Op.EXP, 2 * x)
        return (square - 1) / (square + 1)
    return copy.function(op, x)


_LARGEST_MULTIPLE = 24


def _circular(op: Op, angle: Scalar) -> Scalar:
    """Sine or cosine of an angle that may hold integer multiples of arc tangents."""
    program = angle.program
    arcs: dict[int, int] = {}
    rest = _without_arcs(program, angle.node, 1, arcs)
    counts = {program.lhs[n]: count for n, count in arcs.items() if count}
    if not counts or any(abs(count) > _LARGEST_MULTIPLE for count in counts.values()):
        return program.function(op, angle)
    cosine, sine = rest.cos(), rest.sin()
    for node, count in counts.items():
        w = Scalar(program, node) if count > 0 else -Scalar(program, node)
        below = (1 + w * w) ** (abs(count) // 2)
        for _ in range(abs(count)):
            cosine, sine = cosine - sine * w, sine + cosine * w
        below = below * square_root(1 + w * w) if count % 2 else below
        cosine, sine = cosine / below, sine / below
    return sine if op is Op.SIN else cosine


def _without_arcs(program: Program, node: int, factor: int, arcs: dict[int, int]) -> Scalar:
    """factor · node without its integer multiples of arc tangents, which are counted."""
    op, a, b = Op(program.ops[node]), program.lhs[node], program.rhs[node]
    if op is Op.ATAN:
        arcs[node] = arcs.get(node, 0) + factor
        return program.zero
    if op is Op.NEG:
        return _without_arcs(program, a, -factor, arcs)
    if op in (Op.ADD, Op.SUB):
        other = factor if op is Op.ADD else -factor
        return _without_arcs(program, a, factor, arcs) + _without_arcs(program, b, other, arcs)
    if op is Op.MUL:
        for number, value in ((program.constants.get(a), b), (program.constants.get(b), a)):
            if isinstance(number, int):
                return _without_arcs(program, value, factor * number, arcs)
    return Scalar(program, node) * factor


def _gradual(inverse: Fraction, copy: Program, op: Op, x: Scalar) -> Scalar:
    if op in (Op.SIGN, Op.ABS):
        sign = copy.function(Op.TANH, x * inverse)
        return sign if op is Op.SIGN else x * sign
    return copy.function(op, x)


def smooth_function(function: Function, width: float) -> Function:
    """The same function with signs that change gradually."""
    nodes = [node for argument in function.arguments for node in argument.nodes]
    program, new = smoothed(function.program, [*function.entries.values(), *nodes], width)
    outputs, inputs = new[: len(function.entries)], iter(new[len(function.entries) :])
    arguments = tuple(replace(a, nodes=tuple(next(inputs) for _ in a.nodes)) for a in function.arguments)
    entries = dict(zip(function.entries, outputs, strict=True))
    return replace(function, program=program, arguments=arguments, entries=entries)
