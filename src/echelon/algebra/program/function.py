"""A function: a program with named arguments and one result, ready for machine code or source text.

Programs know nodes; functions know which input is which entry of which argument, so that every evaluator and every
printer agrees on shapes and orders.

The order of operations is the same for machine code and source text.  They go depth first from the results, so that
values are used soon after they are made and live in registers.  Long functions are cut into parts, because compilers
take more than linear time for one long function; values that are made in one part and used in a later one wait in
memory.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

from echelon.algebra.program.derivatives import dependent
from echelon.algebra.program.operations import Op
from echelon.algebra.program.tape import Program
from echelon.shared import EchelonError


@dataclass(frozen=True)
class Argument:
    """One vector argument."""

    name: str  # identifier, ``"q"``
    nodes: tuple[
        int, ...
    ]  # input nodes of the program, in the order of the vector's entries
    labels: tuple[str, ...]  # what each entry is, ``"joint1"``
    units: tuple[str, ...]  # SI unit of each entry
    meaning: str = ""  # for documentation
    # whether it is the same for all samples of a batch (parameters, geometry) and not a column per sample
    uniform: bool = False

    def __len__(self) -> int:
        return len(self.nodes)


@dataclass(frozen=True)
class Function:
    """A straight-line function of some vectors.

    >>> program = Program()
    >>> x = program.input("x")
    >>> argument = Argument("x", (x.node,), ("x",), ("m",))
    >>> square = Function("square", program, (argument,), {(0,): (x * x).node}, (("x²",),), ("m²",))
    >>> square.shape
    (1,)
    """

    name: str  # identifier, ``"inverse_dynamics"``
    program: Program
    arguments: tuple[
        Argument, ...
    ]  # every input that the result depends on is in one of them
    entries: Mapping[
        tuple[int, ...], int
    ]  # node of every entry of the result that is not structurally zero
    # what the indices of the result count, one tuple of labels per axis: outputs, parameters, coordinates
    axes: tuple[tuple[str, ...], ...]
    units: tuple[
        str, ...
    ] = ()  # SI unit along the first axis of the result (empty where it does not apply)
    meaning: str = ""  # for documentation

    def __post_init__(self) -> None:
        known = {node for argument in self.arguments for node in argument.nodes}
        missing = [
            n for n in self.needed if self.program.ops[n] == Op.INPUT and n not in known
        ]
        if missing:
            names = ", ".join(self.program.inputs[n].name for n in missing)
            raise EchelonError(
                f"function '{self.name}' has no argument that holds {names}"
            )

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the result for one sample."""
        return tuple(len(axis) for axis in self.axes)

    @property
    def outputs(self) -> tuple[int, ...]:
        """Nodes of the entries, in their order."""
        return tuple(self.entries.values())

    @cached_property
    def needed(self) -> list[int]:
        """Nodes that the result depends on, in order."""
        return self.program.needed(self.entries.values())

    @cached_property
    def varying(self) -> frozenset[int]:
        """Needed nodes that change from sample to sample; the others depend on uniform arguments and constants only."""
        uniform = {
            node
            for argument in self.arguments
            if argument.uniform
            for node in argument.nodes
        }
        inputs = [
            n
            for n in self.needed
            if self.program.ops[n] == Op.INPUT and n not in uniform
        ]
        return frozenset(dependent(self.program, self.needed, inputs))

    def operations(self) -> dict[str, int]:
        """Operations per sample, by kind: those that only uniform arguments enter are done once and not counted."""
        counts: dict[str, int] = {}
        for node in sorted(self.varying):
            if self.program.ops[node] != Op.INPUT:
                name = Op(self.program.ops[node]).name
                counts[name] = counts.get(name, 0) + 1
        return dict(sorted(counts.items()))

    def __repr__(self) -> str:
        inner = ", ".join(argument.name for argument in self.arguments)
        return f"Function({self.name}({inner}) → {' × '.join(map(str, self.shape))}, {len(self.entries)} entries)"


T = TypeVar("T")


def operands(program: Program, node: int) -> tuple[int, ...]:
    """The nodes that a node refers to."""
    a, b = program.lhs[node], program.rhs[node]
    return () if a < 0 else (a,) if b < 0 else (a, b)


def depth_first(
    outputs: Iterable[int],
    inner: Callable[[int], Sequence[int]],
    done: set[int] | None = None,
) -> Iterator[int]:
    """Nodes in the order in which a walk from the outputs completes them.

    ``inner`` tells the nodes that have to be completed before a node.  Those that are ``done`` are left out, and what
    the walk completes is added to them.
    """
    done = set() if done is None else done
    for output in outputs:
        pending = [(output, False)]
        while pending:
            node, ready = pending.pop()
            if node in done:
                continue
            before = () if ready else inner(node)
            if before:
                pending.append((node, True))
                pending += [(other, False) for other in reversed(before)]
            else:
                done.add(node)
                yield node


def cut(items: Sequence[T], longest: int) -> tuple[tuple[T, ...], ...]:
    """Parts of at most ``longest`` items."""
    return tuple(
        tuple(items[start : start + longest]) for start in range(0, len(items), longest)
    )


def waiting_places(
    made: Sequence[Iterable[int]], used: Sequence[Collection[int]]
) -> dict[int, int]:
    """Places in memory for the nodes that are made in one part and used in a later one."""
    home = {node: number for number, part in enumerate(made) for node in part}
    crossing = dict.fromkeys(
        node
        for number, part in enumerate(used)
        for node in part
        if home.get(node, number) < number
    )
    return {node: place for place, node in enumerate(crossing)}
