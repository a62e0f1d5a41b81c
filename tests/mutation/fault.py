"""Small mistakes planted in the source, found by syntax: comments, line breaks and parentheses do not matter."""

from __future__ import annotations

import ast
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
"""The checkout."""


@dataclass(frozen=True)
class Fault:
    """A small mistake in one file.

    The file is parsed and printed by :func:`ast.unparse`, which decides about blanks, quotes and parentheses; the
    layout of the file itself may change.

    Attributes
    ----------
    file : str
        Below ``src/echelon``.
    old, new : str
        Code that occurs exactly once in the printed file, and the code that replaces it.
    breaks : str
        What becomes wrong.
    tests : str
        Files or tests below ``tests``, separated by blanks, which should notice quickly.
    """

    file: str
    old: str
    new: str
    breaks: str
    tests: str

    @property
    def path(self) -> Path:
        """The file, relative to the checkout."""
        return Path("src", "echelon", self.file)

    def applied(self, text: str) -> str:
        """Source text of the file with the fault.

        Raises
        ------
        ValueError
            If the old code does not occur exactly once, or nothing would change.
        """
        printed = ast.unparse(ast.parse(text))
        count = printed.count(self.old)
        if count != 1 or self.old == self.new:
            raise ValueError(
                f"{self.file}: {count} times {self.old!r}; bring the list up to date"
            )
        return printed.replace(self.old, self.new)
