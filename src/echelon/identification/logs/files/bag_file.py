"""Recorded messages, of ROS bags and MCAP files alike, as columns, whatever their type.

Messages are walked as they come, decoded from ROS's binary encodings or from JSON alike, with no table of known types:
a robot's own messages are as welcome as the standard ones.  One convention is known: where a message lists names
(joints of a ``JointState``), its arrays go by these names and not by position, because publishers may change the order.
Only the topics that hold the columns that are asked for are decoded: a bag's images cost nothing.

Messages of a topic need not all hold the same fields: two nodes may publish different joints under one name.  Rows are
collected by layout, so that a layout's names are worked out once; a column that does not occur in every message gets a
clock of its own instead of invented values.

A message's time is its ``header.stamp`` (or ``timestamp``) if it has one, because that is when the quantity was
measured; otherwise when it was received.  Nanoseconds since 1970 do not fit into a float64, so that seconds count from
the whole second in which the first message was received.  Stamps from a clock that is far off, such as that of a
simulation, count from the whole second of the first of them.
"""

from __future__ import annotations

import os
from array import array
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from echelon.identification.logs.files.log_file import CHUNK, HEAD, Table, missing
from echelon.identification.logs.files.message_sources import (
    END_OF_TIME,
    Mcap,
    Rosbag,
    is_mcap,
)
from echelon.shared import COLUMNS, ENTRIES, Floats, InputError, locating, one_line

Labels = (
    tuple[str, ...] | int | None
)  # names of an array's entries, or how many there are, or None for a single number

_NAME_FIELDS = ("name", "names", "joint_names", "interface_names")
_NANOSECONDS = ("nanosec", "nsec", "nsecs", "nanosecs")
_SECONDS = ("sec", "secs")
_STAMPS = ("stamp", "timestamp")

_NANO = 10**9
"""Nanoseconds in a second."""

_FAR = 10**6 * _NANO
"""Difference of a stamp from the time of reception, ns, that only another clock explains."""

_Layout = tuple[tuple[str, Labels], ...]


@dataclass
class Numbers:
    """The numbers of one message."""

    topic: str
    # a field's path, beginning with the topic; how its entries are told apart; and they themselves
    parts: list[tuple[str, Labels, Sequence[float]]] = field(default_factory=list)
    left_out: dict[str, str] = field(
        default_factory=dict
    )  # paths of what is no column, and why

    @classmethod
    def of(cls, topic: str, message: Any) -> Numbers:
        """The numbers of a topic's message."""
        found = cls(topic)
        found.visit(message, topic)
        return found

    def visit(self, value: Any, path: str, names: tuple[str, ...] = ()) -> None:
        """Take in a field at a path and what is inside it; ``names`` are those that the message around it lists."""
        if isinstance(value, bool | int | float):
            self.parts.append((path, None, (value,)))
        elif isinstance(value, np.ndarray):
            if value.size > ENTRIES.most:  # such as the pixels of an image
                self._leave_out(path, value.size)
            else:
                self._numbers(value.ravel().tolist(), path, names)
        elif isinstance(value, list):
            self._list(value, path, names)
        else:
            self._fields(fields(value), path, names)

    def _fields(
        self, found: Sequence[tuple[str, Any]], path: str, names: tuple[str, ...]
    ) -> None:
        own = self._names(found, path) or names
        for name, value in found:
            inner = f"{path}/{name}"
            is_clock = name in _STAMPS and inner in (
                f"{self.topic}/header/stamp",
                f"{self.topic}/timestamp",
            )
            if not is_clock or nanoseconds(value) is None:
                self.visit(value, inner, own)

    def _list(self, values: list[Any], path: str, names: tuple[str, ...]) -> None:
        if all(
            entry is None or isinstance(entry, bool | int | float) for entry in values
        ):
            self._numbers(
                [float("nan") if entry is None else entry for entry in values],
                path,
                names,
            )
        elif len(values) > ENTRIES.most:
            self._leave_out(path, len(values))
        elif not isinstance(values[0], str):
            labels = (
                [f"/{name}" for name in names] if len(names) == len(values) else None
            )
            for index, entry in enumerate(values):
                self.visit(entry, path + (labels[index] if labels else f"[{index}]"))

    def _numbers(self, values: list[float], path: str, names: tuple[str, ...]) -> None:
        if len(values) > ENTRIES.most:
            self._leave_out(path, len(values))
        elif values:
            self.parts.append(
                (path, names if len(names) == len(values) else len(values), values)
            )

    def _leave_out(self, path: str, length: int) -> None:
        self.left_out[path] = (
            f"has {length} entries; arrays of at most {ENTRIES.most} become columns"
        )

    def _names(self, found: Iterable[tuple[str, Any]], path: str) -> tuple[str, ...]:
        """Names that a message lists for the entries of its arrays."""
        for name, value in found:
            if (
                name in _NAME_FIELDS
                and isinstance(value, list)
                and value
                and all(isinstance(n, str) for n in value)
            ):
                if len(set(value)) != len(value):
                    twice = next(entry for entry in value if value.count(entry) > 1)
                    raise InputError(
                        f"a message names '{one_line(twice)}' twice",
                        element=f"'{path}/{name}'",
                    )
                return tuple(value)
        return ()


def fields(message: Any) -> list[tuple[str, Any]]:
    """The fields of a decoded message, none for anything else."""
    if isinstance(message, dict):
        return [(str(name), value) for name, value in message.items()]
    names = getattr(type(message), "__dataclass_fields__", ())
    return [
        (name, getattr(message, name)) for name in names if not name.startswith("__")
    ]


def stamp(message: Any) -> int | None:
    """The time that a message carries, ``header.stamp`` or ``timestamp``, ns; None without one."""
    found = dict(fields(message))
    inside = dict(fields(found.get("header")))
    if "stamp" in inside:
        return nanoseconds(inside["stamp"])
    return nanoseconds(found.get("timestamp"))


def nanoseconds(value: Any) -> int | None:
    """A time of two integers, seconds and nanoseconds, as one; None for anything else."""
    found = dict(fields(value))
    seconds = next((found[name] for name in _SECONDS if name in found), None)
    rest = next((found[name] for name in _NANOSECONDS if name in found), None)
    if len(found) != 2 or not isinstance(seconds, int) or not isinstance(rest, int):
        return None
    time = seconds * _NANO + rest
    if abs(time) >= END_OF_TIME:
        raise InputError(
            "a message's time is more than 292 years from zero", element="stamp"
        )
    return time


@dataclass
class _RowsOfLayout:
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
        self._rows: dict[_Layout, _RowsOfLayout] = {}
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
        if abs(time) >= END_OF_TIME:
            raise InputError(
                "a message's time is more than 292 years from 1970",
                element=f"topic '{self._topic}'",
            )
        self._times.append(time)

    @property
    def names(self) -> tuple[str, ...]:
        """Columns so far, without clocks."""
        return tuple(
            dict.fromkeys(name for rows in self._rows.values() for name in rows.names)
        )

    def columns(self, clock: str, origin: int) -> Iterator[tuple[str, Floats, str]]:
        """Name, values and clock's name of every column; clocks, in s from ``origin``, are among them and have none."""
        times = (np.array(self._times, dtype=np.int64) - origin * _NANO) / _NANO
        yield clock, times, ""
        for name, (positions, values) in self._merged().items():
            own = (
                clock
                if len(positions) == len(times)
                else clock + name.removeprefix(self._topic)
            )
            yield name, values, own
            if own != clock:
                yield own, times[positions], ""

    def _new(self, layout: _Layout) -> _RowsOfLayout:
        names = [
            one_line(name) for path, labels in layout for name in _entries(path, labels)
        ]
        if len(set(names)) != len(names):
            twice = next(name for name in names if names.count(name) > 1)
            raise InputError(
                "a message holds two numbers of this name", element=f"column '{twice}'"
            )
        picked = [
            index
            for index, name in enumerate(names)
            if self._wanted is None or name in self._wanted
        ]
        self._count += len(picked)
        COLUMNS.check(self._count, element=f"topic '{self._topic}'")
        return _RowsOfLayout(tuple(names[index] for index in picked), tuple(picked))

    def _merged(self) -> dict[str, tuple[npt.NDArray[np.int64], Floats]]:
        """Positions of the messages that hold a column, and its values, in the order of the messages."""
        pieces: dict[str, list[tuple[npt.NDArray[np.int64], Floats]]] = {}
        for rows in self._rows.values():
            positions = np.array(rows.positions, dtype=np.int64)
            matrix = np.array(rows.values, dtype=np.float64).reshape(
                len(positions), len(rows.names)
            )
            for index, name in enumerate(rows.names):
                pieces.setdefault(name, []).append((positions, matrix[:, index]))
        found = {}
        for name, some in pieces.items():
            positions, values = (
                np.concatenate(parts) for parts in zip(*some, strict=True)
            )
            order = np.argsort(positions)
            found[name] = positions[order], values[order]
        return found


def _entries(path: str, labels: Labels) -> list[str]:
    """Names of a field's columns."""
    if labels is None:
        return [path]
    if isinstance(labels, int):
        return [f"{path}[{index}]" for index in range(labels)]
    return [f"{path}/{label}" for label in labels]


@dataclass(frozen=True)
class Topic:
    """A topic by its first messages."""

    name: str
    columns: tuple[str, ...]
    stamped: bool  # whether its messages carry the time at which they were measured
    origin: int  # second since 1970, or of the clock that stamps them, from which its times count

    @property
    def clock(self) -> str:
        """Name of the column with its times."""
        last = "time"
        while f"{self.name}/{last}" in self.columns:
            last = f"log_{last}"
        return f"{self.name}/{last}"

    def time(self, received: int, message: Any) -> int:
        """Time of a message by the topic's clock, ns."""
        if not self.stamped:
            return received
        own = stamp(message)
        if own is None:
            raise InputError(
                "a message carries no time, unlike the first one",
                element=f"topic '{self.name}'",
            )
        return own


def first_look(source: Mcap | Rosbag) -> tuple[dict[str, Topic], dict[str, str]]:
    """The topics that can be read, and what is left out with the reason."""
    left_out = {topic: reason for topic, reason in source.topics.items() if reason}
    columns = {
        topic: TopicColumns(topic)
        for topic, reason in source.topics.items()
        if not reason
    }
    stamps: dict[str, tuple[int, int]] = {}
    for topic, received, message in source.messages(list(columns), HEAD):
        stamps.setdefault(topic, (stamp(message) or 0, received))
        numbers = Numbers.of(topic, message)
        columns[topic].add(received, numbers)
        left_out |= numbers.left_out
    far = {
        topic: own
        for topic, (own, received) in stamps.items()
        if own and abs(own - received) > _FAR
    }
    topics = {}
    for topic, (own, _) in stamps.items():
        start = min(far.values()) if topic in far else source.start
        topics[topic] = Topic(topic, columns[topic].names, own != 0, start // _NANO)
    return topics, left_out


class BagFile:
    """A bag of ROS 1 (``.bag``) or ROS 2 (a directory, or a lone ``.db3``), or an MCAP file.

    Every number in a message is a column named by its topic and path, ``/ft/wrench/force/x``; entries of arrays are
    ``/topic/data[0]``, or go by the names that the message lists: ``/joint_states/position/elbow``.  Each topic has its
    clock ``/topic/time`` (``/topic/log_time`` where messages hold a number called ``time``), which is the time stamped
    on the messages if there is one, otherwise that of their reception.  A column that does not occur in every message
    has a clock of its own, ``/topic/time/position/elbow``.  ``Table.clocks`` says which belongs to which.

    Times are absolute, but for whole seconds: they count from ``origin``.  Stamps of a clock that is more than 10⁶ s
    off count from the whole second of the first of them.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._messages = Mcap(path) if is_mcap(path) else Rosbag(path)
        self.source = self._messages.source
        self.origin = self._messages.start // _NANO
        with locating(self.source):
            self._topics, self._left_out = first_look(self._messages)
        topics = [topic for topic in self._topics.values() if topic.columns]
        self.names: tuple[str, ...] = tuple(
            name for topic in topics for name in (topic.clock, *topic.columns)
        )
        if not self.names:
            reasons = "; ".join(
                f"'{topic}': {reason}" for topic, reason in self._left_out.items()
            )
            raise InputError(
                f"holds no messages with numbers{reasons and f' ({reasons})'}",
                source=self.source,
            )

    def tables(
        self, names: Sequence[str] | None = None, rows: int = CHUNK
    ) -> Iterator[Table]:
        """One table: columns of different topics differ in length, so that there are no common rows to cut at."""
        del rows
        with locating(self.source):
            collected = self._collected(names)
            table = self._table(collected)
        for name in names or ():
            if name not in table.columns:
                raise missing(
                    self.source, name, [*self.names, *table.columns], self._left_out
                )
        yield table

    def _collected(self, names: Sequence[str] | None) -> dict[str, TopicColumns]:
        """The messages of the topics that are needed."""
        wanted = None if names is None else frozenset(names)
        topics = list(self._topics) if names is None else self._homes(names)
        collected = {topic: TopicColumns(topic, wanted) for topic in topics}
        for name, received, message in self._messages.messages(topics):
            collected[name].add(
                self._topics[name].time(received, message), Numbers.of(name, message)
            )
        return collected

    def _table(self, collected: dict[str, TopicColumns]) -> Table:
        columns: dict[str, Floats] = {}
        clocks: dict[str, str] = {}
        for topic, found in collected.items():
            about = self._topics[topic]
            for name, values, clock in found.columns(about.clock, about.origin):
                if name in columns:
                    raise InputError(
                        "two topics have columns of this name",
                        element=f"column '{name}'",
                    )
                columns[name] = values
                if clock:
                    clocks[name] = clock
        return Table(self.source, columns, clocks)

    def _homes(self, names: Sequence[str]) -> list[str]:
        """Topics that hold the columns, or may hold them in later messages."""
        homes: dict[str, None] = {}
        for name in names:
            known = [
                topic.name
                for topic in self._topics.values()
                if name in (topic.clock, *topic.columns)
            ]
            known = known or [
                topic
                for topic in self._topics
                if name.startswith((f"{topic}/", f"{topic}["))
            ]
            if not known:
                raise missing(self.source, name, self.names, self._left_out)
            homes |= dict.fromkeys(known)
        return list(homes)
