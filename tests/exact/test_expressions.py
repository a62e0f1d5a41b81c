"""Exact text: every accepted spelling means what sympy says, and nothing else is accepted."""

from __future__ import annotations

from fractions import Fraction

import pytest
import sympy
from hypothesis import given
from hypothesis import strategies as st

from echelon.algebra.exact.expressions import Angle, parse, parse_angle
from echelon.algebra.exact.polynomial import Polynomial
from support.strategies import in_sympy

SYMBOLS = ("D3", "RL4", "alpha")


@pytest.mark.parametrize(
    "text",
    [
        "0",
        "-0.0825",
        ".5e-3",
        " 2 ",
        "D3/2 - 0.5*D3 + 2*RL4^2",
        "-D3^2 + (+RL4)**3",
        "(D3 + RL4)*(D3 - RL4)/4",
        "sqrt(2)/2",
        "sqrt(0.5) + sqrt(12) - sqrt(27/2)",
        "sqrt(9/4)*D3^(4/2)",
        "D3/sqrt(6)",
        "D3^0 - RL4^1",
        "1/(1 + sqrt(2) + sqrt(3))",
        "cos(pi/12) - sin(-5*pi/12)",
        "D3*cos(alpha + pi/4) + RL4*sin(2*alpha)",
        "cos(alpha)^2 + sin(alpha)^2",
        "sin(pi - 3*alpha)",
        "pi/2 + D3",
    ],
)
def test_meaning(text: str) -> None:
    exact = sympy.sympify(text.replace("^", "**"), rational=True)
    ours = in_sympy(parse(text, SYMBOLS)).subs(sympy.Symbol("pi"), sympy.pi)
    assert sympy.simplify(sympy.expand_trig(sympy.expand(ours - exact))) == 0


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "is not an expression"),
        ("1 +", "is not an expression"),
        ("2 D3", "is not an expression"),
        ("(" * 500 + "1" + ")" * 500, "is not an expression"),
        ("D4", "not a declared symbol .declared: D3, RL4, alpha."),
        ("sin", "is a function"),
        ("tan(alpha)", "not a known function"),
        ("sin(alpha, 2)", "not allowed"),
        ("sin(D3*alpha)", "linear"),
        ("sin(sqrt(2)*alpha)", "linear"),
        ("sin(cos(alpha))", "holds cos"),
        ("sin(alpha/2)", "no exact sine"),
        ("cos(0.5)", "no exact sine"),
        ("cos(pi/5)", "no exact sine"),
        ("1/D3", "only division by a non-zero number"),
        ("1/(2 - 2)", "only division by a non-zero number"),
        ("D3^-1", "powers 0 to"),
        ("D3^0.5", "powers 0 to"),
        ("D3^33", "powers 0 to"),
        ("2^D3", "powers 0 to"),
        ("5 % 2", "only"),
        ("sqrt(5)", "use a symbol"),
        ("sqrt(-1)", "non-negative"),
        ("sqrt(D3)", "not a known function"),
        ("1_000", "finite decimal"),
        ("0x10", "finite decimal"),
        ("1j", "not allowed"),
        ("True", "finite decimal"),
        ("'a'", "not allowed"),
        ("D3.real", "not allowed"),
        ("D3[0]", "not allowed"),
        ("D3 if 1 else 2", "not allowed"),
        ("lambda: 1", "not allowed"),
        ("__import__('os')", "not allowed"),
        ("1" * 2001, "too long"),
        ("1 + " * 300_000 + "1", "too long"),
        (
            "(1 + D3 + RL4 + alpha)^32*(1 + D3 + RL4 + alpha)^32",
            "more than 20000 terms",
        ),
        ("((1 + D3 + RL4 + alpha)^32)^32", "more than 20000 terms"),
        ("(((9^32)^32)^32)^32", "more than 20000 bits"),
        ("(D3/1e299)^32", "more than 20000 bits"),
        ("cos(alpha/3)", "no exact sine"),
        ("1" + " + 1" * 300 + " + ", "is not an expression"),
        ("(1" + " + 1" * 300 + "))", "is not an expression"),
    ],
)
def test_refusals(text: str, reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        parse(text, SYMBOLS)


@pytest.mark.parametrize(
    "term",
    ["D3", "2*D3*(RL4 - 3 + alpha)/7", "D3*(-cos(alpha) - (1 - RL4))", "RL4 * -2"],
)
@pytest.mark.parametrize("signs", ["+-", "-"])
def test_a_long_sum_is_the_sum_of_its_terms(term: str, signs: str) -> None:
    text = "1" + "".join(f" {signs[k % len(signs)]} {term}" for k in range(1201))
    expected = 1 + (1 if signs == "+-" else -1201) * parse(term, SYMBOLS)
    assert parse(text, SYMBOLS) == expected


def test_without_a_list_any_symbol_may_occur() -> None:
    assert parse("D4 + pi").symbols() == ["D4", "pi"]
    with pytest.raises(ValueError, match="declared: none"):
        parse("D4", ())


@pytest.mark.parametrize(
    ("text", "angle"),
    [
        ("0", Angle()),
        ("-pi/2", Angle(Fraction(-1, 2))),
        ("2*alpha - pi/6", Angle(Fraction(-1, 6), (("alpha", 2),))),
        ("1.5708", Angle(radians=Fraction("1.5708"))),
        (
            "(pi + beta - 1)/2",
            Angle(Fraction(1, 2), (("beta", Fraction(1, 2)),), Fraction(-1, 2)),
        ),
    ],
)
def test_angles(text: str, angle: Angle) -> None:
    assert parse_angle(text) == angle
    assert parse_angle(str(angle)) == angle


@pytest.mark.parametrize(
    "text", ["pi^2", "pi*alpha", "alpha*beta", "sqrt(2)*pi", "cos(alpha)"]
)
def test_other_text_is_no_angle(text: str) -> None:
    with pytest.raises(ValueError, match="is not an angle"):
        parse_angle(text)


@given(st.integers(-30, 30), st.integers(-3, 3), st.integers(-3, 3))
def test_exact_sine_and_cosine(steps: int, a: int, b: int) -> None:
    angle = Angle(Fraction(steps, 12), (("a", a), ("b", b)))
    point = {"a": 0.3, "b": -1.1}
    value = float(steps * sympy.pi / 12) + a * point["a"] + b * point["b"]
    assert angle.is_exact
    for ours, theirs in (
        (angle.cos(), sympy.cos(value)),
        (angle.sin(), sympy.sin(value)),
    ):
        assert float(in_sympy(ours).subs(point)) == pytest.approx(
            float(theirs), abs=1e-9
        )


@pytest.mark.parametrize(
    "angle",
    [
        Angle(Fraction(1, 5)),
        Angle(radians=Fraction(1)),
        Angle(parts=(("a", Fraction(1, 2)),)),
    ],
)
def test_an_inexact_angle_says_what_would_be_exact(angle: Angle) -> None:
    assert not angle.is_exact
    with pytest.raises(ValueError, match="multiple of pi/12"):
        angle.cos()


def test_parts_of_a_quotient_may_be_beyond_doubles() -> None:
    """Sets have them where frames of a file were made exact; values that no double comes near to are refused."""
    large = 10**400
    assert parse(f"{3 * large + 1}/{large}") == Polynomial.constant(
        Fraction(3 * large + 1, large)
    )
    with pytest.raises(ValueError, match="beyond the range of double precision"):
        parse(f"{large}*L")
