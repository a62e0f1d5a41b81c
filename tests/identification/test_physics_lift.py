"""Lifts: bodies that exist and have exactly the given base parameters, for set-ups of all kinds."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import echelon as ec
from echelon.base.model import BaseModel
from echelon.identification.physics.bounds import roles
from echelon.identification.physics.feasibility import physical_lift
from echelon.shared.errors import InputError
from support.physical_robots import is_physical, model, robot
from support.selection import slow_unless

SETUPS = {
    "rotor": """
modified_dh:
  - {joint: revolute}
  - {joint: revolute, alpha: pi/2, a: 3/10}
rotors: [{name: rotor2, on: j1, drives: 100*j2, axis: z, frame: {xyz: [1/10, 0, 0]}}]
effects: [{type: spring, at: j1}, {type: asymmetric_coulomb, at: all}, {type: stribeck, at: j2, velocity: 1/10}]
""",
    "wrist": """
modified_dh:
  - {joint: revolute}
  - {joint: revolute, alpha: pi/2, a: 3/10}
  - {joint: revolute, alpha: pi/4, a: 1/10}
outputs: [{wrench: j3}, {joint: j2}]
""",
}


def described(tmp_path: Any, name: str) -> BaseModel:
    file = tmp_path / f"{name}.yaml"
    file.write_text(f"echelon: 1\nname: {name}\n{SETUPS[name]}")
    return ec.base_parameters(ec.load(file))


@pytest.mark.parametrize(
    "name",
    slow_unless(
        lambda name: name != "loops/four_bar",
        [*SETUPS, "floating_tree", "gripper_coupled", "loops/four_bar", "tx40", "ur10"],
    ),
)
def test_lift_has_exactly_the_given_values(tmp_path: Any, name: str) -> None:
    base = described(tmp_path, name) if name in SETUPS else model(name)[0]
    role = roles(base.mechanism)
    rng = np.random.default_rng(15)
    truth = robot(role, rng)
    values = base.values(truth)
    standard = physical_lift(base, values)
    assert standard is not None
    assert np.allclose(base.values(standard), values, rtol=1e-12, atol=1e-12)
    assert is_physical(role.blocks(standard)).all()
    assert (standard[list(role.positive)] >= 0).all()


def test_lift_refuses_what_no_robot_has() -> None:
    base, role = model("panda")
    values = base.values(robot(role, np.random.default_rng(16)))
    place = base.pivots.index("ZZ7")
    assert (
        physical_lift(base, np.where(np.arange(43) == place, -10 * values, values))
        is None
    )
    with pytest.raises(InputError, match="expected 43"):
        physical_lift(base, values[:-1])
    with pytest.raises(InputError, match="finite"):
        physical_lift(base, np.where(np.arange(43) == place, np.nan, values))


def test_rotors_and_springs_have_signs(tmp_path: Any) -> None:
    base = described(tmp_path, "rotor")
    role = roles(base.mechanism)
    positive = [base.parameters[c] for c in role.positive]
    assert len(positive) == 6, positive
    assert {base.parameters[c][:2] for c in role.free} == {"Ps", "Fs"}
