"""Measured logs of robots: those that the repository holds, and others that may lie beside it.

What ``examples/data`` holds is always there.  Other logs, whose licences do not allow it, are looked for in the folder
that ``ECHELON_DATA`` names, and must be those of ``tests/data/measured_logs.sha256``.  Without them, tests that need
them are skipped, and fail where ``ECHELON_REQUIRE_DATA`` is 1.
"""

from __future__ import annotations

import hashlib
import os
from functools import cache
from pathlib import Path

import pytest

from support.paths import ROOT

SHIPPED = ROOT / "examples" / "data"
ELSEWHERE = Path(os.environ.get("ECHELON_DATA", ROOT.parent / "shared" / "data"))
FOLDERS = ("panda_30hz", "double_pendulum/params", "staubli_tx40/reference")
FILES = (
    "double_pendulum/A0_20220812_061157-PM.parquet",
    "double_pendulum/A0_20220812_061705-PM.parquet",
    "staubli_tx40/tx40_5kHz.parquet",
)
_LINES = (
    (ROOT / "tests" / "data" / "measured_logs.sha256")
    .read_text(encoding="utf-8")
    .splitlines()
)
DIGESTS = {name: digest for digest, name in map(str.split, _LINES)}


def measured(name: str) -> Path:
    """Path of a log or of what was published about it; skips the test if it is not there and need not be."""
    if name in FILES or name.startswith(FOLDERS):
        return SHIPPED / name
    path = ELSEWHERE / name
    if not path.is_file():
        absent(path)
    if _digest(path) != DIGESTS[name]:
        pytest.fail(
            f"{path} is another file than the one in tests/data/measured_logs.sha256"
        )
    return path


def absent(path: Path) -> None:
    """Skip the test, or fail it where logs are required."""
    end = pytest.fail if os.environ.get("ECHELON_REQUIRE_DATA") == "1" else pytest.skip
    end(f"{path} is not there: set ECHELON_DATA to the folder of the measured logs")


@cache
def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
