"""Derivatives of programs against SymPy's."""

from __future__ import annotations

import numpy as np
import pytest
import sympy

from echelon.algebra.program.derivatives import derivatives
from echelon.algebra.program.schedule import FloatArithmetic, Schedule
from echelon.algebra.program.tape import Program
from echelon.algebra.program.text import record_expression

EXPRESSIONS = [
    "3*x - y + 2",
    "x*y - (x - y)*(x*x)",
    "-x*(y - x)/(1 + y)",
    "1/(x*y)",
    "sin(x*y) + cos(x - y)",
    "tan(x)*y",
    "exp(-x*x)*y",
    "log(x + y)",
    "tanh(x*y)",
    "sqrt(x + 2*y)",
    "atan(x/y)",
    "abs(x - 3)*y",
    "sign(x - 3)*y*x",
    "x**2.5*y**3",
]
X, Y = np.random.default_rng(4).uniform(0.2, 1.5, (2, 7))


@pytest.mark.parametrize("reverse", [False, True], ids=["forward", "reverse"])
def test_against_sympy(reverse: bool) -> None:
    program = Program()
    names = {"x": program.input("x"), "y": program.input("y")}
    outputs = [
        record_expression(text, names, "test", program).node for text in EXPRESSIONS
    ]
    inputs = [names["x"].node, names["y"].node]
    found = derivatives(program, outputs, inputs, reverse=reverse)
    schedule = Schedule(program, list(found.values()))
    leaves = {
        node: value
        for node, value in zip(inputs, (X, Y), strict=True)
        if node in schedule.leaves
    }
    values = dict(
        zip(found, schedule.run(FloatArithmetic(), leaves, len(X)), strict=True)
    )
    symbols = sympy.symbols("x y", real=True)
    for i, text in enumerate(EXPRESSIONS):
        expression = sympy.sympify(
            text.replace("abs", "Abs"), {"x": symbols[0], "y": symbols[1]}
        )
        for j, symbol in enumerate(symbols):
            expected = sympy.lambdify(
                symbols,
                sympy.diff(expression, symbol),
                ["numpy", {"DiracDelta": np.zeros_like}],
            )(X, Y)
            np.testing.assert_allclose(
                values.get((i, j), 0),
                expected,
                rtol=1e-12,
                err_msg=f"d({text})/d{symbol}",
            )


@pytest.mark.parametrize("reverse", [False, True], ids=["forward", "reverse"])
def test_what_is_zero_is_left_out(reverse: bool) -> None:
    program = Program()
    x, y, g = program.input("x"), program.input("y"), program.input("g", "symbol")
    outputs = [
        (g * y).node,
        x.node,
        x.sign().node,
        program.one.node,
        (x * y).node,
        (x * y).node,
    ]
    found = derivatives(program, outputs, [x.node, y.node], reverse=reverse)
    expected = {
        (0, 1): g,
        (1, 0): program.one,
        (4, 0): y,
        (4, 1): x,
        (5, 0): y,
        (5, 1): x,
    }
    assert found == {key: value.node for key, value in expected.items()}


@pytest.mark.parametrize("reverse", [False, True], ids=["forward", "reverse"])
def test_by_an_operation(reverse: bool) -> None:
    """An independent need not be an input, and may depend on another independent."""
    program = Program()
    x = program.input("x")
    s = x * x
    found = derivatives(program, [(s * x).node], [s.node], reverse=reverse)
    assert found == {(0, 0): x.node}


def test_common_derivatives_are_recorded_once() -> None:
    program = Program()
    x, y = program.input("x"), program.input("y")
    output = [(x.sin() * y.exp()).node]
    first = derivatives(program, output, [x.node, y.node])
    size = len(program)
    assert derivatives(program, output, [x.node, y.node], reverse=True) == first
    assert len(program) == size
