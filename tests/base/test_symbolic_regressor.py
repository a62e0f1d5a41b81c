"""The base regressor as formulas: the textbook's, and in numbers that of the machine code."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import sympy
from click.testing import CliRunner
from hypothesis import given

import echelon as ec
from echelon.base.claims.audit import random_states
from echelon.base.symbolic import SymbolicRegressor
from echelon.cli.commands import app
from echelon.dynamics.evaluate import evaluate_floats
from echelon.robot.joint import rotation
from echelon.shared.errors import ClosedFormError, InputError
from support import textbook_arms as arms
from support.paths import EXAMPLES
from support.random_mechanisms import mechanisms
from support.selection import examples, one_in


def example(name: str) -> ec.BaseModel:
    return ec.base_parameters(ec.load(EXAMPLES / f"{name}.yaml"))


def check(base: ec.BaseModel, found: SymbolicRegressor, **symbols: float) -> None:
    """The formulas give the numbers of the regressor at random states."""
    robot = base.mechanism
    q, qd, qdd = random_states(base, np.random.default_rng(4))
    kinds = {
        "q": (q, robot.positions),
        "qd": (qd, robot.velocities),
        "qdd": (qdd, robot.velocities),
    }
    values = {
        f"{k}[{n}]": array[:, i]
        for k, (array, names) in kinds.items()
        for i, n in enumerate(names)
    }
    values |= {
        name: np.full(len(q), s.value)
        for name, s in robot.symbols.items()
        if s.value is not None
    }
    values |= {name: np.full(len(q), value) for name, value in symbols.items()}
    known = {s: values[found.inputs.get(s.name, s.name)] for s in symbols_of(found)}
    for symbol, formula in found.subexpressions:
        known[symbol] = number(formula, known)
    expected = evaluate_floats(base.reduced, robot, q, qd, qdd, symbols)
    for (i, j), entry in np.ndenumerate(np.array(found.entries.tolist(), dtype=object)):
        np.testing.assert_allclose(
            number(entry, known),
            expected[:, i, j],
            atol=1e-9 * max(1, abs(expected).max()),
        )


def symbols_of(found: SymbolicRegressor) -> set[sympy.Symbol]:
    everything = found.entries.free_symbols.union(
        *(f.free_symbols for _, f in found.subexpressions)
    )
    return everything - {s for s, _ in found.subexpressions}


def number(formula: sympy.Expr, known: dict[sympy.Symbol, np.ndarray]) -> np.ndarray:
    used = sorted(formula.free_symbols, key=str)
    return sympy.lambdify(used, formula)(*(known[s] for s in used)) + np.zeros(
        len(next(iter(known.values()), [0.0]))
    )


def test_double_pendulum_as_in_textbooks() -> None:
    q1, q2, u, v, a, b, g, length = sympy.symbols("q1 q2 qd1 qd2 qdd1 qdd2 g l1")
    c, s, cc, ss = sympy.cos(q2), sympy.sin(q2), sympy.cos(q1 + q2), sympy.sin(q1 + q2)
    expected = [
        [
            a, g * sympy.cos(q1), -g * sympy.sin(q1), a + b,
            length * c * (2 * a + b) - length * s * v * (2 * u + v) + g * cc,
            -length * s * (2 * a + b) - length * c * v * (2 * u + v) - g * ss,
        ],
        [0, 0, 0, a + b, length * c * a + length * s * u**2 + g * cc, -length * s * a + length * c * u**2 - g * ss],
    ]  # fmt: skip
    found = example("double_pendulum").symbolic_regressor()
    assert found.entries == sympy.ImmutableMatrix(expected)
    assert found.subexpressions == ()
    assert found.inputs["qdd2"] == "qdd[j2]"
    assert "\\bar X_{1,1} &= \\ddot q_{1} \\\\" in found.latex()


@pytest.mark.parametrize(
    "name",
    one_in(
        2,
        [
            "cart_pole",
            "floating_tree",
            "gripper_coupled",
            "loops/../rx90",
            "scara",
            "furuta",
        ],
    ),
)
def test_numbers_of_the_examples(name: str) -> None:
    base = example(name)
    check(base, base.symbolic_regressor())


@pytest.mark.parametrize("form", ["short", "named"])
def test_both_forms_of_an_elbow(form: str) -> None:
    """A vertical axis and two horizontal ones: sums of the angles of the last two."""
    arm = arms.modified_dh(
        "elbow", "R 0 0 0", "R pi/2 0 0", "R 0 a 0", values={"a": "0.4", "g": "9.81"}
    )
    base = ec.base_parameters(arm)
    found = base.symbolic_regressor(form)  # type: ignore[arg-type]
    assert bool(found.subexpressions) == (form == "named")
    check(base, found)
    if form == "short":
        q2, q3, g, a, second = sympy.symbols("q2 q3 g a qdd2")
        entry = found.entries[2, found.columns.index("MX3")]
        assert entry.coeff(g) == sympy.cos(q2 + q3)
        assert entry.coeff(second) == a * sympy.cos(q3)


def test_axes_that_point_against_each_other() -> None:
    """cos q1 cos q2 + sin q1 sin q2 = cos(q1 − q2)."""
    bodies = [
        arms.body(1, 0, "revolute", rotation("q1")),
        arms.body(2, 1, "revolute", arms.place("a 0 0"), rotation("q2", sign=-1)),
    ]
    base = ec.base_parameters(
        arms.tree(
            "against", *bodies, gravity="0 -g 0", values={"a": "0.4", "g": "9.81"}
        )
    )
    found = base.symbolic_regressor()
    q1, q2, g = sympy.symbols("q1 q2 g")
    assert found.entries[0, found.columns.index("MX2")].coeff(g) == sympy.cos(q1 - q2)
    check(base, found)


@examples(4)
@given(mechanisms(2))
def test_random_mechanisms(mechanism: ec.Mechanism) -> None:
    base = ec.base_parameters(mechanism)
    for form in ("auto", "named"):
        check(base, base.symbolic_regressor(form))  # type: ignore[arg-type]


def test_python_text_runs_and_is_exact() -> None:
    found = example("furuta").symbolic_regressor()
    names: dict[str, object] = {}
    exec(found.python(), names)
    assert sympy.ImmutableMatrix(names["X"]) == found.entries
    named = example("rx90").symbolic_regressor()
    exec(named.python(), names)
    assert sympy.ImmutableMatrix(names["X"]).shape == named.entries.shape == (6, 36)


def test_named_subexpressions_put_in() -> None:
    base = example("double_pendulum")
    difference = (
        base.symbolic_regressor("named").matrix
        - base.symbolic_regressor("short").entries
    )
    assert difference.applyfunc(
        lambda e: sympy.expand(sympy.expand_trig(e))
    ).is_zero_matrix


def test_linear_models_and_reserved_names() -> None:
    x, rate, lam = sympy.symbols("x y lambda")
    model = ec.LinearModel(
        [[lam * x, sympy.exp(x) * rate, 2 * x]], ["x", "y"], ["a", "b", "c"], ["lambda"]
    )
    found = ec.base_parameters(model).symbolic_regressor()
    assert found.entries == sympy.ImmutableMatrix(
        [[sympy.Symbol("lambda_") * x, sympy.exp(x) * rate]]
    )
    assert found.inputs["lambda_"] == "lambda"
    names: dict[str, object] = {}
    exec(found.python(), names)
    assert names["X"] == sympy.Matrix(found.entries)


def test_refusals() -> None:
    with pytest.raises(ClosedFormError, match="more than 4096 terms"):
        example("panda").symbolic_regressor("short")
    with pytest.raises(
        InputError,
        match="argument 'form' of symbolic_regressor: needs one of 'auto', 'short', 'named'",
    ):
        example("furuta").symbolic_regressor("long")  # type: ignore[arg-type]


def test_command(tmp_path: Path) -> None:
    robot = str(EXAMPLES / "double_pendulum.yaml")
    latex = CliRunner().invoke(app, ["derive", robot, "--regressor", "latex"])
    assert latex.exit_code == 0
    assert "\\cos{\\left(q_{1} + q_{2} \\right)}" in latex.stdout
    file = tmp_path / "x.py"
    assert (
        CliRunner()
        .invoke(app, ["derive", robot, "--regressor", "sympy", "-o", str(file)])
        .exit_code
        == 0
    )
    assert "X[0, 3] = qdd1 + qdd2\n" in file.read_text()
    assert (
        CliRunner()
        .invoke(app, ["derive", robot, "--regressor", "latex", "--rank-only"])
        .exit_code
        == 2
    )
