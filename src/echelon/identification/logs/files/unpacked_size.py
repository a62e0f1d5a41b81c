"""Sizes that recordings claim, checked before the packages that decode them believe it.

The packages unpack whatever a file says, and read settings written in YAML with aliases and all.  A damaged or
malicious file of a few kilobytes could so fill the memory, or never come to an end.
"""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import IO, Any

from echelon.shared import (
    LINE,
    InputError,
    check_unpacked,
    most_unpacked,
    parse_yaml,
    read_content,
)

MCAP_MARK = b"\x89MCAP0\r\n"
"""Beginning and end of MCAP files."""

_CHUNK = b"\x06"
_FRAME_HEADER = 32
"""Bytes that hold the header of a compressed frame, and the name of a compression."""

_READ = ("messages", "topics", "schema", "message_definitions")
_QOS = "offered_qos_profiles"


def check_chunks(stream: IO[bytes], size: int) -> None:
    """Refuse an MCAP file whose chunks unpack to far more than its size in bytes."""
    unpacked = 0
    stream.seek(len(MCAP_MARK))
    while len(head := stream.read(9)) == 9:
        kind, (length,) = head[:1], struct.unpack("<xQ", head)
        start = stream.tell()
        if kind == _CHUNK and start + length <= size:
            unpacked += _chunk_size(stream, start + length, size)
            check_unpacked(unpacked, size)
        stream.seek(start + min(length, size))


def _chunk_size(stream: IO[bytes], end: int, size: int) -> int:
    """Bytes that a chunk will take: what it states, or what its compressed data state."""
    stated: int
    stated, _, letters = struct.unpack("<16xQII", stream.read(32))
    compression = stream.read(min(letters, _FRAME_HEADER))
    stream.seek(8, 1)
    if compression == b"zstd":
        return max(stated, _zstd_size(stream.read(_FRAME_HEADER)) or 0)
    if compression == b"lz4":
        return max(stated, _lz4_size(stream, end, size))
    return stated


def _zstd_size(head: bytes) -> int | None:
    """Content of a frame by its header, None where it does not say."""
    import zstandard

    stated: int = zstandard.get_frame_parameters(head).content_size
    return None if stated == zstandard.CONTENTSIZE_UNKNOWN else stated


def _lz4_size(stream: IO[bytes], end: int, size: int) -> int:
    """Content of a frame by its header, or counted where it does not say."""
    import lz4.frame

    data = stream.read(end - stream.tell())
    stated: int = lz4.frame.get_frame_info(data[:_FRAME_HEADER])["content_size"]
    return stated or len(
        lz4.frame.LZ4FrameDecompressor().decompress(
            data, max_length=most_unpacked(size) + 1
        )
    )


def bounded(chunk: Any, size: int) -> Any:
    """A chunk of a ROS 1 bag, as rosbags describes it, that unpacks to no more than its bag may hold."""
    package = chunk.decompressor.__module__.split(".")[0]
    if package not in ("bz2", "lz4"):
        return chunk

    def unpack(data: bytes) -> bytes:
        if package == "lz4":
            from lz4.frame import LZ4FrameDecompressor as Decompressor
        else:
            from bz2 import BZ2Decompressor as Decompressor
        unpacked: bytes = Decompressor().decompress(data, most_unpacked(size) + 1)
        check_unpacked(len(unpacked), size)
        return unpacked

    return chunk._replace(decompressor=unpack)


def check_bag(path: Path, databases: list[Path]) -> None:
    """Refuse a ROS 2 bag whose settings or packed messages multiply, or whose databases compute their rows."""
    metadata = path / "metadata.yaml"
    packing = _check_metadata(metadata) if metadata.is_file() else ""
    for database in databases:
        with closing(
            sqlite3.connect(f"{database.absolute().as_uri()}?immutable=1", uri=True)
        ) as connection:
            _check_database(connection, packing == "message", database.stat().st_size)
    for file in path.glob("*.mcap"):
        with file.open("rb") as stream:
            check_chunks(stream, file.stat().st_size)
    for file in path.glob("*.zstd") if packing == "file" else ():
        size = file.stat().st_size
        with file.open("rb") as stream:
            check_unpacked(_unpacked_size(stream, most_unpacked(size)), size, str(file))


def _check_metadata(path: Path) -> str:
    """How the messages are packed, after the texts inside have been looked at."""
    documents = parse_yaml(read_content(path), str(path))
    found = documents[0].data if documents else None
    about = (
        found.get("rosbag2_bagfile_information") if isinstance(found, dict) else None
    )
    if not isinstance(about, dict):
        return ""  # rosbags says what is missing
    topics = about.get("topics_with_message_count")
    for topic in topics if isinstance(topics, list) else ():
        inside = topic.get("topic_metadata") if isinstance(topic, dict) else None
        if isinstance(inside, dict) and isinstance(inside.get(_QOS), str):
            parse_yaml(inside[_QOS], str(path))
    return str(about.get("compression_mode") or "").lower()


def _check_database(connection: sqlite3.Connection, packed: bool, size: int) -> None:
    kinds = dict(
        connection.execute(
            "SELECT name, type || coalesce(sql, '') FROM sqlite_master"
        ).fetchall()
    )
    for table in _READ:
        columns = connection.execute(f"PRAGMA table_xinfo({table})").fetchall()
        plain = kinds.get(table, "").lower().startswith("tablecreate table")
        if (table in kinds and not plain) or any(column[-1] for column in columns):
            raise InputError(
                "is not a table of a bag: its rows are computed",
                element=f"table '{table}'",
            )
    if any(
        name == _QOS for _, name, *_ in connection.execute("PRAGMA table_xinfo(topics)")
    ):
        for (text,) in connection.execute(f"SELECT {_QOS} FROM topics"):
            parse_yaml(str(text), _QOS)
    if packed:
        check_unpacked(sum(_message_sizes(connection, size)), size)


def _message_sizes(connection: sqlite3.Connection, size: int) -> Iterator[int]:
    for row, head in connection.execute(
        f"SELECT rowid, substr(data, 1, {_FRAME_HEADER}) FROM messages"
    ):
        stated = _zstd_size(bytes(head))
        if stated is None:
            (data,) = connection.execute(
                "SELECT data FROM messages WHERE rowid = ?", (row,)
            ).fetchone()
            stated = _unpacked_size(data, most_unpacked(size))
        yield stated


def _unpacked_size(packed: bytes | IO[bytes], most: int) -> int:
    """Bytes in a compressed stream; no more are unpacked than it may have."""
    import zstandard

    counted = 0
    for piece in zstandard.ZstdDecompressor().read_to_iter(
        packed, read_size=LINE.most, write_size=LINE.most
    ):
        counted += len(piece)
        if counted > most:
            break
    return counted
