"""Closed forms against textbooks, exact row reduction, another program's regressor and floating point."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from fractions import Fraction

import numpy as np
import pinocchio as pin
import pytest
from sympy import QQ
from sympy.polys.matrices import DomainMatrix

from echelon import base_parameters
from echelon.algebra.exact.expressions import parse
from echelon.algebra.exact.polynomial import Polynomial
from echelon.algebra.program.operations import Op
from echelon.base.model import BaseModel
from echelon.dynamics.linear_forms import LinearForms
from echelon.robot.mechanism import Mechanism
from echelon.shared.conventions import LENGTH_DEGREE, PER_BODY
from support import textbook_arms as arms
from support.float_regressor import FloatArray, random_states
from support.selection import one_in
from support.textbook_arms import body, place, rotation, tree

# -- textbook sets ----------------------------------------------------------------------------------------------------

TEXTBOOK = {
    arms.double_pendulum: """
        ZZ1 + l1^2*M2
        MX1 + l1*M2
        MY1
        ZZ2
        MX2
        MY2""",
    arms.rx90: """
        ZZ1 + YY2 + YY3 + D3^2*(M3 + M4 + M5 + M6)
        XX2 - YY2 - D3^2*(M3 + M4 + M5 + M6)
        XY2
        XZ2 - D3*MZ3
        YZ2
        ZZ2 + D3^2*(M3 + M4 + M5 + M6)
        MX2 + D3*(M3 + M4 + M5 + M6)
        MY2
        XX3 - YY3 + YY4 + 2*RL4*MZ4 + RL4^2*(M4 + M5 + M6)
        XY3
        XZ3
        YZ3
        ZZ3 + YY4 + 2*RL4*MZ4 + RL4^2*(M4 + M5 + M6)
        MX3
        MY3 + MZ4 + RL4*(M4 + M5 + M6)
        XX4 - YY4 + YY5
        XY4
        XZ4
        YZ4
        ZZ4 + YY5
        MX4
        MY4 - MZ5
        XX5 - YY5 + YY6
        XY5
        XZ5
        YZ5
        ZZ5 + YY6
        MX5
        MY5 + MZ6
        XX6 - YY6
        XY6
        XZ6
        YZ6
        ZZ6
        MX6
        MY6""",
}


def coefficients(text: str, parameters: tuple[str, ...]) -> dict[str, Polynomial]:
    """A sum of standard parameters as a coefficient for each of them."""
    row: dict[str, Polynomial] = {}
    for monomial, number in parse(text).terms.items():
        (name,) = (generator for generator, _ in monomial if generator in parameters)
        rest = tuple(factor for factor in monomial if factor[0] != name)
        row[name] = row.get(name, Polynomial({})) + Polynomial({rest: number})
    return row


def rows(model: BaseModel) -> list[dict[str, object]]:
    return [
        {model.parameters[column]: value for column, value in row.items()}
        for row in model.matrix.rows
    ]


@pytest.mark.parametrize("arm", TEXTBOOK, ids=lambda arm: arm.__name__)
def test_textbook_set_term_by_term(arm: Callable[[], Mechanism]) -> None:
    model = base_parameters(arm())
    expected = [
        coefficients(line, model.parameters) for line in TEXTBOOK[arm].split("\n")[1:]
    ]
    assert rows(model) == expected
    assert model.pivots == tuple(next(iter(row)) for row in rows(model))


def double_pendulum_by_hand(
    q: FloatArray, qd: FloatArray, qdd: FloatArray, l1: float, g: float
) -> FloatArray:
    """The reduced regressor as derived on paper, shape (N, 2, 6)."""
    (_, q2), (v1, v2), (a1, a2) = q.T, qd.T, qdd.T
    c1, s1, c2, s2, c12, s12 = (
        f(x) for x in (q[:, 0], q2, q.sum(axis=1)) for f in (np.cos, np.sin)
    )
    zero = np.zeros_like(c1)
    first = [
        a1,
        g * c1,
        -g * s1,
        a1 + a2,
        l1 * c2 * (2 * a1 + a2) - l1 * s2 * v2 * (2 * v1 + v2) + g * c12,
        -l1 * s2 * (2 * a1 + a2) - l1 * c2 * v2 * (2 * v1 + v2) - g * s12,
    ]
    second = [
        zero,
        zero,
        zero,
        a1 + a2,
        l1 * c2 * a1 + l1 * s2 * v1**2 + g * c12,
        -l1 * s2 * a1 + l1 * c2 * v1**2 - g * s12,
    ]
    return np.array([first, second]).transpose(2, 0, 1)


def test_reduced_regressor_of_the_double_pendulum() -> None:
    model = base_parameters(arms.double_pendulum())
    states = random_states(model.mechanism, 50)
    expected = double_pendulum_by_hand(*states, l1=0.7, g=9.8)
    np.testing.assert_allclose(
        model.regressor(*states, {"l1": 0.7, "g": 9.8}), expected, atol=1e-12
    )


# -- floating point ---------------------------------------------------------------------------------------------------

COUNTS: dict[Callable[[], Mechanism], int] = {
    arms.double_pendulum: 6,
    lambda: arms.double_pendulum(None): 4,
    lambda: arms.double_pendulum(arms.DOWN): 4,
    arms.rx90: 36,
    arms.puma560: 36,
    lambda: arms.puma560(arms.GENERIC): 38,
    lambda: arms.puma560(None): 34,
    arms.panda: 43,
    arms.stanford: 33,
    lambda: arms.general_arm(4): 7 * 4 - 6,
    lambda: arms.general_arm(4, arms.GENERIC): 7 * 4 - 4,
    lambda: arms.planar(4): 3 * 4,
    lambda: arms.planar(4, None): 3 * 4 - 2,
    arms.cart_pole: 4,
    arms.furuta: 8,
    arms.cartesian: 3,
    arms.cylindrical_robot: 5,
    arms.spherical: 9,
    lambda: arms.spherical(None): 6,
    arms.floating_pair: 10 + 7,
    arms.free_body: 10,
    arms.rigid: 0,
    arms.helical: 12,
    arms.universal: 17,
    arms.cylindrical: 13,
    arms.prismatic: 14,
    arms.coupled: 9,
    arms.rack: 5,
    arms.massless: 10,
    arms.branched: 17,
    arms.inclined: 8,
    arms.slanted: 21,
}


def random_symbols(model: BaseModel, seed: int = 5) -> dict[str, float]:
    rng = np.random.default_rng(seed)
    inputs = model.standard_forms.program.inputs.values()
    names = sorted(
        {*model.matrix.symbols, *(i.name for i in inputs if i.role == "symbol")}
    )
    return {name: float(rng.uniform(0.4, 1.4)) for name in names}


@pytest.mark.parametrize(
    "arm",
    one_in(3, COUNTS),
    ids=lambda arm: f"{arm().name.replace(' ', '-')}-{COUNTS[arm]}",
)
def test_float_regressor_has_the_rank_and_the_row_space(
    arm: Callable[[], Mechanism],
) -> None:
    """Without exact arithmetic: the singular values give the count, and X = X̄ B, so that X N = 0."""
    model = base_parameters(arm())
    assert model.rank == COUNTS[arm]
    symbols, states = random_symbols(model), random_states(model.mechanism, 120)
    full, reduced = (
        model.standard_regressor(*states, symbols),
        model.regressor(*states, symbols),
    )
    np.testing.assert_allclose(
        reduced @ model.B_float(symbols),
        full,
        atol=1e-10 * (1 + np.abs(full).max(initial=0)),
    )
    observation = full.reshape(-1, len(model.parameters))
    if observation.size:
        assert (
            np.linalg.matrix_rank(observation, tol=1e-9 * np.linalg.norm(observation))
            == model.rank
        )


def test_panda_spans_the_null_space_of_pinocchio() -> None:
    """Rank and null space of W, sampled by another program at a random geometry."""
    model = base_parameters(arms.panda())
    symbols = random_symbols(model)
    observation = np.vstack(
        [
            pinocchio_regressor(symbols, *state)
            for state in np.random.default_rng(7).random((40, 3, 7))
        ]
    )
    _, sizes, directions = np.linalg.svd(observation)
    assert sizes[42] > 1e-3 > 1e-10 > sizes[43]
    assert np.abs(model.B_float(symbols) @ directions[43:].T).max() < 1e-10


def pinocchio_regressor(symbols: Mapping[str, float], *state: FloatArray) -> FloatArray:
    """X of the Panda in our parameter order, shape (7, 70)."""
    robot = pin.Model()
    robot.gravity.linear = np.array([0, 0, -9.81])
    twists = (0, -np.pi / 2, np.pi / 2, np.pi / 2, -np.pi / 2, np.pi / 2, np.pi / 2)
    along_x = (0, 0, 0, symbols["a4"], -symbols["a4"], 0, symbols["a7"])
    along_z = (symbols.get("d1", 0.3), 0, symbols["d3"], 0, symbols["d5"], 0, 0)
    for i, (alpha, a, d) in enumerate(zip(twists, along_x, along_z, strict=True)):
        turned = pin.SE3(pin.utils.rotate("x", alpha), np.array([a, 0, 0]))
        robot.addJoint(
            i,
            pin.JointModelRZ(),
            turned * pin.SE3(np.eye(3), np.array([0, 0, d])),
            f"q{i + 1}",
        )
    columns = [
        10 * block + k for block in range(7) for k in (4, 5, 7, 6, 8, 9, 1, 2, 3, 0)
    ]
    result: FloatArray = pin.computeJointTorqueRegressor(
        robot, robot.createData(), *state
    )[:, columns]
    return result


# -- exact row reduction ----------------------------------------------------------------------------------------------


def exact_entries(
    forms: LinearForms, values: Mapping[str, Fraction]
) -> dict[tuple[int, int], Fraction]:
    """All entries in plain fractions; sines and cosines are given as ``cos(name)`` and ``sin(name)``."""
    program, found = forms.program, dict[int, Fraction]()
    operations = {
        Op.ADD: Fraction.__add__,
        Op.SUB: Fraction.__sub__,
        Op.MUL: Fraction.__mul__,
    }
    for node in program.needed(list(forms.entries.values())):
        op, left = Op(program.ops[node]), program.lhs[node]
        if op is Op.CONSTANT:
            found[node] = Fraction(program.constants[node])  # type: ignore[arg-type]
        elif op is Op.INPUT:
            found[node] = values[program.inputs[node].name]
        elif op in (Op.SIN, Op.COS):
            found[node] = values[f"{op.name.lower()}({program.inputs[left].name})"]
        else:
            found[node] = (
                -found[left]
                if op is Op.NEG
                else operations[op](found[left], found[program.rhs[node]])
            )
    return {key: found[node] for key, node in forms.entries.items()}


def random_values(forms: LinearForms, rng: np.random.Generator) -> dict[str, Fraction]:
    """Random fractions for all inputs, and circle points for those that are angles."""
    values = {}
    for name in sorted({i.name for i in forms.program.inputs.values()}):
        t = values[name] = Fraction(int(rng.integers(-9, 10)), int(rng.integers(1, 5)))
        values[f"cos({name})"], values[f"sin({name})"] = (
            (1 - t * t) / (1 + t * t),
            2 * t / (1 + t * t),
        )
    return values


@pytest.mark.parametrize(
    "arm",
    [
        arms.double_pendulum,
        arms.furuta,
        arms.cart_pole,
        arms.universal,
        arms.branched,
        arms.inclined,
    ],
)
def test_rref_of_rational_samples(arm: Callable[[], Mechanism]) -> None:
    """Theorem 1 of the paper, literally: B is the reduced echelon form of W, here by sympy."""
    model = base_parameters(arm())
    forms, rng = model.standard_forms, np.random.default_rng(3)
    geometry = {
        name: x for name, x in random_values(forms, rng).items() if "[" not in name
    }
    observation: list[list[Fraction]] = []
    for _ in range(2 + model.rank):
        entries = exact_entries(forms, {**random_values(forms, rng), **geometry})
        height, width = forms.shape
        observation += [
            [entries.get((i, j), Fraction(0)) for j in range(width)]
            for i in range(height)
        ]
    reduced, pivots = DomainMatrix(
        [[QQ(x.numerator, x.denominator) for x in row] for row in observation],
        (len(observation), forms.shape[1]),
        QQ,
    ).rref()
    assert pivots == model.matrix.pivots
    expected = [
        {j: Fraction(str(x)) for j, x in enumerate(row) if x}
        for row in reduced.to_list()[: model.rank]
    ]
    assert [
        {j: c.evaluate(geometry, Fraction) for j, c in row.items()}
        for row in model.matrix.rows
    ] == expected


# -- special coefficients ---------------------------------------------------------------------------------------------


def test_quotients_for_an_axis_in_general_direction() -> None:
    """Adding E − u uᵀ to the tensor, or u to the first moments, of a body about its axis u changes no torque of it."""
    model = base_parameters(arms.inclined())
    azimuth, inclination = 0.9, 0.6
    x, y, z = (
        np.sin(inclination) * np.cos(azimuth),
        np.sin(inclination) * np.sin(azimuth),
        np.cos(inclination),
    )
    expected = {
        "XX2": {"ZZ2": -(1 - x * x) / (1 - z * z)},
        "XY2": {"ZZ2": x * y / (1 - z * z)},
        "XZ2": {"ZZ2": x * z / (1 - z * z)},
        "YY2": {"ZZ2": -(1 - y * y) / (1 - z * z)},
        "YZ2": {"ZZ2": y * z / (1 - z * z)},
        "MX2": {"MZ2": -x / z},
        "MY2": {"MZ2": -y / z},
    }
    assert (
        sum(not c.is_polynomial for row in model.matrix.rows for c in row.values()) >= 6
    )
    numbers = model.B_float(
        {"a": 0.3, "b": 0.2, "azimuth": azimuth, "inclination": inclination}
    )
    column = {name: i for i, name in enumerate(model.parameters)}
    for name, others in expected.items():
        row = numbers[model.pivots.index(name)].copy()
        for other, value in {name: 1.0, **others}.items():
            assert row[column[other]] == pytest.approx(value, rel=1e-12)
            row[column[other]] = 0
        assert not row.any()


def test_coefficients_with_square_roots() -> None:
    """Across a prismatic joint the whole tensor is carried over: here turned by 15° about x."""
    model = base_parameters(arms.slanted())
    found = dict(zip(model.pivots, rows(model), strict=True))
    assert found["XY3"] == coefficients(
        "XY3 + (sqrt(6) + sqrt(2))/4*XY4 - (sqrt(6) - sqrt(2))/4*XZ4", model.parameters
    )
    assert found["YZ3"] == coefficients(
        "YZ3 + YY4/4 + sqrt(3)/2*YZ4 - ZZ4/4", model.parameters
    )
    assert found["MY2"] == coefficients(
        "MY2 - sqrt(2)/2*MZ3 - sqrt(2)/2*d3*M3", model.parameters
    )


# -- what must not matter ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "arm",
    one_in(2, [arms.rack, arms.panda, arms.inclined, arms.slanted, arms.prismatic]),
)
def test_the_seed_does_not_matter(arm: Callable[[], Mechanism]) -> None:
    first = base_parameters(arm(), seed=0)
    assert all(
        base_parameters(arm(), seed=seed).matrix == first.matrix for seed in range(1, 6)
    )


@pytest.mark.parametrize("symbols", [(), ("d5",), ("d3", "a4")])
def test_numbers_in_place_of_symbols(symbols: tuple[str, ...]) -> None:
    """The set of a robot with some or all lengths as numbers is that with symbols, evaluated."""
    numeric = base_parameters(
        arms.panda(
            lengths=[s if s in symbols else text for s, text in arms.PANDA.items()]
        )
    )
    assert numeric.matrix.symbols == tuple(sorted(symbols))
    assert base_parameters(arms.panda()).B_exact == numeric.B_exact


def test_millimetres() -> None:
    """A unit of length scales every coefficient by its dimension and changes nothing else."""
    metres = base_parameters(arms.panda(lengths=tuple(arms.PANDA.values())))
    millimetres = base_parameters(
        arms.panda("0 0 -9810", [f"{1000 * float(x):g}" for x in arms.PANDA.values()])
    )
    assert millimetres.pivots == metres.pivots
    for pivot, small, large in zip(
        metres.matrix.pivots, metres.matrix.rows, millimetres.matrix.rows, strict=True
    ):
        degree = {
            c: LENGTH_DEGREE[pivot % PER_BODY] - LENGTH_DEGREE[c % PER_BODY]
            for c in small
        }
        assert {
            c: value.numerator * Fraction(1000) ** degree[c]
            for c, value in small.items()
        } == large


@pytest.mark.parametrize("base", [place("1 2 3"), place("x y z", "0 0 pi/3")])
def test_the_base_frame_does_not_matter(base: arms.Placement) -> None:
    """Moved along anything and turned about gravity."""
    first, *others = arms.rx90().bodies
    moved = tree("rx90", body(1, 0, "revolute", base, rotation("q1")), *others)
    assert first.joint.steps == (rotation("q1"),)
    assert base_parameters(moved).matrix == base_parameters(arms.rx90()).matrix
