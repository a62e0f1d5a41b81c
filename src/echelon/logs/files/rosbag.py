"""ROS 2 bags: a directory with ``metadata.yaml``, or a lone SQLite file of one."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

from echelon.errors import InputError, MissingExtraError
from echelon.logs.files.access import decoding, existing_file
from echelon.logs.files.messages import END_OF_TIME
from echelon.logs.files.recordings import check_bag
from echelon.logs.files.ros_types import Definition, RosTypes

_KIND = "a ROS 2 bag"
_METADATA = "metadata.yaml"


class Rosbag:
    """Messages of a ROS 2 bag, the source of a :class:`echelon.logs.files.bag.BagFile`.

    Parameters
    ----------
    path : path
        The directory, or a ``.db3`` file.

    Attributes
    ----------
    source : str
    start : int
        When the first message was received, ns since 1970.
    topics : mapping of str to str
        Topics, and why their messages cannot be read; empty where they can.

    Raises
    ------
    InputError
        If there is no bag, or it is damaged.
    MissingExtraError
        If rosbags is not installed.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._path, self.source = Path(path), os.fspath(path)
        files = _files(self._path)
        for file in files:
            _check_closed(file, self.source)
        with decoding(self.source, _KIND):
            check_bag(self._path, files)
        with decoding(self.source, _KIND), self._opened() as reader:
            connections = list(reader.connections)
            self.start: int = reader.start_time
            if not isinstance(self.start, int) or abs(self.start) >= END_OF_TIME:
                raise InputError("is damaged: its start is no time in nanoseconds", source=self.source)
            self._types = RosTypes(_definition(connection) for connection in connections)
        self.topics: Mapping[str, str] = self._readable(connections)

    def messages(self, topics: Collection[str], head: int | None = None) -> Iterator[tuple[str, int, Any]]:
        """Messages in the order in which they were received: topic, time in ns, and content.

        Parameters
        ----------
        topics : collection of str
        head : int, optional
            Only so many of each publisher's messages.

        Raises
        ------
        InputError
            If the bag is damaged.
        """
        with decoding(self.source, _KIND), self._opened() as reader:
            chosen = [connection for connection in reader.connections if connection.topic in topics]
            for group in [chosen] if head is None else [[connection] for connection in chosen]:
                for connection, time, message in islice(reader.messages(connections=group), head):
                    # int: a database holds what was put into it, whatever the type of its column
                    yield connection.topic, int(time), self._types.decode(connection.msgtype, message)

    def _opened(self) -> Any:
        try:
            from rosbags.rosbag2 import Reader
        except ImportError:
            raise MissingExtraError("rosbags", "ros") from None
        return Reader(self._path)

    def _readable(self, connections: Sequence[Any]) -> dict[str, str]:
        """A topic can be read if the messages of all its publishers can."""
        counts: Counter[str] = Counter()
        reasons: dict[str, str] = {}
        for connection in connections:
            topic = connection.topic
            if not isinstance(connection.msgcount, int):
                raise InputError(
                    "is damaged: a number of messages is no whole number", source=self.source, element=topic
                )
            counts[topic] += connection.msgcount
            reasons[topic] = reasons.get(topic) or self._types.left_out.get(connection.msgtype, "")
        return {topic: reason if counts[topic] else "its topic has no messages" for topic, reason in reasons.items()}


def _files(path: Path) -> list[Path]:
    """SQLite files of a bag; an error for what is none."""
    if not os.path.isdir(path):
        if existing_file(path).suffix != ".db3":
            raise InputError("is no .db3 file; the files of a ROS 2 bag are .db3 or .mcap", source=os.fspath(path))
        return [path]
    existing_file(path / _METADATA)
    return sorted(path.glob("*.db3"))


def _check_closed(file: Path, source: str) -> None:
    """A recorder that was killed leaves messages in a second file, which SQLite takes in when it opens the first."""
    pending = file.with_name(f"{file.name}-wal")
    if pending.is_file() and pending.stat().st_size:
        problem = f"was not closed: {pending.name} still holds messages; take them in with  sqlite3 {file.name} .tables"
        raise InputError(problem, source=source)


def _definition(connection: Any) -> Definition:
    """How the bag defines a connection's type."""
    format_ = connection.msgdef.format.name.lower()
    return Definition(connection.msgtype, "" if format_ == "none" else format_, connection.msgdef.data)
