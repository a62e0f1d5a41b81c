"""Closures: joints that close the loops of a mechanism whose bodies form a tree.

A closure holds a frame of one body against a frame of another.  With p the origin and R the axes of the second frame,
seen from the first, each kind demands that some components of p vanish and that some entries of R have the value that
they have where both frames coincide.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from echelon.robot.joint import Placement

_ALONG_Z = ((0, 2, 0), (1, 2, 0), (2, 2, 1))
_ALIGNED = tuple((i, j, int(i == j)) for i in range(3) for j in range(3))


class ClosureKind(Enum):
    """The kinds of closures; axes are z, those of a universal joint x of the first and y of the second frame."""

    WELD = "weld"
    REVOLUTE = "revolute"
    PRISMATIC = "prismatic"
    CYLINDRICAL = "cylindrical"
    PLANAR = "planar"
    UNIVERSAL = "universal"
    SPHERICAL = "spherical"
    POINT_ON_AXIS = "point_on_axis"
    POINT_ON_PLANE = "point_on_plane"

    @property
    def positions(self) -> tuple[int, ...]:
        """Components of p that vanish."""
        return _ROW_OF_KIND[self][0]

    @property
    def directions(self) -> tuple[tuple[int, int, int], ...]:
        """Entries (row, column, value) of R that are fixed; they may depend on one another."""
        return _ROW_OF_KIND[self][1]

    @property
    def freedoms(self) -> int:
        """Degrees of freedom that the closing joint leaves."""
        return _ROW_OF_KIND[self][2]


_ROW_OF_KIND: dict[
    ClosureKind, tuple[tuple[int, ...], tuple[tuple[int, int, int], ...], int]
] = {
    ClosureKind.WELD: ((0, 1, 2), _ALIGNED, 0),
    ClosureKind.REVOLUTE: ((0, 1, 2), _ALONG_Z, 1),
    ClosureKind.PRISMATIC: ((0, 1), _ALIGNED, 1),
    ClosureKind.CYLINDRICAL: ((0, 1), _ALONG_Z, 2),
    ClosureKind.PLANAR: ((2,), _ALONG_Z, 3),
    ClosureKind.UNIVERSAL: ((0, 1, 2), ((0, 1, 0),), 2),
    ClosureKind.SPHERICAL: ((0, 1, 2), (), 3),
    ClosureKind.POINT_ON_AXIS: ((0, 1), (), 4),
    ClosureKind.POINT_ON_PLANE: ((2,), (), 5),
}


@dataclass(frozen=True)
class Closure:
    """A joint that closes a loop."""

    name: str
    kind: ClosureKind
    first: int  # index of a body; GROUND for the base
    second: int
    first_frame: Placement  # what it holds, in the frame of the first body
    second_frame: Placement  # the same in the frame of the second

    @property
    def placements(self) -> tuple[Placement, ...]:
        """Both frames."""
        return (self.first_frame, self.second_frame)
