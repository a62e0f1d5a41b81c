"""Functions of robots against Pinocchio, with the inertias that files state."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import echelon as ec
from echelon.dynamics.functions import robot_function
from echelon.robot.mechanism import Mechanism
from support.float_functions import evaluate
from support.float_regressor import FloatArray, random_states, standard_vector
from support.robot_files import pinocchio_model, pinocchio_state, robot_file
from support.selection import slow_unless

CASES = [
    ("ur10_robot", False),
    ("panda", False),
    ("kinova", False),
    ("a1", True),
    ("romeo", True),
    ("tiago", False),
]
SAMPLES = 2


def loaded(name: str, floating: bool) -> tuple[Mechanism, object]:
    """Nothing is snapped, so both programs see the numbers of the file."""
    mechanism = ec.load(
        robot_file(name), floating=floating, snap_tolerance=0, independent_mimics=True
    )
    return mechanism, pinocchio_model(robot_file(name), floating)


def check(found: FloatArray, expected: FloatArray, tolerance: float = 1e-13) -> None:
    np.testing.assert_allclose(
        found, expected, rtol=0, atol=tolerance * np.abs(expected).max()
    )


@pytest.mark.parametrize(("name", "floating"), slow_unless(CASES[:4], CASES))
def test_inverse_dynamics_and_its_parts(name: str, floating: bool) -> None:
    mechanism, model = loaded(name, floating)
    data, columns = model.createData(), range(len(mechanism.parameters))  # type: ignore[attr-defined]
    q, qd, qdd = random_states(mechanism, SAMPLES)
    values = {"q": q, "qd": qd, "qdd": qdd, "parameters": standard_vector(mechanism)}
    names = ("inverse_dynamics", "gravity", "coriolis", "mass_matrix")
    found = {
        n: evaluate(robot_function(n, mechanism, columns), mechanism, values)
        for n in names
    }
    for k in range(SAMPLES):
        state = pinocchio_state(mechanism, model, q[k], qd[k], qdd[k])
        weight = state.to_ours(pin.computeGeneralizedGravity(model, data, state.q))
        check(found["gravity"][k], weight)
        check(
            found["inverse_dynamics"][k],
            state.to_ours(pin.rnea(model, data, state.q, state.v, state.a)),
        )
        constant = pinocchio_state(mechanism, model, q[k], qd[k], 0 * qdd[k])
        slowed = state.to_ours(
            pin.rnea(model, data, constant.q, constant.v, constant.a)
        )
        check(found["coriolis"][k], slowed - weight)
        pin.crba(model, data, state.q)
        mass = np.triu(data.M) + np.triu(data.M, 1).T
        check(found["mass_matrix"][k], state.map.T @ mass @ state.map)


@pytest.mark.parametrize(
    "name", slow_unless(["panda"], ["ur10_robot", "panda", "kinova", "tiago"])
)
def test_derivatives_of_inverse_dynamics(name: str) -> None:
    mechanism, model = loaded(name, False)
    data, columns = model.createData(), range(len(mechanism.parameters))  # type: ignore[attr-defined]
    q, qd, qdd = random_states(mechanism, SAMPLES)
    function = robot_function("inverse_dynamics_derivatives", mechanism, columns)
    values = {"q": q, "qd": qd, "qdd": qdd, "parameters": standard_vector(mechanism)}
    found = evaluate(function, mechanism, values)
    for k in range(SAMPLES):
        state = pinocchio_state(mechanism, model, q[k], qd[k], qdd[k])
        pin.computeRNEADerivatives(model, data, state.q, state.v, state.a)
        by_q, by_v = (
            state.map.T @ matrix @ state.map for matrix in (data.dtau_dq, data.dtau_dv)
        )
        check(found[k], np.hstack([by_q, by_v]), 1e-12)
