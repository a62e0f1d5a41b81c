"""A table in the terms of a robot: units, signs, offsets, clocks and sides of the gears are settled here, once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.hints import nearest_of
from echelon.logs.alignment import Alignment, check_lengths, raw_column, time_candidates
from echelon.logs.column_map import Channel, ColumnMap
from echelon.logs.quantities import units
from echelon.logs.recording import Recording
from echelon.logs.sides import check_names, joint_coordinates, measured_outputs
from echelon.logs.table import Table
from echelon.logs.units import factor
from echelon.mechanism.mechanism import Mechanism

_GAINED = ("A", "V")
_LARGEST = 1e100  # squares of it still have doubles
"""What drives report instead of forces."""

_STATES = {"position": "q", "velocity": "qd", "acceleration": "qdd", "reference": "reference"}


def needed_columns(columns: ColumnMap, names: Sequence[str] = ()) -> tuple[str, ...]:
    """Columns that a recording needs, so that only these are read.

    Parameters
    ----------
    columns : ColumnMap
    names : sequence of str, optional
        The columns that the file has.  If there is neither time nor rate, those that could hold time stamps are needed
        too: to find out whether columns have clocks of their own, and to name them if not.

    Raises
    ------
    InputError
        If ``names`` are given and lack a column; suggests the nearest.

    Examples
    --------
    >>> needed_columns(ColumnMap(time=Channel("t"), positions={"j1": Channel("q1")}))
    ('t', 'q1')
    """
    time = [columns.time] if columns.time is not None else []
    channels = [*time, *(channel for _, group in _groups(columns) for channel in group.values())]
    found = list(dict.fromkeys(channel.column for channel in channels))
    if names:
        strange = next((name for name in found if name not in names), None)
        if strange is not None:
            raise InputError(f"there is no column '{strange}'{nearest_of(strange, names)}")
        if columns.time is None and columns.rate is None:
            found += [name for name in time_candidates(names) if name not in found]
    return tuple(found)


def recording(
    table: Table, columns: ColumnMap, mechanism: Mechanism, symbols: Mapping[str, float] | None = None
) -> Recording:
    """A log in SI units, on the joints' side, on one clock.

    Parameters
    ----------
    table : Table
        The log, or a piece of one: with a constant rate its clock goes on from ``table.first``.
    columns : ColumnMap
    mechanism : Mechanism
    symbols : mapping of str to float, optional
        Values of symbols in transmission ratios that replace or complete those of the mechanism.

    Returns
    -------
    Recording
        Time stamps as they were logged.  Channels with clocks of their own are interpolated at those of the positions;
        values within their pauses are NaN.

    Raises
    ------
    InputError
        If columns, coordinates, outputs or actuators of these names do not exist or are missing, units do not fit,
        there is no clock, or joints do not follow from what was measured at motors.

    Examples
    --------
    >>> import echelon as ec
    >>> robot = ec.load("examples/double_pendulum.yaml")
    >>> degrees = {f"j{n}": Channel(f"q{n}", unit="deg") for n in (1, 2)}
    >>> table = Table("run.csv", {"q1": np.array([0.0, 90]), "q2": np.array([180.0, 0])})
    >>> recording(table, ColumnMap(rate=100, positions=degrees), robot).signals["q"].round(4).tolist()
    [[0.0, 3.1416], [1.5708, 0.0]]
    """
    try:
        return _recording(table, columns, mechanism, symbols)
    except InputError as error:
        raise error.located(table.source) from None


def _recording(
    table: Table, columns: ColumnMap, mechanism: Mechanism, symbols: Mapping[str, float] | None
) -> Recording:
    groups = dict(_groups(columns))
    if not groups["position"]:
        raise InputError("the column map names no positions", element="position")
    for kind, group in groups.items():
        check_names(mechanism, kind, group)
    aligned = _aligned(table, columns)
    given = {kind: _read(aligned, mechanism, kind, group) for kind, group in groups.items() if group}
    signals = {
        signal: joint_coordinates(mechanism, kind, given[kind], symbols)
        for kind, signal in _STATES.items()
        if kind in given
    }
    if "output" in given:
        signals["y"] = measured_outputs(mechanism, given["output"], symbols)
    return Recording(table.source, aligned.time, signals, given.get("input", {}))


def _groups(columns: ColumnMap) -> list[tuple[str, Mapping[str, Channel]]]:
    """Channels by kind, positions first."""
    return [
        ("position", columns.positions),
        ("velocity", columns.velocities),
        ("acceleration", columns.accelerations),
        ("output", columns.outputs),
        ("reference", columns.references),
        ("input", columns.inputs),
    ]


def _aligned(table: Table, columns: ColumnMap) -> Alignment:
    names = tuple(channel.column for _, group in _groups(columns) for channel in group.values())
    for name in names:
        raw_column(table, name)
    aligned = Alignment(table, columns, tuple(dict.fromkeys(names)))
    clocks: dict[str, list[str]] = {}
    for name in aligned.used:
        clocks.setdefault(aligned.clock(name), []).append(name)
    check_lengths(table, clocks)
    return aligned


def _units(mechanism: Mechanism, kind: str, name: str, channel: Channel) -> Sequence[str] | None:
    """SI units that a column may be in; currents and voltages become forces by a gain that is stated."""
    expected = units(mechanism, kind, name)
    gained = kind == "output" and channel.scale != 1 and expected is not None
    return (*expected, *_GAINED) if gained and expected is not None else expected


def _read(aligned: Alignment, mechanism: Mechanism, kind: str, group: Mapping[str, Channel]) -> dict[str, Floats]:
    """Values by coordinate, output or actuator: scale · (column in SI units) + offset."""
    found = {}
    for name, channel in group.items():
        try:
            ratio = channel.scale * factor(channel.unit, _units(mechanism, kind, name, channel))
        except InputError as error:
            where = f"unit of column '{channel.column}' ({kind} of '{name}')"
            raise InputError(error.problem, element=where) from None
        if not np.isfinite(ratio) or ratio == 0 or not np.isfinite(channel.offset):
            problem = f"scale {channel.scale:g} and offset {channel.offset:g}: expected finite numbers, the scale not 0"
            raise InputError(problem, element=f"column '{channel.column}' ({kind} of '{name}')")
        with np.errstate(over="ignore"):
            values = ratio * aligned.column(channel.column) + channel.offset
        largest = float(np.max(np.abs(values), initial=0.0, where=np.isfinite(values)))
        if largest > _LARGEST:
            problem = f"goes to {largest:.3g} in SI units, which no sensor measures (valid: up to {_LARGEST:.0e})"
            raise InputError(problem, element=f"column '{channel.column}' ({kind} of '{name}')")
        found[name] = values
    return found
