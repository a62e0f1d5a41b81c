"""An exact metric S: numbers and formulas as rational functions."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import TYPE_CHECKING, Any, Literal

from echelon.errors import InputError
from echelon.exact.expressions import parse
from echelon.exact.polynomial import Polynomial
from echelon.exact.rational import RationalFunction

if TYPE_CHECKING:
    import sympy

    ExactMetric = Literal["identity"] | Sequence[Any] | sympy.MatrixBase
    """``"identity"``, the diagonal of S, or S."""


def metric_entries(metric: Any, size: int) -> dict[tuple[int, int], RationalFunction]:
    """Non-zero entries of S."""
    import sympy

    if isinstance(metric, str):
        if metric != "identity":
            raise InputError(f"unknown metric '{metric}' (valid: identity, a diagonal, or a sympy Matrix)")
        return {(k, k): RationalFunction(1) for k in range(size)}
    if isinstance(metric, sympy.MatrixBase) and 1 not in metric.shape:
        shape, given = metric.shape, {(int(i), int(j)): value for (i, j), value in metric.todok().items()}
    else:
        diagonal = list(metric)
        shape, given = (len(diagonal),) * 2, {(k, k): value for k, value in enumerate(diagonal)}
    if shape != (size, size):
        raise InputError(f"the metric is {shape[0]} × {shape[1]}; expected {size} × {size} or its diagonal")
    entries = {place: _rational(value) for place, value in given.items() if value != 0}
    _check(entries, size)
    return entries


def _rational(value: Any) -> RationalFunction:
    """A number or formula as a quotient of polynomials."""
    import sympy

    try:
        if isinstance(value, str):  # text is read, never evaluated as code
            return RationalFunction(parse(value))
        formula = sympy.sympify(value, rational=False, strict=True)
        formula = formula.replace(lambda e: e.is_Float, lambda e: sympy.Rational(str(e)))
        top, bottom = sympy.fraction(sympy.together(formula))
        return RationalFunction(_polynomial(top), _polynomial(bottom))
    except (sympy.SympifyError, sympy.PolynomialError, AttributeError, TypeError, ValueError):
        raise InputError(f"the metric's entry '{value}' is not a rational function with rational numbers") from None


def _polynomial(formula: Any) -> Polynomial:
    import sympy

    symbols = sorted(formula.free_symbols, key=str)
    if not symbols:
        return Polynomial.constant(_number(formula))
    terms = {}
    for exponents, coefficient in sympy.Poly(formula, *symbols).terms():
        monomial = tuple((str(s), int(e)) for s, e in zip(symbols, exponents, strict=True) if e)
        terms[tuple(sorted(monomial))] = _number(coefficient)
    return Polynomial(terms)


def _number(value: Any) -> int | Fraction:
    if not value.is_Rational:
        raise ValueError(value)
    return int(value.p) if value.q == 1 else Fraction(int(value.p), int(value.q))


def _check(entries: dict[tuple[int, int], RationalFunction], size: int) -> None:
    """Refuse what is not symmetric or, where all entries are numbers, not positive definite."""
    if any(entries.get((j, i)) != value for (i, j), value in entries.items()):
        raise InputError("the metric is not symmetric")
    numbers = {place: value.numerator.number for place, value in entries.items() if value.is_polynomial}
    definite = all((k, k) in entries for k in range(size))
    if definite and len(numbers) == len(entries) and all(isinstance(v, int | Fraction) for v in numbers.values()):
        definite = _is_definite({place: Fraction(v) for place, v in numbers.items()}, size)  # type: ignore[arg-type]
    else:
        signs = [numbers.get((k, k)) for k in range(size)]
        definite = definite and not any(isinstance(sign, int | Fraction) and sign <= 0 for sign in signs)
    if not definite:
        raise InputError("the metric is not positive definite")


def _is_definite(numbers: dict[tuple[int, int], Fraction], size: int) -> bool:
    """Whether all pivots of an elimination are positive."""
    rows = [{j: v for (i, j), v in numbers.items() if i == k} for k in range(size)]
    for k in range(size):
        pivot = rows[k].get(k, Fraction(0))
        if pivot <= 0:
            return False
        for i in [i for i in rows[k] if i > k]:
            factor = rows[i].pop(k) / pivot
            for j, value in rows[k].items():
                if j > k:
                    rows[i][j] = rows[i].get(j, Fraction(0)) - factor * value
    return True
