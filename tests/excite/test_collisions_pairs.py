"""Which pairs of bodies are checked: not neighbours, nor what is excluded or touches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import echelon as ec
from echelon.errors import InputError
from echelon.excite.problem.clearance import checked_pairs, clearance_of
from echelon.excite.problem.robot_shapes import entry_shapes
from echelon.excite.problem.shapes import Shape
from echelon.excite.problem.task import task_of
from echelon.excite.verify.clearance_bounds import least_clearances
from echelon.mechanism.joint import rotation
from support.shaped_robots import motion, planar, spheres
from support.textbook_arms import body, place, tree


def test_neighbours_are_not_checked() -> None:
    mechanism = planar(4)
    found = {tuple(pair) for pair in checked_pairs(mechanism, spheres(mechanism)).tolist()}
    # index 0 is the world
    assert found == {(0, 2), (0, 3), (0, 4), (1, 3), (1, 4), (2, 4)}
    fewer = checked_pairs(mechanism, spheres(mechanism), [("link4", "link2"), ("stone", "link2"), ("world", "link3")])
    assert {tuple(pair) for pair in fewer.tolist()} == {(0, 4), (1, 3), (1, 4)}
    with pytest.raises(InputError, match="no body, link or shape 'link7' to exclude"):
        checked_pairs(mechanism, spheres(mechanism), [("link7", "link1")])


def test_rigidly_connected_bodies_count_as_one() -> None:
    mechanism = tree(
        "kept",
        body(1, 0, "revolute", rotation("q1")),
        body(2, 1, "fixed", place("1 0 0")),
        body(3, 2, "revolute", rotation("q3")),
        body(4, 0, "fixed", place("0 1 0")),
    )
    found = {tuple(pair) for pair in checked_pairs(mechanism, spheres(mechanism)).tolist()}
    # 2 is 1; 4 is the world
    assert found == {(0, 3), (3, 4)}


def test_touching_pairs_are_left_out_on_request() -> None:
    mechanism = planar()
    shapes = entry_shapes(mechanism, [{"body": f"link{k}", "sphere": 1.2, "name": f"s{k}"} for k in (1, 3)])
    assert len(clearance_of(mechanism, shapes, 0.01).pairs) == 1
    found = clearance_of(mechanism, shapes, 0.01, ignore_touching=True)
    assert len(found.pairs) == 0
    assert found.notes == ("'s1' and 's3' are not checked: they are too near at the reference pose",)
    assert found.values(np.zeros((2, 3)), np.zeros((2, 3)), np.zeros((2, 3))).shape == (2, 0)
    assert least_clearances(found, motion(mechanism, 0)).bounds.shape == (0,)


ARM = """
echelon: 1
name: arm
modified_dh: [{joint: revolute}, {joint: revolute, a: 1}]
excitation:
  limits: {position: [-2, 2], effort: none}
  collisions:
    shapes: [{body: j1, sphere: 0.1}, {body: j2, sphere: 0.1, at: [1, 0, 0]}]
    obstacles:
      - {name: table, box: [0.2, 0.2, 0.1], at: [2, 0.5, 0]}
      - {plane: [0, 0, 1], through: [0, 0, -0.3]}
      - {name: table, box: [0.1, 0.1, 0.1], at: [2, -0.35, 0]}
    exclude: EXCLUDED
"""


@pytest.mark.parametrize(
    ("excluded", "expected"),
    [
        ("[]", ["j1 and table", "j2 and table", "j1 and plane 2", "j2 and plane 2"]),
        ("[[j1, table]]", ["j2 and table", "j1 and plane 2", "j2 and plane 2"]),
        ("[[plane 2, j2], [table, j1]]", ["j2 and table", "j1 and plane 2"]),
        ("[[j1, world]]", ["j2 and table", "j2 and plane 2"]),
    ],
)
def test_obstacles_of_a_set_up_go_by_their_names(tmp_path: Path, excluded: str, expected: list[str]) -> None:
    file = tmp_path / "arm.yaml"
    file.write_text(ARM.replace("EXCLUDED", excluded))
    setup = ec.load_setup(file)
    clearance = task_of(setup, setup.excitation).constraints[-1]
    assert list(clearance.labels) == [f"distance of {pair}" for pair in expected]
    found = dict(zip(expected, clearance.values(*np.zeros((3, 1, 2)))[0], strict=True))
    # two boxes are one table; the sphere at (2, 0, 0) is nearer to the second
    assert found["j2 and table"] == pytest.approx(0.15, abs=1e-7)
    if "j1 and plane 2" in found:
        assert found["j1 and plane 2"] == pytest.approx(0.2)


def obstacles(*entries: dict[str, Any]) -> Sequence[Shape]:
    found = entry_shapes(planar(), [{"body": "world", **entry} for entry in entries])
    return [replace(shape, obstacle=True) for shape in found]


def test_an_obstacle_with_a_name_of_the_world_stands_for_itself() -> None:
    around = obstacles({"name": "ground", "plane": [0, 0, 1], "through": [0, 0, -1]}, {"name": "post", "sphere": 0.1})
    shapes = [*spheres(planar()), *around]
    names = [shape.name for shape in shapes]
    for name, left in (("ground", {"post", "stone"}), ("base", set()), ("world", set())):
        pairs = checked_pairs(planar(), shapes, [("link3", name)]).tolist()
        third = names.index("link3:sphere4")
        assert {names[i] for i, j in pairs if j == third} - {"link1:sphere2"} == left


def test_fixed_parts_of_the_robot_are_the_world() -> None:
    shapes = [*obstacles({"name": "post", "sphere": 0.1}), *spheres(planar(2))]
    assert clearance_of(planar(2), shapes, 0.01).labels == (
        "distance of link1 and post",
        "distance of link2 and post",
        "distance of link2 and world",
    )
