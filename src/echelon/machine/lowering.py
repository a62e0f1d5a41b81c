"""A function's operations in the order in which a kernel does them, and where values wait between its parts."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from echelon.program.function import Function
from echelon.program.operations import Op
from echelon.program.order import cut, depth_first, operands, waiting_places
from echelon.program.tape import Program

_LONGEST = 3000  # operations in one function
_PART = 1500  # operations in one part of a longer one


@dataclass(frozen=True)
class Lowered:
    """A function as parts of a kernel."""

    function: Function
    # nodes that are the same for all samples and that the kernel reads: constants are not among them
    uniform: tuple[int, ...]
    # nodes that change from sample to sample (inputs left out), in the order of computation
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
    def waiting(self) -> dict[int, int]:
        """Places in memory of the nodes that a later part reads."""
        used = [[a for node in part for a in operands(self.program, node)] for part in self.parts]
        return waiting_places(self.parts, used)


def lowered(function: Function, longest: int = _LONGEST, part: int = _PART) -> Lowered:
    """Order a function's operations, and cut those longer than ``longest`` into parts."""
    program, varying = function.program, function.varying
    walk = depth_first(function.outputs, lambda node: operands(program, node) if node in varying else ())
    order = [node for node in walk if node in varying and program.ops[node] != Op.INPUT]
    read = {operand for node in order for operand in operands(program, node)} | set(function.outputs)
    uniform = [n for n in sorted(read) if n not in varying and program.ops[n] != Op.CONSTANT]
    return Lowered(function, tuple(uniform), cut(order, part if len(order) > longest else max(len(order), 1)))
