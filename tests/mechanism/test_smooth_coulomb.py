"""Friction that turns its sign within a stated width, Fc tanh(q̇/width)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import echelon as ec
from echelon.dynamics.evaluate import evaluate_floats
from echelon.dynamics.linear_forms import inverse_dynamics_regressor
from echelon.formats.robot_file import open_robot
from echelon.formats.writers.robot_writer import identified_robot
from echelon.robot.effect import CONSTANTS

URDF = """<robot name="arm"><link name="base"/><link name="one"/>
<joint name="j1" type="continuous"><parent link="base"/><child link="one"/><axis xyz="0 1 0"/></joint>
</robot>"""
SETUP = """
echelon: 1
name: arm
symbols: {w: 0.25}
robot: {file: arm.urdf}
actuators: {m: -4*j1}
effects:
  - {type: viscous, at: m}
  - {type: smooth_coulomb, at: m, width: 2*w}
"""


def described(folder: Path, old: str = "", new: str = "") -> ec.Mechanism:
    (folder / "arm.urdf").write_text(URDF)
    (folder / "arm.yaml").write_text(SETUP.replace(old, new) if old else SETUP)
    return ec.load(folder / "arm.yaml")


def test_it_is_a_column_of_the_drive(tmp_path: Path) -> None:
    robot = described(tmp_path)
    q, qd, qdd = np.random.default_rng(0).normal(size=(3, 20, 1))
    x = evaluate_floats(inverse_dynamics_regressor(robot), robot, q, qd, qdd)
    column = x[:, 0, robot.parameters.index("Fc_m")]
    np.testing.assert_allclose(column, np.tanh(-4 * qd[:, 0] / 0.5), rtol=1e-12)
    base = ec.base_parameters(robot)
    assert "Fc_m" in base.pivots
    assert base.certificate.rank == base.rank


def test_robot_files_state_it_at_the_joint_and_say_what_they_lose(
    tmp_path: Path,
) -> None:
    robot = described(tmp_path)
    body = [1.0, 0, 0, 1.0, 0, 1.0, 0, 0, 0, 1.0]
    effects = {"Fv_m": 2.0, "Fc_m": 0.75}
    values = [*body, *(effects[name] for name in robot.parameters[10:])]
    file = open_robot(tmp_path / "arm.urdf")
    (written,) = identified_robot(robot, values, file)
    # τ = N (Fv N q̇ + Fc tanh(N q̇/w)), whose sign is that of q̇
    assert '<dynamics damping="32.0" friction="3.0"/>' in written.text
    lost = "URDF states Coulomb friction without a width, which is left out: Fc_m"
    assert lost in written.notes


@pytest.mark.parametrize("width", ["0", "0.0", "-0.1", "-sqrt(2)/10", "1/10 - 1/5"])
def test_widths_are_positive(tmp_path: Path, width: str) -> None:
    with pytest.raises(ec.InputError, match="'width' of a smooth_coulomb effect is mo"):
        described(tmp_path, "2*w", width)


def test_a_range_of_widths_belongs_to_a_symbol(tmp_path: Path) -> None:
    with pytest.raises(ec.InputError, match=r"symbols: \{w: \{fit: "):
        described(tmp_path, "2*w", "{fit: [0.01, 1]}")


@pytest.mark.parametrize("constants", ["velocity: -0.05", "velocity: 1, exponent: -2"])
def test_constants_of_other_laws_are_positive_too(
    tmp_path: Path, constants: str
) -> None:
    new = f"stribeck, at: m, {constants}"
    with pytest.raises(ec.InputError, match="of a stribeck effect is more than 0"):
        described(tmp_path, "viscous, at: m", new)


def test_a_width_is_stated_and_only_here(tmp_path: Path) -> None:
    with pytest.raises(ec.InputError, match=r"needs 'width', such as width: 0\.01"):
        described(tmp_path, ", width: 2*w", "")
    with pytest.raises(ec.InputError, match="a viscous effect has no 'width'"):
        described(tmp_path, "viscous, at: m", "viscous, width: 1, at: m")


def test_every_constant_can_be_stated() -> None:
    from echelon.formats.schema.schema_setup import ReadyEffect

    needed = {name for some in CONSTANTS.values() for name in some}
    assert needed <= ReadyEffect.model_fields.keys()
