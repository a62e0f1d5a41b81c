"""What the first messages of a log's topics say: which columns there are, and by which clock they were measured.

A message's time is its ``header.stamp`` (or ``timestamp``) if it has one, because that is when the quantity was
measured; otherwise when it was received.  Nanoseconds since 1970 do not fit into a float64, so that seconds count from
the whole second in which the first message was received.  Stamps from a clock that is far off, such as that of a
simulation, count from the whole second of the first of them.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from echelon.errors import InputError
from echelon.logs.files.message_columns import TopicColumns
from echelon.logs.files.messages import Numbers, stamp

_NANO = 10**9
_FAR = 10**6 * _NANO
_HEAD = 64


class MessageSource(Protocol):
    """Where messages come from: :class:`echelon.logs.files.rosbag.Rosbag` or :class:`echelon.logs.files.mcap.Mcap`.

    Attributes
    ----------
    source : str
    start : int
        When the first message was received, ns since 1970.
    topics : mapping of str to str
        Topics, and why their messages cannot be read; empty where they can.
    """

    source: str
    start: int
    topics: Mapping[str, str]

    def messages(self, topics: Collection[str], head: int | None = None) -> Iterator[tuple[str, int, Any]]:
        """Messages in the order in which they were received: topic, time in ns, and content.

        Parameters
        ----------
        topics : collection of str
        head : int, optional
            Only so many of the first messages of each.
        """
        ...


@dataclass(frozen=True)
class Topic:
    """A topic by its first messages.

    Attributes
    ----------
    name : str
    columns : tuple of str
    stamped : bool
        Whether its messages carry the time at which they were measured.
    origin : int
        Second since 1970, or of the clock that stamps them, from which its times count.
    """

    name: str
    columns: tuple[str, ...]
    stamped: bool
    origin: int

    @property
    def clock(self) -> str:
        """Name of the column with its times."""
        last = "time"
        while f"{self.name}/{last}" in self.columns:
            last = f"log_{last}"
        return f"{self.name}/{last}"

    def time(self, received: int, message: Any) -> int:
        """Time of a message by the topic's clock, ns.

        Parameters
        ----------
        received : int
            When it was received, ns.
        message : object

        Raises
        ------
        InputError
            If it carries no time, unlike the first one.
        """
        if not self.stamped:
            return received
        own = stamp(message)
        if own is None:
            raise InputError("a message carries no time, unlike the first one", element=f"topic '{self.name}'")
        return own


def numbers_of(topic: str, message: Any) -> Numbers:
    """The numbers of a message.

    Parameters
    ----------
    topic : str
    message : object
    """
    found = Numbers(topic)
    found.visit(message, topic)
    return found


def first_look(source: MessageSource) -> tuple[dict[str, Topic], dict[str, str]]:
    """The topics that can be read, and what is left out with the reason.

    Parameters
    ----------
    source : MessageSource
    """
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
