"""Which pairs of bodies are checked: not neighbours, nor what is excluded or touches."""

from __future__ import annotations

import numpy as np
import pytest

from arms import body, place, tree
from clearances import motion, planar, spheres
from echelon.errors import InputError
from echelon.excite.collisions.certificate import least_clearances
from echelon.excite.collisions.constraint import clearance_of
from echelon.excite.collisions.entries import entry_shapes
from echelon.excite.collisions.pairs import checked_pairs
from echelon.mechanism.joint import rotation

pytest.importorskip("mujoco")


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
