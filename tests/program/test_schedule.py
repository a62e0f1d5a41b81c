"""One schedule, three arithmetics, against NumPy and fractions; bounds of degrees and coefficients."""

from __future__ import annotations

from fractions import Fraction
from math import log2, sqrt
from typing import Any

import numpy as np
import pytest
import sympy
from hypothesis import assume, given

from echelon.algebra.exact.field import PrimeField
from echelon.algebra.exact.polynomial import Number, surd
from echelon.algebra.program.operations import FUNCTIONS, Op
from echelon.algebra.program.schedule import (
    FloatArithmetic,
    ModularArithmetic,
    Schedule,
    norm_bits,
    size_bound,
)
from echelon.algebra.program.tape import Program, Scalar
from echelon.shared.errors import DegenerateSampleError, EchelonError
from support.strategies import FIELDS, SMALL_FIELD, calculate, formulas, numbers

NAMES = ("x", "y", "z")
HALF = Fraction(1, 2)
POINTS: list[tuple[Number, ...]] = [
    (1, 2, 3),
    (-5 * HALF, Fraction(1, 9), -4),
    (surd(1, 1, 0, 0), 5, HALF),
]


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
        return [
            calculate(formula, dict(zip(NAMES, map(_plain, p), strict=True)), _plain)
            for p in POINTS
        ]
    except ZeroDivisionError:
        assume(False)
        raise


def _plain(x: Any) -> Any:
    return Fraction(x) if isinstance(x, int) else x


@pytest.mark.parametrize("field", FIELDS, ids=["small", "large"])
@given(formula=formulas(*NAMES, constants=numbers))
def test_residues_are_those_of_the_exact_value(formula: Any, field: PrimeField) -> None:
    program, inputs, output = recorded(formula)
    values = {
        n: np.array([field.embed(p[i]) for p in POINTS], dtype=field.dtype)
        for i, n in enumerate(inputs)
    }
    expected = [field.embed(x) for x in exact(formula)]
    try:
        result = Schedule(program, [output]).run(
            ModularArithmetic(field), values, len(POINTS)
        )
    except DegenerateSampleError:  # a denominator that is divisible by the prime
        assume(False)
    assert result.tolist() == [expected]


@given(formulas(*NAMES, constants=numbers))
def test_doubles_are_close_to_the_exact_value(formula: Any) -> None:
    program, inputs, output = recorded(formula)
    values = {n: np.array([float(p[i]) for p in POINTS]) for i, n in enumerate(inputs)}
    expected = [float(x) for x in exact(formula)]
    with np.errstate(all="ignore"):
        result = Schedule(program, [output]).run(
            FloatArithmetic(), values, len(POINTS)
        )[0]
    assert (
        result == pytest.approx(expected, rel=1e-6, abs=1e-6)
        or not np.isfinite(result).all()
    )


@pytest.mark.parametrize("op", FUNCTIONS)
def test_functions_of_doubles(op: Op) -> None:
    program = Program()
    y = program.function(op, program.input("x"))
    x = np.array([0.25, 1.0, 2.5])
    result = Schedule(program, [y.node]).run(
        FloatArithmetic(), {program.input("x").node: x}, 3
    )
    name = "Abs" if op is Op.ABS else op.name.lower()
    assert result[0] == pytest.approx(
        [float(getattr(sympy, name)(v)) for v in x], rel=1e-14
    )


@pytest.mark.parametrize("op", FUNCTIONS)
def test_functions_have_no_residues(op: Op) -> None:
    program = Program()
    y = program.function(op, program.input("x"))
    with pytest.raises(EchelonError, match=op.name.lower()):
        Schedule(program, [y.node]).run(
            ModularArithmetic(SMALL_FIELD), {program.input("x").node: np.ones(1)}, 1
        )


def test_outputs_may_be_inputs_constants_repeated_and_in_any_order() -> None:
    program = Program()
    x, y = program.input("x"), program.input("y")
    outputs = [
        (x * y).node,
        program.constant(Fraction(1, 4)).node,
        x.node,
        (x * y).node,
        (-y).node,
    ]
    values = {x.node: np.array([1.0, 2.0]), y.node: np.array([3.0, 4.0])}
    result = Schedule(program, outputs).run(FloatArithmetic(), values, 2)
    assert result.tolist() == [[3, 8], [0.25, 0.25], [1, 2], [3, 8], [-3, -4]]


def test_leaves_are_taken_as_they_are_given() -> None:
    program = Program()
    x = program.input("x")
    s = x.sin()
    schedule = Schedule(program, [(s * s + 1).node], leaves=[s.node])
    assert schedule.leaves == [s.node]
    assert schedule.run(
        ModularArithmetic(SMALL_FIELD), {s.node: np.array([3, 4])}, 2
    ).tolist() == [[10, 17]]


@pytest.mark.parametrize("samples", [0, 3])
def test_nothing_to_do(samples: int) -> None:
    program = Program()
    assert Schedule(program, []).run(FloatArithmetic(), {}, samples).shape == (
        0,
        samples,
    )
    assert Schedule(program, [program.zero.node]).run(
        FloatArithmetic(), {}, samples
    ).tolist() == [[0.0] * samples]


def test_a_vanishing_denominator_is_degenerate() -> None:
    program = Program()
    x = program.input("x")
    schedule = Schedule(program, [(1 / x).node])
    with pytest.raises(DegenerateSampleError):
        schedule.run(ModularArithmetic(SMALL_FIELD), {x.node: np.array([1, 0])}, 2)


@given(formulas(*NAMES))
def test_neither_degree_nor_coefficients_exceed_their_bounds(formula: Any) -> None:
    program = Program()
    inputs = {name: program.input(name) for name in NAMES}
    symbols = {name: sympy.Symbol(name) for name in NAMES}
    try:
        output = calculate(formula, inputs, program.constant).node
        quotient = calculate(
            formula, symbols, lambda c: sympy.Rational(c.numerator, c.denominator)
        )
    except ZeroDivisionError:
        assume(False)
    assume(not quotient.has(sympy.zoo, sympy.nan))
    size = size_bound(program, [output])
    parts = [
        sympy.Poly(part, *symbols.values())
        for part in sympy.fraction(sympy.cancel(quotient))
    ]
    assert size.degree >= max(part.total_degree() for part in parts)
    if (
        quotient.is_polynomial()
    ):  # a common factor may have larger coefficients without it
        assert log2(max(1, *map(abs, parts[0].coeffs()))) <= size.bits + 1e-9


PROGRAM = Program()
X, Y = PROGRAM.input("x"), PROGRAM.input("y")
HALF, THIRD = Fraction(1, 2), Fraction(1, 3)


@pytest.mark.parametrize(
    ("output", "degree", "bits"),
    [
        (PROGRAM.one, 0, 0.0),
        (X, 1, 0.0),
        (-(X * X) * Y * 7, 3, log2(7)),
        (X * X + Y, 2, 1.0),
        (1 / (X * Y), 2, 0.0),
        (X / Y + Y / X, 2, 1.0),
        ((X * X * X).sin() * Y, 2, 0.0),
        ((X + Y) * (X + Y) * (X - Y), 3, 3.0),
        (X * HALF + Y * THIRD, 1, log2(5)),  # (3x + 2y)/6
        ((X * HALF + Y * THIRD) * X, 2, log2(5)),
        (X * HALF + Y, 1, log2(3)),  # (x + 2y)/2
        (X * HALF - Y * X, 2, log2(3)),
        (Y * X * X - X * HALF, 3, log2(3)),
        (Y - X * HALF, 1, log2(3)),
    ],
)
def test_bounds_of_simple_programs(output: Scalar, degree: int, bits: float) -> None:
    size = size_bound(PROGRAM, [output.node])
    assert (size.degree, size.bits) == (degree, pytest.approx(bits))


def test_the_largest_of_several_outputs_counts() -> None:
    program = Program()
    x, y = program.input("x"), program.input("y")
    assert size_bound(program, []).degree == 0
    assert size_bound(program, [x.node, (x * y).node]).degree == 2
    assert size_bound(program, [(x * 9).node, (x * y).node]).bits == pytest.approx(
        log2(9)
    )


def test_sizes_of_numbers() -> None:
    assert norm_bits([Fraction(1, 3), -2], 3) == pytest.approx(log2(7))
    assert norm_bits([surd(1, -1, 0, Fraction(1, 2))], 2) == pytest.approx(
        log2(2 + 2 * sqrt(2) + sqrt(6))
    )
    assert norm_bits([Fraction(10**400)]) == pytest.approx(400 * log2(10))
