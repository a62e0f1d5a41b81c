"""Expressions written as text: what they record, how they are refused, and values of functions written with others."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
import sympy
from hypothesis import assume, given

import echelon as ec
from echelon.algebra.program.schedule import FloatArithmetic, Schedule
from echelon.algebra.program.tape import Program, Scalar
from echelon.algebra.program.text import record_expression
from echelon.shared.errors import InputError
from support.strategies import calculate, formulas

VALUES = {"x": 0.7, "y": 1.3, "qd[j5]": -0.4, "qd[left-knee]": 0.2, "qd[3]": 2.0}


def recorded(text: str) -> tuple[Program, Scalar]:
    program = Program()
    return program, record_expression(
        text, {n: program.input(n) for n in VALUES}, "effect 'Fs'", program
    )


def in_doubles(text: str) -> float:
    program, output = recorded(text)
    schedule = Schedule(program, [output.node])
    values = {n: np.array([VALUES[program.inputs[n].name]]) for n in schedule.leaves}
    return float(schedule.run(FloatArithmetic(), values, 1)[0, 0])


MEANINGS = {
    "2*x - y/4": 2 * 0.7 - 1.3 / 4,
    "-x**2": -(0.7**2),
    "x^-3": 0.7**-3,
    "x**0.5 + x**1.5": 0.7**0.5 + 0.7**1.5,
    "x**(1/3)": 0.7 ** (1 / 3),
    "x**y": 0.7**1.3,
    "sin(x)*cos(y) - tan(x)": np.sin(0.7) * np.cos(1.3) - np.tan(0.7),
    "sin(x + pi/2) - cos(-pi/3 - x)": np.sin(0.7 + np.pi / 2)
    - np.cos(-np.pi / 3 - 0.7),
    "exp(-x) + log(y) + tanh(x*y) + sqrt(x)": np.exp(-0.7)
    + np.log(1.3)
    + np.tanh(0.91)
    + np.sqrt(0.7),
    "sign(qd[j5])*abs(qd[j5])": -0.4,
    "qd[left-knee] + qd['left-knee'] + qd[\"left-knee\"]": 0.6,
    "qd[3] + qd['3']": 4.0,
    " ( +x ) ": 0.7,
    "1e-3*x": 0.7e-3,
}


@pytest.mark.parametrize(("text", "value"), MEANINGS.items(), ids=MEANINGS)
def test_meaning(text: str, value: float) -> None:
    assert in_doubles(text) == pytest.approx(value, rel=1e-13)


def test_decimals_are_exact_and_constants_fold() -> None:
    program, output = recorded(
        "0.1 + 0.2 - sin(pi/6)*sqrt(4) + cos(0) + abs(-3/2) + sign(-7)"
    )
    assert (
        program.constants[output.node] == Fraction("0.3") - 1 + 1 + Fraction(3, 2) - 1
    )


@given(formulas("x", "y"))
def test_python_and_text_record_the_same(formula: Any) -> None:
    program = Program()
    names = {n: program.input(n) for n in ("x", "y")}
    try:
        expected = calculate(formula, names, program.constant)
    except ZeroDivisionError:
        assume(False)
    assert (
        record_expression(_written(formula), names, "here", program).node
        == expected.node
    )


def _written(formula: Any) -> str:
    if not isinstance(formula, tuple):
        return f"({formula})"
    return f"({_written(formula[1])}{formula[0]}{_written(formula[2])})"


REFUSED = {
    "x +": "is not an expression",
    "": "is not an expression",
    "x; y": "is not an expression",
    "z + 1": "'z' is unknown (valid: qd[3], qd[j5]",
    "qd[j6]": "'qd[j6]' is unknown",
    "x/0": "divides by zero",
    "x/(y - y)": "divides by zero",
    "x % y": "uses an operation other than",
    "x if y else 1": "has no meaning here",
    "x < y": "has no meaning here",
    "__import__('os')": "has no meaning here",
    "x.real": "has no meaning here",
    "gamma(x)": "has no meaning here",
    "atan2(x)": "has no meaning here",
    "sin(x, y)": "has no meaning here",
    "sin": "'sin' is a function",
    "True*x": "has no meaning here",
    "2j*x": "has no meaning here",
    "1e9999*x": "is beyond the range of double precision",
    "pi*x": "pi is exact only inside",
    "sin(pi/7)": "'pi/7' is not a multiple of pi/12",
    "sin(pi*x)": "'pi*x' is not a multiple of pi/12",
    "log(-1)": "is not real",
    "sqrt(-2)": "is not real",
    "x**1000": "the exponent 1000 is larger than",
    "9**9**9": "larger than",
    "((9**99)**99)**99": "more than",
    "x" + "+x" * 3000: "at most",
    "(" * 900 + "x" + ")" * 900: "is not an expression",
}


@pytest.mark.parametrize(
    ("text", "problem"), REFUSED.items(), ids=[t[:20] for t in REFUSED]
)
def test_refusals_show_the_text_and_the_place(text: str, problem: str) -> None:
    with pytest.raises(InputError) as caught:
        recorded(text)
    assert problem in str(caught.value)
    assert str(caught.value).startswith("effect 'Fs': ")
    assert text[:20] in str(caught.value)


@pytest.mark.parametrize(
    "use", [bool, float, int, lambda x: x < 1, lambda x: np.sign(np.array([x]))]
)
def test_recorded_values_do_not_branch(use: Any) -> None:
    with pytest.raises(InputError, match="cannot branch, compare"):
        use(Program().input("x"))


def test_numpy_functions_record() -> None:
    program = Program()
    x = np.array([program.input("x"), program.input("y")])
    result = (
        np.sin(x) * np.exp(-x)
        + np.abs(x) ** 0.5
        + np.tanh(x) / np.cosh(x)
        + 0.1 * x @ np.ones((2, 2))
    )
    assert {"SIN", "EXP", "ABS", "SQRT", "TANH"} <= set(
        program.count([s.node for s in result])
    )
    with pytest.raises(InputError, match="not a finite real number"):
        program.input("x") * float("nan")


def test_an_input_has_one_role() -> None:
    program = Program()
    program.input("x")
    with pytest.raises(InputError, match="'x' is both a state and a symbol"):
        program.input("x", "symbol")


x, y = sympy.symbols("x y", real=True)

Numeric = Callable[[Any, Any], Any]

CASES: dict[str, tuple[Any, Numeric]] = {
    "sinh(x)": (sympy.sinh(x), lambda x, _: np.sinh(x)),
    "cosh(x)": (sympy.cosh(x), lambda x, _: np.cosh(x)),
    "asin(x)": (sympy.asin(x), lambda x, _: np.arcsin(x)),
    "acos(x)": (sympy.acos(x), lambda x, _: np.arccos(x)),
    "atan2(y, x)": (sympy.atan2(y, x), lambda x, y: np.arctan2(y, x)),
    "max(x, y)": (sympy.Max(x, y), lambda x, y: np.maximum(x, y)),
    "min(x, y)": (sympy.Min(x, y), lambda x, y: np.minimum(x, y)),
    "max(x, 1/5)": (
        sympy.Max(x, sympy.Rational(1, 5)),
        lambda x, _: np.maximum(x, 0.2),
    ),
}


@pytest.mark.parametrize("text", CASES)
def test_values(text: str) -> None:
    rng = np.random.default_rng(0)
    samples = {"x": rng.uniform(-1, 1, 200), "y": rng.uniform(-1, 1, 200)}
    expression, numeric = CASES[text]
    for form in (
        [[text]],
        sympy.Matrix([[expression]]),
        lambda x, y: [[numeric(x, y)]],
    ):
        base = ec.base_parameters(ec.LinearModel(form, ["x", "y"], ["p"]))
        found = base.full_regressor(samples)[:, 0, 0]
        np.testing.assert_allclose(
            found, numeric(samples["x"], samples["y"]), rtol=1e-12, atol=1e-12
        )


def test_steps_and_several_arguments() -> None:
    base = ec.base_parameters(
        ec.LinearModel([["max(x, y, 0)", "heaviside(x)"]], ["x", "y"], ["p", "q"])
    )
    samples = {
        "x": np.array([1.0, -2.0, -3.0, 0.0]),
        "y": np.array([2.0, -1.0, 4.0, -1.0]),
    }
    assert base.full_regressor(samples)[:, 0].tolist() == [
        [2, 1],
        [0, 0],
        [4, 0],
        [0, 0.5],
    ]
    same = ec.LinearModel(
        sympy.Matrix([[sympy.Max(x, y, 0), sympy.Heaviside(x)]]), [x, y], ["p", "q"]
    )
    assert (
        ec.base_parameters(same).full_regressor(samples).tolist()
        == base.full_regressor(samples).tolist()
    )


def test_ends_of_the_arc_functions() -> None:
    base = ec.base_parameters(
        ec.LinearModel([["asin(x)", "acos(x)"]], ["x"], ["p", "q"])
    )
    found = base.full_regressor({"x": np.array([-1.0, 0.0, 1.0])})[:, 0]
    np.testing.assert_allclose(
        found, [[-np.pi / 2, np.pi], [0, np.pi / 2], [np.pi / 2, 0]], atol=1e-15
    )


def test_arc_functions_make_a_right_angle() -> None:
    """The coefficients, 2/π, are no algebraic numbers."""
    base = ec.base_parameters(
        ec.LinearModel([["acos(x)", "asin(x)", "1"]], ["x"], ["p", "q", "r"])
    )
    assert base.certificate.numbers == 1
    np.testing.assert_allclose(base.B_float(), [[1, 0, 2 / np.pi], [0, 1, 2 / np.pi]])


def test_numpy_on_recorded_values() -> None:
    program = Program()
    a, b = program.input("a"), program.input("b")
    several = np.array([a, b], dtype=object)
    assert [s.node for s in np.sin(several)] == [a.sin().node, b.sin().node]
    assert (several * a)[1].node == (a * b).node
    assert np.maximum(a, 0.5).node == ((a + 0.5 + abs(a - 0.5)) / 2).node
    assert np.maximum(a, [1.0, 2.0]).shape == (2,)
    assert np.add(a, b).node == (a + b).node
    with pytest.raises(ec.InputError, match="comparison of a recorded value"):
        np.maximum(several, 0.0)
