"""Kernels as LLVM text: a function's values for a block of samples, one vector operation per recorded operation.

``@compute`` fills a column-major block: entry e of sample k at ``buffer[e·K + k]``.  Every operation is done for as
many samples at a time as a vector holds; the operations may be contracted (a·b + c in one rounding) but not reordered,
so the result of a sample does not depend on its place in the batch.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from echelon.machine.lowering import Lowered
from echelon.machine.text import Code, Vector
from echelon.machine.trigonometry import by_lane, declarations, sincos
from echelon.program.operations import Op

_BINARY = {Op.ADD: "fadd contract", Op.SUB: "fsub contract", Op.MUL: "fmul contract", Op.DIV: "fdiv"}
_LIBRARY = {Op.EXP: "exp", Op.LOG: "log", Op.TANH: "tanh", Op.ATAN: "atan"}
_DOUBLE = 8
_LINE = "<8 x double>"
_STREAM = ", ptr noalias %from, ptr noalias %to"
_DECLARED = (
    "declare i64 @llvm.smin.i64(i64, i64)",
    "declare void @llvm.memcpy.p0.p0.i64(ptr, ptr, i64, i1)",
)


@dataclass(frozen=True)
class Block:
    """The shape of what a kernel writes.

    Attributes
    ----------
    lowered : Lowered
    vector : Vector
    samples : int
        K, a multiple of the vector's lanes.
    streamed : int
        Cache lines that are copied from ``%from`` to ``%to``, past the caches, between the operations on each vector:
        memory is slower than the processor, so it must never wait.
    """

    lowered: Lowered
    vector: Vector
    samples: int
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


def kernel_text(block: Block) -> str:
    """Definitions of ``@compute`` and of all that it calls."""
    v = block.vector
    libraries = [f"declare double @{name}(double)" for name in _LIBRARY.values()]
    intrinsics = [f"declare {v.type} @llvm.sqrt.{v.suffix}({v.type})"]
    intrinsics += [f"declare {v.type} @llvm.copysign.{v.suffix}({v.type}, {v.type})"]
    parts = [_part(block, number) for number in range(len(block.lowered.parts))]
    return "\n".join([sincos(v), *libraries, *intrinsics, *_DECLARED, *parts, _compute(block)])


def prepare_text(lowered: Lowered) -> str:
    """The definition of ``@prepare``, which computes the uniform values from the uniform arguments."""
    writer = _Writer(lowered, Vector(1))
    arguments = [a for a in lowered.function.arguments if a.uniform]
    place = {node: i for i, node in enumerate(n for a in arguments for n in a.nodes)}
    program = lowered.program
    for node in program.needed(lowered.uniform):
        if program.ops[node] == Op.INPUT:
            pointer = writer.code.let(f"getelementptr double, ptr %given, i64 {place[node]}")
            writer.names[node] = writer.code.let(f"load double, ptr {pointer}")
        elif program.ops[node] != Op.CONSTANT:
            writer.operation(node)
    for i, node in enumerate(lowered.uniform):
        pointer = writer.code.let(f"getelementptr double, ptr %uniforms, i64 {i}")
        writer.code.do(f"store double {writer.value(node)}, ptr {pointer}")
    body = writer.code.text()
    scalar = Vector(1)
    head = [declarations(scalar), f"declare double @llvm.sqrt.{scalar.suffix}(double)"]
    head += [f"declare double @llvm.copysign.{scalar.suffix}(double, double)"]
    head += [f"declare double @{name}(double)" for name in _LIBRARY.values()]
    return "\n".join([*head, f"define void @prepare(ptr %given, ptr %uniforms) {{\nentry:\n{body}\n  ret void\n}}\n"])


class _Writer:
    """Writes operations on one vector type; remembers the names of values."""

    def __init__(self, lowered: Lowered, vector: Vector) -> None:
        self.lowered, self.vector = lowered, vector
        self.code = Code()
        self.names: dict[int, str] = {}
        self._pairs: dict[int, tuple[str, str]] = {}
        self._uniform = {node: i for i, node in enumerate(lowered.uniform)}

    def value(self, node: int) -> str:
        """The name of a node's value: a constant, a broadcast uniform value, or one that was computed."""
        constants = self.lowered.program.constants
        if node in constants:
            return self.vector.of(float(constants[node]))
        if node not in self.names:
            self.names[node] = self._broadcast(self._uniform[node])
        return self.names[node]

    def _broadcast(self, place: int) -> str:
        v, code = self.vector, self.code
        pointer = code.let(f"getelementptr double, ptr %uniforms, i64 {place}")
        scalar = code.let(f"load double, ptr {pointer}, !invariant.load !0")
        first = code.let(f"insertelement {v.type} undef, double {scalar}, i32 0")
        return code.let(f"shufflevector {v.type} {first}, {v.type} undef, <{v.lanes} x i32> zeroinitializer")

    def operation(self, node: int) -> None:
        """Write one operation."""
        program = self.lowered.program
        op, a = Op(program.ops[node]), self.value(program.lhs[node])
        if op in _BINARY:
            b = self.value(program.rhs[node])
            self.names[node] = self.code.let(f"{_BINARY[op]} {self.vector.type} {a}, {b}")
        else:
            self.names[node] = self._function(op, a, program.lhs[node])

    def _function(self, op: Op, a: str, operand: int) -> str:
        v, code = self.vector, self.code
        if op is Op.NEG:
            return code.let(f"fneg {v.type} {a}")
        if op in (Op.SIN, Op.COS, Op.TAN):
            s, c = self._sincos(operand, a)
            return s if op is Op.SIN else c if op is Op.COS else code.let(f"fdiv {v.type} {s}, {c}")
        if op is Op.SQRT:
            return code.let(f"call {v.type} @llvm.sqrt.{v.suffix}({v.type} {a})")
        if op is Op.ABS:
            return code.let(f"call {v.type} @llvm.fabs.{v.suffix}({v.type} {a})")
        if op is Op.SIGN:
            return self._sign(a)
        return by_lane(code, v, _LIBRARY[op], a)

    def _sincos(self, operand: int, a: str) -> tuple[str, str]:
        if operand not in self._pairs:
            v, code = self.vector, self.code
            if v.lanes == 1:
                self._pairs[operand] = by_lane(code, v, "sin", a), by_lane(code, v, "cos", a)
            else:
                pair = f"{{ {v.type}, {v.type} }}"
                both = code.let(f"call fastcc {pair} @sincos({v.type} {a})")
                s, c = (code.let(f"extractvalue {pair} {both}, {k}") for k in (0, 1))
                self._pairs[operand] = s, c
        return self._pairs[operand]

    def _sign(self, a: str) -> str:
        """−1, 0 or 1; NaN stays NaN."""
        v, code = self.vector, self.code
        one = code.let(f"call {v.type} @llvm.copysign.{v.suffix}({v.type} {v.of(1.0)}, {v.type} {a})")
        other = code.let(f"fcmp une {v.type} {a}, {v.of(0.0)}")
        number = code.let(f"fcmp ord {v.type} {a}, {v.of(0.0)}")
        nonzero = code.let(f"and {v.bits} {other}, {number}")
        return code.let(f"select {v.bits} {nonzero}, {v.type} {one}, {v.type} {a}")


# -- parts ---------------------------------------------------------------------------------------------------------


def _part(block: Block, number: int) -> str:
    """One part: reads the rows of the inputs and values that wait, writes its outputs and values for later parts."""
    lowered, v = block.lowered, block.vector
    writer = _Writer(lowered, v)
    code, nodes = writer.code, lowered.parts[number]
    operands = {a for n in nodes for a in (lowered.program.lhs[n], lowered.program.rhs[n])}
    _load_columns(writer, operands)
    for node in sorted(operands & lowered.waiting.keys() - set(nodes)):
        writer.names[node] = code.let(f"load {v.type}, ptr {_waiting(code, block, node)}")
    before = sum(len(part) for part in lowered.parts[:number])
    for done, node in enumerate(nodes, before):
        _stream(code, block, done)
        writer.operation(node)
        for entry in lowered.places.get(node, ()):
            _store_entry(writer, block, entry, node)
        if node in lowered.waiting and lowered.last_part[node] > number:
            code.do(f"store {v.type} {writer.value(node)}, ptr {_waiting(code, block, node)}")
    return (
        f"define internal void @part{number}(ptr noalias %rows, ptr noalias %uniforms, ptr noalias %waiting, "
        f"ptr noalias %out{_STREAM if block.streamed else ''}) noinline {{\nentry:\n{code.text()}\n  ret void\n}}\n"
    )


def _stream(code: Code, block: Block, done: int) -> None:
    """The lines that are due before one of the operations on a vector."""
    total = block.lowered.length
    for line in range(done * block.streamed // total, (done + 1) * block.streamed // total):
        source, target = (code.let(f"getelementptr {_LINE}, ptr %{end}, i64 {line}") for end in ("from", "to"))
        value = code.let(f"load {_LINE}, ptr {source}, align 8")
        code.do(f"store {_LINE} {value}, ptr {target}, align 64, !nontemporal !1")


def _waiting(code: Code, block: Block, node: int) -> str:
    return code.let(f"getelementptr {block.vector.type}, ptr %waiting, i64 {block.lowered.waiting[node]}")


def _store_entry(writer: _Writer, block: Block, entry: int, node: int) -> None:
    pointer = writer.code.let(f"getelementptr double, ptr %out, i64 {entry * block.samples}")
    writer.code.do(f"store {block.vector.type} {writer.value(node)}, ptr {pointer}")


def _load_columns(writer: _Writer, nodes: Collection[int]) -> None:
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
            pointer = code.let(f"getelementptr double, ptr {row}, i64 {column}")
            value = code.let(f"load double, ptr {pointer}")
            result = code.let(f"insertelement {v.type} {result}, double {value}, i32 {lane}")
        writer.names[node] = result


def _row_pointers(code: Code, v: Vector, argument: int) -> list[str]:
    """Addresses of an argument's rows; every third is a base, so that the others fit addressing modes."""
    row = code.let(f"load ptr, ptr {code.let(f'getelementptr {{ ptr, i64 }}, ptr %rows, i64 {argument}')}")
    step_at = code.let(f"getelementptr {{ ptr, i64 }}, ptr %rows, i64 {argument}, i32 1")
    step = code.let(f"load i64, ptr {step_at}")
    pointers = [row]
    for lane in range(1, v.lanes):
        base = pointers[lane - lane % 3] if lane % 3 else pointers[lane - 3]
        factor = lane % 3 or 3
        offset = code.let(f"mul i64 {step}, {factor}")
        pointers.append(code.let(f"getelementptr i8, ptr {base}, i64 {offset}"))
    return pointers


# -- the loop over a block ------------------------------------------------------------------------------------------


def _compute(block: Block) -> str:
    """``@compute``: all parts for one vector of samples after the other; beyond the last sample it is repeated."""
    v, code = block.vector, Code()
    sizes = [len(a) for a in block.lowered.function.arguments if not a.uniform]
    code.do(f"%rows = alloca [{max(len(sizes), 1)} x {{ ptr, i64 }}], align 64")
    end = code.let("add i64 %first, %count")
    last = code.let(f"sub i64 {end}, 1")
    waiting = code.let(f"getelementptr double, ptr %buffer, i64 {block.waiting}")
    padding = code.let(f"getelementptr double, ptr %buffer, i64 {block.padding}")
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
        padding = code.let(f"getelementptr double, ptr {padding}, i64 {size * v.lanes}")
    code.do("br label %ready")
    code.label("ready")
    code.do("%out = getelementptr double, ptr %buffer, i64 %k")
    for number in range(len(block.lowered.parts)):
        stream = ", ptr %from, ptr %to" if block.streamed else ""
        code.do(f"call void @part{number}(ptr %rows, ptr %uniforms, ptr {waiting}, ptr %out{stream})")
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
    base = code.let(f"load ptr, ptr {code.let(f'getelementptr ptr, ptr %inputs, i64 {argument}')}")
    stride = code.let(f"load i64, ptr {code.let(f'getelementptr i64, ptr %strides, i64 {argument}')}")
    return base, stride


def _moved(code: Code, base: str, sample: str, stride: str) -> str:
    offset = code.let(f"mul i64 {sample}, {stride}")
    return code.let(f"getelementptr i8, ptr {base}, i64 {offset}")


def _set_rows(code: Code, argument: int, base: str, stride: str) -> None:
    code.do(f"store ptr {base}, ptr {code.let(f'getelementptr {{ ptr, i64 }}, ptr %rows, i64 {argument}')}")
    at = code.let(f"getelementptr {{ ptr, i64 }}, ptr %rows, i64 {argument}, i32 1")
    code.do(f"store i64 {stride}, ptr {at}")


def _pad_rows(code: Code, v: Vector, argument: int, size: int, start: str, last: str, padding: str) -> None:
    """The rows of an incomplete vector, copied; the last one is repeated."""
    base, stride = _argument(code, argument)
    for lane in range(v.lanes):
        sample = code.let(f"add i64 {start}, {lane}")
        row = _moved(code, base, code.let(f"call i64 @llvm.smin.i64(i64 {sample}, i64 {last})"), stride)
        target = code.let(f"getelementptr double, ptr {padding}, i64 {lane * size}")
        code.do(f"call void @llvm.memcpy.p0.p0.i64(ptr {target}, ptr {row}, i64 {size * _DOUBLE}, i1 false)")
    _set_rows(code, argument, padding, str(size * _DOUBLE))


def _store_the_rest(block: Block, code: Code) -> None:
    """Entries that no part computes: inputs, constants and uniform values."""
    lowered = block.lowered
    writer = _Writer(lowered, block.vector)
    writer.code = code
    done = {n for part in lowered.parts for n in part}
    rest = {node: entries for node, entries in lowered.places.items() if node not in done}
    _load_columns(writer, rest)
    for node, entries in rest.items():
        for entry in entries:
            _store_entry(writer, block, entry, node)
