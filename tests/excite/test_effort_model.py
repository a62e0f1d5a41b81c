"""Torque limits by an identified model: what is kept free is what its covariance says."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

import echelon as ec
from echelon.errors import InputError
from echelon.excite.problem.effort_limits import EffortLimit, EffortModel, effort_limits
from echelon.excite.problem.prior_model import check_determined
from echelon.excite.problem.state_limits import Enclosed
from echelon.excite.verify.margins import reach
from support.excitation_cases import Floats, families, random_motion, slopes_by_state, torques, tx40_standard
from support.float_regressor import random_states
from support.simulated_results import Result, result_of

DRAWS = 400


@cache
def tx40() -> tuple[ec.BaseModel, Floats, Floats]:
    """With base parameters, and a covariance by which some combinations are known exactly."""
    mechanism, standard = tx40_standard()
    base = ec.base_parameters(mechanism)
    spread = 0.1 * np.random.default_rng(1).normal(size=(base.rank, base.rank - 3))
    return base, base.values(standard), spread @ spread.T


def identified_efforts(deviations: float = 3.0, smooth: float | None = None) -> Enclosed:
    base, values, covariance = tx40()
    names = [EffortLimit(name, "N·m", 100.0 + k) for k, name in enumerate(base.mechanism.velocities)]
    model = EffortModel(values, base.matrix.pivots, covariance, deviations)
    return effort_limits(base.mechanism, names, model, 0.1, smooth)


def test_efforts_plus_and_minus_deviations() -> None:
    base, values, covariance = tx40()
    state = random_states(base.mechanism, 8)
    X = base.regressor(*state)
    middle, std = X @ values, np.sqrt(np.einsum("nik,kl,nil->ni", X, covariance, X))
    found = identified_efforts()
    size = np.abs(middle).max()
    np.testing.assert_allclose(found.values(*state)[:, ::2], middle + 3 * std, atol=1e-9 * size)
    np.testing.assert_allclose(found.values(*state)[:, 1::2], middle - 3 * std, atol=1e-9 * size)
    assert found.labels[:2] == ("torque of j1 plus 3 deviations", "torque of j1 minus 3 deviations")
    np.testing.assert_array_equal(found.high[:4], [90, np.inf, 0.9 * 101, np.inf])
    np.testing.assert_array_equal(found.low[:4], [-np.inf, -90, -np.inf, -0.9 * 101])


def test_slopes_are_those_of_differences() -> None:
    limits = identified_efforts(smooth=0.1)
    state = dict(zip(("q", "qd", "qdd"), random_states(tx40()[0].mechanism, 4), strict=True))
    for name, found in zip(state, limits.slopes(*state.values()), strict=True):
        expected = slopes_by_state(limits.values, state, name)
        assert found is not None
        np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize("size", [0.0, 1e-3, 0.3])
def test_enclosures_hold(size: float) -> None:
    limits, rng = identified_efforts(), np.random.default_rng(0)
    centres = dict(zip(("q", "qd", "qdd"), random_states(tx40()[0].mechanism, 300), strict=True))
    low, high = limits.enclosures({name: (x - size, x + size) for name, x in centres.items()})
    for _ in range(20):
        values = limits.values(*(x + size * rng.choice([-1, 1, rng.uniform(-1, 1)], x.shape) for x in centres.values()))
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
    values = limits.values(*motion.states(np.linspace(0, motion.duration, round(10_000 * motion.duration))))
    slack = 1e-9 * np.abs(values).max()
    assert np.all(least <= values.min(axis=0) + slack)
    assert np.all(largest >= values.max(axis=0) - slack)


def test_without_deviations_a_model_is_trusted() -> None:
    mechanism, standard = tx40_standard()
    state = random_states(mechanism, 8)
    found, expected = identified_efforts(deviations=0.0), torques(mechanism, standard).values(*state)
    assert found.labels[0] == "torque of j1"
    np.testing.assert_allclose(found.values(*state), expected, atol=1e-11 * np.abs(expected).max())


# -- from a file that an identification wrote --------------------------------------------------------------------------


@cache
def arm() -> Result:
    return result_of("arm")


def designed(**changes: Any) -> ec.ExcitingTrajectory:
    setup = replace(ec.load_setup(arm().folder.parent / "setup.yaml"), robot_file=None)
    limits = {"position": [-1.5, 1.5], "velocity": 3, "acceleration": 20, "jerk": 500, "effort": 12}
    settings = {"duration": 4, "starts": 1, "harmonics": 3, "limits": limits, "effort_margin": 0}
    return ec.exciting_trajectory(setup, **{**settings, **changes})


@cache
def careful() -> ec.ExcitingTrajectory:
    return designed(model="result/model.json")


@pytest.mark.slow
def test_torques_of_robots_that_the_data_allow_stay_below_limits() -> None:
    """Of robots drawn from the confidence region; by the estimate alone a half of them would break a limit."""
    found = careful()
    labels = {margin.label for margin in found.margins if margin.active}
    assert any(label.endswith("deviations") for label in labels)
    assert found.safe
    trusted = designed(model="result/model.json", deviations=0)
    assert largest(found) <= 12 * (1 + 1e-9)
    assert largest(trusted) > 12


def largest(found: ec.ExcitingTrajectory) -> float:
    """Largest torque of three deviations, by the saved model's own regressor."""
    model, states = arm().model, found.trajectory.states(np.arange(0, found.trajectory.duration, 1e-3))
    X = model.base.regressor(*states)
    std = np.sqrt(np.einsum("nik,kl,nil->ni", X, arm().covariance, X))
    return float((np.abs(X @ model.values) + 3 * std).max())


@pytest.mark.slow
def test_draws_of_the_model_break_limits_as_rarely_as_deviations_say() -> None:
    found = careful()
    X = arm().base.regressor(*found.trajectory.states(np.arange(0, found.trajectory.duration, 1e-2)))
    drawn = np.random.default_rng(0).multivariate_normal(arm().model.values, arm().covariance, DRAWS)
    beyond = (np.abs(X.reshape(-1, X.shape[-1]) @ drawn.T) > 12).any(axis=0)
    assert beyond.mean() < 0.05


def test_a_model_of_another_robot_is_refused() -> None:
    setup = ec.load_setup("examples/double_pendulum.yaml")
    with pytest.raises(InputError, match=r"model\.json has other base parameters"):
        ec.exciting_trajectory(
            setup, model=str(arm().folder / "model.json"), limits={"position": [-1, 1], "velocity": 1, "effort": 1}
        )


def test_a_model_that_does_not_exist_is_named() -> None:
    with pytest.raises(InputError, match=r"nowhere\.json.*cannot be read"):
        designed(model="nowhere.json")


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
