"""Logs in which rows of several recordings or joints take turns are refused, and rows that only seem so are not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import echelon as ec
from echelon.identification.logs.faults.mixed_rows import check_not_mixed
from echelon.identification.setup.logs import with_logs
from echelon.identification.setup.setup import load_setup
from echelon.identification.surveying import first_look
from support.faulty_logs import RATE, Floats, changed, clean
from support.paths import ROOT

OTHER_STAMPS = 0.3 / RATE


def columns(seed: int, late: float = 0.0) -> Floats:
    """Time, two positions and two outputs of a recording, a row per sample."""
    recorded = clean(seed)
    return np.column_stack(
        [recorded.time + late, recorded.signals["q"], recorded.signals["y"]]
    )


def look(path: Path, rows: Floats, head: str) -> None:
    np.savetxt(path, rows, delimiter=",", header=head, comments="", fmt="%.8g")
    setup, paths, _ = with_logs(
        load_setup(ROOT / "examples/double_pendulum.yaml"), [path], ()
    )
    first_look(setup, paths)


@pytest.mark.parametrize("late", [0.0, OTHER_STAMPS])
@pytest.mark.parametrize("count", [2, 3])
def test_recordings_that_take_turns(tmp_path: Path, late: float, count: int) -> None:
    rows = np.concatenate([columns(k, k * late) for k in range(count)])
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    with pytest.raises(ec.InputError, match=rf"m\.csv: .*rows of {count} recordings"):
        look(tmp_path / "m.csv", rows, "time,q1,q2,tau1,tau2")
    look(tmp_path / "one.csv", columns(0), "time,q1,q2,tau1,tau2")


def test_the_same_recording_twice(tmp_path: Path) -> None:
    with pytest.raises(
        ec.InputError, match=r"5000 of 10000 time stamps repeat.*give each a file"
    ):
        look(tmp_path / "m.csv", columns(0).repeat(2, axis=0), "time,q1,q2,tau1,tau2")


@pytest.mark.parametrize("label", ["id", "can_id", "joint", ""])
def test_a_row_for_each_joint(tmp_path: Path, label: str) -> None:
    rows = columns(0)
    joints = [
        np.column_stack([rows[:, 0], 0 * rows[:, 0] + k + 1, rows[:, [k + 1, k + 3]]])
        for k in range(2)
    ]
    every = np.concatenate(joints)
    every = every[np.argsort(every[:, 0], kind="stable")]
    if label:
        look(tmp_path / "m.csv", every, f"time,{label},position,effort")
        return
    with pytest.raises(ec.InputError, match=r"every 'time' occurs 2 times.*'joint'"):
        look(tmp_path / "m.csv", every[:, [0, 2, 3]], "time,position,effort")


def test_noise_steps_and_slow_motions_do_not_take_turns() -> None:
    recorded, rng = clean(), np.random.default_rng(1)
    q = recorded.signals["q"]
    for values in (
        q,
        np.round(q, 1),
        rng.normal(size=q.shape),
        np.repeat(q[::4], 4, axis=0)[: len(q)],
        np.where(np.arange(2) == 0, rng.integers(0, 2, (len(q), 1)), q),
        0 * q,
    ):
        check_not_mixed(changed(recorded, "q", values))
    mixed = np.where((np.arange(len(q)) % 2 == 0)[:, None], q, clean(5).signals["q"])
    with pytest.raises(ec.InputError, match="take turns"):
        check_not_mixed(changed(recorded, "q", mixed))
