"""Positions of a robot in a table: all that a log of still poses holds of its joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from echelon.identification.logs.columns.column_guess import guess
from echelon.identification.logs.columns.column_map import ColumnMap
from echelon.identification.logs.columns.conversion import recording
from echelon.identification.logs.faults.locked_joints import check_locked
from echelon.identification.logs.files.log_file import Table
from echelon.robot import Mechanism, lock_joints
from echelon.shared import Floats, InputError


def logged_positions(
    table: Table, mechanism: Mechanism, columns: Sequence[ColumnMap]
) -> tuple[Floats, tuple[str, ...]]:
    """Positions (N, n), rad or m, of all free coordinates, and those that the log lacks, which stand at zero.

    Columns are those of the first map that the table has all columns of; without maps, those whose names say what they
    are.
    """
    unlogged: tuple[str, ...] = ()
    loops = bool(mechanism.closures)
    if loops:  # all joints are measured, as if nothing closed
        mechanism = replace(mechanism, closures=(), independent=(), assembly={})
    if columns:
        stated = next((m for m in columns if _is_of(m, table)), columns[0])
    else:
        found = guess(tuple(table.columns), mechanism, lambda: table, outputs=False)
        if found.problems:
            advice = "name the columns of positions under  log"
            raise InputError("; ".join([*found.problems, advice]), source=table.source)
        stated, unlogged = found.columns, found.unlogged
    check_locked(table, stated.locked)
    logged = (
        lock_joints(mechanism, dict.fromkeys(unlogged, 0.0)) if unlogged else mechanism
    )
    # nothing moves while poses are measured, so that any clock will do
    chosen = ColumnMap(rate=1.0, positions=stated.positions, sensors=stated.sensors)
    found_q = recording(replace(table, clocks={}), chosen, logged).signals["q"]
    if found_q.shape[1] != len(logged.positions) or (loops and unlogged):
        raise InputError(
            "positions of joints in loops are missing: measure all of them, since positions from the nominal "
            "geometry do not show its errors",
            source=table.source,
        )
    q = np.zeros((len(found_q), len(mechanism.positions)))
    for column, name in enumerate(logged.positions):
        q[:, mechanism.positions.index(name)] = found_q[:, column]
    return q, unlogged


def _is_of(columns: ColumnMap, table: Table) -> bool:
    return all(c.column in table.columns for c in columns.positions.values())
