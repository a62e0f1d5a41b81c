"""Words for messages: hints at what was probably meant, lists of names, names that are free."""

from __future__ import annotations

import difflib
from collections.abc import Collection, Iterable, Sequence

MOST_NAMED = 12
"""Names in one message; more are counted, so that a message stays readable."""


def nearest_word(word: str, valid: Iterable[str]) -> str:
    """The valid word that is nearest to a wrong one, or nothing.

    >>> nearest_word("alhpa", ["alpha", "theta"])
    'alpha'
    """
    originals = {v.lower(): v for v in valid}
    close = difflib.get_close_matches(word.lower(), originals, n=1)
    return originals[close[0]] if close else ""


def nearest(word: str, valid: Iterable[str]) -> str:
    """A question for the valid word that is nearest to a wrong one, or nothing.

    >>> nearest("alhpa", ["alpha", "theta"])
    "; did you mean 'alpha'?"
    """
    found = nearest_word(word, valid)
    return f"; did you mean '{found}'?" if found else ""


def nearest_of(word: str, valid: Iterable[str]) -> str:
    """Hint at the nearest valid word, followed by a list of valid words."""
    words = list(dict.fromkeys(valid))
    return f"{nearest(word, words)} (valid: {listed(words) or 'none'})"


def in_quotes(names: Iterable[str]) -> str:
    """Names in quotes, and how many more there are.

    >>> in_quotes(["a", "b", "c"])
    "'a', 'b', 'c'"
    """
    return listed([f"'{name}'" for name in names])


def listed(words: Sequence[str], most: int = MOST_NAMED, separator: str = ", ") -> str:
    """Words one after the other, and how many more there are."""
    more = len(words) - most
    shown = separator.join(words[:most])
    return f"{shown} and {more} more" if more > 0 else shown


def unused(name: str, taken: Collection[str]) -> str:
    """A name like this one that is not taken."""
    while name in taken:
        name += "_"
    return name
