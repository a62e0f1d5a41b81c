"""Exact numbers: Q(√2, √3) against sympy, decimals against the decimal module."""

from __future__ import annotations

import operator
from collections.abc import Callable
from decimal import Decimal
from fractions import Fraction
from typing import Any

import pytest
import sympy
from hypothesis import assume, given
from hypothesis import strategies as st

from echelon.algebra.exact.expressions import parse_decimal
from echelon.algebra.exact.polynomial import (
    Number,
    Surd,
    cosine_of_turn,
    format_number,
    inverse,
    parts_of,
    sine_of_turn,
    surd,
)
from support.strategies import in_sympy, numbers

ROOT2, ROOT3, ROOT6 = surd(0, 1, 0, 0), surd(0, 0, 1, 0), surd(0, 0, 0, 1)


@given(numbers, numbers, numbers)
def test_field_axioms(x: Number, y: Number, z: Number) -> None:
    assert x + y == y + x
    assert x * y == y * x
    assert (x + y) + z == x + (y + z)
    assert (x * y) * z == x * (y * z)
    assert x * (y + z) == x * y + x * z
    assert x - y == -(y - x)
    assert (x - y) + y == x
    if y:
        assert y * inverse(y) == 1
        assert inverse(y) * (x * y) == x


@pytest.mark.parametrize(
    "operation", [operator.add, operator.sub, operator.mul, operator.truediv]
)
@given(x=numbers, y=numbers)
def test_arithmetic_agrees_with_sympy(
    operation: Callable[[Any, Any], Any], x: Number, y: Number
) -> None:
    if operation is operator.truediv:
        assume(y)
        result, expected = (
            (x if isinstance(x, Surd) else Fraction(x)) / y,
            sympy.radsimp(in_sympy(x) / in_sympy(y)),
        )
    else:
        result, expected = operation(x, y), operation(in_sympy(x), in_sympy(y))
    assert sympy.expand(in_sympy(result) - expected) == 0


@given(numbers)
def test_parts_float_and_hash_agree_with_the_value(x: Number) -> None:
    assert surd(*parts_of(x)) == x
    assert hash(surd(*parts_of(x))) == hash(x)
    assert float(x) == pytest.approx(float(in_sympy(x)), abs=1e-12)


def test_arithmetic_returns_to_rationals() -> None:
    for square, value in (
        (ROOT2 * ROOT2, 2),
        (ROOT6 * ROOT6, 6),
        (ROOT2 * ROOT3 - ROOT6, 0),
        (ROOT3 / ROOT3, 1),
    ):
        assert square == value
        assert not isinstance(square, Surd)
    assert ROOT2 * ROOT6 == 2 * ROOT3
    assert ROOT2 != 1
    assert ROOT2 != "sqrt(2)"


@pytest.mark.parametrize("stranger", [0.5, "1", None])
def test_inexact_operands_are_refused(stranger: Any) -> None:
    for operation in (operator.add, operator.mul, operator.truediv):
        with pytest.raises(TypeError):
            operation(ROOT2, stranger)


@pytest.mark.parametrize("zero", [0, Fraction(0), ROOT2 - ROOT2])
def test_zero_has_no_inverse(zero: Number) -> None:
    with pytest.raises(ZeroDivisionError):
        inverse(zero)


@pytest.mark.parametrize("k", range(-25, 50))
def test_turns_of_15_degrees(k: int) -> None:
    assert sympy.expand(in_sympy(cosine_of_turn(k)) - sympy.cos(k * sympy.pi / 12)) == 0
    assert sympy.expand(in_sympy(sine_of_turn(k)) - sympy.sin(k * sympy.pi / 12)) == 0


@given(numbers)
def test_text_is_read_back(x: Number) -> None:
    assert sympy.expand(sympy.sympify(format_number(x)) - in_sympy(x)) == 0


@given(
    st.decimals(
        allow_nan=False, allow_infinity=False, min_value=-(10**9), max_value=10**9
    )
)
def test_decimals_keep_their_value(x: Decimal) -> None:
    assert parse_decimal(str(x)) == Fraction(x)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("+.5", "1/2"),
        ("7.", "7"),
        ("-0", "0"),
        ("1E+2", "100"),
        ("2.50e-1", "1/4"),
        ("007", "7"),
    ],
)
def test_decimal_spellings(text: str, value: str) -> None:
    assert parse_decimal(text) == Fraction(value)


@pytest.mark.parametrize(
    "text",
    ["", ".", "nan", "inf", "-Infinity", "1/2", "1_000", "0x10", "1e", "1 2", "1e9999"],
)
def test_other_text_is_no_decimal(text: str) -> None:
    with pytest.raises(ValueError, match=r"finite decimal|beyond the range"):
        parse_decimal(text)
