"""Forces of mechanisms with loops, against Lagrange multipliers in Pinocchio and MuJoCo and against energy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

import echelon as ec
from echelon.algebra.exact.polynomial import Polynomial
from echelon.base.claims.audit import random_states
from echelon.dynamics.evaluate import evaluate_floats
from echelon.dynamics.linear_forms import virtual_power_form
from echelon.loops.assembly import Assembly
from echelon.robot.effect import Action, Effect, Side
from echelon.robot.joint import GROUND, Placement
from echelon.robot.mechanism import Actuator, Cut, Mechanism
from support import linkages
from support.closed_motion import completed, velocities
from support.float_regressor import FloatArray
from support.loop_states import closed_states, independent_columns, random_parameters
from support.paths import ROOT
from support.pinocchio_loops import Constrained
from support.selection import one_in

GOUGH_STEWART = ROOT / "examples" / "loops" / "gough_stewart.yaml"

ALL = [pytest.param(m, id=m.name) for m in linkages.everything()]


def regressor(mechanism: Mechanism, *state: FloatArray) -> FloatArray:
    return evaluate_floats(
        virtual_power_form(mechanism),
        mechanism,
        *completed(Assembly(mechanism), *state),
    )


# -- forces ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mechanism", one_in(3, ALL))
def test_forces_are_those_with_lagrange_multipliers(mechanism: Mechanism) -> None:
    zeta, states = random_parameters(mechanism), closed_states(mechanism)
    model = Constrained(mechanism, zeta)
    expected = np.array(
        [model.dynamics(*state)[0] for state in zip(*states, strict=True)]
    )
    found = regressor(mechanism, *states) @ zeta
    np.testing.assert_allclose(found, expected, atol=1e-10 * np.abs(expected).max())


def test_sensors_in_a_loop_see_the_load_that_the_loop_carries() -> None:
    mechanism, kinds = (
        linkages.rssr(),
        [(False, k) for k in range(3)] + [(True, k) for k in range(3)],
    )
    cuts = [
        Cut(body, Placement(), False, axis, angular)
        for body in range(3)
        for angular, axis in kinds
    ]
    sensed = replace(
        mechanism,
        measured=tuple(cut.output(f"s{k}", "N") for k, cut in enumerate(cuts)),
    )
    zeta, states = random_parameters(sensed), closed_states(sensed)
    model = Constrained(mechanism, zeta)
    expected = np.array(
        [np.concatenate(model.wrenches(*state)) for state in zip(*states, strict=True)]
    )
    found = regressor(sensed, *states) @ zeta
    np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())


def test_the_whole_mechanism_stands_on_its_base() -> None:
    # the base carries all bodies, however the loop shares the load between its two bearings
    mechanism = linkages.four_bar()
    cuts = tuple(
        Cut(GROUND, Placement(), False, k, False).output(f"f{'xyz'[k]}", "N")
        for k in range(3)
    )
    weight = regressor(
        replace(mechanism, measured=cuts), *(np.zeros((1, 1)) for _ in range(3))
    )[0]
    masses = [mechanism.parameters.index(f"M{k}") for k in (1, 2, 3)]
    np.testing.assert_allclose(
        weight[:, masses], np.outer([0, 9.81, 0], np.ones(3)), atol=1e-10
    )


def test_a_slider_crank_by_its_textbook_formula() -> None:
    mechanism = linkages.slider_crank()
    angle, rate, gain = np.random.default_rng(2).uniform(-2.0, 2.0, (3, 8))
    sine, cosine, ratio = np.sin(angle), np.cos(angle), 0.2 / 0.5
    root = np.sqrt(1 - (ratio * sine) ** 2)
    slope = -0.2 * (sine + ratio * sine * cosine / root)
    curve = -0.2 * (
        cosine
        + ratio * (np.cos(2 * angle) / root + (ratio * sine * cosine) ** 2 / root**3)
    )
    expected = (slope * gain + curve * rate**2) * slope
    x = regressor(mechanism, angle[:, None], rate[:, None], gain[:, None])
    np.testing.assert_allclose(
        x[:, 0, mechanism.parameters.index("M3")], expected, rtol=1e-9, atol=1e-11
    )


def test_friction_in_passive_joints_and_transmissions() -> None:
    mechanism = linkages.rssr()
    friction = Effect("Fv9", "N·m·s/rad", (Action("q2", Side.JOINT, "qd"),))
    one = Polynomial.constant(1)
    drives = (
        Actuator("m1", (("q1", one), ("rod.x", one))),
        Actuator("m2", (("q1", one), ("rod.x", -one))),
    )
    driven = replace(mechanism, effects=(friction,), actuators=drives)
    states = closed_states(mechanism)
    x, plain_x = (
        regressor(driven, *states),
        regressor(replace(driven, actuators=()), *states),
    )
    np.testing.assert_allclose(
        np.array([[1, 1], [1, -1]]).T @ x, plain_x, atol=1e-10 * np.abs(x).max()
    )
    passive = mechanism.velocities.index("q2")
    slopes = [
        velocities(Assembly(mechanism), states[0], np.tile(unit, (6, 1)))[:, passive]
        for unit in np.eye(2)
    ]
    np.testing.assert_allclose(
        plain_x[:, :, -1], np.transpose(slopes) * states[1][:, passive, None], atol=1e-9
    )


MJCF = """
<mujoco>
  <option gravity="0.3 -0.4 -9.81" jacobian="dense"/>
  <worldbody>
    <body name="a" pos="0 0 0.1"><joint name="a" axis="0 0 1"/>
      <inertial pos="0.02 0.03 0.04" mass="2.5" fullinertia="0.03 0.04 0.05 0.001 0.002 0.003"/>
      <body name="b" pos="0.15 0 0"><joint name="b" type="ball"/>
        <inertial pos="0.1 0.01 0.02" mass="1.5" fullinertia="0.02 0.03 0.025 0.001 -0.002 0.001"/></body></body>
    <body name="c" pos="0.5 0 0" ><joint name="c" axis="{axis}"/>
      <inertial pos="0.05 0.2 -0.02" mass="0.7" fullinertia="0.004 0.005 0.006 0.0001 0.0002 0.0003"/>
      <body name="d" pos="0 0.3 0"><joint name="d" type="hinge" axis="1 0 0"/><joint name="e" axis="0 1 0"/>
        <inertial pos="0 0.1 0.03" mass="0.9" fullinertia="0.003 0.002 0.004 0.0001 0.0002 0.0003"/></body></body>
  </worldbody>
  <equality>{equality}</equality>
</mujoco>
"""


@pytest.mark.parametrize(
    ("axis", "equality"),
    [
        ("1 0 0", '<connect body1="b" body2="d" anchor="0.3 0.25 0.2"/>'),
        ("0 1 0", '<connect body1="d" body2="a" anchor="0.1 0.25 0.2"/>'),
        ("0 1 0", '<weld body1="b" body2="d"/>'),
    ],
)
def test_forces_are_those_of_mujoco(tmp_path: Path, axis: str, equality: str) -> None:
    (tmp_path / "loop.xml").write_text(MJCF.format(axis=axis, equality=equality))
    mechanism, model = (
        ec.load(tmp_path / "loop.xml"),
        mujoco.MjModel.from_xml_path(str(tmp_path / "loop.xml")),
    )
    data, chosen = (
        mujoco.MjData(model),
        np.eye(model.nv)[independent_columns(mechanism)],
    )
    states = closed_states(mechanism)
    zeta = np.array(mechanism.standard_values(), dtype=float)
    for state, found in zip(
        zip(*states, strict=True), regressor(mechanism, *states) @ zeta, strict=True
    ):
        data.qpos[:], data.qvel[:], _ = state
        model.opt.disableflags = 0
        mujoco.mj_forward(model, data)
        constraints = data.efc_J.reshape(-1, model.nv)[: data.nefc].copy()
        assert np.abs(data.efc_pos).max() < 1e-9
        assert np.abs(constraints @ data.qvel).max() < 1e-9
        model.opt.disableflags = mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        data.qacc[:] = state[2]
        mujoco.mj_inverse(model, data)
        matrix = np.vstack([chosen, constraints]).T
        expected = np.linalg.lstsq(matrix, data.qfrc_inverse, rcond=1e-9)[0]
        np.testing.assert_allclose(matrix @ expected, data.qfrc_inverse, atol=1e-7)
        np.testing.assert_allclose(
            found, expected[: len(chosen)], atol=1e-8 * np.abs(expected).max()
        )


def crank_motion(time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    return (
        (1 + 2 * np.sin(time))[:, None],
        (2 * np.cos(time))[:, None],
        (-2 * np.sin(time))[:, None],
    )


def leg_motion(time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    lengths = np.array([0.766, 0.772, 0.774, 0.771, 0.774, 0.766])
    size, phase = (
        0.05 * np.array([1, -1, 0.5, 0.8, -0.6, 0.3]),
        time[:, None] + np.arange(6),
    )
    return lengths + size * np.sin(phase), size * np.cos(phase), -size * np.sin(phase)


@pytest.mark.parametrize(
    ("make", "motion"),
    [(linkages.four_bar, crank_motion), (lambda: ec.load(GOUGH_STEWART), leg_motion)],
    ids=["four-bar", "Gough-Stewart"],
)
def test_work_becomes_energy(
    make: Callable[[], Mechanism], motion: Callable[..., tuple[FloatArray, ...]]
) -> None:
    mechanism, h = make(), 1e-3
    zeta, instants = random_parameters(mechanism), np.linspace(0, 6, 5)
    assembly, model = Assembly(mechanism), Constrained(mechanism, zeta)
    times = (instants[:, None] + h * np.array([-2, -1, 0, 1, 2])).ravel()
    q, qd, qdd = motion(times)
    full = assembly.from_independent(q)
    speeds = velocities(assembly, full, qd)
    energy = np.array(
        [model.energy(*state) for state in zip(full, speeds, strict=True)]
    ).reshape(-1, 5)
    gained = (8 * (energy[:, 3] - energy[:, 1]) - (energy[:, 4] - energy[:, 0])) / (
        12 * h
    )
    power = np.einsum("ijk,k,ij->i", regressor(mechanism, q, qd, qdd), zeta, qd)[2::5]
    np.testing.assert_allclose(power, gained, atol=1e-8 * np.abs(gained).max())


def test_states_of_all_or_of_independent_coordinates() -> None:
    mechanism = linkages.four_bar()
    base = ec.base_parameters(mechanism)
    q, qd, qdd = random_states(base, np.random.default_rng(3))
    x = base.standard_regressor(q, qd, qdd)
    assert x.shape == (len(q), 1, 30)
    np.testing.assert_allclose(
        base.regressor(q, qd, qdd) @ base.B_float(), x, atol=1e-9
    )
    np.testing.assert_allclose(
        base.standard_regressor(q[:, :1], qd[:, :1], qdd[:, :1]), x, atol=1e-9
    )
    assert np.linalg.matrix_rank(x[:, 0], rtol=1e-9) == base.rank
