"""Joints that a robot has locked, in logs that have their positions: they must stand where the robot has them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from echelon.identification.logs.columns.column_map import Locked
from echelon.identification.logs.faults.repeated_values import resolution
from echelon.identification.logs.files.log_file import Table
from echelon.identification.logs.units import factor
from echelon.shared import Floats, InputError

STILL = 2e-3
"""Range, rad or m, of a joint at rest: encoders make noise, and drives hold with some play."""

_FAULTS = 0.01
"""Share of the samples in which a joint at rest may be elsewhere, as where values are spoilt."""


def check_locked(table: Table, every: Mapping[str, Locked]) -> None:
    """Refuse a log in which a locked joint moves, or stands elsewhere."""
    for name, locked in every.items():
        channel = locked.position
        if channel.column not in table.columns:
            continue
        size = channel.scale * factor(channel.unit, None)
        raw = table.columns[channel.column]
        q = size * raw[np.isfinite(raw)] + channel.offset
        allowed = max(STILL, abs(size) * (resolution(raw) or 0.0))
        is_away = np.abs(q - locked.at) > allowed
        if is_away.any() and is_away.mean() > _FAULTS:
            raise InputError(
                _advice(name, locked, q, allowed),
                source=table.source,
                element=f"column '{channel.column}' (position of '{name}')",
            )


def _advice(name: str, locked: Locked, q: Floats, allowed: float) -> str:
    """The refusal of a joint that moves or stands elsewhere, with the line to write."""
    low, high = np.quantile(q, [_FAULTS, 1 - _FAULTS]).tolist()
    stated = f"the robot has '{name}' locked at {locked.at:.6g}, but in the log it"
    other = "if the column is not its position, name those of the joints that move one by one, under  position"
    if high - low > 2 * allowed:
        return f"{stated} moves from {low:.4g} to {high:.4g}: leave it out of  locked,  or take logs in which it rests; {other}"
    there = float(np.median(q))
    return f"{stated} stands at {there:.6g}: write  locked: {{{name}: {there:.6g}}},  or take other logs; {other}"
