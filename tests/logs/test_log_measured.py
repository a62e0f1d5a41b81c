"""Measured logs: understood by the names of their columns, and sound.

Those in examples/data are always there; the other ones may be absent.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from pyarrow import parquet

import echelon as ec
from echelon.formats.robot_file import load
from echelon.identification.logs.columns.conversion import recording
from echelon.identification.logs.faults.examine import examine
from echelon.identification.logs.faults.plausibility import check_plausible
from echelon.identification.logs.files.log_file import Table
from echelon.identification.logs.preparation.segments import segments
from support.column_maps import PENDULUM, TX40, Floats, N, guess_columns
from support.measured_logs import ELSEWHERE, SHIPPED, absent, measured

PANDA = load("examples/panda.yaml")


def table_of(path: Path) -> Table:
    read = parquet.read_table(path)
    return Table(
        path.name,
        {column: read[column].to_numpy().astype(float) for column in read.column_names},
    )


def real(name: str) -> Table:
    return table_of(measured(name))


REAL = [
    ("double_pendulum/A0_20220812_061157-PM.parquet", PENDULUM, {"qd", "y"}),
    ("double_pendulum/A0_20220815_traj_11.parquet", PENDULUM, {"qd", "y", "reference"}),
    ("panda_1khz/panda_gaz_exciting_1kHz.parquet", PANDA, {"qd", "y"}),
    ("panda_30hz/panda_exciting.parquet", PANDA, {"qd", "y"}),
    ("kuka_lwr4/lwr4_measurements_3.parquet", PANDA, {"qd", "qdd", "y", "reference"}),
    ("staubli_tx40/tx40_5kHz.parquet", TX40, {"y"}),
]


@pytest.mark.parametrize(("name", "robot", "signals"), REAL)
def test_real_logs_are_understood_by_their_names(
    name: str, robot: ec.Mechanism, signals: set[str]
) -> None:
    table = real(name)
    found = recording(table, guess_columns(list(table.columns), robot), robot)
    assert found.signals.keys() == {"q", *signals}
    assert all(np.isfinite(values).all() for values in found.signals.values())


def test_tx40_on_the_joints_side() -> None:
    table = real("staubli_tx40/tx40_5kHz.parquet")
    found = recording(table, guess_columns(list(table.columns), TX40), TX40)
    theta = np.stack([table.columns[f"q_motor_rad_{n}"] for n in range(1, 7)], axis=1)
    tau = np.stack([table.columns[f"tau_motor_Nm_{n}"] for n in range(1, 7)], axis=1)
    assert np.allclose(found.signals["q"] @ N.T, theta, atol=1e-10)
    assert np.allclose(found.signals["y"], tau @ N)


@pytest.mark.parametrize(
    ("folder", "robot"),
    [
        ("double_pendulum", PENDULUM),
        ("panda_1khz", PANDA),
        ("panda_30hz", PANDA),
        ("kuka_lwr4", PANDA),
        ("staubli_tx40", TX40),
    ],
)
def test_real_logs_are_sound(folder: str, robot: ec.Mechanism) -> None:
    files = {
        file.name: file
        for place in (ELSEWHERE, SHIPPED)
        for file in (place / folder).glob("*.parquet")
    }
    if not files:
        absent(ELSEWHERE / folder)
    for file in files.values():
        table = table_of(file)
        recorded = recording(table, guess_columns(list(table.columns), robot), robot)
        findings, usable = examine(recorded, robot)
        assert usable.mean() > 0.995, "all but spikes"
        kinds = [finding.kind for finding in findings if finding.kind != "spikes"]
        assert kinds == ["smooth"] * (folder == "kuka_lwr4")
        assert not check_plausible(recorded, robot)
        parts, more = segments(recorded, robot, usable)
        assert len(parts) == 1
        assert {finding.kind for finding in more} <= {"jitter", "missing"}
        span = recorded.time[-1] - recorded.time[0]
        assert len(parts[0]) == pytest.approx(span * parts[0].rate, abs=1.5)


def test_the_panda_log_names_its_lost_packets() -> None:
    table = real("panda_1khz/panda_gaz_exciting_1kHz.parquet")
    recorded = recording(table, guess_columns(list(table.columns), PANDA), PANDA)
    (part,), findings = segments(recorded, PANDA)
    assert part.rate == 1000
    missing = next(finding for finding in findings if finding.kind == "missing")
    assert f"{len(part) - len(recorded.time)} samples are missing" in missing.text
    assert "up to 8.81 ms" in missing.text

    def mismatch(signals: Mapping[str, Floats]) -> float:
        """Rms of the travel over 100 samples less the integral of the logged velocity at 1 kHz."""
        q, qd = signals["q"], signals["qd"]
        travelled = np.cumsum(0.5 * (qd[1:] + qd[:-1]), axis=0) / 1000
        return float(
            np.sqrt(
                np.mean(
                    ((travelled[100:] - travelled[:-100]) - (q[101:] - q[1:-100])) ** 2
                )
            )
        )

    assert mismatch(part.signals) < 1e-3
    assert mismatch(recorded.signals) > 3e-3, (
        "without resampling the lost time is missing"
    )
