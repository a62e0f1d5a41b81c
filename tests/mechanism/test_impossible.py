"""Inertias that no body can have, and who warns of them."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np

import echelon as ec
from echelon.robot.impossible import impossibility
from echelon.robot.inertia import from_pseudo_inertia, move
from support.command_line import run

HIP = """<robot name="negative_hip">
  <link name="trunk"><inertial><mass value="-3"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <link name="hip"><inertial><origin xyz="0.002 0.001 0"/><mass value="0.53"/>
    <inertia ixx="-0.0012" ixy="1.8e-05" ixz="0" iyy="0.0012" iyz="0" izz="0.00033"/></inertial></link>
  <link name="tool"><inertial><mass value="5"/><inertia ixx="TOOL" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/>
    </inertial></link>
  <joint name="hip_joint" type="revolute"><parent link="trunk"/><child link="hip"/><axis xyz="1 0 0"/>
    <limit lower="-1" upper="1" effort="9.1" velocity="20"/></joint>
  <joint name="flange" type="fixed"><parent link="hip"/><child link="tool"/><origin xyz="0.1 0.2 0"/></joint>
</robot>"""

TWO_ROWS = """echelon: 1
gravity: [0, -9.81, 0]
modified_dh:
  - {joint: revolute, inertial: {standard: [0.1, 0, 0, 0.1, 0, 0.1, 0.2, 0, 0, 1]}}
  - {joint: revolute, a: 0.3, inertial: {standard: [0.1, 0, 0, 0.1, 0, -0.1, 0, 0, 0, 1]}}
"""


def said(robot: str) -> list[str]:
    """Warnings of the values of a robot's base parameters."""
    base = ec.base_parameters(ec.load(robot))
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        base.values()
    assert all(one.category is ec.DoubtWarning for one in found)
    assert all(
        one.filename == __file__ for one in found
    )  # where a user asked for the values
    return [str(one.message) for one in found]


def test_densities_of_mass_are_possible_in_every_frame() -> None:
    """A body of a few points of mass exists, wherever it is looked at from."""
    rng = np.random.default_rng(4)
    for _ in range(50):
        points = np.hstack([rng.normal(size=(5, 3)), np.ones((5, 1))])
        J = (points * rng.uniform(0.1, 2, (5, 1))).T @ points
        frame = np.eye(4)
        frame[:3, 3] = rng.normal(size=3)
        assert impossibility(move(from_pseudo_inertia(J), frame)) == ""
        J[0, 0] = -J[0, 0] - 10 * J[3, 3]
        assert impossibility(from_pseudo_inertia(J)) != ""


def test_links_are_named_once_and_only_those_that_move() -> None:
    (hip,) = said(HIP.replace("TOOL", "0.1"))
    assert hip.startswith(
        "link 'hip': a principal moment of inertia is negative: -0.0012 kg·m²"
    )
    assert [text.split(":")[0] for text in said(HIP.replace("TOOL", "1"))] == [
        "link 'hip'",
        "link 'tool'",
    ]


def test_rows_of_a_description_are_named() -> None:
    (text,) = said(TWO_ROWS)
    assert "principal moment of inertia is negative" in text
    assert said(TWO_ROWS.replace("-0.1,", "0.1,")) == []


def test_every_command_that_uses_values_names_them(tmp_path: Path) -> None:
    (tmp_path / "hip.urdf").write_text(
        HIP.replace("TOOL", "0.1").replace("0.0012", "1.2")
    )
    robot, saved = str(tmp_path / "hip.urdf"), str(tmp_path / "hip.json")
    derived = run("derive", robot, "--format", "json", "-o", saved)
    assert "negative" not in derived.stderr  # no value is used
    for source in (robot, saved):
        found = run(
            "generate",
            source,
            "--target",
            "python",
            "--parameters",
            "file",
            "-o",
            str(tmp_path / "out"),
        )
        assert found.returncode == 0, found.stderr
        assert (
            found.stderr.count(
                "warning: link 'hip': a principal moment of inertia is negative"
            )
            == 1
        )
    plain = run("generate", robot, "--target", "python", "-o", str(tmp_path / "plain"))
    assert "negative" not in plain.stderr
