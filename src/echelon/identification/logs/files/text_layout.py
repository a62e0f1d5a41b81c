"""The layout of text files: delimiter, names of columns, units, times, comments.

It is found from the first lines rather than asked for: a delimiter is right if it cuts all of them into equally many
cells and turns the last one into numbers; or the later half of them, below what a program wrote about the run.  Tabs
and semicolons are tried before commas, because beside them commas are decimal.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import date
from itertools import groupby

from echelon.identification.logs.units import fits
from echelon.shared import COLUMNS, InputError, one_line

_DELIMITERS = ("\t", ";", ",", "|", None)
_MISSING = frozenset({"", "-", "nan", "na", "n/a", "#n/a", "null", "none"})
_TRUTH = {"true": 1.0, "false": 0.0}
_NUMBER = re.compile(
    r"[+-]?(?:(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?|inf(?:inity)?|nan)",
    re.ASCII | re.IGNORECASE,
)

_MARKS = r"#|//|%(?!\w)"  # of comments; %time is a name
COMMENT = re.compile(rf"^[ \t]*(?:{_MARKS})[^\n]*".encode(), re.MULTILINE)
_DAYS = r"(?P<y>\d{4})[-/](?P<m>\d\d)[-/](?P<d>\d\d)|(?P<day>\d\d?)\.(?P<month>\d\d?)\.(?P<year>\d{4})"
_STAMP = re.compile(
    rf"(?:(?:{_DAYS})[T ])?(\d\d?):(\d\d):(\d\d)(?:[.,](\d+))? ?(?:Z|UTC|([+-]\d\d):?(\d\d))?",
    re.ASCII | re.IGNORECASE,
)
LIST = re.compile(rb'"?[\[(]([^\[\]()]*)[\])]"?')
_EPOCH = date(1970, 1, 1).toordinal()


@dataclass(frozen=True)
class Dialect:
    """The layout of a text file."""

    delimiter: str | None  # between cells; None for any amount of white space
    names: tuple[str, ...]  # of the columns
    start: int  # lines before the first row of numbers
    stamps: frozenset[int] = frozenset()  # columns of times such as 12:30:00.25
    origin: int = 0  # second from which these count
    vectors: bool = (
        False  # whether cells hold lists, ``[0.1, 0.2]``, whose entries are columns
    )
    units: tuple[
        str, ...
    ] = ()  # of the columns, where a line below the names states them

    @property
    def decimal_comma(self) -> bool:
        """Whether a comma inside a cell is a decimal point."""
        return self.delimiter != ","


def cells(line: str, delimiter: str | None) -> list[str]:
    """A line's cells, without quotes and surrounding blanks."""
    text = line.strip("\r\n")
    if '"' not in text:
        if delimiter is None:
            return text.split()
        return [cell.strip() for cell in text.split(delimiter)]
    if delimiter is None:
        text, delimiter = text.replace("\t", " ").strip(), " "
    try:
        rows = list(
            csv.reader([text], delimiter=delimiter, skipinitialspace=True, strict=False)
        )
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
    hour, minute, second, fraction, zone, rest = found.groups()[6:]
    year, month, day = (
        found[long] or found[short]
        for long, short in (("y", "year"), ("m", "month"), ("d", "day"))
    )
    try:
        days = date(int(year), int(month), int(day)).toordinal() - _EPOCH if year else 0
    except ValueError:
        return None
    east = 60 * (60 * int(zone) + int(zone[0] + rest)) if zone else 0
    whole = 86400 * days + 3600 * int(hour) + 60 * int(minute) + int(second) - east
    return whole, float(f"0.{fraction or 0}")


def is_blank(line: str) -> bool:
    """Whether a line holds nothing, or a comment."""
    return not line.strip(" \r\n") or re.match(_MARKS, line.lstrip()) is not None


def sniff(lines: list[str], source: str) -> Dialect:
    """The layout of a file from its first lines.

    Names stand in the last line without numbers above the rows that has as many cells, or in the comment right above
    the rows; otherwise columns are numbered from 0.  Between names and rows there may be a line of units.
    """
    content = [index for index, line in enumerate(lines) if not is_blank(line)]
    if not content:
        raise InputError(
            "holds no numbers: all lines are blank or comments", source=source
        )
    delimiter = _delimiter([lines[index] for index in content])
    COLUMNS.check(
        len(cells(lines[content[0]], delimiter)), source, f"line {content[0] + 1}"
    )
    table = [cells(lines[index], delimiter) for index in content]
    usual = table[len(table) // 2]
    begun = {k: found for k, cell in enumerate(usual) if (found := stamp(cell))}
    times = frozenset(begun), min((whole for whole, _ in begun.values()), default=0)
    head = _head(table, usual, delimiter)
    if head is None:
        first = content[0]
        above = (
            re.sub(rf"^(?:{_MARKS})+", "", lines[first - 1].strip()).strip()
            if first
            else ""
        )
        titles = cells(above, delimiter)
        if (
            above
            and len(titles) == len(usual)
            and any(_value(cell, delimiter) is None for cell in titles)
        ):
            return Dialect(delimiter, _names(titles, source, first - 1), first, *times)
        return Dialect(
            delimiter,
            tuple(str(index) for index in range(len(table[0]))),
            first,
            *times,
        )
    names = _names(_titles(table, head, usual), source, content[head])
    if any(cell[:1] in ("[", "(") for cell in usual) and len(usual) == len(names):
        entries = [
            len(LIST.sub(flat(" "), cell.encode()).split())
            if cell[:1] in ("[", "(")
            else 0
            for cell in usual
        ]
        pairs = zip(names, entries, strict=True)
        names = tuple(
            name
            for n, count in pairs
            for name in ([f"{n}[{k}]" for k in range(count)] if count else [n])
        )
        return Dialect(delimiter, names, content[head] + 1, *times, vectors=True)
    below = table[head + 1] if head + 1 < len(table) else []
    if len(below) == len(names) and _are_units(below):
        return Dialect(
            delimiter,
            names,
            content[head + 1] + 1,
            *times,
            units=tuple(map(_bare, below)),
        )
    return Dialect(delimiter, names, content[head] + 1, *times)


def _head(
    table: Sequence[Sequence[str]], usual: Sequence[str], delimiter: str | None
) -> int | None:
    """The row of a table that holds the names of its columns; None if it begins with numbers."""
    told = [k for k, cell in enumerate(usual) if _value(cell, delimiter) is not None]

    def is_data(row: Sequence[str]) -> bool:
        return (
            len(row) == len(usual)
            and bool(told)
            and all(_value(row[k], delimiter) is not None for k in told)
        )

    first = next((k for k, row in enumerate(table) if is_data(row)), len(table))
    fitting = [k for k in range(first) if len(table[k]) in (len(usual), len(usual) - 1)]
    plain = [
        k
        for k in fitting
        if all(not cell or _value(cell, delimiter) is None for cell in table[k])
    ]
    plain = [
        k for k in plain if any(table[k]) and (len(table[k]) > 1 or len(usual) == 1)
    ]
    if len(plain) > 1 and plain[-1] == plain[-2] + 1 and _are_units(table[plain[-1]]):
        return plain[-2]
    if plain:
        return plain[-1]
    if is_data(table[0]):  # words may stand in it, as they do in the rows below
        return None
    return 0 if any(_value(cell, delimiter) is None for cell in table[0]) else None


def _titles(
    table: Sequence[Sequence[str]], head: int, usual: Sequence[str]
) -> list[str]:
    """The names in a row, with a cell for every column; where several share one, with those above and below it."""
    row = list(table[head])
    if (
        len(row) == len(usual) - 1
    ):  # as R writes names of rows, and others a delimiter at the end
        row = [*row, ""] if not usual[-1] else ["", *row]
    below = table[head + 1] if head + 1 < len(table) else []
    if (
        _repeats(row)
        and len(row) == len(below)
        and any(cell and number(cell) is None for cell in below)
    ):
        row = _under(row, below)
    for above in reversed(table[:head]):
        if not _repeats(row) or len(above) != len(row):
            break
        row = _under(above, row)
    return row


def _repeats(row: Sequence[str]) -> bool:
    return len(set(row)) < len(row)


def _under(upper: Sequence[str], lower: Sequence[str]) -> list[str]:
    return [
        f"{above}/{below}" if above and below else above or below
        for above, below in zip(upper, lower, strict=True)
    ]


def _are_units(row: Sequence[str]) -> bool:
    """Whether all cells of a row are units, and one of them more than the number 1."""
    told = [unit for cell in row if (unit := _bare(cell))]
    return all(fits(unit, None) for unit in told) and any(
        number(unit) is None for unit in told
    )


def _bare(cell: str) -> str:
    """A unit without brackets and dashes around it."""
    return cell.strip("[]()<> -")


def flat(delimiter: str | None) -> Callable[[re.Match[bytes]], bytes]:
    """Writes a list as cells of its own."""
    return lambda found: (
        (delimiter or " ").encode().join(found.group(1).replace(b",", b" ").split())
    )


def _delimiter(lines: list[str]) -> str | None:
    """The delimiter that makes all lines equally long and the last one numbers; failing that, equally long."""
    for some in (lines, lines[len(lines) // 2 :]):
        even = []
        for delimiter in _DELIMITERS:
            rows = [cells(line, delimiter) for line in some]
            if len(rows[0]) > 1 and len({len(row) for row in rows}) == 1:
                even.append(delimiter)
                if all(_value(cell, delimiter) is not None for cell in rows[-1]):
                    return delimiter
        if even:
            return even[0]
    # ragged lines, or a single column: what cuts the first line most often
    return max(
        _DELIMITERS,
        key=lambda delimiter: (len(cells(lines[0], delimiter)), delimiter == ","),
    )


def _value(cell: str, delimiter: str | None) -> float | None:
    value = number(cell if delimiter == "," else cell.replace(",", "."))
    return 0.0 if value is None and stamp(cell) else value


def _names(row: list[str], source: str, line: int) -> tuple[str, ...]:
    """Names of columns; one without a name goes by its number, and neighbours of one name are a vector."""
    plain = [one_line(cell) or str(index) for index, cell in enumerate(row)]
    names = [
        f"{name}[{k}]" if len(same) > 1 else name
        for name, same in ((name, list(some)) for name, some in groupby(plain))
        for k in range(len(same))
    ]
    first: dict[str, int] = {}
    for index, name in enumerate(names):
        if first.setdefault(name, index) != index:
            problem = (
                f"columns {first[name]} and {index} have the same name; rename one"
            )
            raise InputError(
                problem, source=source, element=f"line {line + 1}, column '{name}'"
            )
    return tuple(names)
