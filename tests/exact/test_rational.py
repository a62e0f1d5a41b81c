"""Quotients: field axioms, lowest terms as sympy finds them, values in prime fields as FLINT computes them; factors."""

from __future__ import annotations

from fractions import Fraction

import flint
import pytest
import sympy
from hypothesis import assume, given
from hypothesis import strategies as st

from echelon.algebra.exact.expressions import parse
from echelon.algebra.exact.polynomial import Polynomial
from echelon.algebra.exact.rational import ONE, RationalFunction, sum_of_products
from echelon.algebra.exact.ring import divided, factors
from support.strategies import SMALL_FIELD, in_sympy, integers, polynomials, rationals

LENGTHS = polynomials("d", "r", coefficients=rationals)
MIXED = polynomials("cos(a)", "sin(a)", "d")


def quotients(
    parts: st.SearchStrategy[Polynomial],
) -> st.SearchStrategy[RationalFunction]:
    return st.builds(RationalFunction, parts, parts.filter(bool))


@given(quotients(LENGTHS), quotients(LENGTHS), quotients(LENGTHS))
def test_field_axioms(
    x: RationalFunction, y: RationalFunction, z: RationalFunction
) -> None:
    assert x + y == y + x
    assert x * y == y * x
    assert (x + y) + z == x + (y + z)
    assert x * (y + z) == x * y + x * z
    assert not x - x
    if y:
        assert (x / y) * y == x


@pytest.mark.parametrize("root", ["sqrt(2)", "sqrt(3)", "sqrt(6)", "sin(a)"])
def test_sums_of_products_reduce_squares_of_roots(root: str) -> None:
    first, second = (
        RationalFunction(parse("d"), parse(f"{k}*d + {root}")) for k in (1, 2)
    )
    assert sum_of_products([(first, first), (ONE, second)]) == first * first + second


@given(LENGTHS, LENGTHS, LENGTHS)
def test_lowest_terms_agree_with_sympy(
    p: Polynomial, q: Polynomial, common: Polynomial
) -> None:
    assume(q and common)
    ours = RationalFunction(p * common, q * common)
    top, bottom = sympy.fraction(sympy.cancel(in_sympy(p) / in_sympy(q)))
    assert (
        sympy.expand(
            in_sympy(ours.numerator) * bottom - in_sympy(ours.denominator) * top
        )
        == 0
    )
    d, r = sympy.symbols("d r")
    ours_degree, their_degree = (
        sympy.Poly(e, d, r).total_degree() for e in (in_sympy(ours.denominator), bottom)
    )
    assert ours_degree == their_degree
    assert ours == RationalFunction(p, q)
    assert hash(ours) == hash(RationalFunction(p, q))


@given(quotients(MIXED), quotients(MIXED), integers.filter(bool), integers)
def test_values_in_a_prime_field(
    x: RationalFunction, y: RationalFunction, t: int, d: int
) -> None:
    p = SMALL_FIELD.p
    scale = flint.nmod(1, p) / (1 + t * t)
    point = {
        "cos(a)": scale * (1 - t * t),
        "sin(a)": scale * 2 * t,
        "d": flint.nmod(d, p),
    }

    def value(f: RationalFunction) -> flint.nmod:
        assume(int(f.denominator.evaluate(point, number)))
        return f.evaluate(point, number)

    def number(n: object) -> flint.nmod:
        return flint.nmod(SMALL_FIELD.embed(n), p)  # type: ignore[arg-type]

    assert value(x + y) == value(x) + value(y)
    assert value(x * y) == value(x) * value(y)
    if y and value(y) != 0:
        assert value(x / y) == value(x) / value(y)


@pytest.mark.parametrize(
    ("top", "bottom", "expected"),
    [
        ("d^2 - r^2", "2*d + 2*r", "d/2 - r/2"),
        ("0", "d", "0"),
        ("3*d", "6", "d/2"),
        ("2", "sqrt(2)", "sqrt(2)"),
        ("1 - cos(a)^2", "sin(a)", "sin(a)"),
        ("d*cos(a)^2 - d", "sin(a)", "-d*sin(a)"),
        ("d^2 - 2", "d + sqrt(2)", "d - sqrt(2)"),
        ("1 + cos(a) - cos(a)^2 - cos(a)^3", "sin(a)", "sin(a) + sin(a)*cos(a)"),
        ("d^2 - 2*d*sqrt(6) + 6", "d - sqrt(6)", "d - sqrt(6)"),
    ],
)
def test_a_quotient_that_is_a_polynomial_becomes_one(
    top: str, bottom: str, expected: str
) -> None:
    quotient = RationalFunction(parse(top), parse(bottom))
    assert quotient.is_polynomial
    assert quotient.numerator == parse(expected)
    assert quotient == parse(expected)
    assert hash(quotient) == hash(parse(expected))


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (("sin(a)", "1 + cos(a)"), ("1 - cos(a)", "sin(a)")),
        (("1", "d + sqrt(2)"), ("d - sqrt(2)", "d^2 - 2")),
        (("sqrt(3)", "sqrt(2)*d + sqrt(6)"), ("3", "sqrt(6)*d + 3*sqrt(2)")),
    ],
)
def test_equal_quotients_are_equal_and_hash_alike(
    one: tuple[str, str], other: tuple[str, str]
) -> None:
    x, y = (RationalFunction(*map(parse, pair)) for pair in (one, other))
    assert x == y
    assert hash(x) == hash(y)
    assert x != RationalFunction(parse(one[0]))


def test_equality_with_numbers_and_polynomials_has_two_sides() -> None:
    d = Polynomial.generator("d")
    assert d == RationalFunction(d)
    assert RationalFunction(d, d) == 1
    assert RationalFunction(1, d) != d


def test_symbols_and_text() -> None:
    f = RationalFunction(parse("cos(a)"), parse("d + r"))
    assert f.symbols() == ["a", "d", "r"]
    assert repr(f) == "(cos(a))/(d + r)"
    assert repr(RationalFunction(parse("d"))) == "d"


def test_a_zero_denominator_is_refused() -> None:
    d = Polynomial.generator("d")
    with pytest.raises(ZeroDivisionError, match="non-zero"):
        RationalFunction(d, d - d)
    with pytest.raises(ZeroDivisionError):
        RationalFunction(d) / RationalFunction(0)


def product(constant: Fraction, found: list[tuple[Polynomial, int]]) -> Polynomial:
    total = Polynomial.constant(constant)
    for factor, exponent in found:
        total = total * factor**exponent
    return total


@given(
    polynomials("x", "y", coefficients=rationals),
    polynomials("x", "z", coefficients=rationals),
)
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


@given(
    polynomials("x", "y", coefficients=rationals),
    polynomials("x", "y", coefficients=rationals),
)
def test_division_leaves_quotient_and_rest(a: Polynomial, b: Polynomial) -> None:
    assume(b)
    quotient, rest = divided(a, b, ("x", "y"))
    assert quotient * b + rest == a
