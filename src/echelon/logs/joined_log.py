"""Several files as one log, positions in one and torques in another, by the clock that they share.

Each file keeps the times of its own rows, in seconds, and what is not on the clock of the positions is interpolated to
it, as with topics of a bag.  A file without times has as many rows as another one, whose times are then its own.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.logs.columns.by_values import clock, clock_unit
from echelon.logs.columns.column_names import meaning
from echelon.logs.columns.units import factor
from echelon.logs.files.log_file import CHUNK, LogFile, Table, selected
from echelon.logs.files.open_log import is_joined, open_log, read_table
from echelon.logs.finding import listed


def opened(path: str | Path) -> LogFile:
    """A log of any kind; a path such as ``positions.csv+torques.csv`` names several files of one log."""
    if isinstance(path, str):
        path = Path(path)
    return JoinedLog([Path(part) for part in str(path).split("+")], str(path)) if is_joined(path) else open_log(path)


class JoinedLog:
    """Files of one log; a column whose name occurs in several of them goes by its file, ``torques/j1``."""

    def __init__(self, parts: Sequence[Path], source: str) -> None:
        self.source = source
        self._files = {part.stem: open_log(part) for part in parts}
        if len(self._files) < len(parts):
            raise InputError("two of the files have the same name; rename one", source=source)
        self._times = {stem: _times(file) for stem, file in self._files.items()}
        shared = Counter(name for stem, file in self._files.items() for name in self._columns(stem, file))
        self._places = {
            (f"{stem}/{name}" if max(shared.values()) > 1 else name): (stem, name)
            for stem, file in self._files.items()
            for name in self._columns(stem, file)
        }
        self.names: tuple[str, ...] = tuple(self._places)

    def tables(self, names: Sequence[str] | None = None, rows: int = CHUNK) -> Iterator[Table]:
        """One table: the files differ in length, so that there are no common rows to cut at."""
        del rows
        chosen = selected(self.source, names, self.names)
        columns: dict[str, Floats] = {}
        clocks: dict[str, str] = {}
        for stem, file in self._files.items():
            wanted = {name: self._places[name][1] for name in chosen if self._places[name][0] == stem}
            if wanted:
                values = read_table(file.source, list(wanted.values())).columns
                columns |= {name: values[inner] for name, inner in wanted.items()}
                columns[f"{stem}/time"] = self._own_times(stem, len(values[next(iter(wanted.values()))]))
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
    said = {name: found for name in file.names if (found := meaning(name, {})) is not None and found.kind == "time"}
    name = clock(table.columns, list(said) or ([] if said else list(file.names)[:1]))
    if not name and len(said) > 1:
        raise InputError(f"{listed(said)} could all be the time; leave one in the file", source=file.source)
    name = name or next(iter(said), "")
    if not name:
        return "", np.empty(0)
    unit = (said[name].unit if name in said else "") or clock_unit(table.columns[name])
    return name, factor(unit, "s") * table.columns[name]
