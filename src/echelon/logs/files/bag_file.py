"""Recorded messages, of ROS bags and MCAP files alike, as columns.

Only the topics that hold the columns that are asked for are decoded: a bag's images cost nothing.

A message's time is its ``header.stamp`` (or ``timestamp``) if it has one, because that is when the quantity was
measured; otherwise when it was received.  Nanoseconds since 1970 do not fit into a float64, so that seconds count from
the whole second in which the first message was received.  Stamps from a clock that is far off, such as that of a
simulation, count from the whole second of the first of them.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from echelon.arrays import Floats
from echelon.errors import InputError, locating
from echelon.logs.files.log_file import CHUNK, Table, missing
from echelon.logs.files.mcap_file import Mcap, is_mcap
from echelon.logs.files.message_columns import Numbers, TopicColumns, stamp
from echelon.logs.files.ros_bag import Rosbag

_NANO = 10**9
_FAR = 10**6 * _NANO
_HEAD = 64


class MessageSource(Protocol):
    """Where messages come from: a ROS bag or an MCAP file."""

    source: str
    start: int  # when the first message was received, ns since 1970
    topics: Mapping[str, str]  # topics, and why their messages cannot be read; empty where they can

    def messages(self, topics: Collection[str], head: int | None = None) -> Iterator[tuple[str, int, Any]]:
        """Messages in the order of reception: topic, time in ns, content; or only the first few of each topic."""
        ...


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
            raise InputError("a message carries no time, unlike the first one", element=f"topic '{self.name}'")
        return own


def numbers_of(topic: str, message: Any) -> Numbers:
    """The numbers of a message."""
    found = Numbers(topic)
    found.visit(message, topic)
    return found


def first_look(source: MessageSource) -> tuple[dict[str, Topic], dict[str, str]]:
    """The topics that can be read, and what is left out with the reason."""
    left_out = {topic: reason for topic, reason in source.topics.items() if reason}
    columns = {topic: TopicColumns(topic) for topic, reason in source.topics.items() if not reason}
    stamps: dict[str, tuple[int, int]] = {}
    for topic, received, message in source.messages(list(columns), _HEAD):
        stamps.setdefault(topic, (stamp(message) or 0, received))
        numbers = numbers_of(topic, message)
        columns[topic].add(received, numbers)
        left_out |= numbers.left_out
    far = {topic: own for topic, (own, received) in stamps.items() if own and abs(own - received) > _FAR}
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
        self._messages: MessageSource = Mcap(path) if is_mcap(path) else Rosbag(path)
        self.source = self._messages.source
        self.origin = self._messages.start // 10**9
        with locating(self.source):
            self._topics, self._left_out = first_look(self._messages)
        topics = [topic for topic in self._topics.values() if topic.columns]
        self.names: tuple[str, ...] = tuple(name for topic in topics for name in (topic.clock, *topic.columns))
        if not self.names:
            reasons = "; ".join(f"'{topic}': {reason}" for topic, reason in self._left_out.items())
            raise InputError(f"holds no messages with numbers{reasons and f' ({reasons})'}", source=self.source)

    def tables(self, names: Sequence[str] | None = None, rows: int = CHUNK) -> Iterator[Table]:
        """One table: columns of different topics differ in length, so that there are no common rows to cut at."""
        del rows
        with locating(self.source):
            collected = self._collected(names)
            table = self._table(collected)
        for name in names or ():
            if name not in table.columns:
                raise missing(self.source, name, [*self.names, *table.columns], self._left_out)
        yield table

    def _collected(self, names: Sequence[str] | None) -> dict[str, TopicColumns]:
        """The messages of the topics that are needed."""
        wanted = None if names is None else frozenset(names)
        topics = list(self._topics) if names is None else self._homes(names)
        collected = {topic: TopicColumns(topic, wanted) for topic in topics}
        for name, received, message in self._messages.messages(topics):
            collected[name].add(self._topics[name].time(received, message), numbers_of(name, message))
        return collected

    def _table(self, collected: dict[str, TopicColumns]) -> Table:
        columns: dict[str, Floats] = {}
        clocks: dict[str, str] = {}
        for topic, found in collected.items():
            about = self._topics[topic]
            for name, values, clock in found.columns(about.clock, about.origin):
                if name in columns:
                    raise InputError("two topics have columns of this name", element=f"column '{name}'")
                columns[name] = values
                if clock:
                    clocks[name] = clock
        return Table(self.source, columns, clocks)

    def _homes(self, names: Sequence[str]) -> list[str]:
        """Topics that hold the columns, or may hold them in later messages."""
        homes: dict[str, None] = {}
        for name in names:
            known = [topic.name for topic in self._topics.values() if name in (topic.clock, *topic.columns)]
            known = known or [topic for topic in self._topics if name.startswith((f"{topic}/", f"{topic}["))]
            if not known:
                raise missing(self.source, name, self.names, self._left_out)
            homes |= dict.fromkeys(known)
        return list(homes)
