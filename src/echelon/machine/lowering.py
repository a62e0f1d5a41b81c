"""From a function to straight-line kernels: what is computed when, and where values wait.

Operations go in depth-first order of the outputs, so that values are used soon after they are made and live in
registers.  Long programs are cut into parts of bounded size, because the time of a code generator grows faster than
the length of a function; values that cross a cut wait in memory.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from functools import cached_property

from echelon.program.function import Function
from echelon.program.operations import Op
from echelon.program.tape import Program

_LONGEST = 3000  # operations in one function
_PART = 1500  # operations in one part of a longer one


@dataclass(frozen=True)
class Lowered:
    """A function's operations in the order in which a kernel does them.

    Attributes
    ----------
    function : Function
    uniform : tuple of int
        Nodes that are the same for all samples and that the kernel reads: constants are not among them.
    parts : tuple of tuple of int
        Nodes that change from sample to sample (inputs left out), in the order of computation, cut into parts.
    """

    function: Function
    uniform: tuple[int, ...]
    parts: tuple[tuple[int, ...], ...]

    @property
    def program(self) -> Program:
        """The function's program."""
        return self.function.program

    @cached_property
    def columns(self) -> dict[int, tuple[int, int]]:
        """For each input node, its argument among those that vary, and its place there."""
        varying = [a for a in self.function.arguments if not a.uniform]
        return {node: (i, k) for i, argument in enumerate(varying) for k, node in enumerate(argument.nodes)}

    @cached_property
    def length(self) -> int:
        """Operations in all parts."""
        return sum(len(part) for part in self.parts)

    @cached_property
    def places(self) -> dict[int, list[int]]:
        """For each output node, the entries of the result that it is."""
        found: dict[int, list[int]] = {}
        for entry, node in enumerate(self.function.outputs):
            found.setdefault(node, []).append(entry)
        return found

    @cached_property
    def last_part(self) -> dict[int, int]:
        """For each node of a part, the last part that reads it."""
        found: dict[int, int] = {}
        for number, part in enumerate(self.parts):
            for node in part:
                for operand in (self.program.lhs[node], self.program.rhs[node]):
                    found[operand] = number
        return found

    @cached_property
    def waiting(self) -> dict[int, int]:
        """Places in memory of the nodes that a later part reads."""
        crossing = [n for number, part in enumerate(self.parts) for n in part if self.last_part.get(n, -1) > number]
        return {node: place for place, node in enumerate(crossing)}


def lowered(function: Function, longest: int = _LONGEST, part: int = _PART) -> Lowered:
    """Order and cut a function's operations.

    Parameters
    ----------
    function : Function
    longest : int
        Operations that are still done in one part.
    part : int
        Operations in each part of longer ones.
    """
    program, varying = function.program, function.varying
    order = _depth_first(program, function.outputs, varying)
    size = part if len(order) > longest else max(len(order), 1)
    parts = tuple(tuple(order[start : start + size]) for start in range(0, len(order), size))
    read = {operand for node in order for operand in (program.lhs[node], program.rhs[node]) if operand >= 0}
    read |= set(function.outputs)
    uniform = [n for n in sorted(read) if n not in varying and program.ops[n] != Op.CONSTANT]
    return Lowered(function, tuple(uniform), parts)


def _depth_first(program: Program, outputs: Iterable[int], within: Collection[int]) -> list[int]:
    """Nodes in the order in which a depth-first walk from the outputs completes them, inputs left out."""
    order: list[int] = []
    done: set[int] = set()
    for output in outputs:
        pending = [output]
        while pending:
            node = pending[-1]
            if node in done or node not in within or program.ops[node] == Op.INPUT:
                pending.pop()
                continue
            waiting = [a for a in (program.rhs[node], program.lhs[node]) if a >= 0 and _open(program, a, within, done)]
            if waiting:
                pending += waiting
            else:
                done.add(node)
                order.append(pending.pop())
    return order


def _open(program: Program, node: int, within: Collection[int], done: Collection[int]) -> bool:
    return node in within and node not in done and program.ops[node] != Op.INPUT
