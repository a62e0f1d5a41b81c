"""Which of a function's operations get a name, and the statements that a source file consists of.

Where there are many results (regressors), operations stand in depth-first order from the results, so that few values
are alive at a time.  Where there are few (inverse dynamics), they stand in the order of recording, which alternates
between independent chains.  The better one of both is 5 to 10 % faster in compiled C.

What is used once becomes part of the expression that uses it, up to a length that a person can read; what is used more
often gets a name.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from echelon.algebra import (
    Function,
    Op,
    Program,
    cut,
    depth_first,
    operands,
    waiting_places,
)

LONGEST_PART = 1000
"""Statements of one part: compilers take time that grows with the square."""
FEW_RESULTS = 8
"""Operations for each result, beyond which they are written as they were recorded, not result by result."""
MOST_LEAVES = 8
"""Names and numbers in one expression: it still fits a line."""
MOST_LEAVES_OF_ANGLE = 12
"""Names and numbers in an angle whose sine and cosine are computed first."""
_ARITHMETIC = (Op.ADD, Op.SUB, Op.MUL, Op.NEG, Op.DIV)


@dataclass(frozen=True)
class NamedAngle:
    """An angle whose sine or cosine is needed."""

    node: int  # the argument of the sine and cosine
    # follows ``s`` and ``c`` in their names: the number of the coordinate, from 1, or ``a1`` … for other angles
    label: str


@dataclass(frozen=True)
class Statement:
    """One assignment: to an entry of the result, or to a name where there is no entry."""

    node: int
    entry: tuple[int, ...] | None = None


@dataclass(frozen=True)
class FunctionPlan:
    """How a function is written."""

    function: Function
    angles: tuple[NamedAngle, ...]  # their sines and cosines come first, all at once
    parts: tuple[tuple[Statement, ...], ...]
    names: Mapping[
        int, str
    ]  # what named nodes are called: temporaries, sines and cosines
    slots: Mapping[
        int, int
    ]  # for temporaries that a later part uses, their place in the array that parts share


def plan(function: Function, longest_part: int) -> FunctionPlan:
    """Order a function's operations, with a new part after every ``longest_part`` statements."""
    angles = _angles(function)
    names = _sines_and_cosines(function, angles)
    writer = _Writer(function, names)
    if FEW_RESULTS * len(function.entries) < len(function.needed):
        writer.prepare(function.program.needed(function.outputs, names))
    for entry, node in function.entries.items():
        writer.write(entry, node)
    names |= {
        s.node: f"t{k}"
        for k, s in enumerate((s for s in writer.statements if s.entry is None), 1)
    }
    parts = cut(writer.statements, longest_part)
    made = [[s.node for s in part if s.entry is None] for part in parts]
    used = [used_names(function.program, part, names) for part in parts]
    return FunctionPlan(function, angles, parts, names, waiting_places(made, used))


def homes(parts: Sequence[Sequence[Statement]]) -> dict[int, int]:
    """For every temporary, the number of the part that it is written in."""
    return {s.node: k for k, part in enumerate(parts) for s in part if s.entry is None}


# -- angles ------------------------------------------------------------------------------------------------------------


def _angles(function: Function) -> tuple[NamedAngle, ...]:
    """Arguments of sines and cosines that are coordinates or short expressions in inputs."""
    program = function.program
    found = dict.fromkeys(
        program.lhs[n] for n in function.needed if program.ops[n] in (Op.SIN, Op.COS)
    )
    simple = [n for n in found if _inlined_leaves(program, n, MOST_LEAVES_OF_ANGLE) > 0]
    place = {
        node: k
        for a in function.arguments
        if a.name == "q"
        for k, node in enumerate(a.nodes, 1)
    }
    joints = sorted((n for n in simple if n in place), key=place.__getitem__)
    others = [n for n in simple if n not in place]
    named = [NamedAngle(n, str(place[n])) for n in joints]
    return (*named, *(NamedAngle(n, f"a{k}") for k, n in enumerate(others, 1)))


def _inlined_leaves(program: Program, node: int, most: int) -> int:
    """Leaves of a node as one arithmetic expression; 0 if there are too many, or functions among them."""
    pending, leaves = [node], 0
    while pending:
        n = pending.pop()
        if program.ops[n] in _ARITHMETIC:
            pending += operands(program, n)
        elif program.ops[n] >= Op.SIN:
            return 0
        else:
            leaves += 1
        if leaves + len(pending) > most:
            return 0
    return leaves


def _sines_and_cosines(
    function: Function, angles: Sequence[NamedAngle]
) -> dict[int, str]:
    program, label = function.program, {angle.node: angle.label for angle in angles}
    stems = {Op.SIN: "s", Op.COS: "c"}
    nodes = [
        n
        for n in function.needed
        if program.ops[n] in stems and program.lhs[n] in label
    ]
    return {n: stems[Op(program.ops[n])] + label[program.lhs[n]] for n in nodes}


# -- statements --------------------------------------------------------------------------------------------------------


class _Writer:
    """Writes statements and decides what is inlined."""

    def __init__(self, function: Function, given: Mapping[int, str]) -> None:
        self._program = function.program
        self._given = given
        self._uses = self._count_uses(function)
        self._leaves: dict[int, int] = {}
        self._done: set[int] = set()
        self.statements: list[Statement] = []

    def prepare(self, nodes: Iterable[int]) -> None:
        """Write operations in a given order."""
        for node in nodes:
            self._done.add(node)
            self._finish(node, self._operands(node))

    def write(self, entry: tuple[int, ...], root: int) -> None:
        """Write what an entry of the result needs, in depth-first order, and the entry."""
        self.prepare(depth_first([root], self._operands, self._done))
        self.statements.append(Statement(root, entry))

    def _operands(self, node: int) -> tuple[int, ...]:
        return () if node in self._given else operands(self._program, node)

    def _count_uses(self, function: Function) -> dict[int, int]:
        uses: dict[int, int] = {}
        pending = list(function.entries.values())
        while pending:
            node = pending.pop()
            uses[node] = uses.get(node, 0) + 1
            if uses[node] == 1:
                pending += self._operands(node)
        return uses

    def _finish(self, node: int, inner: tuple[int, ...]) -> None:
        """Name a node that is used more than once, and operands that would make its expression too long."""
        for child in sorted(inner, key=self._leaves.__getitem__, reverse=True):
            if (
                sum(self._leaves[n] for n in inner) > MOST_LEAVES
                and self._leaves[child] > 1
            ):
                self._name(child)
        self._leaves[node] = sum(self._leaves[n] for n in inner) or 1
        if inner and self._uses[node] > 1 and self._program.ops[node] != Op.NEG:
            self._name(node)

    def _name(self, node: int) -> None:
        self.statements.append(Statement(node))
        self._leaves[node] = 1


def used_names(
    program: Program, statements: Sequence[Statement], names: Mapping[int, str]
) -> list[int]:
    """Named nodes and inputs that the expressions of some statements refer to, each once."""
    found: dict[int, None] = {}
    for statement in statements:
        root = statement.node
        whole = statement.entry is None or root not in names
        pending = (
            list(operands(program, root))
            if whole and program.lhs[root] >= 0
            else [root]
        )
        while pending:
            node = pending.pop()
            if node in names or program.ops[node] == Op.INPUT:
                found[node] = None
            else:
                pending += operands(program, node)
    return list(found)
