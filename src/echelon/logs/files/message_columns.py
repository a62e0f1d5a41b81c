"""Columns from the messages of one topic.

Messages of a topic need not all hold the same fields: two nodes may publish different joints under one name.  Rows are
collected by layout, so that a layout's names are worked out once; a column that does not occur in every message gets a
clock of its own instead of invented values.
"""

from __future__ import annotations

from array import array
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.errors import InputError, one_line
from echelon.inputs.limits import COLUMNS
from echelon.logs.files.messages import Labels, Numbers

_NANO = 10**9
_LATEST = 2**63

_Layout = tuple[tuple[str, Labels], ...]


@dataclass
class _Rows:
    """Messages of one layout: wanted columns, the messages' positions in the topic, and their numbers row by row."""

    names: tuple[str, ...]
    picked: tuple[int, ...]
    positions: array[int] = field(default_factory=lambda: array("q"))
    values: array[float] = field(default_factory=lambda: array("d"))


class TopicColumns:
    """Collects the messages of a topic.

    Parameters
    ----------
    topic : str
    wanted : collection of str, optional
        Columns to keep; all if omitted.
    """

    def __init__(self, topic: str, wanted: Collection[str] | None = None) -> None:
        self._topic = topic
        self._wanted = None if wanted is None else frozenset(wanted)
        self._times = array("q")
        self._rows: dict[_Layout, _Rows] = {}
        self._count = 0

    def add(self, time: int, numbers: Numbers) -> None:
        """Take in one message.

        Parameters
        ----------
        time : int
            By the topic's clock, ns.
        numbers : Numbers

        Raises
        ------
        InputError
            If two of its numbers have the same name, or one or its time is too large.
        """
        layout = tuple([(path, labels) for path, labels, _ in numbers.parts])
        rows = self._rows.get(layout)
        if rows is None:
            rows = self._rows[layout] = self._new(layout)
        row = [value for _, _, values in numbers.parts for value in values]
        if len(rows.picked) != len(row):
            row = [row[index] for index in rows.picked]
        try:
            rows.values.extend(row)
        except OverflowError:
            problem = "a message holds an integer that is too large for a float"
            raise InputError(problem, element=f"topic '{self._topic}'") from None
        rows.positions.append(len(self._times))
        if abs(time) >= _LATEST:
            raise InputError("a message's time is more than 292 years from 1970", element=f"topic '{self._topic}'")
        self._times.append(time)

    @property
    def names(self) -> tuple[str, ...]:
        """Columns so far, without clocks."""
        return tuple(dict.fromkeys(name for rows in self._rows.values() for name in rows.names))

    def columns(self, clock: str, origin: int) -> Iterator[tuple[str, Floats, str]]:
        """Name, values and name of the clock of every column; clocks are among them and have none.

        Parameters
        ----------
        clock : str
            Name of the topic's clock.
        origin : int
            Second from which its times count.
        """
        times = (np.array(self._times, dtype=np.int64) - origin * _NANO) / _NANO
        yield clock, times, ""
        for name, (positions, values) in self._merged().items():
            own = clock if len(positions) == len(times) else clock + name.removeprefix(self._topic)
            yield name, values, own
            if own != clock:
                yield own, times[positions], ""

    def _new(self, layout: _Layout) -> _Rows:
        names = [one_line(name) for path, labels in layout for name in _entries(path, labels)]
        if len(set(names)) != len(names):
            twice = next(name for name in names if names.count(name) > 1)
            raise InputError("a message holds two numbers of this name", element=f"column '{twice}'")
        picked = [index for index, name in enumerate(names) if self._wanted is None or name in self._wanted]
        self._count += len(picked)
        COLUMNS.check(self._count, element=f"topic '{self._topic}'")
        return _Rows(tuple(names[index] for index in picked), tuple(picked))

    def _merged(self) -> dict[str, tuple[npt.NDArray[np.int64], Floats]]:
        """Positions of the messages that hold a column, and its values, in the order of the messages."""
        pieces: dict[str, list[tuple[npt.NDArray[np.int64], Floats]]] = {}
        for rows in self._rows.values():
            positions = np.array(rows.positions, dtype=np.int64)
            matrix = np.array(rows.values, dtype=np.float64).reshape(len(positions), len(rows.names))
            for index, name in enumerate(rows.names):
                pieces.setdefault(name, []).append((positions, matrix[:, index]))
        return {name: _in_order(found) for name, found in pieces.items()}


def _in_order(pieces: Sequence[tuple[npt.NDArray[np.int64], Floats]]) -> tuple[npt.NDArray[np.int64], Floats]:
    positions = np.concatenate([positions for positions, _ in pieces])
    values = np.concatenate([values for _, values in pieces])
    order = np.argsort(positions)
    return positions[order], values[order]


def _entries(path: str, labels: Labels) -> list[str]:
    """Names of a field's columns."""
    if labels is None:
        return [path]
    if isinstance(labels, int):
        return [f"{path}[{index}]" for index in range(labels)]
    return [f"{path}/{label}" for label in labels]
