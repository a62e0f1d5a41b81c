"""Joints that a robot has locked, in logs with their positions or velocities: they must stand where it has them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from echelon.identification.logs.columns.column_map import Channel, Locked
from echelon.identification.logs.faults.repeated_values import resolution
from echelon.identification.logs.files.log_file import Table
from echelon.identification.logs.finding import Finding, warning
from echelon.identification.logs.recording import FEWEST
from echelon.identification.logs.units import factor
from echelon.identification.signals.spectrum import white_noise
from echelon.shared import Floats, InputError

STILL = 2e-3
"""Range, rad or m, of a joint at rest: encoders make noise, and drives hold with some play."""

_FAULTS = 0.01
"""Share of the samples in which a joint at rest may be elsewhere, as where values are spoilt."""


MOVING = 0.02
"""Deviation of velocities, rad/s or m/s, from which on a joint moves: sensors at rest drift and hum by less."""

_SMOOTH = 3.0
"""Ratio of velocities to what is white in them, from which on they are motion and no noise."""


def span(values: Floats) -> float:
    """Range of the values that are finite; 0 without any."""
    known = values[np.isfinite(values)]
    return float(np.ptp(known)) if len(known) else 0.0


def check_locked(table: Table, every: Mapping[str, Locked]) -> tuple[Finding, ...]:
    """Refuse a log in which a locked joint moves, or stands elsewhere; of columns that nobody stated, a finding."""
    found = []
    for name, locked in every.items():
        kind, channel, advice = _compared(name, locked, table)
        if channel is None or not advice:
            continue
        label = f"column '{channel.column}' ({kind} of '{name}'"
        if not locked.stated:
            label += " by its name, which is not under  log"
            found.append(warning("locked", f"{table.source}, {label})", advice))
            continue
        raise InputError(advice, source=table.source, element=f"{label})")
    return tuple(found)


def _compared(
    name: str, locked: Locked, table: Table
) -> tuple[str, Channel | None, str]:
    """The quantity and column that were asked, and what contradicts the robot; empty where nothing does."""
    position, velocity = (
        None if channel is None or channel.column not in table.columns else channel
        for channel in (locked.position, locked.velocity)
    )
    if position is not None:
        return "position", position, _of_position(name, locked, position, table)
    if velocity is not None:
        return "velocity", velocity, _of_velocity(name, locked, velocity, table)
    return "", None, ""


def _of_position(name: str, locked: Locked, channel: Channel, table: Table) -> str:
    size = channel.scale * factor(channel.unit, None)
    raw = table.columns[channel.column]
    q = size * raw[np.isfinite(raw)] + channel.offset
    allowed = max(STILL, abs(size) * (resolution(raw) or 0.0))
    is_away = np.abs(q - locked.at) > allowed
    if is_away.any() and is_away.mean() > _FAULTS:
        return _advice(name, locked, q, allowed)
    return ""


def _of_velocity(name: str, locked: Locked, channel: Channel, table: Table) -> str:
    raw = table.columns[channel.column]
    speeds = channel.scale * factor(channel.unit, None) * raw[np.isfinite(raw)]
    if len(speeds) <= FEWEST:
        return ""
    size = float(np.std(speeds))
    if size < max(MOVING, _SMOOTH * white_noise(speeds)):
        return ""
    fastest = float(np.quantile(np.abs(speeds), 1 - _FAULTS))
    return (
        f"the robot has '{name}' locked at {locked.at:.6g}, but in the log it moves at up to {fastest:.3g} rad/s or m/s: leave it "
        "out of  locked  and log its position, or take logs in which it rests"
    )


def _advice(name: str, locked: Locked, q: Floats, allowed: float) -> str:
    """The refusal of a joint that moves or stands elsewhere, with the line to write."""
    low, high = np.quantile(q, [_FAULTS, 1 - _FAULTS]).tolist()
    stated = f"the robot has '{name}' locked at {locked.at:.6g}, but in the log it"
    other = (
        "if the column is not its position, name those of the joints that move one by one, under  position"
        if locked.stated
        else "if the column is not its position, or has another zero, leave it out of the file"
    )
    if high - low > 2 * allowed:
        return f"{stated} moves from {low:.4g} to {high:.4g}: leave it out of  locked,  or take logs in which it rests; {other}"
    there = float(np.median(q))
    return f"{stated} stands at {there:.6g}: write  locked: {{{name}: {there:.6g}}},  or take other logs; {other}"
