"""A robot file as it stands: names, tree and numbers, before anything is read as exact.

URDF and MJCF readers produce this form; :mod:`echelon.formats.intent` turns it into a mechanism.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction

from echelon.exact.numbers import Rational
from echelon.formats.stated_couplings import StatedCoupling
from echelon.mechanism.closure import ClosureKind
from echelon.mechanism.joint import MotionKind

Triple = tuple[Rational, Rational, Rational]


@dataclass(frozen=True)
class LiteralPlacement:
    """A frame placed by numbers."""

    element: str  # the element of the file that states it, for messages
    xyz: Triple = (0, 0, 0)  # translation, m
    # rotations about the fixed x, y and z axes, in this order, rad: R = Rz(yaw) Ry(pitch) Rx(roll)
    rpy: Triple = (0, 0, 0)
    # whether these numbers say where the frame stands that this placement starts from, seen from the one it leads to
    inverse: bool = False


@dataclass(frozen=True)
class LiteralMotion:
    """One elementary or planar or floating motion along a direction given by numbers."""

    element: str
    name: str  # name of the coordinate, or the stem of several
    kind: MotionKind | str
    axis: Triple = (0, 0, 1)  # any non-zero length


LiteralStep = LiteralPlacement | LiteralMotion


@dataclass(frozen=True)
class LiteralLink:
    """A link with the joint that connects it to its parent."""

    name: str
    parent: int  # index of the parent link, −1 for the root
    joint: str  # name and type of the joint in the file
    kind: str  # name and type of the joint in the file
    # from the parent's frame to this link's; no motion in it means that the link is fixed
    steps: tuple[LiteralStep, ...]
    inertial: tuple[float, ...] | None = None  # standard parameters about this link's frame
    # from the parent's frame to this link's at the reference pose, where a format has one
    rest: tuple[LiteralPlacement, ...] = ()


@dataclass(frozen=True)
class LiteralClosure:
    """A joint that closes a loop."""

    element: str
    name: str
    kind: ClosureKind
    first: int  # the two links
    second: int  # the two links
    first_frame: tuple[LiteralPlacement, ...]  # the frame that it holds, in the first link's frame
    # the same in the second link's frame; None for where the first one is at the reference pose
    second_frame: tuple[LiteralPlacement, ...] | None


@dataclass(frozen=True)
class LiteralEffort:
    """A sensor of the force of a joint, times a weight."""

    element: str
    name: str
    joint: str
    weight: Rational = 1


@dataclass(frozen=True)
class LiteralWrench:
    """A sensor of three forces, or three moments, that a link gets from its parent."""

    element: str
    name: str
    link: int
    placements: tuple[LiteralPlacement, ...]  # the sensor's frame in the link's
    angular: bool  # moments or forces


@dataclass(frozen=True)
class LiteralFrame:
    """A named frame on a link, such as a site."""

    name: str
    link: int
    placements: tuple[LiteralPlacement, ...]  # in the link's frame


LiteralSensor = LiteralEffort | LiteralWrench


@dataclass(frozen=True)
class LiteralTree:
    """A whole file."""

    name: str  # name of the robot, and the file
    source: str  # name of the robot, and the file
    links: tuple[LiteralLink, ...]  # parents before children; the first is the root
    couplings: tuple[StatedCoupling, ...] = ()  # of mimic elements or equality constraints, with numbers
    gravity: Triple = (0, 0, Fraction(-981, 100))  # in the root's frame, m/s²
    notes: tuple[str, ...] = ()
    # whether the first link is the world itself, which never moves and carries no parameters
    root_is_world: bool = False
    closures: tuple[LiteralClosure, ...] = ()
    # positions at which the loops may close, zero where absent, by what states them: the reference pose first
    poses: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    driven: tuple[str, ...] = ()  # coordinates with actuators
    has_mimics: bool = False  # whether the file couples joints, whatever is made of it
    sensors: tuple[LiteralSensor, ...] = ()  # those that measure forces
    frames: tuple[LiteralFrame, ...] = ()  # named frames beside those of the links
