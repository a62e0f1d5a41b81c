"""Samples in memory as a log: a dict of arrays, or a data frame of pandas or polars.

Logs are handed on as paths, to other processes as well, and so are these: as paths that name no file but carry the
samples.  A path's name tells what they are by their content, so that equal samples make equal results.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from echelon.errors import InputError
from echelon.logs.files.numpy_file import ArrayFile, NamedArray

if TYPE_CHECKING:
    _Path = Path
else:
    _Path = type(Path())  # before Python 3.12 only the system's own kind of path can be extended


def is_samples(log: object) -> bool:
    """Whether something is a dict of arrays or a data frame."""
    return isinstance(log, Mapping) or (hasattr(log, "columns") and hasattr(log, "shape"))


class MemoryLog(_Path):
    """A path that names no file but carries samples."""

    arrays: Mapping[str, npt.NDArray[Any]]

    @classmethod
    def of(cls, samples: Any) -> MemoryLog:
        """Samples with a name made from their content."""
        arrays = {str(name): _plain(values) for name, values in _columns(samples).items()}
        digest = hashlib.sha256()
        for name, values in arrays.items():
            digest.update(name.encode() + str(values.shape).encode())
            digest.update(np.ascontiguousarray(values).tobytes() if values.dtype != object else b"")
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
        arrays = [NamedArray(name, some.shape, some.dtype, some.view) for name, some in self.arrays.items()]
        return ArrayFile(self, "samples", arrays, {}, str(self))


def _columns(samples: Any) -> dict[str, Any]:
    """Columns of a dict, of a table, or of a data frame with what its index says of time."""
    if isinstance(samples, Mapping):
        return dict(samples)
    if hasattr(samples, "column_names"):  # a table of pyarrow
        return {name: samples.column(name).to_numpy() for name in samples.column_names}
    columns = {str(name): samples[name].to_numpy() for name in samples.columns}
    if len(columns) < len(samples.columns):
        raise InputError("two columns of the data frame have the same name")
    index = getattr(samples, "index", None)
    if index is not None and type(index).__name__ != "RangeIndex" and index.nlevels == 1:
        columns.setdefault(str(index.name or "time"), index.to_numpy())
    return columns


def _plain(values: Any) -> npt.NDArray[Any]:
    """Numbers as they are, vectors in rows as matrices, and times in seconds from the whole second of the first one."""
    array = np.asarray(values)
    if array.dtype == object and len(array) and np.ndim(array[0]) == 1:
        try:
            array = np.stack([np.asarray(row, dtype=float) for row in array])
        except (ValueError, TypeError):
            return array
    if array.dtype.kind not in "mM":
        return array
    whole = array[:1].astype("M8[s]") if array.dtype.kind == "M" else np.zeros(1, "m8[s]")
    spans = (array - whole.astype(array.dtype)).astype("m8[ns]")
    return np.where(np.isnat(spans), np.nan, spans.astype(np.int64) / 1e9)
