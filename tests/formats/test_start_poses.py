"""Poses from which motions can start, and what is said where there is none."""

from __future__ import annotations

import math

import numpy as np
import pytest

from echelon.excite.problem.state_limits import (
    EffortLimit,
    EffortModel,
    MotionLimit,
    PointLimit,
    StateConstraint,
    effort_limits,
    point_limits,
)
from echelon.excite.problem.task import ResolvedLimits
from echelon.excite.solve.design import broken, start_pose
from echelon.robot.joint import rotation, translation
from echelon.robot.mechanism import Mechanism
from echelon.shared.errors import InputError
from support.excitation_cases import Floats
from support.textbook_arms import body, place, tree

PLANAR = tree(
    "planar",
    *(
        body(
            k,
            k - 1,
            "revolute",
            place("1 0 0" if k > 1 else "0 0 0", "pi/2 0 0" if k == 1 else "0 0 0"),
            rotation(f"q{k}"),
        )
        for k in (1, 2)
    ),
    values={"g": "9.81"},
)
"""Two links of length 1 that turn in a vertical plane: the tip is at (cos q₁ + cos(q₁+q₂), sin q₁ + sin(q₁+q₂))."""
FREE = np.full(2, np.nan)
X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


def ranges(*ends: tuple[float, float]) -> ResolvedLimits:
    """Position limits; a coordinate without any has no entry among the limits of the motion."""
    low, high = np.array(ends, dtype=float).T
    motion = [
        MotionLimit(f"q{k + 1}", "rad", 0, np.eye(len(ends))[k], *ends[k])
        for k in range(len(ends))
        if np.isfinite(ends[k]).any()
    ]
    speeds = [
        MotionLimit(f"q{k + 1}", "rad/s", 1, np.eye(len(ends))[k], -1, 1)
        for k in range(len(ends))
    ]
    return ResolvedLimits((*motion, *speeds), (), low, high, ("rad",) * len(ends), ())


ALL = ranges((-math.pi, math.pi), (-math.pi, math.pi))


def tip(
    axis: tuple[float, float, float], low: float, high: float, name: str
) -> PointLimit:
    return PointLimit(name, "link2", (1.0, 0.0, 0.0), axis, low, high)


def places(*limits: PointLimit) -> list[StateConstraint]:
    return [point_limits(PLANAR, limits)]


def weights(
    mechanism: Mechanism, *limits: float, arm: float = 0.5
) -> list[StateConstraint]:
    """Holding torques of links of 10 kg whose centres are ahead of their joints."""
    standard = np.zeros(len(mechanism.parameters))
    for k, name in enumerate(mechanism.parameters):
        standard[k] = {"M": 10.0, "MX": 10.0 * arm}.get(name.rstrip("0123456789"), 0.0)
    named = [
        EffortLimit(name, "N·m", limit)
        for name, limit in zip(mechanism.velocities, limits, strict=True)
    ]
    return [effort_limits(mechanism, named, EffortModel(standard), 0.0, None)]


def tip_of(pose: Floats) -> tuple[float, float]:
    a, b = pose[0], pose[0] + pose[1]
    return math.cos(a) + math.cos(b), math.sin(a) + math.sin(b)


# -- poses that are found ----------------------------------------------------------------------------------------------


def test_the_middle_if_it_will_do() -> None:
    limits = ranges((-1.0, 3.0), (0.2, 0.8))
    np.testing.assert_allclose(start_pose(FREE, limits, [], 0), [1.0, 0.5])
    np.testing.assert_allclose(
        start_pose(FREE, limits, places(tip(Z, -9, 9, "z")), 0), [1.0, 0.5]
    )


def test_without_limits_where_zero_is_nearest() -> None:
    limits = ranges((-np.inf, np.inf), (0.5, np.inf))
    np.testing.assert_array_equal(start_pose(FREE, limits, [], 0), [0.0, 0.5])


def test_the_stated_pose() -> None:
    stated = np.array([0.3, np.nan])
    np.testing.assert_allclose(
        start_pose(stated, ranges((-1, 1), (0, 2)), [], 0), [0.3, 1.0]
    )


@pytest.mark.parametrize("seed", range(3))
def test_another_pose_where_the_middle_breaks_limits(seed: int) -> None:
    """Stretched out the tip is at (2, 0); it is to be high and not far."""
    constraints = places(tip(X, -0.5, 0.5, "x"), tip(Z, 1.0, 1.5, "z"))
    found = start_pose(FREE, ALL, constraints, seed)
    x, z = tip_of(found)
    assert abs(x) <= 0.5
    assert 1.0 <= z <= 1.5
    assert np.all(np.abs(found) <= math.pi)
    np.testing.assert_array_equal(found, start_pose(FREE, ALL, constraints, seed))


def test_a_needle_in_a_haystack() -> None:
    """A region that no random pose hits is found from those that come near."""
    constraints = places(tip(X, 0.6, 0.6002, "x"), tip(Z, 1.1, 1.1002, "z"))
    x, z = tip_of(start_pose(FREE, ALL, constraints, 0))
    assert x == pytest.approx(0.6001, abs=1.1e-4)
    assert z == pytest.approx(1.1001, abs=1.1e-4)


def test_stated_coordinates_stay() -> None:
    constraints = places(tip(Z, 1.5, 2.0, "z"))
    found = start_pose(np.array([0.9, np.nan]), ALL, constraints, 0)
    assert found[0] == 0.9
    assert 1.5 <= tip_of(found)[1] <= 2.0


def test_weights_that_can_be_held_in_few_poses() -> None:
    """Stretched out link 2 needs 49 N·m; it hangs or stands within 10 N·m."""
    constraints = weights(PLANAR, 200.0, 10.0)
    found = start_pose(FREE, ALL, constraints, 0)
    assert abs(49.05 * math.cos(found.sum())) <= 10.0
    assert abs(49.05 * (3 * math.cos(found[0]) + math.cos(found.sum()))) <= 200.0


def test_how_far_limits_are_broken() -> None:
    constraints = [
        *places(tip(X, -1, 1, "x"), tip(Z, -np.inf, 0.5, "z")),
        *weights(PLANAR, 1000.0, 40.0),
    ]
    poses = np.array([[0.0, 0.0], [math.pi / 2, 0.0], [math.pi / 2, math.pi / 2]])
    expected = [[1, 0, 0, 9.05], [0, 1.5, 0, 0], [0, 0.5, 0, 9.05]]
    np.testing.assert_allclose(broken(poses, constraints), expected, atol=1e-9)
    assert broken(poses, []).shape == (3, 0)


# -- conflicts that are named ------------------------------------------------------------------------------------------


def test_a_box_out_of_reach() -> None:
    constraints = places(tip(X, -3, 3, "x of tip"), tip(Z, 2.5, 4.0, "z of tip"))
    with pytest.raises(
        InputError,
        match=r"none of 512 poses .* keeps the limits of z of tip .by 0.5 m at least",
    ) as caught:
        start_pose(FREE, ALL, constraints, 0)
    assert caught.value.element == "limits"


def test_boxes_that_exclude_each_other() -> None:
    """The tip cannot be above and its own link below; each could by itself."""
    elbow = PointLimit("z of elbow", "link2", (0.0, 0.0, 0.0), Z, -1, -0.5)
    constraints = places(
        tip(Z, 1.0, 2.0, "z of tip"), elbow, tip(X, -2.5, 2.5, "x of tip")
    )
    with pytest.raises(
        InputError, match=r"keeps the limits of z of tip and of z of elbow together"
    ):
        start_pose(FREE, ALL, constraints, 0)


def test_weights_that_cannot_be_held_anywhere() -> None:
    """A slide that points up carries its weight at every pose."""
    lift = tree(
        "lift", body(1, 0, "prismatic", translation("q1")), values={"g": "9.81"}
    )
    limits = [EffortLimit("q1", "N", 90.0)]
    standard = np.where([name == "M1" for name in lift.parameters], 10.0, 0.0)
    constraints = [effort_limits(lift, limits, EffortModel(standard), 0.0, None)]
    with pytest.raises(
        InputError, match=r"keeps the limits of force of q1 .by 8.1 N at least"
    ):
        start_pose(np.array([np.nan]), ranges((0, 1)), constraints, 0)
    enough = [
        effort_limits(
            lift, [EffortLimit("q1", "N", 99.0)], EffortModel(standard), 0.0, None
        )
    ]
    np.testing.assert_allclose(
        start_pose(np.array([np.nan]), ranges((0, 1)), enough, 0), [0.5]
    )


def test_three_limits_of_which_any_two_can_be_kept() -> None:
    """Halves of the plane that meet in a triangle of no size."""
    third = tuple(np.array([-1.0, 0.0, -1.0]) / math.sqrt(2))
    constraints = places(
        tip(X, 0.6, 9, "right"),
        tip(Z, 0.6, 9, "up"),
        tip(third, -0.6, 9, "below the slope"),  # type: ignore[arg-type]
    )
    with pytest.raises(
        InputError, match="keeps all limits together: right, up, below the slope"
    ):
        start_pose(FREE, ALL, constraints, 0)


def test_a_stated_pose_that_breaks_limits() -> None:
    constraints = places(tip(X, -1, 1, "x of tip"), tip(Z, -1, 1, "z of tip"))
    with pytest.raises(
        InputError, match=r"pose at which motions start breaks the limits of x of tip$"
    ) as caught:
        start_pose(np.array([0.0, 0.0]), ALL, constraints, 0)
    assert caught.value.element == "centre"


def test_a_stated_pose_outside_of_the_ranges() -> None:
    with pytest.raises(
        InputError, match="the centre of 'q2' is outside of its position limits"
    ):
        start_pose(np.array([0.0, 4.0]), ALL, [], 0)
    partly = ranges((-np.inf, np.inf), (-1, 1), (-1, 1))
    with pytest.raises(InputError, match="the centre of 'q2' is outside"):
        start_pose(np.array([0.0, 4.0, 0.0]), partly, [], 0)
