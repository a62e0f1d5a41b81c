"""Parquet files, read by batches of rows: memory is bounded by the batch, not by the file.

Nested columns are taken apart.  A leaf is a number inside a column and the way to it: fields of structs by name,
entries of lists by index.  Lengths of lists are data, not type, so they are those of the first rows, and every later
row is checked against them.  Points in time count from the whole second of the first one in the file: since 1970, a
float64 would keep no more than a quarter of a microsecond.

In the folder of a LeRobot dataset every episode is a log.  ``meta/info.json`` says what the entries of the vectors are
called, and Parquet files under ``data`` hold the frames: one file per episode up to version 2.1, several episodes in a
file from version 3.0 on.  An episode goes by a path inside the folder, ``dataset/episode_000012``.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from echelon.identification.logs.files.log_file import (
    CHUNK,
    HEAD,
    Table,
    decoding,
    existing_file,
    selected,
)
from echelon.shared import (
    COLUMNS,
    ENTRIES,
    LINE,
    Floats,
    InputError,
    check_unpacked,
    parse_json,
    read_content,
)

_KIND = "a Parquet file"


@dataclass(frozen=True)
class Leaf:
    """A number per row."""

    column: str  # column of the file that holds it
    steps: tuple[
        str | tuple[int, int], ...
    ] = ()  # fields of structs; entries of lists of so many

    @property
    def name(self) -> str:
        """Such as ``column``, ``column.field`` or ``column[0]``."""
        return self.column + "".join(
            f".{step}" if isinstance(step, str) else f"[{step[0]}]"
            for step in self.steps
        )

    def values(self, column: Any, origin: int) -> Floats:
        """The numbers of a piece of the column (N,), NaN where there are none; times count from ``origin``, s."""
        for step in self.steps:
            if isinstance(step, str):
                column = pc.struct_field(column, step)
            else:
                _check_lengths(column, step[1])
                column = pc.list_element(column, step[0])
        return numbers(column, origin)


def numbers(array: Any, origin: int) -> Floats:
    """A piece of a column without nesting as numbers (N,), times in seconds; dates count from ``origin``, s."""
    if pa.types.is_dictionary(array.type):
        array = array.dictionary_decode()
    if pa.types.is_time(array.type):
        array = array.cast(pa.time64("ns")).cast(pa.int64()).cast(pa.duration("ns"))
    values = array.to_numpy(zero_copy_only=False)
    if values.dtype.kind == "M":
        values = values - np.datetime64(origin, "s")
    return np.asarray(
        values / np.timedelta64(1, "s") if values.dtype.kind == "m" else values,
        dtype=np.float64,
    )


def leaves(leaf: Leaf, sample: Any) -> Iterator[tuple[Leaf, str]]:
    """Numbers inside a column, or a part of it, by its first rows, each with the reason why it cannot be read."""
    kind = sample.type
    if pa.types.is_struct(kind):
        for field in kind:
            yield from leaves(
                replace(leaf, steps=(*leaf.steps, field.name)),
                pc.struct_field(sample, field.name),
            )
    elif (
        pa.types.is_list(kind)
        or pa.types.is_large_list(kind)
        or pa.types.is_fixed_size_list(kind)
    ):
        length, reason = _length(sample)
        if reason:
            yield leaf, reason
        complete = (
            sample.filter(pc.equal(pc.list_value_length(sample), length))
            if length
            else sample
        )
        for index in range(length):
            yield from leaves(
                replace(leaf, steps=(*leaf.steps, (index, length))),
                pc.list_element(complete, index),
            )
    else:
        yield leaf, "" if _is_number(kind) else f"holds {kind}, not numbers"


def _is_text(kind: Any) -> bool:
    valued = kind.value_type if pa.types.is_dictionary(kind) else kind
    return bool(pa.types.is_string(valued) or pa.types.is_large_string(valued))


def _is_number(kind: Any) -> bool:
    """Whether values of a type are numbers, times, or missing."""
    valued = kind.value_type if pa.types.is_dictionary(kind) else kind
    return bool(
        pa.types.is_primitive(valued)
        or pa.types.is_decimal(valued)
        or pa.types.is_null(valued)
    )


def _length(sample: Any) -> tuple[int, str]:
    """Entries of each list, or why the lists cannot be columns."""
    lengths = pc.unique(pc.drop_null(pc.list_value_length(sample))).to_pylist()
    if not lengths:
        return (
            0,
            "its first lists are missing, so the number of their entries is unknown",
        )
    if len(lengths) > 1:
        return (
            0,
            f"holds lists of different lengths ({min(lengths)} and {max(lengths)})",
        )
    if lengths[0] > ENTRIES.most:
        return (
            0,
            f"holds lists of {lengths[0]} entries; at most {ENTRIES.most} become columns",
        )
    return lengths[0], "" if lengths[0] else "holds empty lists"


def _check_lengths(lists: Any, length: int) -> None:
    lengths = pc.fill_null(pc.list_value_length(lists), length).to_numpy(
        zero_copy_only=False
    )
    wrong = np.flatnonzero(lengths != length)
    if wrong.size:
        row = int(wrong[0])
        raise InputError(
            f"a list of {lengths[row]} entries where others have {length}",
            element=f"row {row}",
        )


class ParquetFile:
    """A Parquet file.

    Integers, booleans, decimals and floats are columns of their name; a field of a struct is ``name.field``, an entry
    of a list whose length is constant ``name[0]``.  Times and spans of time are in seconds; points in time count from
    ``origin``.  Missing values are NaN.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.source = os.fspath(path)
        existing_file(path)
        with decoding(self.source, _KIND), self._opened() as file:
            if not file.metadata.num_rows:
                raise InputError("holds no rows", source=self.source)
            COLUMNS.check(file.metadata.num_columns, self.source)
            self._rows: int = file.metadata.num_rows
            head = next(file.iter_batches(batch_size=HEAD))
            self._leaves, self._left_out = self._columns(head)
            self.origin = _origin(head)
        self.names: tuple[str, ...] = tuple(self._leaves)
        self.worded = tuple(field.name for field in head.schema if _is_text(field.type))
        if not self.names:
            raise InputError("none of its columns holds numbers", source=self.source)

    def tables(
        self, names: Sequence[str] | None = None, rows: int = CHUNK
    ) -> Iterator[Table]:
        """Pieces of the file."""
        chosen = selected(self.source, names, self.names, self._left_out)
        picked = {name: self._leaves[name] for name in chosen}
        check_unpacked(
            8 * self._rows * len(picked), os.path.getsize(self.source), self.source
        )
        needed = list(dict.fromkeys(leaf.column for leaf in picked.values()))
        with decoding(self.source, _KIND):
            file = self._opened()
        with file:
            first = 0
            batches = file.iter_batches(batch_size=rows, columns=needed)
            while (batch := self._next(batches)) is not None:
                columns = {
                    name: self._values(leaf, batch, first)
                    for name, leaf in picked.items()
                }
                yield Table(self.source, columns, first=first)
                first += batch.num_rows

    def words(self, name: str, rows: int = CHUNK) -> Iterator[list[str]]:
        """A column of words, in the pieces of :meth:`tables`."""
        with decoding(self.source, _KIND), self._opened() as file:
            for batch in file.iter_batches(batch_size=rows, columns=[name]):
                yield [
                    "" if word is None else str(word)
                    for word in batch.column(0).to_pylist()
                ]

    def _opened(self) -> Any:
        # without a buffer, the whole of a column's row group would be read at once
        return pq.ParquetFile(
            self.source,
            page_checksum_verification=True,
            pre_buffer=False,
            buffer_size=LINE.most,
        )

    def _next(self, batches: Iterator[Any]) -> Any:
        with decoding(self.source, _KIND):
            return next(batches, None)

    def _values(self, leaf: Leaf, batch: Any, first: int) -> Floats:
        try:
            with decoding(self.source, _KIND):
                return leaf.values(batch.column(leaf.column), self.origin)
        except InputError as error:
            if not (error.element or "").startswith("row "):
                raise
            row = first + int(str(error.element).removeprefix("row "))
            raise InputError(
                error.problem,
                source=self.source,
                element=f"column '{leaf.name}', row {row}",
            ) from None

    def _columns(self, head: Any) -> tuple[dict[str, Leaf], dict[str, str]]:
        """Columns by name, and what is none with the reason."""
        found: dict[str, Leaf] = {}
        left_out: dict[str, str] = {}
        counts = Counter(head.schema.names)
        for position, column in enumerate(head.schema.names):
            if counts[column] > 1:
                left_out[column] = "more than one column has this name"
                continue
            for leaf, reason in leaves(Leaf(column), head.column(position)):
                if reason:
                    left_out[leaf.name] = reason
                elif leaf.name in found:
                    problem = "a field inside another column has the same name"
                    raise InputError(
                        problem, source=self.source, element=f"column '{leaf.name}'"
                    )
                else:
                    found[leaf.name] = leaf
        return found, left_out


def _origin(head: Any) -> int:
    """Second of the first point in time of the file."""
    dated = [
        column.drop_null()
        for column in head.columns
        if pa.types.is_timestamp(column.type)
    ]
    dated += [
        column.drop_null() for column in head.columns if pa.types.is_date(column.type)
    ]
    found = [
        column.to_numpy(zero_copy_only=False)[0] for column in dated if len(column)
    ]
    return int(found[0].astype("datetime64[s]").astype(np.int64)) if found else 0


# -- datasets of LeRobot ----------------------------------------------------------------------------------------------


_INDEX = "episode_index"


def _data_files(dataset: Path) -> list[Path]:
    """The Parquet files with the frames."""
    found = sorted((dataset / "data").rglob("*.parquet"))
    if not found:
        raise InputError(
            "is a LeRobot dataset without data: there is no data/*/*.parquet",
            source=str(dataset),
        )
    return found


def episodes(dataset: Path) -> list[Path]:
    """The paths of all episodes."""
    with decoding(str(dataset), "a LeRobot dataset"):
        tables = (
            pq.read_table(file, columns=[_INDEX]) for file in _data_files(dataset)
        )
        numbers = sorted(
            {
                int(number)
                for table in tables
                for number in table.column(0).unique().to_pylist()
            }
        )
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
            names = next(
                (inner for inner in names.values() if isinstance(inner, list)), None
            )
        if isinstance(names, list) and len(set(map(str, names))) == len(names):
            found |= {
                f"{name}[{k}]": f"{name}/{entry}" for k, entry in enumerate(names)
            }
    return found


class Episode:
    """An episode of a LeRobot dataset: entries of vectors go by their names, ``observation.state/elbow_flex.pos``."""

    def __init__(self, path: Path) -> None:
        self.source, self._number = str(path), int(path.name.removeprefix("episode_"))
        called = _entry_names(path.parent)
        files = _data_files(path.parent)
        named = [file for file in files if file.stem == path.name]  # up to version 2.1
        self._files = [
            ParquetFile(file)
            for file in named or files
            if named or _may_hold(file, self._number)
        ]
        if not self._files:
            raise InputError(
                "the dataset has no frames of this episode", source=self.source
            )
        own = self._files[0].names
        self._columns = {called.get(name, name): name for name in own if name != _INDEX}
        self.names: tuple[str, ...] = tuple(self._columns)

    def tables(
        self, names: Sequence[str] | None = None, rows: int = CHUNK
    ) -> Iterator[Table]:
        """Pieces of the episode."""
        chosen = selected(self.source, names, self.names)
        first = 0
        for file in self._files:
            for table in file.tables(
                [*(self._columns[name] for name in chosen), _INDEX], rows
            ):
                inside = table.columns[_INDEX] == self._number
                columns = {
                    name: table.columns[self._columns[name]][inside] for name in chosen
                }
                if inside.any():
                    yield Table(self.source, columns, first=first)
                    first += int(inside.sum())


def _may_hold(file: Path, episode: int) -> bool:
    """Whether a file may hold frames of an episode, by the bounds that its groups of rows state."""
    about = pq.read_metadata(file)
    place = about.schema.names.index(_INDEX)
    groups = (
        about.row_group(k).column(place).statistics for k in range(about.num_row_groups)
    )
    return any(
        some is None or not some.has_min_max or some.min <= episode <= some.max
        for some in groups
    )
