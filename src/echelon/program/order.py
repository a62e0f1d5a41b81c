"""The order in which a function's operations are done, for machine code and source text alike.

Operations go depth first from the results, so that values are used soon after they are made and live in registers.
Long functions are cut into parts, because compilers take more than linear time for one long function; values that are
made in one part and used in a later one wait in memory.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from typing import TypeVar

from echelon.program.tape import Program

T = TypeVar("T")


def operands(program: Program, node: int) -> tuple[int, ...]:
    """The nodes that a node refers to."""
    a, b = program.lhs[node], program.rhs[node]
    return () if a < 0 else (a,) if b < 0 else (a, b)


def depth_first(
    outputs: Iterable[int], inner: Callable[[int], Sequence[int]], done: set[int] | None = None
) -> Iterator[int]:
    """Nodes in the order in which a walk from the outputs completes them, but those that are done; adds them to these.

    ``inner`` tells the nodes that have to be completed before a node.
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
    return tuple(tuple(items[start : start + longest]) for start in range(0, len(items), longest))


def waiting_places(made: Sequence[Iterable[int]], used: Sequence[Collection[int]]) -> dict[int, int]:
    """Places in memory for the nodes that are made in one part and used in a later one."""
    home = {node: number for number, part in enumerate(made) for node in part}
    crossing = dict.fromkeys(
        node for number, part in enumerate(used) for node in part if home.get(node, number) < number
    )
    return {node: place for place, node in enumerate(crossing)}
