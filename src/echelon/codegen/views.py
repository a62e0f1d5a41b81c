"""Views for templates: a planned function as lines of text in one language.

Nodes are written as expressions with no more parentheses than the order of operations needs.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from enum import IntEnum
from itertools import product
from math import prod
from sys import maxsize

from echelon.algebra import Argument, Function, Number, Op, Program, is_negative
from echelon.codegen.language import Language, Precision
from echelon.codegen.plan import (
    LONGEST_PART,
    FunctionPlan,
    Statement,
    homes,
    plan,
    used_names,
)


class Binding(IntEnum):
    """How tightly the outermost operation of an expression binds."""

    SUM = 1
    SIGN = 2
    PRODUCT = 3
    ATOM = 4


Text = tuple[str, Binding]


class NodePrinter:
    """Prints nodes of one program."""

    def __init__(
        self,
        program: Program,
        names: Mapping[int, str],
        language: Language,
        precision: Precision,
    ) -> None:
        self._program, self._names = program, names
        self._language, self._precision = language, precision

    def definition(self, node: int) -> str:
        """The operation of a node, also if the node itself has a name."""
        return self._operation(node)[0]

    def reference(self, node: int) -> str:
        """The name of a node, or its operation."""
        return self._text(node)[0]

    def _text(self, node: int) -> Text:
        if node in self._names:
            return self._names[node], Binding.ATOM
        return self._operation(node)

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
            return self._language.call(op, a[0], self._precision), Binding.ATOM
        b = self._text(program.rhs[node])
        if op in (Op.ADD, Op.SUB):
            return _sum(op, a, b), Binding.SUM
        if op is Op.MUL:
            a, b = _factors(a, b, number=program.rhs[node] in program.constants)
        sign = "*" if op is Op.MUL else "/"
        return (
            f"{_at_least(Binding.PRODUCT, a)}{sign}{_at_least(Binding.ATOM, b)}",
            Binding.PRODUCT,
        )

    def _constant(self, value: Number) -> Text:
        size = self._language.literal(
            -value if is_negative(value) else value, self._precision
        )
        if is_negative(value):
            return f"-{size}", Binding.SIGN
        return size, Binding.ATOM


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


WORK = "w"  # the array in which parts of a function pass values on

LANES = 4  # angles whose sines and cosines are computed at once

MOST_ZEROS = 24
"""Entries that are always zero, up to which each is assigned; of more, all entries are cleared first."""


@dataclass(frozen=True)
class Trig:
    """A sine or cosine that a part uses."""

    name: str  # ``"s2"``
    kind: str  # ``"sine"`` or ``"cosine"``
    index: int  # place of the angle in the vector of angles, from 0


@dataclass(frozen=True)
class PartView:
    """Consecutive statements."""

    arguments: tuple[Argument, ...]  # those that the statements use
    trig: tuple[Trig, ...]
    names: tuple[str, ...]  # that the lines define, for languages that declare first
    lines: tuple[str, ...]
    writes: bool  # whether entries of the result are among them
    shares: bool  # whether values are passed to or from other parts

    @property
    def passed(self) -> list[str]:
        """Arguments with which a part is called."""
        names = [argument.name for argument in self.arguments]
        if self.trig:
            names += ["sine", "cosine"]
        if self.shares:
            names.append(WORK)
        if self.writes:
            names.append("result")
        return names


@dataclass(frozen=True)
class FunctionView:
    """A function in one language."""

    function: Function
    unused: tuple[Argument, ...]  # arguments without influence on the result
    angles: tuple[
        str, ...
    ]  # expressions of the angles whose sines and cosines are needed
    parts: tuple[PartView, ...]
    slots: int  # number of values that parts share
    fills: bool  # whether the result is to be filled with zeros first

    @property
    def name(self) -> str:
        """The function's name."""
        return self.function.name

    @property
    def arguments(self) -> tuple[Argument, ...]:
        """The function's arguments."""
        return self.function.arguments

    @property
    def places(self) -> int:
        """Length of the vectors of sines and cosines, a multiple of :data:`LANES`."""
        return -(-len(self.angles) // LANES) * LANES

    @property
    def blocks(self) -> range:
        """Where blocks of :data:`LANES` angles start."""
        return range(0, self.places, LANES)

    @property
    def size(self) -> int:
        """Number of entries of the result."""
        return prod(self.function.shape)


def view(function: Function, language: Language, precision: Precision) -> FunctionView:
    """Print a function."""
    planned = plan(function, LONGEST_PART if language.splits else maxsize)
    places = () if language.zeroed else product(*map(range, function.shape))
    empty = [place for place in places if place not in function.entries]
    fills = len(empty) > MOST_ZEROS
    printer = _Printer(planned, language, precision)
    parts = [printer.part(k) for k in range(len(planned.parts))]
    if empty and not fills:
        zero = language.literal(0, precision)
        zeros = tuple(
            language.assign.format(
                name=language.result_at(i, function.shape), value=zero
            )
            for i in empty
        )
        first = (
            parts[0] if parts else PartView((), (), (), (), writes=True, shares=False)
        )
        parts[:1] = [replace(first, lines=zeros + first.lines, writes=True)]
    angles = tuple(
        printer.expressions({}).reference(angle.node) for angle in planned.angles
    )
    used = {a.name for part in parts for a in part.arguments} | printer.arguments_of(
        a.node for a in planned.angles
    )
    unused = tuple(a for a in function.arguments if a.name not in used)
    return FunctionView(
        function, unused, angles, tuple(parts), len(planned.slots), fills
    )


class _Printer:
    def __init__(
        self, planned: FunctionPlan, language: Language, precision: Precision
    ) -> None:
        self._plan, self._language, self._precision = planned, language, precision
        self._program = planned.function.program
        self._owner: dict[int, Argument] = {}
        self._inputs: dict[int, str] = {}
        for argument in planned.function.arguments:
            for k, node in enumerate(argument.nodes):
                self._owner[node] = argument
                self._inputs[node] = language.at(argument.name, k)
        self._home = homes(planned.parts)
        self._slots = {n: language.at(WORK, slot) for n, slot in planned.slots.items()}
        self._places = {angle.node: k for k, angle in enumerate(planned.angles)}

    def expressions(self, names: Mapping[int, str]) -> NodePrinter:
        return NodePrinter(
            self._program, {**self._inputs, **names}, self._language, self._precision
        )

    def arguments_of(self, nodes: Iterable[int]) -> set[str]:
        needed = self._program.needed(nodes)
        return {self._owner[n].name for n in needed if n in self._owner}

    def part(self, number: int) -> PartView:
        """One part as text."""
        planned, slots = self._plan, self._slots
        passed = {n: slot for n, slot in slots.items() if self._home[n] != number}
        names = {**planned.names, **passed}
        expressions = self.expressions(names)
        statements = planned.parts[number]
        lines = [line for s in statements for line in self._lines(s, expressions)]
        used = used_names(self._program, statements, planned.names)
        owners = {self._owner[n].name for n in used if n in self._owner}
        return PartView(
            tuple(a for a in planned.function.arguments if a.name in owners),
            self._trig(used),
            tuple(planned.names[s.node] for s in statements if s.entry is None),
            tuple(lines),
            writes=any(s.entry is not None for s in statements),
            shares=any(n in slots for n in used)
            or any(s.node in slots for s in statements),
        )

    def _lines(self, statement: Statement, expressions: NodePrinter) -> list[str]:
        language, node = self._language, statement.node
        if statement.entry is not None:
            target = language.result_at(statement.entry, self._plan.function.shape)
            return [
                language.assign.format(name=target, value=expressions.reference(node))
            ]
        real, name = language.real[self._precision], self._plan.names[node]
        lines = [
            language.define.format(
                real=real, name=name, value=expressions.definition(node)
            )
        ]
        if node in self._slots:
            lines.append(language.assign.format(name=self._slots[node], value=name))
        return lines

    def _trig(self, used: Iterable[int]) -> tuple[Trig, ...]:
        names = self._plan.names
        places = self._places
        kinds = {Op.SIN: "sine", Op.COS: "cosine"}
        found = []
        for node in used:
            op, angle = self._program.ops[node], self._program.lhs[node]
            if (
                node in names
                and op in kinds
                and angle in places
                and node not in self._home
            ):
                found.append(Trig(names[node], kinds[Op(op)], places[angle]))
        return tuple(sorted(found, key=lambda trig: (trig.index, trig.kind != "sine")))
