"""Columns from messages, whatever their type.

Messages are walked as they come, decoded from ROS's binary encodings or from JSON alike, with no table of known types:
a robot's own messages are as welcome as the standard ones.  One convention is known: where a message lists names
(joints of a ``JointState``), its arrays go by these names and not by position, because publishers may change the order.

Messages of a topic need not all hold the same fields: two nodes may publish different joints under one name.  Rows are
collected by layout, so that a layout's names are worked out once; a column that does not occur in every message gets a
clock of its own instead of invented values.
"""

from __future__ import annotations

from array import array
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.errors import InputError, one_line
from echelon.inputs.content import COLUMNS

Labels = tuple[str, ...] | int | None
"""Names of an array's entries, or how many there are, or None for a single number."""

_NAME_FIELDS = ("name", "names", "joint_names", "interface_names")
_NANOSECONDS = ("nanosec", "nsec", "nsecs", "nanosecs")
END_OF_TIME = 2**63
"""Nanoseconds that do not fit into 64 bits any more."""
_SECONDS = ("sec", "secs")
_LONGEST = 256

_NANO = 10**9
_LATEST = 2**63
_Layout = tuple[tuple[str, Labels], ...]


@dataclass
class Numbers:
    """The numbers of one message."""

    topic: str
    # a field's path, beginning with the topic; how its entries are told apart; and they themselves
    parts: list[tuple[str, Labels, Sequence[float]]] = field(default_factory=list)
    left_out: dict[str, str] = field(default_factory=dict)  # paths of what is no column, and why

    def visit(self, value: Any, path: str, names: tuple[str, ...] = ()) -> None:
        """Take in a field at a path and what is inside it; ``names`` are those that the message around it lists."""
        if isinstance(value, bool | int | float):
            self.parts.append((path, None, (value,)))
        elif isinstance(value, np.ndarray):
            if value.size > _LONGEST:  # such as the pixels of an image
                self._leave_out(path, value.size)
            else:
                self._numbers(value.ravel().tolist(), path, names)
        elif isinstance(value, list):
            self._list(value, path, names)
        else:
            self._fields(fields(value), path, names)

    def _fields(self, found: Sequence[tuple[str, Any]], path: str, names: tuple[str, ...]) -> None:
        own = self._names(found, path) or names
        for name, value in found:
            if name in ("stamp", "timestamp") and self._is_clock(f"{path}/{name}", value):
                continue
            self.visit(value, f"{path}/{name}", own)

    def _list(self, values: list[Any], path: str, names: tuple[str, ...]) -> None:
        if all(entry is None or isinstance(entry, bool | int | float) for entry in values):
            self._numbers([float("nan") if entry is None else entry for entry in values], path, names)
        elif len(values) > _LONGEST:
            self._leave_out(path, len(values))
        elif not isinstance(values[0], str):
            labels = [f"/{name}" for name in names] if len(names) == len(values) else None
            for index, entry in enumerate(values):
                self.visit(entry, path + (labels[index] if labels else f"[{index}]"))

    def _numbers(self, values: list[float], path: str, names: tuple[str, ...]) -> None:
        if len(values) > _LONGEST:
            self._leave_out(path, len(values))
        elif values:
            self.parts.append((path, names if len(names) == len(values) else len(values), values))

    def _leave_out(self, path: str, length: int) -> None:
        self.left_out[path] = f"has {length} entries; arrays of at most {_LONGEST} become columns"

    def _names(self, found: Iterable[tuple[str, Any]], path: str) -> tuple[str, ...]:
        """Names that a message lists for the entries of its arrays."""
        for name, value in found:
            if name in _NAME_FIELDS and isinstance(value, list) and value and all(isinstance(n, str) for n in value):
                if len(set(value)) != len(value):
                    twice = next(entry for entry in value if value.count(entry) > 1)
                    raise InputError(f"a message names '{one_line(twice)}' twice", element=f"'{path}/{name}'")
                return tuple(value)
        return ()

    def _is_clock(self, path: str, value: Any) -> bool:
        return path in (f"{self.topic}/header/stamp", f"{self.topic}/timestamp") and nanoseconds(value) is not None


def fields(message: Any) -> list[tuple[str, Any]]:
    """The fields of a decoded message, none for anything else."""
    if isinstance(message, dict):
        return [(str(name), value) for name, value in message.items()]
    names = getattr(type(message), "__dataclass_fields__", ())
    return [(name, getattr(message, name)) for name in names if not name.startswith("__")]


def stamp(message: Any) -> int | None:
    """The time that a message carries, ``header.stamp`` or ``timestamp``, ns; None without one."""
    found = dict(fields(message))
    inside = dict(fields(found.get("header")))
    return nanoseconds(inside["stamp"]) if "stamp" in inside else nanoseconds(found.get("timestamp"))


def nanoseconds(value: Any) -> int | None:
    """A time of two integers, seconds and nanoseconds, as one; None for anything else."""
    found = dict(fields(value))
    seconds = next((found[name] for name in _SECONDS if name in found), None)
    rest = next((found[name] for name in _NANOSECONDS if name in found), None)
    if len(found) != 2 or not isinstance(seconds, int) or not isinstance(rest, int):
        return None
    time = seconds * 10**9 + rest
    if abs(time) >= END_OF_TIME:
        raise InputError("a message's time is more than 292 years from zero", element="stamp")
    return time


@dataclass
class _Rows:
    """Messages of one layout: wanted columns, the messages' positions in the topic, and their numbers row by row."""

    names: tuple[str, ...]
    picked: tuple[int, ...]
    positions: array[int] = field(default_factory=lambda: array("q"))
    values: array[float] = field(default_factory=lambda: array("d"))


class TopicColumns:
    """Collects the messages of a topic; all of their columns, or those that are wanted."""

    def __init__(self, topic: str, wanted: Collection[str] | None = None) -> None:
        self._topic = topic
        self._wanted = None if wanted is None else frozenset(wanted)
        self._times = array("q")
        self._rows: dict[_Layout, _Rows] = {}
        self._count = 0

    def add(self, time: int, numbers: Numbers) -> None:
        """Take in the numbers of one message; its time is in ns by the topic's clock."""
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
        """Name, values and clock's name of every column; clocks, in s from ``origin``, are among them and have none."""
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
