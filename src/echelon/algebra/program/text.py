"""Expressions as text, recorded on a program: ``Fc*sign(qd[j5])*exp(-(qd[j5]/0.05)**2)``.

The grammar is that of Python's arithmetic: exact decimals, names, subscripts such as ``qd[j5]`` or ``qd["left-knee"]``,
``+ - * / **`` (or ``^``), parentheses, and functions.  ``pi`` is exact in sin, cos and tan.  The text is walked as a
syntax tree; nothing is ever evaluated as code.

Some functions are written with others, so that nothing else has to know them.  The half angle is taken for arc sines
and angles of points, because its tangent is a quotient without jumps: asin x = 2·atan(x/(1 + √(1 − x²))) and atan2(y,
x) = 2·atan(y/(x + √(x² + y²))).  The sine and cosine of twice an arc tangent are rational in its argument, so that
sin(asin x) = x is found exactly.  Double precision keeps eight digits of atan2 near the negative x-axis, where x + √(x²
+ y²) cancels.  A multiple of 15° is turned by exactly.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from fractions import Fraction
from functools import reduce
from math import tan

from echelon.algebra.exact.expressions import (
    PI,
    STEPS_PER_HALF_TURN,
    Angle,
    expression_tree,
    parse_angle,
    parse_decimal,
)
from echelon.algebra.exact.polynomial import (
    Number,
    circle_point,
    cosine_of_turn,
    sine_of_turn,
)
from echelon.algebra.program.operations import FUNCTIONS, Op
from echelon.algebra.program.tape import (
    Program,
    Scalar,
    maximum,
    minimum,
    power,
    square_root,
)
from echelon.shared import InputError, listed, shortened


def heaviside(x: Scalar) -> Scalar:
    """0, ½ or 1 for negative, zero and positive values."""
    return (1 + x.sign()) / 2


COMPOUND: Mapping[str, tuple[int | None, Callable[[Sequence[Scalar]], Scalar]]] = {
    "sinh": (1, lambda a: a[0].sinh()),
    "cosh": (1, lambda a: a[0].cosh()),
    "asin": (1, lambda a: a[0].arcsin()),
    "acos": (1, lambda a: a[0].arccos()),
    "heaviside": (1, lambda a: heaviside(a[0])),
    "atan2": (2, lambda a: a[0].arctan2(a[1])),
    "max": (None, lambda a: reduce(maximum, a)),
    "min": (None, lambda a: reduce(minimum, a)),
}
"""By name: the number of arguments, None for any, and what is recorded."""

_PLAIN = {op.name.lower(): op for op in FUNCTIONS}
FUNCTION_NAMES = (*_PLAIN, *COMPOUND)  # the functions that a text may hold

LONGEST = 4000
"""Characters of an expression: longer ones take seconds to read."""
_CIRCULAR = (Op.SIN, Op.COS, Op.TAN)


_PHASE = 10**9
"""Largest denominator of the tangent of half a rounded phase, which is so exact to the precision of doubles."""


def record_expression(
    text: str,
    names: Mapping[str, Scalar],
    where: str,
    program: Program,
    *,
    rounded_phases: bool = False,
) -> Scalar:
    """Record an expression; phases of sin and cos that have no exact sine stay functions, or are rounded.

    >>> program = Program()
    >>> y = record_expression("0.5*qd[j5] + abs(qd[j5])", {"qd[j5]": program.input("qd[j5]")}, "friction", program)
    >>> program.count([y.node])
    {'ABS': 1, 'ADD': 1, 'MUL': 1}
    """
    shown = shortened(text)
    if len(text) > LONGEST:
        raise InputError(
            f"'{shown}': an expression has at most {LONGEST} characters", element=where
        )
    source = text.strip().replace("^", "**")
    try:
        return _Recorder(source, names, program, rounded_phases).record(
            expression_tree(source)
        )
    except InputError as error:
        raise InputError(f"in '{shown}': {error.problem}", element=where) from None
    except (SyntaxError, RecursionError):
        raise InputError(
            f"'{shown}' is not an expression such as 2*a*sin(x) - b*x**2", element=where
        ) from None
    except ValueError as error:
        raise InputError(f"in '{shown}': {error}", element=where) from None
    except ZeroDivisionError:
        raise InputError(f"'{shown}' divides by zero", element=where) from None


def turned(op: Op, rest: Scalar, cosine: Number, sine: Number) -> Scalar:
    """A circular function of an angle plus one whose cosine and sine are given."""
    program = rest.program
    if cosine == 1:
        return program.function(op, rest)
    c, s = rest.cos(), rest.sin()
    whole_cosine, whole_sine = c * cosine - s * sine, s * cosine + c * sine
    if op is Op.TAN:
        return whole_sine / whole_cosine
    if op is Op.COS:
        return whole_cosine
    return whole_sine


class _Recorder:
    def __init__(
        self, text: str, names: Mapping[str, Scalar], program: Program, rounded: bool
    ) -> None:
        self.text = text
        self.names = names
        self.program = program
        self.rounded = rounded

    def record(self, node: ast.expr) -> Scalar:
        match node:
            case ast.Constant(value=int() | float()) if not isinstance(
                node.value, bool
            ):
                return self.program.constant(parse_decimal(self._source(node)))
            case ast.Name(id=name):
                return self._named(name)
            case ast.Subscript(value=ast.Name(id=kind), slice=inner):
                return self._named(f"{kind}[{self._index(inner)}]")
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return -self.record(operand)
            case ast.UnaryOp(op=ast.UAdd(), operand=operand):
                return self.record(operand)
            case ast.BinOp(left=left, op=operation, right=right):
                return self._binary(
                    node, operation, self.record(left), self.record(right)
                )
            case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]) if (
                name in _PLAIN
            ):
                return self._function(_PLAIN[name], argument)
            case ast.Call(
                func=ast.Name(id=name), args=[_, *_] as arguments, keywords=[]
            ) if name in COMPOUND:
                count, write = COMPOUND[name]
                if count in (None, len(arguments)):
                    return write([self.record(argument) for argument in arguments])
        valid = f"possible are numbers, names, + - * / ** and the functions {', '.join(FUNCTION_NAMES)}"
        raise InputError(f"'{self._source(node)}' has no meaning here; {valid}")

    def _binary(
        self, node: ast.expr, operation: ast.operator, a: Scalar, b: Scalar
    ) -> Scalar:
        match operation:
            case ast.Add():
                return a + b
            case ast.Sub():
                return a - b
            case ast.Mult():
                return a * b
            case ast.Div():
                return a / b
            case ast.Pow():
                return power(a, b)
        raise InputError(
            f"'{self._source(node)}' uses an operation other than + - * / **"
        )

    def _function(self, op: Op, argument: ast.expr) -> Scalar:
        if op is Op.SQRT:
            return square_root(self.record(argument))
        if op not in _CIRCULAR:
            return self.program.function(op, self.record(argument))
        half_turns, radians, rest = Fraction(), Fraction(), self.program.zero
        for sign, term in _terms(argument):
            constant = self._constant(term)
            if constant is None:
                rest = rest + sign * self.record(term)
            else:
                half_turns = half_turns + sign * constant.half_turns
                radians = radians + sign * constant.radians
        phase = Angle(half_turns, (), radians)
        steps = phase.half_turns * STEPS_PER_HALF_TURN
        if self.rounded and (phase.radians or steps.denominator > 1):
            return turned(op, rest, *_rounded(phase.value))
        if phase.radians:
            rest = rest + self.program.constant(phase.radians)
        return turned(op, rest, cosine_of_turn(int(steps)), sine_of_turn(int(steps)))

    def _constant(self, term: ast.expr) -> Angle | None:
        """A term that is a number of radians or a part of π."""
        names = {
            n.id for n in ast.walk(term) if isinstance(n, ast.Name)
        } - self.names.keys()
        if PI not in names and any(
            isinstance(n, ast.Name | ast.Subscript) for n in ast.walk(term)
        ):
            return None
        with suppress(ValueError):
            angle = parse_angle(self._source(term))
            steps = angle.half_turns * STEPS_PER_HALF_TURN
            if not angle.parts and (self.rounded or steps.denominator == 1):
                return angle
        if PI not in names:
            return None
        raise InputError(f"'{self._source(term)}' is not a multiple of pi/12")

    def _index(self, inner: ast.expr) -> str:
        """Text in brackets, without quotation marks."""
        if isinstance(inner, ast.Constant) and isinstance(inner.value, str):
            return inner.value
        return self._source(inner)

    def _named(self, name: str) -> Scalar:
        if name in self.names:
            return self.names[name]
        if name == PI:
            raise InputError(
                "pi is exact only inside sin, cos and tan; elsewhere use a symbol with that value"
            )
        if name in FUNCTION_NAMES:
            raise InputError(f"'{name}' is a function: write {name}(...)")
        known = listed(sorted(self.names)) or "none"
        raise InputError(f"'{name}' is unknown (valid: {known})")

    def _source(self, node: ast.expr) -> str:
        return ast.get_source_segment(self.text, node) or ""


def _terms(node: ast.expr) -> list[tuple[int, ast.expr]]:
    """The terms of a sum, with their signs."""
    match node:
        case ast.BinOp(left=left, op=ast.Add(), right=right):
            return _terms(left) + _terms(right)
        case ast.BinOp(left=left, op=ast.Sub(), right=right):
            return _terms(left) + [(-sign, term) for sign, term in _terms(right)]
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return [(-sign, term) for sign, term in _terms(operand)]
    return [(1, node)]


def _rounded(angle: float) -> tuple[Fraction, Fraction]:
    """A rational point of the circle as near to an angle as doubles are."""
    return circle_point(Fraction(tan(angle / 2)).limit_denominator(_PHASE))


def phase_symbols(text: str) -> Iterator[str]:
    """Names that stand for angles: alone in a term of the argument of a circular function, perhaps with a factor."""
    circular = {op.name.lower() for op in _CIRCULAR}
    for call in ast.walk(expression_tree(text.strip().replace("^", "**"))):
        if (
            isinstance(call, ast.Call)
            and isinstance(call.func, ast.Name)
            and call.func.id in circular
            and call.args
        ):
            for _, term in _terms(call.args[0]):
                names = [n.id for n in ast.walk(term) if isinstance(n, ast.Name)]
                yield from names if len(names) == 1 else ()
