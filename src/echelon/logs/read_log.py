"""From a file to uniform segments: the steps of reading a log, piece by piece in constant memory.

A long file is read in pieces of :data:`echelon.logs.files.log_file.CHUNK` rows, and every piece is a stretch of its
own: what filters spoil at the cuts, a few rows in a hundred thousand, is the price for never holding more.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from echelon.errors import locating
from echelon.logs.columns.column_guess import guess_columns
from echelon.logs.columns.column_map import ColumnMap
from echelon.logs.columns.conversion import needed_columns, recording
from echelon.logs.columns.guessed_units import with_units
from echelon.logs.faults.examine import examine
from echelon.logs.faults.plausibility import check_plausible, surplus_columns
from echelon.logs.files.log_file import LogFile, Table
from echelon.logs.finding import Finding, counted, listed, warning
from echelon.logs.joined_log import opened
from echelon.logs.preparation.segments import segments
from echelon.logs.recording import Recording, Segment
from echelon.mechanism.mechanism import Mechanism


@dataclass(frozen=True)
class LogPiece:
    """A part of a log."""

    segments: tuple[Segment, ...]  # its uninterrupted stretches
    findings: tuple[Finding, ...]  # what is wrong with it, or worth knowing
    columns: ColumnMap  # what its columns were taken for
    recording: Recording  # as it was logged, row by row


def read_log(
    path: str | Path,
    mechanism: Mechanism,
    columns: Sequence[ColumnMap] = (),
    *,
    rate: float | None = None,
    symbols: Mapping[str, float] | None = None,
    outputs: bool = True,
) -> Iterator[LogPiece]:
    """Read a log in the robot's terms, piece by piece.

    Of several column maps the first one whose columns are all there is used; without any, columns are recognised by
    their names.  Segments are resampled to ``rate``, Hz.  ``symbols`` are values of symbols in transmission ratios.
    """
    log = opened(path)
    if not outputs:  # a map that has all it names comes before the same without outputs
        columns = [*columns, *(replace(some, outputs={}) for some in columns)]
    chosen = chosen_columns(log, mechanism, columns, outputs=outputs)
    findings = surplus_columns(chosen, log.names)
    tables = log.tables(_needed(chosen, log.names, log.source))
    table, following = next(tables, None), next(tables, None)
    whole = following is None
    if table is not None and not columns:
        chosen, more = with_units(chosen, table, mechanism)
        findings += more
    while table is not None:
        findings += _left_out(table)
        recorded = recording(table, chosen, mechanism, symbols)
        findings += check_plausible(recorded, mechanism, chosen)
        faults, usable = examine(recorded, mechanism, whole=whole)
        parts, more = segments(recorded, mechanism, usable, rate=rate, whole=whole)
        yield LogPiece(parts, (*findings, *faults, *more), chosen, recorded)
        findings, table, following = (), following, next(tables, None)


def _left_out(table: Table) -> tuple[Finding, ...]:
    """Rows that could not be read."""
    if not table.left_out:
        return ()
    text = f"{counted(len(table.left_out), 'row')} cannot be read and left out: {listed(table.left_out)}"
    return (warning("rows", table.source, text),)


def chosen_columns(
    log: LogFile, mechanism: Mechanism, columns: Sequence[ColumnMap], *, outputs: bool = True
) -> ColumnMap:
    """The map whose columns a file has; for none, the error says what the nearest one lacks."""
    if not columns:
        return guess_columns(log.names, mechanism, log.source, outputs=outputs, look=lambda: first_table(log))
    lacking = [sum(name not in log.names for name in needed_columns(some)) for some in columns]
    best = columns[lacking.index(min(lacking))]
    _needed(best, log.names, log.source)
    return best


def first_table(log: LogFile) -> Table:
    """The first piece of a log, with all columns."""
    return next(log.tables(), Table(log.source, {}))


def _needed(columns: ColumnMap, names: Sequence[str], source: str) -> tuple[str, ...]:
    with locating(source):
        return needed_columns(columns, names)
