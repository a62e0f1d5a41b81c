"""The straight-line program, its operations, and the scalar that records it.

A program is a list of operations in the order in which they were first needed; each refers to earlier ones by number.
Recording is hash-consed: writing the same operation twice gives the same node, so common subexpressions cost nothing,
and arithmetic with constants is folded exactly, so structural zeros never become operations.

Arithmetic and functions on a scalar append to its program.  It behaves like a number in ordinary Python code and,
through the methods of the same names, in NumPy's functions on arrays of objects.  What a straight-line program cannot
hold (comparisons, branches, conversions to float) is an error that says so, instead of a wrong recording.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from operator import mul
from typing import Any, NoReturn

import numpy as np

from echelon.algebra.exact import polynomial
from echelon.algebra.exact.expressions import MOST_BITS, parse_decimal
from echelon.algebra.exact.polynomial import (
    Number,
    Polynomial,
    Rational,
    Surd,
    inverse,
    is_negative,
    is_trigonometric,
    multiple_of,
    repeated,
    symbol_of,
)
from echelon.algebra.program.operations import Op, folded
from echelon.shared import InputError

LARGEST_POWER = 128
"""Exponent of a power: it takes fourteen products at most."""


def _recorded(op: Op, meaning: str) -> Callable[[Scalar], Scalar]:
    """A method that records a function."""

    def method(self: Scalar) -> Scalar:
        return self.program.function(op, self)

    method.__doc__ = meaning
    return method


class Scalar:
    """A recorded number."""

    __slots__ = ("node", "program")

    def __init__(self, program: Program, node: int) -> None:
        self.program = program
        self.node = node

    def _node_of(self, other: Scalar | Number | float) -> int:
        if isinstance(other, Scalar):
            if other.program is not self.program:
                raise InputError("values recorded on two programs cannot be combined")
            return other.node
        return self.program.constant(exact_number(other)).node

    # -- arithmetic --------------------------------------------------------------------------------------------

    def __add__(self, other: Scalar | Number | float) -> Scalar:
        return Scalar(self.program, self.program.add(self.node, self._node_of(other)))

    __radd__ = __add__

    def __sub__(self, other: Scalar | Number | float) -> Scalar:
        return Scalar(
            self.program, self.program.subtract(self.node, self._node_of(other))
        )

    def __rsub__(self, other: Number | float) -> Scalar:
        return Scalar(
            self.program, self.program.subtract(self._node_of(other), self.node)
        )

    def __mul__(self, other: Scalar | Number | float) -> Scalar:
        return Scalar(
            self.program, self.program.multiply(self.node, self._node_of(other))
        )

    __rmul__ = __mul__

    def __truediv__(self, other: Scalar | Number | float) -> Scalar:
        return Scalar(
            self.program, self.program.divide(self.node, self._node_of(other))
        )

    def __rtruediv__(self, other: Number | float) -> Scalar:
        return Scalar(
            self.program, self.program.divide(self._node_of(other), self.node)
        )

    def __neg__(self) -> Scalar:
        return Scalar(self.program, self.program.negate(self.node))

    def __pos__(self) -> Scalar:
        return self

    def __pow__(self, exponent: Scalar | Number | float) -> Scalar:
        return power(self, Scalar(self.program, self._node_of(exponent)))

    def __rpow__(self, base: Number | float) -> Scalar:
        return power(Scalar(self.program, self._node_of(base)), self)

    # -- functions, by the names that NumPy looks for in arrays of objects --------------------------------------

    sin = _recorded(Op.SIN, "Sine.")
    cos = _recorded(Op.COS, "Cosine.")
    tan = _recorded(Op.TAN, "Tangent.")
    exp = _recorded(Op.EXP, "Exponential.")
    log = _recorded(Op.LOG, "Natural logarithm.")
    tanh = _recorded(Op.TANH, "Hyperbolic tangent.")
    arctan = _recorded(Op.ATAN, "Arc tangent.")
    sign = _recorded(Op.SIGN, "−1, 0 or 1.")
    __abs__ = _recorded(Op.ABS, "Size.")

    def arcsin(self) -> Scalar:
        """Arc sine, as twice an arc tangent."""
        return 2 * (self / (1 + (1 - self * self).sqrt())).arctan()

    def arccos(self) -> Scalar:
        """Arc cosine, as a right angle less the arc sine."""
        return 2 * self.program.one.arctan() - self.arcsin()

    def arctan2(self, x: Scalar | Number | float) -> Scalar:
        """Angle of the point (x, self), as twice an arc tangent."""
        other = Scalar(self.program, self._node_of(x))
        return 2 * (self / (other + (other * other + self * self).sqrt())).arctan()

    def sqrt(self) -> Scalar:
        """Square root."""
        return square_root(self)

    def sinh(self) -> Scalar:
        """Hyperbolic sine, from the exponential."""
        return (self.exp() - (-self).exp()) / 2

    def cosh(self) -> Scalar:
        """Hyperbolic cosine, from the exponential."""
        return (self.exp() + (-self).exp()) / 2

    def __array_ufunc__(
        self, ufunc: Any, method: str, *inputs: Any, **options: Any
    ) -> Any:
        """NumPy's functions: the larger and smaller of values, and on arrays of objects what has a method here."""
        chosen = {"maximum": maximum, "minimum": minimum}.get(ufunc.__name__)
        if chosen is None or method != "__call__":
            return getattr(ufunc, method)(*(_boxed(x) for x in inputs), **options)
        a, b = (
            np.asarray(x, dtype=object)
            for x in np.broadcast_arrays(*(_boxed(x) for x in inputs))
        )
        result = np.empty(a.shape, dtype=object)
        for place in np.ndindex(a.shape):
            pair: list[Any] = [a[place], b[place]]
            result[place] = chosen(
                *(Scalar(self.program, self._node_of(x)) for x in pair)
            )
        return result[()]

    # -- what a program cannot hold ------------------------------------------------------------------------------

    def _refuse(self, operation: str) -> NoReturn:
        raise InputError(
            f"{operation} of a recorded value: a model is recorded once for all values, so it cannot branch, compare "
            "or convert; use abs(v), v.sign(), np.maximum(v, w) of single values and smooth functions"
        )

    def __bool__(self) -> bool:
        self._refuse("truth value")

    def __float__(self) -> float:
        self._refuse("conversion to float")

    def __int__(self) -> int:
        self._refuse("conversion to int")

    def __lt__(self, other: object) -> bool:
        self._refuse("comparison")

    __le__ = __gt__ = __ge__ = __lt__

    @property
    def is_zero(self) -> bool:
        """Whether this is structurally zero."""
        return self.node == self.program.zero.node

    @property
    def number(self) -> Number | None:
        """The value of a constant, else None."""
        return self.program.constants.get(self.node)

    def __repr__(self) -> str:
        return f"Scalar({Op(self.program.ops[self.node]).name}, node {self.node})"


def maximum(a: Scalar, b: Scalar) -> Scalar:
    """The larger of two values: (a + b + |a − b|)/2."""
    return (a + b + abs(a - b)) / 2


def minimum(a: Scalar, b: Scalar) -> Scalar:
    """The smaller of two values: (a + b − |a − b|)/2."""
    return (a + b - abs(a - b)) / 2


def _boxed(value: Any) -> Any:
    """A scalar as an array of objects without axes."""
    return np.array(value, dtype=object) if isinstance(value, Scalar) else value


def exact_number(value: Any) -> Number:
    """A number that code wrote down, exactly; a float stands for the shortest decimal that names it."""
    if isinstance(value, int | Fraction | Surd) and not isinstance(value, bool):
        return value
    if not isinstance(value, bool) and hasattr(value, "__float__"):
        try:
            return parse_decimal(repr(float(value)))
        except (ValueError, TypeError):
            pass
    raise InputError(f"'{value}' is not a finite real number")


def power(base: Scalar, exponent: Scalar) -> Scalar:
    """Base to an exponent: products for integers, square roots for halves, otherwise exp(exponent · log base)."""
    number = exponent.number
    if isinstance(number, int | Fraction) and (2 * number).denominator == 1:
        count, half = divmod(abs(Fraction(number)), 1)
        if count > LARGEST_POWER:
            raise InputError(f"the exponent {number} is larger than {LARGEST_POWER}")
        total = _integer_power(base, int(count))
        total = total * square_root(base) if half else total
        return total if number >= 0 else 1 / total
    return (exponent * base.log()).exp()


def _integer_power(base: Scalar, count: int) -> Scalar:
    """By repeated squaring, from the lowest bit on."""
    value = base.number
    if isinstance(value, int | Fraction) and count * _bits(value) > MOST_BITS:
        raise InputError(
            f"a power of a number would have more than {MOST_BITS} bits; its exponent is too large"
        )
    return repeated(base, count, base.program.one, mul)


def _bits(value: Rational) -> int:
    return value.numerator.bit_length() + value.denominator.bit_length()


def square_root(x: Scalar) -> Scalar:
    """Square root, exact for rational squares times 1, 2, 3 or 6."""
    value = x.number
    if isinstance(value, int | Fraction):
        if value < 0:
            raise InputError(f"the square root of {value} is not real")
        with suppress(ValueError):
            return x.program.constant(polynomial.square_root(value))
    return x.program.function(Op.SQRT, x)


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
            raise InputError(
                f"'{name}' is both a {self.inputs[node].role} and a {role}: rename one of them"
            )
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
        if value is not None and (known := folded(op, value)) is not None:
            return self.constant(known)
        return Scalar(self, self._intern(int(op), x.node, -1))

    def _generator(self, generator: str) -> Scalar:
        symbol = self.input(symbol_of(generator), "symbol")
        if not is_trigonometric(generator):
            return symbol
        angle = symbol * multiple_of(generator)[0]
        return angle.cos() if generator.startswith("cos") else angle.sin()

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
        if (
            a == b and self._scaled(a) is not None
        ):  # c·x + c·x, which is x where c is a half
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
            if is_negative(value):
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
