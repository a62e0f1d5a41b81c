"""Joints: sequences of constant placements and elementary motions.

Every joint, whatever its number of degrees of freedom, is one joint without bodies inside: a universal joint is two
rotations, a planar joint two translations and a rotation, a floating joint three translations and a ball.  An axis
that is not a coordinate axis is a placement that turns it into one.  So the dynamics needs to know four motions only.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property

from echelon.exact.polynomial import Polynomial
from echelon.mechanism.placement import Placement

X, Y, Z = 0, 1, 2


class MotionKind(Enum):
    """The elementary motions."""

    ROTATION = "rotation"
    TRANSLATION = "translation"
    SCREW = "screw"
    BALL = "ball"


@dataclass(frozen=True)
class Motion:
    """An elementary motion along or about a coordinate axis of the frame it moves."""

    kind: MotionKind
    name: str  # name of the coordinate
    axis: int = Z  # 0, 1, 2 for x, y, z (unused for a ball)
    sign: int = 1  # 1, or −1 when the coordinate counts the other way round
    pitch: Polynomial = Polynomial({})  # travel per radian of a screw, m/rad

    @cached_property
    def positions(self) -> tuple[str, ...]:
        """Names of the position coordinates; a ball has a unit quaternion (w, x, y, z)."""
        return tuple(f"{self.name}.{c}" for c in "wxyz") if self.kind is MotionKind.BALL else (self.name,)

    @cached_property
    def velocities(self) -> tuple[str, ...]:
        """Names of the velocity coordinates; a ball has the angular velocity in the moved frame, rad/s."""
        return tuple(f"{self.name}.{c}" for c in "xyz") if self.kind is MotionKind.BALL else (self.name,)


Step = Placement | Motion


@dataclass(frozen=True)
class Joint:
    """What connects a body to its parent."""

    name: str
    kind: str
    steps: tuple[Step, ...]  # from the parent's frame to the body's frame

    @cached_property
    def motions(self) -> tuple[Motion, ...]:
        """The elementary motions, in order from the parent."""
        return tuple(step for step in self.steps if isinstance(step, Motion))

    @property
    def is_fixed(self) -> bool:
        """Whether the body cannot move against its parent."""
        return not self.motions

    def symbols(self) -> list[str]:
        """Geometry symbols of this joint."""
        found: set[str] = set()
        for step in self.steps:
            found.update(step.symbols() if isinstance(step, Placement) else step.pitch.symbols())
        return sorted(found)

    def preceded_by(self, placement: Placement) -> Joint:
        """The same joint mounted on a frame that is placed in the parent's."""
        return replace(self, steps=merge((placement, *self.steps)))


def merge(steps: tuple[Step, ...]) -> tuple[Step, ...]:
    """Join neighbouring placements and drop identities."""
    merged: list[Step] = []
    for step in steps:
        if isinstance(step, Placement) and merged and isinstance(merged[-1], Placement):
            step = merged.pop() @ step  # type: ignore[operator]
        if not (isinstance(step, Placement) and step.is_identity):
            merged.append(step)
    return tuple(merged)


def rotation(name: str, axis: int = Z, sign: int = 1) -> Motion:
    """Rotation about a coordinate axis, rad."""
    return Motion(MotionKind.ROTATION, name, axis, sign)


def translation(name: str, axis: int = Z, sign: int = 1) -> Motion:
    """Translation along a coordinate axis, m."""
    return Motion(MotionKind.TRANSLATION, name, axis, sign)


def screw(name: str, pitch: Polynomial, axis: int = Z, sign: int = 1) -> Motion:
    """Rotation about a coordinate axis that also travels along it by pitch per radian."""
    return Motion(MotionKind.SCREW, name, axis, sign, pitch)


def ball(name: str) -> Motion:
    """Free rotation."""
    return Motion(MotionKind.BALL, name)


def planar_motions(name: str, normal: int = Z) -> tuple[Motion, ...]:
    """Two translations in a plane, then a rotation about its normal."""
    first, second = (normal + 1) % 3, (normal + 2) % 3
    return (
        translation(f"{name}.{'xyz'[first]}", first),
        translation(f"{name}.{'xyz'[second]}", second),
        rotation(f"{name}.angle", normal),
    )


def floating_motions(name: str) -> tuple[Motion, ...]:
    """Three translations along the parent's axes, then free rotation."""
    return (*(translation(f"{name}.t{'xyz'[axis]}", axis) for axis in (X, Y, Z)), ball(f"{name}.r"))


def cylindrical_motions(name: str, axis: int = Z) -> tuple[Motion, ...]:
    """Independent translation along and rotation about one axis."""
    return (translation(f"{name}.slide", axis), rotation(f"{name}.turn", axis))


def universal_motions(name: str, first: int = X, second: int = Y) -> tuple[Motion, ...]:
    """Two rotations about intersecting perpendicular axes; the first is fixed in the parent."""
    return (rotation(f"{name}.1", first), rotation(f"{name}.2", second))
