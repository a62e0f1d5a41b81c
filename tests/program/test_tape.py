"""Recording: what is folded, what is shared, and that neither changes a value."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Any

import pytest
from hypothesis import assume, given

from echelon.algebra.exact.expressions import parse
from echelon.algebra.exact.polynomial import Number, surd
from echelon.algebra.program.operations import FUNCTIONS, Op
from echelon.algebra.program.tape import Input, Program, Scalar
from echelon.shared.errors import InputError
from support.strategies import calculate, formulas, numbers

ROOT2 = surd(0, 1, 0, 0)
POINT: dict[str, Number] = {"x": Fraction(2, 3), "y": -5, "z": ROOT2 + 1}


def replay(program: Program, node: int) -> Number:
    """Value of a node at POINT, one operation after the other."""
    ops, lhs, rhs = program.ops, program.lhs, program.rhs
    values: dict[int, Any] = {}
    for n in program.needed([node]):
        a, b = values.get(lhs[n]), values.get(rhs[n])
        if ops[n] in (Op.INPUT, Op.CONSTANT):
            values[n] = (
                POINT[program.inputs[n].name]
                if n in program.inputs
                else program.constants[n]
            )
        elif ops[n] == Op.NEG:
            values[n] = -a
        else:
            values[n] = calculate(
                ("+-*/"[(Op.ADD, Op.SUB, Op.MUL, Op.DIV).index(Op(ops[n]))], a, b),
                {},
                _plain,
            )
    result: Number = values[node]
    return result


def _plain(x: Any) -> Any:
    return Fraction(x) if isinstance(x, int) else x


def recorded() -> tuple[Program, dict[str, Scalar]]:
    program = Program()
    return program, {name: program.input(name) for name in "xyz"}


@given(formulas(*"xyz", constants=numbers))
def test_recording_keeps_the_value(formula: Any) -> None:
    program, inputs = recorded()
    try:
        expected = calculate(formula, {k: _plain(v) for k, v in POINT.items()}, _plain)
    except ZeroDivisionError:
        assume(False)
    assert (
        replay(program, calculate(formula, inputs, program.constant).node) == expected
    )


@given(formulas(*"xyz", constants=numbers))
def test_writing_twice_adds_nothing(formula: Any) -> None:
    program, inputs = recorded()
    try:
        first = calculate(formula, inputs, program.constant)
    except ZeroDivisionError:
        assume(False)
    size = len(program)
    assert calculate(formula, inputs, program.constant).node == first.node
    assert len(program) == size


Formula = Callable[[Any, Any], Any]

FOLDED: dict[str, tuple[Formula, dict[str, int]]] = {
    "zero and one": (lambda x, y: 0 * x + 1 * y + (x - x) + 0, {}),
    "zero over anything": (lambda x, y: (x - x) / y, {}),
    "constants": (
        lambda x, _: x + ((0 * x + Fraction(1, 3) + 2) * 3 - 1) / 5,
        {"ADD": 1},
    ),
    "negation twice": (lambda x, _: -(0 - x), {}),
    "sum with a negative": (lambda x, y: x + (-y), {"SUB": 1}),
    "difference with a negative": (lambda x, y: x - (-y), {"ADD": 1}),
    "negated difference": (lambda x, y: -(x - y), {"SUB": 1}),
    "product of negatives": (lambda x, y: (-x) * (-y), {"MUL": 1}),
    "sum of negatives": (lambda x, y: -x - y, {"ADD": 1, "NEG": 1}),
    "common subexpression": (lambda x, y: (x + y) * (y + x), {"ADD": 1, "MUL": 1}),
    "one product for both signs": (
        lambda x, y: (x * 3) / y + (x * -3),
        {"DIV": 1, "MUL": 1, "SUB": 1},
    ),
    "division by a constant": (lambda x, _: x / 4, {"MUL": 1}),
    "surds": (
        lambda x, _: ROOT2 * (x * ROOT2 + ROOT2 / 2) - (1 - x) / ROOT2,
        {"ADD": 1, "MUL": 3, "SUB": 2},
    ),
}


@pytest.mark.parametrize(("formula", "count"), FOLDED.values(), ids=FOLDED.keys())
def test_folding(formula: Formula, count: dict[str, int]) -> None:
    program, inputs = recorded()
    result = formula(inputs["x"], inputs["y"])
    assert program.count([result.node]) == count
    assert replay(program, result.node) == formula(Fraction(2, 3), Fraction(-5))


@pytest.mark.parametrize("number", [2, Fraction(1, 3), ROOT2])
def test_numbers_on_either_side(number: Number) -> None:
    program, inputs = recorded()
    x, value = inputs["x"], Fraction(2, 3)
    for scalar, expected in (
        (number + x, number + value),
        (x + number, value + number),
        (number - x, number - value),
        (x - number, value - number),
        (number * x, number * value),
        (x * number, value * number),
        (number / x, number / value),
        (x / number, value / number),
    ):
        assert isinstance(scalar, Scalar)
        assert replay(program, scalar.node) == expected


def test_division_by_zero_is_refused() -> None:
    x = Program().input("x")
    with pytest.raises(ZeroDivisionError):
        x / (x - x)


@pytest.mark.parametrize("op", FUNCTIONS)
def test_functions_of_zero(op: Op) -> None:
    program = Program()
    if op is Op.LOG:
        with pytest.raises(InputError, match="not real"):
            program.function(op, program.zero)
        assert program.function(op, program.one).is_zero
    else:
        at_zero = program.one if op in (Op.COS, Op.EXP) else program.zero
        assert program.function(op, program.zero).node == at_zero.node
    x = program.input("x")
    assert program.function(op, x).node == program.function(op, x).node
    assert program.ops[program.function(op, x).node] == op


def test_inputs_and_constants_are_shared() -> None:
    program = Program()
    assert program.input("x").node == program.input("x").node
    assert program.inputs == {2: Input("x", "state")}
    assert program.constant(Fraction(4, 2)).node == program.constant(2).node
    assert program.constant(0).is_zero
    assert not program.one.is_zero


def test_geometry_becomes_symbols() -> None:
    program = Program()
    x = program.polynomial(parse("2*d^2*cos(a) - sin(a)"))
    assert x.node == program.polynomial(parse("2*cos(a)*d^2 - sin(a)")).node
    assert sorted((i.name, i.role) for i in program.inputs.values()) == [
        ("a", "symbol"),
        ("d", "symbol"),
    ]
    assert program.count([x.node]) == {"COS": 1, "MUL": 3, "SIN": 1, "SUB": 1}
    assert program.polynomial(parse("0")).is_zero


def test_only_what_is_needed_counts() -> None:
    program, inputs = recorded()
    x, y = inputs["x"], inputs["y"]
    s = (x * y).sin()
    useful, _useless = s + x, x / y
    assert program.count([useful.node]) == {"ADD": 1, "MUL": 1, "SIN": 1}
    assert program.count([useful.node, (x * y).node]) == {"ADD": 1, "MUL": 1, "SIN": 1}
    assert program.needed([useful.node], leaves=[s.node]) == [
        x.node,
        s.node,
        useful.node,
    ]
    assert program.count([]) == {}


def test_a_deep_program_needs_no_deep_stack() -> None:
    program, inputs = recorded()
    total = inputs["x"]
    for _ in range(20_000):
        total = total * inputs["y"] + 1
    assert program.count([total.node]) == {"ADD": 20_000, "MUL": 20_000}


def test_text() -> None:
    program = Program()
    assert repr(program.input("x") * 2) == "Scalar(MUL, node 4)"
    assert repr(program) == "Program(5 nodes, 1 inputs)"


@pytest.mark.parametrize("value", [0, 3, -3, Fraction(-2, 7), ROOT2 + -1, ROOT2 + -2])
def test_signs_and_sizes_of_constants_are_folded(value: Number) -> None:
    """|x| = sign(x) · x ≥ 0, also of negative numbers and of roots."""
    program = Program()
    constant = program.constant(value)
    sign, size = (program.function(op, constant).number for op in (Op.SIGN, Op.ABS))
    assert (sign, size) == (
        (float(value) > 0) - (float(value) < 0),
        value if float(value) >= 0 else -value,
    )
