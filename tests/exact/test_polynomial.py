"""Polynomials: ring axioms, one normal form per function, agreement with sympy."""

from __future__ import annotations

import math
from fractions import Fraction

import pytest
import sympy
from hypothesis import given
from hypothesis import strategies as st

from echelon.algebra.exact.expressions import parse
from echelon.algebra.exact.field import PrimeField
from echelon.algebra.exact.polynomial import (
    Number,
    Polynomial,
    as_polynomial,
    float_generators,
    surd,
)
from support.strategies import FIELDS, in_sympy, numbers, polynomials, rationals

LENGTHS = polynomials("d3", "r4")
MIXED = polynomials("cos(a)", "sin(a)", "cos(b)", "sin(b)", "d3")
C, S = Polynomial.generator("cos(a)"), Polynomial.generator("sin(a)")
D = Polynomial.generator("d3")
ROOT2 = surd(0, 1, 0, 0)


@given(MIXED, MIXED, MIXED)
def test_ring_axioms(p: Polynomial, q: Polynomial, r: Polynomial) -> None:
    assert p + q == q + p
    assert p * q == q * p
    assert (p + q) + r == p + (q + r)
    assert (p * q) * r == p * (q * r)
    assert p * (q + r) == p * q + p * r
    assert p - q == -(q - p)
    assert p * 1 == p + 0 == p
    assert not p - p
    assert Polynomial.sum([p, q, r]) == p + q + r


@given(LENGTHS, LENGTHS, st.integers(0, 4))
def test_arithmetic_agrees_with_sympy(
    p: Polynomial, q: Polynomial, exponent: int
) -> None:
    for ours, theirs in (
        (p + q, in_sympy(p) + in_sympy(q)),
        (p * q, in_sympy(p) * in_sympy(q)),
        (3 - p, 3 - in_sympy(p)),
        (p**exponent, in_sympy(p) ** exponent),
    ):
        assert sympy.expand(in_sympy(ours) - theirs) == 0


@given(MIXED, MIXED, rationals, rationals, rationals)
def test_evaluation_on_the_circle_is_a_homomorphism(
    p: Polynomial, q: Polynomial, t: Fraction, u: Fraction, d: Fraction
) -> None:
    point: dict[str, Number] = {"d3": d}
    for name, x in (("a", Fraction(t)), ("b", Fraction(u))):
        point |= {
            f"cos({name})": (1 - x * x) / (1 + x * x),
            f"sin({name})": 2 * x / (1 + x * x),
        }
    (f, g), product = (
        (r.evaluate(point, lambda n: n) for r in (p, q)),
        (p * q).evaluate(point, lambda n: n),
    )
    assert product == f * g
    assert (p + q).evaluate(point, lambda n: n) == f + g


@pytest.mark.parametrize("field", FIELDS, ids=["small", "large"])
@given(p=LENGTHS, d=rationals, r=rationals)
def test_reduction_modulo_a_prime_is_a_homomorphism(
    p: Polynomial, d: Number, r: Number, field: PrimeField
) -> None:
    residue = p.evaluate({"d3": field.embed(d), "r4": field.embed(r)}, field.embed)
    assert residue % field.p == field.embed(p.evaluate({"d3": d, "r4": r}, lambda n: n))


@pytest.mark.parametrize(
    ("left", "right"),
    [
        (S * S + C * C, 1),
        (S**3, S - S * C * C),
        ((S + C) ** 2 - 2 * S * C, Polynomial.constant(1)),
        ((D + ROOT2) * (D - ROOT2), D * D - 2),
        (D * ROOT2, ROOT2 * D),
        (ROOT2 + D, D + ROOT2),
        (ROOT2 - D, -(D - ROOT2)),
    ],
)
def test_equal_functions_have_one_form(
    left: Polynomial, right: Polynomial | Number
) -> None:
    assert left == right
    assert right == left
    assert hash(left) == hash(right)
    assert left.terms == as_polynomial(right).terms


@given(numbers)
def test_a_constant_is_its_number(x: Number) -> None:
    constant = Polynomial.constant(x)
    assert constant.number == x
    assert constant == x
    assert x == constant
    assert hash(constant) == hash(x)
    assert bool(constant) == bool(x)
    assert (constant + D).number is None


def test_inspection() -> None:
    p = D * S * 2 + C
    assert p.generators() == ["cos(a)", "d3", "sin(a)"]
    assert p.symbols() == ["a", "d3"]
    assert [c for _, c in p.sorted_terms()] == [1, 2]
    assert Polynomial.constant(0).symbols() == []
    assert p != "2*d3*sin(a)"


def test_a_negative_power_is_refused() -> None:
    with pytest.raises(ValueError, match="RationalFunction"):
        D**-1


@given(MIXED)
def test_text_is_read_back(p: Polynomial) -> None:
    assert parse(repr(p)) == p
    assert sympy.expand(sympy.sympify(repr(p).replace("^", "**")) - in_sympy(p)) == 0


@given(MIXED)
def test_float_generators_give_float_values(p: Polynomial) -> None:
    symbols = {"a": 0.3, "b": -1.2, "d3": 0.45}
    values = float_generators(p.generators(), symbols)
    expected = float(in_sympy(p).subs(symbols))
    assert math.isclose(p.evaluate(values, float), expected, rel_tol=1e-9, abs_tol=1e-9)
