"""Where messages come from: bags of ROS 1 and of ROS 2, and MCAP files; and how they are decoded.

Everything goes through rosbags: no ROS has to be installed.  Bags of ROS 1 carry the definitions of their messages, and
those of ROS 2 since Iron.  Older ones do not, so that what is missing is taken from Humble, the last release before it;
standard messages have not changed since.  ``AnyReader`` of rosbags is not used: one definition that is wrong would cost
it the whole bag.  Each channel of an MCAP file says how its messages are encoded; JSON and ROS 2's CDR are read.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from itertools import islice
from pathlib import Path
from typing import IO, Any

import numpy as np

from echelon.identification.logs.files.log_file import decoding, existing_file
from echelon.identification.logs.files.unpacked_size import (
    MCAP_MARK,
    bounded,
    check_bag,
    check_chunks,
)
from echelon.shared import InputError, extra, one_line, parse_json

END_OF_TIME = np.iinfo(np.int64).max
"""Nanoseconds from which on they do not fit into 64 bits any more."""

_RULE = "=" * 80 + "\n"
_BAG, _MCAP = "a ROS bag", "an MCAP file"
_ADVICE = "the tool 'mcap recover' saves the messages that are complete"
_FIRST = b"#ROSBAG"
"""Beginning of bags of ROS 1."""
_METADATA = "metadata.yaml"
_LANGUAGES = {"ros2msg": "msg", "ros2idl": "idl", "omgidl": "idl"}
_Decoder = Callable[[bytes], Any]


class RosTypes:
    """Decodes messages of the types that a bag defines; ``left_out`` says which cannot be decoded, and why.

    Definitions are by name, such as ``sensor_msgs/msg/JointState``: language (``"msg"``, ``"idl"``, or empty if the
    bag does not define it) and text.
    """

    def __init__(
        self, definitions: Mapping[str, tuple[str, str]], ros: int = 2
    ) -> None:
        with extra("ros"):
            from rosbags.typesys import Stores, TypesysError, get_typestore

        self.left_out: dict[str, str] = {}
        types: dict[str, Any] = {}
        for name, (language, text) in definitions.items():
            try:
                types |= _parsed(name, language, text)
            except TypesysError as error:
                self.left_out[name] = (
                    f"its type {name} is not defined properly in the bag: {error}"
                )
        if any(name not in types and name not in self.left_out for name in definitions):
            types = {**get_typestore(Stores.ROS2_HUMBLE).fielddefs, **types}
        if ros == 1:  # stamps are of a type that no definition states
            types = {**get_typestore(Stores.ROS1_NOETIC).fielddefs, **types}
        for name in definitions:
            if name not in types and name not in self.left_out:
                self.left_out[name] = (
                    f"its type {name} is defined neither in the bag nor by ROS 2"
                )
        self._store = get_typestore(Stores.EMPTY)
        self._store.register(types)
        self._ros = ros

    def decode(self, name: str, message: bytes) -> Any:
        """A message in ROS's binary encoding, that of ROS 1 or CDR, as an object with its fields."""
        if self._ros == 1:
            return self._store.deserialize_ros1(message, name)
        return self._store.deserialize_cdr(message, name)


def ros_name(name: str) -> str:
    """A type's name with its middle part, which some recorders leave out: ``sensor_msgs/msg/JointState``."""
    package, _, rest = name.partition("/")
    return f"{package}/msg/{rest}" if rest and "/" not in rest else name


def _parsed(name: str, language: str, text: str) -> dict[str, Any]:
    """Parsed types of a definition, with those that it uses."""
    with extra("ros"):
        from rosbags.typesys import get_types_from_idl, get_types_from_msg

    if language == "msg":
        return dict(get_types_from_msg(text, name))
    if language == "idl":
        parts = text.split(_RULE) if text.startswith(_RULE) else [text]
        found: dict[str, Any] = {}
        for part in filter(None, parts):
            found |= get_types_from_idl(
                part.split("\n", 1)[1] if part.startswith("IDL: ") else part
            )
        return found
    return {}


class Rosbag:
    """Messages of a bag, the source of a :class:`echelon.identification.logs.files.bag_file.BagFile`."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._path, self.source = Path(path), os.fspath(path)
        self._ros = 1 if _is_first(self._path) else 2
        files = _files(self._path) if self._ros == 2 else []
        for file in files:
            _check_closed(file, self.source)
        with decoding(self.source, _BAG):
            check_bag(self._path, files)
        with decoding(self.source, _BAG), self._opened() as reader:
            connections = list(reader.connections)
            self.start: int = reader.start_time
            if not isinstance(self.start, int) or abs(self.start) >= END_OF_TIME:
                raise InputError(
                    "is damaged: its start is not a time in nanoseconds",
                    source=self.source,
                )
            stated = {some.msgtype: some.msgdef for some in connections}
            texts = {
                name: (it.format.name.lower().replace("none", ""), it.data)
                for name, it in stated.items()
            }
            self._types = RosTypes(texts, self._ros)
        for connection in connections:
            if not isinstance(connection.msgcount, int):
                problem = "is damaged: a number of messages is not a whole number"
                raise InputError(problem, source=self.source, element=connection.topic)
        unread = self._types.left_out
        self.topics: Mapping[str, str] = readable_topics(
            (some.topic, some.msgcount, unread.get(some.msgtype, ""))
            for some in connections
        )

    def messages(
        self, topics: Collection[str], head: int | None = None
    ) -> Iterator[tuple[str, int, Any]]:
        """Messages in the order of reception: topic, time in ns, content; or only the first few of each publisher."""
        with decoding(self.source, _BAG), self._opened() as reader:
            chosen = [
                connection
                for connection in reader.connections
                if connection.topic in topics
            ]
            for group in (
                [chosen] if head is None else [[connection] for connection in chosen]
            ):
                for connection, time, message in islice(
                    reader.messages(connections=group), head
                ):
                    # int: a database holds what was put into it, whatever the type of its column
                    yield (
                        connection.topic,
                        int(time),
                        self._types.decode(connection.msgtype, message),
                    )

    @contextmanager
    def _opened(self) -> Iterator[Any]:
        with extra("ros"):
            bags = import_module(f"rosbags.rosbag{self._ros}")
        with bags.Reader(self._path) as reader:
            if self._ros == 1:
                size = self._path.stat().st_size
                reader.chunks = {
                    place: bounded(chunk, size)
                    for place, chunk in reader.chunks.items()
                }
            yield reader


def readable_topics(channels: Iterable[tuple[str, int, str]]) -> dict[str, str]:
    """Topics, and why they cannot be read: by topic, messages and reason of every channel, all of which must be."""
    counts: Counter[str] = Counter()
    reasons: dict[str, str] = {}
    for stated, count, reason in channels:
        topic = str(stated)  # the metadata of a bag may say anything
        counts[topic] += count
        reasons[topic] = reasons.get(topic) or reason
    return {
        topic: reason if counts[topic] else "its topic has no messages"
        for topic, reason in reasons.items()
    }


def _files(path: Path) -> list[Path]:
    """SQLite files of a bag; an error for what is none."""
    if not os.path.isdir(path):
        if existing_file(path).suffix != ".db3":
            raise InputError(
                "is not a .db3 file; the files of a ROS bag are .bag, .db3 or .mcap",
                source=os.fspath(path),
            )
        return [path]
    existing_file(path / _METADATA)
    return sorted(path.glob("*.db3"))


def _is_first(path: Path) -> bool:
    if not path.is_file():
        return False
    with path.open("rb") as stream:
        return stream.read(len(_FIRST)) == _FIRST


def _check_closed(file: Path, source: str) -> None:
    """A recorder that was killed leaves messages in a second file, which SQLite takes in when it opens the first."""
    pending = file.with_name(f"{file.name}-wal")
    if pending.is_file() and pending.stat().st_size:
        problem = f"was not closed: {pending.name} still holds messages; take them in with  sqlite3 {file.name} .tables"
        raise InputError(problem, source=source)


class Mcap:
    """Messages of an MCAP file, the source of a :class:`echelon.identification.logs.files.bag_file.BagFile`."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._path, self.source = existing_file(path), os.fspath(path)
        with decoding(self.source, _MCAP, _ADVICE), self._path.open("rb") as stream:
            stream.seek(-len(MCAP_MARK), os.SEEK_END)
            if stream.read() != MCAP_MARK:
                raise InputError(
                    f"was cut off: the end of the MCAP file is missing; {_ADVICE}",
                    source=self.source,
                )
            stream.seek(0)
            _reader(stream)  # the package that also brings the unpackers
            check_chunks(stream, self._path.stat().st_size)
            stream.seek(0)
            index = _index(stream)
            self._decoders, unread = _decoders(index, self.source)
        self.start, self._indexed = index.start, index.complete
        self.topics: Mapping[str, str] = readable_topics(
            (channel.topic, index.counts.get(number, 0), unread.get(number, ""))
            for number, channel in index.channels.items()
        )

    def messages(
        self, topics: Collection[str], head: int | None = None
    ) -> Iterator[tuple[str, int, Any]]:
        """Messages in the order of reception: topic, time in ns, content; or only the first few of each topic."""
        with decoding(self.source, _MCAP, _ADVICE), self._path.open("rb") as stream:
            for group in [topics] if head is None else [[topic] for topic in topics]:
                stream.seek(0)
                reader = _reader(stream, self._indexed)
                found = reader.iter_messages(topics=group, log_time_order=head is None)
                for _, channel, message in islice(found, head):
                    yield (
                        channel.topic,
                        message.log_time,
                        self._decoders[channel.id](message.data),
                    )


def is_mcap(path: str | os.PathLike[str]) -> bool:
    """Whether a file is MCAP, by its first bytes or, should these be damaged, by its name."""
    if os.path.isdir(path):
        return False
    with existing_file(path).open("rb") as stream:
        return stream.read(len(MCAP_MARK)) == MCAP_MARK or os.fspath(
            path
        ).lower().endswith(".mcap")


@dataclass(frozen=True)
class _McapIndex:
    """The content of a file; messages are counted by channel."""

    complete: bool  # whether the file's own index is
    start: int
    schemas: Mapping[int, Any]
    channels: Mapping[int, Any]
    counts: Mapping[int, int]


def _reader(stream: IO[bytes], indexed: bool = True) -> Any:
    """A reader that goes by the file's index, or through all of the file."""
    with extra("ros"):
        from mcap.reader import NonSeekingReader, SeekingReader
    size = os.fstat(stream.fileno()).st_size  # no record is longer
    return (SeekingReader if indexed else NonSeekingReader)(
        stream, validate_crcs=True, record_size_limit=size
    )


def _index(stream: IO[bytes]) -> _McapIndex:
    """From the summary at the end of the file; from all its messages where that is missing or not complete."""
    summary = _reader(stream).get_summary()
    found = None if summary is None else summary.statistics
    if found is not None and (found.channel_count, found.schema_count) == (
        len(summary.channels),
        len(summary.schemas),
    ):
        counts = found.channel_message_counts
        return _McapIndex(
            True, found.message_start_time, summary.schemas, summary.channels, counts
        )
    stream.seek(0)
    schemas, channels, counts, start = {}, {}, Counter[int](), 0
    for schema, channel, message in _reader(stream, indexed=False).iter_messages(
        log_time_order=False
    ):
        schemas[channel.schema_id], channels[channel.id] = schema, channel
        counts[channel.id] += 1
        start = min(start or message.log_time, message.log_time)
    return _McapIndex(False, start, schemas, channels, counts)


def _decoders(
    index: _McapIndex, source: str
) -> tuple[dict[int, _Decoder], dict[int, str]]:
    """How the messages of each channel are decoded; and for the other channels why not."""
    found: dict[int, _Decoder] = {}
    unread: dict[int, str] = {}
    names: dict[int, str] = {}
    definitions: dict[str, tuple[str, str]] = {}
    for number, channel in index.channels.items():
        schema = index.schemas.get(channel.schema_id)
        if channel.message_encoding == "json":
            found[number] = partial(parse_json, source=source)
        elif channel.message_encoding == "cdr" and schema is not None:
            names[number] = ros_name(schema.name)
            definitions[names[number]] = (
                _LANGUAGES.get(schema.encoding, ""),
                schema.data.decode(),
            )
        else:
            name = (
                f" (schema {one_line(schema.name)})"
                if schema is not None
                else ", without a schema"
            )
            encoding = one_line(channel.message_encoding)
            unread[number] = (
                f"its messages are encoded as '{encoding}'{name}; JSON and ROS 2's CDR are read"
            )
    if definitions:
        types = RosTypes(definitions)
        for number, name in names.items():
            found[number] = partial(types.decode, name)
            if name in types.left_out:
                unread[number] = types.left_out[name]
    return found, unread
