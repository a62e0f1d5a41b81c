"""Texts for messages about logs: lists of names, and times with all digits that matter."""

from __future__ import annotations

from collections.abc import Iterable

_SHOWN = 12


def listed(names: Iterable[str]) -> str:
    """Some names, cut short where they are many.

    Examples
    --------
    >>> listed(["q1", "q2"])
    'q1, q2'
    """
    words = list(dict.fromkeys(names))
    return (", ".join(words[:_SHOWN]) + (f", … ({len(words)} in all)" if len(words) > _SHOWN else "")) or "none"


def seconds(time: float) -> str:
    """A time stamp to the microsecond, also where it counts from 1970.

    Examples
    --------
    >>> seconds(1.25), seconds(1460034882.006625)
    ('1.25', '1460034882.006625')
    """
    return f"{time:.6f}".rstrip("0").rstrip(".")
