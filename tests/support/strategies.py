"""Random exact numbers, polynomials and formulas, and the same things in sympy."""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping
from fractions import Fraction
from functools import reduce
from typing import Any

import sympy
from hypothesis import strategies as st

from echelon.algebra.exact.field import PrimeField
from echelon.algebra.exact.polynomial import Number, Polynomial, parts_of, surd

# the largest primes of their sizes, where products come closest to overflow
SMALL_FIELD = PrimeField.of(2**31 - 105)
LARGE_FIELD = PrimeField.of(2**127 - 801)
FIELDS = (SMALL_FIELD, LARGE_FIELD)

integers = st.integers(-9, 9)
rationals = integers | st.fractions(-9, 9, max_denominator=12)
numbers = rationals | st.builds(surd, rationals, rationals, rationals, rationals)


def polynomials(
    *generators: str, coefficients: st.SearchStrategy[Any] = numbers
) -> st.SearchStrategy[Polynomial]:
    """Sums of up to three products of up to three generators."""
    factor = st.sampled_from(generators).map(Polynomial.generator)
    constant = coefficients.map(Polynomial.constant)
    term = st.builds(
        lambda c, factors: reduce(operator.mul, factors, c), constant, _few(factor)
    )
    return _few(term).map(Polynomial.sum)


def _few(elements: st.SearchStrategy[Any]) -> st.SearchStrategy[list[Any]]:
    return st.lists(elements, max_size=3)


# -- formulas: a leaf is a name or a number, a node is (operation, left, right) ---------------------------------------

_OPERATIONS: Mapping[str, Callable[[Any, Any], Any]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
}


def formulas(
    *names: str, constants: st.SearchStrategy[Any] = rationals
) -> st.SearchStrategy[Any]:
    """Random formulas."""
    leaves = st.sampled_from(names) | constants
    return st.recursive(
        leaves,
        lambda inner: st.tuples(st.sampled_from("+-*/"), inner, inner),
        max_leaves=12,
    )


def calculate(
    formula: Any, values: Mapping[str, Any], number: Callable[[Any], Any]
) -> Any:
    """Value of a formula over anything that has the four operations."""
    if isinstance(formula, str):
        return values[formula]
    if not isinstance(formula, tuple):
        return number(formula)
    return _OPERATIONS[formula[0]](
        *(calculate(part, values, number) for part in formula[1:])
    )


# -- in sympy ---------------------------------------------------------------------------------------------------------


def in_sympy(x: Number | Polynomial) -> Any:
    """An exact number or polynomial, term by term."""
    if isinstance(x, Polynomial):
        terms = (
            in_sympy(c) * sympy.prod(_generator(g) ** e for g, e in m)
            for m, c in x.terms.items()
        )
        return sum(terms, sympy.S.Zero)
    parts = zip(map(Fraction, parts_of(x)), (1, 2, 3, 6), strict=True)
    return sum(
        sympy.Rational(part.numerator, part.denominator) * sympy.sqrt(r)
        for part, r in parts
    )


def _generator(name: str) -> Any:
    if name.endswith(")"):
        return {"cos": sympy.cos, "sin": sympy.sin}[name[:3]](sympy.Symbol(name[4:-1]))
    return sympy.Symbol(name)
