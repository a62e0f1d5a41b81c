"""What is the same for all samples, as LLVM text: done once for a batch, one double at a time."""

from __future__ import annotations

from echelon.machine.lowering import Lowered
from echelon.machine.operations_text import Writer, declared
from echelon.machine.text import LARGE_FRAME, Vector
from echelon.machine.trigonometry import declarations
from echelon.program.operations import Op


def prepare_text(lowered: Lowered) -> str:
    """The definition of ``@prepare``, which computes the uniform values from the uniform arguments."""
    scalar = Vector(1)
    writer = Writer(lowered, scalar)
    code, program = writer.code, lowered.program
    arguments = [a for a in lowered.function.arguments if a.uniform]
    place = {node: i for i, node in enumerate(n for a in arguments for n in a.nodes)}
    for node in program.needed(lowered.uniform):
        if program.ops[node] == Op.INPUT:
            pointer = code.let(f"getelementptr double, ptr %given, i64 {place[node]}")
            writer.names[node] = code.let(f"load double, ptr {pointer}")
        elif program.ops[node] != Op.CONSTANT:
            writer.operation(node)
    for i, node in enumerate(lowered.uniform):
        pointer = code.let(f"getelementptr double, ptr %uniforms, i64 {i}")
        code.do(f"store double {writer.value(node)}, ptr {pointer}")
    head = f"define void @prepare(ptr %given, ptr %uniforms) {LARGE_FRAME} {{\nentry:\n"
    return "\n".join([declarations(scalar), *declared(scalar), f"{head}{code.text()}\n  ret void\n}}\n"])
