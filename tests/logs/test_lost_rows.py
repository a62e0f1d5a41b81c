"""Rows that a logger lost without a gap in its time stamps: found by the steps of all joints, and nowhere else."""

from __future__ import annotations

import numpy as np
import pytest

from echelon.identification.logs.faults.lost_rows import with_lost_rows
from echelon.identification.logs.recording import Recording
from support.simulated_motions import RATE, fourier

JOINTS = 4


def recording(
    keep: slice | np.ndarray, *, noise: float = 1e-5, held: int = 0
) -> Recording:
    """Positions of an arm, some rows of them, with the time stamps of a logger that counts rows."""
    rng = np.random.default_rng(5)
    q = fourier(rng, JOINTS, 0.9)[0]
    if held:
        q[held::held] = q[held - 1 : -1 : held][: len(q[held::held])]
    q = (q + noise * rng.standard_normal(q.shape))[keep]
    return Recording("run", np.arange(len(q)) / RATE, {"q": q})


def thinned(share: float) -> np.ndarray:
    """Which rows are kept."""
    return (
        np.random.default_rng(7).random(
            len(fourier(np.random.default_rng(5), JOINTS, 0.9)[0])
        )
        > share
    )


@pytest.mark.parametrize("share", [0.01, 0.03, 0.05])
def test_lost_rows_are_found_and_the_clock_is_set_on(share: float) -> None:
    kept = thinned(share)
    mended, (finding,) = with_lost_rows(recording(kept))
    assert finding.kind == "lost rows"
    true = np.flatnonzero(kept) / RATE
    late = mended.time - mended.time[0] - (true - true[0])
    assert np.abs(late).max() < 0.25 * share * true[-1] + 3 / RATE


@pytest.mark.parametrize("held", [0, 50])
def test_whole_logs_and_held_samples_lose_nothing(held: int) -> None:
    log = recording(slice(None), held=held)
    mended, findings = with_lost_rows(log)
    assert not findings
    np.testing.assert_array_equal(mended.time, log.time)


def test_noise_is_no_lost_row() -> None:
    assert not with_lost_rows(recording(slice(None), noise=3e-3))[1]


def test_stamps_that_show_the_gaps_are_left_alone() -> None:
    kept = thinned(0.05)
    log = recording(kept)
    stamped = Recording("run", np.flatnonzero(kept) / RATE, log.signals)
    assert not with_lost_rows(stamped)[1]
