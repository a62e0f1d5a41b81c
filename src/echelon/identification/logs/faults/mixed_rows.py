"""Rows of several recordings, robots or joints that take turns in one log.

A position goes on in the next row.  Where rows take turns it goes on some rows later instead, and what lies between is
elsewhere.  Neither noise nor vibration looks so: their differences are as large over any number of rows.
"""

from __future__ import annotations

import numpy as np

from echelon.identification.logs.recording import FEWEST, Recording
from echelon.shared import Floats, InputError

_MOST = 8
"""Recordings or joints that are looked for."""

_CLOSER = 0.3
"""Ratio of the usual step over some rows to that over one row, below which positions go on there; of noise it is 1."""


def check_not_mixed(recording: Recording) -> None:
    """Refuse a recording in which all positions that change jump to and fro from row to row."""
    q = recording.signals["q"]
    q = q[np.isfinite(q).all(axis=1)]
    if len(q) < FEWEST * _MOST:
        return
    step = _usual_step(q, 1)
    for count in range(2, _MOST + 1):
        closer = _usual_step(q, count)[step > 0] < _CLOSER * step[step > 0]
        if closer.size and closer.all():
            raise InputError(
                f"all positions jump from row to row and go on {count} rows later: rows of {count} recordings, robots or "
                "joints take turns in it; give each a file, or columns, of its own",
                source=recording.source,
            )


def _usual_step(q: Floats, rows: int) -> Floats:
    """Usual difference of positions (N, n) that are some rows apart, shape (n,)."""
    return np.asarray(np.median(np.abs(q[rows:] - q[:-rows]), axis=0))
