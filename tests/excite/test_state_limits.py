"""Limits of torques and of points against Pinocchio, hand-made kinematics, differences; what models leave free."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import echelon as ec
from echelon.algebra.program.function import Argument, Function
from echelon.algebra.program.tape import Program
from echelon.base.model import BaseModel
from echelon.dynamics.kinematics import Kinematics
from echelon.excite.problem.optimisation import Problem
from echelon.excite.problem.prior_model import check_determined
from echelon.excite.problem.state_limits import (
    EffortLimit,
    EffortModel,
    Enclosed,
    MotionLimit,
    PointLimit,
    StateConstraint,
    StateLimits,
    effort_limits,
    point_limits,
)
from echelon.excite.problem.trajectory import Fourier
from echelon.excite.verify import reach
from echelon.robot.mechanism import Mechanism
from echelon.shared.errors import InputError
from support.excitation_cases import (
    Floats,
    all_limits,
    families,
    points,
    random_motion,
    slopes_by_state,
    torques,
    tx40_standard,
    ur10,
)
from support.float_regressor import float_regressor, random_states, standard_vector
from support.paths import EXAMPLES
from support.report_data import identification
from support.robot_files import pinocchio_model, pinocchio_state, robot_file
from support.simulated_results import Result, result_of

STATE = ("q", "qd", "qdd")


# -- torques -----------------------------------------------------------------------------------------------------------


def test_torques_are_pinocchios() -> None:
    import pinocchio as pin

    mechanism, model = ur10(), pinocchio_model(robot_file("ur10_robot"), False)
    state = random_states(mechanism, 8)
    found = torques(mechanism, standard_vector(mechanism)).values(*state)
    data = model.createData()
    states = [
        pinocchio_state(mechanism, model, *(x[k] for x in state)) for k in range(8)
    ]
    expected = np.array(
        [s.to_ours(pin.rnea(model, data, s.q, s.v, s.a)) for s in states]
    )
    np.testing.assert_allclose(found, expected, atol=1e-12 * np.abs(expected).max())


def test_torques_with_friction() -> None:
    """Joint side of a coupled wrist: the regressor times the parameters."""
    mechanism, standard = tx40_standard()
    state = random_states(mechanism, 8)
    expected = float_regressor(mechanism, *state) @ standard
    found = torques(mechanism, standard)
    np.testing.assert_allclose(
        found.values(*state), expected, atol=1e-11 * np.abs(expected).max()
    )
    assert found.labels[:2] == ("torque of j1", "torque of j2")
    assert found.units[0] == "N·m"
    np.testing.assert_allclose(found.high, 0.9 * (100 + np.arange(6)))
    np.testing.assert_array_equal(found.low, -found.high)


def test_torques_of_motors() -> None:
    """Motor torques τ_m balance the joint torques τ through the gear ratios T: Tᵀ τ_m = τ, without friction."""
    mechanism = ec.load(EXAMPLES / "tx40.yaml")
    _, standard = tx40_standard()
    standard[60:] = 0
    ratios = np.diag([32.0, 32, 45, -48, 45, 32])
    ratios[5, 4] = 32
    limits = [EffortLimit(f"m{k + 1}", "N·m", 1.0) for k in range(6)]
    found = effort_limits(mechanism, limits, EffortModel(standard), 0.0, None)
    state = random_states(mechanism, 5)
    joints = torques(mechanism, standard).values(*state)
    np.testing.assert_allclose(
        found.values(*state) @ ratios, joints, atol=1e-11 * np.abs(joints).max()
    )


def test_forces_of_slides() -> None:
    cart = ec.load(EXAMPLES / "cart_pole.yaml")
    standard = np.random.default_rng(0).normal(size=len(cart.parameters))
    found = effort_limits(
        cart,
        [EffortLimit(cart.velocities[0], "N", 5.0)],
        EffortModel(standard),
        0.2,
        None,
    )
    assert found.labels == (f"force of {cart.velocities[0]}",)
    assert (found.low[0], found.high[0]) == (-4.0, 4.0)


@pytest.mark.parametrize("smooth", [None, 0.2])
def test_slopes_of_torques(smooth: float | None) -> None:
    mechanism, standard = tx40_standard()
    check_slopes(torques(mechanism, standard, smooth=smooth), mechanism)


def test_smoothed_torques_differ_near_standstill_only() -> None:
    mechanism, standard = tx40_standard()
    sharp, smooth = (
        torques(mechanism, standard),
        torques(mechanism, standard, smooth=0.01),
    )
    q, qd, qdd = random_states(mechanism, 6)
    qd = np.sign(qd) * np.maximum(np.abs(qd), 0.3)
    qd[:, 5] = 2.0 * np.sign(qd[:, 4])  # nor does the wrist's motor stand still
    np.testing.assert_allclose(
        smooth.values(q, qd, qdd), sharp.values(q, qd, qdd), atol=1e-9
    )
    assert (
        np.abs(smooth.values(q, 0.01 * qd, qdd) - sharp.values(q, 0.01 * qd, qdd)).max()
        > 0.05
    )


def test_torques_need_a_prior_model() -> None:
    mechanism, standard = tx40_standard()
    standard[3] = np.nan
    with pytest.raises(
        InputError,
        match=rf"need a prior model; {mechanism.parameters[3]} have no values",
    ):
        torques(mechanism, standard)


def check_slopes(limits: StateConstraint, mechanism: Mechanism) -> None:
    state = dict(zip(STATE, random_states(mechanism, 4), strict=True))

    def values(**moved: Floats) -> Floats:
        return limits.values(moved["q"], moved["qd"], moved["qdd"])

    found = limits.slopes(*state.values())
    size = max(np.abs(part).max() for part in found if part is not None)
    for part, name in zip(found, STATE, strict=True):
        expected = slopes_by_state(values, state, name)
        if part is None:
            np.testing.assert_allclose(expected, 0, atol=1e-11 * size)
        else:
            assert part.shape == expected.shape
            np.testing.assert_allclose(part, expected, atol=1e-8 * size)


# -- points ------------------------------------------------------------------------------------------------------------


def test_points_are_where_frames_take_them() -> None:
    mechanism = ur10()
    names = [body.name for body in mechanism.bodies]
    q, qd, qdd = random_states(mechanism, 6)
    found = point_limits(mechanism, points())
    frames = Kinematics(mechanism).frames(q)
    for k, limit in enumerate(points()):
        place = frames[:, names.index(limit.body)]
        expected = (place[..., :3] @ np.array(limit.point) + place[..., 3]) @ np.array(
            limit.direction
        )
        np.testing.assert_allclose(found.values(q, qd, qdd)[:, k], expected, atol=1e-13)
    assert found.labels == ("z of wrist", "slanted of elbow", "z of shoulder")
    assert found.units == ("m",) * 3
    np.testing.assert_array_equal(found.low, [0.1, -np.inf, -1])
    np.testing.assert_array_equal(found.high, [1.2, 0.5, 1])


def test_slopes_of_points() -> None:
    check_slopes(point_limits(ur10(), points()), ur10())
    found = point_limits(ur10(), points()).slopes(*random_states(ur10(), 2))
    assert found[1] is None
    assert found[2] is None


def test_points_of_open_geometry(tmp_path: Path) -> None:
    arm = ec.load(EXAMPLES / "stanford.yaml")
    limit = PointLimit("y", arm.bodies[-1].name, (0.0, 0.0, 0.1), (0.0, 1.0, 0.0), 0, 1)
    with pytest.raises(InputError, match="d2"):
        point_limits(arm, [limit])
    q, qd, qdd = random_states(arm, 3)
    stated = tmp_path / "stanford.yaml"
    stated.write_text(
        (EXAMPLES / "stanford.yaml").read_text().replace("d2: null", "d2: 0.2")
    )
    frames = Kinematics(arm, {"d2": 0.2}).frames(q)[:, -1]
    found = point_limits(ec.load(stated), [limit]).values(q, qd, qdd)[:, 0]
    np.testing.assert_allclose(
        found, frames[:, 1, 2] * 0.1 + frames[:, 1, 3], atol=1e-14
    )


def test_points_need_a_body() -> None:
    limit = PointLimit("z", "wrist_3_lnk", (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0, 1)
    with pytest.raises(InputError, match=r"no body 'wrist_3_lnk'.*wrist_3_link"):
        point_limits(ur10(), [limit])


# -- intervals ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("case", range(3))
@pytest.mark.parametrize("size", [0.0, 1e-3, 0.3])
def test_enclosures_hold(case: int, size: float) -> None:
    """Values anywhere in boxes of states, without smoothing; more boxes than are worked on together."""
    mechanism, limits = all_limits()[case]
    rng = np.random.default_rng(0)
    centres = dict(zip(STATE, random_states(mechanism, 300), strict=True))
    low, high = limits.enclosures(
        {name: (x - size, x + size) for name, x in centres.items()}
    )
    sharp = StateLimits(
        limits.labels,
        limits.units,
        limits.low,
        limits.high,
        limits.function,
        limits.uniform,
    )
    assert low.shape == (300, len(limits.labels))
    for _ in range(20):
        inside = [
            x + size * rng.choice([-1, 1, rng.uniform(-1, 1)], x.shape)
            for x in centres.values()
        ]
        values = sharp.values(*inside)
        slack = 1e-11 * np.abs(values).max()
        assert np.all(values >= low - slack)
        assert np.all(values <= high + slack)
    if size == 0:
        np.testing.assert_allclose(high, low, atol=1e-9 * np.abs(values).max())


def with_zeros() -> StateLimits:
    """Limits of five functions of (q1, q2), of which the first, the third and the last are structurally zero."""
    program = Program()
    x, y = program.input("x"), program.input("y")
    argument = Argument("q", (x.node, y.node), ("q1", "q2"), ("rad", "rad"))
    labels = ("none", "sum", "nothing", "product", "zero")
    # not in the order of the rows, either
    function = Function(
        "mixed",
        program,
        (argument,),
        {(3,): (x * y).node, (1,): (x + y).node},
        (labels,),
    )
    high = np.array([1.0, 5, 1, 20, 1])
    return StateLimits(labels, ("",) * 5, -high, high, function, {})


def test_functions_that_vanish_keep_their_places() -> None:
    limits = with_zeros()
    q = np.array([[3.0, 5.0], [-1.0, 4.0]])
    expected = [[0, 8, 0, 15, 0], [0, 3, 0, -4, 0]]
    np.testing.assert_array_equal(limits.values(q, 0 * q, 0 * q), expected)
    low, high = limits.enclosures(dict.fromkeys(STATE, (q, q)))
    np.testing.assert_allclose(low, expected, atol=1e-12)
    np.testing.assert_allclose(high, expected, atol=1e-12)
    by_q, by_qd, by_qdd = limits.slopes(q, 0 * q, 0 * q)
    assert by_qd is None
    assert by_qdd is None
    assert by_q is not None
    np.testing.assert_array_equal(by_q[0], [[0, 0], [1, 1], [0, 0], [5, 3], [0, 0]])


def test_a_limit_is_broken_where_it_is_although_others_vanish() -> None:
    """The sum reaches 8, beyond its 5; taken for one of its neighbours it would seem to be kept."""
    limits = with_zeros()
    box = np.array([[2.9, 4.9]]), np.array([[3.1, 5.1]])
    low, high = limits.enclosures(dict.fromkeys(STATE, box))
    assert (low[0, 1], high[0, 1]) == (pytest.approx(7.8), pytest.approx(8.2))
    assert (low[0, 3], high[0, 3]) == (
        pytest.approx(2.9 * 4.9),
        pytest.approx(3.1 * 5.1),
    )
    np.testing.assert_array_equal(
        low[0] > limits.high, [False, True, False, False, False]
    )


# -- other constraints -------------------------------------------------------------------------------------------------


def test_tightened_bounds() -> None:
    inner, basis = point_limits(ur10(), points()), Fourier(1.0, 1)
    problem = Problem(basis, 6, None, None, (), (inner,), np.zeros(6))  # type: ignore[arg-type]
    first = problem.tightened(np.array([0.1, 0.0, 0.2]), np.array([0.0, 0.3, 0.0]))
    second = first.tightened(np.array([0.1, 0.0, 0.0]), np.array([0.0, 0.1, 0.0]))
    assert second.constraints == (inner,)
    np.testing.assert_allclose(second.low, [0.3, -np.inf, -0.8])
    np.testing.assert_allclose(second.high, [1.2, 0.1, 1.0])
    x = np.random.default_rng(1).normal(size=problem.size)
    state = second.states(x)
    values = inner.values(state[:, 0], state[:, 1], state[:, 2])
    np.testing.assert_array_equal(second.values(x), values)
    below, above = second.slacks(values)
    np.testing.assert_allclose(
        below[:, [0, 2]], (values - second.low)[:, [0, 2]] / [0.9, 1.8]
    )
    np.testing.assert_allclose(above[:, 1], (0.1 - values[:, 1]) / 0.1)
    assert second.room(x) == min(below.min(), above.min())


def test_sums_over_samples_are_derivatives_by_the_coefficients() -> None:
    inner, basis = point_limits(ur10(), points()), Fourier(1.0, 1)
    speed = MotionLimit("j2", "rad/s", 1, np.eye(6)[1] - np.eye(6)[2], -3, 3)
    problem = Problem(basis, 6, None, None, (speed,), (inner,), np.zeros(6))  # type: ignore[arg-type]
    rng = np.random.default_rng(2)
    x, step = rng.normal(size=(2, problem.size))
    weights = rng.random((len(problem.grid), 4))
    slopes = problem.slopes(x)
    differences = (
        problem.values(x + 1e-6 * step) - problem.values(x - 1e-6 * step)
    ) / 2e-6
    np.testing.assert_allclose(problem.along(slopes, step), differences, atol=1e-7)
    assert problem.gathered(slopes, weights) @ step == pytest.approx(
        float((weights * differences).sum()), rel=1e-6
    )
    curved = step @ problem.curvature(slopes, weights) @ step
    assert curved == pytest.approx(float((weights * differences**2).sum()), rel=1e-6)


def test_what_limits_of_the_motion_are_called() -> None:
    limits = [MotionLimit("j3", "rad", order, np.ones(1), -1, 1) for order in range(4)]
    expected = ["position of j3", "velocity of j3", "acceleration of j3", "jerk of j3"]
    assert [limit.label for limit in limits] == expected


def test_base_parameters_give_the_same_torques() -> None:
    """An identity: what base parameters say of torques is what the standard ones say."""
    base: BaseModel = ec.base_parameters(ur10())
    standard = standard_vector(ur10())
    state = random_states(ur10(), 4)
    expected = base.predict(*state, base.B_float() @ standard)
    found = torques(ur10(), standard).values(*state)
    np.testing.assert_allclose(found, expected, atol=1e-11 * np.abs(expected).max())


DRAWS = 400


@cache
def tx40() -> tuple[ec.BaseModel, Floats, Floats]:
    """With base parameters, and a covariance by which some combinations are known exactly."""
    mechanism, standard = tx40_standard()
    base = ec.base_parameters(mechanism)
    spread = 0.1 * np.random.default_rng(1).normal(size=(base.rank, base.rank - 3))
    return base, base.values(standard), spread @ spread.T


def identified_efforts(
    deviations: float = 3.0, smooth: float | None = None
) -> Enclosed:
    base, values, covariance = tx40()
    names = [
        EffortLimit(name, "N·m", 100.0 + k)
        for k, name in enumerate(base.mechanism.velocities)
    ]
    model = EffortModel(values, base.matrix.pivots, covariance, deviations)
    return effort_limits(base.mechanism, names, model, 0.1, smooth)


def test_efforts_plus_and_minus_deviations() -> None:
    base, values, covariance = tx40()
    state = random_states(base.mechanism, 8)
    X = base.regressor(*state)
    middle, std = X @ values, np.sqrt(np.einsum("nik,kl,nil->ni", X, covariance, X))
    found = identified_efforts()
    size = np.abs(middle).max()
    np.testing.assert_allclose(
        found.values(*state)[:, ::2], middle + 3 * std, atol=1e-9 * size
    )
    np.testing.assert_allclose(
        found.values(*state)[:, 1::2], middle - 3 * std, atol=1e-9 * size
    )
    assert found.labels[:2] == (
        "torque of j1 plus 3 deviations",
        "torque of j1 minus 3 deviations",
    )
    np.testing.assert_array_equal(found.high[:4], [90, np.inf, 0.9 * 101, np.inf])
    np.testing.assert_array_equal(found.low[:4], [-np.inf, -90, -np.inf, -0.9 * 101])


def test_slopes_are_those_of_differences() -> None:
    limits = identified_efforts(smooth=0.1)
    state = dict(
        zip(("q", "qd", "qdd"), random_states(tx40()[0].mechanism, 4), strict=True)
    )
    for name, found in zip(state, limits.slopes(*state.values()), strict=True):
        expected = slopes_by_state(limits.values, state, name)
        assert found is not None
        np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize("size", [0.0, 1e-3, 0.3])
def test_enclosures_of_deviations_hold(size: float) -> None:
    limits, rng = identified_efforts(), np.random.default_rng(0)
    centres = dict(
        zip(("q", "qd", "qdd"), random_states(tx40()[0].mechanism, 300), strict=True)
    )
    low, high = limits.enclosures(
        {name: (x - size, x + size) for name, x in centres.items()}
    )
    for _ in range(20):
        values = limits.values(
            *(
                x + size * rng.choice([-1, 1, rng.uniform(-1, 1)], x.shape)
                for x in centres.values()
            )
        )
        slack = 1e-11 * np.abs(values).max()
        assert np.all(values >= low - slack)
        assert np.all(values <= high + slack)
    if size == 0:
        np.testing.assert_allclose(high, low, atol=1e-8 * np.abs(values).max())


@pytest.mark.parametrize("name", ["fourier at rest", "bspline at rest", "sum at rest"])
def test_bounds_contain_all_samples(name: str) -> None:
    limits = identified_efforts()
    motion = random_motion(families(2.0)[name], 6, 0, 0.15)
    least, largest = reach(motion, limits)
    values = limits.values(
        *motion.states(np.linspace(0, motion.duration, round(10_000 * motion.duration)))
    )
    slack = 1e-9 * np.abs(values).max()
    assert np.all(least <= values.min(axis=0) + slack)
    assert np.all(largest >= values.max(axis=0) - slack)


def test_without_deviations_a_model_is_trusted() -> None:
    mechanism, standard = tx40_standard()
    state = random_states(mechanism, 8)
    found, expected = (
        identified_efforts(deviations=0.0),
        torques(mechanism, standard).values(*state),
    )
    assert found.labels[0] == "torque of j1"
    np.testing.assert_allclose(
        found.values(*state), expected, atol=1e-11 * np.abs(expected).max()
    )


# -- from a file that an identification wrote --------------------------------------------------------------------------


@cache
def arm() -> Result:
    return result_of("arm")


def designed(**changes: Any) -> ec.ExcitingTrajectory:
    setup = replace(ec.load_setup(arm().folder.parent / "setup.yaml"), robot_file=None)
    limits = {
        "position": [-1.5, 1.5],
        "velocity": 3,
        "acceleration": 20,
        "jerk": 500,
        "effort": 12,
    }
    settings = {
        "duration": 4,
        "starts": 1,
        "harmonics": 3,
        "limits": limits,
        "effort_margin": 0,
    }
    return ec.exciting_trajectory(setup, **{**settings, **changes})


@cache
def careful() -> ec.ExcitingTrajectory:
    return designed(model="result/model.json")


@pytest.mark.slow
def test_torques_of_robots_that_the_data_allow_stay_below_limits() -> None:
    """Robots are drawn from the confidence region; a motion for the estimate alone breaks limits of half of them."""
    found = careful()
    labels = {margin.label for margin in found.margins if margin.active}
    assert any(label.endswith("deviations") for label in labels)
    assert found.safe
    trusted = designed(model="result/model.json", deviations=0)
    assert largest(found) <= 12 * (1 + 1e-9)
    assert largest(trusted) > 12


def largest(found: ec.ExcitingTrajectory) -> float:
    """Largest torque of three deviations, by the saved model's own regressor."""
    model, states = (
        arm().model,
        found.trajectory.states(np.arange(0, found.trajectory.duration, 1e-3)),
    )
    X = model.base.regressor(*states)
    std = np.sqrt(np.einsum("nik,kl,nil->ni", X, arm().covariance, X))
    return float((np.abs(X @ model.values) + 3 * std).max())


@pytest.mark.slow
def test_draws_of_the_model_break_limits_as_rarely_as_deviations_say() -> None:
    found = careful()
    X = arm().base.regressor(
        *found.trajectory.states(np.arange(0, found.trajectory.duration, 1e-2))
    )
    drawn = np.random.default_rng(0).multivariate_normal(
        arm().model.values, arm().covariance, DRAWS
    )
    beyond = (np.abs(X.reshape(-1, X.shape[-1]) @ drawn.T) > 12).any(axis=0)
    assert beyond.mean() < 0.05


def test_a_model_of_another_robot_is_refused(tmp_path: Path) -> None:
    ec.save_identification(identification("cart_pole"), tmp_path / "model.json")
    setup = ec.load_setup("examples/double_pendulum.yaml")
    with pytest.raises(InputError, match=r"model\.json has other base parameters"):
        ec.exciting_trajectory(
            setup,
            model=str(tmp_path / "model.json"),
            limits={"position": [-1, 1], "velocity": 1, "effort": 1},
        )


def test_a_model_that_does_not_exist_is_named() -> None:
    setup = ec.load_setup("examples/double_pendulum.yaml")
    limits = {"position": [-1, 1], "velocity": 1, "effort": 1}
    with pytest.raises(InputError, match=r"nowhere\.json.*cannot be read"):
        ec.exciting_trajectory(setup, model="nowhere.json", limits=limits)


def test_a_model_that_does_not_determine_torques_is_refused() -> None:
    """A sensor in the last joint does not see the first one's torque."""
    mechanism = ec.load("examples/double_pendulum.yaml")
    limits = [EffortLimit(name, "N·m", 1.0) for name in mechanism.velocities]
    check_determined(mechanism, limits, ec.base_parameters(mechanism).rank, 0)
    part = replace(mechanism, measured=mechanism.outputs[-1:])
    rank = ec.base_parameters(part).rank
    check_determined(part, limits[-1:], rank, 0)
    with pytest.raises(InputError, match="does not determine all torques"):
        check_determined(part, limits, rank, 0)
