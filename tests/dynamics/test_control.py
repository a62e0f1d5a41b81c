"""Functions for controllers: against Pinocchio, and by what they have to do with each other."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

import echelon as ec
from echelon.algebra.program.function import Function
from echelon.dynamics.functions import robot_function
from echelon.loops.closed_motion import position_rates
from echelon.robot.closure import ClosureKind
from echelon.robot.effect import Action, Effect, Side
from echelon.robot.mechanism import Mechanism
from support import linkages
from support.float_functions import ComplexArithmetic, evaluate
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
    ("romeo", True),
]
SAMPLES = 2


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
    terms = {"Ia": ("kg·m²", "qdd"), "Fv": ("N·m·s", "qd + abs(qd)*qd")}
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


@pytest.mark.parametrize(
    "mechanism", one_in(3, [pytest.param(m, id=m.name) for m in LOOPS])
)
def test_skew_symmetry_in_loops(mechanism: Mechanism) -> None:
    mechanism = with_rotors(mechanism)
    q, qd, qdd = closed_states(mechanism, SAMPLES)
    free = independent_columns(mechanism)
    state = {"q": q, "qd": qd[:, free], "qdd": qdd[:, free]}
    rng = np.random.default_rng(3)
    state["qdr"], state["qddr"] = rng.normal(size=(2, SAMPLES, len(free)))
    state["parameters"] = random_parameters(mechanism)
    check_passivity(mechanism, state, qd)


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
