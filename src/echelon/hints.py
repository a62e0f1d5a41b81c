"""Hints for messages: which of the valid words was probably meant."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

_SHOWN = 12


def nearest(word: str, valid: Iterable[str]) -> str:
    """A question for the valid word that is nearest to a wrong one, or nothing.

    >>> nearest("alhpa", ["alpha", "theta"])
    "; did you mean 'alpha'?"
    """
    originals = {v.lower(): v for v in valid}
    close = difflib.get_close_matches(word.lower(), originals, n=1)
    return f"; did you mean '{originals[close[0]]}'?" if close else ""


def nearest_of(word: str, valid: Iterable[str]) -> str:
    """The same hint, followed by what is valid."""
    words = list(dict.fromkeys(valid))
    listed = ", ".join(words[:_SHOWN]) + (", …" if len(words) > _SHOWN else "")
    return f"{nearest(word, words)} (valid: {listed or 'none'})"
