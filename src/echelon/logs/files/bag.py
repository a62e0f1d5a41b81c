"""Recorded messages, of ROS 2 bags and MCAP files alike, as columns.

Only the topics that hold the columns that are asked for are decoded: a bag's images cost nothing.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.logs.files.mcap import Mcap, is_mcap
from echelon.logs.files.message_columns import TopicColumns
from echelon.logs.files.rosbag import Rosbag
from echelon.logs.files.selection import missing
from echelon.logs.files.topics import MessageSource, first_look, numbers_of
from echelon.logs.table import CHUNK, Table


class BagFile:
    """A ROS 2 bag (a directory, or a lone ``.db3``) or an MCAP file.

    Every number in a message is a column named by its topic and path, ``/ft/wrench/force/x``; entries of arrays are
    ``/topic/data[0]``, or go by the names that the message lists: ``/joint_states/position/elbow``.  Each topic has its
    clock ``/topic/time`` (``/topic/log_time`` where messages hold a number called ``time``), which is the time stamped
    on the messages if there is one, otherwise that of their reception.  A column that does not occur in every message
    has a clock of its own, ``/topic/time/position/elbow``.  ``Table.clocks`` says which belongs to which.

    Times are absolute, but for whole seconds: they count from ``origin``.  Stamps of a clock that is more than 10⁶ s
    off count from the whole second of the first of them.

    Parameters
    ----------
    path : path

    Attributes
    ----------
    source : str
    names : tuple of str
        Columns of the first messages of each topic; columns that occur later only can be asked for all the same.
    origin : int
        Second since 1970 in which the first message was received.

    Raises
    ------
    InputError
        If the bag cannot be read, is damaged, or holds no numbers.
    MissingExtraError
        If rosbags or mcap is not installed.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._messages: MessageSource = Mcap(path) if is_mcap(path) else Rosbag(path)
        self.source = self._messages.source
        self.origin = self._messages.start // 10**9
        try:
            self._topics, self._left_out = first_look(self._messages)
        except InputError as error:
            raise error.located(self.source) from None
        topics = [topic for topic in self._topics.values() if topic.columns]
        self.names: tuple[str, ...] = tuple(name for topic in topics for name in (topic.clock, *topic.columns))
        if not self.names:
            reasons = "; ".join(f"'{topic}': {reason}" for topic, reason in self._left_out.items())
            raise InputError(f"holds no messages with numbers{reasons and f' ({reasons})'}", source=self.source)

    def tables(self, names: Sequence[str] | None = None, rows: int = CHUNK) -> Iterator[Table]:
        """One table: columns of different topics differ in length, so that there are no common rows to cut at.

        Parameters
        ----------
        names : sequence of str, optional
            Columns to read; their clocks come with them.  All if omitted.
        rows : int
            Not used.

        Raises
        ------
        InputError
            If a column is missing or the bag is damaged.
        """
        del rows
        try:
            collected = self._collected(names)
            table = self._table(collected)
        except InputError as error:
            raise error.located(self.source) from None
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
