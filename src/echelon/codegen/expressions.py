"""Nodes as expressions, with no more parentheses than the order of operations needs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import IntEnum

from echelon.exact.numbers import Number, is_negative
from echelon.program.operations import Op
from echelon.program.tape import Program


class Binding(IntEnum):
    """How tightly the outermost operation of an expression binds."""

    SUM = 1
    SIGN = 2
    PRODUCT = 3
    ATOM = 4


Text = tuple[str, Binding]


class Expressions:
    """Prints nodes of one program."""

    def __init__(
        self,
        program: Program,
        names: Mapping[int, str],
        number: Callable[[Number], str],
        function: Callable[[Op, str], str],
    ) -> None:
        self._program, self._names = program, names
        self._number, self._function = number, function

    def definition(self, node: int) -> str:
        """The operation of a node, also if the node itself has a name."""
        return self._operation(node)[0]

    def reference(self, node: int) -> str:
        """The name of a node, or its operation."""
        return self._text(node)[0]

    def _text(self, node: int) -> Text:
        return (self._names[node], Binding.ATOM) if node in self._names else self._operation(node)

    def _operation(self, node: int) -> Text:
        program, op = self._program, Op(self._program.ops[node])
        if op is Op.INPUT:
            return self._names[node], Binding.ATOM
        if op is Op.CONSTANT:
            return self._constant(program.constants[node])
        a = self._text(program.lhs[node])
        if op is Op.NEG:
            return f"-{_at_least(Binding.PRODUCT, a)}", Binding.SIGN
        if op >= Op.SIN:
            return self._function(op, a[0]), Binding.ATOM
        b = self._text(program.rhs[node])
        if op in (Op.ADD, Op.SUB):
            return _sum(op, a, b), Binding.SUM
        if op is Op.MUL:
            a, b = _factors(a, b, number=program.rhs[node] in program.constants)
        sign = "*" if op is Op.MUL else "/"
        return f"{_at_least(Binding.PRODUCT, a)}{sign}{_at_least(Binding.ATOM, b)}", Binding.PRODUCT

    def _constant(self, value: Number) -> Text:
        if is_negative(value):
            return f"-{self._number(-value)}", Binding.SIGN
        return self._number(value), Binding.ATOM


def _at_least(binding: Binding, text: Text) -> str:
    return text[0] if text[1] >= binding else f"({text[0]})"


def _sum(op: Op, a: Text, b: Text) -> str:
    """With the sum or the negative term in front, where the order does not matter."""
    if op is Op.ADD and a[1] > b[1]:
        a, b = b, a
    if b[1] is Binding.SIGN:
        return f"{a[0]} {'-' if op is Op.ADD else '+'} {b[0][1:]}"
    return f"{a[0]} {'+' if op is Op.ADD else '-'} {_at_least(Binding.PRODUCT, b)}"


def _factors(a: Text, b: Text, *, number: bool) -> tuple[Text, Text]:
    """With a product in front, else with a number in front, so that parentheses are not needed."""
    if b[1] is Binding.PRODUCT or (number and a[1] is not Binding.PRODUCT):
        return b, a
    return a, b
