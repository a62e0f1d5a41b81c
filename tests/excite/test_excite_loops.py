"""Regressors of mechanisms with loops as functions of the independent coordinates, which decide everything.

Derivatives are compared with differences of fourth order, states and regressors with those that the library finds in
another way (interpreted, with singular values).
"""

from __future__ import annotations

import numpy as np
import pytest

from echelon.excite.problem.closed_loops import LoopMotion
from echelon.program.tape import Program
from echelon.regressor.loops.assembly import Assembly
from echelon.regressor.loops.dependent_motion import DependentMotion
from support.closed_motion import completed
from support.excitation_cases import slopes_by_state
from support.excitation_loops import (
    CASES,
    DERIVED,
    MECHANISMS,
    REDUNDANT,
    Floats,
    assert_slopes,
    base,
    full,
    mechanism,
    regressor,
    states,
)
from support.selection import slow_unless


@pytest.mark.parametrize("name", CASES)
def test_states_are_those_of_the_assembly(name: str) -> None:
    motion, reference = LoopMotion(mechanism(name)), Assembly(mechanism(name))
    state = states(motion)
    closed = motion.at(*state.values())
    assert closed.done.all()
    for mine, other in zip((closed.q, closed.qd, closed.qdd), completed(reference, *state.values()), strict=True):
        np.testing.assert_allclose(mine, other, atol=1e-8 * max(np.abs(other).max(), 1.0))


@pytest.mark.parametrize("name", slow_unless(lambda name: name != "three_rps", DERIVED))
def test_entries_are_those_of_the_base_model(name: str) -> None:
    made = regressor(name)
    state = states(made.motion)
    expected = base(name).regressor(*state.values())
    X = full(made.entries(state), made, base(name).rank)
    np.testing.assert_allclose(X, expected, atol=1e-9 * np.abs(expected).max())
    assert made.size == sum(rows.entries.stop - rows.entries.start for rows in made.rows)


def test_redundant_equations_are_among_the_cases() -> None:
    for name in MECHANISMS:
        motion = DependentMotion(mechanism(name), Program())
        assert (len(motion.row_units) > len(motion.dependent)) == (name in REDUNDANT), name


@pytest.mark.parametrize("name", slow_unless(lambda name: name != "three_rps", DERIVED))
def test_pulled_derivatives_are_those_of_differences(name: str) -> None:
    made = regressor(name, 0.02)
    state = states(made.motion)
    adjoint = np.random.default_rng(6).normal(size=(len(state["q"]), made.size))

    def total(q: Floats, qd: Floats, qdd: Floats) -> Floats:
        return np.sum(adjoint * made.entries({"q": q, "qd": qd, "qdd": qdd}), axis=1)

    found = dict(zip(state, made.pulled(state, adjoint), strict=True))
    for kind, step in (("q", 1e-4), ("qd", 1e-2), ("qdd", 1e-2)):
        expected = slopes_by_state(total, state, kind, step)
        assert_slopes(found[kind], expected, 1e-3)
