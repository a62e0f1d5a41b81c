"""Limits of torques and points with loops: values against the base model, slopes against differences."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from echelon.excite.problem.closed_loops import LoopMotion, LoopPart, loop_limits
from echelon.excite.problem.effort_limits import EffortLimit, EffortModel
from echelon.excite.problem.state_limits import PointLimit, point_limits
from support.excitation_cases import slopes_by_state
from support.excitation_loops import assert_slopes, base, certain, identified, loop_efforts, mechanism, states


@pytest.mark.parametrize(
    ("name", "made"),
    [
        ("four-bar", certain),
        ("four-bar", identified),
        ("slider-crank", certain),
        pytest.param("three_rps", certain, marks=pytest.mark.slow),
        ("three_rps", identified),
        pytest.param("delta", identified, marks=pytest.mark.slow),
        pytest.param("gough_stewart", certain, marks=pytest.mark.slow),
    ],
)
def test_slopes_of_limits_are_those_of_differences(name: str, made: Callable[..., EffortModel]) -> None:
    robot, rng = mechanism(name), np.random.default_rng(7)
    efforts = [EffortLimit(output.name, output.unit, 10.0) for output in robot.outputs]
    points = [PointLimit("p", body.name, (0.1, 0.2, 0.3), (0.6, 0.0, 0.8), -1.0, 1.0) for body in robot.bodies[-2:]]
    limits = loop_limits(
        LoopMotion(robot),
        [loop_efforts(robot, efforts, made(name, rng), 0.1, 0.02), LoopPart(point_limits(robot, points))],
    )
    state = states(limits.motion)
    found = dict(zip(state, limits.slopes(*state.values()), strict=True))
    for kind, step in (("q", 2e-4), ("qd", 1e-2), ("qdd", 1e-2)):
        expected = slopes_by_state(limits.values, state, kind, step)
        for row in range(len(limits.labels)):
            assert_slopes(found[kind][:, row], expected[:, row], 1e-3)
    assert np.abs(found["q"][:, 0]).max() > 1e-3  # openness does change


def test_uncertain_efforts_are_those_of_the_base_model() -> None:
    robot, model = mechanism("three_rps"), identified("three_rps", np.random.default_rng(8))
    limited = [EffortLimit(output.name, output.unit, 10.0) for output in robot.outputs]
    limits = loop_limits(LoopMotion(robot), [loop_efforts(robot, limited, model, 0.1, None)])
    state = states(limits.motion)
    X = base("three_rps").regressor(*state.values())
    std = np.sqrt(np.einsum("nik,kl,nil->ni", X, model.covariance, X))
    found = limits.values(*state.values())[:, 1:]
    np.testing.assert_allclose(found[:, ::2], X @ model.values + 2 * std, rtol=1e-6)
    np.testing.assert_allclose(found[:, 1::2], X @ model.values - 2 * std, rtol=1e-6, atol=1e-6)


def test_efforts_are_those_of_the_base_model() -> None:
    """Inverse dynamics with standard parameters, and X with the base parameters that belong to them."""
    robot = mechanism("three_rps")
    standard = np.random.default_rng(8).uniform(0.5, 1.0, len(robot.parameters))
    efforts = loop_efforts(
        robot, [EffortLimit(o.name, o.unit, 10.0) for o in robot.outputs], EffortModel(standard), 0.1, None
    )
    limits = loop_limits(LoopMotion(robot), [efforts])
    state = states(limits.motion)
    model = base("three_rps")
    expected = model.predict(*state.values(), model.values(standard))
    np.testing.assert_allclose(limits.values(*state.values())[:, 1:], expected, rtol=1e-9)
    np.testing.assert_allclose(limits.high[1:], 9.0)
