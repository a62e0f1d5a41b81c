"""Numbers from lines of text.

Blocks of clean numbers, which is nearly all of every log, are parsed by pyarrow where it is installed and by numpy
where not.  Both only decide how fast: whatever they refuse is parsed again cell by cell, which alone says what counts
as a number and names the line and the column of what does not.
"""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from echelon.arrays import Floats
from echelon.errors import InputError, one_line
from echelon.logs.files.dialect import Dialect, cells, is_blank, number

_COMMENT = re.compile(rb"^[ \t]*#[^\n]*", re.MULTILINE)
_DATE = re.compile(r"\d+[-/.]\d+[-/.]\d+|\d+:\d\d")
_NULLS = ["", "nan", "NaN", "NAN", "NA", "N/A", "null", "NULL", "None"]
_SHOWN = 40


@dataclass(frozen=True)
class BlockParser:
    """Parses blocks of lines of one file.

    Attributes
    ----------
    source : str
        Name of the file.
    dialect : Dialect
    picked : tuple of int
        Columns whose numbers are wanted; the cells of the others may hold anything.
    """

    source: str
    dialect: Dialect
    picked: tuple[int, ...]

    def parse(self, lines: Sequence[bytes], line: int) -> list[Floats]:
        """The picked columns, all of one length; blank lines and comments give no row.

        Parameters
        ----------
        lines : sequence of bytes
            Without line feeds.
        line : int
            Number of the first one in the file, from 1.

        Raises
        ------
        InputError
            If a line has too many or too few cells or a cell holds no number; names line and column.
        """
        text = b"\n".join(lines)
        if b"#" in text:
            text = _COMMENT.sub(b"", text)
        if self.dialect.decimal_comma:
            text = text.replace(b",", b".")
        if not text.strip():
            return [np.empty(0) for _ in self.picked]
        columns = self._by_arrow(text)
        if columns is None:
            columns = self._by_cells(lines, line)
        return columns

    def _by_arrow(self, text: bytes) -> list[Floats] | None:
        """Columns of clean text through pyarrow, or through numpy if it is not installed or cannot cut the lines."""
        if self.dialect.delimiter is None:
            return self._by_numpy(text)
        try:
            from pyarrow import ArrowException, BufferReader, csv, float64
        except ImportError:
            return self._by_numpy(text)
        wanted = [str(index) for index in self.picked]
        try:
            table = csv.read_csv(
                BufferReader(text),
                csv.ReadOptions(column_names=[str(index) for index in range(len(self.dialect.names))]),
                csv.ParseOptions(delimiter=self.dialect.delimiter),
                csv.ConvertOptions(
                    column_types=dict.fromkeys(wanted, float64()), include_columns=wanted, null_values=_NULLS
                ),
            )
        except ArrowException:
            return None
        return [np.asarray(table.column(name).to_numpy(), dtype=np.float64) for name in wanted]

    def _by_numpy(self, text: bytes) -> list[Floats] | None:
        try:
            stream = io.StringIO(text.decode("ascii"))
            rows = np.loadtxt(stream, delimiter=self.dialect.delimiter, comments=None, ndmin=2, quotechar='"')
        except ValueError:
            return None
        if rows.shape[1] != len(self.dialect.names):
            return None
        return [np.ascontiguousarray(rows[:, index]) for index in self.picked]

    def _by_cells(self, lines: Sequence[bytes], line: int) -> list[Floats]:
        columns: list[list[float]] = [[] for _ in self.picked]
        for current, raw in enumerate(lines, start=line):
            text = raw.decode("utf-8", errors="replace")
            if is_blank(text):
                continue
            row = self._row(text, current)
            for index, values in zip(self.picked, columns, strict=True):
                values.append(self._number(row[index], current, index))
        return [np.array(values) for values in columns]

    def _row(self, text: str, line: int) -> list[str]:
        names = self.dialect.names
        try:
            row = cells(text, self.dialect.delimiter)
        except InputError as error:
            raise InputError(error.problem, source=self.source, element=f"line {line}") from None
        if len(row) != len(names):
            problem = f"has {len(row)} {'cell' if len(row) == 1 else 'cells'} where the file has {len(names)} columns"
            raise InputError(problem, source=self.source, element=f"line {line}")
        return row

    def _number(self, cell: str, line: int, column: int) -> float:
        value = number(cell.replace(",", ".") if self.dialect.decimal_comma else cell)
        if value is None:
            shown = one_line(cell if len(cell) <= _SHOWN else cell[:_SHOWN] + "…")
            where = f"line {line}, column '{self.dialect.names[column]}'"
            hint = "; times have to be in seconds" if _DATE.match(cell) else ""
            raise InputError(f"'{shown}' is no number{hint}", source=self.source, element=where)
        return value
