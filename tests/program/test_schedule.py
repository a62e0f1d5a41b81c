"""One schedule, three arithmetics: doubles against numpy, residues against fractions."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest
import sympy
from hypothesis import assume, given

from echelon.errors import DegenerateSampleError, EchelonError
from echelon.exact.field import PrimeField
from echelon.exact.polynomial import Number, surd
from echelon.program.schedule import FloatArithmetic, ModularArithmetic, Schedule
from echelon.program.tape import FUNCTIONS, Op, Program
from support.strategies import FIELDS, SMALL_FIELD, calculate, formulas, numbers

NAMES = ("x", "y", "z")
HALF = Fraction(1, 2)
POINTS: list[tuple[Number, ...]] = [(1, 2, 3), (-5 * HALF, Fraction(1, 9), -4), (surd(1, 1, 0, 0), 5, HALF)]


def recorded(formula: Any) -> tuple[Program, list[int], int]:
    program = Program()
    inputs = {name: program.input(name) for name in NAMES}
    try:
        output = calculate(formula, inputs, program.constant).node
    except ZeroDivisionError:
        assume(False)
    return program, [scalar.node for scalar in inputs.values()], output


def exact(formula: Any) -> list[Any]:
    try:
        return [calculate(formula, dict(zip(NAMES, map(_plain, p), strict=True)), _plain) for p in POINTS]
    except ZeroDivisionError:
        assume(False)
        raise


def _plain(x: Any) -> Any:
    return Fraction(x) if isinstance(x, int) else x


@pytest.mark.parametrize("field", FIELDS, ids=["small", "large"])
@given(formula=formulas(*NAMES, constants=numbers))
def test_residues_are_those_of_the_exact_value(formula: Any, field: PrimeField) -> None:
    program, inputs, output = recorded(formula)
    values = {n: np.array([field.embed(p[i]) for p in POINTS], dtype=field.dtype) for i, n in enumerate(inputs)}
    expected = [field.embed(x) for x in exact(formula)]
    try:
        result = Schedule(program, [output]).run(ModularArithmetic(field), values, len(POINTS))
    except DegenerateSampleError:  # a denominator that is divisible by the prime
        assume(False)
    assert result.tolist() == [expected]


@given(formulas(*NAMES, constants=numbers))
def test_doubles_are_close_to_the_exact_value(formula: Any) -> None:
    program, inputs, output = recorded(formula)
    values = {n: np.array([float(p[i]) for p in POINTS]) for i, n in enumerate(inputs)}
    expected = [float(x) for x in exact(formula)]
    with np.errstate(all="ignore"):
        result = Schedule(program, [output]).run(FloatArithmetic(), values, len(POINTS))[0]
    assert result == pytest.approx(expected, rel=1e-6, abs=1e-6) or not np.isfinite(result).all()


@pytest.mark.parametrize("op", FUNCTIONS)
def test_functions_of_doubles(op: Op) -> None:
    program = Program()
    y = program.function(op, program.input("x"))
    x = np.array([0.25, 1.0, 2.5])
    result = Schedule(program, [y.node]).run(FloatArithmetic(), {program.input("x").node: x}, 3)
    name = "Abs" if op is Op.ABS else op.name.lower()
    assert result[0] == pytest.approx([float(getattr(sympy, name)(v)) for v in x], rel=1e-14)


@pytest.mark.parametrize("op", FUNCTIONS)
def test_functions_have_no_residues(op: Op) -> None:
    program = Program()
    y = program.function(op, program.input("x"))
    with pytest.raises(EchelonError, match=op.name.lower()):
        Schedule(program, [y.node]).run(ModularArithmetic(SMALL_FIELD), {program.input("x").node: np.ones(1)}, 1)


def test_outputs_may_be_inputs_constants_repeated_and_in_any_order() -> None:
    program = Program()
    x, y = program.input("x"), program.input("y")
    outputs = [(x * y).node, program.constant(Fraction(1, 4)).node, x.node, (x * y).node, (-y).node]
    values = {x.node: np.array([1.0, 2.0]), y.node: np.array([3.0, 4.0])}
    result = Schedule(program, outputs).run(FloatArithmetic(), values, 2)
    assert result.tolist() == [[3, 8], [0.25, 0.25], [1, 2], [3, 8], [-3, -4]]


def test_leaves_are_taken_as_they_are_given() -> None:
    program = Program()
    x = program.input("x")
    s = program.sin(x)
    schedule = Schedule(program, [(s * s + 1).node], leaves=[s.node])
    assert schedule.leaves == [s.node]
    assert schedule.run(ModularArithmetic(SMALL_FIELD), {s.node: np.array([3, 4])}, 2).tolist() == [[10, 17]]


@pytest.mark.parametrize("samples", [0, 3])
def test_nothing_to_do(samples: int) -> None:
    program = Program()
    assert Schedule(program, []).run(FloatArithmetic(), {}, samples).shape == (0, samples)
    assert Schedule(program, [program.zero.node]).run(FloatArithmetic(), {}, samples).tolist() == [[0.0] * samples]


def test_a_vanishing_denominator_is_degenerate() -> None:
    program = Program()
    x = program.input("x")
    schedule = Schedule(program, [(1 / x).node])
    with pytest.raises(DegenerateSampleError):
        schedule.run(ModularArithmetic(SMALL_FIELD), {x.node: np.array([1, 0])}, 2)
