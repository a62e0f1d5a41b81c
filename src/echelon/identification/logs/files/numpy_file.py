"""Named arrays as the columns of a log: NumPy's archives (NPZ) and single arrays (NPY), and samples in memory.

Nothing in such a file says which axis is time, or which arrays belong to the log at all.  The log has as many rows as
most of its arrays are long: a log has more rows than columns.  They lie along the first axis, or along the second where
only that is as long.  Arrays of another length are constants or settings.

Names and shapes come from the headers of an archive's members, so that only the arrays that are asked for are read.
Pickled objects are never loaded: they can run code.

Samples in memory are a dict of arrays, or a data frame of pandas or polars.  Logs are handed on as paths, to other
processes as well, and so are these: as paths that name no file but carry the samples.  A path's name tells what they
are by their content, so that equal samples make equal results.
"""

from __future__ import annotations

import hashlib
import os
import re
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice, product
from math import prod
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from echelon.identification.logs.files.log_file import (
    CHUNK,
    Table,
    decoding,
    existing_file,
    selected,
)
from echelon.shared import ARRAY_COLUMNS, COLUMNS, Floats, InputError, check_unpacked

if TYPE_CHECKING:
    _Path = Path
else:
    _Path = type(
        Path()
    )  # before Python 3.12 only the system's own kind of path can be extended


_ENDING = ".npy"
_KIND = "a NumPy file"
_TIME = re.compile(r"t|ts|tout|clock|.*(time|stamp)s?")
_PERIODS = dict.fromkeys(("dt", "ts", "period", "step"), 1) | dict.fromkeys(
    ("fs", "rate", "hz", "freq", "frequency"), -1
)
"""Names of single numbers that say how far samples are apart, by their last word, as powers of the period."""


@dataclass(frozen=True)
class NamedArray:
    """An array of a file, not yet read."""

    name: str  # empty for the only array of a file
    shape: tuple[int, ...]
    kind: np.dtype[Any]  # of its entries; a structured one gives a column per field
    load: Callable[[], npt.NDArray[Any]]  # reads it


@dataclass(frozen=True)
class _Column:
    """Where a column's numbers are: array, then entry of a row, then field of the entry."""

    array: NamedArray
    entry: tuple[int, ...]
    fields: tuple[str | int, ...] = ()


class ArrayFile:
    """A file of arrays with columns ``name``, ``name[0]``, ``name[0][1]`` and ``name.field``."""

    def __init__(
        self,
        path: Path,
        kind: str,
        arrays: Sequence[NamedArray],
        left_out: Mapping[str, str],
        source: str,
    ) -> None:
        self.source, self._kind, self.left_out = source, kind, dict(left_out)
        self._packed = path.stat().st_size if path.is_file() else None
        repeated = {
            name
            for name, count in Counter(array.name for array in arrays).items()
            if count > 1
        }
        self.left_out |= dict.fromkeys(repeated, "occurs more than once")
        COLUMNS.check(len(arrays), source)
        arrays = _turned(arrays)
        usable = [array for array in arrays if array.shape and self._is_usable(array)]
        self.length = _common_length(usable)
        usable += _clock(arrays, self.length)
        COLUMNS.check(
            sum(
                prod(a.shape[1:]) * _count_numbers(a.kind)
                for a in usable
                if a.shape[0] == self.length
            ),
            source,
        )
        self._columns: dict[str, _Column] = {}
        for array in usable:
            if array.shape[0] == self.length:
                self._columns.update(_columns(array))
            else:
                problem = f"has {array.shape[0]} rows where most arrays of the file have {self.length}"
                self.left_out[array.name] = problem
        for array in arrays:
            if not array.shape:
                self.left_out[array.name] = "is a single value, not a value per row"
        self.names: tuple[str, ...] = tuple(self._columns)
        if not self.names or not self.length:
            reasons = "; ".join(
                f"'{name}' {reason}" for name, reason in list(self.left_out.items())[:4]
            )
            problem = f"holds no arrays of numbers with a row per sample{reasons and f': {reasons}'}"
            raise InputError(problem, source=source)

    def tables(
        self, names: Sequence[str] | None = None, rows: int = CHUNK
    ) -> Iterator[Table]:
        """Pieces of the file."""
        chosen = selected(self.source, names, self.names, self.left_out)
        picked = {name: self._columns[name] for name in chosen}
        self._check_memory([column.array for column in picked.values()])
        with decoding(self.source, self._kind):
            loaded = {
                column.array.name: column.array.load() for column in picked.values()
            }
        for first in range(0, self.length, rows):
            columns = {name: _values(column, loaded[column.array.name][first : first + rows])
                       for name, column in picked.items()}  # fmt: skip
            yield Table(self.source, columns, first=first)

    def _check_memory(self, arrays: Sequence[NamedArray]) -> None:
        """As numbers, which take eight bytes each, and as the arrays that hold them."""
        if self._packed is None:  # they are in memory already
            return
        sizes = {
            array.name: array.kind.itemsize * prod(array.shape) for array in arrays
        }
        check_unpacked(
            max(sum(sizes.values()), 8 * self.length * len(arrays)),
            self._packed,
            self.source,
        )

    def _is_usable(self, array: NamedArray) -> bool:
        entries, numbers = prod(array.shape[1:]), _count_numbers(array.kind)
        if not entries:
            self.left_out[array.name] = "has rows without entries"
        elif not numbers:
            self.left_out[array.name] = (
                f"holds {_described(array.kind)}, not real numbers"
            )
        elif entries * numbers > ARRAY_COLUMNS.most:
            problem = f"has {entries * numbers} columns; at most {ARRAY_COLUMNS.most} are read (is it transposed?)"
            self.left_out[array.name] = problem
        return array.name not in self.left_out


def _turned(arrays: Sequence[NamedArray]) -> list[NamedArray]:
    """The arrays with rows along the first axis, where only the second one is as long as most arrays are."""
    length = _common_length(
        [
            replace(array, shape=(max(array.shape[:2]),))
            for array in arrays
            if array.shape
        ]
    )

    def turned(array: NamedArray) -> NamedArray:
        if (
            len(array.shape) != 2
            or array.shape[0] == length
            or array.shape[1] != length
        ):
            return array
        return replace(array, shape=array.shape[::-1], load=lambda: array.load().T)

    return [turned(array) for array in arrays]


def _clock(arrays: Sequence[NamedArray], length: int) -> list[NamedArray]:
    """The time of every row, s, where a single number says the period or the rate and there is no time."""
    words = {
        array.name: re.split(r"[^a-z]+", array.name.lower())[-1] for array in arrays
    }
    if any(
        _TIME.fullmatch(words[array.name]) and prod(array.shape) > 1 for array in arrays
    ):
        return []
    for array in arrays:
        power = _PERIODS.get(words[array.name])
        if power is not None and prod(array.shape) == 1 and array.kind.kind in "iuf":
            times = np.arange(length) * float(np.ravel(array.load())[0]) ** power
            return [NamedArray("time [s]", times.shape, times.dtype, times.view)]
    return []


def _common_length(arrays: Sequence[NamedArray]) -> int:
    """Length of most arrays; of two that are equally frequent, the larger."""
    lengths = Counter(array.shape[0] for array in arrays)
    return max(lengths, key=lambda length: (lengths[length], length), default=0)


def _columns(array: NamedArray) -> Iterator[tuple[str, _Column]]:
    for entry in product(*(range(size) for size in array.shape[1:])):
        for label, fields in _number_fields(array.kind):
            yield _named(array.name, entry, label), _Column(array, entry, fields)


def _named(name: str, entry: tuple[int, ...], label: str) -> str:
    """``name[0][1].field``; for an array without a name ``0[1].field``, ``field``, or ``0`` for a plain vector."""
    if name or (entry and label):
        return name + "".join(f"[{index}]" for index in entry) + label
    if label:
        return label.removeprefix(".")
    first, *others = entry or (0,)
    return f"{first}" + "".join(f"[{index}]" for index in others)


def _count_numbers(kind: np.dtype[Any]) -> int:
    """Real numbers in a dtype; of more than an array can have as columns, one more than that."""
    return sum(1 for _ in islice(_number_fields(kind), ARRAY_COLUMNS.most + 1))


def _number_fields(kind: np.dtype[Any]) -> Iterator[tuple[str, tuple[str | int, ...]]]:
    """Real numbers in a dtype: their label, and the way to them."""
    if kind.names is not None:
        for name in kind.names:
            for label, fields in _number_fields(kind[name]):
                yield f".{name}{label}", (name, *fields)
    elif kind.subdtype is not None:
        inner, shape = kind.subdtype
        for entry in product(*(range(size) for size in shape)):
            for label, fields in _number_fields(inner):
                yield (
                    "".join(f"[{index}]" for index in entry) + label,
                    (*entry, *fields),
                )
    elif kind.kind in "biuf":
        yield "", ()


def _values(column: _Column, rows: npt.NDArray[Any]) -> Floats:
    index: tuple[Any, ...] = (slice(None), *column.entry)
    values = rows[index]
    for step in column.fields:
        values = values[step] if isinstance(step, str) else values[:, step]
    return np.array(values, dtype=np.float64)


def _described(kind: np.dtype[Any]) -> str:
    words = {"O": "Python objects", "U": "text", "S": "text", "c": "complex numbers"}
    words |= dict.fromkeys("Mm", "dates or spans of time (save them as seconds)")
    return words.get(kind.kind, str(kind))


class NpzFile(ArrayFile):
    """An archive of arrays, or a single array.

    A vector is a column of its name, an array of more dimensions gives ``name[0]``, ``name[1]``, …, a structured array
    ``name.field``.  In a file with a single array these names begin with the index or the field: ``0``, ``1``, … or
    ``field``.  The log has as many rows as most arrays; the others are left out.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        found, source = existing_file(path), os.fspath(path)
        with decoding(source, _KIND):
            arrays = _members(found) if zipfile.is_zipfile(found) else [_single(found)]
        super().__init__(found, _KIND, arrays, {}, source)


def _single(path: Path) -> NamedArray:
    """The array of an NPY file, which stays on disk until its rows are asked for."""
    with path.open("rb") as stream:
        shape, kind = _header(stream)
        rest = os.fstat(stream.fileno()).st_size - stream.tell()
    if kind.hasobject:
        raise InputError(
            "holds pickled Python objects, which are not loaded: they can run code"
        )
    _check_complete(shape, kind, rest)
    return NamedArray(
        "", shape, kind, lambda: np.load(path, mmap_mode="r", allow_pickle=False)
    )


def _members(path: Path) -> list[NamedArray]:
    """The arrays of an archive, by their headers."""
    arrays = []
    with zipfile.ZipFile(path) as archive:
        members = [
            member for member in archive.infolist() if member.filename.endswith(_ENDING)
        ]
        COLUMNS.check(len(members))
        for info in members:
            member = info.filename
            with archive.open(info) as stream:
                shape, kind = _header(stream)
                _check_complete(shape, kind, info.file_size - stream.tell())
            name = member.removesuffix(_ENDING)
            arrays.append(NamedArray(name, shape, kind, partial(_loaded, path, member)))
    return arrays


def _loaded(path: Path, member: str) -> npt.NDArray[Any]:
    with zipfile.ZipFile(path) as archive, archive.open(member) as stream:
        return np.lib.format.read_array(stream, allow_pickle=False)


def _check_complete(shape: tuple[int, ...], kind: np.dtype[Any], rest: int) -> None:
    """The array cannot be larger than what follows its header; its product is exact, however large."""
    if kind.itemsize * prod(shape) > rest and not kind.hasobject:
        raise ValueError(
            f"an array of shape {shape} needs more than the {rest} bytes that follow"
        )


def _header(stream: IO[bytes]) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Shape and dtype of an array that is stored in NumPy's format."""
    version = np.lib.format.read_magic(stream)
    if version not in _HEADERS:
        raise ValueError(
            f"version {version[0]}.{version[1]} of the format is not known"
        )
    shape, _, kind = _HEADERS[version](stream)
    return shape, kind


_HEADERS: Mapping[
    tuple[int, int], Callable[[Any], tuple[tuple[int, ...], bool, np.dtype[Any]]]
] = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}


def is_samples(log: object) -> bool:
    """Whether something is a dict of arrays, a data frame, a matrix or a structured array."""
    if isinstance(log, np.ndarray):
        return log.ndim == 2 or log.dtype.names is not None
    return (
        isinstance(log, Mapping)
        or hasattr(log, "collect")
        or (hasattr(log, "columns") and hasattr(log, "shape"))
    )


class MemoryLog(_Path):
    """A path that names no file but carries samples."""

    arrays: Mapping[str, npt.NDArray[Any]]

    @classmethod
    def of(cls, samples: Any) -> MemoryLog:
        """Samples with a name made from their content."""
        columns = _by_name(samples)
        paths = [
            k for k, some in columns.items() if isinstance(some, str | os.PathLike)
        ]
        if len(paths) == len(columns):
            raise InputError(
                f"it holds no arrays of numbers with a row per sample, and '{paths[-1]}' is a path: give paths in a list, "
                "or by the names of experiments"
            )
        arrays = {str(name): _plain(values) for name, values in columns.items()}
        digest = hashlib.sha256()
        for name, values in arrays.items():
            digest.update(name.encode() + str(values.shape).encode())
            digest.update(
                np.ascontiguousarray(values).tobytes()
                if values.dtype != object
                else b""
            )
        return cls.named(f"samples {digest.hexdigest()[:8]}", arrays)

    @classmethod
    def named(cls, name: str, arrays: Mapping[str, npt.NDArray[Any]]) -> MemoryLog:
        """Samples under a name."""
        log = cls(name)
        log.arrays = arrays
        return log

    def __reduce__(self) -> tuple[Any, ...]:
        return MemoryLog.named, (str(self), self.arrays)

    def file(self) -> ArrayFile:
        """The samples, opened for reading."""
        arrays = [
            NamedArray(name, some.shape, some.dtype, some.view)
            for name, some in self.arrays.items()
        ]
        return ArrayFile(self, "samples", arrays, {}, str(self))


def _by_name(samples: Any) -> dict[str, Any]:
    """Columns of a dict, of a table, or of a data frame with what its index says of time."""
    if isinstance(samples, Mapping):
        found: dict[str, Any] = {}
        for name, some in samples.items():
            inner = _by_name(some) if isinstance(some, Mapping) else {"": some}
            found |= {
                f"{name}/{key}" if key else str(name): values
                for key, values in inner.items()
            }
        return found
    if isinstance(samples, np.ndarray):
        return {"": samples}
    if hasattr(samples, "collect"):  # a lazy frame of polars
        return _by_name(samples.collect())
    if hasattr(samples, "column_names"):  # a table of pyarrow
        return {name: samples.column(name).to_numpy() for name in samples.column_names}
    # several levels of names are one, such as position/elbow
    names = {
        name: "/".join(filter(None, map(str, name)))
        if isinstance(name, tuple)
        else str(name)
        for name in samples.columns
    }
    columns = {label: samples[name].to_numpy() for name, label in names.items()}
    if len(columns) < len(samples.columns):
        raise InputError("two columns of the data frame have the same name")
    index = getattr(samples, "index", None)
    if (
        index is not None
        and type(index).__name__ != "RangeIndex"
        and index.nlevels == 1
    ):
        columns.setdefault(str(index.name or "time"), index.to_numpy())
    return columns


def _plain(values: Any) -> npt.NDArray[Any]:
    """Numbers as they are, vectors in rows as matrices, and times in seconds from the whole second of the first one."""
    array = np.asarray(values)
    if array.dtype == object and array.size and np.ndim(array[0]) < 2:
        try:
            array = np.stack([np.asarray(row, dtype=float) for row in array])
        except (ValueError, TypeError):
            return array
    if array.dtype.kind not in "mM":
        return array
    whole = (
        array[:1].astype("M8[s]") if array.dtype.kind == "M" else np.zeros(1, "m8[s]")
    )
    spans = (array - whole.astype(array.dtype)).astype("m8[ns]")
    return np.where(np.isnat(spans), np.nan, spans.astype(np.int64) / 1e9)
