"""Bounds of degrees and coefficients, which error probabilities rest on, against expanded expressions."""

from __future__ import annotations

from fractions import Fraction
from math import log2, sqrt
from typing import Any

import pytest
import sympy
from hypothesis import assume, given

from echelon.exact.polynomial import surd
from echelon.program.schedule import norm_bits, size_bound
from echelon.program.tape import Program, Scalar
from support.strategies import calculate, formulas

NAMES = ("x", "y", "z")


@given(formulas(*NAMES))
def test_neither_degree_nor_coefficients_exceed_their_bounds(formula: Any) -> None:
    program = Program()
    inputs = {name: program.input(name) for name in NAMES}
    symbols = {name: sympy.Symbol(name) for name in NAMES}
    try:
        output = calculate(formula, inputs, program.constant).node
        quotient = calculate(formula, symbols, lambda c: sympy.Rational(c.numerator, c.denominator))
    except ZeroDivisionError:
        assume(False)
    assume(not quotient.has(sympy.zoo, sympy.nan))
    size = size_bound(program, [output])
    parts = [sympy.Poly(part, *symbols.values()) for part in sympy.fraction(sympy.cancel(quotient))]
    assert size.degree >= max(part.total_degree() for part in parts)
    if quotient.is_polynomial():  # a common factor may have larger coefficients without it
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
        (PROGRAM.sin(X * X * X) * Y, 2, 0.0),
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
    assert size_bound(program, [(x * 9).node, (x * y).node]).bits == pytest.approx(log2(9))


def test_sizes_of_numbers() -> None:
    assert norm_bits([Fraction(1, 3), -2], 3) == pytest.approx(log2(7))
    assert norm_bits([surd(1, -1, 0, Fraction(1, 2))], 2) == pytest.approx(log2(2 + 2 * sqrt(2) + sqrt(6)))
    assert norm_bits([Fraction(10**400)]) == pytest.approx(400 * log2(10))
