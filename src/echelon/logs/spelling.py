"""Texts for messages about logs: names that were probably meant, and times with all digits that matter."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches

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


def suggestion(word: str, valid: Iterable[str]) -> str:
    """A question for the nearest valid name, if one is near, and the valid names.

    Examples
    --------
    >>> suggestion("tau_1", ["tau1", "tau2"])
    "; did you mean 'tau1'? (valid: tau1, tau2)"
    """
    words = list(dict.fromkeys(valid))
    by_lower = {name.lower(): name for name in words}
    close = get_close_matches(word.lower(), by_lower, n=1)
    hint = f"; did you mean '{by_lower[close[0]]}'?" if close else ""
    return f"{hint} (valid: {listed(words)})"


def seconds(time: float) -> str:
    """A time stamp to the microsecond, also where it counts from 1970.

    Examples
    --------
    >>> seconds(1.25), seconds(1460034882.006625)
    ('1.25', '1460034882.006625')
    """
    return f"{time:.6f}".rstrip("0").rstrip(".")
