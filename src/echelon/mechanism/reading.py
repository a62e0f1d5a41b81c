"""What a reader took as exact although the file only says it approximately."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from echelon.mechanism.mechanism import Mechanism, Symbol
    from echelon.mechanism.placement import Placement


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
class Rider:
    """A link that is fixed to another and counts as part of a body.

    Attributes
    ----------
    body : int
        Index of the body that carries it, or :data:`echelon.mechanism.mechanism.GROUND`.
    placement : Placement
        Its frame in the body's frame.
    symbols : tuple of Symbol
        Those of the placement.
    snaps : tuple of Snap
        Numbers of the placement that were read as nearby exact ones.
    """

    body: int
    placement: Placement
    symbols: tuple[Symbol, ...] = ()
    snaps: tuple[Snap, ...] = ()


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
    riders : mapping of str to Rider
        Links that are fixed to others, by name.
    recoupled : callable, optional
        Of files that couple joints: builds the mechanism with them independent, if they are coupled, or coupled.
    """

    snaps: tuple[Snap, ...]
    notes: tuple[str, ...]
    rebuild: Callable[[Collection[str]], Mechanism] = field(repr=False, compare=False)
    riders: Mapping[str, Rider] = field(default_factory=dict, repr=False, compare=False)
    recoupled: Callable[[], Mechanism] | None = field(default=None, repr=False, compare=False)

    def literal(self, elements: Collection[str] | None = None) -> Mechanism:
        """The mechanism with these snapped elements (all, if omitted) taken literally."""
        return self.rebuild({snap.element for snap in self.snaps} if elements is None else elements)

    def followed_by(self, change: Callable[[Mechanism], Mechanism]) -> Reading:
        """The reading of a mechanism that was changed after it was read: what is built again is changed as well.

        Parameters
        ----------
        change : callable
            A function of a module, or a partial one, so that readings can be sent to other processes.
        """
        recoupled = None if self.recoupled is None else partial(_changed, change, self.recoupled)
        return replace(self, rebuild=partial(_changed, change, self.rebuild), recoupled=recoupled)


def _changed(
    change: Callable[[Mechanism], Mechanism], build: Callable[..., Mechanism], *literal: Collection[str]
) -> Mechanism:
    return change(build(*literal))
