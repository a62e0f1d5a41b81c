"""MCAP files: each channel says how its messages are encoded, and JSON and ROS 2's CDR are read."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import islice
from typing import IO, Any

from echelon.errors import InputError, one_line
from echelon.extras import extra
from echelon.inputs.json_text import parse_json
from echelon.logs.files.log_file import decoding, existing_file
from echelon.logs.files.ros_bag import RosTypes, readable_topics, ros_name
from echelon.logs.files.unpacked_size import check_chunks

_KIND = "an MCAP file"
_ADVICE = "the tool 'mcap recover' saves the messages that are complete"
_LANGUAGES = {"ros2msg": "msg", "ros2idl": "idl", "omgidl": "idl"}
_MARK = b"\x89MCAP0\r\n"
_CDR, _JSON = "cdr", "json"

_Decoder = Callable[[bytes], Any]


class Mcap:
    """Messages of an MCAP file, the source of a :class:`echelon.logs.files.bag_file.BagFile`."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._path, self.source = existing_file(path), os.fspath(path)
        with decoding(self.source, _KIND, _ADVICE), self._path.open("rb") as stream:
            stream.seek(-len(_MARK), os.SEEK_END)
            if stream.read() != _MARK:
                raise InputError(f"was cut off: the end of the MCAP file is missing; {_ADVICE}", source=self.source)
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

    def messages(self, topics: Collection[str], head: int | None = None) -> Iterator[tuple[str, int, Any]]:
        """Messages in the order of reception: topic, time in ns, content; or only the first few of each topic."""
        with decoding(self.source, _KIND, _ADVICE), self._path.open("rb") as stream:
            for group in [topics] if head is None else [[topic] for topic in topics]:
                stream.seek(0)
                reader = _reader(stream, self._indexed)
                found = reader.iter_messages(topics=group, log_time_order=head is None)
                for _, channel, message in islice(found, head):
                    yield channel.topic, message.log_time, self._decoders[channel.id](message.data)


def is_mcap(path: str | os.PathLike[str]) -> bool:
    """Whether a file is MCAP, by its first bytes or, should these be damaged, by its name."""
    if os.path.isdir(path):
        return False
    with existing_file(path).open("rb") as stream:
        return stream.read(len(_MARK)) == _MARK or os.fspath(path).lower().endswith(".mcap")


@dataclass(frozen=True)
class _Index:
    """What a file holds; messages are counted by channel.  The file's own index of it need not be complete."""

    complete: bool
    start: int
    schemas: Mapping[int, Any]
    channels: Mapping[int, Any]
    counts: Mapping[int, int]


def _reader(stream: IO[bytes], indexed: bool = True) -> Any:
    """A reader that goes by the file's index, or through all of the file."""
    with extra("ros"):
        from mcap.reader import NonSeekingReader, SeekingReader
    size = os.fstat(stream.fileno()).st_size  # no record is longer
    return (SeekingReader if indexed else NonSeekingReader)(stream, validate_crcs=True, record_size_limit=size)


def _index(stream: IO[bytes]) -> _Index:
    """From the summary at the end of the file; from all its records where that is missing or not complete."""
    summary = _reader(stream).get_summary()
    if summary is None or (found := summary.statistics) is None:
        return _scanned(stream)
    if found.channel_count != len(summary.channels) or found.schema_count != len(summary.schemas):
        return _scanned(stream)
    return _Index(True, found.message_start_time, summary.schemas, summary.channels, found.channel_message_counts)


def _scanned(stream: IO[bytes]) -> _Index:
    with extra("ros"):
        from mcap.records import Channel, Message, Schema
        from mcap.stream_reader import StreamReader

    stream.seek(0)
    start: int | None = None
    schemas: dict[int, Any] = {}
    channels: dict[int, Any] = {}
    counts: Counter[int] = Counter()
    for record in StreamReader(stream, validate_crcs=True).records:
        if isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel):
            channels[record.id] = record
        elif isinstance(record, Message):
            counts[record.channel_id] += 1
            start = record.log_time if start is None else min(start, record.log_time)
    return _Index(False, start or 0, schemas, channels, counts)


def _decoders(index: _Index, source: str) -> tuple[dict[int, _Decoder], dict[int, str]]:
    """How the messages of each channel are decoded; and for the other channels why not."""
    found: dict[int, _Decoder] = {}
    unread: dict[int, str] = {}
    names: dict[int, str] = {}
    definitions: dict[str, tuple[str, str]] = {}
    for number, channel in index.channels.items():
        schema = index.schemas.get(channel.schema_id)
        if channel.message_encoding == _JSON:
            found[number] = partial(parse_json, source=source)
        elif channel.message_encoding == _CDR and schema is not None:
            names[number] = ros_name(schema.name)
            definitions[names[number]] = (_LANGUAGES.get(schema.encoding, ""), schema.data.decode())
        else:
            unread[number] = _unread(channel.message_encoding, schema)
    if definitions:
        types = RosTypes(definitions)
        for number, name in names.items():
            found[number] = partial(types.decode, name)
            if name in types.left_out:
                unread[number] = types.left_out[name]
    return found, unread


def _unread(encoding: str, schema: Any) -> str:
    name = f" (schema {one_line(schema.name)})" if schema is not None else ", without a schema"
    return f"its messages are encoded as '{one_line(encoding)}'{name}; JSON and ROS 2's CDR are read"
