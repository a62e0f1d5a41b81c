"""Units of columns that were guessed: those that magnitudes ask for.

A wrong unit is an error of a factor of 57 or 1000, and robots differ by less than that.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from echelon.logs.columns.by_values import clock_unit
from echelon.logs.columns.column_map import Channel, ColumnMap
from echelon.logs.columns.quantities import motion_of
from echelon.logs.columns.units import factor
from echelon.logs.files.log_file import Table
from echelon.logs.finding import Finding, note, warning
from echelon.mechanism.joint import MotionKind
from echelon.mechanism.mechanism import Mechanism

_TURNS = 4 * math.pi
_DEGREES = 720.0
_NEAR = 0.05


def with_units(columns: ColumnMap, table: Table, mechanism: Mechanism) -> tuple[ColumnMap, tuple[Finding, ...]]:
    """Guessed columns with the units that their magnitudes ask for, and what was assumed."""
    notes: list[Finding] = []
    time = columns.time
    if time is not None and not time.unit and time.column in table.columns:
        unit = clock_unit(table.columns[time.column])
        if unit:
            text = f"the time '{time.column}' is taken to be in {unit}: in seconds no robot would be logged so slowly"
            notes.append(note("units", table.source, text))
        time = replace(time, unit=unit)
    turning = {name: some for name, some in columns.positions.items() if _turns(mechanism, name)}
    far = [np.nanmax(np.abs(table.columns[some.column]), initial=0.0) for some in turning.values()]
    plain = turning and not any(some.unit for some in turning.values())
    positions = columns.positions
    if plain and 2 * sum(size > _TURNS for size in far) > len(far) and max(far) <= _DEGREES:
        positions = {**positions, **{name: replace(some, unit="deg") for name, some in turning.items()}}
        text = f"positions up to {max(far):.4g} are taken to be in degrees"
        notes.append(warning("units", table.source, text))
    guessed = replace(columns, time=time, positions=positions)
    return replace(guessed, velocities=_with_rates(guessed, table, mechanism)), tuple(notes)


def _turns(mechanism: Mechanism, name: str) -> bool:
    motion = motion_of(mechanism, name)
    return motion is not None and motion.kind is MotionKind.ROTATION


def _with_rates(columns: ColumnMap, table: Table, mechanism: Mechanism) -> dict[str, Channel]:
    """Velocities in deg/s where they are to positions as degrees are to radians."""
    found = dict(columns.velocities)
    times = None if columns.time is None else table.columns.get(columns.time.column)
    for name, channel in columns.velocities.items():
        position = columns.positions.get(name)
        if channel.unit or position is None or times is None or not _turns(mechanism, name):
            continue
        q, v = table.columns[position.column] * factor(position.unit, "rad"), table.columns[channel.column]
        if len(q) != len(v) or len(q) != len(times):
            continue
        step = np.diff(times) * factor(columns.time.unit if columns.time else "", "s")
        moved, area = np.diff(q), 0.5 * (v[1:] + v[:-1]) * step
        usable = np.isfinite(moved) & np.isfinite(area)
        ratio = np.linalg.norm(area[usable]) / max(float(np.linalg.norm(moved[usable])), 1e-300)
        if abs(ratio * math.pi / 180 - 1) < _NEAR:
            found[name] = replace(channel, unit="deg/s")
    return found
