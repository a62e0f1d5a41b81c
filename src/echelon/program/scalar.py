"""The recording scalar: arithmetic and functions on it append to its program.

It behaves like a number in ordinary Python code and, through the methods of the same names, in NumPy's functions on
arrays of objects.  What a straight-line program cannot hold (comparisons, branches, conversions to float) is an error
that says so, instead of a wrong recording.
"""

from __future__ import annotations

from fractions import Fraction
from math import isqrt
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from echelon.errors import InputError
from echelon.exact.numbers import Number, Rational, Surd, parse_decimal
from echelon.program.operations import Op

if TYPE_CHECKING:
    from echelon.program.tape import Program

_LARGEST_EXPONENT = 128
_MOST_BITS = 20_000
_ROOTS = {2: Surd((0, 1, 0, 0)), 3: Surd((0, 0, 1, 0)), 6: Surd((0, 0, 0, 1))}


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
        return self.program.constant(exact(other)).node

    # -- arithmetic --------------------------------------------------------------------------------------------

    def __add__(self, other: Scalar | Number | float) -> Scalar:
        return Scalar(self.program, self.program.add(self.node, self._node_of(other)))

    __radd__ = __add__

    def __sub__(self, other: Scalar | Number | float) -> Scalar:
        return Scalar(self.program, self.program.subtract(self.node, self._node_of(other)))

    def __rsub__(self, other: Number | float) -> Scalar:
        return Scalar(self.program, self.program.subtract(self._node_of(other), self.node))

    def __mul__(self, other: Scalar | Number | float) -> Scalar:
        return Scalar(self.program, self.program.multiply(self.node, self._node_of(other)))

    __rmul__ = __mul__

    def __truediv__(self, other: Scalar | Number | float) -> Scalar:
        return Scalar(self.program, self.program.divide(self.node, self._node_of(other)))

    def __rtruediv__(self, other: Number | float) -> Scalar:
        return Scalar(self.program, self.program.divide(self._node_of(other), self.node))

    def __neg__(self) -> Scalar:
        return Scalar(self.program, self.program.negate(self.node))

    def __pos__(self) -> Scalar:
        return self

    def __pow__(self, exponent: Scalar | Number | float) -> Scalar:
        return power(self, Scalar(self.program, self._node_of(exponent)))

    def __rpow__(self, base: Number | float) -> Scalar:
        return power(Scalar(self.program, self._node_of(base)), self)

    # -- functions, by the names that NumPy looks for in arrays of objects --------------------------------------

    def sin(self) -> Scalar:
        """Sine."""
        return self.program.function(Op.SIN, self)

    def cos(self) -> Scalar:
        """Cosine."""
        return self.program.function(Op.COS, self)

    def tan(self) -> Scalar:
        """Tangent."""
        return self.program.function(Op.TAN, self)

    def exp(self) -> Scalar:
        """Exponential."""
        return self.program.function(Op.EXP, self)

    def log(self) -> Scalar:
        """Natural logarithm."""
        return self.program.function(Op.LOG, self)

    def tanh(self) -> Scalar:
        """Hyperbolic tangent."""
        return self.program.function(Op.TANH, self)

    def arctan(self) -> Scalar:
        """Arc tangent."""
        return self.program.function(Op.ATAN, self)

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

    def sign(self) -> Scalar:
        """−1, 0 or 1."""
        return self.program.function(Op.SIGN, self)

    def sinh(self) -> Scalar:
        """Hyperbolic sine, from the exponential."""
        return (self.exp() - (-self).exp()) / 2

    def cosh(self) -> Scalar:
        """Hyperbolic cosine, from the exponential."""
        return (self.exp() + (-self).exp()) / 2

    def __abs__(self) -> Scalar:
        return self.program.function(Op.ABS, self)

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        """NumPy's functions: the larger and smaller of values, and on arrays of objects what has a method here."""
        chosen = {"maximum": maximum, "minimum": minimum}.get(ufunc.__name__)
        if chosen is None or method != "__call__":
            return getattr(ufunc, method)(*(_boxed(x) for x in inputs), **options)
        a, b = (np.asarray(x, dtype=object) for x in np.broadcast_arrays(*(_boxed(x) for x in inputs)))
        result = np.empty(a.shape, dtype=object)
        for place in np.ndindex(a.shape):
            pair: list[Any] = [a[place], b[place]]
            result[place] = chosen(*(Scalar(self.program, self._node_of(x)) for x in pair))
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


def exact(value: Any) -> Number:
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
        if count > _LARGEST_EXPONENT:
            raise InputError(f"the exponent {number} is larger than {_LARGEST_EXPONENT}")
        total = _integer_power(base, int(count))
        total = total * square_root(base) if half else total
        return total if number >= 0 else 1 / total
    return (exponent * base.log()).exp()


def _integer_power(base: Scalar, count: int) -> Scalar:
    """By repeated squaring, from the lowest bit on."""
    value = base.number
    if isinstance(value, int | Fraction) and count * _bits(value) > _MOST_BITS:
        raise InputError(f"a power with more than {_MOST_BITS} bits")
    total, square = base.program.one, base
    while count:
        total = total * square if count & 1 else total
        count >>= 1
        square = square * square if count else square
    return total


def _bits(value: Rational) -> int:
    return value.numerator.bit_length() + value.denominator.bit_length()


def square_root(x: Scalar) -> Scalar:
    """Square root, exact for rational squares times 1, 2, 3 or 6."""
    value = x.number
    if isinstance(value, int | Fraction):
        if value < 0:
            raise InputError(f"the square root of {value} is not real")
        for radicand in (1, 2, 3, 6):
            square = Fraction(value) / radicand
            root = Fraction(isqrt(square.numerator), isqrt(square.denominator))
            if root * root == square:
                return x.program.constant((root.numerator if root.denominator == 1 else root) * _ROOTS.get(radicand, 1))
    return x.program.function(Op.SQRT, x)
