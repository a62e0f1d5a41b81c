"""Bodies from the parts of a file of any format: what moves is a body, and what is fixed to it rides on it.

A part is a link of a URDF, SDF or MJCF file, or a row or body of a description.  Where a fixed part sits is read with
the joint that follows it, so that the symbols in between are named after that joint.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce
from operator import matmul

from echelon.exact.expressions import Angle
from echelon.exact.polynomial import Polynomial
from echelon.mechanism.joint import (
    ALL,
    GROUND,
    Body,
    Joint,
    Motion,
    MotionKind,
    Placement,
    Step,
    floating_motions,
    merge,
    shift,
    turn,
)

BASE = "base"
"""What a parent is called that is the base, unless a body has that name."""

Read = Callable[[str], tuple[Step, ...]]
"""Reads steps; its argument ends the names of symbols."""


@dataclass(frozen=True)
class Part:
    """What becomes a body or rides on one."""

    elements: tuple[str, ...]  # of the file, which state the frames of its joint
    name: str
    parent: str | None  # name of the parent part; None for the base
    joint: str  # name of the joint
    kind: str  # its type
    moves: bool
    steps: Read  # from the parent's frame to its own
    label: str | None = None  # as stated
    default_label: str | None = None  # by the position in a table
    separate: bool = False  # whether it is a body although it is fixed
    carried: tuple[int, ...] = ALL  # which of XX … M it carries
    inertial: tuple[float, ...] | None = None


def placed_before(motion: Motion, offset: Polynomial, angle: Callable[[Polynomial], Angle]) -> Placement:
    """A turn or a slide by the constant part of a coupling, before the motion that it is added to."""
    offset = offset * motion.sign
    if motion.kind is MotionKind.ROTATION:
        return turn(motion.axis, angle(offset))
    x, y, z = (offset if k == motion.axis else 0 for k in range(3))
    return shift(x, y, z)


class Bodies:
    """Bodies in the making, and where parts are on them; labels count from a number."""

    def __init__(self, first: int) -> None:
        self.first = first
        self.made: list[Body] = []
        self.sources: dict[str, list[str]] = {}  # of every body, by label: elements that its joint's frames come from
        self.host: dict[str | None, int] = {None: GROUND}  # the body that carries a part
        self._frames: dict[str | None, tuple[Read, ...]] = {None: ()}  # from that body's frame to the part's
        self._elements: dict[str | None, list[str]] = {None: []}

    def place(self, name: str | None, stem: str = "") -> tuple[int, Placement]:
        """The body that carries a part, or the base, and where it sits on that body."""
        frames = (step for read in self._frames[name] for step in read(stem) if isinstance(step, Placement))
        return self.host[name], reduce(matmul, frames, Placement())

    def attach(self, part: Part, read: Read) -> None:
        """A fixed part rides on its parent's body."""
        self._elements[part.name] = [*self._elements[part.parent], *part.elements]
        self.host[part.name] = self.host[part.parent]
        self._frames[part.name] = (*self._frames[part.parent], read)

    def add(self, part: Part, *, floats: bool = False) -> str:
        """A part becomes a body, perhaps a floating base; returns its label."""
        label = part.label or (None if floats else part.default_label) or str(len(self.made) + self.first)
        self.sources[label] = [*self._elements[part.parent], *part.elements]
        parent, before = self.place(part.parent, label)
        steps = part.steps(label)
        if floats:
            joint = Joint(BASE, "floating", merge((*floating_motions(BASE), *steps)))
        else:  # left as stated where nothing comes before, so that a saved mechanism is read back as it was
            joint = Joint(part.joint, part.kind, steps if before.is_identity else merge((before, *steps)))
        self.made.append(Body(part.name, label, parent, joint, part.carried, part.inertial))
        if floats and part.parent is None:
            # this part carries the base, so all else that hangs on the base hangs on it
            frames = (step.inverse() for step in reversed(steps) if isinstance(step, Placement))
            back = reduce(matmul, frames, Placement())
            self.host[None], self._frames[None] = 0, (lambda _: (back,),)
        self.host[part.name], self._frames[part.name] = len(self.made) - 1, ()
        self._elements[part.name] = []
        return label

    def add_base(self, body: Body) -> None:
        """The base becomes a body of its own."""
        self.made.append(body)
        self.host[None] = 0
