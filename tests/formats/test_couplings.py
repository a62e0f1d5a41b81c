"""Couplings that are polynomials and splines: against SciPy, the free tree's dynamics, and singular values."""

from __future__ import annotations

import json
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial import Polynomial as Powers
from scipy.interpolate import CubicSpline

import echelon as ec
from echelon.algebra.exact.polynomial import Polynomial
from echelon.dynamics.functions import robot_function
from echelon.formats.snapping import ReadingOptions
from echelon.formats.writers.description_writer import write_description
from echelon.robot.coupling import Spline, natural_spline
from echelon.robot.locking import lock_joints
from echelon.robot.mechanism import Mechanism
from support.descriptions import read_description
from support.float_functions import evaluate
from support.float_regressor import FloatArray, float_regressor, random_states
from support.pinocchio_loops import Constrained
from support.selection import examples, one_in

POINTS = [
    [-2, 0.03],
    [-1.2, 0.01],
    [-0.3, -0.012],
    [0, 0.001],
    [0.7, 0.02],
    [1.5, -0.04],
]
SLIDE = Powers([0.05, -0.02, 0.1, 0, 0.01])
LIFT = CubicSpline(*np.array(POINTS).T, bc_type="natural")
TILT = Powers([0.3, 0.5, -0.2, 0.1])

LEG = """
echelon: 1
name: leg
symbols: {l: 0.4}
gravity: [0.3, -9.81, 0]
BASE
COUPLED
bodies:
  - {name: thigh, joint: HIP}
  - {name: c1, parent: thigh, joint: {type: prismatic, name: slide, axis: x, origin: {xyz: [l, 0, 0]}}}
  - {name: c2, parent: c1, joint: {type: prismatic, name: lift, axis: y}, massless: true}
  - {name: shank, parent: c2, joint: {type: revolute, name: knee, axis: z}}
  - {name: patella, parent: thigh, joint: {type: revolute, name: tilt, axis: [1, 0, 2]}}
"""
COUPLED = """
couplings:
  - slide: 0.1*knee^2 - 0.02*knee + 0.01*knee^4 + 0.05
  - lift: {spline: {of: knee, points: POINTS}}
  - tilt: 0.3 + 0.5*knee - 0.2*knee^2 + 0.1*knee^3 - 0.4*hip
""".replace("POINTS", str(POINTS))


def leg(
    coupled: str = COUPLED,
    base: str = "",
    hip: str = "{type: revolute, name: hip, axis: z}",
    text: str = LEG,
) -> Mechanism:
    text = text.replace("COUPLED", coupled).replace("BASE", base).replace("HIP", hip)
    return read_description(text, "leg.yaml", ReadingOptions())


def followers(q: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Positions of slide, lift and tilt for a hip and a knee, with first and second derivatives by the knee."""
    knee = q[:, 1]
    rows = [
        [f(knee), d(knee), c(knee)]
        for f, d, c in ((f, f.deriv(), f.deriv(2)) for f in (SLIDE, TILT))
    ]
    rows.insert(1, [beyond(LIFT, knee, k) for k in range(3)])
    values, slopes, bends = np.transpose(rows, (1, 2, 0))
    values[:, 2] -= 0.4 * q[:, 0]
    return values, slopes, bends


def beyond(spline: CubicSpline, x: FloatArray, order: int) -> FloatArray:
    """A derivative of a spline that goes on straight beyond its ends."""
    at = np.clip(x, spline.x[0], spline.x[-1])
    straight = spline(at, 1) * (x - at) if order == 0 else 0.0
    found = spline(at, order) + straight
    return np.where(at == x, found, found if order < 2 else 0.0)


def all_states(
    q: FloatArray, qd: FloatArray, qdd: FloatArray
) -> tuple[FloatArray, ...]:
    """States of hip, slide, lift, knee and tilt, and the Jacobians by hip and knee."""
    values, slopes, bends = followers(q)
    jacobian = np.zeros((len(q), 5, 2))
    jacobian[:, 0, 0] = jacobian[:, 3, 1] = 1
    jacobian[:, [1, 2, 4], 1], jacobian[:, 4, 0] = slopes, -0.4
    moved = np.einsum("sij,sj->si", jacobian, qdd)
    moved[:, [1, 2, 4]] += bends * qd[:, 1:] ** 2
    positions = np.column_stack([q[:, 0], values[:, :2], q[:, 1], values[:, 2]])
    return positions, np.einsum("sij,sj->si", jacobian, qd), moved, jacobian


# -- the functions -----------------------------------------------------------------------------------------------------

fractions = st.fractions(-3, 3, max_denominator=20)


@given(
    st.lists(
        st.tuples(fractions, fractions),
        min_size=2,
        max_size=7,
        unique_by=lambda p: p[0],
    )
)
def test_natural_splines_are_those_of_scipy(
    points: list[tuple[Fraction, Fraction]],
) -> None:
    x, y = np.array(sorted(points), dtype=float).T
    expected = CubicSpline(x, y, bc_type="natural")
    spline, constant = natural_spline(points)
    size = 1 + max(np.abs(expected(x, k)).max() for k in range(3))
    at = np.linspace(-4, 4, 41)
    for order, found in enumerate(spline.floats(at, {})):
        whole = found + float(constant) * (order == 0)
        np.testing.assert_allclose(
            whole, beyond(expected, at, order), rtol=0, atol=1e-10 * size
        )
    assert spline.floats(0.0, {})[0] == 0


@given(st.lists(fractions, min_size=2, max_size=6, unique=True), fractions, fractions)
def test_a_spline_through_points_of_a_line_is_that_line(
    x: list[Fraction], slope: Fraction, constant: Fraction
) -> None:
    spline, offset = natural_spline([(a, slope * a + constant) for a in x])
    assert spline.ratio == slope
    assert offset == constant


@given(
    st.lists(fractions, max_size=4),
    st.lists(fractions, max_size=3),
    fractions,
    fractions,
)
def test_functions_of_functions(
    a: list[Fraction], b: list[Fraction], offset: Fraction, x: Fraction
) -> None:
    outer, inner = (Spline(tuple(map(Polynomial.constant, c))) for c in (a, b))
    found, constant = outer.after(inner, Polynomial.constant(offset))
    assert constant.number is not None
    y = sum(c * x**k for k, c in enumerate(b, start=1)) + offset
    expected = sum(c * y**k for k, c in enumerate(a, start=1))
    value = sum(
        c * x**k for k, c in enumerate((p.number for p in found.coefficients), start=1)
    )  # type: ignore[operator]
    assert value + constant.number == expected


@given(
    st.lists(fractions, max_size=5),
    st.lists(st.tuples(fractions, fractions), max_size=3),
    st.floats(0.1, 3),
)
def test_nothing_is_steeper_than_the_steepest(
    a: list[Fraction], knots: list[tuple[Fraction, Fraction]], reach: float
) -> None:
    spline = Spline(
        tuple(map(Polynomial.constant, a)),
        tuple((x, Polynomial.constant(c)) for x, c in knots),
    )
    slopes = np.abs(
        spline.floats(np.linspace(-reach, reach, 333), {})[1] + np.zeros(333)
    )
    assert max(slopes) <= spline.steepest(reach, {}) * (1 + 1e-12) + 1e-300
    assert spline.steepest(reach, {}) <= max(slopes) + 0.1 * (
        1 + sum(map(abs, a)) * 200 + 50 * len(knots)
    )


# -- dynamics ----------------------------------------------------------------------------------------------------------


def test_forces_are_those_of_the_free_tree_projected() -> None:
    mechanism, free = leg(), leg("")
    assert mechanism.velocities == ("hip", "knee")
    q, qd, qdd = random_states(mechanism, 6)
    *states, jacobian = all_states(q, qd, qdd)
    expected = np.einsum("sij,sip->sjp", jacobian, float_regressor(free, *states))
    np.testing.assert_allclose(
        float_regressor(mechanism, q, qd, qdd), expected, rtol=0, atol=1e-10
    )


def test_forces_are_those_of_pinocchio() -> None:
    """τ = Jᵀ ID(q(θ), q̇, q̈) with Pinocchio's inverse dynamics of the tree."""
    mechanism, free = (
        leg(c, text=LEG.replace(", massless: true", "")) for c in (COUPLED, "")
    )
    zeta = np.concatenate(
        [[0.2, 0.01, 0.02, 0.3, 0.03, 0.25, 0.1, -0.2, 0.15, 1.5 + k] for k in range(5)]
    )
    tree = Constrained(free, zeta)
    q, qd, qdd = random_states(mechanism, 4)
    *states, jacobian = all_states(q, qd, qdd)
    efforts = np.array(
        [pin.rnea(tree.model, tree.data, *state) for state in zip(*states, strict=True)]
    )
    expected = np.einsum("sij,si->sj", jacobian, efforts)
    found = float_regressor(mechanism, q, qd, qdd) @ zeta
    np.testing.assert_allclose(
        found, expected, rtol=0, atol=1e-10 * np.abs(expected).max()
    )


@pytest.mark.parametrize(
    ("base", "ball"),
    one_in(3, [("", True), ("", False), ("floating_base: true", False)]),
)
def test_functions_fit_together(base: str, ball: bool) -> None:
    """The mass matrix and the parts of the inverse dynamics, and its derivatives by an imaginary step."""
    if ball:
        mechanism = leg(
            COUPLED.replace(" - 0.4*hip", ""), base, "{type: spherical, name: hip}"
        )
    else:
        mechanism = leg(COUPLED, base)
    columns = range(len(mechanism.parameters))
    q, qd, qdd = random_states(mechanism, 2)
    zeta = np.random.default_rng(1).normal(size=len(columns))
    state = {"q": q, "qd": qd, "qdd": qdd, "parameters": zeta}

    def function(name: str, **changed: FloatArray) -> FloatArray:
        return evaluate(
            robot_function(name, mechanism, columns), mechanism, state | changed
        )

    efforts = function("inverse_dynamics")
    np.testing.assert_allclose(
        float_regressor(mechanism, q, qd, qdd) @ zeta, efforts, atol=1e-10
    )
    whole = (
        np.einsum("kij,kj->ki", function("mass_matrix"), qdd)
        + function("coriolis")
        + function("gravity")
    )
    np.testing.assert_allclose(whole, efforts, atol=1e-10)
    mass = function("mass_matrix")
    np.testing.assert_allclose(mass, np.swapaxes(mass, 1, 2), atol=1e-11)
    expected, h = [], 1e-6
    for name in ("q", "qd"):
        for k in range(state[name].shape[1]):
            steps = [
                state[name] + s * h * np.eye(state[name].shape[1])[k] for s in (1, -1)
            ]
            steps = [_unit(mechanism, s) if name == "q" else s for s in steps]
            ahead, back = (function("inverse_dynamics", **{name: s}) for s in steps)
            expected.append((ahead - back) / (2 * h))
    found = function("inverse_dynamics_derivatives")
    np.testing.assert_allclose(
        found, np.stack(expected, axis=2), atol=1e-6 * (1 + np.abs(found).max())
    )


def _unit(mechanism: Mechanism, q: FloatArray) -> FloatArray:
    q = q.copy()
    for motion in mechanism.motions:
        if len(motion.positions) > 1:
            first = mechanism.positions.index(motion.positions[0])
            q[:, first : first + 4] /= np.linalg.norm(
                q[:, first : first + 4], axis=1, keepdims=True
            )
    return q


def test_power_is_the_change_of_energy() -> None:
    """Along a path, kinetic and potential energy from the regressor's own energy change by τ·q̇."""
    from echelon.dynamics.evaluate import evaluate_floats
    from echelon.dynamics.linear_forms import energy_form

    mechanism = leg()
    form = energy_form(mechanism)
    q, qd, qdd = random_states(mechanism, 5)
    h = 1e-5
    ahead, back = (
        evaluate_floats(
            form, mechanism, q + t * qd + t * t / 2 * qdd, qd + t * qdd, qdd
        )[:, 0, 1:]
        for t in (h, -h)
    )
    power = np.einsum("sij,si->sj", float_regressor(mechanism, q, qd, qdd), qd)
    np.testing.assert_allclose(
        (ahead - back) / (2 * h), power, atol=1e-6 * np.abs(power).max()
    )


# -- base parameters ---------------------------------------------------------------------------------------------------


def svd_rank(mechanism: Mechanism) -> int:
    q, qd, qdd = random_states(mechanism, 400)
    rows = float_regressor(mechanism, q, qd, qdd).reshape(-1, len(mechanism.parameters))
    singular = np.linalg.svd(
        rows / np.maximum(np.abs(rows).max(axis=0), 1e-300), compute_uv=False
    )
    ratios = [b / a for a, b in pairwise(singular) if a > 1e-9 * singular[0]]
    cut = int(np.argmin(ratios))
    assert ratios[cut] < 1e-6
    return cut + 1


@pytest.mark.parametrize(
    "coupled",
    [
        COUPLED,
        COUPLED.replace("{spline: {of: knee, points: " + str(POINTS) + "}}", "knee^2"),
        "couplings: [slide: 0.1*knee^2 + l*knee, lift: 0.2*hip^3, tilt: 2*slide + knee]",
    ],
    ids=["spline", "polynomials", "chain with a symbol"],
)
def test_rank_is_that_of_singular_values(coupled: str) -> None:
    mechanism = leg(coupled)
    base = ec.base_parameters(mechanism)
    assert base.rank == svd_rank(mechanism)
    q, qd, qdd = random_states(mechanism, 4)
    found = base.regressor(q, qd, qdd) @ base.B_float()
    np.testing.assert_allclose(found, float_regressor(mechanism, q, qd, qdd), atol=1e-9)


def test_every_piece_counts() -> None:
    """A slide that moves beyond a knot only: its mass is seen there."""
    text = """
echelon: 1
gravity: none
couplings: [{s: {terms: {j: {coefficients: [], knots: [[KNOT, 1]]}}}}]
bodies:
  - {name: a, joint: {type: prismatic, name: j, axis: x}}
  - {name: b, parent: a, joint: {type: prismatic, name: s, axis: y}}
"""
    for knot in ("0", "1.5", "-2", "0.01"):
        mechanism = read_description(
            text.replace("KNOT", knot), "slides.yaml", ReadingOptions()
        )
        assert (
            ec.base_parameters(mechanism).rank == 2
        )  # M1 + M2 everywhere, M2 beyond the knot


def test_a_polynomial_of_degree_one_is_a_linear_coupling() -> None:
    line = "couplings: [slide: {spline: {of: knee, points: [[-1, -1], [0, 1], [2, 5]]}}, lift: knee, tilt: hip]"
    mechanism, same = (
        leg(line),
        leg("couplings: [slide: 2*knee + 1, lift: knee, tilt: hip]"),
    )
    assert mechanism.couplings == same.couplings
    assert mechanism.bodies == same.bodies


def test_squares_are_other_angles() -> None:
    """cos(q²) and cos(q) are independent: as many parameters as two independent links have, without gravity."""
    text = """
echelon: 1
gravity: none
couplings: [{b: a^2}]
bodies:
  - {name: one, joint: {type: revolute, name: a, axis: z}}
  - {name: two, parent: one, joint: {type: revolute, name: b, axis: z, origin: {xyz: [0.5, 0, 0]}}}
"""
    base = ec.base_parameters(read_description(text, "two.yaml", ReadingOptions()))
    assert base.rank == 4  # ZZ1 + l² M2, ZZ2, MX2, MY2


def test_descriptions_are_written_exactly() -> None:
    mechanism = leg()
    again = read_description(
        json.dumps(write_description(mechanism)), "again", ReadingOptions()
    )
    assert (again.couplings, again.bodies) == (mechanism.couplings, mechanism.bodies)


def test_coordinates_are_held_with_what_follows_them() -> None:
    mechanism = leg()
    part = lock_joints(leg(COUPLED.replace(" - 0.4*hip", "")), {"knee": 0.4})
    assert part.velocities == ("hip",)
    assert not part.couplings
    q = np.array([[0.3]])
    full = leg(COUPLED.replace(" - 0.4*hip", ""))
    expected = float_regressor(
        full, np.array([[0.3, 0.4]]), np.array([[0.7, 0]]), np.array([[-0.2, 0]])
    )[:, :1]
    np.testing.assert_allclose(
        float_regressor(part, q, [[0.7]], [[-0.2]]), expected, atol=1e-6
    )
    assert mechanism.couplings


REFUSED = {
    "circle": (
        "couplings: [slide: knee^2, knee: slide]",
        "circle: slide -> knee -> slide",
    ),
    "product": (
        "couplings: [slide: hip*knee]",
        "not a sum of polynomials in one coordinate each",
    ),
    "cosine": ("couplings: [slide: cos(knee)]", "not a sum of polynomials"),
    "pi": (
        "couplings: [slide: (knee - pi/2)^2]",
        "pi can occur in the constant part only",
    ),
    "degree": ("couplings: [slide: knee^40]", "powers 0 to 32"),
    "sum of two squared": (
        "couplings: [slide: hip + knee, tilt: slide^2]",
        "'slide' follows hip, knee",
    ),
    "one point": (
        "couplings: [slide: {spline: {of: knee, points: [[0, 1]]}}]",
        "two points or more",
    ),
    "same point": (
        "couplings: [slide: {spline: {of: knee, points: [[0, 1], [0, 2]]}}]",
        "an x of its own",
    ),
    "unknown": (
        "couplings: [slide: {spline: {of: kne, points: [[0, 1], [1, 2]]}}]",
        "no coordinate 'kne'.*knee",
    ),
    "spline of a spline": (
        "couplings: [slide: knee^2, lift: {spline: {of: slide, points: [[0, 1], [1, 2], [2, 0]]}}]",
        "a spline of a coordinate that itself depends on others",
    ),
    "loops": (
        "couplings: [slide: {spline: {of: knee, points: [[0, 0], [1, 1], [2, 3]]}}]\n"
        "loops: [{connects: [shank, patella], joint: spherical, at: {xyz: [0.1, 0, 0]}}]",
        "with loops, couplings must be polynomials",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refusals(case: str) -> None:
    text, message = REFUSED[case]
    with pytest.raises(ec.InputError, match=message) as caught:
        leg(text)
    assert "leg.yaml" in str(caught.value)


@examples(20)
@given(st.lists(fractions, min_size=1, max_size=4), st.integers(0, 1000))
def test_random_polynomials_against_the_free_tree(a: list[Fraction], seed: int) -> None:
    powers = " + ".join(f"({c})*knee^{k}" for k, c in enumerate(a, start=1))
    mechanism, free = (
        leg(f"couplings: [slide: '{powers}', lift: 0.5*knee, tilt: hip]"),
        leg(""),
    )
    q, qd, qdd = random_states(mechanism, 2, seed)
    f = Powers([0, *map(float, a)])
    hip, knee = q.T
    slope, bend = f.deriv()(knee), f.deriv(2)(knee)
    jacobian = np.array([[[1, 0], [0, d], [0, 0.5], [0, 1], [1, 0]] for d in slope])
    positions = np.column_stack([hip, f(knee), 0.5 * knee, knee, hip])
    moved = np.einsum("sij,sj->si", jacobian, qdd)
    moved[:, 1] += bend * qd[:, 1] ** 2
    every = float_regressor(
        free, positions, np.einsum("sij,sj->si", jacobian, qd), moved
    )
    expected = np.einsum("sij,sip->sjp", jacobian, every)
    found = float_regressor(mechanism, q, qd, qdd)
    np.testing.assert_allclose(
        found, expected, rtol=0, atol=1e-11 * (1 + np.abs(expected).max())
    )
