"""What a reader took as exact although the file only says it approximately."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from echelon.mechanism.mechanism import Mechanism


@dataclass(frozen=True)
class Snap:
    """One number of a file that was read as a nearby exact one.

    Attributes
    ----------
    element : str
        Where it stands, e.g. ``"joint 'elbow' rpy[0]"``.
    literal, intended : str
        The number in the file and what it was taken for.
    difference : float
        Size of the change, rad or m.
    """

    element: str
    literal: str
    intended: str
    difference: float

    def __str__(self) -> str:
        return f"{self.element}: {self.literal} read as {self.intended}"


@dataclass(frozen=True)
class Reading:
    """How a mechanism was read from a file, with the way back to the literal reading.

    Attributes
    ----------
    snaps : tuple of Snap
        Numbers that were read as nearby exact ones.
    notes : tuple of str
        Things the reader wants its user to know.
    rebuild : callable
        Builds the mechanism again with the numbers of some elements taken literally.
    """

    snaps: tuple[Snap, ...]
    notes: tuple[str, ...]
    rebuild: Callable[[Collection[str]], Mechanism] = field(repr=False, compare=False)

    def literal(self, elements: Collection[str] | None = None) -> Mechanism:
        """The mechanism with these snapped elements (all, if omitted) taken literally."""
        return self.rebuild({snap.element for snap in self.snaps} if elements is None else elements)
