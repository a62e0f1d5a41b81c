"""Folders of LeRobot datasets, of which every episode is a log.

``meta/info.json`` says what the entries of the vectors are called, and Parquet files under ``data`` hold the frames:
one file per episode up to version 2.1, several episodes in a file from version 3.0 on.  An episode goes by a path
inside the folder, ``dataset/episode_000012``.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from echelon.errors import InputError
from echelon.extras import extra
from echelon.inputs import parse_json, read_content
from echelon.logs.files.log_file import CHUNK, Table, decoding, selected

_EPISODE = re.compile(r"episode_(\d+)")
_INDEX = "episode_index"


def is_dataset(path: Path) -> bool:
    """Whether a directory is a dataset."""
    return os.path.isfile(path / "meta" / "info.json") and os.path.isdir(path / "data")


def is_episode(path: Path) -> bool:
    """Whether a path stands for an episode of a dataset."""
    return _EPISODE.fullmatch(path.name) is not None and is_dataset(path.parent)


def _data_files(dataset: Path) -> list[Path]:
    """The Parquet files with the frames."""
    found = sorted((dataset / "data").rglob("*.parquet"))
    if not found:
        raise InputError("is a LeRobot dataset without data: there is no data/*/*.parquet", source=str(dataset))
    return found


def episodes(dataset: Path) -> list[Path]:
    """The paths of all episodes."""
    with extra("identify"):
        import pyarrow.parquet as pq
    with decoding(str(dataset), "a LeRobot dataset"):
        tables = (pq.read_table(file, columns=[_INDEX]) for file in _data_files(dataset))
        numbers = sorted({int(number) for table in tables for number in table.column(0).unique().to_pylist()})
    return [dataset / f"episode_{number:06d}" for number in numbers]


def _entry_names(dataset: Path) -> dict[str, str]:
    """Names of columns such as ``observation.state[0]`` by what the dataset calls the entries of its vectors."""
    source = dataset / "meta" / "info.json"
    about: Any = parse_json(read_content(source), str(source))
    features = about.get("features") if isinstance(about, dict) else None
    found: dict[str, str] = {}
    for name, feature in (features if isinstance(features, dict) else {}).items():
        names = feature.get("names") if isinstance(feature, dict) else None
        if isinstance(names, dict):
            names = next((inner for inner in names.values() if isinstance(inner, list)), None)
        if isinstance(names, list) and len(set(map(str, names))) == len(names):
            found |= {f"{name}[{k}]": f"{name}/{entry}" for k, entry in enumerate(names)}
    return found


class Episode:
    """An episode of a LeRobot dataset: entries of vectors go by their names, ``observation.state/elbow_flex.pos``."""

    def __init__(self, path: Path) -> None:
        with extra("identify"):
            from echelon.logs.files.parquet_file import ParquetFile, may_hold

        self.source, self._number = str(path), int(path.name.removeprefix("episode_"))
        called = _entry_names(path.parent)
        files = _data_files(path.parent)
        named = [file for file in files if file.stem == path.name]  # up to version 2.1
        self._files = [ParquetFile(file) for file in named or files if named or may_hold(file, _INDEX, self._number)]
        if not self._files:
            raise InputError("the dataset has no frames of this episode", source=self.source)
        own = self._files[0].names
        self._columns = {called.get(name, name): name for name in own if name != _INDEX}
        self.names: tuple[str, ...] = tuple(self._columns)

    def tables(self, names: Sequence[str] | None = None, rows: int = CHUNK) -> Iterator[Table]:
        """Pieces of the episode."""
        chosen = selected(self.source, names, self.names)
        first = 0
        for file in self._files:
            for table in file.tables([*(self._columns[name] for name in chosen), _INDEX], rows):
                inside = table.columns[_INDEX] == self._number
                columns = {name: table.columns[self._columns[name]][inside] for name in chosen}
                if inside.any():
                    yield Table(self.source, columns, first=first)
                    first += int(inside.sum())
