"""What templates see: a planned function as lines of text in one language."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import product
from math import prod
from sys import maxsize

from echelon.codegen.expressions import Expressions
from echelon.codegen.language import Language, Precision
from echelon.codegen.plan import LONGEST_PART, Plan, Statement, coordinates, homes, plan, used_names
from echelon.program.function import Argument, Function
from echelon.program.operations import Op

WORK = "w"
"""The array in which parts of a function pass values on."""

LANES = 4
"""Angles whose sines and cosines are computed at once."""

_MOST_ZEROS = 24


@dataclass(frozen=True)
class Trig:
    """A sine or cosine that a part uses."""

    name: str  # ``"s2"``
    kind: str  # ``"sine"`` or ``"cosine"``
    index: int  # place of the angle, from 0: in the vector of angles, or in the window on q


@dataclass(frozen=True)
class PartView:
    """Consecutive statements."""

    arguments: tuple[Argument, ...]  # those that the statements use
    trig: tuple[Trig, ...]
    lines: tuple[str, ...]
    writes: bool  # whether entries of the result are among them
    shares: bool  # whether values are passed to or from other parts

    @property
    def passed(self) -> list[str]:
        """What a part is called with."""
        names = [argument.name for argument in self.arguments]
        names += ["sine", "cosine"] * bool(self.trig) + [WORK] * self.shares
        return names + ["result"] * self.writes


@dataclass(frozen=True)
class FunctionView:
    """A function in one language."""

    function: Function
    unused: tuple[Argument, ...]  # arguments without influence on the result
    angles: tuple[str, ...]  # expressions of the angles whose sines and cosines are needed
    # for languages that compute several sines at once, the consecutive entries of q that hold all angles, where there
    # are at least :data:`LANES`; code reads them in place, because gathering them first stalls processors
    window: range | None
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
        """Length of the vectors of sines and cosines, at least :data:`LANES` unless there are none."""
        if self.window is not None:
            return len(self.window)
        return -(-len(self.angles) // LANES) * LANES

    @property
    def blocks(self) -> list[int]:
        """Where blocks of :data:`LANES` angles start; the last may overlap the one before."""
        return [min(k, self.places - LANES) for k in range(0, self.places, LANES)]

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the result."""
        return self.function.shape

    @property
    def rank(self) -> int:
        """Number of axes of the result."""
        return len(self.function.shape)

    @property
    def size(self) -> int:
        """Number of entries of the result."""
        return prod(self.function.shape)


def view(function: Function, language: Language, precision: Precision) -> FunctionView:
    """Print a function."""
    planned = plan(function, LONGEST_PART if language.splits else maxsize)
    places = () if language.zeroed else product(*map(range, function.shape))
    empty = [place for place in places if place not in function.entries]
    fills = len(empty) > _MOST_ZEROS
    window = _window(planned) if language.windows else None
    printer = _Printer(planned, language, precision, window)
    parts = [printer.part(k) for k in range(len(planned.parts))]
    if empty and not fills:
        zero = language.literal(0, precision)
        zeros = tuple(language.assign.format(name=language.result_at(i, function.shape), value=zero) for i in empty)
        first = parts[0] if parts else PartView((), (), (), writes=True, shares=False)
        parts[:1] = [replace(first, lines=zeros + first.lines, writes=True)]
    angles = tuple(printer.expressions({}).reference(angle.node) for angle in planned.angles)
    used = {a.name for part in parts for a in part.arguments} | printer.arguments_of(a.node for a in planned.angles)
    unused = tuple(a for a in function.arguments if a.name not in used)
    return FunctionView(function, unused, angles, window, tuple(parts), len(planned.slots), fills)


def _window(planned: Plan) -> range | None:
    """The consecutive entries of q that hold all angles."""
    q = coordinates(planned.function)
    places = [q.index(angle.node) for angle in planned.angles if angle.node in q]
    if len(places) < len(planned.angles) or not places:
        return None
    first, last = min(places), max(places)
    first = max(0, min(first, last + 1 - LANES))
    last = min(len(q) - 1, max(last, first + LANES - 1))
    return range(first, last + 1) if last + 1 - first >= LANES else None


class _Printer:
    def __init__(self, planned: Plan, language: Language, precision: Precision, window: range | None) -> None:
        self._plan, self._language, self._precision = planned, language, precision
        self._program = planned.function.program
        self._owner: dict[int, Argument] = {}
        self._inputs: dict[int, str] = {}
        for argument in planned.function.arguments:
            for k, node in enumerate(argument.nodes):
                self._owner[node], self._inputs[node] = argument, language.at(argument.name, k)
        self._home = homes(planned.parts)
        self._slots = {n: language.at(WORK, slot) for n, slot in planned.slots.items()}
        angles = [angle.node for angle in planned.angles]
        listed = angles if window is None else coordinates(planned.function)[window.start : window.stop]
        self._places = {node: k for k, node in enumerate(listed)}

    def expressions(self, names: Mapping[int, str]) -> Expressions:
        language, precision = self._language, self._precision
        return Expressions(
            self._program,
            {**self._inputs, **names},
            lambda value: language.literal(value, precision),
            lambda op, x: language.call(op, x, precision),
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
            tuple(lines),
            writes=any(s.entry is not None for s in statements),
            shares=any(n in slots for n in used) or any(s.node in slots for s in statements),
        )

    def _lines(self, statement: Statement, expressions: Expressions) -> list[str]:
        language, node = self._language, statement.node
        if statement.entry is not None:
            target = language.result_at(statement.entry, self._plan.function.shape)
            return [language.assign.format(name=target, value=expressions.reference(node))]
        real, name = language.real[self._precision], self._plan.names[node]
        lines = [language.define.format(real=real, name=name, value=expressions.definition(node))]
        if node in self._slots:
            lines.append(language.assign.format(name=self._slots[node], value=name))
        return lines

    def _trig(self, used: Iterable[int]) -> tuple[Trig, ...]:
        names, places, kinds = self._plan.names, self._places, {Op.SIN: "sine", Op.COS: "cosine"}
        found = []
        for node in used:
            op, angle = self._program.ops[node], self._program.lhs[node]
            if node in names and op in kinds and angle in places and node not in self._home:
                found.append(Trig(names[node], kinds[Op(op)], places[angle]))
        return tuple(sorted(found, key=lambda trig: (trig.index, trig.kind != "sine")))
