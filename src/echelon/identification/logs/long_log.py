"""Logs with a row for every joint and time, as databases and melted data frames write them, joint beside joint.

They are told by a column of few labels, of joints or of quantities, whose rows repeat the same times, or take turns
with times of their own.  Such a log is read as a whole: the rows of one time may stand anywhere in it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np
import numpy.typing as npt

from echelon.identification.logs.columns.by_values import clock
from echelon.identification.logs.columns.column_names import meaning
from echelon.identification.logs.files.log_file import (
    CHUNK,
    LogFile,
    Table,
    WordedFile,
    selected,
)
from echelon.identification.logs.finding import listed
from echelon.identification.signals.chance import SHARE
from echelon.shared import ENTRIES, Floats, InputError

Labels = npt.NDArray[Any]

_NUMBERS = re.compile(
    r"id|(joint|jnt|axis|motor|actuator|servo|dof|drive|can|node|slave|device|channel)s?[\W_]*"
    r"(id|no|nr|num|number|idx|index)?",
    re.IGNORECASE,
)
"""Names of columns that number joints."""
_RUNS = re.compile(
    "run|episode|trial|session|phase|test|lap|cycle|segment|rep|set|file|exp|mode|state",
    re.IGNORECASE,
)
"""Names of columns whose labels are of stretches of time, which may all begin at zero."""


def joint_by_joint(file: LogFile) -> LogFile:
    """The file; joint beside joint if it has a row for each of them."""
    words = _worded(file)
    said = [found for name in file.names if (found := meaning(name, {})) is not None]
    if any(found.index is not None for found in said):  # q1 is of one joint already
        return file
    named = [name for name in words if not _RUNS.match(name)]
    for label in (*named, *(name for name in file.names if _NUMBERS.fullmatch(name))):
        with suppress(InputError):  # what cannot be read is said when it is needed
            labels = next(_labels(file, label), np.zeros(0))
            if not 1 < len(np.unique(labels)) <= ENTRIES.most:
                continue
            table = next(
                file.tables(
                    [name for name in file.names if name not in (label, *words)]
                )
            )
            if time := _shared_clock(table.columns, labels):
                return LongLog(file, label, time)
    return file


def rows_of_one_time(table: Table) -> str:
    """A sentence about a table in which every time occurs several times, though no column says why; else empty."""
    for name, values in table.columns.items():
        said = meaning(name, {})
        if said is None or said.kind != "time":
            continue
        times, counts = np.unique(values, return_counts=True)
        if len(times) > 1 and counts[0] > 1 and np.mean(counts == counts[0]) > SHARE:
            return (
                f"every '{name}' occurs {counts[0]} times: if each row is of one joint, call the column that says of "
                "which one 'joint'; if it is of one recording, give each recording a file of its own"
            )
    return ""


def _worded(file: LogFile) -> Sequence[str]:
    return file.worded if isinstance(file, WordedFile) else ()


def _labels(file: LogFile, label: str) -> Iterator[Labels]:
    """The labels of rows, in pieces."""
    if isinstance(file, WordedFile) and label in file.worded:
        yield from map(np.array, file.words(label))
        return
    for table in file.tables([label]):
        yield table.columns[label]


def _shared_clock(columns: Mapping[str, Floats], labels: Labels) -> str:
    """The column with the times that rows of several labels share; empty if there is none."""
    if any(len(values) != len(labels) for values in columns.values()):
        return ""
    first, *others = np.unique(labels)
    said = [
        name
        for name in columns
        if (found := meaning(name, {})) is not None and found.kind == "time"
    ]
    own = {name: columns[name][labels == first] for name in columns}
    time = clock(
        {name: np.sort(own[name]) for name in said} or own,
        said or list(own),
        named=bool(said),
    )
    if not time:
        return ""
    pair = own[time], columns[time][labels == others[0]]
    repeated = max(np.mean(np.isin(*pair)), np.mean(np.isin(*pair[::-1]))) > SHARE
    return time if repeated or _take_turns(columns[time], labels) else ""


def _take_turns(times: Floats, labels: Labels) -> bool:
    """Whether each label has a clock and most rows of the rarest one stand between rows of others, as no mode's do."""
    every, counts = np.unique(labels, return_counts=True)
    rarest = labels == every[np.argmin(counts)]
    begins = rarest & np.append(True, ~rarest[:-1])
    alone = 2 * np.count_nonzero(begins) > np.min(counts)
    stamps = ({"t": np.sort(times[labels == one])} for one in every)
    return bool(alone) and all(clock(own, ["t"], named=True) for own in stamps)


class LongLog:
    """A log with a row for every label and time: a column ``position/elbow`` for every quantity and label.

    Where there is one quantity only, labels are names of columns themselves.
    """

    def __init__(self, file: LogFile, label: str, time: str) -> None:
        self.source, self._file, self._label, self._time = (
            file.source,
            file,
            label,
            time,
        )
        labels = np.concatenate(list(_labels(file, label)))
        every = np.unique(labels[(labels == labels) & (labels != "")]).tolist()
        self._rows = {
            f"{one:g}" if isinstance(one, float) else one: labels == one
            for one in every
        }
        values = [
            name for name in file.names if name not in (label, time, *_worded(file))
        ]
        self._places = {
            f"{name}/{one}" if len(values) > 1 or one.isdecimal() else one: (name, one)
            for name in values
            for one in self._rows
        }
        self.names: tuple[str, ...] = (time, *self._places)
        self.notes = (
            f"rows of one '{time}' are put side by side by '{label}', as {listed(self._places)}",
        )

    def tables(
        self, names: Sequence[str] | None = None, rows: int = CHUNK
    ) -> Iterator[Table]:
        """One table, with NaN where a label lacks a time; if labels lack many, each has a clock of its own."""
        del rows
        chosen = selected(self.source, names, self.names)
        needed = dict.fromkeys(
            [
                self._time,
                *(self._places[name][0] for name in chosen if name in self._places),
            ]
        )
        pieces = [table.columns for table in self._file.tables(list(needed))]
        values = {
            name: np.concatenate([piece[name] for piece in pieces]) for name in needed
        }
        if any(len(values[self._time]) != len(mine) for mine in self._rows.values()):
            raise InputError("some rows cannot be read, so their label is unknown",
                             source=self.source)  # fmt: skip
        labels = dict.fromkeys(
            self._places[name][1] for name in chosen if name in self._places
        )
        stamps = {one: np.unique(values[self._time][self._rows[one]]) for one in labels}
        fewest = min(map(len, stamps.values()), default=0)
        times, places = np.unique(values[self._time], return_inverse=True)
        if fewest < SHARE * len(times) and len(labels) > 1:
            yield self._with_clocks(chosen, values)
            return
        columns = {}
        for name in chosen:
            column, label = self._places.get(name, (name, ""))
            mine = self._rows.get(label, slice(None))
            columns[name] = np.full(len(times), np.nan)
            columns[name][places[mine]] = values[column][mine]
        yield Table(self.source, columns)

    def _with_clocks(
        self, chosen: Sequence[str], values: Mapping[str, Floats]
    ) -> Table:
        """A table in which each label has the times of its own rows; those of the first are the column of times."""
        columns: dict[str, Floats] = {}
        clocks: dict[str, str] = {}
        for name in chosen:
            if name not in self._places:
                continue
            column, label = self._places[name]
            mine, clock_of = self._rows[label], f"{self._time}/{label}"
            order = np.argsort(values[self._time][mine], kind="stable")
            columns[name] = values[column][mine][order]
            columns[clock_of] = values[self._time][mine][order]
            clocks |= {name: clock_of, clock_of: self._time}
        if self._time in chosen:
            columns[self._time] = columns[next(iter(clocks.values()))]
        return Table(self.source, columns, clocks)
