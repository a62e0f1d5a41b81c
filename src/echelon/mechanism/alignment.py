"""Two descriptions of one robot: where every body's frame of one sits in that of the other.

Frames differ between descriptions (DH frames and URDF link frames, say), and so do zero poses and directions of joints;
joint axes do not.  So the second description is posed, joint by joint from the base, until its axes coincide with those
of the first; the frames of each body are then read off.  What the axes leave open (along and about the last one) is
settled by the zero poses.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.mechanism.axes import (
    Axis,
    angle_about,
    constant_placement,
    line_distance,
    moved,
    number_of,
    settling,
    shortest_turn,
    turn_about,
)
from echelon.mechanism.joint import Motion, MotionKind
from echelon.mechanism.mechanism import GROUND, Body, Mechanism
from echelon.mechanism.placement import Placement

_ATTEMPTS = 256


@dataclass(frozen=True)
class BodyAlignment:
    """One body in both descriptions."""

    first: int  # its index in the first mechanism
    second: int  # and in the second
    placement: Placement  # its frame of the first description in that of the second, with constant entries
    sign: int
    offset: float  # the second's coordinate is sign · the first's + offset, rad or m


@dataclass(frozen=True)
class Alignment:
    """The first description placed in the second."""

    base: Placement  # the first's base frame in the second's
    bodies: tuple[BodyAlignment, ...]


def align(first: Mechanism, second: Mechanism, tolerance: float) -> Alignment:
    """Find where the frames of one description are in the other."""
    # two perpendicular axes allow two positions of a joint, half a turn apart; which is meant shows further on
    waiting: list[list[int]] = [[]]
    errors: list[tuple[int, InputError]] = []
    while waiting and len(errors) < _ATTEMPTS:
        attempt = _Aligner(first, second, tolerance, waiting.pop())
        try:
            return attempt.run()
        except InputError as error:
            errors.append((len(attempt.fixed), error))
            waiting += attempt.alternatives()
    raise max(errors, key=lambda entry: entry[0])[1]


@dataclass
class _Posed:
    """A body of the second description while it is posed."""

    parent: _Posed | None
    mount: Placement
    """From the parent's frame to where the joint moves."""
    motion: Motion
    after: Placement
    offset: float = 0.0
    settled: bool = False

    @property
    def before(self) -> Placement:
        """The frame in which the joint moves, in the base."""
        return self.parent.frame @ self.mount if self.parent else self.mount

    @property
    def frame(self) -> Placement:
        """The body's frame in the base."""
        return self.before @ moved(self.motion, self.offset) @ self.after

    @property
    def axis(self) -> Axis:
        """The joint's axis in the base."""
        return Axis.of(self.before, self.motion)


class _Aligner:
    def __init__(self, first: Mechanism, second: Mechanism, tolerance: float, choices: list[int]) -> None:
        self.first, self.second, self.tolerance = first, second, tolerance
        self.choices, self.made = choices, 0
        self.base = Placement()
        self.fixed: dict[int, Placement] = {}
        """Frames of the first's bodies at its zero pose, in the second's base frame."""
        self.posed: dict[int, _Posed] = {}

    def run(self) -> Alignment:
        signs = {}
        for i, j in paired(self.first, self.second):
            if not self.fixed:
                self.base = self._place_base(i, j)
            signs[i, j] = self._join(i, j)
        return Alignment(
            self.base,
            tuple(
                BodyAlignment(i, j, self.posed[j].frame.inverse() @ self.fixed[i], sign, self.posed[j].offset)
                for (i, j), sign in signs.items()
            ),
        )

    def alternatives(self) -> list[list[int]]:
        """Other choices for those that were made freely, the last one to be tried first."""
        free = self.made - len(self.choices)
        return [[*self.choices, *[0] * k, 1] for k in range(free)]

    def _join(self, i: int, j: int) -> int:
        """Pose the parent of a body, if that is still open, so that the joints' axes coincide; whether they agree."""
        ours, theirs = self.first.bodies[i], self.second.bodies[j]
        before, motion, after = _parts(ours, self.first)
        start = (self.fixed[ours.parent] if ours.parent != GROUND else self.base) @ before
        wanted = Axis.of(start, motion)
        self.fixed[i] = start @ moved(motion, 0.0) @ after
        parent = self.posed.get(theirs.parent)
        self.posed[j] = child = _Posed(parent, *_parts(theirs, self.second))
        if parent and not parent.settled:
            ways = settling(parent.axis, child.axis, wanted)
            if ways:
                parent.offset, parent.settled = self._chosen(ways), True
        self._compare(ours, theirs, wanted, child.axis)
        return 1 if wanted.direction @ child.axis.direction > 0 else -1

    def _chosen(self, ways: list[float]) -> float:
        """One of one or two ways: the prescribed one, or the shortest."""
        if len(ways) == 1:
            return ways[0]
        self.made += 1
        return ways[self.choices[self.made - 1]] if self.made <= len(self.choices) else ways[0]

    def _compare(self, ours: Body, theirs: Body, wanted: Axis, actual: Axis) -> None:
        where = f"joints '{ours.joint.name}' and '{theirs.joint.name}'"
        if wanted.kind is not actual.kind:
            raise InputError(f"one is a {wanted.kind.value}, the other a {actual.kind.value}", element=where)
        angle = float(np.arcsin(min(1.0, float(np.linalg.norm(np.cross(wanted.direction, actual.direction))))))
        if angle > self.tolerance:
            raise InputError(f"the geometry differs: their axes are {np.degrees(angle):.4g}° apart", element=where)
        distance = line_distance(wanted, actual) if wanted.kind is MotionKind.ROTATION else 0.0
        if distance > self.tolerance:
            raise InputError(f"the geometry differs: their axes are {distance:.4g} m apart", element=where)

    def _place_base(self, i: int, j: int) -> Placement:
        """The first's base in the second's: first axes and gravity coincide, with the least movement."""
        (before, motion, _), (other, other_motion, _) = (
            _parts(self.first.bodies[i], self.first),
            _parts(self.second.bodies[j], self.second),
        )
        ours, theirs = Axis.of(before, motion), Axis.of(other, other_motion)
        rotation = shortest_turn(ours.direction, theirs.direction)
        down, their_down = _down(self.first), _down(self.second)
        if (down is None) != (their_down is None):
            raise InputError("one description has gravity, the other has none")
        if down is not None and their_down is not None:
            angle = angle_about(theirs.direction, rotation @ down, their_down)
            rotation = turn_about(theirs.direction, angle) @ rotation
            apart = float(np.linalg.norm(rotation @ down - their_down))
            if apart > self.tolerance:
                problem = f"the geometry differs: gravity has another direction against the first axis, by {apart:.4g}"
                raise InputError(problem)
        gap = theirs.point - rotation @ ours.point
        gap = gap - (gap @ theirs.direction) * theirs.direction
        return constant_placement(rotation, gap * (ours.kind is MotionKind.ROTATION))


def paired(first: Mechanism, second: Mechanism) -> Iterator[tuple[int, int]]:
    """Bodies that correspond, parents first: children by joint name where the names agree, else in order."""
    waiting = [(GROUND, GROUND)]
    while waiting:
        i, j = waiting.pop(0)
        ours = [k for k, body in enumerate(first.bodies) if body.parent == i]
        theirs = [k for k, body in enumerate(second.bodies) if body.parent == j]
        if len(ours) != len(theirs):
            name, other = (m.bodies[k].name if k != GROUND else "base" for m, k in ((first, i), (second, j)))
            raise InputError(
                f"'{name}' carries {len(ours)} moving bodies, its counterpart '{other}' {len(theirs)}: "
                "the descriptions do not have the same joints"
            )
        names = {second.bodies[k].joint.name: k for k in theirs}
        if all(first.bodies[k].joint.name in names for k in ours):
            theirs = [names[first.bodies[k].joint.name] for k in ours]
        for pair in zip(ours, theirs, strict=True):
            yield pair
            waiting.append(pair)


def _parts(body: Body, mechanism: Mechanism) -> tuple[Placement, Motion, Placement]:
    """What comes before the joint's motion, the motion, and what comes after."""
    motions = body.joint.motions
    if len(motions) != 1 or motions[0].kind not in (MotionKind.ROTATION, MotionKind.TRANSLATION):
        raise InputError(
            f"it is {body.joint.kind}; only revolute and prismatic joints can be matched",
            element=f"{mechanism.name}: joint '{body.joint.name}'",
        )
    before, after, steps = Placement(), Placement(), body.joint.steps
    place = steps.index(motions[0])
    for k, step in enumerate(steps):
        if isinstance(step, Placement):
            before, after = (before @ step, after) if k < place else (before, after @ step)
    return before, motions[0], after


def _down(mechanism: Mechanism) -> Floats | None:
    """Direction of gravity."""
    if mechanism.gravity is None:
        return None
    vector = np.array([number_of(part) for part in mechanism.gravity])
    down: Floats = vector / np.linalg.norm(vector)
    return down
