"""Functions for controllers: against Pinocchio, and by what they have to do with each other."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import echelon as ec
from echelon.algebra.program.function import Function
from echelon.dynamics.functions import robot_function
from echelon.loops.closed_motion import position_rates
from echelon.robot.closure import ClosureKind
from echelon.robot.effect import Action, Effect, Side
from echelon.robot.mechanism import Mechanism
from echelon.shared.errors import InputError
from support import linkages
from support.described_robots import EVERYTHING, sensed
from support.float_functions import ComplexArithmetic, evaluate, normalised
from support.float_regressor import FloatArray, random_states, standard_vector
from support.loop_states import closed_states, independent_columns, random_parameters
from support.paths import EXAMPLES
from support.random_mechanisms import mechanisms
from support.robot_files import (
    PinocchioState,
    pinocchio_model,
    pinocchio_state,
    robot_file,
)
from support.selection import examples, one_in
from support.small_kernels import by_numpy

ROBOTS = [
    ("ur10_robot", False),
    ("a1", True),
    ("panda", False),
    ("ur10_robot", True),
    ("tiago", False),
]
SAMPLES = 2
MOST_CONDITION = 1e4
"""Condition of mass matrices of random parameters up to which accelerations have eight digits."""


def close(found: FloatArray, expected: FloatArray, tolerance: float = 1e-12) -> None:
    size = max(np.abs(expected).max(initial=0), 1e-3)
    np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance * size)


class Case:
    """A robot of a file, with its inertias, at random states and references; and the same in Pinocchio."""

    def __init__(self, name: str, floating: bool) -> None:
        file = robot_file(name)
        self.mechanism = ec.load(
            file, floating=floating, snap_tolerance=0, independent_mimics=True
        )
        self.model = pinocchio_model(file, floating)
        self.data = self.model.createData()
        self.floating = floating
        q, qd, qdd = random_states(self.mechanism, SAMPLES)
        _, qdr, qddr = random_states(self.mechanism, SAMPLES, 2)
        self.state = {"q": q, "qd": qd, "qdd": qdd, "qdr": qdr, "qddr": qddr}
        self.state["parameters"] = standard_vector(self.mechanism)

    def __call__(self, name: str, **changed: FloatArray) -> FloatArray:
        function = recorded(name, self.mechanism)
        return evaluate(function, self.mechanism, self.state | changed)

    def sample(self, k: int) -> PinocchioState:
        """One sample of the state in Pinocchio's coordinates."""
        row = [self.state[name][k] for name in ("q", "qd", "qdd")]
        return pinocchio_state(self.mechanism, self.model, *row)

    def mass(self, k: int) -> FloatArray:
        state = self.sample(k)
        pin.crba(self.model, self.data, state.q)
        whole = np.triu(self.data.M) + np.triu(self.data.M, 1).T
        return state.map.T @ whole @ state.map

    def coriolis_matrix(self, k: int) -> FloatArray:
        """Pinocchio's C, which has Christoffel's symbols, in our velocities v = map · q̇."""
        state = self.sample(k)
        pin.crba(self.model, self.data, state.q)
        whole = np.triu(self.data.M) + np.triu(self.data.M, 1).T
        turned = np.zeros_like(state.map)
        if self.floating:
            # the map turns linear velocities into the base's axes, Rᵀ, whose rate is − ω × Rᵀ
            turned[:3] = -np.cross(state.v[3:6], state.map[:3].T).T
        C = pin.computeCoriolisMatrix(self.model, self.data, state.q, state.v)
        return state.map.T @ (C @ state.map + whole @ turned)


@cache
def recorded(name: str, mechanism: Mechanism) -> Function:
    return robot_function(name, mechanism, range(len(mechanism.parameters)))


made = cache(Case)


@pytest.fixture(
    params=[
        pytest.param(r, marks=[pytest.mark.slow] * (k > 1), id=str(r))
        for k, r in enumerate(ROBOTS)
    ]
)
def case(request: pytest.FixtureRequest) -> Case:
    return made(*request.param)


def test_forces_of_slotine_and_li(case: Case) -> None:
    found, state = case("slotine_li"), case.state
    close(case("slotine_li_regressor") @ state["parameters"], found)
    matrices = case("coriolis_matrix")
    for k in range(SAMPLES):
        C, at = case.coriolis_matrix(k), case.sample(k)
        weight = at.to_ours(pin.computeGeneralizedGravity(case.model, case.data, at.q))
        close(matrices[k], C)
        reference = case.mass(k) @ state["qddr"][k] + C @ state["qdr"][k]
        close(found[k], reference + weight)


def test_momentum_and_energies(case: Case) -> None:
    state, zeta = case.state, case.state["parameters"]
    momentum, kinetic = case("momentum"), case("kinetic_energy")[:, 0]
    potential = case("potential_energy")[:, 0]
    heights = []
    for k in range(SAMPLES):
        at = case.sample(k)
        close(momentum[k], case.mass(k) @ state["qd"][k])
        energy = pin.computeKineticEnergy(case.model, case.data, at.q, at.v)
        assert kinetic[k] == pytest.approx(energy, rel=1e-12)
        heights.append(pin.computePotentialEnergy(case.model, case.data, at.q))
    close(np.diff(potential), np.diff(heights), 1e-11)
    for name in ("momentum", "momentum_bias", "kinetic_energy", "potential_energy"):
        close(case(f"{name}_regressor") @ zeta, case(name))


def test_forward_dynamics(case: Case) -> None:
    y = case("inverse_dynamics")
    close(case("forward_dynamics", y=y), case.state["qdd"], 1e-10)
    if case.floating:
        return
    slopes = case("forward_dynamics_derivatives", y=y)
    for k in range(SAMPLES):
        at = case.sample(k)
        turn = at.map.T
        torque = np.linalg.solve(turn, y[k])
        close(
            case.state["qdd"][k],
            turn @ pin.aba(case.model, case.data, at.q, at.v, torque),
            1e-10,
        )
        pin.computeABADerivatives(case.model, case.data, at.q, at.v, torque)
        data = case.data
        mass = np.triu(data.Minv) + np.triu(data.Minv, 1).T
        expected = [turn @ d @ turn.T for d in (data.ddq_dq, data.ddq_dv, mass)]
        close(slopes[k], np.hstack(expected), 1e-10)


# -- Christoffel's symbols ---------------------------------------------------------------------------------------------


def check_passivity(
    mechanism: Mechanism, state: dict[str, FloatArray], velocities: FloatArray
) -> None:
    """Ṁ = C + Cᵀ, and references that are the motion need the forces of inverse dynamics."""

    def found(name: str, **changed: FloatArray) -> FloatArray:
        return evaluate(recorded(name, mechanism), mechanism, state | changed)

    C, tiny = found("coriolis_matrix"), 1e-100j
    rates = position_rates(mechanism, state["q"], velocities)
    moved = state | {"q": state["q"] + tiny * rates}
    mass = recorded("mass_matrix", mechanism)
    changed = evaluate(mass, mechanism, moved, ComplexArithmetic()).imag / tiny.imag
    close(C + C.swapaxes(1, 2), changed, 1e-9)
    same = {"qdr": state["qd"], "qddr": state["qdd"]}
    close(found("slotine_li", **same), found("inverse_dynamics"), 1e-9)
    close(found("slotine_li_regressor") @ state["parameters"], found("slotine_li"))


def with_rotors(mechanism: Mechanism) -> Mechanism:
    """With inertia and friction on all coordinates that a term can use."""
    names = [
        name
        for motion in mechanism.motions
        if len(motion.positions) == 1
        for name in motion.velocities
    ]
    terms = {"Ia": ("kg·m²", "qdd"), "Fv": ("N·m·s", "qd + qd**3")}
    effects = [
        Effect(f"{kind}{k}", unit, (Action(name, Side.JOINT, term),))
        for k, name in enumerate(names, 1)
        for kind, (unit, term) in terms.items()
    ]
    return replace(mechanism, effects=tuple(effects))


@examples(10)
@given(mechanisms(most=3), st.integers(0, 2**32))
def test_skew_symmetry(mechanism: Mechanism, seed: int) -> None:
    mechanism = with_rotors(mechanism)
    q, qd, qdd = random_states(mechanism, SAMPLES, seed)
    _, qdr, qddr = random_states(mechanism, SAMPLES, seed + 1)
    state = {"q": q, "qd": qd, "qdd": qdd, "qdr": qdr, "qddr": qddr}
    zeta = np.random.default_rng(seed).normal(size=len(mechanism.parameters))
    check_passivity(mechanism, state | {"parameters": zeta}, qd)


LOOPS = [
    *(linkages.closed_chain(k, n % 3 == 1, False) for n, k in enumerate(ClosureKind)),
    linkages.slider_crank(),
    linkages.rssr(),
]
CASES_OF_LOOPS = [pytest.param(m, id=m.name) for m in LOOPS]


@pytest.mark.parametrize("mechanism", one_in(3, CASES_OF_LOOPS))
def test_skew_symmetry_in_loops(mechanism: Mechanism) -> None:
    mechanism = with_rotors(mechanism)
    q, qd, qdd = closed_states(mechanism, SAMPLES)
    free = independent_columns(mechanism)
    state = {"q": q, "qd": qd[:, free], "qdd": qdd[:, free]}
    rng = np.random.default_rng(3)
    state["qdr"], state["qddr"] = rng.normal(size=(2, SAMPLES, len(free)))
    state["parameters"] = random_parameters(mechanism)
    check_passivity(mechanism, state, qd)


# -- momentum, power and accelerations ---------------------------------------------------------------------------------


def check_motion(
    mechanism: Mechanism, state: dict[str, FloatArray], qd: FloatArray
) -> None:
    """Momentum, energies and accelerations beside inverse dynamics; ``qd`` are velocities of all coordinates."""
    tiny = 1e-100j
    later = {
        "q": state["q"] + tiny * position_rates(mechanism, state["q"], qd),
        "qd": state["qd"] + tiny * state["qdd"],
    }

    def found(name: str, **changed: FloatArray) -> FloatArray:
        return evaluate(recorded(name, mechanism), mechanism, state | changed)

    def rate(name: str) -> FloatArray:
        """Rate of a function along the motion."""
        function = recorded(name, mechanism)
        value = evaluate(function, mechanism, state | later, ComplexArithmetic())
        return value.imag / tiny.imag

    y = found("inverse_dynamics")
    close(rate("momentum") + found("momentum_bias"), y, 1e-9)
    velocities = state["qd"][:, None]
    moments = found("momentum")[:, :, None]
    close(found("kinetic_energy"), (velocities @ moments)[:, 0] / 2, 1e-10)
    slowed = [k for k, e in enumerate(mechanism.parameters) if e.startswith("Fv")]
    lost = np.zeros_like(state["parameters"])
    lost[slowed] = state["parameters"][slowed]
    friction = found("effects", parameters=lost)
    powers = np.sum((y - friction) * state["qd"], axis=1, keepdims=True)
    close(rate("kinetic_energy") + rate("potential_energy"), powers, 1e-9)
    for name in ("momentum", "momentum_bias", "kinetic_energy", "potential_energy"):
        close(found(f"{name}_regressor") @ state["parameters"], found(name), 1e-10)
    if np.linalg.cond(found("mass_matrix")).max(initial=1) < MOST_CONDITION:
        close(found("forward_dynamics", y=y), state["qdd"], 1e-8)


@examples(10)
@given(mechanisms(most=3), st.integers(0, 2**32))
def test_power(mechanism: Mechanism, seed: int) -> None:
    mechanism = with_rotors(mechanism)
    q, qd, qdd = random_states(mechanism, SAMPLES, seed)
    zeta = np.random.default_rng(seed).normal(size=len(mechanism.parameters))
    state = {"q": q, "qd": qd, "qdd": qdd, "parameters": zeta}
    check_motion(mechanism, state, qd)


@pytest.mark.parametrize("mechanism", one_in(3, CASES_OF_LOOPS))
def test_power_in_loops(mechanism: Mechanism) -> None:
    mechanism = with_rotors(mechanism)
    q, qd, qdd = closed_states(mechanism, SAMPLES)
    free = independent_columns(mechanism)
    state = {"q": q, "qd": qd[:, free], "qdd": qdd[:, free]}
    check_motion(mechanism, state | {"parameters": random_parameters(mechanism)}, qd)


@examples(10)
@given(mechanisms(most=3), st.integers(0, 2**32))
def test_forward_dynamics_and_its_derivatives_by_an_imaginary_step(
    mechanism: Mechanism, seed: int
) -> None:
    mechanism = with_rotors(mechanism)
    q, qd, qdd = random_states(mechanism, SAMPLES, seed)
    state = {"q": q, "qd": qd, "y": qdd, "parameters": bodies_of(mechanism, seed)}
    mass = evaluate(recorded("mass_matrix", mechanism), mechanism, state)
    assume(np.linalg.cond(mass).max(initial=1) < MOST_CONDITION)
    found = evaluate(recorded("forward_dynamics", mechanism), mechanism, state)
    needed = evaluate(
        recorded("inverse_dynamics", mechanism), mechanism, state | {"qdd": found}
    )
    close(needed, state["y"], 1e-8)
    slopes = evaluate(
        recorded("forward_dynamics_derivatives", mechanism), mechanism, state
    )
    expected, tiny = [], 1e-100j
    for name in ("q", "qd", "y"):
        for step in tiny * np.eye(state[name].shape[1]):
            changed = state[name] + step
            moved = state | {
                name: normalised(mechanism, changed) if name == "q" else changed
            }
            function = recorded("forward_dynamics", mechanism)
            value = evaluate(function, mechanism, moved, ComplexArithmetic())
            expected.append(value.imag / tiny.imag)
    close(slopes, np.stack(expected, axis=2), 1e-8)


def bodies_of(mechanism: Mechanism, seed: int) -> FloatArray:
    """Standard parameters of random physical bodies; 0.1 of every effect."""
    rng = np.random.default_rng(seed)
    values = np.full(len(mechanism.parameters), 0.1)
    for first in mechanism.first_column.values():
        points, masses = rng.normal(size=(5, 3)), rng.uniform(0.1, 1.0, 5)
        second = np.einsum("k,ki,kj->ij", masses, points, points)
        tensor = np.trace(second) * np.eye(3) - second
        values[first : first + 6] = tensor[np.triu_indices(3)]
        values[first + 6 : first + 10] = *(masses @ points), masses.sum()
    return values


COUPLED = """
<mujoco>
  <option gravity="1 2 -9.81"/>
  <worldbody>
    <body name="arm">
      <joint name="a" axis="0 1 0"/>
      <inertial pos="0.2 0.1 0" mass="2" fullinertia="0.1 0.2 0.25 0.01 0.02 0.03"/>
      <body name="hand" pos="0.4 0 0">
        <joint name="b" axis="0 0 1"/>
        <inertial pos="0.1 0 0.1" mass="1" fullinertia="0.05 0.06 0.05 0.01 0 0.01"/>
        <body name="tip" pos="0 0.3 0">
          <joint name="c" type="slide" axis="1 0 0"/>
          <inertial pos="0 0 0.1" mass="0.5" diaginertia="0.02 0.02 0.02"/>
        </body>
      </body>
    </body>
  </worldbody>
  <equality><joint joint1="c" joint2="b" polycoef="0 0.3 0 0 0"/></equality>
</mujoco>
"""


def test_a_coupled_arm_accelerates_as_in_mujoco(tmp_path: Path) -> None:
    (tmp_path / "arm.xml").write_text(COUPLED, encoding="utf-8")
    mechanism = ec.load(tmp_path / "arm.xml")
    assert mechanism.velocities == ("a", "b")
    model = mujoco.MjModel.from_xml_string(COUPLED)
    data, followed = mujoco.MjData(model), np.array([[1, 0], [0, 1], [0, 0.3]])
    q, qd, y = random_states(mechanism, SAMPLES)
    zeta = standard_vector(mechanism)
    state = {"q": q, "qd": qd, "y": y, "parameters": zeta}
    function = recorded("forward_dynamics", mechanism)
    found = evaluate(function, mechanism, state)
    for k in range(SAMPLES):
        data.qpos[:], data.qvel[:] = followed @ q[k], followed @ qd[k]
        mujoco.mj_forward(model, data)
        full = np.zeros((3, 3))
        for column, unit in zip(full, np.eye(3), strict=True):
            mujoco.mj_mulM(model, data, column, unit)
        mass = followed.T @ full @ followed
        expected = np.linalg.solve(mass, y[k] - followed.T @ data.qfrc_bias)
        close(found[k], expected, 1e-10)


def test_forward_dynamics_of_all_effects_and_drives(tmp_path: Path) -> None:
    """Whatever laws and transmissions there are, the accelerations are those that need the outputs."""
    (tmp_path / "robot.yaml").write_text(EVERYTHING, encoding="utf-8")
    mechanism = ec.load(tmp_path / "robot.yaml")
    q, qd, qdd = random_states(mechanism, SAMPLES)
    state = {"q": q, "qd": qd, "qdd": qdd, "inputs": np.ones((SAMPLES, 1))}
    state["parameters"] = bodies_of(mechanism, 1)
    function = recorded("inverse_dynamics", mechanism)
    state["y"] = evaluate(function, mechanism, state)
    found = evaluate(recorded("forward_dynamics", mechanism), mechanism, state)
    close(found, qdd, 1e-9)


def test_sensors_alone_do_not_tell_accelerations() -> None:
    mechanism = sensed(ec.load(EXAMPLES / "rx90.yaml"))
    for name in ("forward_dynamics", "kinetic_energy", "potential_energy_regressor"):
        with pytest.raises(InputError, match="needs the force of every independent"):
            robot_function(name, mechanism, [0])


# -- base parameters ---------------------------------------------------------------------------------------------------


def test_base_parameters_do_for_standard_parameters() -> None:
    mechanism = ec.load(EXAMPLES / "rx90.yaml")
    base = ec.base_parameters(mechanism)
    symbols = {"RL4": 0.45, "D3": 0.45}
    zeta = np.random.default_rng(1).normal(size=len(mechanism.parameters))
    q, qd, _ = random_states(mechanism, SAMPLES)
    _, qdr, qddr = random_states(mechanism, SAMPLES, 2)
    state = {"q": q, "qd": qd, "qdr": qdr, "qddr": qddr}
    standard = recorded("slotine_li", mechanism)
    geometry = {"symbols": [symbols[n] for n in standard.arguments[-1].labels]}
    values = base.B_float(symbols) @ zeta
    expected = by_numpy(standard, {**state, **geometry, "parameters": zeta})
    found = base.evaluate("slotine_li", {**state, "parameters": values}, symbols)
    close(found, expected)
    close(base.evaluate("slotine_li_regressor", state, symbols) @ values, expected)


# -- filtered regressors -----------------------------------------------------------------------------------------------


def test_filtered_regressors_need_no_accelerations() -> None:
    """They are the filtered regressors of a simulated motion, up to the square of the step, and estimate as well."""
    base = ec.base_parameters(ec.load(EXAMPLES / "double_pendulum.yaml"))
    rng = np.random.default_rng(5)
    rates, starts = rng.uniform(1.0, 9.0, 2), rng.uniform(0.0, 6.0, 2)
    coarse = np.cumsum(rng.uniform(0.5e-3, 1.5e-3, 1500))  # no even steps
    fine = np.interp(np.arange(2999) / 2, np.arange(1500), coarse)
    errors, zeta = [], rng.normal(size=base.rank)
    for times in (coarse, fine):
        phases = times[:, None] * rates + starts
        q, qd, qdd = (
            np.sin(phases),
            rates * np.cos(phases),
            -(rates**2) * np.sin(phases),
        )
        X = base.regressor(q, qd, qdd)
        found = base.filtered_regressor(times, q, qd, 20.0)
        error = np.abs(found - ec.low_pass(times, X, 20.0)).max()
        errors.append(error / np.abs(X).max())
        torques = ec.low_pass(times, X @ zeta, 20.0)
        rows, right = found.reshape(-1, base.rank), torques.ravel()
        close(np.linalg.lstsq(rows, right, rcond=None)[0], zeta, 1e-3)
    assert errors[0] < 1e-4
    assert errors[1] == pytest.approx(errors[0] / 4, rel=0.1)


def test_a_low_pass_of_what_is_linear_between_samples_is_exact() -> None:
    times = np.array([0.0, 0.1, 0.4, 1.0])
    fine = np.linspace(0.0, 1.0, 100_001)
    values = np.array([[1.0, 0.0], [2.0, 1.0], [-1.0, 0.5], [0.0, 3.0]])
    found = ec.low_pass(times, values, 3.0, start=[0.5, 0.0])
    close(found[0], np.array([0.5, 0.0]))
    for column in range(2):
        x = np.interp(fine, times, values[:, column])
        y = ec.low_pass(fine, x, 3.0, start=found[0, column])
        close(found[:, column], np.interp(times, fine, y), 1e-12)
        slope = np.gradient(y, fine)[1:-1]
        inside = np.abs(np.subtract.outer(fine[1:-1], times)).min(axis=1) > 1e-4
        close(slope[inside], (3.0 * (x - y)[1:-1])[inside], 1e-4)
    whole = ec.low_pass(times[2:], values[2:], 3.0, start=found[2])
    close(whole, found[2:])


def test_one_state_is_a_log_of_one_sample() -> None:
    base = ec.base_parameters(ec.load(EXAMPLES / "double_pendulum.yaml"))
    q, qd = np.array([0.3, -0.7]), np.array([1.0, 2.0])
    found = base.filtered_regressor([0.0], q, qd, 20.0)
    close(found, np.zeros((1, 2, base.rank)))
    with pytest.raises(InputError, match="times has shape"):
        base.filtered_regressor([0.0, 1.0], q, qd, 20.0)


def test_a_low_pass_starts_at_finite_numbers_of_the_signals_shape() -> None:
    for start, message in [([1, 2], "start has shape"), (np.nan, "must be finite")]:
        with pytest.raises(InputError, match=message):
            ec.low_pass([0, 1], [1, 2], 1.0, start)


@pytest.mark.parametrize(
    ("times", "values", "bandwidth", "message"),
    [
        ([0, 1], [1, 2, 3], 1.0, "times has shape"),
        ([0, 0], [1, 2], 1.0, "times must increase"),
        ([0, 1], [1, np.nan], 1.0, "all numbers must be finite"),
        ([0, 1], [1, 2], 0.0, "bandwidth is 0.0; expected rad/s above zero"),
    ],
)
def test_signals_that_no_low_pass_takes(
    times: list[float], values: list[float], bandwidth: float, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        ec.low_pass(times, values, bandwidth)
