"""The regressor against Pinocchio's inverse dynamics and regressor, with the inertials that files state."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

import echelon as ec
from echelon.program.schedule import FloatArithmetic, Schedule
from echelon.regressor.energy import energy_form
from echelon.regressor.virtual_power import virtual_power_form
from oracles import float_regressor, random_states, standard_vector
from robots import pinocchio_model, pinocchio_state, robot_file

pin = pytest.importorskip("pinocchio", reason="Pinocchio is not installed")

ROBOTS = ("ur10_robot", "panda", "so100", "a1", "z1", "kinova", "romeo_small", "talos_reduced", "icub", "tiago_no_hand")


@pytest.mark.parametrize("floating", [False, True])
@pytest.mark.parametrize("name", ROBOTS)
def test_torques_equal_pinocchio(name: str, floating: bool) -> None:
    file = robot_file(name)
    # nothing is snapped, so both programs see the numbers of the file
    mechanism = ec.load(file, floating=floating, tolerance=0, independent_mimics=True)
    model = pinocchio_model(file, floating)
    data = model.createData()
    q, qd, qdd = random_states(mechanism, 4)
    torque = float_regressor(mechanism, q, qd, qdd) @ standard_vector(mechanism)
    for k in range(4):
        state = pinocchio_state(mechanism, model, q[k], qd[k], qdd[k])
        expected = state.to_ours(pin.rnea(model, data, state.q, state.v, state.a))
        np.testing.assert_allclose(torque[k], expected, rtol=0, atol=1e-11 * max(1.0, np.abs(expected).max()))


@pytest.mark.parametrize("name", ["ur10_robot", "a1", "icub"])
def test_virtual_power_is_a_combination_of_rows(name: str) -> None:
    mechanism = ec.load(robot_file(name), independent_mimics=True)
    states = random_states(mechanism, 3)
    u = np.random.default_rng(3).uniform(-1, 1, (3, len(mechanism.velocities)))
    rows = np.einsum("ko,kon->kn", u, float_regressor(mechanism, *states))
    power = evaluate(virtual_power_form(mechanism), mechanism, *states, u)
    np.testing.assert_allclose(power, rows, rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("name", ["ur10_robot", "a1", "tiago_no_hand"])
def test_power_is_the_rate_of_energy(name: str) -> None:
    """q̇ᵀ X ζ equals the time derivative of the energy form along a motion of single-axis joints."""
    mechanism = ec.load(robot_file(name), independent_mimics=True)
    q, qd, qdd = random_states(mechanism, 2)
    zeta = np.random.default_rng(5).uniform(-1, 1, len(mechanism.parameters))
    power = np.einsum("ko,kon,n->k", qd, float_regressor(mechanism, q, qd, qdd), zeta)
    form = energy_form(mechanism)

    def energy(t: float) -> npt.NDArray[np.float64]:
        moved = q + t * qd + t * t / 2 * qdd, qd + t * qdd, qdd
        return evaluate(form, mechanism, *moved, np.zeros_like(qd))[:, 1:] @ zeta

    step = 1e-3
    rate = (8 * (energy(step) - energy(-step)) - energy(2 * step) + energy(-2 * step)) / (12 * step)
    np.testing.assert_allclose(power, rate, rtol=1e-7, atol=1e-7)


def evaluate(form, mechanism, q, qd, qdd, u):  # type: ignore[no-untyped-def]
    """One-row forms in floats, shape (samples, columns)."""
    named = {f"q[{n}]": q[:, i] for i, n in enumerate(mechanism.positions)}
    for kind, values in (("qd", qd), ("qdd", qdd), ("u", u)):
        named |= {f"{kind}[{n}]": values[:, i] for i, n in enumerate(mechanism.velocities)}
    named |= {name: np.full(len(q), symbol.value) for name, symbol in mechanism.symbols.items()}
    schedule = Schedule(form.program, list(form.entries.values()))
    leaves = {node: named[form.program.inputs[node].name] for node in schedule.leaves}
    result = np.zeros((len(q), form.shape[1]))
    for (_, column), value in zip(form.entries, schedule.run(FloatArithmetic(), leaves, len(q)), strict=True):
        result[:, column] = value
    return result
