"""The text of expressions: what may stand in it, and its tree by Python's own parser, of which nothing is evaluated.

All that is read as an expression is later shown again, in terminals, pages, LaTeX and comments of source code.  So it
is one line of visible characters that all count: comments and control characters are refused here, once for all
readers.
"""

from __future__ import annotations

import ast
import re
import warnings

from echelon.errors import shortened

_QUOTED = re.compile(r"\"[^\"\\]*\"|'[^'\\]*'")


def expression_tree(text: str) -> ast.expr:
    """The syntax tree of an expression."""
    check_characters(text)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SyntaxWarning)
            return ast.parse(text, mode="eval").body
    except (RecursionError, MemoryError):
        raise SyntaxError("nested too deeply") from None


def check_characters(text: str) -> None:
    """Refuse what could hide in an expression: control characters, comments, and digits that only look like digits.

    >>> check_characters("0.3 # in metres")
    Traceback (most recent call last):
    ValueError: '0.3 # in metres' holds a comment: an expression ends where its last term ends
    """
    shown = f"'{shortened(text)}'"
    hidden = next((c for c in text if not c.isprintable()), None)
    if hidden is not None:
        raise ValueError(f"{shown} holds the control character U+{ord(hidden):04X}: an expression is one line of text")
    bare = _QUOTED.sub("", text)
    if "#" in bare:
        raise ValueError(f"{shown} holds a comment: an expression ends where its last term ends")
    foreign = next((c for c in bare if c.isdigit() and not c.isascii()), None)
    if foreign is not None:
        raise ValueError(f"{shown} holds the digit U+{ord(foreign):04X}: digits are 0 to 9")


def is_whole(text: str) -> bool:
    """Whether a text is a whole number without sign, in digits that are counted with."""
    return re.fullmatch(r"[0-9]{1,18}", text) is not None
