"""A robot file as it stands: names, tree and numbers, before anything is read as exact.

URDF, SDF and MJCF readers produce this form; :mod:`echelon.formats.builder` turns it into a mechanism.  Couplings may
refer to other dependent coordinates here, and joints may be declared to be of types that the format does not know.

Inertial values are floats, about a link's frame; they move from the centre of mass there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import reduce
from graphlib import CycleError, TopologicalSorter
from math import atan2, cos, hypot, sin
from sys import float_info

import numpy as np
import numpy.typing as npt

from echelon.algebra import Polynomial, Rational
from echelon.robot import (
    ClosureKind,
    Coupling,
    MotionKind,
    Spline,
    from_tensor,
    tensor_and_moment,
)
from echelon.shared import Floats, InputError, nearest_of

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
    # turns from the joint's frame to the one in which the axis is stated, where that is another one
    turns: tuple[LiteralPlacement, ...] = ()
    pitch: Polynomial = Polynomial({})


LiteralStep = LiteralPlacement | LiteralMotion

MOTIONS: dict[str, MotionKind | str] = {
    "revolute": MotionKind.ROTATION,
    "continuous": MotionKind.ROTATION,
    "prismatic": MotionKind.TRANSLATION,
    "planar": "planar",
    "floating": "floating",
}
"""Motions by the type of a joint with one axis, or of a floating base."""


@dataclass(frozen=True)
class LiteralLink:
    """A link with the joint that connects it to its parent."""

    name: str
    parent: int  # index of the parent link, −1 for the root
    joint: str  # name of the joint in the file
    kind: str  # its type there
    # from the parent's frame to this link's; no motion in it means that the link is fixed
    steps: tuple[LiteralStep, ...]
    inertial: tuple[float, ...] | None = (
        None  # standard parameters about this link's frame
    )
    # from the parent's frame to this link's at the reference pose, where a format has one
    rest: tuple[LiteralPlacement, ...] = ()


@dataclass(frozen=True)
class LiteralClosure:
    """A joint that closes a loop."""

    element: str
    name: str
    kind: ClosureKind
    first: int  # index of a link
    second: int
    first_frame: tuple[
        LiteralPlacement, ...
    ]  # the frame that it holds, in the first link's frame
    # the same in the second link's frame; None for where the first one is at the reference pose
    second_frame: tuple[LiteralPlacement, ...] | None
    axis: LiteralMotion | None = (
        None  # along whose axis, stated in these frames, z is instead
    )


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
    """A robot file as a tree of links."""

    name: str  # of the robot
    source: str  # of the file
    links: tuple[LiteralLink, ...]  # parents before children; the first is the root
    couplings: tuple[
        StatedCoupling, ...
    ] = ()  # of mimic elements or equality constraints, with numbers
    gravity: Triple = (0, 0, Fraction(-981, 100))  # in the root's frame, m/s²
    notes: tuple[str, ...] = ()
    # whether the first link is the world itself, which never moves and carries no parameters
    root_is_world: bool = False
    closures: tuple[LiteralClosure, ...] = ()
    # positions at which the loops may close, zero where absent, by what states them: the reference pose first
    poses: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    driven: tuple[str, ...] = ()  # coordinates with actuators
    # joints that are said to be independent of others, or to depend on them
    independent: Mapping[str, bool] = field(default_factory=dict)
    # what is stated of the drives of coordinates, by kind of effect, nan where only the kind is known
    drives: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    has_mimics: bool = False  # whether the file couples joints, whatever is made of it
    sensors: tuple[LiteralSensor, ...] = ()  # those that measure forces
    frames: tuple[LiteralFrame, ...] = ()  # named frames beside those of the links
    # components of quaternions and axes as written, where angles were computed from them
    turned: tuple[Rational, ...] = ()
    # coordinates of points as written, where others were computed from them
    placed: tuple[Rational, ...] = ()


@dataclass(frozen=True)
class StatedCoupling:
    """q_coordinate = Σ f_k(q_k) + offset."""

    element: str  # what states it: a mimic element, an equality constraint, an entry of a description
    coordinate: str
    terms: Mapping[
        str, Spline
    ]  # functions of other coordinates, which may be dependent themselves
    offset: Polynomial  # the constant part; of rotations it may contain pi

    @property
    def coupling(self) -> Coupling:
        """The coupling without its offset, which belongs into the geometry."""
        return Coupling(self.coordinate, tuple(self.terms.items()))


def resolved(
    couplings: Iterable[StatedCoupling], error: Callable[[str, str], InputError]
) -> dict[str, StatedCoupling]:
    """Couplings by coordinate, with chains of dependent coordinates followed to independent ones."""
    stated: dict[str, StatedCoupling] = {}
    for coupling in couplings:
        earlier = stated.setdefault(coupling.coordinate, coupling)
        if earlier is not coupling:
            raise error(
                coupling.element,
                f"'{coupling.coordinate}' is already coupled in {earlier.element}",
            )
    known: dict[str, StatedCoupling] = {}
    order = TopologicalSorter(
        {name: [n for n in c.terms if n in stated] for name, c in stated.items()}
    )
    try:
        for name in order.static_order():
            known[name] = substituted(stated[name], known, error)
    except CycleError as found:
        *_, last, _ = circle = found.args[1][::-1]
        raise error(
            stated[last].element, f"the couplings form a circle: {' -> '.join(circle)}"
        ) from None
    return {name: known[name] for name in stated}


def substituted(
    coupling: StatedCoupling,
    known: Mapping[str, StatedCoupling],
    error: Callable[[str, str], InputError],
) -> StatedCoupling:
    """A coupling with functions of independent coordinates in the place of dependent ones."""
    terms: dict[str, Spline] = {}
    offset = coupling.offset
    for name, function in coupling.terms.items():
        inner = {name: Spline((Polynomial.constant(1),))}
        constant = Polynomial({})
        if name in known:
            inner, constant = dict(known[name].terms), known[name].offset
        if function.ratio is None and len(inner) > 1:
            several = ", ".join(inner)
            raise error(
                coupling.element,
                f"'{name}' follows {several}, so only linear functions of it are supported",
            )
        for independent, part in inner.items() or [(name, Spline(()))]:
            try:
                found, value = function.after(part, constant)
            except ValueError as problem:
                raise error(coupling.element, str(problem)) from None
            terms[independent] = terms.get(independent, Spline(())) + found
            offset, constant = offset + value, Polynomial({})
    moving = {
        name: function for name, function in terms.items() if function.expressions
    }
    return StatedCoupling(coupling.element, coupling.coordinate, moving, offset)


@dataclass(frozen=True)
class StatedJoint:
    """The true type of a joint of a robot file."""

    name: str  # of the joint in the file
    kind: str
    # coordinate axes and signs of a universal joint, in the frame of the joint's origin
    axes: tuple[tuple[int, int], ...]
    error: Callable[[str], InputError]  # makes an error about what states it


def with_joints(tree: LiteralTree, joints: Sequence[StatedJoint]) -> LiteralTree:
    """A tree some of whose joints are of other types.

    The frame in which the file states a joint stays; a ball, or the axes of a universal joint, take the place of its
    axis.
    """
    coupled = {
        name: c.element for c in tree.couplings for name in (c.coordinate, *c.terms)
    }
    for joint in joints:
        moving = [
            step.name
            for link in tree.links
            for step in link.steps
            if isinstance(step, LiteralMotion)
        ]
        names = dict.fromkeys(
            [*(link.joint for link in tree.links if link.joint), *moving]
        )
        if joint.name not in names:
            raise joint.error(
                f"the robot file has no joint '{joint.name}'{nearest_of(joint.name, list(names))}"
            )
        if joint.name in coupled:
            raise joint.error(
                f"it has one axis, because of {coupled[joint.name]}: take that out"
            )
        tree = replace(tree, links=tuple(_changed(link, joint) for link in tree.links))
    return tree


def _changed(link: LiteralLink, joint: StatedJoint) -> LiteralLink:
    stated = any(
        isinstance(step, LiteralMotion) and step.name == joint.name
        for step in link.steps
    )
    if not stated and link.joint != joint.name:
        return link
    # a joint of its own keeps its name; a fixed one has no motion that could be replaced
    steps = (
        link.steps
        if stated
        else (*link.steps, LiteralMotion(f"joint '{joint.name}'", joint.name, "fixed"))
    )
    kind = joint.kind if link.joint == joint.name else link.kind
    return replace(link, kind=kind, steps=tuple(_steps(steps, joint)))


def _steps(steps: Sequence[LiteralStep], joint: StatedJoint) -> Iterator[LiteralStep]:
    for step in steps:
        if not isinstance(step, LiteralMotion) or step.name != joint.name:
            yield step
        elif joint.kind == "spherical":
            yield LiteralMotion(step.element, joint.name, MotionKind.BALL)
        else:
            for number, (axis, sign) in enumerate(joint.axes, 1):
                x, y, z = (sign if k == axis else 0 for k in range(3))
                direction: Triple = (x, y, z)
                yield LiteralMotion(
                    step.element,
                    f"{joint.name}.{number}",
                    MotionKind.ROTATION,
                    direction,
                )


def rotation_matrix(roll: float, pitch: float, yaw: float) -> Floats:
    """Rz(yaw) Ry(pitch) Rx(roll)."""
    cr, sr, cp, sp, cy, sy = (
        f(a) for a in (roll, pitch, yaw) for f in (np.cos, np.sin)
    )
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


DOUBLE_DIGITS = float_info.dig
"""Decimals that a double always keeps; numbers with more were computed."""

DOUBLE_ROUNDING = 10.0**-DOUBLE_DIGITS
"""Relative error of a number with as many digits as a double keeps."""


def roll_pitch_yaw(r: Floats) -> tuple[float, float, float]:
    """Angles with R = Rz(yaw) Ry(pitch) Rx(roll)."""
    # the roll is taken after the yaw is undone, so that at a pitch near ±90°, where neither is well determined, their
    # errors cancel
    yaw = atan2(r[1, 0], r[0, 0]) if hypot(r[0, 0], r[1, 0]) > DOUBLE_ROUNDING else 0.0
    c, s = cos(yaw), sin(yaw)
    return (
        atan2(s * r[0, 2] - c * r[1, 2], c * r[1, 1] - s * r[0, 1]),
        atan2(-r[2, 0], hypot(r[0, 0], r[1, 0])),
        yaw,
    )


def numeric_placement(placement: LiteralPlacement) -> Floats:
    """A literal placement as a homogeneous matrix, shape (4, 4)."""
    frame = np.eye(4)
    frame[:3, :3] = rotation_matrix(*map(float, placement.rpy))
    frame[:3, 3] = [float(v) for v in placement.xyz]
    if placement.inverse:
        frame[:3, 3] = -frame[:3, :3].T @ frame[:3, 3]
        frame[:3, :3] = frame[:3, :3].T.copy()
    return frame


def numeric_placements(placements: Iterable[LiteralPlacement]) -> Floats:
    """Several placements, one after the other, as a homogeneous matrix."""
    return reduce(np.matmul, map(numeric_placement, placements), np.eye(4))


def central_inertial(
    mass: float,
    centre: npt.ArrayLike,
    moments: Iterable[float],
    rotation: npt.ArrayLike,
) -> tuple[float, ...]:
    """Standard parameters from mass, centre of mass, and inertia XX XY XZ YY YZ ZZ about it in rotated axes."""
    # centre in the link's frame, m; moments about it, kg·m², along axes that are the columns of the rotation there
    xx, xy, xz, yy, yz, zz = moments
    turned = (
        np.asarray(rotation)
        @ [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
        @ np.asarray(rotation).T
    )
    c = np.asarray(centre, dtype=float)
    about_origin = turned + mass * (c @ c * np.eye(3) - np.outer(c, c))
    return tuple(from_tensor(about_origin, mass * c, np.asarray(mass)).tolist())


def move_inertial(inertial: Floats, frame: Floats) -> Floats:
    """A body's standard parameters about a reference frame in which its own frame is placed."""
    r, p = frame[:3, :3], frame[:3, 3]
    tensor, moment, mass = tensor_and_moment(inertial)
    h = r @ moment
    # parallel axes for a frame shift p: I + terms in h and m, symmetric in both factors; fewer roundings than a
    # congruence of the pseudo-inertia has, so that the digits of files stay
    shifted = (
        r @ tensor @ r.T + 2 * (p @ h) * np.eye(3) - np.outer(p, h) - np.outer(h, p)
    )
    shifted = shifted + mass * (p @ p * np.eye(3) - np.outer(p, p))
    return from_tensor(shifted, h + mass * p, mass)
