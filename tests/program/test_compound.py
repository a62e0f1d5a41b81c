"""Functions that are written with others: their values, in texts, sympy and NumPy, against NumPy's own."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import sympy

import echelon as ec
from echelon.program.tape import Program

x, y = sympy.symbols("x y", real=True)

Numeric = Callable[[Any, Any], Any]

CASES: dict[str, tuple[Any, Numeric]] = {
    "sinh(x)": (sympy.sinh(x), lambda x, _: np.sinh(x)),
    "cosh(x)": (sympy.cosh(x), lambda x, _: np.cosh(x)),
    "asin(x)": (sympy.asin(x), lambda x, _: np.arcsin(x)),
    "acos(x)": (sympy.acos(x), lambda x, _: np.arccos(x)),
    "atan2(y, x)": (sympy.atan2(y, x), lambda x, y: np.arctan2(y, x)),
    "max(x, y)": (sympy.Max(x, y), lambda x, y: np.maximum(x, y)),
    "min(x, y)": (sympy.Min(x, y), lambda x, y: np.minimum(x, y)),
    "max(x, 1/5)": (sympy.Max(x, sympy.Rational(1, 5)), lambda x, _: np.maximum(x, 0.2)),
}


@pytest.mark.parametrize("text", CASES)
def test_values(text: str) -> None:
    rng = np.random.default_rng(0)
    samples = {"x": rng.uniform(-1, 1, 200), "y": rng.uniform(-1, 1, 200)}
    expression, numeric = CASES[text]
    for form in ([[text]], sympy.Matrix([[expression]]), lambda x, y: [[numeric(x, y)]]):
        base = ec.base_parameters(ec.LinearModel(form, ["x", "y"], ["p"]))
        found = base.full_regressor(samples)[:, 0, 0]
        np.testing.assert_allclose(found, numeric(samples["x"], samples["y"]), rtol=1e-12, atol=1e-12)


def test_steps_and_several_arguments() -> None:
    base = ec.base_parameters(ec.LinearModel([["max(x, y, 0)", "heaviside(x)"]], ["x", "y"], ["p", "q"]))
    samples = {"x": np.array([1.0, -2.0, -3.0, 0.0]), "y": np.array([2.0, -1.0, 4.0, -1.0])}
    assert base.full_regressor(samples)[:, 0].tolist() == [[2, 1], [0, 0], [4, 0], [0, 0.5]]
    same = ec.LinearModel(sympy.Matrix([[sympy.Max(x, y, 0), sympy.Heaviside(x)]]), [x, y], ["p", "q"])
    assert ec.base_parameters(same).full_regressor(samples).tolist() == base.full_regressor(samples).tolist()


def test_ends_of_the_arc_functions() -> None:
    base = ec.base_parameters(ec.LinearModel([["asin(x)", "acos(x)"]], ["x"], ["p", "q"]))
    found = base.full_regressor({"x": np.array([-1.0, 0.0, 1.0])})[:, 0]
    np.testing.assert_allclose(found, [[-np.pi / 2, np.pi], [0, np.pi / 2], [np.pi / 2, 0]], atol=1e-15)


def test_pi_is_four_arc_tangents_of_one() -> None:
    base = ec.base_parameters(ec.LinearModel([["acos(x)", "asin(x)", "1"]], ["x"], ["p", "q", "r"]))
    assert sympy.simplify(base.B - sympy.Matrix([[1, 0, 2 / sympy.pi], [0, 1, 2 / sympy.pi]])) == sympy.zeros(2, 3)
    np.testing.assert_allclose(base.B_float(), [[1, 0, 2 / np.pi], [0, 1, 2 / np.pi]])


def test_numpy_on_recorded_values() -> None:
    program = Program()
    a, b = program.input("a"), program.input("b")
    several = np.array([a, b], dtype=object)
    assert [s.node for s in np.sin(several)] == [a.sin().node, b.sin().node]
    assert (several * a)[1].node == (a * b).node
    assert np.maximum(a, 0.5).node == ((a + 0.5 + abs(a - 0.5)) / 2).node
    assert np.maximum(a, [1.0, 2.0]).shape == (2,)
    assert np.add(a, b).node == (a + b).node
    with pytest.raises(ec.InputError, match="comparison of a recorded value"):
        np.maximum(several, 0.0)
