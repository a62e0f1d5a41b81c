"""Opening a log of any kind.

What a file is, its first bytes say more reliably than its name; text has no such mark, and goes by the name.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import numpy as np

from echelon.identification.logs.files.bag_file import BagFile
from echelon.identification.logs.files.csv_file import CsvFile
from echelon.identification.logs.files.log_file import (
    LogFile,
    Table,
    existing_file,
    with_stamps,
)
from echelon.identification.logs.files.mat_file import Hdf5File, MatFile
from echelon.identification.logs.files.numpy_file import MemoryLog, NpzFile, is_samples
from echelon.shared import InputError, extra

_METADATA = "metadata.yaml"
_EPISODE = re.compile(r"episode_(\d+)")

_FOREIGN = {b"PK\x03\x04[Content_Types]": "is a spreadsheet; save it as CSV"}


@dataclass(frozen=True)
class LogFormat:
    """A format of logs."""

    name: str  # as messages call it
    read: Callable[[str | os.PathLike[str]], LogFile]
    suffixes: tuple[str, ...]  # of names of files
    marks: tuple[bytes, ...] = ()  # with which files begin


def _parquet() -> ModuleType:
    """The module that needs pyarrow."""
    with extra("identify"):
        import echelon.identification.logs.files.parquet_file as parquet_file
    return parquet_file


_TEXT = LogFormat("CSV", CsvFile, (".csv", ".tsv", ".txt", ".dat"))
_BAG = LogFormat(
    "ROS bag or MCAP",
    BagFile,
    (".bag", ".db3", ".mcap"),
    (b"#ROSBAG", b"SQLite format 3\0", b"\x89MCAP0"),
)
FORMATS = (
    _TEXT,
    LogFormat(
        "Parquet",
        lambda path: _parquet().ParquetFile(path),
        (".parquet", ".pq"),
        (b"PAR1",),
    ),
    LogFormat("NumPy", NpzFile, (".npz", ".npy"), (b"\x93NUMPY",)),
    LogFormat(
        "HDF5", Hdf5File, (".h5", ".hdf5"), (b"MATLAB 7.3", b"\x89HDF\r\n\x1a\n")
    ),
    LogFormat("MAT", MatFile, (".mat",), (b"MATLAB ",)),
    _BAG,
)
"""All formats; where marks begin alike, the longer one comes first."""

_SUFFIXES = {suffix: kind for kind in FORMATS for suffix in kind.suffixes}
_ALSO_TEXT = ("", ".log", ".asc", ".prn", ".out")
_VALID = (
    f"valid are {', '.join(_SUFFIXES)} (text also with .gz), directories of bags and of "
    "LeRobot datasets"
)


def open_log(path: str | os.PathLike[str]) -> LogFile:
    """Open a log: CSV, Parquet, NPZ, NPY, MAT, HDF5, a ROS bag or MCAP, an episode of LeRobot, samples in memory."""
    if isinstance(path, MemoryLog):
        return path.file()
    found = Path(path)
    if is_episode(found):
        episode: LogFile = _parquet().Episode(found)
        return episode
    if os.path.isdir(found):
        if not is_bag(found):
            raise InputError(
                f"is a directory, not a log{_content(found)}", source=os.fspath(path)
            )
        return BagFile(path)
    return with_stamps(_format(existing_file(path)).read(path))


def log_paths(logs: object) -> list[Path]:
    """The logs that are meant by a path, samples in memory, or several of them.

    A directory stands for the logs of one kind in it, ``run2`` before ``run10``; a LeRobot dataset for its episodes.
    Files whose names no log has, such as read-me files, and hidden ones do not count.
    """
    if isinstance(logs, MemoryLog):
        return [logs]
    if isinstance(logs, str | os.PathLike):
        return _paths(logs)
    if is_samples(logs):
        return [MemoryLog.of(logs)]
    if (
        not isinstance(logs, Iterable)
        or isinstance(logs, np.ndarray)
        or hasattr(logs, "read")
    ):
        raise InputError(
            f"expected paths, data frames or dicts of arrays as logs, found {type(logs).__name__}"
        )
    return [path for log in logs for path in log_paths(log)]


def _paths(path: str | os.PathLike[str]) -> list[Path]:
    found = Path(path)
    if os.path.isdir(found) and not is_bag(found):
        return _parquet().episodes(found) if is_dataset(found) else _directory(found)
    return [
        found
        if is_bag(found) or is_episode(found) or is_joined(found)
        else existing_file(path)
    ]


def _directory(path: Path) -> list[Path]:
    kinds: dict[LogFormat, list[Path]] = {}
    for entry in _entries(path):
        by_name = None if entry.is_dir() else _format_by_name(entry)
        kind = _BAG if is_bag(entry) else by_name
        if kind is not None:
            kinds.setdefault(kind, []).append(entry)
    if not kinds:
        raise InputError(f"is a directory without logs; {_VALID}", source=str(path))
    if len(kinds) > 1:
        examples = ", ".join(
            f"{kind.name} ({entries[0].name})" for kind, entries in kinds.items()
        )
        problem = f"holds logs of several kinds: {examples}; give each kind a directory of its own"
        raise InputError(problem, source=str(path))
    (logs,) = kinds.values()
    return sorted(logs, key=_natural)


def read_table(
    path: str | os.PathLike[str], names: Sequence[str] | None = None
) -> Table:
    """A whole log in memory, or some of its columns."""
    log = open_log(path)
    pieces = list(log.tables(names))
    if len(pieces) < 2:
        return pieces[0] if pieces else Table(log.source, {})
    columns = {
        name: np.concatenate([piece.columns[name] for piece in pieces])
        for name in pieces[0].columns
    }
    return Table(log.source, columns, pieces[0].clocks)


def is_joined(path: Path) -> bool:
    """Whether a path names several files that are one log, ``positions.csv+torques.csv``."""
    return (
        "+" in str(path)
        and not path.exists()
        and all(Path(part).exists() for part in str(path).split("+"))
    )


def is_bag(path: Path) -> bool:
    """Whether a path is the directory of a ROS 2 bag."""
    return os.path.isfile(path / _METADATA)


def is_dataset(path: Path) -> bool:
    """Whether a directory is a dataset of LeRobot."""
    return os.path.isfile(path / "meta" / "info.json") and os.path.isdir(path / "data")


def is_episode(path: Path) -> bool:
    """Whether a path stands for an episode of a dataset."""
    return _EPISODE.fullmatch(path.name) is not None and is_dataset(path.parent)


def _format(path: Path) -> LogFormat:
    with path.open("rb") as stream:
        start = stream.read(64)
    for mark, reason in _FOREIGN.items():
        if start.startswith(mark[:4]) and mark[4:] in start:
            raise InputError(reason, source=os.fspath(path))
    for kind in FORMATS:
        if start.startswith(kind.marks):
            return kind
    by_name = _format_by_name(path)
    if by_name is not None:
        return by_name
    if path.suffix.lower() in _ALSO_TEXT:  # in a directory they are notes, not logs
        return _TEXT
    raise InputError(f"its kind is not known; {_VALID}", source=os.fspath(path))


def _format_by_name(path: Path) -> LogFormat | None:
    name = path.name.lower()
    kind = _SUFFIXES.get(Path(name.removesuffix(".gz")).suffix)
    return kind if kind is _TEXT or not name.endswith(".gz") else None


def _entries(directory: Path) -> list[Path]:
    try:
        return [
            entry for entry in directory.iterdir() if not entry.name.startswith(".")
        ]
    except OSError as error:
        raise InputError(
            f"cannot be read: {error.strerror or error}", source=os.fspath(directory)
        ) from None


def _content(directory: Path) -> str:
    """A hint at the logs in a directory that is none."""
    logs = sorted(
        (entry for entry in _entries(directory) if _format_by_name(entry)), key=_natural
    )
    if not logs:
        return f", and it holds none; {_VALID}"
    if _format_by_name(logs[0]) is _BAG:
        return f": {_METADATA} is missing; name {logs[0].name} in it, or repair the bag with  ros2 bag reindex"
    return f"; name a file in it, such as {logs[0].name}"


def _natural(path: Path) -> list[tuple[int, int, str]]:
    """Order of names in which numbers count as numbers."""
    parts = re.findall(r"\d+|\D+", path.name)
    return [
        (0, int(part), part) if part.isdecimal() else (1, 0, part) for part in parts
    ]
