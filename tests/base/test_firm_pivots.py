"""Representatives that work in doubles: torques of Pinocchio, sizes of coefficients, and classical ones that stay."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import echelon as ec
from echelon.base.firm_pivots import LARGEST_COEFFICIENT, firm_order
from echelon.formats.robot_file import RobotFile
from echelon.formats.snapping import ReadingOptions
from support.selection import slow_unless

INERTIAL = """<inertial><origin xyz="0.05 -0.02 0.08" rpy="0 0 0"/><mass value="2"/>
  <inertia ixx="0.03" ixy="0.002" ixz="0.001" iyy="0.02" iyz="-0.003" izz="0.01"/></inertial>"""


def arm(*axes: str) -> str:
    """An arm in general frames, whose axes have tiny components."""
    text = '<link name="l0"/>'
    for k, axis in enumerate(axes, 1):
        text += (
            f'<link name="l{k}">{INERTIAL}</link><joint name="q{k}" type="revolute"><parent link="l{k - 1}"/>'
            f'<child link="l{k}"/><origin xyz="0.2 {k / 10} 0.3" rpy="0.{k} 0.5 0.6"/><axis xyz="{axis}"/>'
            '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
        )
    return f'<robot name="arm">{text}</robot>'


ARMS = {
    "six decimals": arm("1 0.0000004 -0.0000003", "0.0000002 1 0.0000004"),
    "eight decimals": arm("0.00000003 0.6 0.8", "0.00000001 0.00000002 1"),
    "three joints": arm(
        "0.0000003 0.0000002 1", "0.8 0.0000006 0.6", "1 0.0000001 0.0000003"
    ),
}


@cache
def base_of_arm(name: str, budget: float) -> ec.BaseModel:
    robot = RobotFile.of(ARMS[name].encode(), "arm.urdf").mechanism(
        ReadingOptions(snap_tolerance=0)
    )
    return ec.base_parameters(robot, budget=budget)


@pytest.mark.parametrize("name", slow_unless(["six decimals"], ARMS))
@pytest.mark.parametrize("budget", [0.0, 0.2])
def test_numbers_that_nearly_vanish_are_no_representatives(
    name: str, budget: float
) -> None:
    base = base_of_arm(name, budget)
    assert base.largest_coefficient is not None
    assert base.largest_coefficient < 1e3
    assert base.largest_coefficient == np.abs(base.B_float()).max()
    assert any("have a weak effect" in note for note in base.reading.notes)
    model = pin.buildModelFromXML(ARMS[name])
    data, rng = model.createData(), np.random.default_rng(1)
    for _ in range(3):
        q, qd, qdd = rng.uniform(-1, 1, (3, model.nv))
        wanted = pin.rnea(model, data, q, qd, qdd)
        regressor = base.regressor([q], [qd], [qdd])[0]
        np.testing.assert_allclose(
            regressor @ base.values(), wanted, rtol=1e-7, atol=1e-8
        )


def test_the_set_passes_verification_after_it_was_saved(tmp_path: Path) -> None:
    base = base_of_arm("six decimals", 0.2)
    ec.save_base(base, tmp_path / "base.json")
    read = ec.load_base(tmp_path / "base.json")
    assert read.pivots == base.pivots
    assert ec.verify(read).rank == base.rank


def test_other_numbers_leave_the_classical_representatives() -> None:
    """A factor of a thousand between lengths, and lengths in millimetres, make large coefficients without harm."""
    for a, d in (("0.001", "1"), ("1500", "0"), ("0.0002", "0.9")):
        frames = (
            f"alpha: pi/3, a: {a}, d: {d}",
            f"alpha: 0, a: {a}",
            f"alpha: pi/2, d: {d}",
        )
        rows = (
            "[" + ", ".join(f"{{joint: revolute, {frame}}}" for frame in frames) + "]"
        )
        robot = RobotFile.of(
            f"echelon: 1\nname: r\nmodified_dh: {rows}\n".encode(), "r.yaml"
        ).mechanism()
        base = ec.base_parameters(robot)
        assert firm_order(robot, base.matrix) is None
        assert base.matrix.order == tuple(range(len(base.parameters)))


def test_a_preference_that_makes_coefficients_huge_gives_way() -> None:
    """M2 hardly shows at a radius of a tenth of a micrometre."""
    frames = ("alpha: pi/2", "a: 0.0000001", "a: 1")
    rows = "[" + ", ".join(f"{{joint: revolute, {frame}}}" for frame in frames) + "]"
    robot = RobotFile.of(
        f"echelon: 1\nname: r\nmodified_dh: {rows}\n".encode(), "r.yaml"
    ).mechanism(ReadingOptions(snap_tolerance=0))
    base = ec.base_parameters(robot, prefer=["M2"], budget=0)
    assert base.largest_coefficient is not None
    assert base.largest_coefficient < LARGEST_COEFFICIENT
    assert any("MX1 replace M2" in note for note in base.reading.notes)
    assert base.rank == ec.base_parameters(robot).rank


def test_the_largest_coefficient_stands_in_the_text() -> None:
    text = "echelon: 1\nname: r\nmodified_dh: [{joint: revolute}, {joint: revolute, a: 3}, {joint: revolute, a: 5}]\n"
    base = ec.base_parameters(RobotFile.of(text.encode(), "r.yaml").mechanism())
    assert base.largest_coefficient == 25
    assert "largest coefficient: 25\n" in str(base)
