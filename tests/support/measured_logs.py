"""Measured logs of robots: those that the repository holds, and others that may lie beside it.

What ``examples/data`` holds is always there.  Other logs, whose licences do not allow it, are looked for in the folder
that ``ECHELON_DATA`` names; tests that need them are skipped without them.
"""

from __future__ import annotations

import os
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


def measured(name: str) -> Path:
    """Path of a log or of what was published about it; skips the test if it is not there and need not be."""
    if name in FILES or name.startswith(FOLDERS):
        return SHIPPED / name
    path = ELSEWHERE / name
    if not path.is_file():
        pytest.skip(f"{path} is not there: set ECHELON_DATA to the folder of the measured logs")
    return path
