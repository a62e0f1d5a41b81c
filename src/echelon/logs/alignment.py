"""One clock for all columns of a table.

Messages of a bag arrive topic by topic, each with stamps of its own.  Positions keep theirs, because they are the ones
that get differentiated; all other channels are interpolated linearly between the two stamps around each of them, which
adds no frequencies and needs no smoothness.  Nothing is extrapolated: what not all channels cover is cut away, and
where a channel pauses for longer than a gap its values are not numbers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.hints import nearest_of
from echelon.logs.column_map import ColumnMap
from echelon.logs.table import Table
from echelon.logs.units import factor
from echelon.logs.wording import listed
from echelon.signals.clock import GAP, nominal_period

_TIME_WORDS = ("time", "stamp", "t", "ts", "sec", "seconds", "clock")


def time_candidates(names: Sequence[str]) -> list[str]:
    """Columns that by their names could hold time stamps.

    Parameters
    ----------
    names : sequence of str

    Examples
    --------
    >>> time_candidates(["q_1", "t_s", "tau_1", "timestamp"])
    ['t_s', 'timestamp']
    """
    found = []
    for name in names:
        word = "".join(c if c.isalnum() else " " for c in name.lower()).split()
        if any(part in _TIME_WORDS or part.startswith("time") or part.endswith("stamp") for part in word):
            found.append(name)
    return found


@dataclass(frozen=True)
class Alignment:
    """Columns of a table on the clock of the positions.

    Attributes
    ----------
    table : Table
    columns : ColumnMap
    used : tuple of str
        The columns that will be asked for, those of positions first.
    """

    table: Table
    columns: ColumnMap
    used: tuple[str, ...]

    def column(self, name: str) -> Floats:
        """A column on the common clock, shape (N,).

        Parameters
        ----------
        name : str
            One of ``used``.

        Raises
        ------
        InputError
            If there is no such column, or its clock goes backwards.
        """
        values = raw_column(self.table, name)
        clock = self.clock(name)
        if clock == self.clock(self.used[0]):
            return np.asarray(values if self._inside.all() else values[self._inside])
        return self._interpolated(name, self._stamps(clock), values)

    @cached_property
    def time(self) -> Floats:
        """The common time stamps, s, shape (N,)."""
        return np.asarray(self._stamps(self.clock(self.used[0]))[self._inside])

    @cached_property
    def _inside(self) -> npt.NDArray[np.bool_]:
        """Which stamps of the positions lie within the span of all clocks."""
        own = self.clock(self.used[0])
        base = self._stamps(own)
        inside = np.ones(len(base), dtype=bool)
        for clock in dict.fromkeys(map(self.clock, self.used)):
            if clock != own:
                stamps = self._stamps(clock)
                inside &= (base >= stamps[:1].sum()) & (base <= stamps[-1:].sum()) & bool(len(stamps))
        if len(base) and not inside.any():
            clocks = listed(filter(None, map(self.clock, self.used)))
            raise InputError(f"the clocks {clocks} have no time in common", source=self.table.source)
        return inside

    def clock(self, name: str) -> str:
        """The column with the time stamps of a column; empty where a rate is given.

        Parameters
        ----------
        name : str

        Raises
        ------
        InputError
            If there are none; names columns that could hold them.
        """
        own = self.table.clocks.get(name)
        if self.columns.rate is not None:
            return ""
        time = self.columns.time
        if time is not None and (own is None or own in (time.column, self.table.clocks.get(time.column))):
            return time.column
        if own is None:
            candidates = time_candidates(tuple(self.table.columns))
            hint = f": by their names, these could be time stamps: {listed(candidates)}" if candidates else ""
            problem = "its samples have no time: name the column with time stamps as time, or give rate" + hint
            raise InputError(problem, source=self.table.source, element=f"column '{name}'")
        return own

    def _stamps(self, clock: str) -> Floats:
        if not clock:
            if not (self.columns.rate and 0 < self.columns.rate < float("inf")):
                raise InputError(f"rate must be positive, got {self.columns.rate}", source=self.table.source)
            count = len(raw_column(self.table, self.used[0]))
            return np.asarray((self.table.first + np.arange(count)) / self.columns.rate)
        values = raw_column(self.table, clock)
        channel = self.columns.time
        if channel is None or channel.column != clock:
            return values
        try:
            return np.asarray(channel.scale * factor(channel.unit, "s") * values + channel.offset)
        except InputError as error:
            raise InputError(error.problem, source=self.table.source, element="unit of time") from None

    def _interpolated(self, name: str, stamps: Floats, values: Floats) -> Floats:
        back = np.flatnonzero(~(np.diff(stamps) >= 0))
        if len(back):
            problem = f"its time stamps go backwards at row {back[0] + 1}, so it cannot be brought onto another clock"
            raise InputError(problem, source=self.table.source, element=f"column '{name}'")
        later = np.append(np.diff(stamps) > 0, True)  # of equal stamps the last counts
        stamps, values = stamps[later], values[later]
        wanted = self.time
        found = np.interp(wanted, stamps, values)
        if len(stamps) > 1:
            after = np.clip(np.searchsorted(stamps, wanted), 1, len(stamps) - 1)
            wide = stamps[after] - stamps[after - 1] > GAP * nominal_period(stamps)
            exact = (wanted == stamps[after]) | (wanted == stamps[after - 1])
            found[wide & ~exact] = np.nan
        return found


def raw_column(table: Table, name: str) -> Floats:
    """A column of a table.

    Parameters
    ----------
    table : Table
    name : str

    Raises
    ------
    InputError
        If there is none of this name; suggests the nearest.
    """
    if name not in table.columns:
        raise InputError(f"there is no column '{name}'{nearest_of(name, table.columns)}", source=table.source)
    return table.columns[name]


def check_lengths(table: Table, groups: Mapping[str, Sequence[str]]) -> None:
    """Refuse columns of one clock with different lengths.

    Parameters
    ----------
    table : Table
    groups : mapping of str to sequence of str
        Columns by clock; the clock itself may be empty.

    Raises
    ------
    InputError
        Names the columns and their lengths.
    """
    for clock, names in groups.items():
        sizes = {name: len(raw_column(table, name)) for name in ([clock] if clock else []) + list(names)}
        if len(set(sizes.values())) > 1:
            shown = ", ".join(f"'{name}' {size}" for name, size in list(sizes.items())[:8])
            raise InputError(f"columns of one clock have different lengths: {shown}", source=table.source)
