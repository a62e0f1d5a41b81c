"""What was taken as exact when a file was read although the file only says it approximately."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

Robot = TypeVar("Robot")
RobotOf = TypeVar("RobotOf", covariant=True)


@dataclass(frozen=True)
class Snap:
    """One number of a file that was read as a nearby exact one."""

    element: str  # where it stands, e.g. ``"joint 'elbow' rpy[0]"``
    literal: str  # the number in the file
    intended: str  # what it was taken for
    difference: float  # size of the change, rad or m

    def __str__(self) -> str:
        return f"{self.element}: {self.literal} read as {self.intended}"


class ReadableFile(Protocol[RobotOf]):
    """A file that mechanisms can be built from (:class:`echelon.formats.robot_file.RobotFile`)."""

    def mechanism(self, options: Any = ..., literal: Collection[str] = ...) -> RobotOf:
        """The robot, with the numbers of some elements taken literally."""
        ...

    def recoupled(self, options: Any) -> RobotOf | None:
        """The robot with its couplings ignored, or kept if the options ignore them; None if the file has none."""
        ...


@dataclass(frozen=True)
class Reading(Generic[Robot]):
    """How a mechanism was read from a file."""

    snaps: tuple[Snap, ...]  # numbers that were read as nearby exact ones
    notes: tuple[str, ...]  # remarks of the reader for the user
    file: ReadableFile[Robot]
    options: Any  # how the file was read

    def literal(self, elements: Collection[str] | None = None) -> Robot:
        """The mechanism with these snapped elements (all, if omitted) taken literally."""
        chosen = {snap.element for snap in self.snaps} if elements is None else elements
        return self.file.mechanism(self.options, chosen)

    def recoupled(self) -> Robot | None:
        """The mechanism with the file's couplings ignored, or kept if they are ignored; None if it has none."""
        return self.file.recoupled(self.options)
