"""A set-up with its logs: what columns mean is decided once, before anything is read in earnest.

Every kind of log, which is every list of column names, is guessed from its first file, so that all logs of a kind mean
the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from echelon.errors import InputError
from echelon.logs.columns.by_values import with_units
from echelon.logs.columns.column_guess import guess
from echelon.logs.columns.column_map import ColumnMap
from echelon.logs.columns.conversion import needed_columns
from echelon.logs.files.log_file import LogFile, Table
from echelon.logs.files.open_log import log_paths
from echelon.logs.read_log import first_table, opened
from echelon.mechanism.mechanism import Mechanism
from echelon.setup.setup import Setup, load_setup, with_usual


def with_logs(setup: Any, logs: Any, others: Any = ()) -> tuple[Setup, tuple[Path, ...], tuple[Path, ...]]:
    """A set-up that knows its columns, or what one is made from; and the paths of two lists of logs."""
    setup = with_usual(setup if isinstance(setup, Setup) else load_setup(setup))
    fitted, unseen = (joined(log_paths(some), setup.mechanism, setup.columns) for some in (logs, others))
    if setup.columns:
        return setup, fitted, unseen
    kinds: dict[tuple[str, ...], LogFile] = {}
    for path in (*fitted, *unseen):
        file = opened(path)
        kinds.setdefault(tuple(file.names), file)
    found = [_guessed(file, setup.mechanism) for file in kinds.values()]
    notes = tuple(dict.fromkeys(text for _, texts in found for text in texts))
    columns = tuple(columns for columns, _ in found)
    return replace(setup, columns=columns, assumed=(*setup.assumed, *notes)), fitted, unseen


def _guessed(file: LogFile, mechanism: Mechanism) -> tuple[ColumnMap, list[str]]:
    found = guess(file.names, mechanism, lambda: first_table(file))
    if found.problems:
        raise InputError("; ".join(found.problems), source=file.source)
    table = next(file.tables(needed_columns(found.columns, file.names)), Table(file.source, {}))
    columns, notes = with_units(found.columns, table, mechanism)
    return columns, [*found.notes, *(note.text for note in notes)]


def joined(paths: Sequence[Path], mechanism: Mechanism, columns: Sequence[ColumnMap] = ()) -> tuple[Path, ...]:
    """The logs, with files joined that hold positions only and outputs only: one of each, or as many of both."""
    if len(paths) < 2 or any(set(needed_columns(some)) <= set(opened(paths[0]).names) for some in columns):
        return tuple(paths)
    kinds = [_holds(path, mechanism) for path in paths]
    positions = [path for path, has in zip(paths, kinds, strict=True) if has == (True, False)]
    outputs = [path for path, has in zip(paths, kinds, strict=True) if has == (False, True)]
    if len(positions) + len(outputs) < len(paths) or len(positions) != len(outputs):
        return tuple(paths)
    return tuple(Path(f"{first}+{second}") for first, second in zip(positions, outputs, strict=True))


def _holds(path: Path, mechanism: Mechanism) -> tuple[bool, bool]:
    """Whether the names of a log's columns say positions, and outputs; the name of the file may say it for them."""
    names = opened(path).names
    for tried in ([f"{path.stem}/{name}" for name in names], names):
        columns = guess(tried, mechanism).columns
        if columns.positions or columns.outputs:
            return bool(columns.positions), bool(columns.outputs)
    return False, False
