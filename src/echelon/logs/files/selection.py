"""Which columns of a file are read."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from echelon.errors import InputError
from echelon.hints import nearest_of

_NOTHING: Mapping[str, str] = {}


def selected(
    source: str, asked: Sequence[str] | None, names: Sequence[str], left_out: Mapping[str, str] = _NOTHING
) -> tuple[str, ...]:
    """The columns to read, each once.

    Parameters
    ----------
    source : str
        Name of the file.
    asked : sequence of str, optional
        Columns that were asked for; all if omitted.
    names : sequence of str
        Columns of the file.
    left_out : mapping of str to str
        What the file holds besides, and why that is no column.

    Raises
    ------
    InputError
        If one that was asked for is missing; suggests the nearest.

    Examples
    --------
    >>> selected("run.csv", ["q2", "t"], ("t", "q1", "q2"))
    ('q2', 't')
    """
    if asked is None:
        return tuple(names)
    known = set(names)
    for name in asked:
        if name not in known:
            raise missing(source, name, names, left_out)
    return tuple(dict.fromkeys(asked))


def missing(source: str, name: str, names: Sequence[str], left_out: Mapping[str, str] = _NOTHING) -> InputError:
    """The error for a column that the file does not have, or cannot give; arguments as of :func:`selected`.

    Parameters
    ----------
    source, name : str
        Names of the file and of the column.
    names : sequence of str
    left_out : mapping of str to str
    """
    for part, reason in left_out.items():
        if name == part or re.match(re.escape(part) + r"[\[./]", name):
            return InputError(reason, source=source, element=f"column '{name}'")
    inside = [other for other in names if other.startswith((f"{name}[", f"{name}.", f"{name}/"))]
    if inside:
        problem = f"has {len(inside)} columns; name one of them, such as '{inside[0]}'"
        return InputError(problem, source=source, element=f"column '{name}'")
    return InputError(f"no such column{nearest_of(name, names)}", source=source, element=f"column '{name}'")
