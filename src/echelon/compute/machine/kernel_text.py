"""Kernels as LLVM text: a function's values for a block of samples, one vector operation per recorded operation.

``@compute`` fills a column-major block: entry e of sample k at ``buffer[e·K + k]``.  Every operation is done for as
many samples at a time as a vector holds; the operations may be contracted (a·b + c in one rounding) but not reordered,
so the result of a sample does not depend on its place in the batch.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from echelon.algebra import Op, operands
from echelon.compute.machine.operations_text import (
    LARGE_FRAME,
    Code,
    Lowered,
    Vector,
    Writer,
    declarations,
    sincos,
)

DOUBLE = 8
"""Bytes of a double."""
LINE = 8
"""Doubles in a cache line, of 64 bytes."""
_STREAM = ", ptr noalias %from, ptr noalias %to"
_DECLARED = (
    "declare i64 @llvm.smin.i64(i64, i64)",
    "declare void @llvm.memcpy.p0.p0.i64(ptr, ptr, i64, i1)",
)


@dataclass(frozen=True)
class KernelBlock:
    """The shape of what a kernel writes."""

    lowered: Lowered
    vector: Vector
    samples: int  # K, a multiple of the vector's lanes
    # cache lines that are copied from ``%from`` to ``%to``, past the caches, between the operations on each vector:
    # memory is slower than the processor, so it must never wait
    streamed: int = 0

    @property
    def entries(self) -> int:
        """Columns of the block."""
        return len(self.lowered.function.entries)

    @property
    def doubles(self) -> int:
        """Doubles that the buffer must hold: the block, a column of zeros, and what the kernel keeps for itself."""
        inputs = sum(len(a) for a in self.lowered.function.arguments if not a.uniform)
        return self.padding + inputs * self.vector.lanes

    @property
    def waiting(self) -> int:
        """Offset in the buffer of the values that wait between parts."""
        return (self.entries + 1) * self.samples

    @property
    def padding(self) -> int:
        """Offset in the buffer of the rows of an incomplete vector."""
        return self.waiting + len(self.lowered.waiting) * self.vector.lanes

    @property
    def zeros(self) -> int:
        """Offset in the buffer of a column that stays zero."""
        return self.entries * self.samples


def kernel_text(block: KernelBlock) -> str:
    """Definitions of ``@compute`` and of all that it calls."""
    v = block.vector
    parts = [_part(block, number) for number in range(len(block.lowered.parts))]
    return "\n".join([sincos(v), *declarations(v), *_DECLARED, *parts, _compute(block)])


# -- parts ---------------------------------------------------------------------------------------------------------


def _part(block: KernelBlock, number: int) -> str:
    """One part: reads the rows of the inputs and values that wait, writes its outputs and values for later parts."""
    lowered, v = block.lowered, block.vector
    writer = Writer(lowered, v)
    code, nodes = writer.code, lowered.parts[number]
    read = {a for n in nodes for a in operands(lowered.program, n)}
    _load_columns(writer, read)
    for node in sorted(read & lowered.waiting.keys() - set(nodes)):
        writer.names[node] = code.load(v.type, _waiting(code, block, node))
    before = sum(len(part) for part in lowered.parts[:number])
    for done, node in enumerate(nodes, before):
        _stream(code, block, done)
        writer.operation(node)
        for entry in lowered.places.get(node, ()):
            _store_entry(writer, block, entry, node)
        if node in lowered.waiting:
            value = f"{v.type} {writer.value(node)}"
            code.store(_waiting(code, block, node), value)
    return (
        f"define internal void @part{number}(ptr noalias %rows, ptr noalias %uniforms, ptr noalias %waiting, "
        f"ptr noalias %out{_STREAM if block.streamed else ''}) noinline {LARGE_FRAME} "
        f"{{\nentry:\n{code.text()}\n  ret void\n}}\n"
    )


def _stream(code: Code, block: KernelBlock, done: int) -> None:
    """Copy the cache lines that are due before one of the operations on a vector, past the caches."""
    total = block.lowered.length
    for line in range(
        done * block.streamed // total, (done + 1) * block.streamed // total
    ):
        source, target = (code.at(end, line * LINE) for end in ("%from", "%to"))
        value = code.let(f"load <8 x double>, ptr {source}, align 8")
        code.do(f"store <8 x double> {value}, ptr {target}, align 64, !nontemporal !1")


def _waiting(code: Code, block: KernelBlock, node: int) -> str:
    return code.at("%waiting", block.lowered.waiting[node], block.vector.type)


def _store_entry(writer: Writer, block: KernelBlock, entry: int, node: int) -> None:
    writer.code.store(
        writer.code.at("%out", entry * block.samples),
        f"{block.vector.type} {writer.value(node)}",
    )


def _load_columns(writer: Writer, nodes: Collection[int]) -> None:
    """Inputs among some nodes: a column of an argument for the samples of one vector each."""
    columns = writer.lowered.columns
    wanted = [node for node in sorted(nodes) if node in columns]
    rows: dict[int, list[str]] = {}
    code, v = writer.code, writer.vector
    for node in wanted:
        argument, column = columns[node]
        if argument not in rows:
            rows[argument] = _row_pointers(code, v, argument)
        result = "undef"
        for lane, row in enumerate(rows[argument]):
            value = code.load("double", code.at(row, column))
            result = code.let(
                f"insertelement {v.type} {result}, double {value}, i32 {lane}"
            )
        writer.names[node] = result


def _row_pointers(code: Code, v: Vector, argument: int) -> list[str]:
    """Addresses of an argument's rows; every third is a base, so that the others fit addressing modes."""
    row = code.let(
        f"load ptr, ptr {code.let(f'getelementptr {{ ptr, i64 }}, ptr %rows, i64 {argument}')}"
    )
    step_at = code.let(
        f"getelementptr {{ ptr, i64 }}, ptr %rows, i64 {argument}, i32 1"
    )
    step = code.load("i64", step_at)
    pointers = [row]
    for lane in range(1, v.lanes):
        base = pointers[lane - lane % 3] if lane % 3 else pointers[lane - 3]
        factor = lane % 3 or 3
        offset = code.let(f"mul i64 {step}, {factor}")
        pointers.append(code.at(base, offset, "i8"))
    return pointers


# -- the loop over a block ------------------------------------------------------------------------------------------


def _compute(block: KernelBlock) -> str:
    """``@compute``: all parts for one vector of samples after the other; beyond the last sample it is repeated."""
    v, code = block.vector, Code()
    sizes = [len(a) for a in block.lowered.function.arguments if not a.uniform]
    code.do(f"%rows = alloca [{max(len(sizes), 1)} x {{ ptr, i64 }}], align 64")
    end = code.let("add i64 %first, %count")
    last = code.let(f"sub i64 {end}, 1")
    waiting = code.at("%buffer", block.waiting)
    padding = code.at("%buffer", block.padding)
    code.do("br label %loop")
    code.label("loop")
    code.do("%k = phi i64 [ 0, %entry ], [ %next, %ready ]")
    start = code.let("add i64 %first, %k")
    beyond = code.let(f"add i64 {start}, {v.lanes}")
    full = code.let(f"icmp sle i64 {beyond}, {end}")
    code.do(f"br i1 {full}, label %full, label %partial")
    code.label("full")
    for argument in range(len(sizes)):
        base, stride = _argument(code, argument)
        _set_rows(code, argument, _moved(code, base, start, stride), stride)
    code.do("br label %ready")
    code.label("partial")
    for argument, size in enumerate(sizes):
        _pad_rows(code, v, argument, size, start, last, padding)
        padding = code.at(padding, size * v.lanes)
    code.do("br label %ready")
    code.label("ready")
    code.do("%out = getelementptr double, ptr %buffer, i64 %k")
    for number in range(len(block.lowered.parts)):
        stream = ", ptr %from, ptr %to" if block.streamed else ""
        code.do(
            f"call void @part{number}(ptr %rows, ptr %uniforms, ptr {waiting}, ptr %out{stream})"
        )
    _store_the_rest(block, code)
    code.do(f"%next = add i64 %k, {v.lanes}")
    code.do(f"br i1 {code.let('icmp slt i64 %next, %count')}, label %loop, label %done")
    code.label("done")
    code.do("ret void")
    stream = _STREAM if block.streamed else ""
    return (
        "define void @compute(ptr %inputs, ptr %strides, ptr %uniforms, i64 %first, i64 %count, "
        f"ptr %buffer{stream}) {{\nentry:\n{code.text()}\n}}\n!0 = !{{}}\n!1 = !{{i32 1}}\n"
    )


def _argument(code: Code, argument: int) -> tuple[str, str]:
    """Address and stride of an argument."""
    base = code.load("ptr", code.at("%inputs", argument, "ptr"))
    stride = code.load("i64", code.at("%strides", argument, "i64"))
    return base, stride


def _moved(code: Code, base: str, sample: str, stride: str) -> str:
    offset = code.let(f"mul i64 {sample}, {stride}")
    return code.at(base, offset, "i8")


def _set_rows(code: Code, argument: int, base: str, stride: str) -> None:
    code.do(
        f"store ptr {base}, ptr {code.let(f'getelementptr {{ ptr, i64 }}, ptr %rows, i64 {argument}')}"
    )
    at = code.let(f"getelementptr {{ ptr, i64 }}, ptr %rows, i64 {argument}, i32 1")
    code.do(f"store i64 {stride}, ptr {at}")


def _pad_rows(
    code: Code, v: Vector, argument: int, size: int, start: str, last: str, padding: str
) -> None:
    """The rows of an incomplete vector, copied; the last one is repeated."""
    base, stride = _argument(code, argument)
    for lane in range(v.lanes):
        sample = code.let(f"add i64 {start}, {lane}")
        row = _moved(
            code,
            base,
            code.let(f"call i64 @llvm.smin.i64(i64 {sample}, i64 {last})"),
            stride,
        )
        target = code.at(padding, lane * size)
        code.do(
            f"call void @llvm.memcpy.p0.p0.i64(ptr {target}, ptr {row}, i64 {size * DOUBLE}, i1 false)"
        )
    _set_rows(code, argument, padding, str(size * DOUBLE))


def _store_the_rest(block: KernelBlock, code: Code) -> None:
    """Entries that no part computes: inputs, constants and uniform values."""
    lowered = block.lowered
    writer = Writer(lowered, block.vector)
    writer.code = code
    done = {n for part in lowered.parts for n in part}
    rest = {
        node: entries for node, entries in lowered.places.items() if node not in done
    }
    _load_columns(writer, rest)
    for node, entries in rest.items():
        for entry in entries:
            _store_entry(writer, block, entry, node)


# -- what is the same for all samples ----------------------------------------------------------------------------------


def prepare_text(lowered: Lowered) -> str:
    """The definition of ``@prepare``, which computes the uniform values from the uniform arguments."""
    scalar = Vector(1)
    writer = Writer(lowered, scalar)
    code, program = writer.code, lowered.program
    arguments = [a for a in lowered.function.arguments if a.uniform]
    place = {node: i for i, node in enumerate(n for a in arguments for n in a.nodes)}
    for node in program.needed(lowered.uniform):
        if program.ops[node] == Op.INPUT:
            writer.names[node] = code.load("double", code.at("%given", place[node]))
        elif program.ops[node] != Op.CONSTANT:
            writer.operation(node)
    for i, node in enumerate(lowered.uniform):
        code.store(code.at("%uniforms", i), f"double {writer.value(node)}")
    head = f"define void @prepare(ptr %given, ptr %uniforms) {LARGE_FRAME} {{\nentry:\n"
    return "\n".join([*declarations(scalar), f"{head}{code.text()}\n  ret void\n}}\n"])
