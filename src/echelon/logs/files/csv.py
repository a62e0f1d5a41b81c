"""Text files: CSV and its relatives, with commas, semicolons, tabs or blanks, compressed by gzip or not.

Read in pieces, so that a file may be larger than memory.
"""

from __future__ import annotations

import gzip
import os
from collections.abc import Iterator, Sequence
from itertools import chain
from pathlib import Path
from typing import IO, cast

from echelon.errors import InputError
from echelon.inputs.limits import LINE, check_unpacked
from echelon.logs.files.access import decoding, existing_file
from echelon.logs.files.dialect import sniff
from echelon.logs.files.selection import selected
from echelon.logs.files.text_blocks import BlockParser
from echelon.logs.table import CHUNK, Table

_SNIFFED = 50
_PREAMBLE = 100_000
_AT_ONCE = 1 << 26
_BLOCK = 1 << 20
_MARK = b"\xef\xbb\xbf"


class CsvFile:
    r"""A text file with a row of cells per line.

    Names stand in the first line or in the comment right above the numbers; without them columns are named ``0``,
    ``1``, ….  Lines that begin with ``#`` are comments.  Empty cells, ``nan`` and ``NA`` are missing values, NaN;
    ``true`` and ``false`` are 1 and 0.  Where cells are not cut by commas, a comma is a decimal point.

    Parameters
    ----------
    path : path
        UTF-8; compressed if the name ends in ``.gz``.

    Attributes
    ----------
    source : str
    names : tuple of str
        As of :class:`echelon.logs.table.LogFile`.

    Raises
    ------
    InputError
        If the file cannot be read, is no text, or holds no numbers.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.NamedTemporaryFile("w", suffix=".csv", delete=False) as file:
    ...     _ = file.write("t,q1\n0.0,1.5\n0.1,\n")
    >>> (table,) = CsvFile(file.name).tables()
    >>> dict(table.columns)
    {'t': array([0. , 0.1]), 'q1': array([1.5, nan])}
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._path = existing_file(path)
        self.source = os.fspath(path)
        self._packed = self._path.stat().st_size if _is_packed(self._path) else 0
        self._dialect = sniff(self._first_lines(), self.source)
        self.names: tuple[str, ...] = self._dialect.names

    def tables(self, names: Sequence[str] | None = None, rows: int = CHUNK) -> Iterator[Table]:
        """Pieces of the file, as :meth:`echelon.logs.table.LogFile.tables` describes.

        Parameters
        ----------
        names : sequence of str, optional
            Columns to read; all if omitted.
        rows : int
            Lines that are read at once; less where they are long.

        Raises
        ------
        InputError
            If a column is missing, a line has too many or too few cells, or a cell holds no number.
        """
        chosen = selected(self.source, names, self.names)
        place = {name: index for index, name in enumerate(self.names)}
        parser = BlockParser(self.source, self._dialect, tuple(place[name] for name in chosen))
        first, line = 0, self._dialect.start + 1
        for lines in self._pieces(rows, self._dialect.start):
            columns = parser.parse(lines, line)
            length = len(columns[0]) if columns else 0
            if length:
                yield Table(self.source, dict(zip(chosen, columns, strict=True)), first=first)
            first, line = first + length, line + len(lines)
        if chosen and not first:
            raise InputError("holds the names of columns but no numbers", source=self.source)

    def _pieces(self, rows: int, skipped: int) -> Iterator[list[bytes]]:
        """Lines behind the first ones: so many at once, or as many as fit into the memory set aside."""
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
        return [self._decoded(line, number) for number, line in enumerate(lines, start=1)]

    def _check_text(self, lines: list[bytes]) -> None:
        start = b"\n".join([*lines, b""])
        if start[:2] in (b"\xff\xfe", b"\xfe\xff"):
            raise InputError("is UTF-16 text; save it as UTF-8", source=self.source)
        if b"\0" in start:
            raise InputError("is no text, though its name says so", source=self.source)
        if b"\r" in start.replace(b"\r\n", b""):
            raise InputError("has carriage returns inside lines; end lines with a line feed", source=self.source)

    def _decoded(self, line: bytes, number: int) -> str:
        try:
            return line.decode("utf-8")
        except UnicodeDecodeError as error:
            problem = f"byte {line[error.start]:#04x} is no UTF-8 text; save the file as UTF-8"
            raise InputError(problem, source=self.source, element=f"line {number}") from None


def _is_packed(path: Path) -> bool:
    return path.suffix.lower() == ".gz"


def _opened(path: Path) -> IO[bytes]:
    if _is_packed(path):
        return cast("IO[bytes]", gzip.open(path, "rb"))
    return path.open("rb")
