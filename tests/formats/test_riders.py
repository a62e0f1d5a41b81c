"""Links of URDF files that are fixed to others."""

from __future__ import annotations

import numpy as np
import pytest

from echelon.formats.robot_file import open_robot
from echelon.formats.snapping import ReadingOptions
from echelon.robot.joint import GROUND
from echelon.robot.stated import known_values, placement_matrix
from support.robot_files import pinocchio_model, robot_file


@pytest.mark.parametrize("name", ["panda", "talos_full_v2", "romeo"])
def test_fixed_links_are_where_pinocchio_has_them(name: str) -> None:
    import pinocchio as pin

    built = open_robot(robot_file(name)).built(
        ReadingOptions(snap_tolerance=0, symbolic=False)
    )
    robot, model = built.mechanism, pinocchio_model(robot_file(name), False)
    frames = {frame.name: frame for frame in model.frames if frame.type == pin.BODY}
    places = {link: built.place(link) for link in built.rides if link in frames}
    assert len(places) > 2
    for link, (body, placement) in places.items():
        known = known_values(robot) | {
            name: symbol.value or 0.0 for name, symbol in built.snapping.symbols.items()
        }
        expected = frames[link].placement
        if body != GROUND:
            expected = frames[robot.bodies[body].name].placement.inverse() * expected
        np.testing.assert_allclose(
            placement_matrix(placement, known), expected.homogeneous, atol=1e-9
        )
