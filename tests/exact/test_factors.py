"""Factorisation over the rational numbers: products come back, and factors are irreducible."""

from __future__ import annotations

from fractions import Fraction

import pytest
from hypothesis import assume, given

from echelon.exact.expressions import parse
from echelon.exact.factors import divided, factors
from echelon.exact.polynomial import Polynomial
from support.strategies import polynomials, rationals


def product(constant: Fraction, found: list[tuple[Polynomial, int]]) -> Polynomial:
    total = Polynomial.constant(constant)
    for factor, exponent in found:
        total = total * factor**exponent
    return total


@given(polynomials("x", "y", coefficients=rationals), polynomials("x", "z", coefficients=rationals))
def test_factors_multiply_to_the_polynomial(a: Polynomial, b: Polynomial) -> None:
    """Also of squares, whose constants count twice."""
    whole = a * a * b
    assume(whole)
    assert product(*factors(whole)) == whole


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("3*(2*x + 1)^2", (3, {"1 + 2*x": 2})),
        ("(x^2 - y^2)*(x + y)/4", (Fraction(1, 4), {"x + y": 2, "x - y": 1})),
        ("-6", (-6, {})),
        ("4*x^3", (4, {"x": 3})),
    ],
)
def test_known_factors(text: str, expected: tuple[Fraction, dict[str, int]]) -> None:
    constant, found = factors(parse(text))
    assert abs(constant) == abs(expected[0])
    assert len(found) == len(expected[1])
    for name, exponent in expected[1].items():
        assert any(f in (parse(name), -parse(name)) and e == exponent for f, e in found)


@given(polynomials("x", "y", coefficients=rationals), polynomials("x", "y", coefficients=rationals))
def test_division_leaves_quotient_and_rest(a: Polynomial, b: Polynomial) -> None:
    assume(b)
    quotient, rest = divided(a, b, ("x", "y"))
    assert quotient * b + rest == a
