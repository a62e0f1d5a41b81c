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
    """A frame placed by numbers.

    Attributes
    ----------
    element : str
        The element of the file that states it, for messages.
    xyz : 3 numbers
        Translation, m.
    rpy : 3 numbers
        Rotations about the fixed x, y and z axes, in this order, rad: R = Rz(yaw) Ry(pitch) Rx(roll).
    inverse : bool
        Whether these numbers say where the frame stands that this placement starts from, seen from the one it leads to.
    """

    element: str
    xyz: Triple = (0, 0, 0)
    rpy: Triple = (0, 0, 0)
    inverse: bool = False


@dataclass(frozen=True)
class LiteralMotion:
    """One elementary or planar or floating motion along a direction given by numbers.

    Attributes
    ----------
    element : str
    name : str
        Name of the coordinate, or the stem of several.
    kind : MotionKind or "planar" or "floating"
    axis : 3 numbers
        Any non-zero length.
    """

    element: str
    name: str
    kind: MotionKind | str
    axis: Triple = (0, 0, 1)


LiteralStep = LiteralPlacement | LiteralMotion


@dataclass(frozen=True)
class LiteralLink:
    """A link with the joint that connects it to its parent.

    Attributes
    ----------
    name : str
    parent : int
        Index of the parent link, −1 for the root.
    joint, kind : str
        Name and type of the joint in the file.
    steps : tuple
        From the parent's frame to this link's; no motion in it means that the link is fixed.
    inertial : tuple of 10 floats, optional
        Standard parameters about this link's frame.
    rest : tuple of LiteralPlacement
        From the parent's frame to this link's at the reference pose, where a format has one.
    """

    name: str
    parent: int
    joint: str
    kind: str
    steps: tuple[LiteralStep, ...]
    inertial: tuple[float, ...] | None = None
    rest: tuple[LiteralPlacement, ...] = ()


@dataclass(frozen=True)
class LiteralClosure:
    """A joint that closes a loop.

    Attributes
    ----------
    element, name : str
    kind : ClosureKind
    first, second : int
        The two links.
    first_frame : tuple of LiteralPlacement
        The frame that it holds, in the first link's frame.
    second_frame : tuple of LiteralPlacement, or None
        The same in the second link's frame; None for where the first one is at the reference pose.
    """

    element: str
    name: str
    kind: ClosureKind
    first: int
    second: int
    first_frame: tuple[LiteralPlacement, ...]
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
    """A sensor of three forces, or three moments, that a link gets from its parent.

    Attributes
    ----------
    element, name : str
    link : int
    placements : tuple of LiteralPlacement
        The sensor's frame in the link's.
    angular : bool
        Moments or forces.
    """

    element: str
    name: str
    link: int
    placements: tuple[LiteralPlacement, ...]
    angular: bool


@dataclass(frozen=True)
class LiteralFrame:
    """A named frame on a link, such as a site.

    Attributes
    ----------
    name : str
    link : int
    placements : tuple of LiteralPlacement
        In the link's frame.
    """

    name: str
    link: int
    placements: tuple[LiteralPlacement, ...]


LiteralSensor = LiteralEffort | LiteralWrench


@dataclass(frozen=True)
class LiteralTree:
    """A whole file.

    Attributes
    ----------
    name, source : str
        Name of the robot, and the file.
    links : tuple of LiteralLink
        Parents before children; the first is the root.
    couplings : tuple of StatedCoupling
        Of mimic elements or equality constraints, with numbers.
    gravity : 3 numbers
        In the root's frame, m/s².
    notes : tuple of str
    root_is_world : bool
        Whether the first link is the world itself, which never moves and carries no parameters.
    closures : tuple of LiteralClosure
    poses : mapping of str to mapping of str to float
        Positions at which the loops may close, zero where absent, by what states them: the reference pose first.
    driven : tuple of str
        Coordinates with actuators.
    has_mimics : bool
        Whether the file couples joints, whatever is made of it.
    sensors : tuple of LiteralSensor
        Those that measure forces.
    frames : tuple of LiteralFrame
        Named frames beside those of the links.
    """

    name: str
    source: str
    links: tuple[LiteralLink, ...]
    couplings: tuple[StatedCoupling, ...] = ()
    gravity: Triple = (0, 0, Fraction(-981, 100))
    notes: tuple[str, ...] = ()
    root_is_world: bool = False
    closures: tuple[LiteralClosure, ...] = ()
    poses: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    driven: tuple[str, ...] = ()
    has_mimics: bool = False
    sensors: tuple[LiteralSensor, ...] = ()
    frames: tuple[LiteralFrame, ...] = ()
