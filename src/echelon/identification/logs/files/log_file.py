"""Files of logs: named columns of numbers, and errors that name the file.

The packages that decode files raise whatever their parsers stumble over when a file is cut off or damaged: assertions,
struct errors, look-ups of keys.  A list of them would never be complete, so :func:`decoding` takes every exception that
arises while a file's content is decoded for what it is: a file that cannot be read.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Protocol, runtime_checkable

from echelon.shared import (
    EchelonError,
    Floats,
    InputError,
    nearest,
    nearest_of,
    one_line,
    shortened,
)

CHUNK = 1 << 17
"""Rows that are read at once from a file that can be read in pieces."""

HEAD = 32
"""Rows, or messages of a topic, by which the layout of a file is judged."""

_NOTHING: Mapping[str, str] = {}


@dataclass(frozen=True)
class Table:
    """Columns of numbers."""

    source: str  # name of the file, for messages
    # shape (N,); by name.  A vector per row is one column per entry: ``positions[0]``, ``positions[1]``, …
    columns: Mapping[str, Floats]
    # column → the column with its time stamps, where the file says so: messages of a bag arrive topic by topic, so
    # their columns have lengths and clocks of their own.  All other columns have one length and share one clock.  The
    # clock of a clock is the column of times that a set-up knows it by
    clocks: Mapping[str, str] = field(default_factory=dict)
    first: int = 0  # row of the file with which the table begins, for messages
    left_out: tuple[
        str, ...
    ] = ()  # rows that cannot be read, with their lines and reasons; they are not counted


class LogFile(Protocol):
    """A file that is open for reading."""

    source: str  # name of the file
    names: tuple[str, ...]  # its columns, without reading their values

    def tables(
        self, names: Sequence[str] | None = None, rows: int = CHUNK
    ) -> Iterator[Table]:
        """The content in pieces of at most ``rows`` rows, in order; files that cannot be cut come as one piece."""
        ...


@runtime_checkable
class WordedFile(LogFile, Protocol):
    """A file that may hold words beside numbers."""

    worded: tuple[str, ...]  # its columns of words

    def words(self, name: str, rows: int = CHUNK) -> Iterator[list[str]]:
        """A column of words, in the pieces of :meth:`tables`."""
        ...


_SECONDS = re.compile(r"(.*[^A-Za-z]|)secs?", re.IGNORECASE)


def with_stamps(file: LogFile) -> LogFile:
    """The file with one column of times for whole seconds and nanoseconds in two, as messages of ROS have them."""
    for name in file.names:
        before = _SECONDS.fullmatch(name)
        for word in ("nanosec", "nsec", "nsecs", "nanosecs") if before else ():
            rest = f"{before[1]}{word}"  # type: ignore[index]
            if rest in file.names:
                return StampedFile(file, name, rest)
    return file


class StampedFile:
    """A file whose times stand in two columns."""

    def __init__(self, file: LogFile, seconds: str, rest: str) -> None:
        self.source, self._file, self._parts = file.source, file, (seconds, rest)
        self._stamp = f"{seconds.rstrip('secSEC')}time [s]"
        self.names: tuple[str, ...] = (self._stamp, *file.names)

    def tables(
        self, names: Sequence[str] | None = None, rows: int = CHUNK
    ) -> Iterator[Table]:
        """Pieces of the file."""
        chosen = selected(self.source, names, self.names)
        parts = self._parts if self._stamp in chosen else ()
        for table in self._file.tables(
            [*parts, *(name for name in chosen if name != self._stamp)], rows
        ):
            columns = dict(table.columns)
            if parts:
                columns[self._stamp] = columns[parts[0]] + 1e-9 * columns[parts[1]]
            yield replace(table, columns={name: columns[name] for name in chosen})


def existing_file(path: str | os.PathLike[str]) -> Path:
    """A path at which a file with content can be read; an error says why not, and which file was probably meant."""
    found, source = Path(path), os.fspath(path)
    if os.path.isdir(found):
        raise InputError("is a directory; name a file in it", source=source)
    if os.path.exists(found) and not os.path.isfile(found):
        raise InputError(
            "is a pipe or a device, which cannot be read twice; save it to a file first",
            source=source,
        )
    try:
        with found.open("rb") as stream:
            content = stream.read(1)
    except FileNotFoundError:
        raise InputError(f"no such file{_neighbour(found)}", source=source) from None
    except (OSError, ValueError) as error:  # ValueError: a name that no system allows
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"cannot be read: {reason}", source=one_line(source)) from None
    if not content:
        raise InputError("is empty", source=source)
    return found


@contextmanager
def decoding(source: str, kind: str, advice: str = "") -> Iterator[None]:
    """Any exception of another package's decoder becomes one error that names the file, its kind and what to do."""
    try:
        yield
    except InputError as error:
        raise error.located(source) from None
    except EchelonError:
        raise
    except PermissionError as error:
        raise InputError(f"cannot be read: {error.strerror}", source=source) from None
    except Exception as error:  # see the head of this file
        reason = shortened(str(error).strip(), 160).rstrip(".") or type(error).__name__
        problem = f"cannot be read as {kind}; it is damaged or was cut off ({reason})"
        raise InputError(
            f"{problem}; {advice}" if advice else problem, source=source
        ) from error


def _neighbour(path: Path) -> str:
    """A question for the file beside it that was probably meant."""
    try:
        return nearest(path.name, sorted(entry.name for entry in path.parent.iterdir()))
    except OSError:
        return ""


def selected(
    source: str,
    asked: Sequence[str] | None,
    names: Sequence[str],
    left_out: Mapping[str, str] = _NOTHING,
) -> tuple[str, ...]:
    """The columns to read, each once; all if none were asked for.  ``left_out`` says why the others are none."""
    if asked is None:
        return tuple(names)
    known = set(names)
    for name in asked:
        if name not in known:
            raise missing(source, name, names, left_out)
    return tuple(dict.fromkeys(asked))


def missing(
    source: str, name: str, names: Sequence[str], left_out: Mapping[str, str] = _NOTHING
) -> InputError:
    """The error for a column that the file does not have, or cannot give."""
    for part, reason in left_out.items():
        if name == part or re.match(re.escape(part) + r"[\[./]", name):
            return InputError(reason, source=source, element=f"column '{name}'")
    inside = [
        other
        for other in names
        if other.startswith((f"{name}[", f"{name}.", f"{name}/"))
    ]
    if inside:
        problem = f"has {len(inside)} columns; name one of them, such as '{inside[0]}'"
        return InputError(problem, source=source, element=f"column '{name}'")
    return InputError(
        f"no such column{nearest_of(name, names)}",
        source=source,
        element=f"column '{name}'",
    )
