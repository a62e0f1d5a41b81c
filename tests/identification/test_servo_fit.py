"""Servo gains, friction and base parameters from positions and commands: truth is planted in MuJoCo."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import echelon as ec
from echelon.identification.logs.recording import Segment
from echelon.identification.servos.output_error import OutputErrorProblem
from echelon.identification.servos.servo_fit import ServoScore, scale_groups
from echelon.identification.servos.servo_limits import Limits
from echelon.identification.servos.servo_motion import ServoMotion, Windows, smooth
from echelon.identification.servos.servo_start import positive_parameters, servo_joints
from support import servo_arms
from support.command_line import run
from support.paths import EXAMPLES
from support.selection import slow_unless

SETUP = EXAMPLES / "logs" / "so101.yaml"
PENDULUM = """<robot name="swing"><link name="base"/>
<link name="upper"><inertial><origin xyz="0.1 0 0"/><mass value="0.2"/>
<inertia ixx="1e-4" ixy="0" ixz="0" iyy="8e-4" iyz="0" izz="8e-4"/></inertial></link>
<link name="lower"><inertial><origin xyz="0.08 0 0.01"/><mass value="0.12"/>
<inertia ixx="5e-5" ixy="0" ixz="0" iyy="4e-4" iyz="0" izz="4e-4"/></inertial></link>
<joint name="lift" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" effort="3" velocity="5"/></joint>
<joint name="bend" type="revolute"><origin xyz="0.2 0 0"/><parent link="upper"/><child link="lower"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" effort="3" velocity="5"/></joint></robot>"""


def two_joints(folder: Path) -> ec.Setup:
    (folder / "swing.urdf").write_text(PENDULUM)
    text = SETUP.read_text().replace("../so101.urdf", "swing.urdf")
    (folder / "swing.yaml").write_text(text)
    return ec.load_setup(folder / "swing.yaml")


def fitted(
    folder: Path, setup: ec.Setup, urdf: Path, seed: int, seconds: float, *, known: int
) -> tuple[ec.ServoFit, np.ndarray]:
    """A fit to a simulated log, and the true base parameters."""
    rng = np.random.default_rng(seed)
    arm = servo_arms.servo_arm(urdf, rng)
    u = servo_arms.commands(arm, seconds, rng)
    log = servo_arms.written(folder, arm.names, servo_arms.simulated(arm, u, 0.025), u)
    setup = setup.with_settings(known={f"Kp{known}": float(arm.gains[known - 1])})
    fit = ec.fit_servos(setup, [log])
    return fit, fit.base.values(servo_arms.true_standard(arm, setup.mechanism))


@pytest.mark.slow
def test_planted_truth_of_two_servos(tmp_path: Path) -> None:
    setup = two_joints(tmp_path)
    fit, truth = fitted(tmp_path, setup, tmp_path / "swing.urdf", 4, 16.0, known=1)
    assert fit.converged
    # what is left is what encoders of 4096 steps cut off
    assert max(
        score.rms for score in fit.held_out
    ) < 1.4 * servo_arms.ENCODER / np.sqrt(12)
    error = np.abs(fit.estimate.values - truth)
    assert (error <= 4 * fit.estimate.std + 1e-12).all()
    gains = [fit.base.pivots.index(name) for name in ("Kp1", "Kp2", "Fv1", "Fv2")]
    assert np.allclose(fit.estimate.values[gains], truth[gains], rtol=0.03)
    assert abs(fit.delay - 0.025) < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("seed", [3, 4])
def test_planted_truth_of_the_so101(tmp_path: Path, seed: int) -> None:
    fit, truth = fitted(
        tmp_path, ec.load_setup(SETUP), EXAMPLES / "so101.urdf", seed, 40.0, known=1
    )
    z = (fit.estimate.values - truth) / np.maximum(fit.estimate.std, 1e-12)
    assert fit.converged
    assert max(
        score.rms for score in fit.held_out
    ) < 1.2 * servo_arms.ENCODER / np.sqrt(12)
    assert (
        np.mean(np.abs(z) < 2) > 0.8
    )  # one joint's scale, in all of its parameters, may be off together
    assert np.abs(z).max() < 4


@pytest.mark.parametrize("every", slow_unless([5], [1, 5]))
def test_derivatives_are_those_of_the_computed_motion(
    tmp_path: Path, every: int
) -> None:
    """By every parameter, or by some, and by the delay."""
    setup = two_joints(tmp_path)
    base = ec.base_parameters(setup.mechanism)
    rng = np.random.default_rng(1)
    arm = servo_arms.servo_arm(tmp_path / "swing.urdf", rng)
    names = setup.mechanism.velocities
    u = servo_arms.commands(arm, 2.0, rng)
    segment = Segment("", 0.0, 30.0, {"q": u}, dict(zip(names, u.T, strict=True)))
    windows = Windows((segment,), np.array([[0, 3]]), 4, 20, 30.0)
    servos = servo_joints(setup.mechanism)
    places = tuple(base.pivots.index(servos[name]) for name in names)
    motion = ServoMotion(
        replace(base, mechanism=smooth(setup.mechanism, 0.1)), names, places
    )
    values, delay = base.values(servo_arms.true_standard(arm, setup.mechanism)), 0.013
    slopes = motion.derivatives(windows, values, delay)[1]
    for k, step in [
        *list(enumerate(np.maximum(1e-5 * np.abs(values), 1e-8)))[::every],
        (len(values), 1e-6),
    ]:
        moved = np.zeros(len(values) + 1)
        moved[k] = step
        after, before = (
            motion.positions(windows, values + s * moved[:-1], delay + s * moved[-1])
            for s in (1, -1)
        )
        assert np.allclose(
            slopes[..., k],
            (after - before) / (2 * step),
            rtol=1e-4,
            atol=1e-5 * np.abs(slopes).max(),
        )


def test_joints_that_share_no_parameter_have_scales_of_their_own(
    tmp_path: Path,
) -> None:
    assert scale_groups(two_joints(tmp_path).mechanism) == (("lift", "bend"),)
    cart = ec.load(EXAMPLES / "cart_pole.yaml")
    assert scale_groups(cart) == (tuple(output.name for output in cart.outputs),)
    apart = """
echelon: 1
name: apart
bodies:
  - {name: left, joint: {name: a, type: revolute, axis: y}}
  - {name: right, joint: {name: b, type: revolute, axis: y, origin: {xyz: [1, 0, 0]}}}
"""
    (tmp_path / "apart.yaml").write_text(apart)
    assert scale_groups(ec.load(tmp_path / "apart.yaml")) == (("a",), ("b",))


def test_joints_without_a_servo_are_named(tmp_path: Path) -> None:
    (tmp_path / "swing.urdf").write_text(PENDULUM)
    text = (
        SETUP.read_text()
        .replace("../so101.urdf", "swing.urdf")
        .replace("servo, at: all", "servo, at: [lift]")
    )
    (tmp_path / "swing.yaml").write_text(text)
    with pytest.raises(ec.InputError, match="joints bend have no servo"):
        ec.fit_servos(ec.load_setup(tmp_path / "swing.yaml"), [])


@pytest.mark.slow
def test_identify_finds_ratios_and_says_that_the_scale_is_the_files(
    tmp_path: Path,
) -> None:
    mechanism = two_joints(tmp_path).mechanism
    rng = np.random.default_rng(5)
    arm = servo_arms.servo_arm(tmp_path / "swing.urdf", rng)
    u = servo_arms.commands(arm, 16.0, rng)
    log = servo_arms.written(tmp_path, arm.names, servo_arms.simulated(arm, u), u)
    found = run(
        "identify", str(tmp_path / "swing.yaml"), str(log), "-o", str(tmp_path / "out")
    )
    assert found.returncode == 0, found.stderr
    assert "damping gains" in found.stdout
    document = json.loads((tmp_path / "out" / "servos.json").read_text())
    values = {entry["name"]: entry["value"] for entry in document["parameters"]}
    std = {entry["name"]: entry["std"] for entry in document["parameters"]}
    base = ec.base_parameters(mechanism)
    assert tuple(values) == base.pivots
    truth = dict(
        zip(
            base.pivots,
            base.values(servo_arms.true_standard(arm, mechanism)),
            strict=True,
        )
    )
    scale = values["Kp1"] / truth["Kp1"]
    assert abs(scale - 1) > 0.02  # the file's masses are not the arm's
    for name in ("Fv1", "Kp2", "Fv2"):
        assert (
            abs(values[name] - scale * truth[name]) < 4 * std[name] < 0.3 * values[name]
        )
    assert any(
        "only ratios of masses, friction and gains of all joints" in text
        for text in document["hidden"]
    )


def test_a_lag_that_the_model_does_not_explain_speaks_against_it() -> None:
    """Positions near their commands have a high R² whatever the servo does."""
    score = ServoScore("lift", 0.03, 0.997, 0.71, 0.0015)
    assert score.lags
    assert not replace(score, rms=0.001).lags  # steps of the encoder
    assert not replace(score, lag_r2=0.95).lags


LIMITS = {
    "torque": {"torque": np.array([0.05, np.inf])},
    "dead": {"dead": np.array([0.0, 0.05])},
    "speed": {"speed": np.array([0.7, np.inf])},
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", LIMITS)
def test_limits_of_servos_are_found_and_do_not_spoil_the_rest(
    kind: str, tmp_path: Path
) -> None:
    setup, rng = two_joints(tmp_path), np.random.default_rng(6 if kind == "dead" else 5)
    arm = servo_arms.servo_arm(tmp_path / "swing.urdf", rng)
    u = servo_arms.commands(arm, 20.0, rng)
    log = servo_arms.written(
        tmp_path, arm.names, servo_arms.simulated(arm, u, 0.025, **LIMITS[kind]), u
    )
    fit = ec.fit_servos(setup.with_settings(known={"Kp1": float(arm.gains[0])}), [log])
    (limit,) = fit.limits
    joint = arm.names.index(limit.joint)
    planted = float(LIMITS[kind][kind][joint])
    assert limit.kind == kind
    assert limit.value == pytest.approx(planted, rel=0.01)
    assert not fit.reasons
    assert any(limit.joint in str(finding) for finding in fit.findings)
    truth = fit.base.values(servo_arms.true_standard(arm, setup.mechanism))
    gains = [fit.base.pivots.index(name) for name in ("Kp2", "Fv1", "Fv2")]
    assert np.allclose(fit.estimate.values[gains], truth[gains], rtol=0.05)
    z = (fit.estimate.values - truth) / np.maximum(fit.estimate.std, 1e-12)
    assert np.abs(z).max() < 3.5
    assert abs(limit.value - planted) < 3.5 * limit.std


@pytest.mark.slow
@pytest.mark.parametrize(
    ("limit", "seed", "least"), [(0.15, 11, 0.88), (0.1, 21, 0.95)]
)
def test_intervals_beside_a_torque_limit_hold(
    limit: float, seed: int, least: float, tmp_path: Path
) -> None:
    """Also where servos pull as hard as they can most of the time, so that they do not mend how windows begin."""
    setup, rng, limits = (
        two_joints(tmp_path),
        np.random.default_rng(seed),
        Limits.none(2).having("torque", 0, limit),
    )
    base, names = ec.base_parameters(setup.mechanism), setup.mechanism.velocities
    places = tuple(
        base.pivots.index(servo_joints(setup.mechanism)[name]) for name in names
    )
    known, z = np.eye(base.rank)[[places[0]]], []
    for _ in range(4):
        arm = servo_arms.servo_arm(tmp_path / "swing.urdf", rng)
        u = servo_arms.commands(arm, 20.0, rng)
        q = servo_arms.simulated(arm, u, 0.025, torque=limits.torque)
        segment = Segment("", 0.0, 30.0, {"q": q}, dict(zip(names, u.T, strict=True)))
        windows = Windows(
            (segment,),
            np.array([(0, b) for b in range(0, len(q) - 61, 30)]),
            30,
            30,
            30.0,
        )
        motion = ServoMotion(
            replace(base, mechanism=smooth(setup.mechanism, 0.005)), names, places
        )
        truth = base.values(servo_arms.true_standard(arm, setup.mechanism))
        prior, positive = np.zeros((0, base.rank)), positive_parameters(base)
        found = OutputErrorProblem(
            motion, windows, truth, 0.025, limits, positive, prior, known
        ).solve(lambda _: None)
        error = np.concatenate(
            [found.values - truth, [found.delay - 0.025], found.limits.values - limit]
        )
        z.append(error / np.maximum(np.sqrt(np.diagonal(found.covariance)), 1e-12))
    # three quarters where commands are averaged before their limit; one arm's errors hardly reach it, which is no fault
    assert np.mean(np.abs(z) < 2) > least


@pytest.mark.parametrize("corner", [0.0, 0.05])
def test_limits_of_servos_have_exact_derivatives(corner: float) -> None:
    limits = Limits(
        np.array([0.2, np.inf]), np.array([0.03, 0.01]), np.array([np.inf, 1.5]), corner
    )
    error, tiny = np.random.default_rng(0).normal(0, 0.2, (500, 2)), 1e-7
    pull = limits.pull(error)
    numeric = (limits.pull(error + tiny).value - limits.pull(error - tiny).value) / (
        2 * tiny
    )
    assert np.allclose(pull.by_error, numeric, atol=1e-4)
    asked = np.cumsum(np.random.default_rng(1).normal(0, 0.05, (40, 2)), axis=0)
    for kind, joint in limits.active:
        up, down = (
            limits.having(kind, joint, getattr(limits, kind)[joint] + s * tiny)
            for s in (1, -1)
        )
        if kind == "speed":
            numeric = (
                up.followed(asked, 30.0, 7)[0] - down.followed(asked, 30.0, 7)[0]
            ) / (2 * tiny)
            assert np.allclose(limits.followed(asked, 30.0, 7)[1], numeric, atol=1e-4)
            assert (
                np.abs(np.diff(limits.followed(asked, 30.0, 7)[0][:, joint])).max()
                < 2 * 1.5 / 210
            )
        else:
            numeric = (up.pull(error).value - down.pull(error).value) / (2 * tiny)
            found = {"torque": pull.by_torque, "dead": pull.by_dead}[kind]
            assert np.allclose(found[:, joint], numeric[:, joint], atol=1e-3)
    assert np.abs(pull.value[:, 0]).max() < 0.2 + 1e-12
    assert np.abs(limits.pull(np.full((1, 2), 0.005)).value).max() < (
        1e-3 if corner else 1e-12
    )
