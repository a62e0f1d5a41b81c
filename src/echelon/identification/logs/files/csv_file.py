"""Text files: CSV and its relatives, with commas, semicolons, tabs or blanks, compressed by gzip or not.

Blocks of clean numbers, which is nearly all of every log, are parsed by pyarrow.  It only decides how fast: whatever it
refuses is parsed again cell by cell, which alone says what counts as a number and names the line and the column of what
does not.  Files are read in pieces and may be larger than memory.
"""

from __future__ import annotations

import codecs
import gzip
import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import IO, Any, cast

import numpy as np

from echelon.identification.logs.files.log_file import (
    CHUNK,
    HEAD,
    Table,
    decoding,
    existing_file,
    selected,
)
from echelon.identification.logs.files.text_layout import (
    COMMENT,
    LIST,
    Dialect,
    cells,
    flat,
    is_blank,
    number,
    sniff,
    stamp,
)
from echelon.identification.logs.recording import FEWEST
from echelon.shared import LINE, UNPACKED, Floats, InputError, check_unpacked, shortened

_DATE = re.compile(r"\d+[-/.]\d+[-/.]\d+|\d+:\d\d")
_NULLS = ["", "-", "nan", "NaN", "NAN", "NA", "N/A", "#N/A", "null", "NULL", "None"]
_FEW = 0.01
"""Share of the rows of a piece that may be garbage; of more, the file is of another layout."""
_MARK = b"\xef\xbb\xbf"


@dataclass(frozen=True)
class BlockParser:
    """Parses blocks of lines of one file."""

    source: str  # name of the file
    dialect: Dialect
    picked: tuple[
        int, ...
    ]  # columns whose numbers are wanted; the cells of the others may hold anything

    def parse(
        self, lines: Sequence[bytes], line: int, before: int = 0
    ) -> tuple[list[Floats], list[InputError]]:
        """The picked columns of lines, the first of them number ``line``, and what is wrong with rows left out.

        Blank lines and comments give no row.  Rows are left out if they are few beside these and those ``before``, or
        if the last one is cut off.
        """
        if self.dialect.vectors:
            lines = [LIST.sub(flat(self.dialect.delimiter), line) for line in lines]
        text = b"\n".join(lines)
        if any(mark in text for mark in (b"#", b"%", b"//")):
            text = COMMENT.sub(b"", text)
        if self.dialect.decimal_comma:
            text = text.replace(b",", b".")
        if not text.strip():
            return [np.empty(0) for _ in self.picked], []
        columns = self._by_arrow(text)
        if columns is not None:
            return columns, []
        return self._by_cells(lines, line, before)

    def _by_arrow(self, text: bytes) -> list[Floats] | None:
        """Columns of clean text; None if pyarrow refuses it, or is not installed."""
        try:
            from pyarrow import ArrowException, BufferReader, csv, float64, string
        except ImportError:
            return None
        if self.dialect.delimiter is None:
            text = b"\n".join(b" ".join(line.split()) for line in text.split(b"\n"))
        wanted = [str(index) for index in self.picked]
        kinds = {
            str(index): string() if index in self.dialect.stamps else float64()
            for index in self.picked
        }
        try:
            table = csv.read_csv(
                BufferReader(text),
                csv.ReadOptions(
                    column_names=[
                        str(index) for index in range(len(self.dialect.names))
                    ]
                ),
                csv.ParseOptions(delimiter=self.dialect.delimiter or " "),
                csv.ConvertOptions(
                    column_types=kinds, include_columns=wanted, null_values=_NULLS
                ),
            )
            return [self._numbers(table.column(name)) for name in wanted]
        except (ArrowException, TypeError):
            return None

    def _numbers(self, column: Any) -> Floats:
        """Numbers, or times in seconds; what is no time is a TypeError."""
        if str(column.type) == "string":
            times = [self._seconds(cell) for cell in column.to_pylist()]
            if None in times:
                raise TypeError("not a time")
            return np.array(times, dtype=np.float64)
        return np.asarray(column.to_numpy(), dtype=np.float64)

    def _seconds(self, cell: str) -> float | None:
        """A time in a cell, s from the file's origin; None for what is no time."""
        found = stamp(cell)
        return None if found is None else found[0] - self.dialect.origin + found[1]

    def _by_cells(
        self, lines: Sequence[bytes], line: int, before: int
    ) -> tuple[list[Floats], list[InputError]]:
        rows: list[list[float]] = []
        wrong: list[InputError] = []
        for current, raw in enumerate(lines, start=line):
            text = raw.decode("utf-8", errors="replace")
            if is_blank(text):
                continue
            try:
                row = self._row(text, current)
                rows.append(
                    [self._number(row[index], current, index) for index in self.picked]
                )
            except InputError as error:
                wrong.append(error)
        count = before + len(rows)
        cut_off = bool(wrong) and wrong[-1].element == f"line {line + len(lines) - 1}"
        if len(wrong) - cut_off > _FEW * count or (wrong and count < FEWEST):
            raise wrong[0]
        table = np.array(rows).reshape(len(rows), len(self.picked))
        return [np.ascontiguousarray(column) for column in table.T], wrong

    def _row(self, text: str, line: int) -> list[str]:
        names = self.dialect.names
        try:
            row = cells(text, self.dialect.delimiter)
        except InputError as error:
            raise InputError(
                error.problem, source=self.source, element=f"line {line}"
            ) from None
        if len(row) != len(names):
            problem = f"has {len(row)} {'cell' if len(row) == 1 else 'cells'} where the file has {len(names)} columns"
            raise InputError(problem, source=self.source, element=f"line {line}")
        return row

    def _number(self, cell: str, line: int, column: int) -> float:
        value = number(cell.replace(",", ".") if self.dialect.decimal_comma else cell)
        if value is None:
            value = self._seconds(cell)
        if value is None:
            problem = f"'{shortened(cell, 40)}' is not a number"
            if _DATE.match(cell):
                problem += "; write times as numbers or as 2026-05-01T12:30:00.25"
            where = f"line {line}, column '{self.dialect.names[column]}'"
            raise InputError(problem, source=self.source, element=where)
        return value


class CsvFile:
    """A text file with a row of cells per line.

    Names stand in the first line or in the comment right above the numbers; without them columns are named ``0``,
    ``1``, ….  Lines that begin with ``#`` are comments.  Empty cells, ``nan`` and ``NA`` are missing values, NaN;
    ``true`` and ``false`` are 1 and 0.  Where cells are not cut by commas, a comma is a decimal point.  Times such as
    ``2026-05-01T12:30:00.25Z`` are in seconds, from a whole second near the beginning.  Lists in cells are a column per
    entry.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._path = existing_file(path)
        self.source = os.fspath(path)
        self._packed = self._path.stat().st_size if _is_packed(self._path) else 0
        lines = self._first_lines()
        self._dialect = sniff(lines, self.source)
        self.names: tuple[str, ...] = self._dialect.names
        last = next(
            cells(line, self._dialect.delimiter)
            for line in reversed(lines)
            if not is_blank(line)
        )
        told = () if self._dialect.vectors else zip(self.names, last, strict=False)
        self.worded = tuple(
            name
            for name, cell in told
            if number(cell.replace(",", ".")) is None and not stamp(cell)
        )
        self.units = dict(zip(self.names, self._dialect.units, strict=False))

    def tables(
        self, names: Sequence[str] | None = None, rows: int = CHUNK
    ) -> Iterator[Table]:
        """Pieces of the file with ``rows`` lines, or fewer where lines are long."""
        chosen = selected(self.source, names, self.names)
        place = {name: index for index, name in enumerate(self.names)}
        parser = BlockParser(
            self.source, self._dialect, tuple(place[name] for name in chosen)
        )
        first, line = 0, self._dialect.start + 1
        for lines in self._pieces(rows, self._dialect.start):
            columns, wrong = parser.parse(lines, line, first)
            length = len(columns[0]) if columns else 0
            if length:
                left_out = tuple(f"{error.element}: {error.problem}" for error in wrong)
                yield Table(
                    self.source,
                    dict(zip(chosen, columns, strict=True)),
                    first=first,
                    left_out=left_out,
                )
            first, line = first + length, line + len(lines)
        if chosen and not first:
            raise InputError(
                "holds the names of columns but no numbers", source=self.source
            )

    def words(self, name: str, rows: int = CHUNK) -> Iterator[list[str]]:
        """A column of words, in the pieces of :meth:`tables`."""
        place, delimiter = self.names.index(name), self._dialect.delimiter
        for lines in self._pieces(rows, self._dialect.start):
            texts = (line.decode("utf-8", errors="replace") for line in lines)
            rows_of_cells = (
                cells(text, delimiter) for text in texts if not is_blank(text)
            )
            yield [row[place] for row in rows_of_cells if len(row) == len(self.names)]

    def _pieces(self, rows: int, skipped: int) -> Iterator[list[bytes]]:
        """Lines behind the first ones: ``rows`` at once, or as many as fit into the memory set aside."""
        waiting: list[bytes] = []
        size = 0
        for lines in self._blocks():
            size += LINE.most
            waiting += lines[skipped:]
            skipped -= min(skipped, len(lines))
            whole = (
                len(waiting) - len(waiting) % rows
                if size < UNPACKED.most
                else len(waiting)
            )
            for start in range(0, whole, rows):
                yield waiting[start : min(start + rows, whole)]
            if whole:
                waiting, size = waiting[whole:], 0
        if waiting:
            yield waiting

    def _blocks(self) -> Iterator[list[bytes]]:
        """All lines without their ends, in blocks."""
        rest, mark = b"", _MARK
        with decoding(self.source, "text"), _opened(self._path) as stream:
            while block := stream.read(LINE.most):
                check_unpacked(stream.tell() if self._packed else 0, self._packed)
                *lines, rest = (rest + block.removeprefix(mark)).split(b"\n")
                LINE.check(
                    len(lines[0] if lines else rest)
                )  # the others are shorter than the block
                mark = b""
                yield lines
        if rest:
            yield [rest]

    def _first_lines(self) -> list[str]:
        """Lines to judge the layout by: leading comments and some lines of content."""
        lines: list[bytes] = []
        content = size = 0
        for line in chain.from_iterable(self._blocks()):
            lines.append(line)
            content += bool(line.strip()) and not line.lstrip().startswith(b"#")
            size += len(line)
            if content == HEAD or size > UNPACKED.most or len(lines) == CHUNK:
                break
        self._check_text(lines)
        return [_decoded(line) for line in lines]

    def _check_text(self, lines: list[bytes]) -> None:
        start = b"\n".join([*lines, b""])
        if b"\0" in start:
            raise InputError(
                "is not text, although its name says so", source=self.source
            )
        if b"\r" in start.replace(b"\r\n", b""):
            raise InputError(
                "has carriage returns inside lines; end lines with a line feed",
                source=self.source,
            )


def _decoded(line: bytes) -> str:
    """Text in UTF-8, or as programs of Windows write names and units."""
    try:
        return line.decode("utf-8")
    except UnicodeDecodeError:
        return line.decode("cp1252", errors="replace")


def _is_packed(path: Path) -> bool:
    return path.suffix.lower() == ".gz"


def _opened(path: Path) -> IO[bytes]:
    if _is_packed(path):
        return cast("IO[bytes]", gzip.open(path, "rb"))
    stream = path.open("rb")
    is_wide = stream.read(2) in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
    stream.seek(0)
    if is_wide:
        return cast("IO[bytes]", codecs.EncodedFile(stream, "utf-8", "utf-16"))
    return stream
