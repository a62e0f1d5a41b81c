"""Clearances that pairs can have: spheres on planar links, whose distances are known by hand."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from echelon.excite.problem.allowances import Allowances, allowances_of
from echelon.excite.problem.clearance import clearance_of
from echelon.excite.problem.robot_shapes import entry_shapes
from echelon.shared.errors import InputError
from support.shaped_robots import planar


def allowed(
    *obstacles: dict[str, Any],
    shapes: Sequence[dict[str, Any]],
    clearance: float = 0.02,
) -> Allowances:
    """Allowances of three links of length 1 that turn about z, with shapes on them."""
    from dataclasses import replace

    mechanism = planar()
    around = entry_shapes(
        mechanism, [{"body": "world", **obstacle} for obstacle in obstacles]
    )
    own = entry_shapes(mechanism, shapes)
    found = clearance_of(
        mechanism,
        [*own, *(replace(shape, obstacle=True) for shape in around)],
        clearance,
    )
    return allowances_of(found, np.random.default_rng(1).uniform(-3, 3, (512, 3)))


def ball(body: str, radius: float, **more: Any) -> dict[str, Any]:
    return {"body": body, "sphere": radius, **more}


def test_a_pair_that_never_reaches_the_clearance_keeps_seven_tenths_of_its_largest_distance() -> (
    None
):
    """Centres of the first and the third frame are at most 2 apart: of 1.985 by radii 0.015 are left."""
    found = allowed(shapes=[ball("link1", 1.0), ball("link3", 0.985)])
    assert found.clearance.low == pytest.approx([0.010])
    (text,) = found.lowered
    assert text.startswith("distance of link3 and link1: 0.01") or text.startswith(
        "distance of link1 and link3: 0.01"
    )
    assert text.endswith("m at most, so 0.010 m is kept")
    assert not found.unchecked


def test_a_distance_that_no_pose_changes_is_said_to_be_one() -> None:
    """A ball at the axis of the first joint turns on the spot."""
    found = allowed(
        {"name": "table", "box": [18, 18, 2], "at": [0, 0, -1.216]},
        shapes=[ball("link1", 0.2)],
    )
    assert found.lowered == (
        "distance of link1 and table: 0.0160 m whatever the pose, so 0.011 m is kept",
    )
    assert found.clearance.low == pytest.approx([0.011])


def test_what_reaches_the_clearance_is_left_as_it_is() -> None:
    found = allowed(shapes=[ball("link1", 0.5), ball("link3", 0.5)])
    assert (found.lowered, found.unchecked) == ((), ())
    assert found.clearance.low == pytest.approx([0.02])


def test_shapes_of_the_robot_that_always_overlap_are_not_checked_but_their_neighbours_are() -> (
    None
):
    found = allowed(
        shapes=[
            ball("link1", 1.2, name="big"),
            ball("link3", 1.2, name="huge"),
            ball("link3", 0.3),
        ]
    )
    (text,) = found.unchecked
    assert text.startswith("'big' and 'huge' overlap in all poses (-0.4")
    assert len(found.clearance.pairs) == 1
    assert found.clearance.labels == ("distance of link1 and link3",)


def test_an_obstacle_that_no_pose_keeps_clear_of_is_refused_with_the_distance_reached() -> (
    None
):
    with pytest.raises(
        InputError,
        match=r"distance of link2 and wall: -0\.\d+ m at most; .* exclude: \[\[link2, wall",
    ):
        allowed(
            {"name": "wall", "box": [1, 6, 2], "at": [1.2, 0, 0]},
            shapes=[ball("link2", 1.9)],
        )


@pytest.mark.parametrize(
    ("obstacle", "problem"),
    [
        (
            {"name": "crate", "box": [2, 2, 2]},
            "'crate' holds the base: obstacles are solid.* full lengths, so this one measures 2 × 2 × 2 m",
        ),
        (
            {"name": "table", "plane": [0, 0, -1], "through": [0, 0, -0.5]},
            r"whose normal .* plane: \[0, 0, 1\]",
        ),
    ],
)
def test_obstacles_that_hold_the_base_are_refused(
    obstacle: dict[str, Any], problem: str
) -> None:
    with pytest.raises(InputError, match=problem):
        allowed(obstacle, shapes=[ball("link1", 0.1), ball("link3", 0.1)])
