"""How strongly fits are drawn to a prior, and priors that are no bodies."""

from __future__ import annotations

import numpy as np
import pytest

from echelon.identification.physics.fit import CANDIDATES, by_stretches, physical_fit
from echelon.identification.physics.prior_information import reference
from echelon.shared.errors import InputError
from support.physical_robots import is_physical, model, observed, robot


def test_more_weight_comes_nearer_to_the_prior_and_fits_worse() -> None:
    base, role = model("rx90")
    rng = np.random.default_rng(9)
    truth, prior = robot(role, rng), robot(role, rng)
    observation, weights = observed(base, truth, rng)
    triangle = observation.combined(weights)
    fits = [
        physical_fit(base, triangle, prior=prior, prior_weight=w)
        for w in (1e-2, 1.0, 1e2, 1e4, 1e8)
    ]
    apart = [sum(fit.diagnostics["divergence"].values()) for fit in fits]
    assert apart == sorted(apart, reverse=True)
    assert [f.misfit for f in fits] == sorted(f.misfit for f in fits)
    assert apart[-1] < 1e-3


def test_the_weight_is_chosen_from_the_data() -> None:
    base, role = model("rx90")
    rng = np.random.default_rng(10)
    truth, other = robot(role, rng), robot(role, rng)
    pieces = [
        observed(base, truth, np.random.default_rng(k), samples=10) for k in range(4)
    ]
    weights = pieces[0][1]
    whole = sum((p for p, _ in pieces[1:]), pieces[0][0]).combined(weights)
    for stretches in ([p for p, _ in pieces], []):
        chosen = [
            physical_fit(
                base,
                whole,
                prior=p,
                prior_weight="auto",
                pieces=stretches,
                weights=weights,
            )
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


def test_of_weights_that_predict_alike_the_largest_is_taken() -> None:
    base, role = model("rx90")
    truth = robot(role, np.random.default_rng(10))
    pieces = [
        observed(base, truth, np.random.default_rng(k), samples=10)[0] for k in range(3)
    ]
    values = base.values(truth)
    assert by_stretches(lambda *_: values, pieces, None).weight == CANDIDATES[-1]


def test_effects_are_drawn_to_their_priors() -> None:
    base, role = model("tx40")
    rng = np.random.default_rng(11)
    truth = robot(role, rng)
    observation, weights = observed(base, truth, rng)
    prior = np.full(role.size, np.nan)
    column = role.positive[-1]
    prior[column] = 2 * truth[column]
    near = physical_fit(
        base, observation.combined(weights), prior=prior, prior_weight=1e9
    )
    assert near.standard[column] == pytest.approx(prior[column], rel=1e-3)


def test_friction_that_data_contradict_is_not_drawn_to() -> None:
    """Files state a damping of a thousandth for the sake of a simulation."""
    base, role = model("tx40")
    rng = np.random.default_rng(11)
    truth = robot(role, rng)
    observation, weights = observed(base, truth, rng)
    prior = truth.copy()
    prior[list(role.positive)] *= 1e-3
    fit = physical_fit(
        base, observation.combined(weights), prior=prior, prior_weight=1.0
    )
    assert fit.misfit < fit.unconstrained_misfit + 3 * base.rank


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
