"""Motions start where there is room: a pose that only just keeps a clearance leaves none to move."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import echelon as ec
from echelon.excite.problem.clearance import Clearance, clearance_of
from echelon.excite.problem.resolved_limits import ResolvedLimits
from echelon.excite.problem.robot_shapes import entry_shapes
from echelon.excite.solve.design import start_pose
from support.robot_files import robot_file
from support.shaped_robots import planar

LIMITS = ResolvedLimits((), (), np.array([-1.5, -1.0]), np.array([1.5, 1.0]), ("rad", "rad"), ())
OPEN = np.full(2, np.nan)


def beside(wall: float) -> Clearance:
    """Two links along x with a ball at the end, and a wall at some y."""
    entries: list[dict[str, Any]] = [
        {"body": "link2", "sphere": 0.1, "at": [1, 0, 0]},
        {"body": "world", "plane": [0, -1, 0], "through": [0, wall, 0]},
    ]
    return clearance_of(planar(2), entry_shapes(planar(2), entries), 0.02)


def test_a_narrow_middle_is_left_for_a_pose_with_room() -> None:
    found = start_pose(OPEN, LIMITS, [beside(0.13)], 0)
    assert np.sin(found[0]) + np.sin(found.sum()) < -0.5
    np.testing.assert_array_equal(found, start_pose(OPEN, LIMITS, [beside(0.13)], 0))


def test_a_middle_with_room_is_kept() -> None:
    np.testing.assert_array_equal(start_pose(OPEN, LIMITS, [beside(2.5)], 0), [0.0, 0.0])


def test_what_is_stated_stays_with_room_or_without() -> None:
    found = start_pose(np.array([0.0, np.nan]), LIMITS, [beside(0.13)], 0)
    assert found[0] == 0.0
    assert found[1] < 0.0
    np.testing.assert_array_equal(start_pose(np.zeros(2), LIMITS, [beside(0.13)], 0), [0.0, 0.0])


@pytest.mark.slow
def test_a_leg_of_a_quadruped_over_a_floor() -> None:
    """In the middle of its ranges the thigh is 1.5 mm further from the trunk than it has to be."""
    leg = [f"FR_{part}_joint" for part in ("hip", "thigh", "calf")]
    floor = {"name": "floor", "plane": [0, 0, 1], "through": [0, 0, -0.45]}
    setup = ec.load_setup(robot_file("a1"), floating=True)
    found = ec.exciting_trajectory(setup, starts=1, harmonics=6, move=leg, collisions={"obstacles": [floor]})
    assert found.safe
    assert found.starts[0].status == "converged"
    assert found.conditioning.scaled_condition < 60
    labels = [margin.label for margin in found.margins]
    assert "distance of FR_calf and floor" in labels
    assert "distance of base and FR_thigh" in labels
