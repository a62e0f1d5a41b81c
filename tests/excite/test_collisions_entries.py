"""Shapes that a set-up names: where they are, and what is wrong with them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from echelon.errors import InputError
from echelon.excite.problem.clearance import clearance_of
from echelon.excite.problem.robot_shapes import entry_shapes
from echelon.excite.problem.shapes import Kind
from support.shaped_robots import planar


def test_entries() -> None:
    mechanism = planar()
    shapes = entry_shapes(
        mechanism,
        [
            {"body": "link3", "sphere": 0.06, "at": [0.5, 0, 0.1]},
            {"body": "link1", "capsule": [0.05], "from": [0, 0, 0], "to": [1, 0, 0], "name": "upper"},
            {"body": "link2", "box": [0.1, 0.2, 0.3], "at": [0, 0, 0.2], "rpy": [0, 0, 0.3]},
            {"body": "world", "plane": [0, 0, 2], "through": [0, 0, -0.1]},
        ],
    )
    assert [(s.body, s.kind, s.size) for s in shapes] == [
        (2, Kind.SPHERE, (0.06,)),
        (0, Kind.CAPSULE, (0.05, 0.5)),
        (1, Kind.BOX, (0.1, 0.2, 0.3)),
        (-1, Kind.PLANE, ()),
    ]
    np.testing.assert_allclose(shapes[1].placement[:3, [2, 3]], [[1, 0.5], [0, 0], [0, 0]], atol=1e-15)
    np.testing.assert_allclose(shapes[2].placement[:2, 0], [np.cos(0.3), np.sin(0.3)])
    # at zero the sphere is at (2.5, 0, 0.1) over the plane, and 1.5 from the end of the capsule
    zero = np.zeros((1, 3))
    clearance = clearance_of(mechanism, shapes, 0.01, reach=10.0)
    assert clearance.labels == (
        "distance of link2 and world",
        "distance of link3 and world",
        "distance of link1 and link3",
    )
    found = dict(zip(clearance.labels, clearance.values(zero, zero, zero)[0], strict=True))
    assert found["distance of link3 and world"] == pytest.approx(0.2 - 0.06)
    assert found["distance of link1 and link3"] == pytest.approx(np.hypot(1.5, 0.1) - 0.11)
    # the box stands on the plane; hulls have single precision in MuJoCo
    assert found["distance of link2 and world"] == pytest.approx(0.0, abs=1e-7)


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ({"body": "link9", "sphere": 1}, r"entry 1: there is no body 'link9' \(valid: link1, link2, link3, world\)"),
        ({"sphere": 1}, "does not name its body"),
        ({"body": "link1"}, "exactly one of sphere.*found none"),
        ({"body": "link1", "sphere": 1, "box": [1, 1, 1]}, "found sphere and box"),
        ({"body": "link1", "sphere": -1}, "radius must be a positive number"),
        ({"body": "link1", "sphere": 0.1, "rpy": [0, 0, 0]}, "'rpy' has no meaning for a sphere"),
        ({"body": "link1", "sphere": 0.1, "at": [0, float("nan"), 0]}, "'at' needs 3 numbers"),
        ({"body": "link1", "capsule": 0.1, "from": [0, 0, 0]}, "needs 'to'"),
        ({"body": "link1", "capsule": 0.1, "from": [0, 0, 0], "to": [0, 0, 0]}, "must not be zero"),
        ({"body": "link1", "plane": [0, 0, 1]}, "only belong to the world"),
        ({"body": "link1", "mesh": "none.stl"}, "is not found"),
        ("link1", "expected a mapping"),
    ],
)
def test_entries_are_checked(entry: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        entry_shapes(planar(), [entry])
