"""Derivatives of programs, recorded on the same program.

Both modes multiply the same local partial derivatives: forward from the inputs, one pass for each input, or in reverse
from the outputs, one pass for each output.  Whatever derivatives have in common with the program or with each other is
there once, and zeros vanish while recording.  Forward mode is right for few inputs, reverse mode for few outputs: a
gradient costs about as much as the function itself, three to five times over.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction

from echelon.algebra.program.operations import Op
from echelon.algebra.program.tape import Program, Scalar

Partials = list[
    tuple[int, Scalar]
]  # operands of a node, and the derivative of the node by each of them


def derivatives(
    program: Program,
    outputs: Sequence[int],
    inputs: Sequence[int],
    *,
    reverse: bool = False,
) -> dict[tuple[int, int], int]:
    """Record the derivative of every output by every input.

    Derivatives of sign(x) are zero, those of |x| are sign(x).

    >>> program = Program()
    >>> x, y = program.input("x"), program.input("y")
    >>> program.count(derivatives(program, [(x * y).node, y.sin().node], [x.node, y.node]).values())
    {'COS': 1}
    """
    varying = dependent(program, program.needed(outputs, inputs), inputs)
    recorded = _Partials(program, varying)
    order = sorted(varying)
    found: dict[tuple[int, int], int] = {}
    if reverse:
        for i, output in enumerate(outputs):
            adjoints = _pulled(recorded, order, output)
            found |= {
                (i, j): adjoints[node].node
                for j, node in enumerate(inputs)
                if node in adjoints
            }
    else:
        for j, node in enumerate(inputs):
            tangents = _pushed(recorded, order, {node: program.one})
            found |= {
                (i, j): tangents[output].node
                for i, output in enumerate(outputs)
                if output in tangents
            }
    return {
        key: node for key, node in sorted(found.items()) if node != program.zero.node
    }


def rates(
    program: Program, outputs: Sequence[int], seeds: Mapping[int, Scalar]
) -> list[Scalar]:
    """Record how fast outputs change while inputs change at given rates."""
    varying = dependent(program, program.needed(outputs, seeds), list(seeds))
    tangents = _pushed(_Partials(program, varying), sorted(varying), seeds)
    return [tangents.get(node, program.zero) for node in outputs]


def dependent(
    program: Program, needed: Sequence[int], inputs: Sequence[int]
) -> set[int]:
    """The inputs, and those of the needed nodes, given in order, that depend on them."""
    found = set(inputs)
    for node in needed:
        if program.ops[node] > Op.CONSTANT and (
            program.lhs[node] in found or program.rhs[node] in found
        ):
            found.add(node)
    return found


class _Partials:
    """Local partial derivatives by operands that vary, recorded when they are first asked for."""

    def __init__(self, program: Program, varying: set[int]) -> None:
        self.program, self.varying = program, varying
        self._known: dict[int, Partials] = {}

    def __getitem__(self, node: int) -> Partials:
        if node not in self._known:
            self._known[node] = [
                (n, d)
                for n, d in local_partials(self.program, node)
                if n in self.varying
            ]
        return self._known[node]


def _pushed(
    partials: _Partials, order: Sequence[int], seeds: Mapping[int, Scalar]
) -> dict[int, Scalar]:
    """Rates of all nodes from those of some."""
    tangents, first = dict(seeds), min(seeds)
    for node in order:
        if node <= first or node in seeds:
            continue
        terms = [
            d * tangents[operand]
            for operand, d in partials[node]
            if operand in tangents
        ]
        if terms:
            total = sum(terms[1:], terms[0])
            if not total.is_zero:
                tangents[node] = total
    return tangents


def _pulled(partials: _Partials, order: Sequence[int], end: int) -> dict[int, Scalar]:
    """Derivatives of one node by all."""
    adjoints = {end: partials.program.one}
    for node in reversed(order):
        if node not in adjoints:
            continue
        for operand, d in partials[node]:
            term = d * adjoints[node]
            adjoints[operand] = (
                adjoints[operand] + term if operand in adjoints else term
            )
    return adjoints


def local_partials(program: Program, node: int) -> Partials:
    """Derivatives of one operation by its operands."""
    op, a, b = Op(program.ops[node]), program.lhs[node], program.rhs[node]
    if op in (Op.INPUT, Op.CONSTANT, Op.SIGN):
        return []
    one, x, y = program.one, Scalar(program, a), Scalar(program, node)
    if op is Op.NEG:
        return [(a, -one)]
    if op is Op.ADD or op is Op.SUB:
        return [(a, one), (b, one if op is Op.ADD else -one)]
    if op is Op.MUL:
        return [(a, 2 * x)] if a == b else [(a, Scalar(program, b)), (b, x)]
    if op is Op.DIV:
        inverse = 1 / Scalar(program, b)
        return [(a, inverse), (b, -y * inverse)]
    return [(a, _slope(op, x, y))]


def _slope(op: Op, x: Scalar, y: Scalar) -> Scalar:
    """Derivative of the function y of x."""
    if op is Op.SIN:
        return x.cos()
    if op is Op.COS:
        return -x.sin()
    if op is Op.TAN:
        return 1 + y * y
    if op is Op.EXP:
        return y
    if op is Op.LOG:
        return 1 / x
    if op is Op.TANH:
        return 1 - y * y
    if op is Op.SQRT:
        return Fraction(1, 2) / y
    if op is Op.ABS:
        return x.sign()
    assert op is Op.ATAN
    return 1 / (1 + x * x)
