"""Signals while ``excite`` searches: the first ends with the best checked motion, the second at once."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest

from support.paths import EXAMPLES
from support.selection import slow_unless

LONG = (
    "excite",
    str(EXAMPLES / "panda.yaml"),
    "-o",
    "motion",
    "--budget",
    "1000",
    "--starts",
    "400",
    "--verbose",
)


def searching(folder: Path) -> subprocess.Popen[str]:
    """A command in the middle of its search."""
    command = [sys.executable, "-m", "echelon", *LONG]
    process = subprocess.Popen(
        command,
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # shells have their background processes ignore it
        preexec_fn=partial(signal.signal, signal.SIGINT, signal.SIG_DFL),
    )
    assert process.stderr is not None
    for line in process.stderr:
        if "start 1 of" in line:
            return process
    raise AssertionError(process.communicate())


@pytest.mark.parametrize(
    "number", slow_unless([signal.SIGINT], [signal.SIGTERM, signal.SIGINT])
)
def test_the_first_signal_ends_with_a_motion_that_was_checked(
    tmp_path: Path, number: signal.Signals
) -> None:
    process = searching(tmp_path)
    process.send_signal(number)
    out, _ = process.communicate(timeout=120)
    assert process.returncode == 128 + number
    assert (
        "the search ended early, because somebody stopped it: better motions may exist"
        in " ".join(out.split())
    )
    document = json.loads((tmp_path / "motion" / "trajectory.json").read_text())
    assert document["safe"]
    assert {start["status"] for start in document["starts"]} == {"stopped"}


@pytest.mark.slow
def test_the_second_signal_ends_at_once_and_nothing_is_written(tmp_path: Path) -> None:
    process = searching(tmp_path)
    process.send_signal(signal.SIGINT)
    process.send_signal(signal.SIGTERM)
    process.communicate(timeout=10)
    assert process.returncode in {128 + signal.SIGINT, 128 + signal.SIGTERM}
    assert not (tmp_path / "motion").exists()
