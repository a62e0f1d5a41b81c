"""B† in closed form: against its definition, the numeric one, and sympy's own."""

from __future__ import annotations

import numpy as np
import pytest
import sympy
from hypothesis import given

import echelon as ec
from echelon.base.pseudo_inverse import pseudo_inverse
from echelon.shared.errors import ClosedFormError, InputError
from support import textbook_arms as arms
from support.paths import EXAMPLES
from support.random_mechanisms import mechanisms
from support.selection import examples


def example(name: str, **options: object) -> ec.BaseModel:
    return ec.base_parameters(ec.load(EXAMPLES / f"{name}.yaml"), **options)  # type: ignore[arg-type]


def floats(matrix: sympy.Matrix, values: dict[str, float]) -> np.ndarray:
    names = sorted(matrix.free_symbols, key=str)
    return np.array(
        sympy.lambdify(names, matrix.tolist())(*(values[str(n)] for n in names)),
        dtype=float,
    ).reshape(matrix.shape)


def test_double_pendulum_by_hand() -> None:
    """The block of ZZ1 + l² M2 and MX1 + l M2: B = [1 0 l²; 0 1 l], so det B Bᵀ = 1 + l² + l⁴."""
    base, length = example("double_pendulum"), sympy.Symbol("l1")
    found = base.pseudo_inverse()
    assert found.shape == (20, 6)
    assert (
        sympy.simplify(found[5, 0] - (1 + length**2) / (1 + length**2 + length**4)) == 0
    )
    assert sympy.simplify(found[19, 0] - length**2 / (1 + length**2 + length**4)) == 0
    assert found[7, 2] == 1
    assert (base.B * found).applyfunc(sympy.simplify) == sympy.eye(6)


@pytest.mark.parametrize("metric", ["identity", "diagonal", "symbols", "full"])
def test_theorem_for_every_kind_of_metric(metric: str) -> None:
    base, n = example("double_pendulum"), 20
    weights = [sympy.Rational(k + 2, 3) for k in range(n)]
    a, length = sympy.symbols("a L", positive=True)
    given = {
        "identity": "identity",
        "diagonal": weights,
        "symbols": [a, *weights[1:-1], length**2],
        "full": sympy.Matrix(
            n,
            n,
            lambda i, j: weights[i] if i == j else sympy.Rational(abs(i - j) == 14, 9),
        ),
    }[metric]
    s = (
        sympy.eye(n)
        if metric == "identity"
        else given
        if metric == "full"
        else sympy.diag(*given)
    )
    gram = base.B * s * base.B.T
    residual = base.pseudo_inverse(given) * gram - s * base.B.T
    assert residual.applyfunc(sympy.cancel).is_zero_matrix


@examples(6)
@given(mechanisms(3))
def test_random_mechanisms(mechanism: ec.Mechanism) -> None:
    base = ec.base_parameters(mechanism)
    values = {name: symbol.value for name, symbol in mechanism.symbols.items()}
    found = floats(base.pseudo_inverse(), values)  # type: ignore[arg-type]
    np.testing.assert_allclose(found, np.linalg.pinv(base.B_float()), atol=1e-9)


def test_angles_and_roots() -> None:
    """An arm with an angle symbol and links at 30° and 45°."""
    rows = ["R 0 0 0", "R beta a 0", "R pi/4 b 0"]
    values = {"a": "0.3", "b": "-0.45", "g": "9.81", "beta": "0.7"}
    base = ec.base_parameters(arms.modified_dh("skew", *rows, values=values))
    found = floats(
        base.pseudo_inverse(), {name: float(text) for name, text in values.items()}
    )
    np.testing.assert_allclose(found, base.pseudo_inverse_float("identity"), atol=1e-9)


def test_representatives_with_quotients() -> None:
    base = example("double_pendulum", prefer=["M2"])
    found = floats(base.pseudo_inverse(), {"l1": 0.3})
    np.testing.assert_allclose(
        found, np.linalg.pinv(base.B_float({"l1": 0.3})), atol=1e-12
    )


@pytest.mark.slow
def test_rx90_in_closed_form() -> None:
    base = example("rx90")
    values = {"D3": 0.45, "RL4": 0.4}
    found = base.pseudo_inverse()
    np.testing.assert_allclose(
        floats(found, values), np.linalg.pinv(base.B_float(values)), atol=1e-10
    )
    row = {
        sympy.Symbol(name): sympy.Rational(str(value)) for name, value in values.items()
    }
    assert (base.B[0, :].subs(row) * found.subs(row))[0, 0] == 1


def test_linear_models_too() -> None:
    t, k = sympy.symbols("t k")
    model = ec.LinearModel(
        [[sympy.cos(t), sympy.exp(t), k * sympy.cos(t)]], ["t"], ["a", "b", "c"], ["k"]
    )
    found = ec.base_parameters(model).pseudo_inverse()
    assert sympy.simplify(found[2, 0] - k / (1 + k**2)) == 0


def test_numbers_instead_of_symbols() -> None:
    """A robot read with numbers has an inverse in exact numbers."""
    base = ec.base_parameters(ec.load(EXAMPLES / "two_link.xml", symbolic=False))
    found = base.pseudo_inverse()
    assert base.B * found == sympy.eye(base.rank)
    assert all(entry.is_Rational for entry in found)


def test_floats_give_the_lift() -> None:
    base, rng = example("panda"), np.random.default_rng(3)
    values, prior = rng.normal(size=43), rng.normal(size=70)
    corrected = prior + base.pseudo_inverse_float() @ (values - base.B_float() @ prior)
    np.testing.assert_allclose(base.lift(values, prior), corrected, atol=1e-9)


@pytest.mark.parametrize(
    ("metric", "words"),
    [
        ("physical", "unknown metric"),
        ([1] * 19, "19 × 19; expected 20 × 20"),
        ([1] * 19 + [-1], "not positive definite"),
        ([1] * 19 + [sympy.sqrt(2)], "rational"),
        (["x +"] + [1] * 19, "'x \\+' is not"),
        (
            sympy.eye(20) + sympy.Matrix(20, 20, lambda i, j: int((i, j) == (0, 1))),
            "not symmetric",
        ),
        (
            sympy.eye(20)
            + 2 * sympy.Matrix(20, 20, lambda i, j: int({i, j} == {0, 1})),
            "not positive definite",
        ),
    ],
)
def test_metrics_that_are_none(metric: object, words: str) -> None:
    with pytest.raises(InputError, match=words):
        example("double_pendulum").pseudo_inverse(metric)  # type: ignore[arg-type]


def test_what_is_too_long_is_refused() -> None:
    with pytest.raises(
        ClosedFormError,
        match="more than 50 terms; numbers for symbols, or pseudo_inverse_float",
    ):
        pseudo_inverse(example("rx90").matrix, "identity", {}, most_terms=50)


@pytest.mark.slow
def test_panda_in_closed_form() -> None:
    base = example("panda")
    values = {"a4": 0.0825, "a7": 0.088, "d1": 0.333, "d3": 0.316, "d5": 0.384}
    found = base.pseudo_inverse()
    names = sorted(found.free_symbols, key=str)
    rows = [0, 19, 29, 69]
    some = sympy.Matrix([list(found[r, :]) for r in rows])
    numbers = sympy.lambdify(names, some.tolist())(*(values[str(n)] for n in names))
    np.testing.assert_allclose(
        np.array(numbers, dtype=float),
        np.linalg.pinv(base.B_float(values))[rows],
        atol=1e-9,
    )
