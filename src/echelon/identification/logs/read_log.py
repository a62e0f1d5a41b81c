"""From files to uniform segments: the steps of reading a log, piece by piece in constant memory.

A long file is read in pieces of :data:`echelon.identification.logs.files.log_file.CHUNK` rows, and every piece is a
stretch of its
own: what filters spoil at the cuts, a few rows in a hundred thousand, is the price for never holding more.

Several files are one log, positions in one and torques in another, by the clock that they share.  Each file keeps the
times of its own rows, in seconds, and what is not on the clock of the positions is interpolated to it, as with topics
of a bag.  A file without times has as many rows as another one, whose times are then its own.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from echelon.identification.logs.columns.by_values import clock
from echelon.identification.logs.columns.column_map import ColumnMap
from echelon.identification.logs.columns.column_names import meaning
from echelon.identification.logs.columns.conversion import (
    LARGEST,
    needed_columns,
    recording,
)
from echelon.identification.logs.columns.magnitudes import clock_unit
from echelon.identification.logs.faults.examine import examine
from echelon.identification.logs.faults.locked_joints import check_locked
from echelon.identification.logs.faults.lost_rows import with_lost_rows
from echelon.identification.logs.faults.mixed_rows import check_not_mixed
from echelon.identification.logs.faults.plausibility import (
    check_plausible,
    surplus_columns,
)
from echelon.identification.logs.files.log_file import CHUNK, LogFile, Table, selected
from echelon.identification.logs.files.open_log import is_joined, open_log, read_table
from echelon.identification.logs.finding import Finding, counted, listed, warning
from echelon.identification.logs.long_log import joint_by_joint
from echelon.identification.logs.preparation.segments import segments
from echelon.identification.logs.recording import Recording, Segment
from echelon.identification.logs.units import factor
from echelon.robot import Mechanism, experiment_of
from echelon.shared import Floats, InputError, locating


@dataclass(frozen=True)
class LogPiece:
    """A part of a log."""

    segments: tuple[Segment, ...]  # its uninterrupted stretches
    findings: tuple[Finding, ...]  # what is wrong with it, or worth knowing
    recording: Recording  # as it was logged, row by row
    mechanism: (
        Mechanism  # that the log is of: that of its experiment, where there are several
    )
    experiment: str = ""


def read_log(
    path: str | Path,
    mechanism: Mechanism,
    columns: Sequence[ColumnMap],
    *,
    rate: float | None = None,
    outputs: bool = True,
    named: bool = True,
) -> Iterator[LogPiece]:
    """Read a log in the robot's terms, piece by piece.

    Of several column maps for the log the first one whose columns are all there is used.  A log of an experiment is in
    the terms of that.  Segments are resampled to ``rate``, Hz.
    Faults that spoil no sample are looked for only if they are to be ``named``.
    """
    log = opened(path)
    if not outputs:  # a map that has all it names comes before the same without outputs
        columns = [*columns, *(replace(some, outputs={}) for some in columns)]
    chosen = map_of(log, columns)
    if mechanism.experiments:
        mechanism = experiment_of(
            mechanism, chosen.experiment or _touching_most(mechanism)
        )
    findings = surplus_columns(chosen, log, mechanism)
    tables = log.tables(_needed(chosen, log.names, log.source))
    table, following = next(tables, None), next(tables, None)
    whole = following is None
    while table is not None:
        findings += _left_out(table)
        findings += check_locked(table, chosen.locked)
        recorded, lost = with_lost_rows(recording(table, chosen, mechanism))
        check_not_mixed(recorded)
        findings += check_plausible(recorded, mechanism, chosen)
        faults, usable = examine(recorded, mechanism, whole=whole, named=named)
        parts, more = segments(recorded, mechanism, usable, rate=rate, whole=whole)
        found = (*findings, *lost, *faults, *more)
        yield LogPiece(parts, found, recorded, mechanism, chosen.experiment)
        findings, table, following = (), following, next(tables, None)


def _left_out(table: Table) -> tuple[Finding, ...]:
    """Rows that could not be read."""
    if not table.left_out:
        return ()
    text = f"{counted(len(table.left_out), 'row')} cannot be read and left out: {listed(table.left_out)}"
    return (warning("rows", table.source, text),)


def _touching_most(mechanism: Mechanism) -> str:
    """The experiment with most contacts, in whose terms a log is read whose contacts change."""
    counts = dict.fromkeys(mechanism.experiments, 0)
    for contact in mechanism.contacts:
        counts[contact.name.partition(".")[0]] += 1
    return max(counts, key=lambda name: counts[name])


def map_of(log: LogFile, columns: Sequence[ColumnMap]) -> ColumnMap:
    """The map for a file whose columns it has; for none, the error says what the nearest one lacks."""
    if not columns:
        problem = "the set-up lacks the section  log, which names the columns: add it, or let  echelon setup  write it"
        raise InputError(problem, source=log.source)
    known = list(dict.fromkeys(some.experiment for some in columns))
    exactly = [some for some in columns if log.source in some.files]
    columns = exactly or [some for some in columns if some.is_for(log.source)]
    found = {some.experiment for some in columns}
    # the name of one experiment may hold that of another
    whole = {
        name for name in found if not any(name in other for other in found - {name})
    }
    if len(whole) != 1:
        problem = "no map under  log  is for files of this name: mend  files"
        if any(known):
            problem = f"which of the experiments {listed(known)} it is of, its name does not tell: give the file a name with "
            problem += f'one of them as a word, such as run1_{known[0]}.csv, or state  files: ["…"]  under log'
        raise InputError(problem, source=log.source)
    columns = [some for some in columns if some.experiment in whole]
    lacking = [
        sum(name not in log.names for name in needed_columns(some)) for some in columns
    ]
    best = columns[lacking.index(min(lacking))]
    _needed(best, log.names, log.source)
    return best


def measured(table: Table) -> Table:
    """A table with NaN for what no sensor measures, so that it is no number to reckon with."""
    columns = {
        name: np.where(np.abs(values) <= LARGEST, values, np.nan)
        for name, values in table.columns.items()
    }
    return replace(table, columns=columns)


def first_table(log: LogFile) -> Table:
    """The first piece of a log, with all columns of numbers, and NaN for what no sensor measures."""
    names = list(log.names)
    while True:
        try:
            return measured(next(log.tables(names), Table(log.source, {})))
        except InputError as error:  # a column of words, such as AUTO
            column = re.search("column '(.*)'$", error.element or "")
            if column is None or column[1] not in names or len(names) == 1:
                raise
            names.remove(column[1])


def _needed(columns: ColumnMap, names: Sequence[str], source: str) -> tuple[str, ...]:
    with locating(source):
        return needed_columns(columns, names)


def opened(path: str | Path) -> LogFile:
    """A log of any kind; a path such as ``positions.csv+torques.csv`` names several files of one log."""
    if isinstance(path, str):
        path = Path(path)
    if is_joined(path):
        return JoinedLog([Path(part) for part in str(path).split("+")], str(path))
    return joint_by_joint(open_log(path))


class JoinedLog:
    """Files of one log; a column whose name occurs in several of them goes by its file, ``torques/j1``."""

    def __init__(self, parts: Sequence[Path], source: str) -> None:
        self.source = source
        self._files = {part.stem: open_log(part) for part in parts}
        if len(self._files) < len(parts):
            raise InputError(
                "two of the files have the same name; rename one", source=source
            )
        self._times = {stem: _times(file) for stem, file in self._files.items()}
        shared = Counter(
            name
            for stem, file in self._files.items()
            for name in self._columns(stem, file)
        )
        self._places = {
            (f"{stem}/{name}" if max(shared.values()) > 1 else name): (stem, name)
            for stem, file in self._files.items()
            for name in self._columns(stem, file)
        }
        self.names: tuple[str, ...] = tuple(self._places)

    def tables(
        self, names: Sequence[str] | None = None, rows: int = CHUNK
    ) -> Iterator[Table]:
        """One table: the files differ in length, so that there are no common rows to cut at."""
        del rows
        chosen = selected(self.source, names, self.names)
        columns: dict[str, Floats] = {}
        clocks: dict[str, str] = {}
        for stem, file in self._files.items():
            wanted = {
                name: self._places[name][1]
                for name in chosen
                if self._places[name][0] == stem
            }
            if wanted:
                values = read_table(file.source, list(wanted.values())).columns
                columns |= {name: values[inner] for name, inner in wanted.items()}
                if any(len(times) for _, times in self._times.values()):
                    columns[f"{stem}/time"] = self._own_times(
                        stem, len(values[next(iter(wanted.values()))])
                    )
                    clocks |= dict.fromkeys(wanted, f"{stem}/time")
        yield Table(self.source, columns, clocks)

    def _columns(self, stem: str, file: LogFile) -> list[str]:
        return [name for name in file.names if name != self._times[stem][0]]

    def _own_times(self, stem: str, count: int) -> Floats:
        """Times of a file's rows, or of another file that has as many rows, s."""
        for _, times in (self._times[stem], *self._times.values()):
            if len(times) == count:
                return times
        problem = "has no column of times, and another number of rows than the files that have one"
        raise InputError(problem, source=self._files[stem].source)


def _times(file: LogFile) -> tuple[str, Floats]:
    """The column of times and its values in seconds; none if there is no such column."""
    table = read_table(file.source)
    said = {
        name: found
        for name in file.names
        if (found := meaning(name, {})) is not None and found.kind == "time"
    }
    name = clock(table.columns, list(said) or list(file.names)[:1], named=bool(said))
    if not name and len(said) > 1:
        raise InputError(
            f"{listed(said)} could all be the time; leave one in the file",
            source=file.source,
        )
    name = name or next(iter(said), "")
    if not name:
        return "", np.empty(0)
    unit = (said[name].unit if name in said else "") or clock_unit(table.columns[name])
    return name, factor(unit, "s") * table.columns[name]
