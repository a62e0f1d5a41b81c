"""Exciting trajectories of mechanisms with loops, against random ones and limits that bind."""

from __future__ import annotations

import numpy as np
import pytest

import echelon as ec
from echelon.dynamics.kinematics import Kinematics
from echelon.excite.excite import conditioning_of
from echelon.excite.problem.closed_loops import LoopMotion
from echelon.excite.problem.task import changed, task_of
from echelon.excite.solve.design import designed
from support.excitation_loops import LOOPS, base

FOUR_BAR = {"limits": {"velocity": 5, "acceleration": 50, "jerk": "none"}, "duration": 6, "starts": 1}


@pytest.mark.slow
def test_a_trajectory_of_a_four_bar_beats_random_motions() -> None:
    setup = ec.load_setup(LOOPS / "four_bar.yaml")
    found = ec.exciting_trajectory(setup, **FOUR_BAR)
    assert found.safe
    assert found.trajectory.coordinates == ("crank",)
    assert any("loops" in margin.label for margin in found.margins)
    task = task_of(setup, changed(setup.excitation, FOUR_BAR, ""))
    design = designed(task)
    random = [design.trajectory(design.problem.start(np.random.default_rng(k), 0.95)) for k in range(30)]
    assert found.conditioning.log_det > max(conditioning_of(task, motion).log_det for motion in random)
    assert found.conditioning.condition < np.median([conditioning_of(task, motion).condition for motion in random])
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
    standard = np.array([x if x is not None else 0.0 for x in setup.mechanism.standard_values()])
    tau = model.predict(*found.trajectory.states(np.linspace(0, 6, 5000)), model.values(standard))
    assert np.abs(tau).max() <= 0.9 * 1.5
    assert torque.active
    assert torque.sampled
    assert torque.least == pytest.approx(tau.min(), abs=1e-3)
    assert torque.largest == pytest.approx(tau.max(), abs=1e-3)


def test_a_parallelogram_starts_where_it_is_not_flat() -> None:
    found = ec.exciting_trajectory(ec.load_setup(LOOPS / "parallelogram.yaml"), **FOUR_BAR)
    assert found.safe
    q = found.trajectory(np.linspace(0, 6, 2000))
    assert np.abs(np.sin(q)).min() > 0.05


@pytest.mark.parametrize(
    ("changes", "problem"),
    [({"hold": {"coupler": 0.1}}, "leave out move and hold"), ({"move": ["rocker"]}, "leave out move and hold")],
)
def test_coordinates_of_loops_are_not_held(changes: dict[str, object], problem: str) -> None:
    setup = ec.load_setup(LOOPS / "four_bar.yaml")
    with pytest.raises(ec.InputError, match=problem):
        task_of(setup, changed(setup.excitation, changes, ""))


def test_a_floating_base_with_loops_is_refused() -> None:
    setup = ec.load_setup(LOOPS / "biped.xml")
    with pytest.raises(ec.InputError, match="not driven by a motor of its own"):
        task_of(setup, setup.excitation)


@pytest.mark.slow
def test_clearances_hold_with_loops() -> None:
    """A post that the coupler would sweep over: capsules' distances from the frames of the closed motion."""
    setup = ec.load_setup(LOOPS / "four_bar.yaml")
    post, radius, length = np.array([0.25, 0.31, 0.0]), 0.01, 0.3
    shape = {"body": "coupler", "capsule": radius, "from": [0, 0, 0], "to": [length, 0, 0]}
    around = {"obstacles": [{"name": "post", "sphere": 0.03, "at": post.tolist()}], "self": False, "shapes": [shape]}
    found = ec.exciting_trajectory(setup, **FOUR_BAR, collisions=around)  # type: ignore[arg-type]
    assert found.safe
    (margin,) = [margin for margin in found.margins if margin.label == "distance of coupler and post"]
    assert margin.least < 0.021  # it binds
    motion = LoopMotion(setup.mechanism)
    closed = motion.at(*found.trajectory.states(np.linspace(0, 6, 60_001)))
    frames = Kinematics(setup.mechanism).frames(closed.q)[:, 1]
    along = np.clip(np.einsum("nij,ni->nj", frames[:, :, :3], post - frames[:, :, 3])[:, 0], 0, length)
    nearest = frames[:, :, 3] + along[:, None] * frames[:, :, 0]
    distances = np.linalg.norm(post - nearest, axis=1) - radius - 0.03
    assert margin.sampled
    assert 0.02 <= margin.least == pytest.approx(distances.min(), abs=1e-5)
    assert distances.min() <= 0.025
