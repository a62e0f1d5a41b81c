"""Two descriptions of one robot, such as a DH table and a URDF: the parameters of one by those of the other.

Frames, zero poses and directions of joints differ between descriptions; joint axes do not.  So the second description
is posed, joint by joint from the base, until its axes coincide with those of the first.  Then ζ' = T ζ holds body by
body, and both sets of base parameters see the same if B' T = M B.  What the axes leave open (along and about the last
one) is settled by the zero poses.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from echelon.base.derive import base_of
from echelon.base.model import BaseModel
from echelon.dynamics import Kinematics
from echelon.robot import (
    GROUND,
    Mechanism,
    MotionKind,
    Readable,
    frame_change,
    symbol_values,
)
from echelon.shared import PER_BODY, Floats, InputError, public

MOST_PAIRINGS = 256
"""Pairings of bodies that are compared before two robots count as different."""
PARALLEL = 1e-6
"""Sine of an angle, or distance of axes in m, that counts as zero."""
Wanted = dict[
    int, tuple[Floats, "JointAxis"]
]  # by body of the second: the first's frame and axis, in the second's base


@public
@dataclass(frozen=True, repr=False)
class Match:
    """One robot in two descriptions.

    Made by :func:`echelon.match`.

    Attributes
    ----------
    first, second : BaseModel
    order : tuple of int
        The first's coordinate for every one of the second.
    sign, offset : array of shape (coordinates,)
        Coordinates of the second are sign · those of the first, in this order, + offset, rad or m.
    standard_map : array of shape (n, n)
        T: standard parameters of the second are T · those of the first.
    base_map : array of shape (r, r)
        M: base parameters of the second are M · those of the first.
    """

    first: BaseModel
    second: BaseModel
    order: tuple[int, ...]
    sign: Floats
    offset: Floats
    standard_map: Floats
    base_map: Floats

    def __str__(self) -> str:
        one, two, names = (
            self.first.mechanism.name,
            self.second.mechanism.name,
            self.first.pivots,
        )
        lines = [f"{one} and {two}: the same {self.first.rank} base parameters"]
        for k, (name, row) in enumerate(
            zip(self.second.pivots, self.base_map, strict=True), 1
        ):
            terms = [
                f"{x:+.9g}·[{names[i]}]" for i, x in enumerate(row) if abs(x) > 1e-12
            ]
            plain = (
                " ".join(terms)
                .replace("+", "+ ")
                .replace("-", "− ")
                .replace(" 1·[", " [")
            )
            lines.append(f"{k:>3}  [{name}]' = {plain.removeprefix('+ ')}")
        return "\n".join(lines)

    def __repr__(self) -> str:
        return f"Match({self.first.mechanism.name} = {self.second.mechanism.name}: {self.first.rank} base parameters)"


@public
def match(
    first: BaseModel | Mechanism | Readable,
    second: BaseModel | Mechanism | Readable,
    *,
    tolerance: float = 1e-6,
) -> Match:
    """Match two descriptions of the same robot, such as a DH table and a URDF.

    Parameters
    ----------
    first, second : BaseModel, Mechanism or path-like
        Sets, robots, or their files.  Trees of revolute and prismatic joints without effects; all symbols need values.
    tolerance : float
        How far apart joint axes may be, m and rad.

    Returns
    -------
    Match

    Raises
    ------
    InputError
        If the geometry differs (names the first joints that do), or one description sees what the other does not.

    Examples
    --------
    >>> import echelon as ec
    >>> robot = ec.load("examples/rx90.yaml")
    >>> ec.match(robot, robot)
    Match(rx90 = rx90: 36 base parameters)
    """
    one, two = base_of(first), base_of(second)
    ours, theirs = _PosedMechanism(one.mechanism), _PosedMechanism(two.mechanism)
    pairs = list(_paired(one.mechanism, two.mechanism))
    base = _base(ours, theirs, *pairs[0], tolerance) if pairs else np.eye(4)
    wanted = {j: (base @ ours.frames[i], ours.axes[i].moved(base)) for i, j in pairs}
    offsets = _pose(theirs, ours, wanted, pairs, tolerance)
    standard = np.zeros((len(two.parameters), len(one.parameters)))
    to, start = two.mechanism.first_column, one.mechanism.first_column
    for i, j in pairs:
        if (i in start) != (j in to):
            raise InputError(
                "it has parameters in one description only",
                element=f"body '{theirs.bodies[j].name}'",
            )
        if i in start:
            change = np.linalg.solve(theirs.frames[j], wanted[j][0])
            standard[to[j] : to[j] + PER_BODY, start[i] : start[i] + PER_BODY] = (
                frame_change(change)
            )
    found = sorted(
        (two.mechanism.positions.index(theirs.coordinate(j)), i, j) for i, j in pairs
    )
    order = tuple(
        one.mechanism.positions.index(ours.coordinate(i)) for _, i, _ in found
    )
    sign = [
        np.sign(wanted[j][1].direction @ theirs.axes[j].direction) for _, _, j in found
    ]
    offset = [offsets.get(j, 0.0) for _, _, j in found]
    return Match(
        one,
        two,
        order,
        np.array(sign),
        np.array(offset),
        standard,
        _base_map(one, two, standard, tolerance),
    )


def _base_map(
    one: BaseModel, two: BaseModel, standard: Floats, tolerance: float
) -> Floats:
    """M of B' T = M B: the pivot columns of the left side, since those of B are unit vectors."""
    if one.rank != two.rank:
        raise InputError(
            f"the first description has {one.rank} base parameters, the second {two.rank}"
        )
    moved = two.B_float() @ standard
    found: Floats = moved[:, [one.parameters.index(name) for name in one.pivots]]
    rest = np.abs(moved - found @ one.B_float()).max(axis=1, initial=0.0)
    worst = int(np.argmax(rest)) if len(rest) else 0
    if len(rest) and rest[worst] > 10 * tolerance * max(
        1.0, float(np.abs(moved).max())
    ):
        raise InputError(
            f"the base parameter {two.pivots[worst]} of the second description is none of the first"
        )
    return found


@dataclass(frozen=True)
class JointAxis:
    """A joint axis; a prismatic joint's is nowhere in particular."""

    turns: bool
    point: Floats
    direction: Floats

    def moved(self, frame: Floats) -> JointAxis:
        """The axis carried along with a frame."""
        return JointAxis(
            self.turns,
            frame[:3, :3] @ self.point + frame[:3, 3],
            frame[:3, :3] @ self.direction,
        )

    def amounts(self, child: JointAxis, wanted: JointAxis) -> list[float]:
        """Displacements of this joint that bring another axis into place: one or two, or none."""
        normal, apart = (
            np.cross(child.direction, self.direction),
            wanted.point - child.point,
        )
        if not self.turns:
            free = not child.turns or normal @ normal < PARALLEL**2
            return (
                []
                if free
                else [
                    float(normal @ np.cross(child.direction, apart) / (normal @ normal))
                ]
            )
        if np.linalg.norm(normal) > PARALLEL:
            slopes = [
                self.direction @ child.direction
                - sign * (self.direction @ wanted.direction)
                for sign in (1, -1)
            ]
            signs = [
                s
                for s, slope in zip((1, -1), slopes, strict=True)
                if abs(slope) <= min(map(abs, slopes)) + 1e-3
            ]
            return [
                _angle(self.direction, child.direction, sign * wanted.direction)
                for sign in signs
            ]
        radius = np.cross(self.direction, child.point - self.point)
        if not child.turns or np.linalg.norm(radius) < PARALLEL:
            return []
        return [
            _angle(self.direction, child.point - self.point, wanted.point - self.point)
        ]


class _PosedMechanism:
    """A mechanism in a pose, first that of zero: frames of its bodies (4, 4) and its joint axes, in its base frame."""

    def __init__(self, mechanism: Mechanism) -> None:
        _check(mechanism)
        self.mechanism, self.bodies = mechanism, mechanism.bodies
        self._kinematics = Kinematics(mechanism)
        self.place({})

    def place(self, coordinates: Mapping[int, float]) -> None:
        """Move bodies to coordinates, and all others to 0."""
        q = np.zeros((1, len(self.mechanism.positions)))
        for body, value in coordinates.items():
            q[0, self.mechanism.positions.index(self.coordinate(body))] = value
        self.frames = [
            np.vstack([frame, [0, 0, 0, 1]]) for frame in self._kinematics.frames(q)[0]
        ]
        slopes = self._kinematics.slopes(q)[0]
        self.axes = [self._axis(k, slopes[k]) for k in range(len(slopes))]

    def coordinate(self, body: int) -> str:
        """The name of a body's only coordinate."""
        return self.bodies[body].joint.motions[0].name

    def _axis(self, body: int, slopes: Floats) -> JointAxis:
        slope = slopes[..., self.mechanism.positions.index(self.coordinate(body))]
        if self.bodies[body].joint.motions[0].kind is MotionKind.TRANSLATION:
            return JointAxis(False, np.zeros(3), slope[:, 3])
        spin = slope[:, :3] @ self.frames[body][:3, :3].T
        direction = np.array([spin[2, 1], spin[0, 2], spin[1, 0]])
        return JointAxis(
            True, self.frames[body][:3, 3] + np.cross(direction, slope[:, 3]), direction
        )


def _pose(
    theirs: _PosedMechanism,
    ours: _PosedMechanism,
    wanted: Wanted,
    pairs: list[tuple[int, int]],
    tolerance: float,
) -> dict[int, float]:
    """Put the second into the pose in which its axes are those of the first; returns its coordinates by body.

    Two perpendicular axes allow two positions of a joint, half a turn apart; which is meant shows further on.
    """
    waiting: list[list[int]] = [[]]
    errors: list[tuple[int, InputError]] = []
    while waiting and len(errors) < MOST_PAIRINGS:
        choices, offsets, free = waiting.pop(), dict[int, float](), 0
        theirs.place(offsets)
        try:
            for i, j in pairs:
                parent = theirs.bodies[j].parent
                if parent not in offsets and parent != GROUND:
                    ways = theirs.axes[parent].amounts(theirs.axes[j], wanted[j][1])
                    if ways:
                        if free == len(choices):
                            choices.append(0)
                        offsets[parent] = ways[choices[free] % len(ways)]
                        if len(ways) > 1 and choices[free] == 0:
                            waiting.append([*choices[:free], 1])
                        theirs.place(offsets)
                        free += 1
                where = f"joints '{ours.bodies[i].joint.name}' and '{theirs.bodies[j].joint.name}'"
                _compare(wanted[j][1], theirs.axes[j], where, tolerance)
        except InputError as error:
            errors.append((pairs.index((i, j)), error))
        else:
            return offsets
    raise max(errors, key=lambda entry: entry[0])[1]


def _compare(
    wanted: JointAxis, actual: JointAxis, where: str, tolerance: float
) -> None:
    if wanted.turns != actual.turns:
        raise InputError("one is a rotation, the other a translation", element=where)
    normal = np.cross(wanted.direction, actual.direction)
    angle = float(np.arcsin(min(1.0, float(np.linalg.norm(normal)))))
    if angle > tolerance:
        raise InputError(
            f"the geometry differs: their axes are {np.degrees(angle):.4g}° apart",
            element=where,
        )
    gap = (
        np.linalg.norm(np.cross(wanted.direction, actual.point - wanted.point))
        if wanted.turns
        else 0.0
    )
    if gap > tolerance:
        raise InputError(
            f"the geometry differs: their axes are {gap:.4g} m apart", element=where
        )


def _base(
    ours: _PosedMechanism, theirs: _PosedMechanism, i: int, j: int, tolerance: float
) -> Floats:
    """The first's base in the second's: first axes and gravity coincide, with the least movement."""
    axis, other = ours.axes[i], theirs.axes[j]
    rotation = shortest_turn(axis.direction, other.direction)
    down, their_down = _down(ours.mechanism), _down(theirs.mechanism)
    if (down is None) != (their_down is None):
        raise InputError("one description has gravity, the other has none")
    if down is not None and their_down is not None:
        rotation = (
            turn_about(
                other.direction, _angle(other.direction, rotation @ down, their_down)
            )
            @ rotation
        )
        apart = float(np.linalg.norm(rotation @ down - their_down))
        if apart > tolerance:
            problem = f"the geometry differs: gravity has another direction against the first axis, by {apart:.4g}"
            raise InputError(problem)
    gap = other.point - rotation @ axis.point
    base = np.eye(4)
    base[:3, :3] = rotation
    base[:3, 3] = gap - (gap @ other.direction) * other.direction
    return base


def _paired(first: Mechanism, second: Mechanism) -> Iterator[tuple[int, int]]:
    """Bodies that correspond, parents first: children by joint name where the names agree, else in order."""
    waiting = [(GROUND, GROUND)]
    while waiting:
        i, j = waiting.pop(0)
        ours, theirs = (
            [k for k, body in enumerate(m.bodies) if body.parent == at]
            for m, at in ((first, i), (second, j))
        )
        if len(ours) != len(theirs):
            name, other = (
                m.bodies[k].name if k != GROUND else "base"
                for m, k in ((first, i), (second, j))
            )
            raise InputError(
                f"'{name}' carries {len(ours)} moving bodies, its counterpart '{other}' {len(theirs)}: "
                "the descriptions have different joints"
            )
        names = {second.bodies[k].joint.name: k for k in theirs}
        if all(first.bodies[k].joint.name in names for k in ours):
            theirs = [names[first.bodies[k].joint.name] for k in ours]
        yield from (pairs := list(zip(ours, theirs, strict=True)))
        waiting += pairs


def _check(mechanism: Mechanism) -> None:
    if mechanism.couplings or mechanism.dependent_velocities or mechanism.effects:
        raise InputError(
            "couplings, loops and effects cannot be matched", element=mechanism.name
        )
    for body in mechanism.bodies:
        kinds = [motion.kind for motion in body.joint.motions]
        if kinds not in ([MotionKind.ROTATION], [MotionKind.TRANSLATION]):
            raise InputError(
                f"it is {body.joint.kind}; only revolute and prismatic joints can be matched",
                element=f"{mechanism.name}: joint '{body.joint.name}'",
            )
        if len(body.carried) not in (0, PER_BODY):
            raise InputError(
                "it carries some inertial parameters only",
                element=f"body '{body.name}'",
            )
    shared = next(
        (k for k in mechanism.carriers if len(mechanism.sharing[k]) > 1), None
    )
    if shared is not None:
        problem = "share their parameters, which cannot be matched: give each a label of its own"
        raise InputError(problem, element=f"bodies {mechanism.carrier_name(shared)}")


def _down(mechanism: Mechanism) -> Floats | None:
    """Direction of gravity."""
    if mechanism.gravity is None:
        return None
    vector = gravity_value(mechanism)
    down: Floats = vector / np.linalg.norm(vector)
    return down


def gravity_value(mechanism: Mechanism) -> Floats:
    """Gravity in the base frame at the stated values, m/s²; zero where there is none."""
    parts = mechanism.gravity or ()
    values = symbol_values(mechanism, sorted({s for p in parts for s in p.symbols()}))
    return np.array([part.at(values) for part in parts] or [0.0] * 3)


def _angle(axis: Floats, start: Floats, end: Floats) -> float:
    """The angle of the turn about an axis that brings one vector next to another."""
    sine, cosine = (
        axis @ np.cross(start, end),
        start @ end - (axis @ start) * (axis @ end),
    )
    return float(np.arctan2(sine, cosine)) if np.hypot(sine, cosine) > PARALLEL else 0.0


def turn_about(axis: Floats, angle: float) -> Floats:
    """The matrix of a turn, by Rodrigues' formula."""
    cross = np.cross(np.eye(3), axis)
    turned: Floats = (
        np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    )
    return turned


def shortest_turn(start: Floats, end: Floats) -> Floats:
    """The least rotation that brings one line of a direction onto another: never more than a quarter turn."""
    end = end * (1 if start @ end >= 0 else -1)
    normal = np.cross(start, end)
    size = np.linalg.norm(normal)
    return (
        turn_about(normal / size, float(np.arctan2(size, start @ end)))
        if size > 1e-15
        else np.eye(3)
    )
