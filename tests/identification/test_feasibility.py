"""Whether robots with given base parameters exist, checked by other means."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import echelon as ec
from echelon.base.model import BaseModel
from echelon.identification.physics.bounds import Roles, roles
from echelon.identification.physics.feasibility import (
    feasibility,
    nearest_physical,
    sizes_of,
)
from echelon.shared.errors import InputError
from support.physical_robots import is_physical, robot
from support.selection import examples, slow_unless

seeds = st.integers(0, 2**32 - 1)
NAMES = (
    "double_pendulum",
    "cart_pole",
    "furuta",
    "scara",
    "puma560",
    "panda",
    "tx40",
    "floating_tree",
)


@cache
def model(name: str) -> tuple[BaseModel, Roles]:
    base = ec.base_parameters(ec.load(f"examples/{name}.yaml"))
    return base, roles(base.mechanism)


def outside(base: BaseModel, role: Roles, rng: np.random.Generator) -> np.ndarray:
    """Values that no robot has: an entry that is positive for all robots is negative."""
    values = base.values(robot(role, rng))
    sure = [
        k
        for k, p in enumerate(base.matrix.pivots)
        if p in role.positive
        or (base.mechanism.columns[p].kind in (0, 3, 5, 9) and _all_positive(base, k))
    ]
    values[rng.choice(sure)] *= -3
    return values


def _all_positive(base: BaseModel, k: int) -> bool:
    """Whether a base parameter is a sum of moments of inertia and masses with positive factors."""
    kinds = [
        (base.mechanism.columns[c].kind, v)
        for c, v in enumerate(base.B_float()[k])
        if v
    ]
    return all(kind in (0, 3, 5, 9, None) and v > 0 for kind, v in kinds)


@examples(12)
@given(seeds, st.sampled_from(NAMES))
def test_robots_that_exist_are_found(seed: int, name: str) -> None:
    base, role = model(name)
    values = base.values(robot(role, np.random.default_rng(seed)))
    found = feasibility(base, values)
    assert found.feasible is True
    assert found.distance == 0
    assert found.standard is not None
    assert np.allclose(
        base.values(found.standard),
        values,
        rtol=1e-9,
        atol=1e-12 * np.abs(values).max(),
    )
    assert (found.standard[list(role.positive)] >= 0).all()
    assert is_physical(role.blocks(found.standard)).all()


@examples(12)
@given(seeds, st.sampled_from(NAMES))
def test_values_that_no_robot_has_are_told(seed: int, name: str) -> None:
    base, role = model(name)
    rng = np.random.default_rng(seed)
    values = outside(base, role, rng)
    found = feasibility(base, values)
    assert found.feasible is False
    assert found.standard is None
    assert found.nearest is not None
    # robots form a convex cone, so the way to the nearest one separates the values from all of them
    size = sizes_of(base, values)
    separator = (found.nearest - values) / size**2
    assert found.distance == pytest.approx(
        np.linalg.norm((found.nearest - values) / size)
    )
    assert separator @ values < 0
    for _ in range(20):
        other = base.values(robot(role, rng))
        assert separator @ other > -1e-3 * np.linalg.norm(
            separator * size
        ) * np.linalg.norm(other / size)


def test_the_nearest_robot_of_a_cart_has_no_mass() -> None:
    base, role = model("cart_pole")
    values = base.values(robot(role, np.random.default_rng(1)))
    place = base.pivots.index("M1")
    values[place] = -2.0
    deviations = np.full(len(values), 1e-3)
    deviations[place] = 0.5
    found = feasibility(base, values, np.diag(deviations**2))
    # the total mass cannot be below that of the pole, which its first moments and its inertia demand
    standard, distance = nearest_physical(base, values, np.diag(deviations**2))
    assert found.distance == pytest.approx(distance)
    inertia, *moments = base.values(standard)[1:]
    least = np.sum(np.square(moments)) / inertia
    assert distance == pytest.approx((2 + least) / 0.5, rel=0.02)
    assert is_physical(role.blocks(standard)).all()


@pytest.mark.parametrize(
    "name", slow_unless(["floating_tree"], ["panda", "floating_tree", "tx40"])
)
def test_where_the_nearest_robot_is_the_answer_turns(name: str) -> None:
    base, role = model(name)
    rng = np.random.default_rng(3)
    inner, values = base.values(robot(role, rng)), outside(base, role, rng)
    beyond = feasibility(base, values)
    assert beyond.nearest is not None
    towards = [beyond.nearest + s * (inner - beyond.nearest) for s in (0.01, 0.5)]
    assert [feasibility(base, v).feasible for v in towards] == [True, True]
    # a segment from inside to outside leaves the robots once
    answers = [
        feasibility(base, inner + s * (values - inner)).feasible
        for s in np.linspace(0, 1, 11)
    ]
    last = max(k for k, a in enumerate(answers) if a)
    assert answers[: last + 1] == [True] * (last + 1)
    assert all(a is not True for a in answers[last + 1 :])
    assert answers[-1] is False


def test_values_on_the_boundary_are_not_told_either_way() -> None:
    base, role = model("cart_pole")
    standard = np.zeros(role.size)
    found = feasibility(base, base.values(standard))
    assert found.feasible is None
    assert "boundary" in repr(found)
    assert found.nearest is not None


IRRATIONAL = """
echelon: 1
name: tilted
symbols: {a: 0.3, tilt: 0.3}
gravity: [0, 0, -9.81]
modified_dh:
  - {joint: revolute, alpha: tilt}
  - {joint: revolute, alpha: pi/4, a: a}
  - {joint: revolute, alpha: pi/3, a: a}
"""


def test_irrational_geometry(tmp_path: Path) -> None:
    file = tmp_path / "tilted.yaml"
    file.write_text(IRRATIONAL)
    base = ec.base_parameters(ec.load(file))
    role = roles(base.mechanism)
    values = base.values(robot(role, np.random.default_rng(4)))
    found = feasibility(base, values)
    assert found.feasible is True
    place = base.pivots.index("ZZ3")
    values[place] *= -1
    found = feasibility(base, values)
    assert found.feasible is False


OTHERS: dict[str, str] = {
    "rotor": """
modified_dh: [{joint: revolute}, {joint: revolute, alpha: pi/2, a: 3/10}]
rotors: [{name: rotor2, on: j1, drives: 100*j2, axis: z, frame: {xyz: [1/10, 0, 0]}}]
effects: [{type: spring, at: j1}, {type: asymmetric_coulomb, at: all}]
""",
    "wrist": """
modified_dh: [{joint: revolute}, {joint: revolute, alpha: pi/2, a: 3/10}, {joint: revolute, alpha: pi/2, a: 1/10}]
outputs: [{wrench: j3}, {joint: j2}]
""",
}


@pytest.mark.parametrize(
    "name",
    slow_unless(
        lambda name: name != "loops/four_bar",
        ["rotor", "wrist", "loops/four_bar", "loops/parallelogram", "gripper_coupled"],
    ),
)
def test_all_kinds_of_set_ups(tmp_path: Path, name: str) -> None:
    if name in OTHERS:
        file = tmp_path / f"{name}.yaml"
        file.write_text(f"echelon: 1\nname: {name}\n{OTHERS[name]}")
        base = ec.base_parameters(ec.load(file))
    else:
        base = model(name)[0]
    role = roles(base.mechanism)
    rng = np.random.default_rng(5)
    values = base.values(robot(role, rng))
    assert feasibility(base, values).feasible is True
    assert feasibility(base, -values).feasible is False


def test_wrong_arguments_are_refused() -> None:
    base, role = model("scara")
    values = base.values(robot(role, np.random.default_rng(6)))
    wrong: list[tuple[Any, Any, str]] = [
        (values[1:], None, "expected"),
        (np.full(len(values), np.inf), None, "finite"),
        (-values, np.eye(2), "covariance of shape"),
        (-values, np.zeros((len(values),) * 2), "not positive"),
        (-values, np.ones((len(values),) * 2), "positive definite"),
    ]
    for given_values, covariance, message in wrong:
        with pytest.raises(InputError, match=message):
            feasibility(base, given_values, covariance)
