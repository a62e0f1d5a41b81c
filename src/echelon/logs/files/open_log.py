"""Opening a log of any kind.

What a file is, its first bytes say more reliably than its name; text has no such mark, and goes by the name.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Sequence
from enum import StrEnum
from pathlib import Path
from types import ModuleType

import numpy as np

from echelon.errors import InputError
from echelon.extras import extra
from echelon.logs.files.bag_file import BagFile
from echelon.logs.files.csv_file import CsvFile
from echelon.logs.files.log_file import LogFile, Table, existing_file, with_stamps
from echelon.logs.files.mat_file import Hdf5File, MatFile
from echelon.logs.files.numpy_file import MemoryLog, NpzFile, is_samples

_METADATA = "metadata.yaml"
_EPISODE = re.compile(r"episode_(\d+)")

_FOREIGN = {b"PK\x03\x04[Content_Types]": "is a spreadsheet; save it as CSV"}
_VALID = (
    "valid are .csv, .tsv, .txt, .dat (also with .gz), .parquet, .npz, .npy, .mat, .h5, .hdf5, .bag, .db3, .mcap, "
    "directories of bags and of LeRobot datasets"
)


class Kind(StrEnum):
    """Kinds of logs."""

    TEXT = "CSV"
    PARQUET = "Parquet"
    NUMPY = "NumPy"
    MATLAB = "MAT"
    HDF5 = "HDF5"
    BAG = "ROS bag or MCAP"


def _parquet() -> ModuleType:
    """The module that needs pyarrow."""
    with extra("identify"):
        import echelon.logs.files.parquet_file as parquet_file
    return parquet_file


_READERS: dict[Kind, Callable[[str | os.PathLike[str]], LogFile]] = {
    Kind.TEXT: CsvFile,
    Kind.PARQUET: lambda path: _parquet().ParquetFile(path),
    Kind.NUMPY: NpzFile,
    Kind.MATLAB: MatFile,
    Kind.HDF5: Hdf5File,
    Kind.BAG: BagFile,
}
_NAMES = {
    Kind.TEXT: ".csv .tsv .txt .dat",
    Kind.PARQUET: ".parquet .pq",
    Kind.NUMPY: ".npz .npy",
    Kind.MATLAB: ".mat",
    Kind.HDF5: ".h5 .hdf5",
    Kind.BAG: ".bag .db3 .mcap",
}
_SUFFIXES = {
    suffix: kind for kind, suffixes in _NAMES.items() for suffix in suffixes.split()
}
_ALSO_TEXT = ("", ".log", ".asc", ".prn", ".out")
_MARKS = {
    b"PAR1": Kind.PARQUET,
    b"\x93NUMPY": Kind.NUMPY,
    b"MATLAB 7.3": Kind.HDF5,
    b"MATLAB ": Kind.MATLAB,
    b"\x89HDF\r\n\x1a\n": Kind.HDF5,
    b"#ROSBAG": Kind.BAG,
    b"SQLite format 3\0": Kind.BAG,
    b"\x89MCAP0": Kind.BAG,
}


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
    return with_stamps(_READERS[_kind(existing_file(path))](path))


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
    kinds: dict[Kind, list[Path]] = {}
    for entry in _entries(path):
        kind = (
            Kind.BAG
            if is_bag(entry)
            else None
            if entry.is_dir()
            else _kind_by_name(entry)
        )
        if kind is not None:
            kinds.setdefault(kind, []).append(entry)
    if not kinds:
        raise InputError(f"is a directory without logs; {_VALID}", source=str(path))
    if len(kinds) > 1:
        examples = ", ".join(
            f"{kind} ({entries[0].name})" for kind, entries in kinds.items()
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


def _kind(path: Path) -> Kind:
    with path.open("rb") as stream:
        start = stream.read(64)
    for mark, reason in _FOREIGN.items():
        if start.startswith(mark[:4]) and mark[4:] in start:
            raise InputError(reason, source=os.fspath(path))
    for mark, kind in _MARKS.items():
        if start.startswith(mark):
            return kind
    by_name = _kind_by_name(path)
    if (
        by_name is None and path.suffix.lower() in _ALSO_TEXT
    ):  # in a directory they are notes rather than logs
        return Kind.TEXT
    if by_name is None:
        raise InputError(f"its kind is not known; {_VALID}", source=os.fspath(path))
    return by_name


def _kind_by_name(path: Path) -> Kind | None:
    name = path.name.lower()
    if name.endswith(".gz"):
        kind = _SUFFIXES.get(Path(name.removesuffix(".gz")).suffix)
        return kind if kind is Kind.TEXT else None
    return _SUFFIXES.get(Path(name).suffix)


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
    """What a directory that is no log holds instead."""
    logs = sorted(
        (entry for entry in _entries(directory) if _kind_by_name(entry)), key=_natural
    )
    if not logs:
        return f", and it holds none; {_VALID}"
    if _kind_by_name(logs[0]) is Kind.BAG:
        return f": {_METADATA} is missing; name {logs[0].name} in it, or repair the bag with  ros2 bag reindex"
    return f"; name a file in it, such as {logs[0].name}"


def _natural(path: Path) -> list[tuple[int, int, str]]:
    """Order of names in which numbers count as numbers."""
    parts = re.findall(r"\d+|\D+", path.name)
    return [
        (0, int(part), part) if part.isdecimal() else (1, 0, part) for part in parts
    ]
