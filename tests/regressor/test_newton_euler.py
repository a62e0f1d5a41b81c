"""The regressor against Pinocchio's inverse dynamics and regressor, with the inertials that files state."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

import echelon as ec
from echelon.algebra.program.schedule import FloatArithmetic, Schedule
from echelon.dynamics.linear_forms import energy_form, virtual_power_form
from echelon.robot.joint import MotionKind
from echelon.robot.mechanism import Mechanism
from support.float_regressor import (
    FloatArray,
    float_regressor,
    random_states,
    standard_vector,
)
from support.random_mechanisms import mechanisms
from support.robot_files import pinocchio_model, pinocchio_state, robot_file
from support.selection import slow_unless

ROBOTS = (
    "ur10_robot",
    "panda",
    "so100",
    "a1",
    "z1",
    "kinova",
    "romeo",
    "talos_full_v2",
    "icub",
    "g1_29dof_rev_1_0",
)
# joints that are continuous or prismatic, beside kinova's and panda's
ROBOTS += ("baxter", "pr2", "tiago")


LARGE = {
    "romeo", "talos_full_v2", "icub", "pr2", "tiago", "baxter", "g1_29dof_rev_1_0",
}  # fmt: skip


@pytest.mark.parametrize("floating", [False, True])
@pytest.mark.parametrize("name", slow_unless(lambda name: name not in LARGE, ROBOTS))
def test_torques_equal_pinocchio(name: str, floating: bool) -> None:
    file = robot_file(name)
    # nothing is snapped, so both programs see the numbers of the file
    mechanism = ec.load(
        file, floating=floating, snap_tolerance=0, independent_mimics=True
    )
    model = pinocchio_model(file, floating)
    data = model.createData()
    q, qd, qdd = random_states(mechanism, 4)
    torque = float_regressor(mechanism, q, qd, qdd) @ standard_vector(mechanism)
    for k in range(4):
        state = pinocchio_state(mechanism, model, q[k], qd[k], qdd[k])
        expected = state.to_ours(pin.rnea(model, data, state.q, state.v, state.a))
        # reached over all files and 20 states each: 6e-15 of the largest torque
        np.testing.assert_allclose(
            torque[k], expected, rtol=0, atol=1e-13 * np.abs(expected).max()
        )


@pytest.mark.parametrize("name", ["ur10_robot", "a1", "icub"])
def test_virtual_power_is_a_combination_of_rows(name: str) -> None:
    mechanism = ec.load(robot_file(name), independent_mimics=True)
    states = random_states(mechanism, 3)
    u = np.random.default_rng(3).uniform(-1, 1, (3, len(mechanism.velocities)))
    rows = np.einsum("ko,kon->kn", u, float_regressor(mechanism, *states))
    power = evaluate(virtual_power_form(mechanism), mechanism, *states, u)
    np.testing.assert_allclose(power, rows, rtol=1e-11, atol=1e-11)


@given(mechanisms(), st.integers(0, 2**32))
def test_power_is_the_rate_of_energy(mechanism: Mechanism, seed: int) -> None:
    """q̇ᵀ X equals the time derivative of the energy form along any motion, column by column.

    The derivative is exact to rounding: the imaginary part of the energy at q + iε q̇, q̇ + iε q̈.
    """
    q, qd, qdd = random_states(mechanism, 2, seed)
    power = np.einsum("ko,kon->kn", qd, float_regressor(mechanism, q, qd, qdd))
    tiny = 1e-100j
    moved = q + tiny * position_rates(mechanism, q, qd), qd + tiny * qdd, qdd
    energy = evaluate(energy_form(mechanism), mechanism, *moved, qd)
    np.testing.assert_allclose(
        energy[:, 1:].imag / tiny.imag, power, rtol=1e-9, atol=1e-9
    )


def position_rates(mechanism: Mechanism, q: FloatArray, qd: FloatArray) -> FloatArray:
    """dq/dt: the velocities, and for a quaternion half its product with the angular velocity in body axes."""
    rates = np.zeros_like(q)
    position, velocity = mechanism.positions.index, mechanism.velocities.index
    for motion in mechanism.motions:
        if motion.kind is MotionKind.BALL:
            w, v = (
                q[:, [position(motion.positions[0])]],
                q[:, [position(n) for n in motion.positions[1:]]],
            )
            spin = qd[:, [velocity(n) for n in motion.velocities]]
            rates[:, position(motion.positions[0])] = -np.sum(v * spin, axis=1) / 2
            rates[:, [position(n) for n in motion.positions[1:]]] = (
                w * spin + np.cross(v, spin)
            ) / 2
        elif motion.name in mechanism.velocities:
            rates[:, position(motion.name)] = qd[:, velocity(motion.name)]
    return rates


class ComplexArithmetic(FloatArithmetic):
    """Complex numbers, for derivatives by an imaginary step."""

    dtype = np.complex128


def evaluate(form, mechanism, q, qd, qdd, u):  # type: ignore[no-untyped-def]
    """One-row forms in complex numbers, shape (samples, columns)."""
    named = {f"q[{n}]": q[:, i] for i, n in enumerate(mechanism.positions)}
    for kind, values in (("qd", qd), ("qdd", qdd), ("u", u)):
        named |= {
            f"{kind}[{n}]": values[:, i] for i, n in enumerate(mechanism.velocities)
        }
    named |= {
        name: np.full(len(q), symbol.value, dtype=complex)
        for name, symbol in mechanism.symbols.items()
    }
    schedule = Schedule(form.program, list(form.entries.values()))
    leaves = {
        node: named[form.program.inputs[node].name].astype(complex)
        for node in schedule.leaves
    }
    result = np.zeros((len(q), form.shape[1]), dtype=complex)
    for (_, column), value in zip(
        form.entries, schedule.run(ComplexArithmetic(), leaves, len(q)), strict=True
    ):
        result[:, column] = value
    return result
