"""Dynamics from base parameters against Pinocchio's dynamics from the inertias in the files."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import echelon as ec
from echelon.base.model import BaseModel
from support.float_regressor import FloatArray, random_states, standard_vector
from support.robot_files import (
    PinocchioState,
    pinocchio_model,
    pinocchio_state,
    robot_file,
)
from support.selection import slow_unless

SAMPLES = 9
FIXED = ("ur10_robot", "panda", "xarm7", "z1")
ROBOTS = [(name, False) for name in FIXED] + [
    ("a1", True),
    ("ur10_robot", True),
    ("double_pendulum_continuous", True),
]


class Case:
    """A base model of a file as it is written, base parameters of its inertias, and states in both coordinates."""

    def __init__(self, name: str, floating: bool) -> None:
        file = robot_file(name)
        mechanism = ec.load(
            file, floating=floating, snap_tolerance=0, independent_mimics=True
        )
        self.base: BaseModel = ec.base_parameters(mechanism)
        self.values = self.base.B_float() @ standard_vector(mechanism)
        self.state = self.q, self.qd, self.qdd = random_states(mechanism, SAMPLES)
        self.model = pinocchio_model(file, floating)
        self.data = self.model.createData()

    def states(self, *, still: bool = False) -> list[PinocchioState]:
        """In Pinocchio's coordinates; ``still`` without our accelerations."""
        rows = zip(self.q, self.qd, 0 * self.qdd if still else self.qdd, strict=True)
        return [pinocchio_state(self.base.mechanism, self.model, *row) for row in rows]

    def forces(self, *, still: bool = False) -> FloatArray:
        return np.array(
            [
                s.to_ours(pin.rnea(self.model, self.data, s.q, s.v, s.a))
                for s in self.states(still=still)
            ]
        )

    def weights(self) -> FloatArray:
        return np.array(
            [
                s.to_ours(pin.computeGeneralizedGravity(self.model, self.data, s.q))
                for s in self.states()
            ]
        )


made = cache(Case)
LONG = ("panda", "xarm7", "a1")


@pytest.fixture(
    params=[
        pytest.param(pair, marks=[pytest.mark.slow] * (pair[0] in LONG))
        for pair in ROBOTS
    ],
    ids=lambda pair: pair[0] + (" floating" if pair[1] else ""),
)
def case(request: pytest.FixtureRequest) -> Case:
    return made(*request.param)


def check(found: FloatArray, expected: FloatArray, tolerance: float = 1e-13) -> None:
    np.testing.assert_allclose(
        found, expected, rtol=0, atol=tolerance * np.abs(expected).max()
    )


def test_inverse_dynamics(case: Case) -> None:
    expected = case.forces()
    check(case.base.predict(*case.state, case.values), expected)
    check(case.base.regressor(*case.state) @ case.values, expected)


def test_gravity(case: Case) -> None:
    check(case.base.gravity(case.q, case.values), case.weights())


def test_coriolis(case: Case) -> None:
    check(
        case.base.coriolis(case.q, case.qd, case.values),
        case.forces(still=True) - case.weights(),
    )


def test_mass_matrix(case: Case) -> None:
    expected = []
    for state in case.states():
        pin.crba(case.model, case.data, state.q)
        whole = np.triu(case.data.M) + np.triu(case.data.M, 1).T
        expected.append(state.map.T @ whole @ state.map)
    found = case.base.mass_matrix(case.q, case.values)
    check(found, np.array(expected))
    check(found, np.swapaxes(found, 1, 2))


def test_effects_of_a_plain_robot(case: Case) -> None:
    assert not case.base.effects(case.q, case.qd, case.values).any()


@pytest.mark.parametrize("name", slow_unless(lambda name: name not in LONG, FIXED))
def test_derivatives(name: str) -> None:
    case = made(name, False)
    found = case.base.inverse_dynamics_derivatives(*case.state, case.values)
    expected: list[Any] = []
    for s in case.states():
        pin.computeRNEADerivatives(case.model, case.data, s.q, s.v, s.a)
        expected.append(
            [s.map.T @ d @ s.map for d in (case.data.dtau_dq, case.data.dtau_dv)]
        )
    for ours, theirs in zip(found, np.swapaxes(expected, 0, 1), strict=True):
        check(ours, theirs, 1e-12)
