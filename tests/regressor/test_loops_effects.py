"""Friction, springs and gains in mechanisms with loops: exact ranks, and numeric ones."""

from __future__ import annotations

import numpy as np
import pytest

import echelon as ec
from support.closed_states import read, states

FRICTION = """
name: four bar with friction
symbols: {l1: 0.4, l2: 0.15, l3: 0.35, l4: 0.3}
gravity: [0, -9.81, 0]
modified_dh:
  - {name: crank, joint: revolute}
  - {name: coupler, joint: revolute, a: l2}
  - {name: rocker, joint: revolute, parent: base, a: l1}
loops:
  - {name: pin, joint: revolute, connects: [coupler, rocker], at: {xyz: [l3, 0, 0]}, on_second: {xyz: [l4, 0, 0]}}
assembly: {crank: 1.0, coupler: -0.4, rocker: 1.6}
effects:
"""


@pytest.mark.parametrize(
    ("effects", "rank"),
    [
        pytest.param(
            "[{type: viscous, at: all, side: joint}, {type: coulomb, at: all, side: joint}]",
            8 + 6,
            marks=pytest.mark.slow,
        ),
        pytest.param(
            "[{type: viscous, at: all, side: joint}, {type: coulomb, at: all}]",
            8 + 4,
            marks=pytest.mark.slow,
        ),
        (
            "[{type: asymmetric_coulomb, at: all}, {type: rotor_inertia, at: all}, {type: drive_gain, at: all}]",
            8 + 3,
        ),
        pytest.param(
            "[{type: stribeck, velocity: 0.05, at: all, side: joint}]",
            8 + 3,
            marks=pytest.mark.slow,
        ),
        pytest.param(
            "[{type: stribeck, velocity: 0.05, exponent: 1, at: all, side: joint}]",
            8 + 3,
            marks=pytest.mark.slow,
        ),
        pytest.param(
            "[{type: spring, at: [coupler, rocker], side: joint}]",
            8 + 4,
            marks=pytest.mark.slow,
        ),
        # what primes know no relations of is compared in balls
        pytest.param(
            "[{parameter: Fz, unit: N·m, acts: [{at: rocker, term: 'sign(qd)*sqrt(abs(qd))', side: joint}]}]",
            8 + 1,
            marks=pytest.mark.slow,
        ),
        pytest.param(
            "[{parameter: Fz, unit: N·m, acts: [{at: coupler, term: 'atan(5*qd)', side: joint}]}]",
            8 + 1,
            marks=pytest.mark.slow,
        ),
    ],
)
def test_friction_and_springs_in_loops(effects: str, rank: int) -> None:
    mechanism = read(FRICTION + "  " + effects)
    base = ec.base_parameters(mechanism)
    assert base.rank == rank
    inputs = (
        {"crank": np.random.default_rng(1).uniform(-1, 1, 200)}
        if "gain" in effects
        else None
    )
    table = base.standard_regressor(*states(mechanism, 200), inputs=inputs)[:, 0]
    table = table / np.abs(table).max(axis=0).clip(1e-9)
    assert np.linalg.matrix_rank(table, tol=1e-9 * np.linalg.norm(table, 2)) == rank


def test_exponentials_that_loops_tie_together_are_compared_in_balls() -> None:
    """Bars that stay parallel turn equally fast, so their Stribeck friction adds up."""
    text = (
        FRICTION.replace("l3: 0.35, l4: 0.3", "l3: 0.4, l4: 0.15")
        .replace("[l3,", "[l1,")
        .replace("[l4,", "[l2,")
    )
    text = text.replace("coupler: -0.4, rocker: 1.6", "coupler: -1.0, rocker: 1.0")
    effects = "  [{type: stribeck, velocity: 0.05, at: all, side: joint}]"
    base = ec.base_parameters(read(text + effects))
    assert base.certificate.in_balls
    assert sorted(str(base.expressions[-1]).split(" + ")) == ["Fs1", "Fs2", "Fs3"]
