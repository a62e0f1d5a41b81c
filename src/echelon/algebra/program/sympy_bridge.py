"""Between sympy and recorded programs, exactly in both directions.

A regressor that somebody wrote in sympy becomes a program like any other, and a program can be read as formulas.
Decimals keep the value that their text shows, square roots of 2, 3 and 6 become exact numbers, and multiples of 15°
inside sin, cos and tan are turned by exactly: a rank must not hang on the difference between a number and the nearest
double.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from fractions import Fraction
from functools import reduce
from operator import add, mul, sub, truediv
from typing import Any

from echelon.algebra.exact.expressions import STEPS_PER_HALF_TURN, parse_decimal
from echelon.algebra.exact.polynomial import (
    Number,
    Rational,
    Surd,
    cosine_of_turn,
    sine_of_turn,
)
from echelon.algebra.program.operations import FUNCTIONS, Op
from echelon.algebra.program.tape import Program, Scalar, power, square_root
from echelon.algebra.program.text import COMPOUND, turned
from echelon.shared import InputError, extra

SUPPORTED = {"Abs" if op is Op.ABS else op.name.lower(): op for op in FUNCTIONS}
"""The functions that a program can hold, by sympy's names."""

_CIRCULAR = ("sin", "cos", "tan")
_BY_EXPONENTIALS = ("sinh", "cosh", "coth", "sech", "csch")
_COMPOUND = {
    "asin": "asin",
    "acos": "acos",
    "atan2": "atan2",
    "Max": "max",
    "Min": "min",
    "Heaviside": "heaviside",
}


def from_sympy(
    program: Program, expression: Any, symbols: Mapping[str, Scalar]
) -> Scalar:
    """Record a sympy expression.

    >>> import sympy
    >>> program, x = Program(), sympy.Symbol("x")
    >>> y = from_sympy(program, 0.1 * x**2 + sympy.cos(x + sympy.pi / 2), {"x": program.input("x")})
    >>> to_sympy(program, [y.node])
    [x**2/10 - sin(x)]
    """
    with extra("symbolic"):
        import sympy

    strangers = sorted(
        name for name, scalar in symbols.items() if scalar.program is not program
    )
    if strangers:
        raise InputError(f"symbols recorded on another program: {', '.join(strangers)}")
    try:
        checked = sympy.sympify(expression, strict=True)
    except sympy.SympifyError:
        checked = None
    if not isinstance(checked, sympy.Expr):
        raise InputError(
            f"a scalar sympy expression is needed, not {type(expression).__name__}"
        )
    try:
        return _SympyReader(program, symbols).read(checked)
    except ZeroDivisionError:
        raise InputError("division by zero", element=f"'{expression}'") from None


def to_sympy(
    program: Program, outputs: Sequence[int], given: Mapping[int, Any] | None = None
) -> list[Any]:
    """Nodes of a program as sympy expressions in real symbols named like the inputs.

    >>> program = Program()
    >>> x = program.input("x")
    >>> to_sympy(program, [(x / 3).node, (1 / x.sin()).node])
    [x/3, 1/sin(x)]
    """
    with extra("symbolic"):
        import sympy

    functions = {op: getattr(sympy, name) for name, op in SUPPORTED.items()}
    formulas: dict[int, Any] = dict(given or {})
    for node in program.needed(outputs, formulas):
        if node in formulas:
            continue
        op = Op(program.ops[node])
        a = formulas.get(program.lhs[node])
        b = formulas.get(program.rhs[node])
        if op is Op.INPUT:
            formulas[node] = sympy.Symbol(program.inputs[node].name)
        elif op is Op.CONSTANT:
            formulas[node] = sympy_number(program.constants[node])
        else:
            formulas[node] = (
                functions[op](a) if op in functions else _operated(op, a, b)
            )
    return [formulas[node] for node in outputs]


def shared_nodes(program: Program, outputs: Sequence[int]) -> list[int]:
    """Operations that outputs use more than once, in the order of the program."""
    needed = program.needed(outputs)
    uses = Counter(
        operand for node in needed for operand in (program.lhs[node], program.rhs[node])
    )
    uses.update(outputs)
    return [
        n
        for n in needed
        if uses[n] > 1 and program.ops[n] not in (Op.INPUT, Op.CONSTANT, Op.NEG)
    ]


def _operated(op: Op, a: Any, b: Any) -> Any:
    """Arithmetic on sympy expressions."""
    if op is Op.NEG:
        return -a
    return {Op.ADD: add, Op.SUB: sub, Op.MUL: mul, Op.DIV: truediv}[op](a, b)


def sympy_number(x: Number) -> Any:
    """An exact number in sympy."""
    with extra("symbolic"):
        import sympy

    if isinstance(x, Surd):
        roots = (sympy.Integer(1), sympy.sqrt(2), sympy.sqrt(3), sympy.sqrt(6))
        return sum(
            (
                sympy.Rational(p.numerator, p.denominator) * r
                for p, r in zip(x.parts, roots, strict=True)
            ),
            sympy.Integer(0),
        )
    return sympy.Rational(x.numerator, x.denominator)


class _SympyReader:
    """One walk over an expression; shared parts are read once."""

    def __init__(self, program: Program, symbols: Mapping[str, Scalar]) -> None:
        self.program, self.symbols = program, symbols
        self._known: dict[Any, Scalar] = {}

    def read(self, e: Any) -> Scalar:
        found = self._known.get(e)
        if found is None:
            found = self._known[e] = self._read(e)
        return found

    def _read(self, e: Any) -> Scalar:
        if e.is_Symbol:
            return self._symbol(e.name)
        if e.is_Rational or e.is_Float:
            return self.program.constant(_rational(e))
        if e.is_Add:
            return sum(map(self.read, e.args), self.program.zero)
        if e.is_Mul:
            return self._product(e)
        if e.is_Pow:
            return self._power(e.base, e.exp)
        name = type(e).__name__
        if name == "Exp1":
            return self.program.function(Op.EXP, self.program.one)
        if name in _BY_EXPONENTIALS:
            return self.read(e.rewrite(_exponential()))
        if name in _COMPOUND:
            return COMPOUND[_COMPOUND[name]][1](
                [self.read(argument) for argument in e.args]
            )
        if not e.is_Function or name not in SUPPORTED or len(e.args) != 1:
            raise _refusal(e)
        if name in _CIRCULAR:
            return self._circular(name, e.args[0])
        return self._function(name, e.args[0])

    def _symbol(self, name: str) -> Scalar:
        if name not in self.symbols:
            known = ", ".join(sorted(self.symbols)) or "none"
            raise InputError(
                f"not declared (declared: {known})", element=f"symbol '{name}'"
            )
        return self.symbols[name]

    def _product(self, e: Any) -> Scalar:
        """Factors of negative power share one division."""
        above: list[Scalar] = []
        below: list[Scalar] = []
        for factor in e.args:
            if factor.is_Pow and factor.exp.is_Number and factor.exp.is_negative:
                below.append(self._power(factor.base, -factor.exp))
            else:
                above.append(self.read(factor))
        return reduce(mul, above, self.program.one) / reduce(
            mul, below, self.program.one
        )

    def _power(self, base: Any, exponent: Any) -> Scalar:
        if type(base).__name__ == "Exp1":
            return self.program.function(Op.EXP, self.read(exponent))
        return power(self.read(base), self.read(exponent))

    def _function(self, name: str, argument: Any) -> Scalar:
        if name == "sqrt":
            return square_root(self.read(argument))
        return self.program.function(SUPPORTED[name], self.read(argument))

    def _circular(self, name: str, argument: Any) -> Scalar:
        """Sine, cosine or tangent, with multiples of 15° in the argument turned by exactly."""
        steps, rest = _split_turn(argument)
        return turned(
            SUPPORTED[name], self.read(rest), cosine_of_turn(steps), sine_of_turn(steps)
        )


def _split_turn(argument: Any) -> tuple[int, Any]:
    """An angle as steps of 15° and what is left of it."""
    with extra("symbolic"):
        import sympy

    if not argument.has(sympy.pi):
        return 0, argument
    steps, rest = 0, sympy.S.Zero
    for term in sympy.Add.make_args(argument.expand()):
        ratio = term / sympy.pi * STEPS_PER_HALF_TURN
        if (ratio.is_Rational or ratio.is_Float) and _rational(ratio).denominator == 1:
            steps += int(_rational(ratio))
        else:
            rest += term
    return steps, rest


def _rational(e: Any) -> Rational:
    """The exact value of a sympy Rational, or of the text of a Float."""
    if e.is_Float:
        try:
            return parse_decimal(str(e))
        except ValueError as error:
            raise InputError(str(error)) from None
    return int(e.p) if e.q == 1 else Fraction(int(e.p), int(e.q))


def _exponential() -> Any:
    with extra("symbolic"):
        import sympy

    return sympy.exp


def _refusal(e: Any) -> InputError:
    """The error for a part of an expression that programs do not hold."""
    if type(e).__name__ == "Pi":
        problem = "exact only as a multiple of pi/12 inside sin, cos and tan; elsewhere use a symbol with that value"
    elif e.is_Derivative or (
        e.is_Function and type(type(e)).__name__ == "UndefinedFunction"
    ):
        problem = "replace functions of time and their derivatives by symbols first (expression.subs)"
    elif e.is_Function:
        known = ", ".join((*SUPPORTED, *_BY_EXPONENTIALS, *_COMPOUND))
        problem = (
            f"the function {type(e).__name__} is not supported (supported: {known})"
        )
    else:
        problem = f"{type(e).__name__} is not a real scalar that a program can hold"
    return InputError(problem, element=f"'{e}'")
