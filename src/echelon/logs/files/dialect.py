"""How a text file is laid out: its delimiter, the names of its columns, and where the numbers begin.

Guessed from the first lines rather than asked for: a delimiter is right if it cuts all of them into equally many cells
and turns the last one into numbers.  Tabs and semicolons are tried before commas, because beside them commas are
decimal.
"""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass

from echelon.errors import InputError, one_line
from echelon.inputs.limits import COLUMNS

_DELIMITERS = ("\t", ";", ",", None)
_MISSING = frozenset({"", "nan", "na", "n/a", "null", "none"})
_TRUTH = {"true": 1.0, "false": 0.0}
_NUMBER = re.compile(r"[+-]?(?:(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?|inf(?:inity)?|nan)", re.ASCII | re.IGNORECASE)


@dataclass(frozen=True)
class Dialect:
    """The layout of a text file.

    Attributes
    ----------
    delimiter : str, optional
        Between cells; None for any amount of white space.
    names : tuple of str
        Of the columns.
    start : int
        Lines before the first row of numbers.
    """

    delimiter: str | None
    names: tuple[str, ...]
    start: int

    @property
    def decimal_comma(self) -> bool:
        """Whether a comma inside a cell is a decimal point."""
        return self.delimiter != ","


def cells(line: str, delimiter: str | None) -> list[str]:
    """A line's cells, without quotes and surrounding blanks.

    Parameters
    ----------
    line : str
    delimiter : str or None
        As of :class:`Dialect`.

    Raises
    ------
    InputError
        If quotes do not close.

    Examples
    --------
    >>> cells(' 1.5, "left, upper" ,', ",")
    ['1.5', 'left, upper', '']
    """
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
    """The value of a cell, NaN where there is none, or None for what is no number.

    Parameters
    ----------
    cell : str
        With a decimal point.

    Examples
    --------
    >>> number("-1.5e-3"), number(""), number("true"), number("1_000")
    (-0.0015, nan, 1.0, None)
    """
    word = cell.strip().lower()
    if word in _MISSING:
        return float("nan")
    if word in _TRUTH:
        return _TRUTH[word]
    return float(word) if _NUMBER.fullmatch(word) else None


def is_blank(line: str) -> bool:
    """Whether a line holds nothing, or a comment.

    Parameters
    ----------
    line : str
    """
    return not line.strip(" \r\n") or line.lstrip().startswith("#")


def sniff(lines: list[str], source: str) -> Dialect:
    """The layout of a file from its first lines.

    Names stand in the first line, if that holds anything but numbers, or in the comment right above the numbers, if
    that has as many cells; otherwise columns are numbered from 0.

    Parameters
    ----------
    lines : list of str
        The first lines of the file, all of them complete.
    source : str
        Name of the file.

    Raises
    ------
    InputError
        If there is no line to judge by, or two columns share a name.

    Examples
    --------
    >>> sniff(["t; q1", "0,5; 1,25"], "run.csv")
    Dialect(delimiter=';', names=('t', 'q1'), start=1)
    """
    content = [index for index, line in enumerate(lines) if not is_blank(line)]
    if not content:
        raise InputError("holds no numbers: all lines are blank or comments", source=source)
    first = content[0]
    delimiter = _delimiter([lines[index] for index in content])
    row = cells(lines[first], delimiter)
    COLUMNS.check(len(row), source, f"line {first + 1}")
    if any(_value(cell, delimiter) is None for cell in row):
        return Dialect(delimiter, _names(row, source, first), first + 1)
    above = lines[first - 1].strip().lstrip("#").strip() if first else ""
    titles = cells(above, delimiter)
    if above and len(titles) == len(row) and any(_value(cell, delimiter) is None for cell in titles):
        return Dialect(delimiter, _names(titles, source, first - 1), first)
    return Dialect(delimiter, tuple(str(index) for index in range(len(row))), first)


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
    return number(cell if delimiter == "," else cell.replace(",", "."))


def _names(row: list[str], source: str, line: int) -> tuple[str, ...]:
    """Names of columns; one without a name goes by its number."""
    names = tuple(one_line(cell) or str(index) for index, cell in enumerate(row))
    first: dict[str, int] = {}
    for index, name in enumerate(names):
        if first.setdefault(name, index) != index:
            problem = f"columns {first[name]} and {index} have the same name; rename one"
            raise InputError(problem, source=source, element=f"line {line + 1}, column '{name}'")
    return names
