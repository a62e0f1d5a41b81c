"""Numbers of joints about oblique axes, whose sines are irrational while coefficients are not."""

from __future__ import annotations

import pytest

import echelon as ec

LINK = (
    '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
    "</inertial>"
)


@pytest.mark.parametrize("rpy", ["0 0 0", "0.1 0.2 0.3"])
def test_exact_numbers_of_irrational_angles_are_proved(rpy: str) -> None:
    text = (
        f'<robot name="oblique"><link name="base"/><link name="arm">{LINK}</link>'
        '<joint name="j1" type="revolute"><parent link="base"/><child link="arm"/>'
        f'<origin xyz="0.1 0 0" rpy="{rpy}"/><axis xyz="0.123 0.456 -0.3"/>'
        '<limit lower="-3" upper="3" effort="1" velocity="1"/></joint></robot>'
    )
    robot = ec.load(text, snap_tolerance=0)
    formulas, numbers = ec.base_parameters(robot), ec.base_parameters(robot, budget=0)
    assert numbers.rank == formulas.rank == 3
    assert numbers.B_float() == pytest.approx(formulas.B_float(), rel=1e-12)
    assert not numbers.certificate.unchecked
