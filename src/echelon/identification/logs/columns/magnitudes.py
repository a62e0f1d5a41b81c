"""Magnitudes that quantities of robots have, in SI units.

A wrong unit is an error of a factor of 57 or 1000, and robots differ by less than that: joints turn once or twice, not
fifty times, and are sampled between five and twenty thousand times a second.  So magnitudes tell the units of columns
that are guessed, and contradict those that are stated.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from echelon.identification.logs.columns.column_map import Channel, ColumnMap, motion_of
from echelon.identification.logs.files.log_file import Table
from echelon.identification.logs.finding import Finding, note, warning
from echelon.identification.logs.units import factor
from echelon.identification.signals.clock import nominal_period
from echelon.identification.signals.rates import NEAR, rate
from echelon.robot import Mechanism, MotionKind

PERIODS = (5e-5, 0.2)
"""Shortest and longest time between samples, s, of a log of a robot's motion."""

LARGEST = {"rad": 4 * math.pi, "m": 20.0, "N·m": 2e4, "N": 1e6}
"""Positions and forces that hardly any joint exceeds: two turns; the length of a gantry; drives of excavators."""

SMALLEST = {"rad": 2 * math.pi * math.radians(1), "m": 1e-3}
"""Ranges of positions that no motion of an identification has."""


def clock_unit(times: np.ndarray) -> str:
    """The unit in which time stamps make a rate at which robots are logged; empty for seconds."""
    stamps = times[np.isfinite(times)]
    fitting = (
        fitting_units(nominal_period(stamps)) if np.any(np.diff(stamps) > 0) else []
    )
    return "" if not fitting or fitting[0] == "s" else fitting[0]


def fitting_units(period: float) -> list[str]:
    """Units of time stamps that are so far apart in which that is a rate at which robots are logged."""
    return [
        unit
        for unit in ("s", "ms", "us", "ns", "day")
        if is_period(period * factor(unit, "s"))
    ]


def is_period(seconds: float) -> bool:
    """Whether robots are logged with so much time between samples."""
    return PERIODS[0] <= seconds <= PERIODS[1]


def with_units(
    columns: ColumnMap, table: Table, mechanism: Mechanism
) -> tuple[ColumnMap, tuple[Finding, ...]]:
    """Guessed columns with the units that their magnitudes ask for, and notes on what was assumed."""
    notes: list[Finding] = []
    time, positions = columns.time, dict(columns.positions)
    if time is not None and not time.unit and time.column in table.columns:
        unit = clock_unit(table.columns[time.column])
        if unit:
            text = f"the time '{time.column}' is read as {unit}: in seconds the rate would be unlike a robot's log"
            notes.append(note("units", table.source, text))
        time = replace(time, unit=unit)
    for kind, si, unit, words in _ASSUMED:
        own = {
            name: channel
            for name, channel in positions.items()
            if _moves(mechanism, name, kind)
        }
        sizes = [
            float(np.nanmax(np.abs(table.columns[c.column]), initial=0.0))
            for c in own.values()
        ]
        many = 2 * sum(size > LARGEST[si] for size in sizes) > len(sizes) or (
            kind is MotionKind.TRANSLATION
        )
        most = max(sizes, default=0.0)
        is_told = (
            most > LARGEST[si]
            and many
            and not (unit == "deg" and most > math.degrees(LARGEST[si]))
        )
        if is_told and not any(channel.unit for channel in own.values()):
            positions |= {
                name: replace(channel, unit=unit) for name, channel in own.items()
            }
            notes.append(
                warning(
                    "units",
                    table.source,
                    f"{words[0]} up to {most:.4g} are read as {words[1]}",
                )
            )
    asked = {
        name: replace(some, unit=some.unit or positions[name].unit)
        for name, some in columns.references.items()
    }
    guessed = replace(columns, time=time, positions=positions, references=asked)
    return replace(guessed, velocities=_with_rates(guessed, table, mechanism)), tuple(
        notes
    )


_ASSUMED = (
    (MotionKind.ROTATION, "rad", "deg", ("positions", "degrees")),
    (MotionKind.TRANSLATION, "m", "mm", ("lengths", "mm")),
)
"""Kinds of motion, SI units of their positions, the units that too large ones are taken to be in, and words."""


def _moves(mechanism: Mechanism, name: str, kind: MotionKind) -> bool:
    motion = motion_of(mechanism, name)
    return motion is not None and motion.kind is kind


def _with_rates(
    columns: ColumnMap, table: Table, mechanism: Mechanism
) -> dict[str, Channel]:
    """Velocities in deg/s or mm/s where they are to positions as degrees are to radians, or mm to m.

    Without a clock they are in the unit of their positions per second.
    """
    found = dict(columns.velocities)
    times = None if columns.time is None else table.columns.get(columns.time.column)
    for name, channel in columns.velocities.items():
        position = columns.positions.get(name)
        if channel.unit or position is None:
            continue
        if times is None:
            per_second = position.unit and not table.clocks
            found[name] = (
                replace(channel, unit=f"{position.unit}/s") if per_second else channel
            )
            continue
        unit = "deg/s" if _moves(mechanism, name, MotionKind.ROTATION) else "mm/s"
        q = table.columns[position.column] * factor(position.unit, None)
        v = table.columns[channel.column]
        if len(q) != len(v) or len(q) != len(times):
            continue
        own = rate(q, v, times * factor(columns.time.unit if columns.time else "", "s"))
        if own.relative < NEAR and abs(own.slope * factor(unit, None) - 1) < NEAR:
            found[name] = replace(channel, unit=unit)
    return found
