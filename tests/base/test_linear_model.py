"""General linear models: how they are given, what they have for an answer, and how bad ones are refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy
from hypothesis import given
from hypothesis import strategies as st

import echelon as ec
from echelon.base.display import to_latex, to_markdown
from echelon.base.saved.saved import to_json
from echelon.dynamics.models import LinearModel, evaluate_model
from echelon.formats.description.document import read_text
from echelon.formats.linear_models import load_linear, read_linear
from support.paths import ROOT
from support.selection import examples

EXAMPLES = ROOT / "examples" / "linear"

ANSWERS = {
    "thermal_network": ["C1", "G12", "G10 + G10b", "C2", "G20", "eta"],
    "aircraft_longitudinal": ["CL0", "CLa", "CLad + CLq", "CLde", "Cm0 + (h/cbar)·CmT", "Cma", "Cmad + Cmq", "Cmde"],
    "single_track": ["Iz", "cf + (1/lf)·cft", "cr", "cw"],
    "arrhenius": [
        "lnA − 5.69759672·b", "E", "n + b", "a1 + a12", "a2 + a12", "k + 574938003·k0",
    ],
    "heat_capacity": ["a0 − 5.69759672·d", "a1", "a2", "a3", "a4", "b", "c + d"],
}  # fmt: skip


@pytest.mark.parametrize("name", ANSWERS)
def test_worked_examples(name: str) -> None:
    base = ec.base_parameters(load_linear(EXAMPLES / f"{name}.yaml"))
    assert [str(e) for e in base.expressions] == ANSWERS[name]
    assert base.certificate.rank == base.rank


@pytest.mark.parametrize("name", ANSWERS)
def test_the_reduced_regressor_reproduces_the_full_one(name: str) -> None:
    model = load_linear(EXAMPLES / f"{name}.yaml")
    base, rng = ec.base_parameters(model), np.random.default_rng(1)
    variables = {v: rng.uniform(0.5, 2.0, 30) for v in model.variables}
    stated = base.matrix.numbers is not None  # at the stated values only
    constants = {} if stated else {c: rng.uniform(0.5, 2.0) for c in model.constants}
    if name == "arrhenius":
        variables["T"] *= 1000
    full = base.full_regressor(variables, constants)
    assert base.regressor(variables, constants) @ base.B_float(
        constants
    ) == pytest.approx(full, rel=1e-9)
    zeta = rng.standard_normal(len(model.parameters))
    reduced = base.regressor(variables, constants) @ base.values(zeta, constants)
    assert reduced == pytest.approx(full @ zeta, rel=1e-9)


def test_constants_without_values_need_closed_forms() -> None:
    with pytest.raises(ec.ClosedFormError, match="constants"):
        ec.base_parameters(
            load_linear(EXAMPLES / "aircraft_longitudinal.yaml"), budget=0
        )


def test_a_rank_that_floating_point_gets_wrong() -> None:
    model = load_linear(EXAMPLES / "heat_capacity.yaml")
    W = evaluate_model(model, model.regressor, {"T": np.linspace(280, 320, 1000)})[:, 0]
    assert np.linalg.matrix_rank(W) == 4
    assert ec.base_parameters(model).rank == 7


T, x, y, a, k = sympy.symbols("T x y a k")


def test_sympy_text_and_functions_give_the_same_model() -> None:
    texts = [["sin(x + a)", "cos(x)", "sin(x)"], ["x^2*exp(-y)", "0", "abs(y)"]]
    matrix = sympy.Matrix(
        [
            [sympy.sin(x + a), sympy.cos(x), sympy.sin(x)],
            [x**2 * sympy.exp(-y), 0, sympy.Abs(y)],
        ]
    )

    def function(x: Any, y: Any, a: Any) -> Any:
        return [
            [np.sin(x + a), np.cos(x), np.sin(x)],
            [x**2 * np.exp(-y), 0, np.abs(y)],
        ]

    models = [
        ec.LinearModel(texts, ["x", "y"], ["p", "q", "r"], ["a"]),
        ec.LinearModel(matrix, [x, y], sympy.symbols("p q r")),
        ec.LinearModel(function, ["x", "y"], ["p", "q", "r"]),
    ]
    found = [[str(e) for e in ec.base_parameters(m).expressions] for m in models]
    assert found[0] == found[1] == found[2]
    assert [list(m.constants) for m in models] == [["a"]] * 3


def test_numpy_matrices_are_traced() -> None:
    def function(q: Any, v: Any) -> Any:
        R = np.array([[np.cos(q), -np.sin(q)], [np.sin(q), np.cos(q)]])
        return R @ np.array([[v, 1, 0], [0, v, 2]]) @ R

    with pytest.raises(ec.InputError, match="cannot be recorded"):
        ec.LinearModel(function, ["q", "v"], ["a", "b", "c"])

    def right(q: Any, v: Any) -> Any:
        R = np.array([[np.cos(q), -np.sin(q)], [np.sin(q), np.cos(q)]])
        return R @ np.array([[v, 1, 0, 2 * v], [0, v, 2, 0]])

    assert (
        ec.base_parameters(ec.LinearModel(right, ["q", "v"], ["a", "b", "c", "d"])).rank
        == 3
    )


def test_functions_of_constants_are_numbers_at_their_values() -> None:
    columns = ["sqrt(a)*x", "a*x", "exp(k/2)*y", "exp(k)*y", "2*log(3)*T", "log(9)*T"]
    names, variables = list("pqrstu"), ["x", "y", "T"]
    base = ec.base_parameters(
        ec.LinearModel([columns], variables, names, {"a": "1/4", "k": 3})
    )
    root = 4.4816890703380648226020554601192758190057498683696670567726500827859  # exp(3/2)
    assert base.B_float() == pytest.approx(
        np.array([[1, 0.5, 0, 0, 0, 0], [0, 0, 1, root, 0, 0], [0, 0, 0, 0, 1, 1]]),
        rel=1e-15,
    )
    assert base.B[0, 1] == sympy.Rational(1, 2)
    assert abs(base.B[1, 3] - sympy.exp(sympy.Rational(3, 2)).n(60)) < 1e-38
    assert base.matrix.numbers is not None
    assert base.matrix.numbers.columns == (1, 3)
    assert "the coefficients of q s are numbers at the stated values" in str(base)
    assert base.certificate.in_balls
    with pytest.raises(ec.InputError, match=r"numbers at a = 0\.25"):
        base.B_float({"a": 2.0})
    with pytest.raises(
        ec.ClosedFormError, match=r"give constants values \(such as k\)"
    ):
        ec.base_parameters(
            ec.LinearModel([columns], variables, names, {"a": "1/4", "k": None})
        )


def test_roots_are_short_surds() -> None:
    columns = [
        "sqrt(x)",
        "sqrt(2*x)",
        "sqrt(3*x)",
        "sqrt(x)/sqrt(6)",
        "sqrt(x/4)",
        "sqrt(5*x)",
    ]
    base = ec.base_parameters(ec.LinearModel([columns], ["x"], list("pqrstu")))
    assert str(base.expressions[0]).startswith(
        "p + √2·q + √3·r + √6/6·s + 1/2·t + 2.236067"
    )


def test_exact_values() -> None:
    base = ec.base_parameters(
        ec.LinearModel([["x", "a*x", "exp(a)*x"]], ["x"], ["p", "q", "r"], {"a": 0.1})
    )
    assert base.B_exact[:2] == [1, sympy.Rational(1, 10)]
    assert base.values([1, 10, 0]) == pytest.approx([2])
    assert str(base.expressions[0]) == "p + a·q + 1.10517092·r"


def test_preferred_representatives() -> None:
    model = ec.LinearModel(
        [["x", "2*x", "y"]], ["x", "y"], ["p", "q", "r"], units=["m", "s", "kg"]
    )
    assert [str(e) for e in ec.base_parameters(model, prefer=["q"]).expressions] == [
        "q + 1/2·p",
        "r",
    ]
    assert ec.base_parameters(model).units == ("m", "kg")
    with pytest.raises(ec.InputError, match="'z' is not a parameter"):
        ec.base_parameters(model, prefer=["z"])
    with pytest.raises(ec.InputError, match="no base and tip"):
        ec.base_parameters(model, order="tip-to-base")


def test_friction() -> None:
    columns = "sign(v) v abs(v) v*sign(v) tanh(v/a) (exp(2*v/a)-1)/(exp(2*v/a)+1) sign(v)*exp(-abs(v)/k)"
    base = ec.base_parameters(
        ec.LinearModel(
            [columns.split()], ["v"], [f"F{i}" for i in range(7)], ["a", "k"]
        )
    )
    assert [str(e) for e in base.expressions] == [
        "F0",
        "F1",
        "F2 + F3",
        "F4 + F5",
        "F6",
    ]


NOT_LINEAR = {
    "p*q*x": "holds p·q",
    "exp(p)*x": "'p' is in the argument of exp",
    "x/(q + 1)": "'q' is in a denominator",
    "p*x + x": "a part without any",
    "p**2*x": "holds p·p",
    "p*sqrt(q)": "'q' is in the argument of sqrt",
}


@pytest.mark.parametrize(("output", "why"), NOT_LINEAR.items(), ids=NOT_LINEAR)
def test_nonlinear_models_are_refused_with_the_reason(output: str, why: str) -> None:
    with pytest.raises(ec.InputError) as caught:
        LinearModel.from_outputs(
            ["p*x", output], ["x"], ["p", "q"], outputs=["first", "second"]
        )
    assert why in str(caught.value)
    assert "output 'second'" in str(caught.value)


def test_what_cancels_is_linear() -> None:
    model = LinearModel.from_outputs(
        ["(x + p)**2 - p*p - x*x + sin(x)**2 - (1 - cos(x)**2)"], ["x"], ["p"]
    )
    assert model.regressor.shape == (1, 1)
    assert ec.base_parameters(model).rank == 1


BAD = {
    "shape": (lambda: LinearModel([["x"]], ["x"], ["p", "q"]), r"X has shape \(1, 1\)"),
    "ragged": (
        lambda: LinearModel([["x"], ["x", "1"]], ["x"], ["p"]),
        "different lengths",
    ),
    "unknown": (
        lambda: LinearModel([["z"]], ["x"], ["p"]),
        r"X\[0, 0\].*'z' is unknown",
    ),
    "twice": (lambda: LinearModel([["x"]], ["x"], ["x"]), "declared twice"),
    "parameter in X": (lambda: LinearModel([["p*x"]], ["x"], ["p"]), "'p' is unknown"),
    "sympy": (
        lambda: LinearModel(sympy.Matrix([sympy.gamma(x)]), [x], ["p"]),
        r"X\[0, 0\].*gamma",
    ),
    "no parameters": (lambda: LinearModel([[]], ["x"], []), "at least one parameter"),
    "units": (
        lambda: LinearModel([["x"]], ["x"], ["p"], units=["m", "s"]),
        "2 units for 1 parameters",
    ),
    "outputs": (
        lambda: LinearModel([["x"]], ["x"], ["p"], outputs=["a", "b"]),
        "1 different names",
    ),
    "value": (lambda: LinearModel([["x"]], ["x"], ["p"], {"a": "big"}), "constant 'a'"),
    "branch": (
        lambda: LinearModel(lambda x: [[x if x > 0 else 0]], ["x"], ["p"]),
        "comparison of a recorded value",
    ),
    "text for list": (lambda: LinearModel([["x"]], "x", ["p"]), "needs a list"),
}


@pytest.mark.parametrize(("make", "problem"), BAD.values(), ids=BAD)
def test_bad_models(make: Any, problem: str) -> None:
    with pytest.raises(ec.InputError, match=problem):
        make()


RELATED = {
    "arc tangents whose derivatives depend on one another": (
        ["atan(x)", "x", "atan(x/(1 + sqrt(1 + x^2)))"],
        2,
    ),
    "the root of a sum": (["exp(sqrt(1 + x^2))", "exp(2*sqrt(1 + x^2))"], 2),
    "a function of an arc tangent": (["exp(atan(x))", "x"], 2),
    "fine fractions as powers": (["1", "x^1e-20", "x^2"], 3),
    "almost the same": (["exp(x)", "exp(x) + 1e-30*x", "1"], 3),
    "values far apart": (["1", "sign(x - 1000)", "exp(x)"], 3),
    "an arc tangent beyond its pole": (
        ["atan(1/(x - 1000))", "atan(x - 1000)", "1"],
        3,
    ),
}


@pytest.mark.parametrize(("columns", "rank"), RELATED.values(), ids=RELATED)
def test_functions_of_functions(columns: list[str], rank: int) -> None:
    base = ec.base_parameters(
        LinearModel([columns], ["x"], [f"p{i}" for i in range(len(columns))])
    )
    assert base.rank == rank
    assert not base.certificate.unchecked


POOL = ["x", "y", "x*y", "exp(x)", "exp(x + y)", "log(y**2)", "log(x*y)", "sin(x)", "sin(x + y)", "sqrt(x*y)",
        "abs(x)", "tanh(y)", "1", "exp(-x)*y", "sqrt(x)*exp(y)"]  # fmt: skip


@examples(6)
@given(st.data())
def test_planted_dependences_are_found(data: Any) -> None:
    chosen = data.draw(
        st.lists(st.sampled_from(POOL), min_size=2, max_size=5, unique=True)
    )
    factors = data.draw(
        st.lists(st.integers(-5, 5), min_size=len(chosen), max_size=len(chosen))
    )
    planted = " + ".join(f"({f})*({c})" for f, c in zip(factors, chosen, strict=True))
    names = [f"p{i}" for i in range(len(chosen))]
    alone = ec.base_parameters(LinearModel([chosen], ["x", "y"], names)).rank
    base = ec.base_parameters(
        LinearModel([[*chosen, planted]], ["x", "y"], [*names, "s"])
    )
    assert base.rank == alone
    assert alone == len(chosen)
    assert list(base.B[:, len(chosen)]) == factors


def test_documents(tmp_path: Path) -> None:
    def refused(text: str) -> str:
        with pytest.raises(ec.InputError) as caught:
            read_linear(read_text(text, "model.yaml"))
        return str(caught.value)

    head = "echelon: 1\nmodel: linear\nvariables: [x]\nparameters: [p]\n"
    assert "give exactly one of outputs, regressor" in refused(head)
    assert "colour" in refused(head + "colour: red\noutputs: {y: p*x}\n")
    assert "model.yaml: output 'y': not linear" in refused(
        head + "outputs: {y: p*p*x}\n"
    )
    assert "parameters" in refused(
        "echelon: 1\nmodel: linear\nvariables: [x]\noutputs: {y: x}\n"
    )
    with pytest.raises(ec.InputError, match="cannot be read"):
        load_linear(tmp_path / "none.yaml")


@pytest.mark.parametrize("name", ANSWERS)
def test_saved_documents_hold_the_model(name: str) -> None:
    base = ec.base_parameters(load_linear(EXAMPLES / f"{name}.yaml"))
    record = json.loads(to_json(base))
    again = ec.base_parameters(
        read_linear(read_text(json.dumps(record["model"]), "model.json"))
    )
    assert [str(e) for e in again.expressions] == [
        row["expression"] for row in record["base"]
    ]
    assert record["rank"] == base.rank


def test_outputs_without_names_are_counted_from_one() -> None:
    assert ec.LinearModel([["x"], ["2*x"]], ["x"], ["p"]).outputs == ("y1", "y2")


def test_display() -> None:
    base = ec.base_parameters(load_linear(EXAMPLES / "single_track.yaml"))
    assert str(base).startswith(
        "single-track vehicle, yaw only: 4 base parameters of 6 parameters, 1 output\n"
    )
    assert "unidentifiable: m" in str(base)
    assert (
        r"\bar\zeta_{2} &= \mathrm{cf} + \frac{1}{\mathrm{lf}}\,\mathrm{cft}"
        in to_latex(base)
    )
    assert "| 2 | cf + (1/lf)·cft | N/rad |" in to_markdown(base)
    assert (
        repr(base)
        == "LinearBase(single-track vehicle, yaw only: 4 base parameters of 6)"
    )


def test_powers_that_are_fine_fractions() -> None:
    base = ec.base_parameters(
        ec.LinearModel([["1", "x^0.333333333333", "x^2"]], ["x"], ["a", "b", "c"])
    )
    assert base.rank == 3


def test_one_sample_in_gives_one_sample_out() -> None:
    base = ec.base_parameters(ec.load_linear(EXAMPLES / "heat_capacity.yaml"))
    for function in (base.regressor, base.full_regressor):
        several = function({"T": np.array([300.0, 310.0])})
        np.testing.assert_array_equal(function({"T": 310.0}), several[1])
