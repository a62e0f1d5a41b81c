"""Designed trajectories as a whole: limits by the formula of the file, the best value, seeds, and what is refused."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import echelon as ec
from echelon.excite.excite import ExcitingTrajectory
from echelon.excite.problem.trajectory import Fourier, Trajectory
from echelon.excite.solve.design import Searched
from echelon.excite.solve.solver import Search
from support.paths import EXAMPLES
from support.resampled_motions import Floats, evaluated, resampled

PENDULUM = EXAMPLES / "double_pendulum.yaml"
SWING: dict[str, Any] = {
    "criterion": "d_optimal",
    "duration": 6,
    "limits": {"position": [-2, 2], "velocity": 3},
}
FAMILIES = ("fourier", "bspline", "sum")


def design(file: Path, **changes: Any) -> ExcitingTrajectory:
    return ec.exciting_trajectory(ec.load_setup(file), **{"starts": 1, **changes})


@cache
def swung(family: str) -> ExcitingTrajectory:
    return design(PENDULUM, family=family, **SWING)


# -- limits of the motion ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("family", FAMILIES)
def test_every_family_keeps_its_limits_between_samples_and_uses_them(
    family: str,
) -> None:
    found = swung(family)
    assert found.safe
    limits = [
        2.0,
        3.0,
        30.0,
        600.0,
    ]  # the last two are defaults: full speed in 0.1 s, full acceleration in 0.05 s
    reached = [np.abs(resampled(found, order)).max(axis=0) for order in range(4)]
    for limit, values in zip(limits, reached, strict=True):
        assert np.all(values <= limit)
    assert np.all(reached[1] >= 0.98 * 3)
    assert reached[0].max() >= 0.98 * 2


@pytest.mark.parametrize("family", FAMILIES)
def test_every_family_begins_and_ends_at_rest(family: str) -> None:
    for order in (1, 2):
        values = resampled(swung(family), order)
        largest = np.abs(values).max()
        assert np.abs(values[[0, -1]]).max() <= 1e-9 * largest
        assert largest > 1


@pytest.mark.parametrize("family", FAMILIES)
def test_margins_hold_what_is_reached_and_little_more(family: str) -> None:
    found = swung(family)
    for k, margin in enumerate(found.margins):
        order, coordinate = divmod(k, 2)
        values = resampled(found, order)[:, coordinate]
        wider = 0.01 * (margin.high - margin.low)
        assert values.min() - wider <= margin.least <= values.min() + 1e-12
        assert values.max() - 1e-12 <= margin.largest <= values.max() + wider
    assert [m.label for m in found.margins[2:4]] == ["velocity of j1", "velocity of j2"]


def test_acceleration_and_jerk_limits_bind_and_hold() -> None:
    limits = {
        "position": [-2, 2],
        "velocity": 3,
        "acceleration": 4,
        "jerk": {"j1": 12, "j2": "none"},
    }
    found = design(PENDULUM, duration=6, limits=limits)
    rates, jerks = (np.abs(resampled(found, order)).max(axis=0) for order in (2, 3))
    assert np.all(rates <= 4)
    assert rates.max() >= 0.98 * 4
    assert 0.98 * 12 <= jerks[0] <= 12
    assert not [m for m in found.margins if m.label == "jerk of j2"]


COUPLED = """
echelon: 1
name: differential
symbols: {l1: 0.4, l2: 0.3}
gravity: [0, 0, -9.81]
modified_dh:
  - {joint: revolute}
  - {joint: revolute, alpha: pi/2, a: l1}
  - {joint: revolute, alpha: -pi/2, a: l2}
actuators: {m1: -50*j1, m2: 20*j2 + 30*j3, m3: 20*j2 - 30*j3}
effects: [{type: viscous, at: all}, {type: coulomb, at: all}, {type: rotor_inertia, at: all}]
excitation:
  duration: 5
  limits: {position: [-2, 2], velocity: {all: 2, m2: 60}, acceleration: {all: 12, m3: 150}, jerk: none}
"""


@pytest.mark.slow
def test_limits_of_motors_hold_through_a_transmission(tmp_path: Path) -> None:
    (tmp_path / "arm.yaml").write_text(COUPLED)
    found = design(tmp_path / "arm.yaml")
    assert found.safe
    velocity, acceleration = (resampled(found, order) for order in (1, 2))
    motor = np.abs(velocity @ [0, 20, 30])
    assert 0.98 * 60 <= motor.max() <= 60
    assert np.abs(acceleration @ [0, 20, -30]).max() <= 150
    assert np.abs(velocity).max() <= 2
    assert np.isfinite(found.conditioning.condition)


# -- what the trajectory shows -----------------------------------------------------------------------------------------


def pendulum_rows(q: Floats, qd: Floats, qdd: Floats) -> Floats:
    """Rows of both torques by ZZ1 + l1²·M2, MX1 + l1·M2, MY1, ZZ2, MX2, MY2: Lagrange's equations by hand."""
    l1, g = 0.3, 9.81
    (q1, q2), (v1, v2), (a1, a2) = q.T, qd.T, qdd.T
    c1, s1, c12, s12 = np.cos(q1), np.sin(q1), np.cos(q1 + q2), np.sin(q1 + q2)
    zero = np.zeros_like(q1)
    both = a1 + a2
    # MX2: the kinetic energy holds l1·v1·(v1 + v2)·cos q2, MY2 the same with −sin q2; potential energy by heights
    mx = (
        l1 * (np.cos(q2) * (2 * a1 + a2) - np.sin(q2) * (2 * v1 * v2 + v2**2)) + g * c12
    )
    my = (
        l1 * (-np.sin(q2) * (2 * a1 + a2) - np.cos(q2) * (2 * v1 * v2 + v2**2))
        - g * s12
    )
    mx2 = l1 * (np.cos(q2) * a1 + np.sin(q2) * v1**2) + g * c12
    my2 = l1 * (-np.sin(q2) * a1 + np.cos(q2) * v1**2) - g * s12
    first = np.stack([a1, g * c1, -g * s1, both, mx, my], axis=1)
    second = np.stack([zero, zero, zero, both, mx2, my2], axis=1)
    return np.stack([first, second], axis=1)


def observation(found: ExcitingTrajectory, rate: float = 100.0) -> Floats:
    count = round(found.trajectory.duration * rate)
    states = [resampled(found, order, rate)[:count] for order in range(3)]
    return pendulum_rows(*states).reshape(-1, 6)


def test_conditioning_and_deviations_are_those_of_equations_by_hand() -> None:
    found = design(PENDULUM, noise={"j1": 0.5, "j2": 0.1}, **SWING)
    W = observation(found) / np.tile([0.5, 0.1], 600)[:, None]
    scaled = W / np.linalg.norm(W, axis=0)
    assert found.conditioning.condition == pytest.approx(np.linalg.cond(W), rel=1e-9)
    assert found.conditioning.scaled_condition == pytest.approx(
        np.linalg.cond(scaled), rel=1e-9
    )
    assert found.conditioning.log_det == pytest.approx(
        np.linalg.slogdet(W.T @ W)[1], rel=1e-9
    )
    expected = np.sqrt(np.diag(np.linalg.inv(W.T @ W)))
    np.testing.assert_allclose(
        sorted(found.conditioning.std), sorted(expected), rtol=1e-9
    )
    assert found.conditioning.over_time[-1][1] == pytest.approx(
        found.conditioning.scaled_condition
    )


def test_information_at_hand_is_complemented() -> None:
    """A motion need not show parameters known already: it shows more of the others than one designed for all."""
    known = 1e6 * np.diag([1.0, 1, 1, 0, 0, 0])
    plain, found = swung("fourier"), design(PENDULUM, prior_information=known, **SWING)
    assert [
        found.base.mechanism.parameters[k] for k in found.base.matrix.pivots[:3]
    ] == ["ZZ1", "MX1", "MY1"]
    assert found.safe
    new, old = (
        np.linalg.slogdet(W.T @ W + known)[1] for W in map(observation, (found, plain))
    )
    assert found.conditioning.log_det == pytest.approx(new, rel=1e-9)
    assert new > old + 0.01


# -- the search --------------------------------------------------------------------------------------------------------


def test_the_best_value_only_falls_and_is_always_that_of_a_motion_within_limits(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    taken: list[tuple[float, Floats]] = []
    remember = Search._remember

    def spied(self: Search) -> None:
        remember(self)
        problem = self.now.problem
        before = [value for value, _ in taken]
        if self.best is self.now.x and self.history[-1] < min(before, default=np.inf):
            taken.append(
                (
                    self.history[-1],
                    problem.basis.matrix @ self.now.x.reshape(problem.shape),
                )
            )  # type: ignore[attr-defined]

    monkeypatch.setattr(Search, "_remember", spied)
    found = design(PENDULUM, harmonics=5, **SWING)
    (start,) = found.starts
    assert len(start.history) > 5
    assert np.all(np.diff(start.history) < 0)
    assert start.value == start.history[-1]
    assert [value for value, _ in taken[: len(start.history)]] == list(start.history)
    names = list(found.trajectory.coordinates)
    for value, C in taken[: len(start.history)]:
        columns = {
            name: {"constant": c[0], "sin": c[1::2], "cos": c[2::2]}
            for name, c in zip(names, C.T, strict=True)
        }
        motion = {
            "family": "fourier",
            "duration": 6.0,
            "harmonics": 5,
            "coefficients": columns,
        }
        samples = np.linspace(0, 6, 101)  # twenty of every period of the fifth harmonic
        for order, limit in enumerate((2.0, 3.0, 30.0, 600.0)):
            assert np.abs(evaluated(motion, names, samples, order)).max() <= limit * (
                1 + 3e-6
            )
        t = np.arange(600) / 100
        W = pendulum_rows(
            *(evaluated(motion, names, t, order) for order in range(3))
        ).reshape(-1, 6)
        assert value == pytest.approx(-np.linalg.slogdet(W.T @ W)[1] / 6, rel=1e-9)


def test_equal_seeds_give_equal_bits_and_others_others() -> None:
    told: list[str] = []
    one = design(PENDULUM, starts=2, seed=7, on_step=told.append, **SWING)
    two = design(PENDULUM, starts=2, seed=7, **SWING)
    assert (
        one.trajectory.coefficients.tobytes() == two.trajectory.coefficients.tobytes()
    )
    assert [s.history for s in one.starts] == [s.history for s in two.starts]
    assert len(one.starts) == 2
    other = design(PENDULUM, seed=8, **SWING)
    assert (
        one.trajectory.coefficients.tobytes() != other.trajectory.coefficients.tobytes()
    )
    # several starts give the best of them
    best = min(start.value for start in one.starts)
    W = observation(one)
    # limits that hold between samples cost a little
    assert -np.linalg.slogdet(W.T @ W)[1] / 6 == pytest.approx(best, abs=0.02)
    assert {text.partition(":")[0] for text in told if "start" in text} >= {
        "start 1 of 2",
        "start 2 of 2",
    }


def test_a_search_ends_when_its_work_is_done_or_somebody_asks_and_its_motion_is_safe() -> (
    None
):
    asked = 0

    def stopped() -> bool:
        nonlocal asked
        asked += 1
        return asked > 5

    early = design(PENDULUM, stopped=stopped, **SWING)
    assert early.starts[0].iterations <= 6
    assert early.starts[0].status == "stopped"
    poor = design(PENDULUM, budget=0.05, **SWING)
    assert poor.starts[0].status == "budget"
    again = design(PENDULUM, budget=0.05, **SWING)
    assert (
        again.trajectory.coefficients.tobytes()
        == poor.trajectory.coefficients.tobytes()
    )
    for found in (early, poor):
        assert found.safe
        assert np.abs(resampled(found, 1)).max() <= 3
        assert any(
            "the search ended early" in finding.text for finding in found.findings
        )
    best = swung("fourier")
    assert best.starts[0].iterations > early.starts[0].iterations


def test_the_best_of_random_motions_stands_beside_the_result() -> None:
    found = swung("fourier")
    assert found.chance is not None
    assert found.chance.count == 24
    assert found.conditioning.scaled_condition < found.chance.scaled_condition
    assert max(found.conditioning.std) < found.chance.worst_std
    assert found.conditioning.std[found.conditioning.worst] == max(
        found.conditioning.std
    )


def test_few_iterations_still_give_a_safe_trajectory() -> None:
    found = design(EXAMPLES / "panda.yaml", iterations=3, limits={"velocity": 2})
    assert found.starts[0].status == "iterations"
    assert found.safe
    assert np.abs(resampled(found, 1)).max() <= 2
    assert np.abs(resampled(found, 0)).max() <= np.pi
    assert np.isfinite(found.conditioning.condition)


@pytest.mark.slow
def test_a_start_that_breaks_limits_between_samples_loses_little_when_made_safe() -> (
    None
):
    """Limits of points are tightened after the search; the motion must not be thrown away for it."""
    arm = {
        "frames": [
            {"body": "j6", "radius": 0.1, "box": {"z": [0.3, 1.2], "x": [-0.6, 0.6]}}
        ]
    }
    limits = {"position": [-2.5, 2.5], "velocity": 2.5}
    found = design(
        EXAMPLES / "ur10.yaml", duration=6, centre={"j2": -1.57}, limits=limits, **arm
    )
    assert found.safe
    lost = -found.conditioning.log_det / found.base.rank - found.starts[0].value
    assert abs(lost) < 0.2


def test_nothing_is_unlimited_unless_it_is_said() -> None:
    found = design(PENDULUM, duration=6, iterations=20)
    assert [m.high for m in found.margins] == pytest.approx(
        [np.pi] * 2 + [1.0] * 2 + [10.0] * 2 + [200.0] * 2
    )
    text = "\n".join(map(str, found.findings))
    for kind, value in {
        "position": "−π to π", "velocity": "1 rad/s", "acceleration": "10 rad/s²", "jerk": "200 rad/s³",
    }.items():  # fmt: skip
        assert f"no {kind} limits are stated; these are used: j1, j2 {value}" in text
    assert "no limits of torques or forces" in text
    assert "collisions are not checked" in text


# -- what is refused ---------------------------------------------------------------------------------------------------

ARM = """
echelon: 1
name: arm
symbols: {l1: 0.4, l2: 0.3}
gravity: [0, 0, -9.81]
modified_dh:
  - {joint: revolute, inertial: {mass: 4, com: [0.1, 0, 0], inertia: {xx: 0.1, yy: 0.1, zz: 0.1}}}
  - {joint: revolute, alpha: pi/2, a: l1, inertial: {mass: 3, com: [0.2, 0, 0], inertia: {xx: 0.1, yy: 0.1, zz: 0.1}}}
  - {joint: KIND, a: l2, inertial: {mass: 2, com: [0.15, 0, 0], inertia: {xx: 0.1, yy: 0.1, zz: 0.1}}}
"""
POINT = "{body: j3, point: [0.1, 0, 0], "
BALL = "collisions: {shapes: [{body: j3, sphere: 0.1}]"
POST = BALL + ", obstacles: [{name: post, box: [0.2, 0.2, 0.2], at: [0.7, 0, 0]}]}"
REFUSED = {
    "zero-length range": ("limits: {position: {j2: [1, 1]}}", "the position range of 'j2' has length zero"),
    "empty range": ("limits: {position: {j2: [1, 0]}}", r"position\.j2: the range is empty"),
    "unknown limit": ("limits: {velocity: {j22: 1}}", "no moving coordinate or actuator 'j22'; did you mean 'j2'"),
    "unknown moving": ("move: [j11]", "no coordinate 'j11'; did you mean 'j1'"),
    "unknown held": ("hold: {k1: 1}", r"no coordinate 'k1' \(valid: j1, j2, j3\)"),
    "unknown centre": ("centre: {k1: 1}", "there is no coordinate 'k1'"),
    "unknown output": ("noise: {j9: 1}", "there is no output 'j9'"),
    "unknown body": (f"frames: [{POINT.replace('j3', 'j33')}box: {{z: [0, none]}}}}]", "body 'j33'; did you mean 'j3'"),
    "unknown key": ("limit: {position: 1}", "unknown key; did you mean 'limits'"),
    "unknown criterion": ("criterion: c_optimal", "'c_optimal' is not valid; did you mean 'd_optimal'"),
    "infinite": ("limits: {velocity: .inf}", "not a finite number: write none"),
    "centre outside": ("centre: {j1: 4}", "the centre of 'j1' is outside of its position limits"),
    "pose in collision": (f"centre: {{j1: 0, j2: 0, j3: 0}}, {POST}", "pose at which motions start breaks .* j3"),
    "boxes that exclude each other": (
        f"frames: [{POINT}box: {{z: [0.2, none]}}}}, {POINT}above: {{normal: [0, 0, -1], offset: 0.1}}}}]",
        "none of 512 poses .* z of j3 at 0.1, 0, 0 and of height of j3 at 0.1, 0, 0 above .* together",
    ),
    "box out of reach": (f"frames: [{POINT}box: {{z: [2, none]}}}}]", "none of 512 poses .* limits of z of j3"),
    "gravity above the torque limit": (
        "limits: {position: {j2: [-0.5, 0.5], j3: [-0.5, 0.5]}, effort: {j2: 3}}",
        "none of 512 poses .* limits of torque of j2 .by .* at least",
    ),
    "everything held": ("hold: {j1: 0, j2: 0, j3: 0}", "nothing moves: every coordinate is held"),
    "degrees": ("limits: {position: [-180, 0]}", r"'j1', \[-180, 0\], is beyond 4π: ranges are in rad"),
    "obstacle that holds the base": (
        f"centre: {{j1: 0}}, {POST.replace('[0.7, 0, 0]', '[0, 0, 0]')}", "'post' holds the base: obstacles are solid"
    ),
    "plane upside down": (
        "collisions: {shapes: [{body: j3, sphere: 0.1}], obstacles: [{plane: [0, 0, -1], through: [0, 0, -0.3]}]}",
        r"the base is below 'plane 1', whose normal points away from it: write plane: \[0, 0, 1\]",
    ),
    "shape by name": (
        "collisions: {shapes: [{body: j3, sphere: 0.1}], obstacles: [{name: wall, box: [1, 1]}]}",
        r"obstacles\[0\]: 'wall': 'box' needs 3 numbers, got \[1.0, 1.0\] \(line \d+\)",
    ),
    "moved and held": ("move: [j1], hold: {j1: 1}", "'j1' moves and is held"),
}  # fmt: skip


def arm(folder: Path, section: str, kind: str = "revolute", extra: str = "") -> Path:
    text = ARM.replace("KIND", kind) + extra + f"excitation: {{{section}}}\n"
    (folder / "arm.yaml").write_text(text, encoding="utf-8")
    return folder / "arm.yaml"


def refusal(file: Path, **changes: Any) -> str:
    with pytest.raises(ec.InputError) as caught:
        design(file, **changes)
    text = str(caught.value)
    assert "\n" not in text
    assert len(text) < 500
    return text


@pytest.mark.parametrize(("section", "message"), REFUSED.values(), ids=REFUSED)
def test_what_cannot_be_designed_is_refused_in_one_clear_line(
    tmp_path: Path, section: str, message: str
) -> None:
    text = refusal(arm(tmp_path, section))
    assert re.search(message, text)
    assert "arm.yaml" in text


def test_what_slides_needs_a_range(tmp_path: Path) -> None:
    assert "'j3' is prismatic and has no position limits" in refusal(
        arm(tmp_path, "", "prismatic")
    )
    found = design(
        arm(tmp_path, "iterations: 20, limits: {position: {j3: [0, 0.2]}}", "prismatic")
    )
    assert [m.unit for m in found.margins if m.label == "velocity of j3"] == ["m/s"]
    assert [m.high for m in found.margins if m.label == "velocity of j3"] == [0.25]


def test_an_empty_base_set_is_refused(tmp_path: Path) -> None:
    text = """
echelon: 1
name: blind
modified_dh: [{joint: revolute}, {joint: revolute, alpha: pi/2}]
gravity: [0, 0, -9.81]
outputs: [{joint: j1}]
excitation: {move: [j2], limits: {velocity: 1}}
"""
    (tmp_path / "blind.yaml").write_text(text)
    assert "the base set is empty" in refusal(tmp_path / "blind.yaml")


def test_torque_limits_without_a_prior_model_are_refused() -> None:
    assert "limits of torques need inertial values" in refusal(
        PENDULUM, limits={"effort": 3}
    )


def test_changes_are_checked_like_the_section(tmp_path: Path) -> None:
    file = arm(tmp_path, "")
    assert re.search(
        r"excitation\.criterion: .*condition\)", refusal(file, criterion="c_optimal")
    )
    assert re.search(
        r"excitation: unknown key; did you mean 'duration'", refusal(file, durations=3)
    )
    assert "excitation.duration" in refusal(file, duration=-1)
    assert "expected a square matrix" in refusal(file, prior_information=[[np.nan]])
    assert "the robot has 15 base parameters" in refusal(
        file, prior_information=[[1.0]]
    )


MESH = """
<robot name="m"><link name="base"/><link name="a">
<inertial><mass value="1"/><origin xyz="0.1 0 0"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry><mesh filename="gone.stl"/></geometry></collision></link>
<joint name="j" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="100" velocity="2"/></joint></robot>
"""


def test_a_missing_mesh_matters_only_where_collisions_are_asked_for(
    tmp_path: Path,
) -> None:
    (tmp_path / "m.urdf").write_text(MESH)
    text = refusal(tmp_path / "m.urdf", collisions={})
    assert "collision of link 'a': mesh 'gone.stl' not found" in text
    assert design(tmp_path / "m.urdf", iterations=20).safe
    shapes = {"shapes": [{"body": "a", "sphere": 0.1}]}
    found = design(tmp_path / "m.urdf", iterations=20, collisions=shapes)
    assert any(
        "other shapes stand for their links: a" in finding.text
        for finding in found.findings
    )


def test_no_motion_at_all_is_an_error_that_names_the_limits(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("echelon.excite.excite.searched", lambda *_: Searched((), ()))
    assert (
        "no trajectory keeps all limits: no start found a motion that keeps them"
        in refusal(PENDULUM, **SWING)
    )


def test_what_is_stated_about_held_coordinates_is_of_no_consequence() -> None:
    setup = ec.load_setup(EXAMPLES / "double_pendulum.yaml")
    limits = {"position": {"all": [-1, 1]}, "velocity": {"j1": 2, "j2": 2}}
    found = ec.exciting_trajectory(
        setup, starts=1, move=["j2"], limits=limits, centre={"j1": 0.5}, iterations=20
    )
    assert found.trajectory.coordinates == ("j2",)
    with pytest.raises(
        ec.InputError, match="there is no moving coordinate or actuator 'j3'"
    ):
        ec.exciting_trajectory(
            setup, starts=1, move=["j2"], limits={"velocity": {"j3": 2}}
        )


def test_motions_of_little_use_are_warned_about() -> None:
    setup = ec.load_setup(EXAMPLES / "double_pendulum.yaml")
    still = Trajectory(("j1", "j2"), ("rad", "rad"), Fourier(4.0, 1), np.zeros((3, 2)))
    found = ec.judged_trajectory(setup, still)
    assert any(
        "does not determine all base parameters" in finding.text
        for finding in found.findings
    )
    assert found.safe


def test_dry_friction_above_the_limit_of_a_torque_is_refused_at_once(
    tmp_path: Path,
) -> None:
    text = MESH.replace(
        '<limit lower="-1"', '<dynamics friction="120"/><limit lower="-1"'
    )
    (tmp_path / "m.urdf").write_text(text)
    message = refusal(tmp_path / "m.urdf")
    assert "dry friction alone needs 120 N·m, and 90 N·m are allowed" in message
