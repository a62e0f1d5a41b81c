"""MJCF: X ζ against MuJoCo's own inverse dynamics, also where equalities couple or hold joints."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from echelon.robot.mechanism import Mechanism
from support.float_regressor import float_regressor, random_states, standard_vector
from support.mjcf_models import INERTIA, mechanism_of, model, read

MODELS = {
    "geoms of fused bodies in the place of a stated inertia": model(
        f"""<body name="a"><joint name="a" axis="0 1 0"/>{INERTIA}<body name="b" pos="0.1 0 0.2">
        <joint name="b" axis="1 0 0"/><inertial pos="0 0 0" mass="3" diaginertia="1 1 1"/>
        <body name="lump" pos="0 0 1"><geom size="0.1"/></body></body></body>""",
        '<compiler inertiafromgeom="true" fusestatic="true"/>',
    ),
    "hinges with odd orientations": model(
        f"""
        <body name="a" pos="0.1 -0.2 0.333" quat="0.8 0.1 -0.3 0.5"><joint name="a" axis="1 2 -0.5"/>{INERTIA}
          <body name="b" pos="0 0.4 0.1" axisangle="1 0.2 0.3 0.7"><joint name="b" axis="0 -1 0"/>{INERTIA}
            <body name="c" pos="0.25 0 0" xyaxes="0.2 1 0 -1 0.1 0.4"><joint name="c" axis="0 0 -3"/>{INERTIA}
              <body name="d" pos="0.25 0 0.1" zaxis="0.3 -0.4 0.2"><joint name="d" axis="1 0 0"/>{INERTIA}</body>
            </body>
          </body>
        </body>""",
        '<compiler angle="radian"/><option gravity="1.5 -2 -9"/>',
    ),
    "slide and hinge on one body": model(
        f"""
        <body name="a" pos="0.1 0 0.2" euler="0.3 0.1 0.2">
          <joint name="s" type="slide" axis="1 1 0" pos="0.4 0.5 0.6"/><joint name="h" axis="0 1 0" pos="0.2 -0.1 0.3"/>
          {INERTIA}
          <body name="b" pos="0 0.3 0">
            <joint name="k" axis="1 0 1" pos="-0.1 0 0.2"/><joint name="t" type="slide" axis="0 0 1"/>{INERTIA}
          </body>
        </body>""",
        '<compiler angle="radian"/>',
    ),
    "three hinges on one body": model(
        f"""
        <body name="a"><joint name="x" axis="1 0 0" pos="0.1 0.2 0.3"/><joint name="y" axis="0 1 0" pos="0.1 0.2 0.3"/>
          <joint name="z" axis="0 0.1 1" pos="-0.1 0.2 0.3"/>{INERTIA}
          <body name="b" pos="0.5 0 0"><joint name="k" axis="0 1 0"/>{INERTIA}</body></body>"""
    ),
    "ball with anchor": model(
        f"""
        <body name="a" pos="0.2 0 0" quat="0.7 0.1 0.5 -0.2"><joint name="b" type="ball" pos="0.1 -0.2 0.05"/>{INERTIA}
          <body name="c" pos="0 0 0.4"><joint name="h" axis="0 1 0" pos="0 0 0.1"/>{INERTIA}
            <body name="d" pos="0.1 0 0.2" quat="1 1 0 0"><joint name="e" type="ball"/>{INERTIA}</body></body></body>"""
    ),
    "free body with arms": model(
        f"""
        <body name="base" pos="1 2 3" quat="0.5 0.5 -0.5 0.1"><freejoint name="f"/>{INERTIA}
          <body name="left" pos="0.2 0.3 0"><joint name="l" axis="1 0 0"/>{INERTIA}
            <body name="hand" pos="0 0.3 0"><joint name="h" type="slide" axis="0 1 0.3"/>{INERTIA}</body></body>
          <body name="plate" pos="0 0 0.3" euler="30 20 10">{INERTIA}</body>
          <body name="right" pos="0.2 -0.3 0"><joint name="r" axis="0 0 1"/>{INERTIA}</body>
        </body>
        <body name="other"><joint name="o" axis="1 1 1"/>{INERTIA}</body>"""
    ),
    "degrees and intrinsic and extrinsic euler": model(
        f"""
        <body name="a" pos="0 0 0.1" euler="30 40 -50"><joint name="a" axis="1 0 0"/>{INERTIA}
          <body name="b" pos="0.2 0 0.1" axisangle="1 1 0 37"><joint name="b" axis="0 1 0"/>{INERTIA}
            <frame pos="0.1 0.2 0" euler="12 0 90"><body name="c" pos="0.3 0 0"><joint name="c"/>{INERTIA}</body>
            </frame></body></body>""",
        '<compiler angle="degree" eulerseq="XyZ"/>',
    ),
    "default classes": model(
        f"""
        <body name="a" childclass="arm"><joint name="a"/>{INERTIA}
          <body name="b" pos="0 0 0.3"><joint name="b"/><joint name="s" class="rail"/><geom mass="0.7" pos="0.1 0 0"/>
          </body></body>
        <body name="c" pos="1 0 0"><joint name="c"/><geom class="arm" density="900"/></body>""",
        """<default><joint axis="0 1 0"/>
        <default class="arm"><joint axis="1 0 0.4" pos="0 0.1 0"/><geom type="box" size="0.1 0.2 0.3"/>
        <default class="rail"><joint type="slide" axis="0 1 1"/></default></default></default>""",
    ),
    "joint references": model(
        f"""
        <body name="a" euler="10 0 0"><joint name="a" axis="0 -1 0" ref="90" pos="0.1 0 0"/>{INERTIA}
          <body name="b" pos="0.3 0 0"><joint name="b" axis="1 2 3" ref="37" pos="0 0 0.2"/>{INERTIA}
            <body name="c" pos="0.3 0.2 0"><joint name="c" type="slide" axis="1 -2 0.5" ref="0.4"/>
              <joint name="y" axis="1e-3 1 1e-3" ref="-20"/><joint name="z" axis="1e-3 -2e-3 -1" ref="20"/>{INERTIA}
            </body></body></body>"""
    ),
    "replicated": model(
        f"""<replicate count="3" offset="0 0 0.2" euler="0 0 25">
        <body name="arm" pos="0.4 0 0"><joint name="j" axis="0 1 0"/>{INERTIA}</body></replicate>"""
    ),
    "gimbal lock": model(
        f"""
        <body name="a" quat="0.706 0 0.7082 0.001"><joint name="a"/>{INERTIA}
          <body name="b" pos="0.3 0 0" quat="0.7071068 0 -0.7071068 0"><joint name="b" axis="1 0 0"/>{INERTIA}
            <body name="c" pos="0 0.3 0" euler="25 90 40"><joint name="c" axis="0 1 0"/>{INERTIA}</body>
          </body></body>"""
    ),
    "no gravity": model(
        f'<body name="a"><joint name="a"/>{INERTIA}</body>',
        '<option><flag gravity="disable"/></option>',
    ),
}


def simulator(text: str) -> tuple[object, object]:
    """MuJoCo's model without constraint forces, and its data."""
    compiled = mujoco.MjModel.from_xml_string(text)
    compiled.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    return compiled, mujoco.MjData(compiled)


def simulated_inverse_dynamics(
    text: str, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray
) -> np.ndarray:
    compiled, data = simulator(text)
    efforts = []
    for data.qpos[:], data.qvel[:], data.qacc[:] in zip(q, qd, qdd, strict=True):
        mujoco.mj_inverse(compiled, data)
        efforts.append(data.qfrc_inverse.copy())
    return np.array(efforts)


@pytest.mark.parametrize("name", MODELS)
def test_regressor_times_parameters_is_mujocos_inverse_dynamics(name: str) -> None:
    mechanism = mechanism_of(read(MODELS[name]))
    q, qd, qdd = random_states(mechanism, 5)
    expected = simulated_inverse_dynamics(MODELS[name], q, qd, qdd)
    found = float_regressor(mechanism, q, qd, qdd) @ standard_vector(mechanism)
    assert np.abs(expected).max() > 0.01
    np.testing.assert_allclose(
        found, expected, rtol=0, atol=1e-9 * np.abs(expected).max()
    )


def test_no_gravity_is_none() -> None:
    assert mechanism_of(read(MODELS["no gravity"])).gravity is None


# -- equalities of joints ----------------------------------------------------------------------------------------------

CHAIN = f"""
    <body name="a"><joint name="a" axis="0 1 0"/>{INERTIA}
      <body name="b" pos="0.3 0 0"><joint name="b" axis="0 1 0" ref="20"/>{INERTIA}
        <body name="c" pos="0.3 0 0"><joint name="c" type="slide" axis="1 1 0" ref="0.1"/>{INERTIA}
          <body name="d" pos="0.2 0 0"><joint name="d" axis="1 0 0" pos="0 0 0.1"/>{INERTIA}</body>
    </body></body></body>"""


def coupled_efforts(
    text: str, mechanism: Mechanism, T: np.ndarray, q0: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Efforts of a coupled mechanism: ours, and MuJoCo's at q = T θ + q₀ projected with Tᵀ."""
    q, qd, qdd = random_states(mechanism, 5)
    found = float_regressor(mechanism, q, qd, qdd) @ standard_vector(mechanism)
    return found, simulated_inverse_dynamics(
        text, q @ T.T + q0, qd @ T.T, qdd @ T.T
    ) @ T


def test_coupled_joints() -> None:
    equality = (
        '<equality><joint joint1="b" joint2="a" polycoef="0.3 -2 0 0 0"/>'
        '<joint name="chain" joint1="c" joint2="b" polycoef="0.05 0.5 0 0 0"/></equality>'
    )
    text = model(CHAIN, tail=equality)
    mechanism = mechanism_of(read(text))
    assert mechanism.velocities == ("a", "d")
    ref = np.deg2rad(20)
    T = np.array([[1.0, 0], [-2, 0], [-1, 0], [0, 1]])
    q0 = np.array([0, ref + 0.3, 0.1 + 0.05 + 0.5 * 0.3, 0])
    found, expected = coupled_efforts(text, mechanism, T, q0)
    np.testing.assert_allclose(
        found, expected, rtol=0, atol=1e-9 * np.abs(expected).max()
    )


def test_a_joint_follows_by_a_polynomial() -> None:
    """As a knee's slide follows its angle; degree four, about reference positions, and a follower of the follower."""
    a = np.array([0.05, -0.3, 0.4, 0.2, -0.1])
    equality = (
        f'<equality><joint joint1="c" joint2="b" polycoef="{" ".join(map(str, a))}"/>'
        '<joint joint1="d" joint2="c" polycoef="0.2 3 -2 0 0"/></equality>'
    )
    text = model(CHAIN, tail=equality)
    mechanism = mechanism_of(read(text))
    assert mechanism.velocities == ("a", "b")
    q, qd, qdd = random_states(mechanism, 5)
    first, second = np.polynomial.Polynomial(a), np.polynomial.Polynomial([0.2, 3, -2])
    x = q[:, 1] - np.deg2rad(20)
    functions = [first, second(first)]
    T = np.zeros((5, 4, 2))
    T[:, 0, 0] = T[:, 1, 1] = 1
    T[:, 2:, 1] = np.transpose([f.deriv()(x) for f in functions])
    positions = np.column_stack([q, 0.1 + first(x), functions[1](x)])
    moved = np.einsum("sij,sj->si", T, qdd)
    moved[:, 2:] += np.transpose([f.deriv(2)(x) for f in functions]) * qd[:, 1:] ** 2
    expected = simulated_inverse_dynamics(
        text, positions, np.einsum("sij,sj->si", T, qd), moved
    )
    found = float_regressor(mechanism, q, qd, qdd) @ standard_vector(mechanism)
    expected = np.einsum("sij,si->sj", T, expected)
    np.testing.assert_allclose(
        found, expected, rtol=0, atol=1e-9 * np.abs(expected).max()
    )


def test_tendons_couple_joints() -> None:
    """Lengths of fixed tendons as linear relations; those that no actuator drives follow, the last one first."""
    tendons = (
        '<tendon><fixed name="t"><joint joint="a" coef="1"/><joint joint="b" coef="2"/></fixed>'
        '<fixed name="u"><joint joint="c" coef="-4"/></fixed>'
        '<fixed name="v"><joint joint="b" coef="1"/><joint joint="d" coef="-1"/></fixed></tendon>'
        '<actuator><motor joint="b"/></actuator>'
        '<equality><tendon tendon1="t" tendon2="u" polycoef="0.1 -0.5 0 0 0"/><tendon tendon1="v"/></equality>'
    )
    mechanism = mechanism_of(read(model(CHAIN, tail=tendons)))
    # a + 2 (b - b0) = 0.1 + 2 (c - c0), and b - b0 = d
    assert mechanism.velocities == ("a", "b")
    T = np.array([[1.0, 0], [0, 1], [0.5, 1], [0, 1]])
    b0 = np.deg2rad(20)
    q0 = np.array([0, 0, 0.1 - 0.05 - b0, -b0])
    found, expected = coupled_efforts(model(CHAIN, tail=tendons), mechanism, T, q0)
    np.testing.assert_allclose(
        found, expected, rtol=0, atol=1e-9 * np.abs(expected).max()
    )


def test_a_tendon_of_one_joint_holds_it() -> None:
    tendon = '<tendon><fixed name="t"><joint joint="b" coef="2"/></fixed></tendon>'
    text = model(
        CHAIN,
        tail=tendon
        + '<equality><tendon tendon1="t" polycoef="0.6 0 0 0 0"/></equality>',
    )
    held = '<equality><joint joint1="b" polycoef="0.3 0 0 0 0"/></equality>'
    assert (
        mechanism_of(read(text)).bodies
        == mechanism_of(read(model(CHAIN, tail=held))).bodies
    )
    ignored = read(text, mimics=False)
    assert mechanism_of(ignored).velocities == ("a", "c", "d")


def test_a_tendon_that_says_nothing_new_is_noted() -> None:
    tendon = (
        '<tendon><fixed name="t"><joint joint="b" coef="2"/><joint joint="a" coef="-6"/></fixed></tendon>'
        '<equality><joint joint1="b" joint2="a" polycoef="0 3 0 0 0"/><tendon tendon1="t"/></equality>'
    )
    tree = read(model(CHAIN, tail=tendon))
    assert mechanism_of(tree).velocities == ("a", "c", "d")
    assert "equality tendon 't' follows from the other equalities" in tree.notes


def test_a_tendon_follows_a_single_joint_by_a_polynomial() -> None:
    tendon = (
        '<tendon><fixed name="t"><joint joint="a" coef="2"/></fixed>'
        '<fixed name="u"><joint joint="d" coef="0.5"/></fixed></tendon>'
        '<equality><tendon tendon1="t" tendon2="u" polycoef="0 1 0 2 0"/></equality>'
    )
    same = '<equality><joint joint1="a" joint2="d" polycoef="0 0.25 0 0.125 0"/></equality>'
    found, expected = (
        mechanism_of(read(model(CHAIN, tail=tail))) for tail in (tendon, same)
    )
    assert found.couplings == expected.couplings


def test_held_joints_are_fixed_where_the_equality_holds_them() -> None:
    equality = '<equality><joint joint1="b" polycoef="0.3 9 9 9 9"/><joint joint1="d" joint2="b"/></equality>'
    text = model(CHAIN, tail=equality)
    tree = read(text)
    assert [link.kind for link in tree.links] == [
        "root",
        "hinge",
        "fixed",
        "slide",
        "fixed",
    ]
    assert "joint 'd' is held by an equality and cannot move" in tree.notes
    mechanism = mechanism_of(tree)
    assert mechanism.velocities == ("a", "c")
    T = np.array([[1.0, 0], [0, 0], [0, 1], [0, 0]])
    found, expected = coupled_efforts(
        text, mechanism, T, np.array([0, np.deg2rad(20) + 0.3, 0, 0.3])
    )
    np.testing.assert_allclose(
        found, expected, rtol=0, atol=1e-9 * np.abs(expected).max()
    )


def test_couplings_can_be_ignored_but_held_joints_stay_held() -> None:
    equality = '<equality><joint joint1="b" joint2="a" polycoef="0 1 1 0 0"/><joint joint1="d"/></equality>'
    tree = read(model(CHAIN, tail=equality), mimics=False)
    assert tree.couplings == ()
    assert mechanism_of(tree).velocities == ("a", "b", "c")


def test_inactive_equalities_are_ignored_with_a_note() -> None:
    equality = (
        '<equality><joint name="off" joint1="b" joint2="a" active="false" polycoef="0 0 1 0 0"/>'
        '<connect body1="a" body2="d" anchor="0 0 0" active="false"/></equality>'
    )
    tree = read(model(CHAIN, tail=equality))
    assert tree.couplings == ()
    assert "equality joint 'off' is ignored: it is not active" in tree.notes
    assert "equality connect 'a and d' is ignored: it is not active" in tree.notes
