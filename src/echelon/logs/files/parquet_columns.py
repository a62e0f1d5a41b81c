"""Columns of Parquet files as numbers: nested types are taken apart, times become seconds.

A leaf is a number inside a column and the way to it: fields of structs by name, entries of lists by index.  Lengths of
lists are data, not type, so they are those of the first rows, and every later row is checked against them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from echelon.arrays import Floats
from echelon.errors import InputError

_UNITS = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}
_DAY = 86400
_LONGEST = 256


@dataclass(frozen=True)
class Step:
    """One step into a nested column: a field of a struct, or an entry of a list of so many."""

    key: str | int
    length: int = 0

    def __str__(self) -> str:
        return f"[{self.key}]" if isinstance(self.key, int) else f".{self.key}"


@dataclass(frozen=True)
class Leaf:
    """A number per row.

    Attributes
    ----------
    column : str
        Column of the file that holds it.
    steps : tuple of Step
        The way from there.
    """

    column: str
    steps: tuple[Step, ...] = ()

    @property
    def name(self) -> str:
        """Such as ``column``, ``column.field`` or ``column[0]``."""
        return self.column + "".join(map(str, self.steps))

    def values(self, column: Any, origin: int) -> Floats:
        """The numbers of a piece of the column, NaN where there are none, shape (N,).

        Parameters
        ----------
        column : pyarrow.Array
        origin : int
            Second from which points in time count, since 1970.

        Raises
        ------
        InputError
            If a list has another length than in the first rows; names neither file nor row of the file.
        """
        import pyarrow.compute as pc

        for step in self.steps:
            if isinstance(step.key, str):
                column = pc.struct_field(column, step.key)
            else:
                _check_lengths(column, step.length)
                column = pc.list_element(column, step.key)
        return numbers(column, origin)


def leaves(column: str, sample: Any) -> Iterator[tuple[Leaf, str]]:
    """Numbers inside a column, each with the reason why it cannot be read, empty if it can.

    Parameters
    ----------
    column : str
    sample : pyarrow.Array
        The column's first rows.
    """
    yield from _inside(Leaf(column), sample)


def numbers(array: Any, origin: int) -> Floats:
    """A piece of a column without nesting as numbers, shape (N,); spans of time in seconds.

    Parameters
    ----------
    array : pyarrow.Array
    origin : int
        Second from which points in time count, since 1970.
    """
    import pyarrow as pa
    import pyarrow.compute as pc

    if pa.types.is_dictionary(array.type):
        array = array.dictionary_decode()
    if ticks := ticks_per_second(array.type):
        shift = origin * ticks if is_point_in_time(array.type) else 0
        values = pc.subtract(_integers(array), pa.scalar(shift, pa.int64()))
        scale = ticks
    else:
        values, scale = array, 1
    floats = np.asarray(pc.cast(values, pa.float64(), safe=False).to_numpy(zero_copy_only=False), dtype=np.float64)
    return floats / scale if scale != 1 else floats


def ticks_per_second(kind: Any) -> int:
    """Resolution of a type of times; 0 for other types.

    Parameters
    ----------
    kind : pyarrow.DataType
    """
    import pyarrow as pa

    if pa.types.is_timestamp(kind) or pa.types.is_duration(kind) or pa.types.is_time(kind):
        return _UNITS[kind.unit]
    return 1000 if pa.types.is_date64(kind) else 1 if pa.types.is_date32(kind) else 0


def is_point_in_time(kind: Any) -> bool:
    """Whether a type of times counts from 1970.

    Parameters
    ----------
    kind : pyarrow.DataType
    """
    import pyarrow as pa

    return bool(pa.types.is_timestamp(kind) or pa.types.is_date(kind))


def _integers(times: Any) -> Any:
    """Ticks since the type's zero."""
    import pyarrow as pa
    import pyarrow.compute as pc

    if pa.types.is_date32(times.type):
        return pc.multiply(pc.cast(times.cast(pa.int32()), pa.int64()), _DAY)
    if times.type.bit_width == 32:  # times of the day in seconds or milliseconds
        return pc.cast(times.cast(pa.int32()), pa.int64())
    return times.cast(pa.int64())


def _inside(leaf: Leaf, sample: Any) -> Iterator[tuple[Leaf, str]]:
    import pyarrow as pa
    import pyarrow.compute as pc

    kind = sample.type
    if pa.types.is_struct(kind):
        for field in kind:
            yield from _inside(_below(leaf, Step(field.name)), pc.struct_field(sample, field.name))
    elif _is_list(kind):
        length, reason = _length(sample)
        if reason:
            yield leaf, reason
        for index in range(length):
            yield from _inside(_below(leaf, Step(index, length)), _element(sample, index, length))
    else:
        valued = kind.value_type if pa.types.is_dictionary(kind) else kind
        yield leaf, "" if _is_number(valued) else f"holds {kind}, not numbers"


def _below(leaf: Leaf, step: Step) -> Leaf:
    return Leaf(leaf.column, (*leaf.steps, step))


def _is_list(kind: Any) -> bool:
    import pyarrow as pa

    return bool(pa.types.is_list(kind) or pa.types.is_large_list(kind) or pa.types.is_fixed_size_list(kind))


def _is_number(kind: Any) -> bool:
    import pyarrow as pa

    plain = (pa.types.is_integer, pa.types.is_floating, pa.types.is_boolean, pa.types.is_decimal, pa.types.is_null)
    return any(test(kind) for test in plain) or ticks_per_second(kind) > 0


def _length(sample: Any) -> tuple[int, str]:
    """Entries of each list, or why the lists cannot be columns."""
    import pyarrow.compute as pc

    lengths = pc.unique(pc.drop_null(pc.list_value_length(sample))).to_pylist()
    if not lengths:
        return 0, "its first lists are missing, so that the number of their entries is not known"
    if len(lengths) > 1:
        return 0, f"holds lists of different lengths ({min(lengths)} and {max(lengths)})"
    if lengths[0] > _LONGEST:
        return 0, f"holds lists of {lengths[0]} entries; at most {_LONGEST} become columns"
    return lengths[0], "" if lengths[0] else "holds empty lists"


def _element(lists: Any, index: int, length: int) -> Any:
    import pyarrow.compute as pc

    complete = lists.filter(pc.equal(pc.list_value_length(lists), length))
    return pc.list_element(complete, index)


def _check_lengths(lists: Any, length: int) -> None:
    import pyarrow.compute as pc

    lengths = pc.fill_null(pc.list_value_length(lists), length).to_numpy(zero_copy_only=False)
    wrong = np.flatnonzero(lengths != length)
    if wrong.size:
        row = int(wrong[0])
        raise InputError(f"a list of {lengths[row]} entries where others have {length}", element=f"row {row}")
