"""Physically consistent fits: that of a modelling language, stationary, as good as the truth."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from echelon.identification.physics.bounds import Bounds, Roles
from echelon.identification.physics.fit import physical_fit
from echelon.robot.inertia import (
    divergence,
    factor,
    from_pseudo_inertia,
    pseudo_inertia,
)
from echelon.shared.errors import InputError
from support.physical_robots import is_physical, model, observed, robot
from support.selection import examples


def cvxpy_fit(
    role: Roles, design: Any, target: Any, bodies: Any, weight: float
) -> tuple[float, Any]:
    """Loss and parameters of the fit, stated in the modelling language of cvxpy."""
    import cvxpy as cp

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


def test_fit_is_that_of_a_modelling_language() -> None:
    base, role = model("furuta")
    rng = np.random.default_rng(5)
    truth, prior = robot(role, rng), robot(role, rng)
    observation, weights = observed(base, truth, rng)
    triangle = observation.combined(weights)
    fit = physical_fit(base, triangle, prior=prior, prior_weight=3.0)
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
    for start, J, J0 in zip(
        role.starts,
        *(pseudo_inertia(role.blocks(z)) for z in (fit.standard, prior)),
        strict=True,
    ):
        basis = pseudo_inertia(np.eye(10))
        drawing = 10.0 * np.einsum(
            "kij,ji->k", basis, np.linalg.inv(J0) - np.linalg.inv(J)
        )
        whole = loss[start : start + 10] + drawing
        size = 10.0 * np.abs(
            np.einsum("kij,ji->k", np.abs(basis), np.abs(np.linalg.inv(J)))
        )
        assert (np.abs(whole) < 1e-3 * size).all()


seeds = st.integers(0, 2**32 - 1)


@examples(10)
@given(
    seeds,
    st.sampled_from(
        ["double_pendulum", "scara", "rx90", "puma560", "tx40", "cart_pole"]
    ),
)
def test_fit_without_prior_is_as_good_as_the_truth(seed: int, name: str) -> None:
    base, role = model(name)
    rng = np.random.default_rng(seed)
    truth = robot(role, rng)
    observation, weights = observed(base, truth, rng, samples=100)
    triangle = observation.combined(weights)
    fit = physical_fit(base, triangle)
    at_truth = (
        np.sum((triangle.R @ base.values(truth) - triangle.qty) ** 2)
        + triangle.residual**2
    )
    # the drawing towards plain shapes raises it by no more than the truth does on average
    drawn = base.rank * triangle.residual**2 / (triangle.rows - base.rank) + 0.1 * len(
        role.bodies
    )
    assert fit.unconstrained_misfit - 1e-9 <= fit.misfit <= at_truth + drawn
    assert is_physical(role.blocks(fit.standard)).all()
    assert (fit.standard[list(role.positive)] >= 0).all()
    assert min(fit.margins.values()) > 0
    assert np.allclose(fit.base, base.values(fit.standard))


def test_masses_that_data_hardly_see_stay_like_the_others() -> None:
    """A weak motion tells hardly anything of the links' masses, whose sums with moments alone count."""
    base, role = model("panda")
    rng = np.random.default_rng(3)
    truth = robot(role, rng)
    observation, weights = observed(base, truth, rng, samples=30)
    fit = physical_fit(base, observation.combined(weights))
    true, found = role.blocks(truth)[1:, 9], role.blocks(fit.standard)[1:, 9]
    assert fit.diagnostics["plain_weight"] == 1.0
    assert (found < 5 * true.max()).all()


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
    free = physical_fit(
        base,
        observation.combined(weights),
        bounds=Bounds(parameters={names[-1]: (-1, 1)}),
    )
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


def test_a_triangle_of_other_parameters_is_refused() -> None:
    base, role = model("scara")
    observation, _ = observed(
        base, robot(role, np.random.default_rng(1)), np.random.default_rng(1)
    )
    with pytest.raises(InputError, match="not the base parameters"):
        physical_fit(base, observation.select([0, 1]).combined())
    assert np.allclose(
        from_pseudo_inertia(pseudo_inertia(np.arange(10.0))), np.arange(10.0)
    )
