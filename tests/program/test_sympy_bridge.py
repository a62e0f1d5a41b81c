"""Between sympy and programs: nothing is lost either way, and what cannot be held is refused with advice."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import numpy as np
import pytest
import sympy
from hypothesis import assume, given
from sympy import Abs, Rational, cos, exp, log, pi, sign, sin, sqrt, tan, tanh

from echelon.algebra.exact.polynomial import Number
from echelon.algebra.program.operations import FUNCTIONS
from echelon.algebra.program.schedule import FloatArithmetic, Schedule
from echelon.algebra.program.sympy_bridge import SUPPORTED, from_sympy, to_sympy
from echelon.algebra.program.tape import Program, Scalar
from echelon.base.structure import linear_structure
from echelon.dynamics.linear_forms import LinearForms
from echelon.shared.errors import InputError
from support.strategies import calculate, formulas, in_sympy, numbers

x, y = sympy.symbols("x y")
VALUES = {x: 0.7, y: 1.3}


def recorded(expression: Any) -> tuple[Program, Scalar]:
    program = Program()
    symbols = {name: program.input(name) for name in ("x", "y")}
    return program, from_sympy(program, expression, symbols)


def in_doubles(program: Program, output: Scalar) -> float:
    schedule = Schedule(program, [output.node])
    values = {
        n: np.array([VALUES[sympy.Symbol(program.inputs[n].name)]])
        for n in schedule.leaves
    }
    return float(schedule.run(FloatArithmetic(), values, 1)[0, 0])


EXPRESSIONS = [
    sympy.S.Zero,
    Rational(-22, 7),
    x,
    x - y,
    3 * x**2 * y - x / 3 + 1,
    (x + y) ** 7,
    x / (y * (1 + x**2)),
    1 / x + x**-3 * y,
    sqrt(2) * x + sqrt(3) - sqrt(6) / y,
    sqrt(x) + x ** Rational(5, 2) - y ** Rational(-3, 2),
    sqrt(5) * x,
    sin(x) * cos(y) - tan(x),
    sin(x + pi / 4) - cos(2 * x - 7 * pi / 12) * tan(y + pi / 3),
    cos(pi * (x / pi + Rational(1, 6))),
    exp(-x) * log(y) + tanh(x * y) + sympy.E,
    sign(x) * Abs(x - y),
    sin(sin(x) + cos(y)),
    sin(1),
]


@pytest.mark.parametrize("expression", EXPRESSIONS, ids=str)
def test_there_and_back(expression: Any) -> None:
    program, output = recorded(expression)
    back = to_sympy(program, [output.node])[0]
    assert sympy.simplify(sympy.expand_trig(sympy.expand(back - expression))) == 0
    assert in_doubles(program, output) == pytest.approx(
        float(expression.subs(VALUES)), rel=1e-12
    )


@pytest.mark.parametrize(
    "expression",
    [
        x**y,
        sympy.cbrt(x),
        2**-x,
        x ** (y + 2),
        sympy.cosh(x) - sympy.sinh(x) * sympy.sech(y),
    ],
    ids=str,
)
def test_what_is_recorded_by_exponentials(expression: Any) -> None:
    program, output = recorded(expression)
    assert in_doubles(program, output) == pytest.approx(
        float(expression.subs(VALUES)), rel=1e-12
    )


@given(formulas("x", "y", constants=numbers))
def test_random_formulas_agree_with_lambdify(formula: Any) -> None:
    expression = calculate(formula, {"x": x, "y": y}, in_sympy)
    assume(expression.is_finite and not expression.has(sympy.zoo, sympy.nan))
    program, output = recorded(expression)
    with np.errstate(all="ignore"):
        expected = sympy.lambdify([x, y], expression, "numpy")(
            *map(np.float64, VALUES.values())
        )
        result = in_doubles(program, output)
    assume(np.isfinite(expected) and abs(expected) < 1e6)
    assert result == pytest.approx(float(expected), rel=1e-6, abs=1e-6)


@given(formulas("x", "y", constants=numbers))
def test_programs_survive_the_round_trip(formula: Any) -> None:
    program = Program()
    inputs = {name: program.input(name) for name in ("x", "y")}
    try:
        scalar = calculate(formula, inputs, program.constant)
    except ZeroDivisionError:
        assume(False)
    expression = to_sympy(program, [scalar.node])[0]
    assume(not expression.has(sympy.zoo, sympy.nan))
    difference = scalar - from_sympy(program, expression, inputs)
    forms = LinearForms(program, {(0, 0): difference.node}, (1, 1))
    assert linear_structure(forms, np.random.default_rng(0)).rank == 0


@given(numbers)
def test_numbers_are_exact_both_ways(number: Number) -> None:
    program, output = recorded(in_sympy(number))
    assert program.constants[output.node] == number
    assert to_sympy(program, [output.node]) == [in_sympy(number)]


@pytest.mark.parametrize(
    ("given_number", "value"),
    [
        (sympy.Float("0.0825"), "33/400"),
        (0.1 * x + 0.2 * x, "3*x/10"),
        (sympy.Float("1e-30"), f"1/{10**30}"),
        (2.0 * x**2.0, "2*x**2"),
        (-1.5, "-3/2"),
        (np.float64(0.25), "1/4"),
        (7, "7"),
    ],
)
def test_floats_mean_the_decimal_that_they_show(given_number: Any, value: str) -> None:
    program, output = recorded(given_number)
    assert to_sympy(program, [output.node]) == [sympy.sympify(value, locals={"x": x})]


@pytest.mark.parametrize("k", range(-13, 25, 2))
@pytest.mark.parametrize("function", [sin, cos, tan])
def test_pure_turns_of_15_degrees_fold(function: Any, k: int) -> None:
    program, output = recorded(function(k * pi / 12, evaluate=False))
    value = in_sympy(program.constants[output.node])
    assert sympy.radsimp(value - function(k * pi / 12)) == 0


@pytest.mark.parametrize(
    ("expression", "count"),
    [
        (x**13, {"MUL": 5}),
        (x**16, {"MUL": 4}),
        (x**-8, {"DIV": 1, "MUL": 3}),
        (x / (y * x**3 * (x + 1)), {"ADD": 1, "DIV": 1, "MUL": 3}),
        (x - y, {"SUB": 1}),
        (sin(x + pi / 2, evaluate=False), {"COS": 1}),
        (sin(x + pi, evaluate=False), {"NEG": 1, "SIN": 1}),
        (sin(x + 2 * pi, evaluate=False), {"SIN": 1}),
        (sin(x) ** 2 + 1 / sin(x), {"ADD": 1, "DIV": 1, "MUL": 1, "SIN": 1}),
        (sqrt(x) * sin(sqrt(x)), {"MUL": 1, "SIN": 1, "SQRT": 1}),
    ],
    ids=str,
)
def test_operations_are_few(expression: Any, count: dict[str, int]) -> None:
    program, output = recorded(expression)
    assert program.count([output.node]) == count


def test_every_function_of_programs_is_supported() -> None:
    assert set(SUPPORTED.values()) == set(FUNCTIONS)
    assert all(hasattr(sympy, name) for name in SUPPORTED)


def test_a_regressor_written_in_sympy_has_an_exact_rank() -> None:
    q = sympy.Symbol("x")
    columns = [
        sin(q),
        cos(q),
        sin(q + pi / 4),
        cos(q - pi / 12),
        0.1 * sin(2 * q),
        sin(q) * cos(q),
        q**2,
    ]
    program = Program()
    outputs = [from_sympy(program, c, {"x": program.input("x")}).node for c in columns]
    forms = LinearForms(
        program, {(0, k): node for k, node in enumerate(outputs)}, (1, len(outputs))
    )
    assert linear_structure(forms, np.random.default_rng(1)).rank == 4


@pytest.mark.parametrize(
    ("expression", "reason"),
    [
        (x + sympy.Symbol("z"), r"symbol 'z': not declared \(declared: x, y\)"),
        (sympy.gamma(x), "gamma is not supported .supported: .*sin, cos, tan"),
        (
            sympy.zeta(x),
            "zeta is not supported .supported: .*asin, acos, atan2, Max, Min",
        ),
        (sympy.Piecewise((x, x > 0), (y, True)), "Piecewise"),
        (sympy.Function("q")(x), "replace functions of time"),
        (sympy.Function("q")(x).diff(x), "replace functions of time"),
        (x**200, "exponent 200 is larger"),
        (pi * x, "pi/12"),
        (sin(pi * x), "pi/12"),
        (sin(pi / 7), "pi/12"),
        (sympy.I * x, "real scalar"),
        (sympy.oo, "real scalar"),
        (sympy.nan, "real scalar"),
        (sympy.Matrix([x]), "real scalar"),
        (tan(pi / 2, evaluate=False), "division by zero"),
        (sympy.Eq(x, y), "a scalar sympy expression is needed, not Equality"),
        ("x", "not str"),
        (None, "not NoneType"),
    ],
    ids=str,
)
def test_refusals(expression: Any, reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        recorded(expression)


def test_symbols_of_another_program_are_refused() -> None:
    with pytest.raises(InputError, match="another program: x"):
        from_sympy(Program(), x, {"x": Program().input("x")})


def test_sympy_is_loaded_only_when_used() -> None:
    script = "import sys, echelon.algebra.program.sympy_bridge; print('sympy' in sys.modules)"
    result = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert result.stdout.strip() == "False"
