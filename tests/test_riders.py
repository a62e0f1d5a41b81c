"""Links of URDF files that are fixed to others."""

from __future__ import annotations

import numpy as np
import pytest

import echelon as ec
from echelon.mechanism.mechanism import GROUND
from echelon.mechanism.values import known_values, placement_matrix
from robots import pinocchio_model, robot_file


@pytest.mark.parametrize("name", ["panda", "talos_full_v2", "romeo"])
def test_fixed_links_are_where_pinocchio_has_them(name: str) -> None:
    pin = pytest.importorskip("pinocchio")
    robot, model = ec.load(robot_file(name), tolerance=0, symbolic=False), pinocchio_model(robot_file(name), False)
    assert robot.reading is not None
    frames = {frame.name: frame for frame in model.frames if frame.type == pin.BODY}
    riders = {link: rider for link, rider in robot.reading.riders.items() if link in frames}
    assert len(riders) > 2
    for link, rider in riders.items():
        known = known_values(robot) | {symbol.name: symbol.value or 0.0 for symbol in rider.symbols}
        expected = frames[link].placement
        if rider.body != GROUND:
            expected = frames[robot.bodies[rider.body].name].placement.inverse() * expected
        np.testing.assert_allclose(placement_matrix(rider.placement, known), expected.homogeneous, atol=1e-9)
