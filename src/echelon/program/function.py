"""A function: a program with named arguments and one result, ready for machine code or source text.

Programs know nodes; functions know which input is which entry of which argument, so that every evaluator and every
printer agrees on shapes and orders.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from echelon.errors import EchelonError
from echelon.program.derivatives import dependent
from echelon.program.operations import Op
from echelon.program.tape import Program


@dataclass(frozen=True)
class Argument:
    """One vector argument."""

    name: str  # identifier, ``"q"``
    nodes: tuple[int, ...]  # input nodes of the program, in the order of the vector's entries
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
    arguments: tuple[Argument, ...]  # every input that the result depends on is in one of them
    entries: Mapping[tuple[int, ...], int]  # node of every entry of the result that is not structurally zero
    # what the indices of the result count, one tuple of labels per axis: outputs, parameters, coordinates
    axes: tuple[tuple[str, ...], ...]
    units: tuple[str, ...] = ()  # SI unit along the first axis of the result (empty where it does not apply)
    meaning: str = ""  # for documentation

    def __post_init__(self) -> None:
        known = {node for argument in self.arguments for node in argument.nodes}
        missing = [n for n in self.needed if self.program.ops[n] == Op.INPUT and n not in known]
        if missing:
            names = ", ".join(self.program.inputs[n].name for n in missing)
            raise EchelonError(f"function '{self.name}' has no argument that holds {names}")

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
        uniform = {node for argument in self.arguments if argument.uniform for node in argument.nodes}
        inputs = [n for n in self.needed if self.program.ops[n] == Op.INPUT and n not in uniform]
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
