"""Pseudo-inertias, bounds, physically consistent fits and lifts."""

from __future__ import annotations

from fractions import Fraction
from functools import cache
from typing import Any

import numpy as np
import pytest
import sympy
from hypothesis import given, settings
from hypothesis import strategies as st

import echelon as ec
from echelon.base.model import BaseModel
from echelon.errors import InputError
from echelon.identification.physics.bounds import Bounds
from echelon.identification.physics.constraints import Roles, roles
from echelon.identification.physics.fit import PLAIN_WEIGHT, physical_fit
from echelon.identification.physics.nearest import physical_lift
from echelon.identification.physics.pseudo_inertia import (
    divergence,
    dual_matrix,
    exact_pseudo_inertia,
    factor,
    is_physical,
    is_semidefinite,
    margins,
)
from echelon.identification.physics.reference import reference
from echelon.inertia.spatial import from_pseudo_inertia, move, pseudo_inertia
from physical import body_of_points, observed, robot

seeds = st.integers(0, 2**32 - 1)


@cache
def model(name: str) -> tuple[BaseModel, Roles]:
    base = ec.base_parameters(ec.load(f"examples/{name}.yaml"))
    return base, roles(base.mechanism)


# -- pseudo-inertias ---------------------------------------------------------------------------------------------------


@given(seeds)
def test_dual_matrix_is_the_adjoint_of_the_pseudo_inertia(seed: int) -> None:
    c, body = np.random.default_rng(seed).standard_normal((2, 10))
    assert np.isclose(np.trace(dual_matrix(c) @ pseudo_inertia(body)), c @ body)
    exact = [Fraction(x) for x in body]
    assert np.allclose(np.array(exact_pseudo_inertia(exact), dtype=float), pseudo_inertia(body))


@given(seeds)
def test_a_body_exists_if_its_central_moments_satisfy_the_triangle_inequality(seed: int) -> None:
    rng = np.random.default_rng(seed)
    moments = rng.uniform(0.1, 1.2, 3)
    mass, centre = rng.uniform(-0.2, 1), rng.standard_normal(3)
    axes = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    tensor = axes @ np.diag(moments) @ axes.T + mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    body = np.array([*tensor[np.triu_indices(3)], *(mass * centre), mass])
    assert is_physical(body) == (mass > 0 and 2 * moments.max() < moments.sum())


@given(seeds)
def test_divergence_does_not_depend_on_frames_and_units(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = body_of_points(rng), body_of_points(rng)
    frame = np.eye(4)
    frame[:3, :3] = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    frame[:3, 3] = rng.standard_normal(3)
    ratio = pseudo_inertia(a) @ np.linalg.inv(pseudo_inertia(b))
    expected = np.trace(ratio) - np.log(np.linalg.det(ratio)) - 4
    assert np.isclose(divergence(a, b), expected, rtol=1e-6)
    assert np.isclose(divergence(move(a, frame), move(b, frame)), expected, rtol=1e-6)
    grams = 1000.0 * np.array([1e6] * 6 + [1e3] * 3 + [1.0])
    assert np.isclose(divergence(a * grams, b * grams), expected, rtol=1e-6)
    assert divergence((a + b) / 2, b) <= expected / 2 + 1e-12
    assert divergence(-a, b) == np.inf
    assert np.isclose(margins(a, b), np.linalg.eigvals(ratio).real.min(), rtol=1e-5)


def test_bodies_that_do_not_exist_have_no_factor() -> None:
    for body in (np.zeros(10), -np.ones(10), [1, 0, 0, 1, 0, 3, 0, 0, 0, 1], [np.nan] * 10):
        with pytest.raises(InputError, match="not positive definite"):
            factor(body)


@given(st.lists(st.integers(-3, 3), min_size=9, max_size=9), st.booleans())
def test_exact_semidefiniteness_agrees_with_principal_minors(entries: list[int], square: bool) -> None:
    matrix = sympy.Matrix(3, 3, entries)
    matrix = matrix.T * matrix if square else matrix + matrix.T
    expected = all(
        matrix.extract(list(s), list(s)).det() >= 0 for s in ((0,), (1,), (2,), (0, 1), (0, 2), (1, 2), (0, 1, 2))
    )
    exact = [[Fraction(int(x)) for x in matrix.row(i)] for i in range(3)]
    assert is_semidefinite(exact) == expected
    assert is_semidefinite(exact, definite=True) == (expected and matrix.det() != 0)


# -- fits --------------------------------------------------------------------------------------------------------------


def cvxpy_fit(role: Roles, design: Any, target: Any, bodies: Any, weight: float) -> tuple[float, Any]:
    """The same problem written down in a modelling language."""
    cp = pytest.importorskip("cvxpy")
    zeta = cp.Variable(role.size)
    loss = cp.sum_squares(design @ zeta - target)
    basis = [pseudo_inertia(e) for e in np.eye(10)]
    for start, body in zip(role.starts, bodies, strict=True):
        root = np.linalg.inv(factor(body))
        K = sum(zeta[start + k] * (root @ basis[k] @ root.T) for k in range(10))
        loss += weight * (cp.trace(K) - cp.log_det(K) - 4)
    signs = [zeta[c] >= 0 for c in role.positive]
    problem = cp.Problem(cp.Minimize(loss), signs)
    problem.solve(solver="CLARABEL")
    return problem.value, zeta.value


@pytest.mark.parametrize("solver", ["CLARABEL", "SCS"])
def test_fit_is_that_of_a_modelling_language(solver: str) -> None:
    base, role = model("furuta")
    rng = np.random.default_rng(5)
    truth, prior = robot(role, rng), robot(role, rng)
    observation, weights = observed(base, truth, rng)
    triangle = observation.combined(weights)
    fit = physical_fit(base, triangle, prior=prior, prior_weight=3.0, solver=solver)
    design, target = triangle.R @ base.B_float(), triangle.qty
    value, standard = cvxpy_fit(role, design, target, role.blocks(prior), 3.0)
    mine = np.sum((design @ fit.standard - target) ** 2)
    mine += 3.0 * divergence(role.blocks(fit.standard), role.blocks(prior)).sum()
    assert np.isclose(mine, value, rtol=1e-4)
    assert divergence(role.blocks(fit.standard), role.blocks(standard)).max() < 1e-4


@pytest.mark.parametrize("name", ["panda", "floating_tree"])
def test_gradient_vanishes_at_the_fit(name: str) -> None:
    base, role = model(name)
    rng = np.random.default_rng(6)
    truth = robot(role, rng)
    prior = truth * rng.uniform(0.8, 1.2)
    observation, weights = observed(base, truth, rng)
    triangle = observation.combined(weights)
    fit = physical_fit(base, triangle, prior=prior, prior_weight=10.0)
    assert fit.diagnostics["active"] == []
    assert repr(fit).startswith(f"PhysicalFit({len(role.bodies)} bodies, misfit ")
    assert repr(fit).endswith("drawn to prior with weight 10)")
    loss = 2 * (triangle.R @ base.B_float()).T @ (triangle.R @ fit.base - triangle.qty)
    for start, J, J0 in zip(role.starts, *(pseudo_inertia(role.blocks(z)) for z in (fit.standard, prior)), strict=True):
        basis = pseudo_inertia(np.eye(10))
        drawing = 10.0 * np.einsum("kij,ji->k", basis, np.linalg.inv(J0) - np.linalg.inv(J))
        whole = loss[start : start + 10] + drawing
        size = 10.0 * np.abs(np.einsum("kij,ji->k", np.abs(basis), np.abs(np.linalg.inv(J))))
        assert (np.abs(whole) < 1e-3 * size).all()


@settings(max_examples=10, deadline=None)
@given(seeds, st.sampled_from(["double_pendulum", "scara", "rx90", "puma560", "tx40", "cart_pole"]))
def test_fit_without_prior_is_as_good_as_the_truth(seed: int, name: str) -> None:
    base, role = model(name)
    rng = np.random.default_rng(seed)
    truth = robot(role, rng)
    observation, weights = observed(base, truth, rng, samples=100)
    triangle = observation.combined(weights)
    fit = physical_fit(base, triangle)
    at_truth = np.sum((triangle.R @ base.values(truth) - triangle.qty) ** 2) + triangle.residual**2
    drawn = PLAIN_WEIGHT * 100 * len(role.bodies)
    assert fit.least_misfit - 1e-9 <= fit.misfit <= at_truth + drawn
    assert is_physical(role.blocks(fit.standard)).all()
    assert (fit.standard[list(role.positive)] >= 0).all()
    assert min(fit.margins.values()) > 0
    assert np.allclose(fit.base, base.values(fit.standard))


def test_friction_does_not_drive() -> None:
    base, role = model("tx40")
    rng = np.random.default_rng(7)
    truth = robot(role, rng)
    names = [base.parameters[c] for c in role.positive]
    assert names[0] == "Ia1"
    assert {n[:2] for n in names} == {"Ia", "Fv", "Fc"}
    fc = base.parameters.index(names[-1])
    truth[fc] = -0.5
    observation, weights = observed(base, truth, rng)
    fit = physical_fit(base, observation.combined(weights))
    assert fit.standard[fc] == pytest.approx(0, abs=1e-6)
    assert fit.standard[fc] >= 0
    assert names[-1] in fit.diagnostics["active"]
    free = physical_fit(base, observation.combined(weights), bounds=Bounds(parameters={names[-1]: (-1, 1)}))
    assert free.standard[fc] == pytest.approx(-0.5, rel=0.1)


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_light_and_heavy_links_are_no_harder(scale: float) -> None:
    base, role = model("panda")
    rng = np.random.default_rng(8)
    truth = robot(role, rng)
    truth[60:] *= 1e-4  # the last link is much lighter than the others
    truth *= scale
    observation, weights = observed(base, truth, rng)
    triangle = observation.combined(weights)
    for prior, tolerated in ((None, 60), (truth, 1)):
        fit = physical_fit(base, triangle, prior=prior)
        assert fit.diagnostics["step_inside"] < 1e-6
        assert fit.misfit - triangle.residual**2 < tolerated
        assert is_physical(role.blocks(fit.standard)).all()
    assert divergence(role.blocks(fit.standard), role.blocks(truth)).max() < 5


def test_more_weight_comes_nearer_to_the_prior_and_fits_worse() -> None:
    base, role = model("rx90")
    rng = np.random.default_rng(9)
    truth, prior = robot(role, rng), robot(role, rng)
    observation, weights = observed(base, truth, rng)
    triangle = observation.combined(weights)
    fits = [physical_fit(base, triangle, prior=prior, prior_weight=w) for w in (1e-2, 1.0, 1e2, 1e4, 1e8)]
    apart = [sum(fit.diagnostics["divergence"].values()) for fit in fits]
    assert apart == sorted(apart, reverse=True)
    assert [f.misfit for f in fits] == sorted(f.misfit for f in fits)
    assert apart[-1] < 1e-3


def test_the_weight_is_chosen_from_the_data() -> None:
    base, role = model("rx90")
    rng = np.random.default_rng(10)
    truth, other = robot(role, rng), robot(role, rng)
    pieces = [observed(base, truth, np.random.default_rng(k), samples=10) for k in range(4)]
    weights = pieces[0][1]
    whole = sum((p for p, _ in pieces[1:]), pieces[0][0]).combined(weights)
    for stretches in ([p for p, _ in pieces], []):
        chosen = [
            physical_fit(base, whole, prior=p, prior_weight="auto", pieces=stretches, weights=weights)
            for p in (truth, other)
        ]
        right, wrong = (fit.prior_weight for fit in chosen)
        assert right >= 1e3 > 10 * wrong
        plain = np.linalg.norm(physical_fit(base, whole).base - base.values(truth))
        assert np.linalg.norm(chosen[0].base - base.values(truth)) < 0.1 * plain
    with pytest.raises(InputError, match="prior_weight is 'car'"):
        physical_fit(base, whole, prior=truth, prior_weight="car")
    with pytest.raises(InputError, match=r"prior_weight is -1\.0"):
        physical_fit(base, whole, prior=truth, prior_weight=-1.0)


def test_effects_are_drawn_to_their_priors() -> None:
    base, role = model("tx40")
    rng = np.random.default_rng(11)
    truth = robot(role, rng)
    observation, weights = observed(base, truth, rng)
    prior = np.full(role.size, np.nan)
    column = role.positive[-1]
    prior[column] = 2 * truth[column]
    near = physical_fit(base, observation.combined(weights), prior=prior, prior_weight=1e9)
    assert near.standard[column] == pytest.approx(prior[column], rel=1e-3)


# -- priors that are no bodies -----------------------------------------------------------------------------------------


def test_priors_that_are_no_bodies_are_repaired() -> None:
    base, role = model("panda")
    rng = np.random.default_rng(12)
    truth = robot(role, rng)
    prior = truth.copy()
    prior[:10] = [0, 0, 0, 0, 0, 0, 0, 0, 0, 2.0]  # a point mass
    prior[10:20] = [1, 0, 0, 1, 0, 5, 0, 0, 0, 1.0]  # against the triangle inequality
    prior[20:30] = 0.0  # nothing
    prior[30:40] = np.nan
    prior[40:50] = [1, 0, 0, 1, 0, 1, 0, 0, 0, -3.0]
    found = reference(role, prior)
    assert list(found.informed) == [True, True, False, False, True, True, True]
    assert is_physical(found.bodies).all()
    assert np.array_equal(found.bodies[5], truth[50:60])
    assert [f.where for f in found.findings] == [f"body 'j{k}'" for k in (1, 2, 5)]
    observation, weights = observed(base, truth, rng)
    fit = physical_fit(base, observation.combined(weights), prior=prior)
    assert is_physical(role.blocks(fit.standard)).all()
    with pytest.raises(InputError, match="expected a prior of 70"):
        reference(role, prior[:-1])


# -- bounds ------------------------------------------------------------------------------------------------------------


def test_bounds_are_respected() -> None:
    base, role = model("puma560")
    rng = np.random.default_rng(13)
    truth = robot(role, rng)
    observation, weights = observed(base, truth, rng)
    names = [name for name, _ in role.bodies]
    given_bounds = {
        "bodies": {
            names[0]: {"mass": [2, 2]},
            names[1]: {"mass": [0.5, 0.6], "box": [[-0.1, -0.1, 0], [0.1, 0.1, 0]]},
            names[2]: {"ellipsoid": [[0.1, 0, 0], [0.05, 0.1, 0.02]], "mass": [0.3, None]},
            names[3]: {"symmetry": ["xz", "yz"]},
            names[4]: {"symmetry": "z"},
            names[5]: {"extent": [[0, 0, 0.05], [0.1, 0.1, 0.1]]},
        },
        "parameters": {"XX4": [0.5, None]},
        "total_mass": [4, 5],
        "margin": 1e-3,
    }
    bounds = Bounds.of(base.mechanism, given_bounds)
    fit = physical_fit(base, observation.combined(weights), bounds=bounds)
    bodies = role.blocks(fit.standard)
    mass, centre = bodies[:, 9], bodies[:, 6:9] / bodies[:, 9:]
    assert mass[0] == pytest.approx(2)
    assert 0.5 - 1e-9 <= mass[1] <= 0.6 + 1e-9
    assert (np.abs(centre[1]) <= np.array([0.1, 0.1, 1e-12]) + 1e-9).all()
    assert np.linalg.norm((centre[2] - [0.1, 0, 0]) / [0.05, 0.1, 0.02]) <= 1 + 1e-9
    assert np.allclose(bodies[3][[1, 2, 4, 6, 7]], 0, atol=1e-12)
    assert bodies[3, 0] >= 0.5 - 1e-9
    assert np.allclose(bodies[4][[1, 2, 4, 6, 7]], 0, atol=1e-12)
    assert bodies[4, 0] == pytest.approx(bodies[4, 3])
    inside = np.diag([-100.0, -100.0, -100.0, 1 - 0.25])
    inside[2, 3] = inside[3, 2] = 100 * 0.05
    assert np.trace(inside @ pseudo_inertia(bodies[5])) >= -1e-9
    assert 4 - 1e-9 <= mass.sum() <= 5 + 1e-9
    assert min(fit.margins.values()) >= 1e-3 * (1 - 1e-6)
    assert fit.misfit > fit.least_misfit
    loose = physical_fit(base, observation.combined(weights))
    assert loose.misfit < fit.misfit


def test_bounds_that_contradict_each_other() -> None:
    base, role = model("scara")
    rng = np.random.default_rng(14)
    observation, weights = observed(base, robot(role, rng), rng)
    names = [name for name, _ in role.bodies]
    for given_bounds in (
        {"bodies": {n: {"mass": [2, 3]} for n in names}, "total_mass": [0, 5]},
        {"bodies": {names[0]: {"box": [[0, 0, 0], [0, 0, 1]], "mass": [1, 1]}}, "parameters": {"ZZ1": [-2, -1]}},
    ):
        with pytest.raises(InputError, match="contradict"):
            physical_fit(base, observation.combined(weights), bounds=Bounds.of(base.mechanism, given_bounds))


@pytest.mark.parametrize(
    ("given_bounds", "message"),
    [
        ({"bodies": {"joint_1": {}}}, "no such body"),
        ({"bodies": {"j11": {}}}, "did you mean 'j1'"),
        ({"parameters": {"XX": [0, 1]}}, "did you mean 'XX"),
        ({"body": {}}, "did you mean 'bodies'"),
        ({"bodies": {"j1": {"mas": 1}}}, "did you mean 'mass'"),
        ({"bodies": {"j1": 3}}, "expected a mapping"),
        ({"bodies": {"j1": {"mass": [3, 2]}}}, "nothing is between"),
        ({"bodies": {"j1": {"mass": "heavy"}}}, "expected two numbers"),
        ({"bodies": {"j1": {"mass": [-2, -1]}}}, "nothing is between"),
        ({"bodies": {"j1": {"box": [[0, 0], [1, 1]]}}}, "two times three"),
        ({"bodies": {"j1": {"box": [[1, 0, 0], [0, 1, 1]]}}}, "first corner"),
        ({"bodies": {"j1": {"ellipsoid": [[0, 0, 0], [1, 0, 1]]}}}, "semi-axes"),
        ({"bodies": {"j1": {"symmetry": "w"}}}, "unknown symmetry"),
        ({"total_mass": [1]}, "total_mass"),
        ({"margin": 2}, "margin"),
        ({"parameters": {"M1": [True, 2]}}, "expected two numbers"),
    ],
)
def test_wrong_bounds_are_explained(given_bounds: dict[str, Any], message: str) -> None:
    base, _ = model("panda")
    with pytest.raises(InputError, match=message) as error:
        Bounds.of(base.mechanism, given_bounds, "setup.yaml")
    assert str(error.value).startswith("setup.yaml")


# -- lifts, and set-ups of all kinds -----------------------------------------------------------------------------------

SETUPS = {
    "rotor": """
modified_dh:
  - {joint: revolute}
  - {joint: revolute, alpha: pi/2, a: 3/10}
rotors: [{name: rotor2, on: j1, drives: 100*j2, axis: z, frame: {xyz: [1/10, 0, 0]}}]
effects: [{type: spring, at: j1}, {type: asymmetric_coulomb, at: all}, {type: stribeck, at: j2, velocity: 1/10}]
""",
    "wrist": """
modified_dh:
  - {joint: revolute}
  - {joint: revolute, alpha: pi/2, a: 3/10}
  - {joint: revolute, alpha: pi/4, a: 1/10}
outputs: [{wrench: j3}, {joint: j2}]
""",
}


def described(tmp_path: Any, name: str) -> BaseModel:
    file = tmp_path / f"{name}.yaml"
    file.write_text(f"echelon: 1\nname: {name}\n{SETUPS[name]}")
    return ec.base_parameters(ec.load(file))


@pytest.mark.parametrize("name", [*SETUPS, "floating_tree", "gripper_coupled", "loops/four_bar", "tx40", "ur10"])
def test_lift_has_exactly_the_given_values(tmp_path: Any, name: str) -> None:
    base = described(tmp_path, name) if name in SETUPS else model(name)[0]
    role = roles(base.mechanism)
    rng = np.random.default_rng(15)
    truth = robot(role, rng)
    values = base.values(truth)
    for prior in (None, robot(role, rng)):
        standard = physical_lift(base, values, prior=prior)
        assert np.allclose(base.values(standard), values, rtol=1e-12, atol=1e-12)
        assert is_physical(role.blocks(standard)).all()
        assert (standard[list(role.positive)] >= 0).all()
    assert divergence(role.blocks(physical_lift(base, values, prior=truth)), role.blocks(truth)).max() < 1e-5


def test_lift_refuses_what_no_robot_has() -> None:
    base, role = model("panda")
    values = base.values(robot(role, np.random.default_rng(16)))
    place = base.pivots.index("ZZ7")
    with pytest.raises(InputError, match=r"differs most in \[ZZ7\]"):
        physical_lift(base, np.where(np.arange(43) == place, -10 * values, values))
    with pytest.raises(InputError, match="expected 43"):
        physical_lift(base, values[:-1])
    with pytest.raises(InputError, match="finite"):
        physical_lift(base, np.where(np.arange(43) == place, np.nan, values))
    with pytest.raises(InputError, match="within the bounds"):
        physical_lift(base, values, bounds=Bounds(parameters={"M7": (50.0, 60.0)}))


def test_rotors_and_springs_have_signs(tmp_path: Any) -> None:
    base = described(tmp_path, "rotor")
    role = roles(base.mechanism)
    positive = [base.parameters[c] for c in role.positive]
    assert len(positive) == 6, positive
    assert {base.parameters[c][:2] for c in role.free} == {"Ps", "Fs"}


def test_a_triangle_of_other_parameters_is_refused() -> None:
    base, role = model("scara")
    observation, _ = observed(base, robot(role, np.random.default_rng(1)), np.random.default_rng(1))
    with pytest.raises(InputError, match="not the base parameters"):
        physical_fit(base, observation.select([0, 1]).combined())
    assert np.allclose(from_pseudo_inertia(pseudo_inertia(np.arange(10.0))), np.arange(10.0))
