"""The straight-line program.

A program is a list of operations in the order in which they were first needed; each refers to earlier ones by number.
Recording is hash-consed: writing the same operation twice gives the same node, so common subexpressions cost nothing,
and arithmetic with constants is folded exactly, so structural zeros never become operations.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction

from echelon.errors import InputError
from echelon.exact.numbers import Number, Surd, inverse
from echelon.exact.polynomial import Polynomial, is_trigonometric, multiple_of, symbol_of
from echelon.program.operations import Op
from echelon.program.scalar import Scalar

__all__ = ["Input", "Program", "Scalar"]

_INPUT, _CONSTANT, _ADD, _SUB, _MUL, _NEG, _DIV = (int(op) for op in list(Op)[:7])
_COMMUTATIVE = (_ADD, _MUL)


@dataclass(frozen=True)
class Input:
    """One input of a program."""

    name: str
    # ``"state"`` for what varies from sample to sample (q, q̇, q̈, model variables), ``"symbol"`` for what is constant
    # for a robot (geometry, gravity)
    role: str


class Program:
    """A straight-line program under construction or complete.

    >>> program = Program()
    >>> x = program.input("x")
    >>> y = (x + 1) * (x + 1) - 0 * x
    >>> program.count([y.node])
    {'ADD': 1, 'MUL': 1}
    """

    def __init__(self) -> None:
        self.ops: list[int] = []
        self.lhs: list[int] = []
        self.rhs: list[int] = []
        self.inputs: dict[int, Input] = {}
        self.constants: dict[int, Number] = {}
        self.unit_groups: list[tuple[int, ...]] = []
        self._known: dict[tuple[int, int, int], int] = {}
        self._constant_nodes: dict[Number, int] = {}
        self._input_nodes: dict[str, int] = {}
        self._polynomials: dict[Polynomial, Scalar] = {}
        self.zero = self.constant(0)
        self.one = self.constant(1)

    def __len__(self) -> int:
        return len(self.ops)

    # -- recording ---------------------------------------------------------------------------------------------

    def input(self, name: str, role: str = "state") -> Scalar:
        """The input of this name, created on first use."""
        node = self._input_nodes.get(name)
        if node is not None and self.inputs[node].role != role:
            raise InputError(f"'{name}' is both a {self.inputs[node].role} and a {role}: rename one of them")
        if node is None:
            node = self._append(_INPUT, -1, -1)
            self._input_nodes[name] = node
            self.inputs[node] = Input(name, role)
        return Scalar(self, node)

    def constant(self, value: Number) -> Scalar:
        """An exact constant."""
        node = self._constant_nodes.get(value)
        if node is None:
            node = self._append(_CONSTANT, -1, -1)
            self._constant_nodes[value] = node
            self.constants[node] = value
        return Scalar(self, node)

    def polynomial(self, polynomial: Polynomial) -> Scalar:
        """A geometry expression; its symbols become inputs with role ``symbol``."""
        found = self._polynomials.get(polynomial)
        if found is None:
            values = {g: self._generator(g) for g in polynomial.generators()}
            found = polynomial.evaluate(values, self.constant)
            self._polynomials[polynomial] = found
        return found

    def function(self, op: Op, x: Scalar) -> Scalar:
        """A unary function of a scalar, folded where the value is exact."""
        value = x.number
        if value is not None and (folded := _folded(op, value)) is not None:
            return self.constant(folded)
        return Scalar(self, self._intern(int(op), x.node, -1))

    def sin(self, x: Scalar) -> Scalar:
        """Sine of a recorded scalar."""
        return self.function(Op.SIN, x)

    def cos(self, x: Scalar) -> Scalar:
        """Cosine of a recorded scalar."""
        return self.function(Op.COS, x)

    def _generator(self, generator: str) -> Scalar:
        symbol = self.input(symbol_of(generator), "symbol")
        if not is_trigonometric(generator):
            return symbol
        angle = symbol * multiple_of(generator)[0]
        return self.cos(angle) if generator.startswith("cos") else self.sin(angle)

    # -- operations on nodes, with simplification -----------------------------------------------------------------

    def add(self, a: int, b: int) -> int:
        """Node of a + b."""
        if a == self.zero.node:
            return b
        if b == self.zero.node:
            return a
        if a in self.constants and b in self.constants:
            return self.constant(self.constants[a] + self.constants[b]).node
        if self.ops[b] == _NEG:
            return self.subtract(a, self.lhs[b])
        if self.ops[a] == _NEG:
            return self.subtract(b, self.lhs[a])
        if a == b and self._scaled(a) is not None:  # c·x + c·x, which is x where c is a half
            return self.multiply(a, self.constant(2).node)
        return self._intern(_ADD, a, b)

    def subtract(self, a: int, b: int) -> int:
        """Node of a − b."""
        if a == b:
            return self.zero.node
        if b == self.zero.node:
            return a
        if a == self.zero.node:
            return self.negate(b)
        if a in self.constants and b in self.constants:
            return self.constant(self.constants[a] - self.constants[b]).node
        if self.ops[b] == _NEG:
            return self.add(a, self.lhs[b])
        if self.ops[a] == _NEG:
            return self.negate(self.add(self.lhs[a], b))
        return self._intern(_SUB, a, b)

    def multiply(self, a: int, b: int) -> int:
        """Node of a · b."""
        zero, one = self.zero.node, self.one.node
        if a == zero or b == zero:
            return zero
        if a == one:
            return b
        if b == one:
            return a
        if a in self.constants:
            a, b = b, a
        if b in self.constants:
            value = self.constants[b]
            if a in self.constants:
                return self.constant(self.constants[a] * value).node
            if value == -1:
                return self.negate(a)
            if _is_negative(value):
                return self.negate(self.multiply(a, self.constant(-value).node))
            inner = self._scaled(a)
            if inner is not None:
                return self.multiply(inner[1], self.constant(inner[0] * value).node)
        if self.ops[a] == _NEG:
            return self.negate(self.multiply(self.lhs[a], b))
        if self.ops[b] == _NEG:
            return self.negate(self.multiply(a, self.lhs[b]))
        return self._intern(_MUL, a, b)

    def negate(self, a: int) -> int:
        """Node of −a."""
        if a in self.constants:
            return self.constant(-self.constants[a]).node
        if self.ops[a] == _NEG:
            return self.lhs[a]
        if self.ops[a] == _SUB:
            return self._intern(_SUB, self.rhs[a], self.lhs[a])
        return self._intern(_NEG, a, -1)

    def divide(self, a: int, b: int) -> int:
        """Node of a / b."""
        if b in self.constants:
            return self.multiply(a, self.constant(inverse(self.constants[b])).node)
        return a if a == self.zero.node else self._intern(_DIV, a, b)

    def _scaled(self, a: int) -> tuple[Number, int] | None:
        """Factor and node, if a is a product with a constant."""
        if self.ops[a] != _MUL:
            return None
        for factor, rest in ((self.lhs[a], self.rhs[a]), (self.rhs[a], self.lhs[a])):
            if factor in self.constants:
                return self.constants[factor], rest
        return None

    def _intern(self, op: int, a: int, b: int) -> int:
        if a > b and op in _COMMUTATIVE:
            a, b = b, a
        key = (op, a, b)
        node = self._known.get(key)
        if node is None:
            node = self._append(op, a, b)
            self._known[key] = node
        return node

    def _append(self, op: int, a: int, b: int) -> int:
        self.ops.append(op)
        self.lhs.append(a)
        self.rhs.append(b)
        return len(self.ops) - 1

    # -- inspection ----------------------------------------------------------------------------------------------

    def needed(self, outputs: Iterable[int], leaves: Iterable[int] = ()) -> list[int]:
        """Nodes that the outputs depend on, in order; what feeds only a leaf is left out."""
        stop, lhs, rhs = set(leaves), self.lhs, self.rhs
        pending, seen = list(outputs), {-1}
        while pending:
            node = pending.pop()
            if node in seen:
                continue
            seen.add(node)
            if node not in stop:
                if (left := lhs[node]) not in seen:
                    pending.append(left)
                if (right := rhs[node]) not in seen:
                    pending.append(right)
        seen.discard(-1)
        return sorted(seen)

    def count(self, outputs: Iterable[int]) -> dict[str, int]:
        """Operations needed for the outputs, by kind (inputs and constants are free)."""
        counts: dict[str, int] = {}
        for node in self.needed(outputs):
            if self.ops[node] >= _ADD:
                name = Op(self.ops[node]).name
                counts[name] = counts.get(name, 0) + 1
        return dict(sorted(counts.items()))

    def __repr__(self) -> str:
        return f"Program({len(self)} nodes, {len(self.inputs)} inputs)"


def _is_negative(value: Number) -> bool:
    return float(value) < 0 if isinstance(value, Surd) else Fraction(value) < 0


def _folded(op: Op, value: Number) -> Number | None:
    """The exact value of a function at a number, where there is one."""
    sign = -1 if _is_negative(value) else int(bool(value))
    if op in (Op.LOG, Op.SQRT) and (sign < 0 or (op is Op.LOG and not sign)):
        raise InputError(f"{op.name.lower()}({value}) is not real")
    if op is Op.SIGN:
        return sign
    if op is Op.ABS:
        return value * sign
    if op is Op.LOG:
        return 0 if value == 1 else None
    if sign:
        return None
    return 1 if op in (Op.COS, Op.EXP) else 0
