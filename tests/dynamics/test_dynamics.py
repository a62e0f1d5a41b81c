"""Functions of robots: what they have to do with each other, and how many operations they need for a sample."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import echelon as ec
from echelon.algebra.program.function import Function
from echelon.dynamics.evaluate import evaluate_floats
from echelon.dynamics.functions import FUNCTIONS, robot_function, vector
from echelon.dynamics.linear_forms import virtual_power_form
from echelon.dynamics.outputs import RecordedOutputs
from echelon.loops.assembly import Assembly
from echelon.robot.effect import Action, Effect, Side
from echelon.robot.mechanism import Mechanism
from echelon.shared.errors import InputError
from support import linkages
from support import textbook_arms as arms
from support.described_robots import EVERYTHING, SENSORS, sensed
from support.float_functions import ComplexArithmetic, evaluate, normalised
from support.float_regressor import FloatArray, random_states
from support.paths import EXAMPLES
from support.random_mechanisms import mechanisms
from support.selection import examples, one_in

NAMES = (
    "inverse_dynamics",
    "gravity",
    "coriolis",
    "effects",
    "mass_matrix",
    "regressor",
)


def results(
    mechanism: Mechanism, pivots: Sequence[int], seed: int = 1, **inputs: FloatArray
) -> tuple[dict[str, FloatArray], FloatArray, FloatArray]:
    """All functions at random states with random parameters; the parameters; the accelerations."""
    q, qd, qdd = random_states(mechanism, 3, seed)
    zeta = np.random.default_rng(seed).normal(size=len(pivots))
    values = {"q": q, "qd": qd, "qdd": qdd, "parameters": zeta, **inputs}
    found = {
        name: evaluate(robot_function(name, mechanism, pivots), mechanism, values)
        for name in NAMES
    }
    return found, zeta, qdd


def check_parts(
    found: dict[str, FloatArray], zeta: FloatArray, qdd: FloatArray
) -> None:
    y = found["inverse_dynamics"]
    size = 1 + np.abs(y).max()
    np.testing.assert_allclose(found["regressor"] @ zeta, y, atol=1e-13 * size)
    parts = found["coriolis"] + found["gravity"] + found["effects"]
    np.testing.assert_allclose(
        np.einsum("kij,kj->ki", found["mass_matrix"], qdd) + parts, y, atol=1e-13 * size
    )


@examples(12)
@given(mechanisms(), st.integers(0, 2**32))
def test_parts_of_inverse_dynamics(mechanism: Mechanism, seed: int) -> None:
    columns = range(len(mechanism.parameters))
    found, zeta, qdd = results(mechanism, columns, seed)
    check_parts(found, zeta, qdd)
    mass = found["mass_matrix"]
    np.testing.assert_allclose(
        mass, np.swapaxes(mass, 1, 2), atol=1e-12 * (1 + np.abs(mass).max(initial=0))
    )


@pytest.mark.parametrize(
    "make", [arms.rx90, arms.puma560, arms.panda, arms.floating_pair]
)
def test_base_parameters_do_for_standard_parameters(make) -> None:  # type: ignore[no-untyped-def]
    mechanism = make()
    base = ec.base_parameters(mechanism)
    found, zeta, qdd = results(mechanism, base.matrix.pivots)
    check_parts(found, zeta, qdd)


def test_an_unknown_name() -> None:
    assert set(NAMES) <= set(FUNCTIONS)
    with pytest.raises(
        InputError,
        match=r"there is no function 'dynamics' \(valid: inverse_dynamics, gravity",
    ):
        robot_function("dynamics", arms.rx90(), [0])
    with pytest.raises(
        InputError, match="pivots are different column numbers from 0 to 59"
    ):
        robot_function("gravity", arms.rx90(), [0, 60])


# -- derivatives -------------------------------------------------------------------------------------------------------


@examples(10)
@given(mechanisms(most=3), st.integers(0, 2**32))
def test_derivatives_by_an_imaginary_step(mechanism: Mechanism, seed: int) -> None:
    columns = range(len(mechanism.parameters))
    state = dict(
        zip(("q", "qd", "qdd"), random_states(mechanism, 2, seed), strict=True)
    )
    state["parameters"] = np.random.default_rng(seed).normal(size=len(columns))
    function = robot_function("inverse_dynamics", mechanism, columns)
    found = evaluate(
        robot_function("inverse_dynamics_derivatives", mechanism, columns),
        mechanism,
        state,
    )
    expected, tiny = [], 1e-100j
    for name in ("q", "qd"):
        for k in range(state[name].shape[1]):
            step = np.zeros(state[name].shape[1], dtype=complex)
            step[k] = tiny
            changed = (
                normalised(mechanism, state["q"] + step)
                if name == "q"
                else state["qd"] + step
            )
            moved = evaluate(
                function, mechanism, state | {name: changed}, ComplexArithmetic()
            )
            expected.append(moved.imag / tiny.imag)
    np.testing.assert_allclose(
        found,
        np.stack(expected, axis=2),
        atol=1e-11 * (1 + np.abs(found).max(initial=0)),
    )


# -- effects, transmissions, sensors -----------------------------------------------------------------------------------


def described(folder: Path, text: str) -> Mechanism:
    (folder / "robot.yaml").write_text(text, encoding="utf-8")
    return ec.load(folder / "robot.yaml")


@pytest.mark.parametrize("sensors", ["", SENSORS], ids=["drives", "sensors"])
def test_effects_couplings_transmissions_and_sensors(
    tmp_path: Path, sensors: str
) -> None:
    mechanism = described(tmp_path, EVERYTHING + sensors)
    current = np.random.default_rng(8).normal(size=(3, 1))
    columns = range(len(mechanism.parameters))
    found, zeta, qdd = results(mechanism, columns, inputs=current)
    check_parts(found, zeta, qdd)
    function = robot_function("inverse_dynamics", mechanism, columns)
    names = ["q", "qd", "qdd", "inputs", "parameters", "symbols"]
    assert [argument.name for argument in function.arguments] == names
    assert [argument.labels for argument in function.arguments[3::2]] == [
        ("j1",),
        ("l", "n"),
    ]
    assert function.units == tuple(output.unit for output in mechanism.outputs)


def test_the_effects_alone(tmp_path: Path) -> None:
    mechanism = described(tmp_path, EVERYTHING)
    pivots = [mechanism.parameters.index(name) for name in ("Fv1", "Ks2", "K", "Ia4")]
    (q, qd, qdd), zeta = random_states(mechanism, 3), np.array([2.0, 3.0, 5.0, 7.0])
    values = {"q": q, "qd": qd, "qdd": qdd, "parameters": zeta}
    row = dict(
        zip((output.name for output in mechanism.outputs), range(4), strict=True)
    )
    expected = np.zeros((3, 4))
    expected[:, row["j1"]] = 2 * qd[:, 0] + 5 * np.abs(qd[:, 0])
    expected[:, row["m2"]] = 5 * np.sin(q[:, 0]) + 3 * q[:, 1] / 50
    expected[:, row["m3"]] = 3 * q[:, 1] * 10 / 50 / 60  # j2 = m2 / 50 + m3 / 300
    found = evaluate(robot_function("effects", mechanism, pivots), mechanism, values)
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    mass = evaluate(robot_function("mass_matrix", mechanism, pivots), mechanism, values)
    np.testing.assert_allclose(mass[:, row["j4"]], np.tile([0, 0, 0, 7.0], (3, 1)))
    np.testing.assert_allclose(mass[:, row["j1"], 1], 10 * np.cos(q[:, 0]))
    np.testing.assert_allclose(
        mass[:, row["m2"]], np.tile([0, 0, 5 * 0.4 * -60, 0], (3, 1))
    )


@pytest.mark.parametrize(
    "term", ["qdd**2", "sign(qdd)", "abs(qdd)*q", "qdd*qd", "i*qdd"]
)
def test_effects_that_no_mass_matrix_holds(tmp_path: Path, term: str) -> None:
    own = f'  - {{parameter: P, unit: N·m, acts: [{{at: j1, term: "{term}"}}]}}'
    mechanism = described(tmp_path, EVERYTHING + own)
    with pytest.raises(
        InputError,
        match="effect 'P' is not linear in the accelerations, with positions alone",
    ):
        robot_function("mass_matrix", mechanism, range(len(mechanism.parameters)))
    robot_function("mass_matrix", mechanism, range(60))
    robot_function(
        "inverse_dynamics_derivatives", mechanism, range(len(mechanism.parameters))
    )


def check_slopes(mechanism: Mechanism, values: dict[str, FloatArray]) -> None:
    """Derivatives of inverse dynamics against central differences."""
    columns, h = range(len(mechanism.parameters)), 1e-6
    function = robot_function("inverse_dynamics", mechanism, columns)
    found = evaluate(
        robot_function("inverse_dynamics_derivatives", mechanism, columns),
        mechanism,
        values,
    )
    expected = []
    for name in ("q", "qd"):
        for step in h * np.eye(values[name].shape[1]):
            ends = (
                evaluate(function, mechanism, values | {name: values[name] + s * step})
                for s in (1, -1)
            )
            expected.append(np.subtract(*ends) / (2 * h))
    np.testing.assert_allclose(
        found, np.stack(expected, axis=2), atol=1e-7 * np.abs(found).max()
    )


@pytest.mark.parametrize("sensors", ["", SENSORS], ids=["drives", "sensors"])
def test_derivatives_with_effects_and_sensors(tmp_path: Path, sensors: str) -> None:
    mechanism = described(tmp_path, EVERYTHING + sensors)
    rng = np.random.default_rng(8)
    values = dict(zip(("q", "qd", "qdd"), random_states(mechanism, 3), strict=True))
    values |= {
        "parameters": rng.normal(size=len(mechanism.parameters)),
        "inputs": rng.normal(size=(3, 1)),
    }
    check_slopes(mechanism, values)


# -- loops -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "mechanism",
    [linkages.four_bar(), linkages.rssr(), sensed(linkages.rssr())],
    ids=["four-bar", "rssr", "sensors"],
)
def test_loops(mechanism: Mechanism) -> None:
    passive = mechanism.velocities[-1]
    mechanism = replace(
        mechanism,
        effects=(Effect("Fv", "N·m·s/rad", (Action(passive, Side.JOINT, "qd"),)),),
    )
    columns = range(len(mechanism.parameters))
    q, qd, qdd = Assembly(mechanism).random_closed_states(np.random.default_rng(5), 4)
    zeta = np.random.default_rng(6).normal(size=len(columns))
    free = [
        mechanism.velocities.index(name) for name in mechanism.independent_velocities
    ]
    values = {"q": q, "qd": qd[:, free], "qdd": qdd[:, free], "parameters": zeta}
    found = {
        name: evaluate(robot_function(name, mechanism, columns), mechanism, values)
        for name in NAMES
    }
    check_parts(found, zeta, qdd[:, free])
    x = evaluate_floats(virtual_power_form(mechanism), mechanism, q, qd, qdd)
    np.testing.assert_allclose(
        found["inverse_dynamics"], x @ zeta, atol=1e-9 * np.abs(x).max()
    )
    arguments = robot_function("coriolis", mechanism, columns).arguments
    assert [a.name for a in arguments] == ["q", "qd", "parameters", "symbols"]


NAME = "inverse_dynamics"
COUNTS = {
    "rx90": {
        "inverse_dynamics": (225, 238, 5),
        "gravity": (25, 40, 5),
        "mass_matrix": (112, 132, 5),
        "inverse_dynamics_derivatives": (896, 1024, 5),
    },
    "puma560": {
        "inverse_dynamics": (236, 248, 5),
        "gravity": (25, 40, 5),
        "mass_matrix": (130, 148, 5),
        "inverse_dynamics_derivatives": (974, 1106, 5),
    },
    "panda": {
        "inverse_dynamics": (294, 298, 6),
        "gravity": (34, 50, 6),
        "mass_matrix": (175, 196, 6),
        "inverse_dynamics_derivatives": (1273, 1439, 6),
    },
    "ur10": {
        "inverse_dynamics": (232, 244, 5),
        "gravity": (25, 40, 5),
        "mass_matrix": (128, 146, 5),
        "inverse_dynamics_derivatives": (938, 1067, 5),
    },
}
"""Additions and subtractions, multiplications, and pairs of sine and cosine."""

UR10 = ("R 0 0 0", "R pi/2 0 0", "R 0 a2 0", "R 0 a3 d4", "R pi/2 0 d5", "R -pi/2 0 0")
ARMS = {
    "rx90": arms.rx90(),
    "puma560": arms.puma560(),
    "panda": arms.panda(),
    "ur10": arms.modified_dh(
        "ur10",
        *UR10,
        values={"a2": "-0.612", "a3": "-0.5723", "d4": "0.163941", "d5": "0.1157"},
    ),
}


def counted(function: Function) -> tuple[int, int, int]:
    operations = function.operations()
    assert operations.keys() <= {"ADD", "SUB", "MUL", "NEG", "SIN", "COS"}
    return operations["ADD"] + operations["SUB"], operations["MUL"], operations["SIN"]


@pytest.mark.parametrize("robot", one_in(2, ARMS))
@pytest.mark.parametrize("name", COUNTS["rx90"])
def test_base_parameters(robot: str, name: str) -> None:
    mechanism, limits = ARMS[robot], COUNTS[robot][name]
    found = counted(
        robot_function(name, mechanism, ec.base_parameters(mechanism).matrix.pivots)
    )
    assert all(a <= b for a, b in zip(found, limits, strict=True)), found


@pytest.mark.parametrize("robot", ARMS)
def test_standard_parameters_cost_the_same(robot: str) -> None:
    mechanism: Mechanism = ARMS[robot]
    found = counted(
        robot_function("inverse_dynamics", mechanism, range(len(mechanism.parameters)))
    )
    assert all(
        a <= b for a, b in zip(found, COUNTS[robot]["inverse_dynamics"], strict=True)
    ), found


def test_frames_behind_constant_placements_cost_the_same() -> None:
    """Standard and modified Denavit–Hartenberg frames of one arm."""
    mechanism = ec.load(EXAMPLES / "ur10.yaml")
    found = counted(
        robot_function(
            "inverse_dynamics", mechanism, ec.base_parameters(mechanism).matrix.pivots
        )
    )
    assert all(
        a <= b for a, b in zip(found, COUNTS["ur10"]["inverse_dynamics"], strict=True)
    ), found


def test_angles_are_summed_only_where_that_pays() -> None:
    """A planar arm needs no sums, because nothing lies across its axes; UR10's wrist turns by a sum of three angles."""
    planar, arm = arms.planar(3), ARMS["ur10"]
    for mechanism in (planar, arm):
        columns = range(len(mechanism.parameters))
        without, chosen = (
            counted(build(mechanism, columns))
            for build in (
                lambda *given: vector(NAME, RecordedOutputs(*given, sums=False)),
                FUNCTIONS[NAME],
            )
        )
        assert (sum(chosen) < sum(without)) == (mechanism is arm)
