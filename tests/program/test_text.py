"""Expressions written as text: what they record, and how they are refused."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given

from echelon.errors import InputError
from echelon.program.schedule import FloatArithmetic, Schedule
from echelon.program.tape import Program, Scalar
from echelon.program.text import record_expression
from support.strategies import calculate, formulas

VALUES = {"x": 0.7, "y": 1.3, "qd[j5]": -0.4, "qd[left-knee]": 0.2, "qd[3]": 2.0}


def recorded(text: str) -> tuple[Program, Scalar]:
    program = Program()
    return program, record_expression(text, {n: program.input(n) for n in VALUES}, "effect 'Fs'", program)


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
    "sin(x + pi/2) - cos(-pi/3 - x)": np.sin(0.7 + np.pi / 2) - np.cos(-np.pi / 3 - 0.7),
    "exp(-x) + log(y) + tanh(x*y) + sqrt(x)": np.exp(-0.7) + np.log(1.3) + np.tanh(0.91) + np.sqrt(0.7),
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
    program, output = recorded("0.1 + 0.2 - sin(pi/6)*sqrt(4) + cos(0) + abs(-3/2) + sign(-7)")
    assert program.constants[output.node] == Fraction("0.3") - 1 + 1 + Fraction(3, 2) - 1


@given(formulas("x", "y"))
def test_python_and_text_record_the_same(formula: Any) -> None:
    program = Program()
    names = {n: program.input(n) for n in ("x", "y")}
    try:
        expected = calculate(formula, names, program.constant)
    except ZeroDivisionError:
        assume(False)
    assert record_expression(_written(formula), names, "here", program).node == expected.node


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


@pytest.mark.parametrize(("text", "problem"), REFUSED.items(), ids=[t[:20] for t in REFUSED])
def test_refusals_show_the_text_and_the_place(text: str, problem: str) -> None:
    with pytest.raises(InputError) as caught:
        recorded(text)
    assert problem in str(caught.value)
    assert str(caught.value).startswith("effect 'Fs': ")
    assert text[:20] in str(caught.value)


@pytest.mark.parametrize("use", [bool, float, int, lambda x: x < 1, lambda x: np.sign(np.array([x]))])
def test_recorded_values_do_not_branch(use: Any) -> None:
    with pytest.raises(InputError, match="cannot branch, compare"):
        use(Program().input("x"))


def test_numpy_functions_record() -> None:
    program = Program()
    x = np.array([program.input("x"), program.input("y")])
    result = np.sin(x) * np.exp(-x) + np.abs(x) ** 0.5 + np.tanh(x) / np.cosh(x) + 0.1 * x @ np.ones((2, 2))
    assert {"SIN", "EXP", "ABS", "SQRT", "TANH"} <= set(program.count([s.node for s in result]))
    with pytest.raises(InputError, match="not a finite real number"):
        program.input("x") * float("nan")


def test_an_input_has_one_role() -> None:
    program = Program()
    program.input("x")
    with pytest.raises(InputError, match="'x' is both a state and a symbol"):
        program.input("x", "symbol")
