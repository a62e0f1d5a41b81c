"""Named arrays as the columns of a log: what NPZ and MAT files hold.

Nothing in such a file says which axis is time, or which arrays belong to the log at all.  Rows are along the first
axis, and the log has as many as most of its arrays; arrays of another length are constants or settings, or transposed,
and are not guessed at.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from math import prod
from typing import Any

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.inputs.limits import ARRAY_COLUMNS, COLUMNS, check_unpacked
from echelon.logs.files.selection import selected
from echelon.logs.table import Table


@dataclass(frozen=True)
class NamedArray:
    """An array of a file, not yet read.

    Attributes
    ----------
    name : str
        Empty for the only array of a file.
    shape : tuple of int
    kind : dtype
        Of its entries; a structured one gives a column per field.
    load : callable
        Reads it.
    """

    name: str
    shape: tuple[int, ...]
    kind: np.dtype[Any]
    load: Callable[[], npt.NDArray[Any]]


@dataclass(frozen=True)
class _Column:
    """Where a column's numbers are: array, then entry of a row, then field of the entry."""

    array: NamedArray
    entry: tuple[int, ...]
    fields: tuple[str | int, ...] = ()


class ArrayColumns:
    """Columns of a file's arrays: ``name``, ``name[0]``, ``name[0][1]``, ``name.field``.

    Parameters
    ----------
    source : str
        Name of the file.
    arrays : sequence of NamedArray
    left_out : mapping of str to str
        What the file holds besides, and why that is no column.
    packed : int
        Size of the file, bytes.

    Attributes
    ----------
    names : tuple of str
    length : int
        Rows of the log.

    Raises
    ------
    InputError
        If no array can be a column.
    """

    def __init__(self, source: str, arrays: Sequence[NamedArray], left_out: Mapping[str, str], packed: int) -> None:
        self._source, self._left_out, self._packed = source, dict(left_out), packed
        repeated = {name for name, count in Counter(array.name for array in arrays).items() if count > 1}
        self._left_out |= dict.fromkeys(repeated, "occurs more than once")
        COLUMNS.check(len(arrays), source)
        usable = [array for array in arrays if array.shape and self._is_usable(array)]
        self.length = _common_length(usable)
        COLUMNS.check(
            sum(prod(a.shape[1:]) * _count_numbers(a.kind) for a in usable if a.shape[0] == self.length), source
        )
        self._columns: dict[str, _Column] = {}
        for array in usable:
            if array.shape[0] == self.length:
                self._columns.update(_columns(array))
            else:
                rows = f"has {array.shape[0]} rows where most arrays of the file have {self.length}"
                swapped = "; transpose it" if self.length in array.shape else ""
                self._left_out[array.name] = rows + swapped
        for array in arrays:
            if not array.shape:
                self._left_out[array.name] = "is a single value, not a value per row"
        self.names: tuple[str, ...] = tuple(self._columns)
        if not self.names or not self.length:
            raise InputError("holds no arrays of numbers with a row per sample" + self._reasons(), source=source)

    def tables(self, names: Sequence[str] | None, rows: int) -> Iterator[Table]:
        """Pieces of the file, as :meth:`echelon.logs.table.LogFile.tables` describes.

        Parameters
        ----------
        names : sequence of str, optional
        rows : int

        Raises
        ------
        InputError
            If a column is missing.
        """
        chosen = selected(self._source, names, self.names, self._left_out)
        picked = {name: self._columns[name] for name in chosen}
        self._check_memory([column.array for column in picked.values()])
        loaded = {column.array.name: column.array.load() for column in picked.values()}
        for first in range(0, self.length, rows):
            columns = {name: _values(column, loaded[column.array.name][first : first + rows])
                       for name, column in picked.items()}  # fmt: skip
            yield Table(self._source, columns, first=first)

    def _check_memory(self, arrays: Sequence[NamedArray]) -> None:
        """As numbers, which take eight bytes each, and as the arrays that hold them."""
        sizes = {array.name: array.kind.itemsize * prod(array.shape) for array in arrays}
        check_unpacked(max(sum(sizes.values()), 8 * self.length * len(arrays)), self._packed, self._source)

    def _is_usable(self, array: NamedArray) -> bool:
        entries, numbers = prod(array.shape[1:]), _count_numbers(array.kind)
        if not entries:
            self._left_out[array.name] = "has rows without entries"
        elif not numbers:
            self._left_out[array.name] = f"holds {_described(array.kind)}, not real numbers"
        elif entries * numbers > ARRAY_COLUMNS.most:
            problem = f"has {entries * numbers} columns; at most {ARRAY_COLUMNS.most} are read (is it transposed?)"
            self._left_out[array.name] = problem
        return array.name not in self._left_out

    def _reasons(self) -> str:
        found = [f"'{name}' {reason}" for name, reason in self._left_out.items()]
        return f": {'; '.join(found[:4])}" if found else ""


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
    """How many real numbers a dtype holds."""
    if kind.names is not None:
        return sum(_count_numbers(kind[name]) for name in kind.names)
    if kind.subdtype is not None:
        return _count_numbers(kind.subdtype[0]) * prod(kind.subdtype[1])
    return int(kind.kind in "biuf")


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
                yield "".join(f"[{index}]" for index in entry) + label, (*entry, *fields)
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
