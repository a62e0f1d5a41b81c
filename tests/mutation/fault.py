"""What a fault is."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
"""The checkout."""


@dataclass(frozen=True)
class Fault:
    """A small mistake in one file.

    Attributes
    ----------
    file : str
        Below ``src/echelon``.
    old, new : str
        What stands there, exactly once, and what is put in its place.
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
        """The text with the fault.

        Raises
        ------
        ValueError
            If the old text does not stand there exactly once, or nothing would change.
        """
        if text.count(self.old) != 1 or self.old == self.new:
            raise ValueError(f"{self.file}: {text.count(self.old)} times {self.old!r}; bring the list up to date")
        return text.replace(self.old, self.new)
