"""Operations of a program as LLVM instructions on one vector type."""

from __future__ import annotations

from echelon.machine.lowering import Lowered
from echelon.machine.text import Code, Vector
from echelon.machine.trigonometry import by_lane
from echelon.program.operations import Op

_BINARY = {Op.ADD: "fadd contract", Op.SUB: "fsub contract", Op.MUL: "fmul contract", Op.DIV: "fdiv"}
_LIBRARY = {Op.EXP: "exp", Op.LOG: "log", Op.TANH: "tanh", Op.ATAN: "atan"}


def declared(v: Vector) -> list[str]:
    """Declarations of the functions that operations may call."""
    found = [f"declare double @{name}(double)" for name in _LIBRARY.values()]
    found.append(f"declare {v.type} @llvm.sqrt.{v.suffix}({v.type})")
    found.append(f"declare {v.type} @llvm.copysign.{v.suffix}({v.type}, {v.type})")
    return found


class Writer:
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
