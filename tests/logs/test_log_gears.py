"""Columns of either side of the gears: positions, velocities and torques of motors and of joints."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import echelon as ec
from echelon.formats.robot_file import load
from echelon.identification.logs.columns.column_map import Channel, ColumnMap
from echelon.identification.logs.columns.conversion import recording
from echelon.identification.logs.files.log_file import Table
from support.column_maps import MOTORS, TX40, Floats, N, channels, random_columns

COUPLED = load("examples/coupled_arm.yaml")


def test_motor_side_of_a_coupled_wrist() -> None:
    table = Table(
        "run",
        random_columns(
            [f"q{n}" for n in range(1, 7)] + [f"tau{n}" for n in range(1, 7)]
        ),
    )
    raw = np.stack(list(table.columns.values()), axis=1)
    turned = channels("q{n}", MOTORS) | {"m2": Channel("q2", offset=-16 * math.pi)}
    columns = ColumnMap(
        rate=5000,
        positions=turned,
        references=turned,
        outputs=channels("tau{n}", MOTORS),
    )
    found = recording(table, columns, TX40)
    expected = np.linalg.solve(N, raw[:, :6].T).T - np.array(
        [0, math.pi / 2, 0, 0, 0, 0]
    )
    assert np.allclose(found.signals["q"], expected, atol=1e-14)
    assert np.allclose(found.signals["reference"], expected, atol=1e-14)
    assert np.allclose(found.signals["y"], raw[:, 6:] @ N, rtol=1e-13)


def test_both_sides_may_be_mixed_where_that_determines_all() -> None:
    names = list(TX40.positions)
    q = np.random.default_rng(0).normal(size=(30, 6))
    theta = q @ N.T
    table = Table(
        "run",
        {f"q{n + 1}": q[:, n] for n in range(6)}
        | {f"m{n + 1}": theta[:, n] for n in range(6)},
    )

    def read(*keys: str) -> Floats:
        own = {name: Channel("q" + name[1:]) for name in names}
        chosen = {key: own.get(key, Channel(key)) for key in keys}
        return recording(table, ColumnMap(rate=1, positions=chosen), TX40).signals["q"]

    for keys in (
        ["j1", "j2", "j3", "m4", "j5", "m6"],
        ["m1", "j2", "m3", "m4", "m6", "j6"],
        [*MOTORS[:4], "m6", "m5"],
    ):
        assert np.allclose(read(*keys), q, atol=1e-12)
    with pytest.raises(
        ec.InputError, match="columns are missing for j5, or for the actuators m5, m6"
    ):
        read("j1", "j2", "j3", "j4", "j6")
    with pytest.raises(ec.InputError, match="both sides of a gear"):
        read(*MOTORS, "j1")
    with pytest.raises(ec.InputError, match="m1, m2, m3, m4 alone do not determine"):
        read(*MOTORS[:4])
    with pytest.raises(ec.InputError, match="m4 do not determine j5"):
        read("j1", "j2", "j3", "j4", "m4", "j6")


def test_velocities_of_motors_and_units_of_either_kind() -> None:
    names = [a.name for a in COUPLED.actuators]
    table = Table("run", random_columns(["j1", *names]))
    columns = ColumnMap(
        rate=1,
        positions={"j1": Channel("j1")} | channels("{name}", names),
        velocities={"j1": Channel("j1", "rpm")} | channels("{name}", names, unit="rpm"),
    )
    found = recording(table, columns, COUPLED)
    side = ec.joint_side(
        COUPLED, np.stack([table.columns[n] for n in ["j1", *names]], axis=1)
    )
    assert np.allclose(found.signals["q"], side)
    assert np.allclose(found.signals["qd"], side * math.tau / 60)


def test_forces_that_are_not_those_of_joints_are_refused() -> None:
    names = list(TX40.positions)
    table = Table("run", random_columns([*names, *MOTORS]))
    positions = channels("{name}", names)
    with pytest.raises(
        ec.InputError,
        match="output 'j5': a column is missing for it, or for the actuator 'm6'",
    ):
        recording(
            table,
            ColumnMap(
                rate=1, positions=positions, outputs=channels("{name}", MOTORS[:5])
            ),
            TX40,
        )
    mixed = channels("{name}", [*names[:5], "j6", "m6"])
    with pytest.raises(ec.InputError, match="output of 'm6': no output needs it"):
        recording(table, ColumnMap(rate=1, positions=positions, outputs=mixed), TX40)
    # the coupled arm measures its actuators' forces, which joint torques are not: there is friction in the drives
    torques = channels("{name}", [*COUPLED.velocities])
    table = Table("run", random_columns(list(COUPLED.velocities)))
    columns = ColumnMap(
        rate=1, positions=channels("{name}", list(COUPLED.positions)), outputs=torques
    )
    with pytest.raises(
        ec.InputError, match="output of 'j2': coupled arm has no output or actuator"
    ):
        recording(table, columns, COUPLED)


def test_friction_in_the_drive_stands_between_motor_and_joint(tmp_path: Path) -> None:
    text = (
        Path("examples/tx40.yaml")
        .read_text()
        .replace("{type: viscous, at: all, side: joint}", "{type: viscous, at: m6}")
    )
    assert "at: m6" in text
    file = tmp_path / "arm.yaml"
    file.write_text(text)
    arm = load(file)
    table = Table("run", random_columns([*arm.positions, *MOTORS]))
    columns = ColumnMap(
        rate=1,
        positions=channels("{name}", list(arm.positions)),
        outputs=channels("{name}", MOTORS),
    )
    with pytest.raises(
        ec.InputError,
        match="actuator 'm6' differs from that at the joint by the effect 'Fv6'",
    ):
        recording(table, columns, arm)
