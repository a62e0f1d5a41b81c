"""Mechanisms with loops: regressors and limits of independent coordinates, open loops, and exciting trajectories."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields as fields_of
from dataclasses import replace

import numpy as np
import pytest

import echelon as ec
from echelon.algebra.program.tape import Program
from echelon.dynamics.kinematics import Kinematics
from echelon.excite.excite import conditioning_of
from echelon.excite.problem.closed_loops import (
    Closed,
    LoopMotion,
    LoopRegressor,
    loop_limits,
)
from echelon.excite.problem.state_limits import (
    EffortLimit,
    EffortModel,
    PointLimit,
    effort_limits,
    point_limits,
)
from echelon.excite.problem.task import changed, task_of
from echelon.excite.problem.trajectory import Fourier, Trajectory, resting_ends
from echelon.excite.solve.design import designed
from echelon.excite.verify import loop_margins
from echelon.loops.assembly import Assembly
from echelon.loops.dependent_motion import DependentMotion
from support import linkages
from support.closed_motion import completed
from support.excitation_cases import slopes_by_state
from support.excitation_loops import (
    CASES,
    LOOPS,
    MECHANISMS,
    REDUNDANT,
    Floats,
    assert_slopes,
    base,
    certain,
    full,
    identified,
    mechanism,
    regressor,
    states,
)
from support.selection import slow_unless


@pytest.mark.parametrize("name", slow_unless(lambda name: name != "delta", CASES))
def test_states_are_those_of_the_assembly(name: str) -> None:
    motion, reference = LoopMotion(mechanism(name)), Assembly(mechanism(name))
    state = states(motion)
    closed = motion.positioned(state["q"])
    assert closed.done.all()
    rates = (
        motion.velocities(closed, state["qd"]),
        motion.run("closed_accelerations", **{**state, "q": closed.q}),
    )
    for mine, other in zip(
        (closed.q, *rates), completed(reference, *state.values()), strict=True
    ):
        np.testing.assert_allclose(
            mine, other, atol=1e-8 * max(np.abs(other).max(), 1.0)
        )


@pytest.mark.parametrize(
    "name", slow_unless(["slider-crank", "parallelogram"], MECHANISMS)
)
def test_entries_are_those_of_the_base_model(name: str) -> None:
    made = regressor(name)
    state = states(made.motion)
    expected = base(name).regressor(*state.values())
    X = full(made.entries(state), made, base(name).rank)
    np.testing.assert_allclose(X, expected, atol=1e-9 * np.abs(expected).max())
    assert made.size == sum(
        rows.entries.stop - rows.entries.start for rows in made.rows
    )


def test_redundant_equations_are_among_the_cases() -> None:
    for name in MECHANISMS:
        motion = DependentMotion(mechanism(name), Program())
        assert (len(motion.row_units) > len(motion.dependent)) == (name in REDUNDANT), (
            name
        )


@pytest.mark.parametrize(
    "name", slow_unless(["slider-crank", "parallelogram"], MECHANISMS)
)
def test_pulled_derivatives_are_those_of_differences(name: str) -> None:
    made = regressor(name, 0.02)
    state = states(made.motion)
    adjoint = np.random.default_rng(6).normal(size=(len(state["q"]), made.size))

    def total(q: Floats, qd: Floats, qdd: Floats) -> Floats:
        return np.sum(adjoint * made.entries({"q": q, "qd": qd, "qdd": qdd}), axis=1)

    found = dict(zip(state, made.pulled(state, adjoint), strict=True))
    for kind, step in (("q", 1e-4), ("qd", 1e-2), ("qdd", 1e-2)):
        expected = slopes_by_state(total, state, kind, step)
        assert_slopes(found[kind], expected, 1e-3)


@pytest.mark.parametrize(
    ("name", "made"),
    [
        ("four-bar", certain),
        ("four-bar", identified),
        ("slider-crank", certain),
        pytest.param("three_rps", certain, marks=pytest.mark.slow),
        pytest.param("three_rps", identified, marks=pytest.mark.slow),
        pytest.param("delta", identified, marks=pytest.mark.slow),
        pytest.param("gough_stewart", certain, marks=pytest.mark.slow),
    ],
)
def test_slopes_of_limits_are_those_of_differences(
    name: str, made: Callable[..., EffortModel]
) -> None:
    robot, rng = mechanism(name), np.random.default_rng(7)
    efforts = [EffortLimit(output.name, output.unit, 10.0) for output in robot.outputs]
    points = [
        PointLimit("p", body.name, (0.1, 0.2, 0.3), (0.6, 0.0, 0.8), -1.0, 1.0)
        for body in robot.bodies[-2:]
    ]
    limits = loop_limits(
        LoopMotion(robot),
        [
            effort_limits(robot, efforts, made(name, rng), 0.1, 0.02),
            point_limits(robot, points),
        ],
    )
    state = states(limits.motion)
    found = dict(zip(state, limits.slopes(*state.values()), strict=True))
    for kind, step in (("q", 2e-4), ("qd", 1e-2), ("qdd", 1e-2)):
        expected = slopes_by_state(limits.values, state, kind, step)
        for row in range(len(limits.labels)):
            assert_slopes(found[kind][:, row], expected[:, row], 1e-3)
    assert np.abs(found["q"][:, 0]).max() > 1e-3  # openness does change


@pytest.mark.parametrize(
    "name", slow_unless(["slider-crank"], ["slider-crank", "three_rps"])
)
def test_uncertain_efforts_are_those_of_the_base_model(name: str) -> None:
    robot, model = mechanism(name), identified(name, np.random.default_rng(8))
    limited = [EffortLimit(output.name, output.unit, 10.0) for output in robot.outputs]
    limits = loop_limits(
        LoopMotion(robot), [effort_limits(robot, limited, model, 0.1, None)]
    )
    state = states(limits.motion)
    X = base(name).regressor(*state.values())
    std = np.sqrt(np.einsum("nik,kl,nil->ni", X, model.covariance, X))
    found = limits.values(*state.values())[:, 1:]
    np.testing.assert_allclose(found[:, ::2], X @ model.values + 2 * std, rtol=1e-6)
    np.testing.assert_allclose(
        found[:, 1::2], X @ model.values - 2 * std, rtol=1e-6, atol=1e-6
    )


def test_efforts_are_those_of_the_base_model() -> None:
    """Inverse dynamics with standard parameters, and X with the base parameters that belong to them."""
    robot = mechanism("three_rps")
    standard = np.random.default_rng(8).uniform(0.5, 1.0, len(robot.parameters))
    efforts = effort_limits(
        robot,
        [EffortLimit(o.name, o.unit, 10.0) for o in robot.outputs],
        EffortModel(standard),
        0.1,
        None,
    )
    limits = loop_limits(LoopMotion(robot), [efforts])
    state = states(limits.motion)
    model = base("three_rps")
    expected = model.predict(*state.values(), model.values(standard))
    np.testing.assert_allclose(
        limits.values(*state.values())[:, 1:], expected, rtol=1e-9
    )
    np.testing.assert_allclose(limits.high[1:], 9.0)


def beyond() -> tuple[LoopRegressor, dict[str, Floats]]:
    """A crank-rocker driven at the rocker, which only swings: from the assembly pose to where it cannot go."""
    robot = linkages.four_bar("rocker")
    made = LoopRegressor(robot, ec.base_parameters(robot).matrix.pivots, 0.02)
    q = np.linspace(1.62, 3.0, 60)[:, None]
    return made, {"q": q, "qd": np.ones_like(q), "qdd": np.ones_like(q)}


def end_of_rocker() -> float:
    """Where crank and coupler are in line, one on the other: their ends are l3 − l2 apart (law of cosines)."""
    l1, l4, far = 0.4, 0.3, 0.35 - 0.15
    return float(np.pi - np.arccos((l1**2 + l4**2 - far**2) / (2 * l1 * l4)))


def test_what_cannot_be_closed_counts_nothing() -> None:
    made, state = beyond()
    closed = made.motion.positioned(state["q"])
    np.testing.assert_array_equal(
        closed.done, np.abs(state["q"][:, 0]) < end_of_rocker()
    )
    entries = made.entries(state)
    assert np.isfinite(entries).all()
    assert not entries[~closed.done].any()
    assert entries[0].any()
    for part in made.pulled(state, np.ones_like(entries)):
        assert np.isfinite(part).all()
        assert not part[~closed.done].any()


@pytest.mark.slow
def test_samples_fade_out_towards_singular_poses() -> None:
    """Entries do not jump where the loops cease to close, and their derivatives are exact where they fade."""
    made, _ = beyond()
    q = np.linspace(end_of_rocker() - 0.05, end_of_rocker() + 0.01, 400)[:, None]
    state = {"q": q, "qd": np.ones_like(q), "qdd": np.ones_like(q)}
    entries, openness = (
        made.entries(state),
        made.motion.positioned(q).openness / made.motion.reference,
    )
    fading = (openness > 0.055) & (openness < 0.095)
    assert fading.sum() > 2
    assert not entries[openness < 0.05].any()
    chosen = {name: part[fading] for name, part in state.items()}
    found = made.pulled(chosen, np.ones((int(fading.sum()), made.size)))[0]
    expected = slopes_by_state(
        lambda q, qd, qdd: made.entries({"q": q, "qd": qd, "qdd": qdd}).sum(axis=1),
        chosen,
        "q",
        1e-6,
    )
    assert_slopes(found, expected, 1.0)


def test_the_way_back_is_told() -> None:
    made, state = beyond()
    limits = loop_limits(made.motion)
    values, slopes = (
        limits.values(*state.values())[:, 0],
        limits.slopes(*state.values())[0],
    )
    assert slopes is not None
    outside = state["q"][:, 0] > end_of_rocker()
    assert (values[outside] < 0).all()
    assert (np.diff(values[outside]) < 0).all()
    assert (slopes[outside, 0, 0] < 0).all()
    np.testing.assert_allclose(
        np.diff(values[outside]),
        slopes[outside, 0, 0][1:] * np.diff(state["q"][outside, 0]),
    )


@pytest.mark.slow
def test_what_was_found_does_not_depend_on_what_was_asked_before() -> None:
    made, state = beyond()
    fresh = made.motion.positioned(state["q"])
    made.motion.positioned(state["q"] - 0.3)
    again = made.motion.positioned(state["q"])
    np.testing.assert_array_equal(fresh.done, again.done)
    first, second = (
        made.motion.run("closed_accelerations", **{**state, "q": one.q})
        for one in (fresh, again)
    )
    np.testing.assert_allclose(second[again.done], first[fresh.done], rtol=1e-6)


def test_a_motion_through_a_flat_parallelogram_is_not_safe() -> None:
    robot = mechanism("parallelogram")
    limits, basis = loop_limits(LoopMotion(robot)), resting_ends(Fourier(4.0, 2))
    coefficients = np.zeros((basis.size, 1))
    rest = np.linalg.lstsq(
        basis.values(np.linspace(0, 4, 50), 0), np.ones(50), rcond=None
    )[0]
    swing = np.random.default_rng(1).normal(size=(basis.size, 1))
    for size, safe in ((0.05, True), (1.0, False)):
        q = basis.values(np.linspace(0, 4, 500), 0) @ swing
        coefficients = np.pi / 3 * rest[:, None] + size * 2.0 / np.abs(q).max() * swing
        (margin,) = loop_margins(
            Trajectory(("crank",), ("rad",), basis, coefficients), limits
        )
        assert margin.kept is safe


class HalfMirrored(LoopMotion):
    """Finds the second half of all samples in the other way of assembly, as one might that follows them one by one."""

    def positioned(self, wanted: Floats) -> Closed:
        flipped = {"crank": 1.0, "coupler": -2.9, "rocker": -2.0}
        other = LoopMotion(replace(linkages.four_bar(), assembly=flipped))
        mine, theirs = super().positioned(wanted), other.positioned(wanted)
        half = len(wanted) // 2
        fields = (
            np.concatenate(
                [getattr(mine, f.name)[:half], getattr(theirs, f.name)[half:]]
            )
            for f in fields_of(mine)
        )
        return Closed(*fields)


def test_another_way_of_assembly_counts_as_open_loops() -> None:
    basis = resting_ends(Fourier(1.0, 2))
    trajectory = Trajectory(("crank",), ("rad",), basis, 0.1 * np.ones((basis.size, 1)))
    for motion, kept in (
        (LoopMotion(linkages.four_bar()), True),
        (HalfMirrored(linkages.four_bar()), False),
    ):
        (margin,) = loop_margins(trajectory, loop_limits(motion))
        assert margin.kept is kept


FOUR_BAR = {
    "limits": {"velocity": 5, "acceleration": 50, "jerk": "none"},
    "duration": 6,
    "starts": 1,
}


@pytest.mark.slow
def test_a_trajectory_of_a_four_bar_beats_random_motions() -> None:
    setup = ec.load_setup(LOOPS / "four_bar.yaml")
    found = ec.exciting_trajectory(setup, **FOUR_BAR)
    assert found.safe
    assert found.trajectory.coordinates == ("crank",)
    assert any("loops" in margin.label for margin in found.margins)
    task = task_of(setup, changed(setup.excitation, FOUR_BAR, ""))
    design = designed(task)
    problem = design.problem
    seeds = (np.random.default_rng(k) for k in range(30))
    random = [
        design.trajectory(problem.scaled(problem.random(rng), 0.95)) for rng in seeds
    ]
    assert found.conditioning.log_det > max(
        conditioning_of(task, motion).log_det for motion in random
    )
    assert found.conditioning.condition < np.median(
        [conditioning_of(task, motion).condition for motion in random]
    )
    # the observation matrix of the library, at the same samples
    t = np.arange(600) / 100
    W = base("four_bar").regressor(*found.trajectory.states(t)).reshape(600, -1)
    assert found.conditioning.condition == pytest.approx(np.linalg.cond(W), rel=1e-6)


@pytest.mark.slow
def test_torque_limits_hold_with_loops() -> None:
    setup = ec.load_setup(LOOPS / "four_bar.xml")
    limits = {**FOUR_BAR["limits"], "effort": 1.5}  # type: ignore[dict-item]
    found = ec.exciting_trajectory(setup, **{**FOUR_BAR, "limits": limits})
    assert found.safe
    (torque,) = [margin for margin in found.margins if "torque" in margin.label]
    model = ec.base_parameters(setup.mechanism)
    standard = np.array(
        [x if x is not None else 0.0 for x in setup.mechanism.standard_values()]
    )
    tau = model.predict(
        *found.trajectory.states(np.linspace(0, 6, 5000)), model.values(standard)
    )
    assert np.abs(tau).max() <= 0.9 * 1.5
    assert torque.active
    assert torque.sampled
    assert torque.least == pytest.approx(tau.min(), abs=1e-3)
    assert torque.largest == pytest.approx(tau.max(), abs=1e-3)


def test_a_parallelogram_starts_where_it_is_not_flat() -> None:
    found = ec.exciting_trajectory(
        ec.load_setup(LOOPS / "parallelogram.yaml"), **FOUR_BAR
    )
    assert found.safe
    q = found.trajectory(np.linspace(0, 6, 2000))
    assert np.abs(np.sin(q)).min() > 0.05


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"hold": {"coupler": 0.1}}, "leave out move and hold"),
        ({"move": ["rocker"]}, "leave out move and hold"),
    ],
)
def test_coordinates_of_loops_are_not_held(
    changes: dict[str, object], problem: str
) -> None:
    setup = ec.load_setup(LOOPS / "four_bar.yaml")
    with pytest.raises(ec.InputError, match=problem):
        task_of(setup, changed(setup.excitation, changes, ""))


def test_a_floating_base_with_loops_is_refused() -> None:
    setup = ec.load_setup(LOOPS / "biped.xml")
    with pytest.raises(ec.InputError, match="not driven by a motor of its own"):
        task_of(setup, setup.excitation)


def test_a_freejoint_is_held_like_any_floating_base() -> None:
    """No motor moves the translations of a freejoint, and so no limits are asked for."""
    text = """<mujoco><worldbody><body name="trunk"><freejoint name="root"/><geom size="0.1"/>
      <body name="arm"><joint name="j1" axis="0 1 0"/><geom size="0.1" pos="0.2 0 0"/></body>
    </body></worldbody></mujoco>"""
    setup = ec.load_setup(text)
    task = task_of(setup, setup.excitation)
    assert task.held == dict.fromkeys(["root.tx", "root.ty", "root.tz", "root.r"], 0.0)


@pytest.mark.slow
def test_clearances_hold_with_loops() -> None:
    """A post that the coupler would sweep over: capsules' distances from the frames of the closed motion."""
    setup = ec.load_setup(LOOPS / "four_bar.yaml")
    post, radius, length = np.array([0.25, 0.31, 0.0]), 0.01, 0.3
    shape = {
        "body": "coupler",
        "capsule": radius,
        "from": [0, 0, 0],
        "to": [length, 0, 0],
    }
    around = {
        "obstacles": [{"name": "post", "sphere": 0.03, "at": post.tolist()}],
        "self": False,
        "shapes": [shape],
    }
    found = ec.exciting_trajectory(setup, **FOUR_BAR, collisions=around)  # type: ignore[arg-type]
    assert found.safe
    (margin,) = [
        margin
        for margin in found.margins
        if margin.label == "distance of coupler and post"
    ]
    assert margin.least < 0.021  # it binds
    motion = LoopMotion(setup.mechanism)
    closed = motion.positioned(found.trajectory(np.linspace(0, 6, 60_001)))
    frames = Kinematics(setup.mechanism).frames(closed.q)[:, 1]
    along = np.clip(
        np.einsum("nij,ni->nj", frames[:, :, :3], post - frames[:, :, 3])[:, 0],
        0,
        length,
    )
    nearest = frames[:, :, 3] + along[:, None] * frames[:, :, 0]
    distances = np.linalg.norm(post - nearest, axis=1) - radius - 0.03
    assert margin.sampled
    assert 0.02 <= margin.least == pytest.approx(distances.min(), abs=1e-5)
    assert distances.min() <= 0.025
