"""Operations of a program in the order of a kernel, as LLVM instructions on one vector type, written as text.

Text, because building it is several times faster than building instruction objects, and because it can be read: one
instruction per line, fresh names.

Sines and cosines of a vector have no branches for all angles that robots meet.  The angle is reduced by the nearest
multiple n of π/2 with three fused multiply-adds (Cody and Waite's method; the three constants hold π/2 to 159 bits, and
the first step is exact).  Then polynomials of least error on [−π/4, π/4] follow, those of FDLIBM's kernels (Sun
Microsystems, 1993), and the quadrant picks and signs them.  The error is below 2 units in the last place up to
:data:`LARGEST_ANGLE`; larger angles, infinities and NaN go to the C library, lane by lane.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from functools import cached_property
from math import pi

from echelon.algebra import (
    Function,
    Op,
    Program,
    cut,
    depth_first,
    operands,
    waiting_places,
)

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
        return {
            node: (i, k)
            for i, argument in enumerate(varying)
            for k, node in enumerate(argument.nodes)
        }

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
        used = [
            [a for node in part for a in operands(self.program, node)]
            for part in self.parts
        ]
        return waiting_places(self.parts, used)


def lowered(function: Function, longest: int = _LONGEST, part: int = _PART) -> Lowered:
    """Order a function's operations, and cut those longer than ``longest`` into parts."""
    program, varying = function.program, function.varying
    walk = depth_first(
        function.outputs,
        lambda node: operands(program, node) if node in varying else (),
    )
    order = [node for node in walk if node in varying and program.ops[node] != Op.INPUT]
    read = {operand for node in order for operand in operands(program, node)} | set(
        function.outputs
    )
    uniform = [
        n for n in sorted(read) if n not in varying and program.ops[n] != Op.CONSTANT
    ]
    return Lowered(
        function,
        tuple(uniform),
        cut(order, part if len(order) > longest else max(len(order), 1)),
    )


LARGE_FRAME = '"no-stack-arg-probe"'
"""Attribute of functions that spill much: Windows would probe their stack by a function that is not linked here."""


@dataclass(frozen=True)
class Vector:
    """The type of a vector of doubles, or of a plain double if it has one lane."""

    lanes: int

    @property
    def type(self) -> str:
        """Its name."""
        return f"<{self.lanes} x double>" if self.lanes > 1 else "double"

    @property
    def suffix(self) -> str:
        """Its name in those of intrinsic functions."""
        return f"v{self.lanes}f64" if self.lanes > 1 else "f64"

    @property
    def integers(self) -> str:
        """The type of as many 64-bit integers."""
        return f"<{self.lanes} x i64>" if self.lanes > 1 else "i64"

    @property
    def bits(self) -> str:
        """The type of as many truth values."""
        return f"<{self.lanes} x i1>" if self.lanes > 1 else "i1"

    def of(self, value: float) -> str:
        """A constant with the same value in all lanes."""
        return self._filled("double", number(value))

    def of_integer(self, value: int) -> str:
        """A constant with the same integer in all lanes."""
        return self._filled("i64", str(value))

    def _filled(self, kind: str, text: str) -> str:
        if self.lanes > 1:
            return "<" + ", ".join([f"{kind} {text}"] * self.lanes) + ">"
        return text


def number(value: float) -> str:
    """A double, bit for bit.

    >>> number(1.0)
    '0x3FF0000000000000'
    """
    return f"0x{struct.unpack('>Q', struct.pack('>d', value))[0]:016X}"


@dataclass
class Code:
    """Instructions of one function body under construction."""

    lines: list[str] = field(default_factory=list)
    _count: int = 0

    def let(self, instruction: str) -> str:
        """Append an instruction that has a value; returns the value's name."""
        self._count += 1
        name = f"%t{self._count}"
        self.lines.append(f"  {name} = {instruction}")
        return name

    def at(self, pointer: str, index: object, kind: str = "double") -> str:
        """The address of an entry of an array."""
        return self.let(f"getelementptr {kind}, ptr {pointer}, i64 {index}")

    def load(self, kind: str, pointer: str) -> str:
        """The value at an address."""
        return self.let(f"load {kind}, ptr {pointer}")

    def store(self, pointer: str, value: str, hint: str = "") -> None:
        """Write a value, given with its type, to an address."""
        self.do(f"store {value}, ptr {pointer}{hint}")

    def do(self, instruction: str) -> None:
        """Append an instruction without a value."""
        self.lines.append(f"  {instruction}")

    def label(self, name: str) -> None:
        """Begin a block."""
        self.lines.append(f"{name}:")

    def text(self) -> str:
        """The body."""
        return "\n".join(self.lines)


def module_text(*texts: str) -> str:
    """One module of several texts; what more than one of them declares is declared once."""
    heads: dict[str, None] = {}
    bodies: list[str] = []
    for line in "\n".join(texts).splitlines():
        if line.startswith(("declare ", "!")):
            heads[line] = None
        else:
            bodies.append(line)
    return "\n".join([*heads, *bodies]) + "\n"


_BINARY = {
    Op.ADD: "fadd contract",
    Op.SUB: "fsub contract",
    Op.MUL: "fmul contract",
    Op.DIV: "fdiv",
}
_LIBRARY = {Op.EXP: "exp", Op.LOG: "log", Op.TANH: "tanh", Op.ATAN: "atan"}
LARGEST_ANGLE = 1e9  # radians; beyond, the C library takes over

_TURNS = 2 / pi
_HALF_PI = tuple(
    map(
        float.fromhex,
        ("0x1.921fb54442d18p+0", "0x1.1a62633145c07p-54", "-0x1.f1976b7ed8fbcp-110"),
    )
)
_ROUNDING = float.fromhex(
    "0x1.8p52"
)  # adding it leaves the nearest integer in the low bits
_SINE = (
    -1.66666666666666324348e-01,
    8.33333333332248946124e-03,
    -1.98412698298579493134e-04,
    2.75573137070700676789e-06,
    -2.50507602534068634195e-08,
    1.58969099521155010221e-10,
)
_COSINE = (
    4.16666666666666019037e-02,
    -1.38888888888741095749e-03,
    2.48015872894767294178e-05,
    -2.75573143513906633035e-07,
    2.08757232129817482790e-09,
    -1.13596475577881948265e-11,
)


def declarations(v: Vector) -> list[str]:
    """Declarations of the functions that operations may call, and those that ``@sincos`` calls."""
    found = [
        f"declare double @{name}(double)" for name in ("sin", "cos", *_LIBRARY.values())
    ]
    for name, count in (("sqrt", 1), ("copysign", 2), ("fma", 3), ("fabs", 1)):
        found.append(
            f"declare {v.type} @llvm.{name}.{v.suffix}({', '.join([v.type] * count)})"
        )
    if v.lanes > 1:
        found.append(f"declare i1 @llvm.vector.reduce.or.v{v.lanes}i1({v.bits})")
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
        pointer = code.at("%uniforms", place)
        scalar = code.let(f"load double, ptr {pointer}, !invariant.load !0")
        first = code.let(f"insertelement {v.type} undef, double {scalar}, i32 0")
        return code.let(
            f"shufflevector {v.type} {first}, {v.type} undef, <{v.lanes} x i32> zeroinitializer"
        )

    def operation(self, node: int) -> None:
        """Write one operation."""
        program = self.lowered.program
        op, a = Op(program.ops[node]), self.value(program.lhs[node])
        if op in _BINARY:
            b = self.value(program.rhs[node])
            self.names[node] = self.code.let(
                f"{_BINARY[op]} {self.vector.type} {a}, {b}"
            )
        else:
            self.names[node] = self._function(op, a, program.lhs[node])

    def _function(self, op: Op, a: str, operand: int) -> str:
        v, code = self.vector, self.code
        if op is Op.NEG:
            return code.let(f"fneg {v.type} {a}")
        if op in (Op.SIN, Op.COS, Op.TAN):
            s, c = self._sincos(operand, a)
            if op is Op.SIN:
                return s
            if op is Op.COS:
                return c
            return code.let(f"fdiv {v.type} {s}, {c}")
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
                self._pairs[operand] = (
                    by_lane(code, v, "sin", a),
                    by_lane(code, v, "cos", a),
                )
            else:
                pair = f"{{ {v.type}, {v.type} }}"
                both = code.let(f"call fastcc {pair} @sincos({v.type} {a})")
                s, c = (code.let(f"extractvalue {pair} {both}, {k}") for k in (0, 1))
                self._pairs[operand] = s, c
        return self._pairs[operand]

    def _sign(self, a: str) -> str:
        """−1, 0 or 1; NaN stays NaN."""
        v, code = self.vector, self.code
        one = code.let(
            f"call {v.type} @llvm.copysign.{v.suffix}({v.type} {v.of(1.0)}, {v.type} {a})"
        )
        other = code.let(f"fcmp une {v.type} {a}, {v.of(0.0)}")
        number = code.let(f"fcmp ord {v.type} {a}, {v.of(0.0)}")
        nonzero = code.let(f"and {v.bits} {other}, {number}")
        return code.let(f"select {v.bits} {nonzero}, {v.type} {one}, {v.type} {a}")


# -- sines and cosines -------------------------------------------------------------------------------------------------


def sincos(v: Vector) -> str:
    """The definition of ``@sincos``, which returns both."""
    code = Code()
    shifted = _fma(code, v, "%x", v.of(_TURNS), v.of(_ROUNDING))
    n = code.let(f"fsub {v.type} {shifted}, {v.of(_ROUNDING)}")
    r = "%x"
    for part in _HALF_PI:
        r = _fma(code, v, n, v.of(-part), r)
    z = code.let(f"fmul {v.type} {r}, {r}")
    sine, cosine = _sine(code, v, r, z), _cosine(code, v, z)
    quadrant = code.let(f"bitcast {v.type} {shifted} to {v.integers}")
    low = code.let(f"and {v.integers} {quadrant}, {v.of_integer(1)}")
    swapped = code.let(f"icmp ne {v.integers} {low}, {v.of_integer(0)}")
    first = code.let(f"select {v.bits} {swapped}, {v.type} {cosine}, {v.type} {sine}")
    second = code.let(f"select {v.bits} {swapped}, {v.type} {sine}, {v.type} {cosine}")
    next_quadrant = code.let(f"add {v.integers} {quadrant}, {v.of_integer(1)}")
    s, c = _signed(code, v, first, quadrant), _signed(code, v, second, next_quadrant)
    zero = code.let(f"fcmp oeq {v.type} %x, {v.of(0.0)}")
    s = code.let(
        f"select {v.bits} {zero}, {v.type} %x, {v.type} {s}"
    )  # the sums above lose the sign of −0
    size = code.let(f"call {v.type} @llvm.fabs.{v.suffix}({v.type} %x)")
    beyond = code.let(f"fcmp uge {v.type} {size}, {v.of(LARGEST_ANGLE)}")
    some = beyond
    if v.lanes > 1:
        some = code.let(
            f"call i1 @llvm.vector.reduce.or.v{v.lanes}i1({v.bits} {beyond})"
        )
    code.do(f"br i1 {some}, label %library, label %done")
    code.label("library")
    far_s, far_c = (by_lane(code, v, name, "%x") for name in ("sin", "cos"))
    # the other lanes keep what they have: a sample's result must not depend on its neighbours
    pairs = [
        (near, code.let(f"select {v.bits} {beyond}, {v.type} {far}, {v.type} {near}"))
        for near, far in ((s, far_s), (c, far_c))
    ]
    code.do("br label %done")
    code.label("done")
    s, c = (
        code.let(f"phi {v.type} [ {near}, %entry ], [ {far}, %library ]")
        for near, far in pairs
    )
    pair = f"{{ {v.type}, {v.type} }}"
    half = code.let(f"insertvalue {pair} undef, {v.type} {s}, 0")
    both = code.let(f"insertvalue {pair} {half}, {v.type} {c}, 1")
    code.do(f"ret {pair} {both}")
    return f"define internal fastcc {pair} @sincos({v.type} %x) noinline {{\nentry:\n{code.text()}\n}}\n"


def _fma(code: Code, v: Vector, a: str, b: str, c: str) -> str:
    return code.let(
        f"call {v.type} @llvm.fma.{v.suffix}({v.type} {a}, {v.type} {b}, {v.type} {c})"
    )


def _horner(code: Code, v: Vector, z: str, coefficients: tuple[float, ...]) -> str:
    total = v.of(coefficients[-1])
    for coefficient in coefficients[-2::-1]:
        total = _fma(code, v, total, z, v.of(coefficient))
    return total


def _sine(code: Code, v: Vector, r: str, z: str) -> str:
    """r + r³·p(r²)."""
    cube = code.let(f"fmul {v.type} {r}, {z}")
    return _fma(code, v, cube, _horner(code, v, z, _SINE), r)


def _cosine(code: Code, v: Vector, z: str) -> str:
    """1 − r²/2 + r⁴·p(r²), with the rounding error of the first two terms added back."""
    half = code.let(f"fmul {v.type} {z}, {v.of(0.5)}")
    w = code.let(f"fsub {v.type} {v.of(1.0)}, {half}")
    rounded = code.let(f"fsub {v.type} {v.of(1.0)}, {w}")
    lost = code.let(f"fsub {v.type} {rounded}, {half}")
    square = code.let(f"fmul {v.type} {z}, {z}")
    rest = _fma(code, v, square, _horner(code, v, z, _COSINE), lost)
    return code.let(f"fadd {v.type} {w}, {rest}")


def _signed(code: Code, v: Vector, value: str, quadrant: str) -> str:
    """The value with the sign that its quadrant gives: the second bit becomes the sign bit."""
    shifted = code.let(f"shl {v.integers} {quadrant}, {v.of_integer(62)}")
    sign = code.let(f"and {v.integers} {shifted}, {v.of_integer(-(1 << 63))}")
    bits = code.let(f"bitcast {v.type} {value} to {v.integers}")
    flipped = code.let(f"xor {v.integers} {bits}, {sign}")
    return code.let(f"bitcast {v.integers} {flipped} to {v.type}")


def by_lane(code: Code, v: Vector, name: str, x: str) -> str:
    """A function of the C library, called for every lane."""
    if v.lanes == 1:
        return code.let(f"call double @{name}(double {x})")
    result = "undef"
    for lane in range(v.lanes):
        element = code.let(f"extractelement {v.type} {x}, i32 {lane}")
        value = code.let(f"call double @{name}(double {element})")
        result = code.let(
            f"insertelement {v.type} {result}, double {value}, i32 {lane}"
        )
    return result
