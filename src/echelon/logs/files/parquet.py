"""Parquet files, read by batches of rows: memory is bounded by the batch, not by the file.

Points in time count from the whole second of the first one in the file: since 1970, a float64 would keep no more than a
quarter of a microsecond.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any

from echelon.arrays import Floats
from echelon.errors import InputError, MissingExtraError
from echelon.inputs.limits import COLUMNS, check_unpacked
from echelon.logs.files.access import decoding, existing_file
from echelon.logs.files.parquet_columns import Leaf, is_point_in_time, leaves, ticks_per_second
from echelon.logs.files.selection import selected
from echelon.logs.table import CHUNK, Table

_SAMPLED = 16
_BUFFER = 1 << 20
_KIND = "a Parquet file"


class ParquetFile:
    """A Parquet file.

    Integers, booleans, decimals and floats are columns of their name; a field of a struct is ``name.field``, an entry
    of a list whose length is constant ``name[0]``.  Times and spans of time are in seconds; points in time count from
    ``origin``.  Missing values are NaN.

    Parameters
    ----------
    path : path

    Attributes
    ----------
    source : str
    names : tuple of str
        As of :class:`echelon.logs.table.LogFile`; columns that hold no numbers are left out.
    origin : int
        Second since 1970 from which points in time count: that of the first one in the file; 0 without any.

    Raises
    ------
    InputError
        If the file cannot be read, is damaged, or holds no rows or no numbers.
    MissingExtraError
        If pyarrow is not installed.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.source = os.fspath(path)
        existing_file(path)
        with decoding(self.source, _KIND), self._opened() as file:
            if not file.metadata.num_rows:
                raise InputError("holds no rows", source=self.source)
            COLUMNS.check(file.metadata.num_columns, self.source)
            self._rows: int = file.metadata.num_rows
            head = next(file.iter_batches(batch_size=_SAMPLED))
            self._leaves, self._left_out = self._columns(head)
            self.origin = _origin(head)
        self.names: tuple[str, ...] = tuple(self._leaves)
        if not self.names:
            raise InputError("none of its columns holds numbers", source=self.source)

    def tables(self, names: Sequence[str] | None = None, rows: int = CHUNK) -> Iterator[Table]:
        """Pieces of the file, as :meth:`echelon.logs.table.LogFile.tables` describes.

        Parameters
        ----------
        names : sequence of str, optional
            Columns to read; all that hold numbers if omitted.
        rows : int
            Rows that are read at once.

        Raises
        ------
        InputError
            If a column is missing or holds no numbers, or the file is damaged.
        """
        chosen = selected(self.source, names, self.names, self._left_out)
        picked = {name: self._leaves[name] for name in chosen}
        check_unpacked(8 * self._rows * len(picked), os.path.getsize(self.source), self.source)
        needed = list(dict.fromkeys(leaf.column for leaf in picked.values()))
        with decoding(self.source, _KIND):
            file = self._opened()
        with file:
            first = 0
            batches = file.iter_batches(batch_size=rows, columns=needed)
            while (batch := self._next(batches)) is not None:
                columns = {name: self._values(leaf, batch, first) for name, leaf in picked.items()}
                yield Table(self.source, columns, first=first)
                first += batch.num_rows

    def _opened(self) -> Any:
        try:
            import pyarrow.parquet as pq
        except ImportError:
            raise MissingExtraError("pyarrow", "identify") from None
        # without a buffer, the whole of a column's row group would be read at once
        return pq.ParquetFile(self.source, page_checksum_verification=True, pre_buffer=False, buffer_size=_BUFFER)

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
            raise InputError(error.problem, source=self.source, element=f"column '{leaf.name}', row {row}") from None

    def _columns(self, head: Any) -> tuple[dict[str, Leaf], dict[str, str]]:
        """Columns by name, and what is none with the reason."""
        found: dict[str, Leaf] = {}
        left_out: dict[str, str] = {}
        counts = Counter(head.schema.names)
        for position, column in enumerate(head.schema.names):
            if counts[column] > 1:
                left_out[column] = "more than one column has this name"
                continue
            for leaf, reason in leaves(column, head.column(position)):
                if reason:
                    left_out[leaf.name] = reason
                elif leaf.name in found:
                    problem = "a field inside another column has the same name"
                    raise InputError(problem, source=self.source, element=f"column '{leaf.name}'")
                else:
                    found[leaf.name] = leaf
        return found, left_out


def _origin(head: Any) -> int:
    """Second of the first point in time of the file."""
    import pyarrow as pa

    for column in head.columns:
        valid = column.drop_null()
        if is_point_in_time(column.type) and len(valid):
            if pa.types.is_date32(column.type):
                return int(valid[0].cast(pa.int32()).as_py()) * 86400
            return int(valid[0].cast(pa.int64()).as_py()) // ticks_per_second(column.type)
    return 0
