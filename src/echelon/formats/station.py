"""Axes and points of a mechanism, and what they are to one another: exactly modulo a prime, and nearly in doubles."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from echelon.arrays import Floats
from echelon.mechanism.joint import Placement

NOISE = 1e-13  # what is left of exact relations in doubles


@dataclass(frozen=True, eq=False)
class Station:
    """A frame in which something moves or is held, in the base frame."""

    pose: Floats  # homogeneous matrix
    residues: Sequence[Sequence[int]]  # the same modulo a prime
    axis: int | None  # the coordinate axis that counts
    is_line: bool  # whether the axis has a place
    is_point: bool  # whether the origin counts
    bodies: tuple[int, ...]  # in which its place is fixed
    exact: Placement | None  # the pose as far as numbers state it exactly
    slack: float = 1.0  # how many times less exact the direction is than others: that of a line between two points

    @property
    def is_between(self) -> bool:
        """Whether the axis is the line between two points."""
        return self.slack > 1

    @property
    def direction(self) -> Floats:
        """The axis, a unit vector."""
        return self.pose[:3, self.axis]

    @property
    def place(self) -> Floats:
        """The origin, m."""
        return self.pose[:3, 3]

    @property
    def along(self) -> list[int]:
        """The axis modulo the prime."""
        assert self.axis is not None
        return self.modulo(self.axis)

    def modulo(self, column: int) -> list[int]:
        """A column of the pose modulo the prime."""
        return [row[column] for row in self.residues[:3]]

    def way(self, other: Station, p: int) -> list[int]:
        """From one origin to another modulo the prime."""
        return [(b - a) % p for a, b in zip(self.modulo(3), other.modulo(3), strict=True)]

    def missed(self, other: Station, near: float, within: float, scale: float, p: int) -> Iterator[float]:
        """What two axes are nearly and not exactly, by how much they miss it; lengths are in units of a scale."""
        slack = max(self.slack, other.slack)
        near, within = near * slack, within * slack
        d, e, apart = self.direction, other.direction, (other.place - self.place) / scale
        u, v = self.along, other.along
        way = self.way(other, p)
        normal = np.cross(d, e)
        sine, lines = float(np.linalg.norm(normal)), self.is_line and other.is_line
        if sine < near:
            found = [(sine, cross(u, v, p))]
            gap = float(np.linalg.norm(np.cross(apart, d)))
            found += [(gap, cross(way, u, p))] * (lines and gap < within)
        else:
            gap = abs(float(apart @ normal)) / sine
            found = [(abs(float(d @ e)), [dot(u, v, p)])] * (abs(float(d @ e)) < near)
            found += [(gap, [dot(way, cross(u, v, p), p)])] * (lines and gap < within)
        yield from (max(size, NOISE) for size, exact in found if any(exact))

    def beside(self, line: Station, within: float, scale: float, p: int) -> float:
        """By how much a point misses an axis that it is nearly on; 0 if it is on it exactly, or is not near it."""
        gap = float(np.linalg.norm(np.cross(line.place - self.place, line.direction))) / scale
        return max(gap, NOISE) if gap < within and any(cross(self.way(line, p), line.along, p)) else 0.0


def dot(a: Sequence[int], b: Sequence[int], p: int) -> int:
    """Scalar product modulo a prime."""
    return sum(x * y for x, y in zip(a, b, strict=True)) % p


def cross(a: Sequence[int], b: Sequence[int], p: int) -> list[int]:
    """Vector product modulo a prime."""
    return [(a[i] * b[j] - a[j] * b[i]) % p for i, j in ((1, 2), (2, 0), (0, 1))]
