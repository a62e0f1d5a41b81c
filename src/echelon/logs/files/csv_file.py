"""Text files: CSV and its relatives, with commas, semicolons, tabs or blanks, compressed by gzip or not.

The layout is found from the first lines rather than asked for: a delimiter is right if it cuts all of them into equally
many cells and turns the last one into numbers.  Tabs and semicolons are tried before commas, because beside them commas
are decimal.

Blocks of clean numbers, which is nearly all of every log, are parsed by pyarrow where it is installed and by numpy
where not.  Both only decide how fast: whatever they refuse is parsed again cell by cell, which alone says what counts
as a number and names the line and the column of what does not.  Files are read in pieces and may be larger than memory.
"""

from __future__ import annotations

import codecs
import csv
import gzip
import io
import os
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from datetime import date
from itertools import chain
from pathlib import Path
from typing import IO, Any, cast

import numpy as np

from echelon.arrays import Floats
from echelon.errors import InputError, one_line
from echelon.inputs import COLUMNS, LINE, check_unpacked
from echelon.logs.files.log_file import CHUNK, Table, decoding, existing_file, selected

_DELIMITERS = ("\t", ";", ",", None)
_MISSING = frozenset({"", "nan", "na", "n/a", "null", "none"})
_TRUTH = {"true": 1.0, "false": 0.0}
_NUMBER = re.compile(r"[+-]?(?:(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?|inf(?:inity)?|nan)", re.ASCII | re.IGNORECASE)

_COMMENT = re.compile(rb"^[ \t]*#[^\n]*", re.MULTILINE)
_DATE = re.compile(r"\d+[-/.]\d+[-/.]\d+|\d+:\d\d")
_STAMP = re.compile(
    r"(?:(\d{4})[-/](\d\d)[-/](\d\d)[T ])?(\d\d?):(\d\d):(\d\d)(?:[.,](\d+))? ?(?:Z|UTC|([+-]\d\d):?(\d\d))?",
    re.ASCII | re.IGNORECASE,
)
_LIST = re.compile(rb'"?\[([^\[\]]*)\]"?')
_NULLS = ["", "nan", "NaN", "NAN", "NA", "N/A", "null", "NULL", "None"]
_SHOWN = 40
_FEW = 0.01
"""Share of the rows of a piece that may be garbage; of more, the file is of another layout."""
_ENOUGH = 10
"""Rows before one that is cut off, such as the last one of a recorder that was stopped."""
_SNIFFED = 50
_PREAMBLE = 100_000
_AT_ONCE = 1 << 26
_BLOCK = 1 << 20
_MARK = b"\xef\xbb\xbf"
_EPOCH = date(1970, 1, 1).toordinal()


@dataclass(frozen=True)
class Dialect:
    """The layout of a text file."""

    delimiter: str | None  # between cells; None for any amount of white space
    names: tuple[str, ...]  # of the columns
    start: int  # lines before the first row of numbers
    stamps: frozenset[int] = frozenset()  # columns of times such as 12:30:00.25
    origin: int = 0  # second from which these count
    vectors: bool = False  # whether cells hold lists, ``[0.1, 0.2]``, whose entries are columns

    @property
    def decimal_comma(self) -> bool:
        """Whether a comma inside a cell is a decimal point."""
        return self.delimiter != ","


def cells(line: str, delimiter: str | None) -> list[str]:
    """A line's cells, without quotes and surrounding blanks."""
    text = line.strip("\r\n")
    if '"' not in text:
        return text.split() if delimiter is None else [cell.strip() for cell in text.split(delimiter)]
    if delimiter is None:
        text, delimiter = text.replace("\t", " ").strip(), " "
    try:
        rows = list(csv.reader([text], delimiter=delimiter, skipinitialspace=True, strict=False))
    except csv.Error as error:
        raise InputError(f"its quotes cannot be read: {error}") from None
    return [cell.strip() for cell in rows[0]] if rows else [""]


def number(cell: str) -> float | None:
    """The value of a cell with a decimal point, NaN where there is none, or None for what is no number."""
    word = cell.strip().lower()
    if word in _MISSING:
        return float("nan")
    if word in _TRUTH:
        return _TRUTH[word]
    return float(word) if _NUMBER.fullmatch(word) else None


def stamp(cell: str) -> tuple[int, float] | None:
    """Whole seconds and their fraction of a time such as ``2026-05-01T12:30:00.25+02:00`` or ``12:30:00``."""
    found = _STAMP.fullmatch(cell)
    if found is None:
        return None
    year, month, day, hour, minute, second, fraction, zone, rest = found.groups()
    try:
        days = date(int(year), int(month), int(day)).toordinal() - _EPOCH if year else 0
    except ValueError:
        return None
    east = 60 * (60 * int(zone) + int(zone[0] + rest)) if zone else 0
    whole = 86400 * days + 3600 * int(hour) + 60 * int(minute) + int(second) - east
    return whole, float(f"0.{fraction or 0}")


def is_blank(line: str) -> bool:
    """Whether a line holds nothing, or a comment."""
    return not line.strip(" \r\n") or line.lstrip().startswith("#")


def sniff(lines: list[str], source: str) -> Dialect:
    """The layout of a file from its first lines.

    Names stand in the first line, if that holds anything but numbers, or in the comment right above the numbers, if
    that has as many cells; otherwise columns are numbered from 0.
    """
    content = [index for index, line in enumerate(lines) if not is_blank(line)]
    if not content:
        raise InputError("holds no numbers: all lines are blank or comments", source=source)
    first = content[0]
    delimiter = _delimiter([lines[index] for index in content])
    row = cells(lines[first], delimiter)
    COLUMNS.check(len(row), source, f"line {first + 1}")
    usual = cells(lines[content[len(content) // 2]], delimiter)
    begun = {k: found for k, cell in enumerate(usual) if (found := stamp(cell))}
    times = frozenset(begun), min((whole for whole, _ in begun.values()), default=0)
    if any(_value(cell, delimiter) is None for cell in row):
        names = _names(row, source, first)
        if any(cell.startswith("[") for cell in usual) and len(usual) == len(names):
            entries = [len(_LIST.sub(_flat(" "), cell.encode()).split()) for cell in usual]
            pairs = zip(names, usual, entries, strict=True)
            names = tuple(f"{n}[{k}]" if c.startswith("[") else n for n, c, count in pairs for k in range(count))
            return Dialect(delimiter, names, first + 1, *times, vectors=True)
        return Dialect(delimiter, names, first + 1, *times)
    above = lines[first - 1].strip().lstrip("#").strip() if first else ""
    titles = cells(above, delimiter)
    if above and len(titles) == len(row) and any(_value(cell, delimiter) is None for cell in titles):
        return Dialect(delimiter, _names(titles, source, first - 1), first, *times)
    return Dialect(delimiter, tuple(str(index) for index in range(len(row))), first, *times)


def _flat(delimiter: str | None) -> Callable[[re.Match[bytes]], bytes]:
    """Writes a list as cells of its own."""
    return lambda found: (delimiter or " ").encode().join(found.group(1).replace(b",", b" ").split())


def _delimiter(lines: list[str]) -> str | None:
    """The delimiter that makes all lines equally long and the last one numbers; failing that, equally long."""
    even = []
    for delimiter in _DELIMITERS:
        rows = [cells(line, delimiter) for line in lines]
        if len(rows[0]) > 1 and len({len(row) for row in rows}) == 1:
            even.append(delimiter)
            if all(_value(cell, delimiter) is not None for cell in rows[-1]):
                return delimiter
    if even:
        return even[0]
    # ragged lines, or a single column: what cuts the first line most often
    return max(_DELIMITERS, key=lambda delimiter: (len(cells(lines[0], delimiter)), delimiter == ","))


def _value(cell: str, delimiter: str | None) -> float | None:
    value = number(cell if delimiter == "," else cell.replace(",", "."))
    return 0.0 if value is None and stamp(cell) else value


def _names(row: list[str], source: str, line: int) -> tuple[str, ...]:
    """Names of columns; one without a name goes by its number."""
    names = tuple(one_line(cell) or str(index) for index, cell in enumerate(row))
    first: dict[str, int] = {}
    for index, name in enumerate(names):
        if first.setdefault(name, index) != index:
            problem = f"columns {first[name]} and {index} have the same name; rename one"
            raise InputError(problem, source=source, element=f"line {line + 1}, column '{name}'")
    return names


@dataclass(frozen=True)
class BlockParser:
    """Parses blocks of lines of one file."""

    source: str  # name of the file
    dialect: Dialect
    picked: tuple[int, ...]  # columns whose numbers are wanted; the cells of the others may hold anything

    def parse(self, lines: Sequence[bytes], line: int, before: int = 0) -> tuple[list[Floats], list[InputError]]:
        """The picked columns of lines, the first of them number ``line``, and what is wrong with rows left out.

        Blank lines and comments give no row.  Rows are left out if they are few beside these and those ``before``, or
        if the last one is cut off.
        """
        if self.dialect.vectors:
            lines = [_LIST.sub(_flat(self.dialect.delimiter), line) for line in lines]
        text = b"\n".join(lines)
        if b"#" in text:
            text = _COMMENT.sub(b"", text)
        if self.dialect.decimal_comma:
            text = text.replace(b",", b".")
        if not text.strip():
            return [np.empty(0) for _ in self.picked], []
        columns = self._by_arrow(text)
        return (columns, []) if columns is not None else self._by_cells(lines, line, before)

    def _by_arrow(self, text: bytes) -> list[Floats] | None:
        """Columns of clean text through pyarrow, or through numpy if it is not installed or cannot cut the lines."""
        if self.dialect.delimiter is None:
            return self._by_numpy(text)
        try:
            from pyarrow import ArrowException, BufferReader, csv, float64, string
        except ImportError:
            return self._by_numpy(text)
        wanted = [str(index) for index in self.picked]
        kinds = {str(index): string() if index in self.dialect.stamps else float64() for index in self.picked}
        try:
            table = csv.read_csv(
                BufferReader(text),
                csv.ReadOptions(column_names=[str(index) for index in range(len(self.dialect.names))]),
                csv.ParseOptions(delimiter=self.dialect.delimiter),
                csv.ConvertOptions(column_types=kinds, include_columns=wanted, null_values=_NULLS),
            )
            return [self._numbers(table.column(name)) for name in wanted]
        except (ArrowException, TypeError):
            return None

    def _numbers(self, column: Any) -> Floats:
        """Numbers, or times in seconds; what is no time is a TypeError."""
        if str(column.type) == "string":
            found = [stamp(cell) for cell in column.to_pylist()]
            return np.array([whole - self.dialect.origin + fraction for whole, fraction in found])  # type: ignore[misc]
        return np.asarray(column.to_numpy(), dtype=np.float64)

    def _by_numpy(self, text: bytes) -> list[Floats] | None:
        try:
            stream = io.StringIO(text.decode("ascii"))
            rows = np.loadtxt(stream, delimiter=self.dialect.delimiter, comments=None, ndmin=2, quotechar='"')
        except ValueError:
            return None
        if rows.shape[1] != len(self.dialect.names):
            return None
        return [np.ascontiguousarray(rows[:, index]) for index in self.picked]

    def _by_cells(self, lines: Sequence[bytes], line: int, before: int) -> tuple[list[Floats], list[InputError]]:
        rows: list[list[float]] = []
        wrong: list[InputError] = []
        for current, raw in enumerate(lines, start=line):
            text = raw.decode("utf-8", errors="replace")
            if is_blank(text):
                continue
            try:
                row = self._row(text, current)
                rows.append([self._number(row[index], current, index) for index in self.picked])
            except InputError as error:
                wrong.append(error)
        count = before + len(rows)
        cut_off = bool(wrong) and wrong[-1].element == f"line {line + len(lines) - 1}"
        if len(wrong) - cut_off > _FEW * count or (wrong and count < _ENOUGH):
            raise wrong[0]
        table = np.array(rows).reshape(len(rows), len(self.picked))
        return [np.ascontiguousarray(column) for column in table.T], wrong

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
        if value is None and (found := stamp(cell)):
            return found[0] - self.dialect.origin + found[1]
        if value is None:
            shown = one_line(cell if len(cell) <= _SHOWN else cell[:_SHOWN] + "…")
            where = f"line {line}, column '{self.dialect.names[column]}'"
            hint = "; write times as numbers or as 2026-05-01T12:30:00.25" if _DATE.match(cell) else ""
            raise InputError(f"'{shown}' is not a number{hint}", source=self.source, element=where)
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
        self._dialect = sniff(self._first_lines(), self.source)
        self.names: tuple[str, ...] = self._dialect.names

    def tables(self, names: Sequence[str] | None = None, rows: int = CHUNK) -> Iterator[Table]:
        """Pieces of the file with ``rows`` lines, or fewer where lines are long."""
        chosen = selected(self.source, names, self.names)
        place = {name: index for index, name in enumerate(self.names)}
        parser = BlockParser(self.source, self._dialect, tuple(place[name] for name in chosen))
        first, line = 0, self._dialect.start + 1
        for lines in self._pieces(rows, self._dialect.start):
            columns, wrong = parser.parse(lines, line, first)
            length = len(columns[0]) if columns else 0
            if length:
                left_out = tuple(f"{error.element}: {error.problem}" for error in wrong)
                yield Table(self.source, dict(zip(chosen, columns, strict=True)), first=first, left_out=left_out)
            first, line = first + length, line + len(lines)
        if chosen and not first:
            raise InputError("holds the names of columns but no numbers", source=self.source)

    def _pieces(self, rows: int, skipped: int) -> Iterator[list[bytes]]:
        """Lines behind the first ones: ``rows`` at once, or as many as fit into the memory set aside."""
        waiting: list[bytes] = []
        size = 0
        for lines in self._blocks():
            size += _BLOCK
            waiting += lines[skipped:]
            skipped -= min(skipped, len(lines))
            whole = len(waiting) - len(waiting) % rows if size < _AT_ONCE else len(waiting)
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
            while block := stream.read(_BLOCK):
                check_unpacked(stream.tell() if self._packed else 0, self._packed)
                *lines, rest = (rest + block.removeprefix(mark)).split(b"\n")
                LINE.check(len(lines[0] if lines else rest))  # the others are shorter than the block
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
            if content == _SNIFFED or size > _AT_ONCE or len(lines) == _PREAMBLE:
                break
        self._check_text(lines)
        return [_decoded(line) for line in lines]

    def _check_text(self, lines: list[bytes]) -> None:
        start = b"\n".join([*lines, b""])
        if b"\0" in start:
            raise InputError("is not text, although its name says so", source=self.source)
        if b"\r" in start.replace(b"\r\n", b""):
            raise InputError("has carriage returns inside lines; end lines with a line feed", source=self.source)


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
    return cast("IO[bytes]", codecs.EncodedFile(stream, "utf-8", "utf-16")) if is_wide else stream
