"""What a file of a log holds: named columns of numbers, before anyone says what they mean."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from echelon.arrays import Floats

CHUNK = 1 << 17
"""Rows that are read at once from a file that can be read in pieces."""


@dataclass(frozen=True)
class Table:
    """Columns of numbers.

    Attributes
    ----------
    source : str
        Name of the file, for messages.
    columns : mapping of str to array of shape (N,)
        By name.  A vector per row is one column per entry: ``positions[0]``, ``positions[1]``, …
    clocks : mapping of str to str
        Column → the column with its time stamps, where the file says so: messages of a bag arrive topic by topic, so
        their columns have lengths and clocks of their own.  All other columns have one length and share one clock.
    first : int
        Row of the file with which the table begins, for messages.
    """

    source: str
    columns: Mapping[str, Floats]
    clocks: Mapping[str, str] = field(default_factory=dict)
    first: int = 0


class LogFile(Protocol):
    """A file that is open for reading.

    Attributes
    ----------
    source : str
        Name of the file.
    names : tuple of str
        Its columns, without reading their values.
    """

    source: str
    names: tuple[str, ...]

    def tables(self, names: Sequence[str] | None = None, rows: int = CHUNK) -> Iterator[Table]:
        """The content in pieces of at most so many rows, in order; files that cannot be cut come as one piece.

        Parameters
        ----------
        names : sequence of str, optional
            Columns to read; all if omitted.
        rows : int

        Raises
        ------
        InputError
            If the file is damaged or a column is missing or holds no numbers; names file, column and row.
        """
        ...
