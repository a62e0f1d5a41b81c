"""Ranks with functions: all relations that hold for real inputs are found, and no others are."""

from __future__ import annotations

import numpy as np
import pytest

import echelon as ec
from echelon.base.structure import linear_structure
from echelon.shared.errors import InputError
from support.selection import one_in

SYMBOLS = ("a", "b")


def rank(*texts: str) -> int:
    """Dimension of what some functions span over the constants."""
    model = ec.LinearModel(
        [list(texts)],
        ["x", "y", "z", "v"],
        [f"p{k}" for k in range(len(texts))],
        SYMBOLS,
    )
    return linear_structure(model.regressor, np.random.default_rng(3)).rank


IDENTITIES = {
    "exp of a sum": "exp(x + y) - exp(x)*exp(y)",
    "exp of a difference": "exp(x - y)*exp(y) - exp(x)",
    "exp of a multiple": "exp(3*x) - exp(x)**3",
    "exp of a fraction": "exp(x/2)**2 - exp(x)",
    "exp of two fractions": "exp(x/2)**3 - exp(x/3)**4*exp(x/6)",
    "exp of a product": "exp(x*y)*exp(-x*y) - 1",
    "exp of a sum with a constant": "exp(x + 1) - exp(1)*exp(x)",
    "exp with a model constant": "exp(a*x + b) - exp(a*x)*exp(b)",
    "exp of an inverse": "exp(2/x) - exp(1/x)**2",
    "exp of a quotient": "exp((x + 1)/x) - exp(1)*exp(1/x)",
    "exp of a true quotient": "exp(x/(x - 1)) - exp(1)*exp(1/(x - 1))",
    "exp of partial fractions": "exp(1/(x*(x - 1)))*exp(1/x) - exp(1/(x - 1))",
    "exp over constants": "exp(x/(a + 1))*exp(a*x/(a + 1)) - exp(x)",
    "exp over constants and variables": "exp(a*x/(b*(y + 1)))**2 - exp(2*a*x/(b*y + b))",
    "nested exp": "exp(exp(x) + y) - exp(exp(x))*exp(y)",
    "nested exp of a fraction": "exp(exp(x/2)**2) - exp(exp(x))",
    "circle": "sin(x)**2 + cos(x)**2 - 1",
    "double angle": "sin(2*x) - 2*sin(x)*cos(x)",
    "tangent": "tan(x)*cos(x) - sin(x)",
    "tangent of a sum": "tan(x + y)*(1 - tan(x)*tan(y)) - tan(x) - tan(y)",
    "angle of an exp": "sin(2*exp(x)) - 2*sin(exp(x))*cos(exp(x))",
    "exp of a sine": "exp(sin(x)*cos(x)) - exp(sin(2*x)/2)",
    "exp of a square sum": "exp(sin(x)**2 + cos(x)**2) - exp(1)",
    "tanh": "tanh(x)*(exp(x) + exp(-x)) - exp(x) + exp(-x)",
    "tanh of a double": "tanh(2*x)*(1 + tanh(x)**2) - 2*tanh(x)",
    "log of a product": "log(x*y) - log(x) - log(y)",
    "log of a quotient": "log(x/y) - log(x) + log(y)",
    "log of a power": "log(x**3) - 3*log(x)",
    "log of a multiple": "log(6*x) - log(2) - log(3) - log(x)",
    "log of a factored sum": "log(x**2 - y**2) - log(x + y) - log(x - y)",
    "log of an inverse": "log(1/(x + 1)) + log(x + 1)",
    "log of exp": "log(exp(x)) - x",
    "log of exps": "log(exp(x)*exp(y)*x) - x - y - log(x)",
    "log of exp and a sum": "log(exp(x) + exp(2*x)) - x - log(1 + exp(x))",
    "exp of log": "exp(log(x)) - x",
    "exp of logs": "exp(log(x) + log(y)) - x*y",
    "exp of a multiple of log": "exp(-3*log(x))*x**3 - 1",
    "exp of half a log": "exp(log(x)/2) - sqrt(x)",
    "exp of a log of a sum": "exp(log(x + y)/2)**2 - x - y",
    "Arrhenius": "log(a*exp(-b/x)) - log(a) + b/x",
    "square root": "sqrt(x)**2 - x",
    "square root of a product": "sqrt(x)*sqrt(y) - sqrt(x*y)",
    "square root of a square": "sqrt(x**2) - abs(x)",
    "square root of a sum": "sqrt(x + y)**2 - x - y",
    "square root of a factored sum": "sqrt(x**2 - y**2)*sqrt(x + y) - (x + y)*sqrt(x - y)",
    "square root of a full square": "sqrt(x**2 + 2*x*y + y**2) - abs(x + y)",
    "square root of exp": "sqrt(exp(x)) - exp(x/2)",
    "square root of a square root": "sqrt(sqrt(x))**4 - x",
    "square root of numbers": "sqrt(2*x) - sqrt(2)*sqrt(x)",
    "square root of a quotient": "sqrt(x/y)*sqrt(y) - sqrt(x)",
    "cube root": "(x**(1/3))**3 - x",
    "power laws": "x**(1/3)*x**(1/6) - sqrt(x)",
    "power of a product": "(x*y)**(2/3) - x**(2/3)*y**(2/3)",
    "symbolic power": "x**(a + 2) - x**a*x**2",
    "symbolic power of a product": "(x*y)**a - x**a*y**a",
    "number to a power": "2**(x + y) - 2**x*2**y",
    "log of a power of a variable": "log(x**a) - a*log(x)",
    "abs": "abs(x)**2 - x**2",
    "abs of a product": "abs(x*y) - abs(x)*abs(y)",
    "abs and sign": "abs(x) - sign(x)*x",
    "sign squared": "sign(x + y)**2 - 1",
    "sign of a product": "sign(x*y) - sign(x)*sign(y)",
    "sign of an odd power": "sign(x**3) - sign(x)",
    "sign of what is positive": "sign(x**2 + 1) - 1",
    "sign of exp": "sign(exp(x) - 1) - sign(x)",
    "signs that exclude each other": "(1 + sign(x))*(1 + sign(y))*(1 - sign(x + y))",
    "sign in a domain": "sqrt(x)*(sign(x) - 1)",
    "Stribeck, symmetric": "exp(-abs(v)/a)*exp(abs(v)/a) - 1",
    "exp of abs": "exp(-abs(v)) + exp(abs(v)) - exp(v) - exp(-v)",
    "tanh of abs": "tanh(abs(v)) - sign(v)*tanh(v)",
    "exp of abs of a product": "exp(abs(x*y)) - exp(abs(x)*abs(y))",
    "log of abs": "log(abs(x*y)) - log(abs(x)) - log(abs(y))",
    "root of abs": "sqrt(abs(x))**2 - sign(x)*x",
    "root of a product of either sign": "sqrt(x*y) - sqrt(abs(x))*sqrt(abs(y))",
    "log of one plus abs": "log(1 + 2*abs(x) + x**2) - 2*log(1 + abs(x))",
    "power of abs": "abs(v)**1.5 - abs(v)*sqrt(abs(v))",
    "Stribeck with an exponent": "exp(-(abs(v)/b)**a)*exp((abs(v)/b)**a) - 1",
    "sine of abs": "sin(abs(x)) - sign(x)*sin(x)",
    "exp of a root": "exp(2*sqrt(x)) - exp(sqrt(x))**2",
    "hyperbolic functions": "cosh(x)**2 - sinh(x)**2 - 1",
    "hyperbolic quotient": "sinh(x) - tanh(x)*cosh(x)",
    "larger and smaller": "max(x, y)*min(x, y) - x*y",
    "largest of three": "max(x, y, z) - max(max(z, x), y)",
    "either the larger or the smaller": "(max(x, y) - x)*(max(x, y) - y)",
    "clipped": "max(x, 0)*min(x, 0)",
    "step": "heaviside(x)*x - max(x, 0)",
    "arc sine and cosine": "sin(asin(x) + acos(x)) - 1",
    "sine of an arc sine": "sin(asin(x)) - x",
    "cosine of an arc sine": "cos(asin(x)) - sqrt(1 - x**2)",
    "tangent of an arc cosine": "tan(acos(x))*x - sqrt(1 - x**2)",
    "cosine of twice an arc cosine": "cos(2*acos(x)) - 2*x**2 + 1",
    "sine of an arc tangent": "sin(atan(x))*sqrt(1 + x**2) - x",
    "sine of an angle and arc tangents": "sin(y - 3*atan(x)) - sin(y - atan(x))*cos(2*atan(x))"
    " + cos(y - atan(x))*sin(2*atan(x))",
    "direction of a point": "cos(atan2(y, x))*sqrt(x**2 + y**2) - x",
    "tangent of a direction": "tan(atan2(y, x)) - y/x",
    "angle between directions": "sin(atan2(y, x) - atan2(x, y))*(x**2 + y**2) - y**2 + x**2",
    "quarter of pi": "cos(4*atan(1)) + 1",
}


@pytest.mark.parametrize(
    "text",
    one_in(2, [pytest.param(text, id=name) for name, text in IDENTITIES.items()]),
)
def test_identities_hold(text: str) -> None:
    assert rank(text) == 0


SPANS = {
    "exponentials": (["exp(x)", "exp(2*x)", "exp(x*x)", "exp(y)", "exp(x + y)", "1"], 6),
    "hyperbolic": (["exp(x)", "exp(-x)", "tanh(x)*(exp(x) + exp(-x))", "(exp(x) + exp(-x))/2"], 2),
    "shifts are constants": (["exp(x)", "exp(x + 1)", "exp(x + a)", "exp(x - b*b)"], 1),
    "shifts of quotients": (["exp(1/(x - 1))", "exp(x/(x - 1))"], 1),
    "rates are not": (["exp(x)", "exp(a*x)", "exp(b*x)", "exp(x/2)"], 4),
    "exp and log": (["x", "log(x)", "exp(x)", "x*log(x)", "log(x)**2", "1"], 6),
    "logs": (["log(x)", "log(y)", "log(x*y)", "log(2*x)", "1"], 3),
    "logs of sums": (["log(x)", "log(x + 1)", "log(x + 2)", "log(x**2 + 3*x + 2)"], 3),
    "roots": (["sqrt(x)", "sqrt(y)", "sqrt(x*y)", "sqrt(x + y)", "x", "sqrt(x)*sqrt(y)"], 5),
    "roots of constants": (["sqrt(x)", "sqrt(2*x)", "sqrt(a*x)", "sqrt(3*x)"], 1),
    "powers": (["x**a", "x**b", "x**(a + 1)", "x*x**a", "x"], 4),
    "signs": (["1", "sign(x)", "sign(y)", "sign(x)*sign(y)", "sign(x*y)"], 4),
    "all regions": (["1", "sign(x)", "sign(y)", "sign(x+y)", "sign(x)*sign(y)", "sign(x)*sign(x+y)",
                     "sign(y)*sign(x+y)", "sign(x)*sign(y)*sign(x+y)"], 6),
    "friction": (["sign(v)", "v", "abs(v)", "tanh(v/a)", "sign(v)*exp(-abs(v)/b)", "sign(v)*sqrt(abs(v))", "v*sign(v)",
                  "sign(v)*exp(-(v/b)**2)"], 7),
    "one-sided": (["x", "abs(x)", "(x + abs(x))/2", "(x - abs(x))/2"], 2),
    "angle and exp": (["sin(x)", "cos(x)", "exp(x)", "x", "tan(x)", "tanh(x)"], 6),
    "arc functions": (["asin(x)", "acos(x)", "1", "asin(x)*x"], 3),
    "arc tangents": (["atan(x)", "atan(2*x)", "atan(y)", "atan(x)*log(x)", "log(1 + x**2)", "x", "1"], 7),
    "arc tangent at scales": (["atan(x/a)", "atan(x/b)", "sign(x)", "atan(x/a)*sign(x)"], 4),
    "abs under log": (["log(abs(x))", "log(1 + abs(x))", "log(1 + x**2 + 2*abs(x))", "sign(x)"], 3),
}  # fmt: skip


@pytest.mark.parametrize(("texts", "expected"), SPANS.values(), ids=SPANS.keys())
def test_ranks(texts: list[str], expected: int) -> None:
    assert rank(*texts) == expected


WITH_OTHERS = {
    "arc tangents that add up": (
        ["atan(x) + atan(y)", "atan((x + y)/(1 - x*y))", "1"],
        3,
    ),
    "arc tangents that add up without jumps": (
        ["atan(exp(x))", "atan(exp(-x))", "1"],
        2,
    ),
    "arc tangents of either sign": (
        ["atan(x)", "atan(abs(x))", "sign(x)*atan(abs(x))"],
        2,
    ),
    "half an angle": (["atan(sin(x)/(1 + cos(x)))", "x", "sin(x)"], 3),
    "function of an arc tangent": (["exp(atan(x))", "exp(atan(x) + 1)", "x"], 2),
    "sine of half an arc tangent": (["sin(atan(x)/2)**2", "1/sqrt(1 + x**2)", "1"], 2),
    "arc tangent of a constant": (["atan(2)*x", "x"], 1),
    "function of a root of a sum": (
        ["exp(sqrt(1 + x**2))", "exp(2*sqrt(1 + x**2))", "exp(1 + sqrt(1 + x**2))"],
        2,
    ),
    "log of a root of two": (["log(x + sqrt(2))", "log(sqrt(2)*x + 2)", "1"], 2),
    "quotient led by a constant": (
        ["exp(1/(a*x + 1))", "exp(1 + 1/(a*x + 1))", "exp(2/(a*x + 1))"],
        2,
    ),
}


@pytest.mark.parametrize(
    ("texts", "expected"), WITH_OTHERS.values(), ids=WITH_OTHERS.keys()
)
def test_functions_of_functions(texts: list[str], expected: int) -> None:
    assert rank(*texts) == expected


@pytest.mark.parametrize(
    "text", ["log(-x**2)", "sqrt(x) + sqrt(-x)", "log(sin(x) - 2)"]
)
def test_functions_that_are_real_nowhere(text: str) -> None:
    with pytest.raises(InputError, match="no real point"):
        rank(text)
