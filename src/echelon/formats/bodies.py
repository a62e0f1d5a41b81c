"""Bodies from the parts of a file of any format: what moves is a body, and what is fixed to it rides on it.

A part is a link of a URDF, SDF or MJCF file, or a row or body of a description.  Where a fixed part sits is read with
the joint that follows it, so that the symbols in between are named after that joint.

Consecutive joint axes may be meant to be parallel, at a multiple of 15° or to intersect.  A chain of frames between two
joints may bring their axes together although no single number says so: rotations by 0.3, 0.4 and −0.7 rad, or by 65°
and 25° in rounded radians, or two axes that are written with eight digits.  Only the twist between the two axes and
their distance matter for what can be seen, and neither depends on the pose, so that is where rounded numbers are
compared.  What is that near to a relation is rewritten so that it holds identically: the frames' rotation becomes
Rz(θ₁) Rx(twist) Rz(θ₂) about the two axes, the translation a sum of steps along them.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import reduce
from math import atan2, hypot, pi
from operator import matmul

import numpy as np

from echelon.algebra import STEPS_PER_HALF_TURN, Angle, Polynomial, cosine_of_turn
from echelon.formats.snapping import (
    COMPUTED_ROUNDING,
    LENGTH_TOLERANCE,
    PRECISION,
    TO_AXIS,
    Snapping,
)
from echelon.robot import (
    ALL,
    GROUND,
    Body,
    Joint,
    Matrix,
    Motion,
    MotionKind,
    Placement,
    Snap,
    Step,
    Vector,
    floating_motions,
    largest_offset,
    merge,
    multiply,
    parted,
    rotate,
    shift,
    transpose,
    turn,
    vanishes,
)
from echelon.shared import Floats, check_title

BASE = "base"  # what a parent is called that is the base, unless a body has that name

Read = Callable[
    [str], tuple[Step, ...]
]  # reads steps; its argument ends the names of symbols


@dataclass(frozen=True)
class Part:
    """A link of a robot file, or a row or body of a description; it becomes a body or is fixed to one."""

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


def placed_before(
    motion: Motion, offset: Polynomial, angle: Callable[[Polynomial], Angle]
) -> Placement:
    """A turn or a slide by the constant part of a coupling, before the motion that it is added to."""
    offset = offset * motion.sign
    if motion.kind is MotionKind.ROTATION:
        return turn(motion.axis, angle(offset))
    x, y, z = (offset if k == motion.axis else 0 for k in range(3))
    return shift(x, y, z)


class Bodies:
    """Makes bodies of parts, and knows where every part sits on its body; labels count from a number."""

    def __init__(self, first: int) -> None:
        self.first = first
        self.made: list[Body] = []
        self.sources: dict[
            str, list[str]
        ] = {}  # of every body, by label: elements that its joint's frames come from
        self.host: dict[str | None, int] = {
            None: GROUND
        }  # the body that carries a part
        self._frames: dict[str | None, tuple[Read, ...]] = {
            None: ()
        }  # from that body's frame to the part's
        self._elements: dict[str | None, list[str]] = {None: []}

    def place(self, name: str | None, stem: str = "") -> tuple[int, Placement]:
        """The body that carries a part, or the base, and where it sits on that body."""
        frames = (
            step
            for read in self._frames[name]
            for step in read(stem)
            if isinstance(step, Placement)
        )
        return self.host[name], reduce(matmul, frames, Placement())

    def attach(self, part: Part, read: Read) -> None:
        """A fixed part rides on its parent's body."""
        check_title(
            part.name, f"link '{part.name}'"
        )  # bodies are checked where they become a mechanism
        self._elements[part.name] = [*self._elements[part.parent], *part.elements]
        self.host[part.name] = self.host[part.parent]
        self._frames[part.name] = (*self._frames[part.parent], read)

    def add(self, part: Part, *, floats: bool = False) -> str:
        """A part becomes a body, perhaps a floating base; returns its label."""
        label = (
            part.label
            or (None if floats else part.default_label)
            or str(len(self.made) + self.first)
        )
        self.sources[label] = [*self._elements[part.parent], *part.elements]
        parent, before = self.place(part.parent, label)
        steps = part.steps(label)
        if floats:
            joint = Joint(BASE, "floating", merge((*floating_motions(BASE), *steps)))
        else:  # left as stated where nothing comes before, so that a saved mechanism is read back as it was
            joint = Joint(
                part.joint,
                part.kind,
                steps if before.is_identity else merge((before, *steps)),
            )
        self.made.append(
            Body(part.name, label, parent, joint, part.carried, part.inertial)
        )
        if floats and part.parent is None:
            # this part carries the base, so all else that hangs on the base hangs on it
            frames = (
                step.inverse()
                for step in reversed(steps)
                if isinstance(step, Placement)
            )
            back = reduce(matmul, frames, Placement())
            self.host[None], self._frames[None] = 0, (lambda _: (back,),)
        self.host[part.name], self._frames[part.name] = len(self.made) - 1, ()
        self._elements[part.name] = []
        return label

    def add_base(self, body: Body) -> None:
        """The base becomes a body of its own."""
        self.made.append(body)
        self.host[None] = 0


_STEP = pi / STEPS_PER_HALF_TURN
_TURNS = (MotionKind.ROTATION, MotionKind.SCREW)


def with_relations(
    bodies: Sequence[Body],
    gravity: Vector | None,
    snapping: Snapping,
    sources: Mapping[str, Collection[str]],
    declared: Collection[str] = (),
    ends: Iterable[tuple[int, int]] = (),
) -> tuple[list[Body], Vector | None]:
    """Bodies and gravity, with axes that are related exactly where the numbers of the file mean it.

    Bodies in loops, between the ends of closures, stay where they are: loops close at the numbers of the file.
    """
    parents = [body.parent for body in bodies]
    looped = {
        k
        for pair in ends
        for chain in parted(*pair, parents.__getitem__)
        for k in chain
    }
    found: list[Body] = []
    literal = {
        label
        for label, own in sources.items()
        if any(e.startswith(tuple(own)) for e in snapping.literal)
    }
    named = set(snapping.symbols)
    scale = largest_offset(
        (step for body in bodies for step in body.joint.steps), snapping.known
    )
    down = _down(gravity, snapping)
    for index, body in enumerate(bodies):
        pair = _pair(found, body, down)
        if pair is None or index in looped or pair.symbols() & set(declared):
            found.append(body)
            continue
        parent = None if body.parent == GROUND else bodies[body.parent].label
        as_stated = not literal.isdisjoint(
            {body.label, parent}
        ) or not snapping.exact.isdisjoint(pair.symbols())
        found.append(replace(pair, literal=as_stated, scale=scale).related(snapping))
        if (
            body.parent == GROUND
            and down is not None
            and down.gravity
            and replace(pair, body=found[-1]).is_exact
        ):
            gravity = down.gravity
    used = {s for body in found for s in body.joint.symbols()} | {
        s for part in gravity or () for s in part.symbols()
    }
    snapping.forget(set(snapping.symbols) - named - used)
    return found, gravity


@dataclass(frozen=True)
class _Down:
    """The direction of gravity: a coordinate axis of a frame in the base."""

    frame: Placement
    axis: int
    gravity: (
        Vector | None
    )  # gravity in the base frame by the frame's angles; None for a frame without any


def _down(gravity: Vector | None, snapping: Snapping) -> _Down | None:
    numbers = [part.number for part in gravity or ()]
    if gravity is None or any(not isinstance(n, int | Fraction) for n in numbers):
        axes = [k for k, part in enumerate(gravity or ()) if part]
        return _Down(Placement(), axes[0], None) if len(axes) == 1 else None
    x, y, z = (Fraction(n) for n in numbers if isinstance(n, int | Fraction))
    frame, axis, sign = snapping.direction((x, y, z), "gravity", "_gravity")
    if frame.is_identity:
        return _Down(frame, axis, None)
    size = Fraction(f"{hypot(x, y, z):.12g}") * sign
    a, b, c = (row[axis] * size for row in frame.rotation)
    return _Down(frame, axis, (a, b, c))


@dataclass(frozen=True)
class _MotionPair:
    """A joint's first motion and what moves before it."""

    body: Body
    before: str  # what the axis is compared with, for messages
    axis: int  # the coordinate axis of the earlier motion, in the frame that it moves
    trailing: Placement  # from that frame to the parent's
    turns: bool  # whether the earlier motion is about an axis that has a place
    literal: bool = False  # whether numbers of the frames between are taken literally
    scale: float = 0.0  # the robot's largest translation, m

    @property
    def motion(self) -> Motion:
        """The joint's first motion."""
        return self.body.joint.motions[0]

    @property
    def leading(self) -> Placement:
        """From the parent's frame to where the joint moves."""
        first = self.body.joint.steps[0]
        return first if isinstance(first, Placement) else Placement()

    @property
    def is_exact(self) -> bool:
        """Whether the twist between the axes is a number whatever the symbols are."""
        rotation = multiply(self.trailing.rotation, self.leading.rotation)
        return rotation[self.axis][self.motion.axis].number is not None

    def symbols(self) -> set[str]:
        """Symbols between the two axes."""
        return {*self.trailing.symbols(), *self.leading.symbols()}

    def related(self, snapping: Snapping) -> Body:
        """The body, with intended relations between the axes made exact."""
        if not self.symbols() <= snapping.known.keys():
            return self.body
        rotation = multiply(self.trailing.rotation, self.leading.rotation)
        exact = self._rotation(rotation, snapping)
        turned = (
            self.leading.rotation
            if exact is rotation
            else multiply(transpose(self.trailing.rotation), exact)
        )
        shift = (
            self._translation(exact, snapping)
            if self.turns
            else self.leading.translation
        )
        if turned is self.leading.rotation and shift is self.leading.translation:
            return self.body
        kept: tuple[Step, ...] = self.body.joint.steps
        kept = kept[1:] if isinstance(kept[0], Placement) else kept
        steps = merge((Placement(turned, shift), *kept))
        return replace(self.body, joint=replace(self.body.joint, steps=steps))

    def _tolerance(self, intended: float) -> float:
        return min(PRECISION, intended) if self.literal else intended

    def _element(self, what: str) -> str:
        return f"joint '{self.body.joint.name}' {what} {self.before}"

    def _rotation(self, rotation: Matrix, snapping: Snapping) -> Matrix:
        """The rotation between the axes' frames, exact if its twist is meant to be."""
        numbers = np.array(
            [[snapping.numeric(entry) for entry in row] for row in rotation]
        )
        along = numbers[self.axis, self.motion.axis]
        across = np.delete(numbers[:, self.motion.axis], self.axis)
        twist = atan2(hypot(*across), along)
        steps = round(twist / _STEP)
        element, difference = self._element("axis against"), abs(twist - steps * _STEP)
        excess = rotation[self.axis][self.motion.axis] - cosine_of_turn(steps)
        if not excess or difference > max(
            self._tolerance(snapping.angle_tolerance(element)), PRECISION
        ):
            return rotation
        if not vanishes(excess, snapping.symbols):
            if not snapping.options.snap_tolerance:
                return rotation
            snapping.snaps.append(
                Snap(element, f"{twist:.9g}", f"{steps * 15}°", difference)
            )
        return self._with_twist(numbers, steps, element, snapping)

    def _with_twist(
        self, numbers: Floats, steps: int, element: str, snapping: Snapping
    ) -> Matrix:
        before, after = TO_AXIS[self.axis], TO_AXIS[self.motion.axis]
        matrix = _floats(before).T @ numbers @ _floats(after)
        if steps % STEPS_PER_HALF_TURN:
            first = atan2(matrix[0, 2], -matrix[1, 2])
            second = atan2(matrix[2, 0], matrix[2, 1])
        else:
            first, second = atan2(matrix[1, 0], matrix[0, 0]), 0.0
        one, two = (
            snapping.computed_angle(angle, f"{element}, turn", f"turn{self.body.label}")
            if abs(angle) > COMPUTED_ROUNDING
            else Angle()
            for angle in (first, second)
        )
        twist = Angle(Fraction(steps, STEPS_PER_HALF_TURN))
        return (
            before @ turn(2, one) @ turn(0, twist) @ turn(2, two) @ after.inverse()
        ).rotation

    def _translation(self, rotation: Matrix, snapping: Snapping) -> Vector:
        """The joint's place in its parent, exactly on the axis before it if it is meant to be."""
        if not any(
            m.kind in _TURNS and m.axis == self.motion.axis
            for m in self.body.joint.motions
        ):
            return self.leading.translation  # where a slide is makes no difference
        moved = rotate(self.trailing.rotation, self.leading.translation)
        place = tuple(
            a + b for a, b in zip(self.trailing.translation, moved, strict=True)
        )
        direction = tuple(row[self.motion.axis] for row in rotation)
        i, j = (self.axis + 1) % 3, (self.axis + 2) % 3
        p, d = (
            np.array([snapping.numeric(entry) for entry in v])
            for v in (place, direction)
        )
        sine = hypot(d[i], d[j])
        if sine > COMPUTED_ROUNDING:
            gap = abs(p[i] * d[j] - p[j] * d[i]) / sine
            exact = place[i] * direction[j] - place[j] * direction[i]
        else:
            gap, exact = hypot(p[i], p[j]), place[i] * place[i] + place[j] * place[j]
        element = self._element("distance of its axis from")
        tolerance = (
            PRECISION
            if self.literal or element in snapping.literal
            else LENGTH_TOLERANCE
        )
        if not exact or gap > max(tolerance, PRECISION) * self.scale:
            return self.leading.translation
        if not vanishes(exact, snapping.symbols):
            if not snapping.options.snap_tolerance:
                return self.leading.translation
            snapping.snaps.append(Snap(element, f"{gap:.3g}", "0", float(gap)))
        second = (
            0.0
            if sine <= COMPUTED_ROUNDING
            else float(p[i] * d[i] + p[j] * d[j]) / sine**2
        )
        along = [Polynomial({})] * 3
        along[self.axis] = snapping.length(
            float(p[self.axis] - second * d[self.axis]), f"d{self.body.label}", element
        )
        step = snapping.length(second, f"r{self.body.label}", element)
        met = tuple(a + step * b for a, b in zip(along, direction, strict=True))
        x, y, z = (a - b for a, b in zip(met, self.trailing.translation, strict=True))
        return rotate(transpose(self.trailing.rotation), (x, y, z))


def _pair(bodies: Sequence[Body], body: Body, down: _Down | None) -> _MotionPair | None:
    """A joint with what moves before it; None where there is no axis to compare with."""
    motions = body.joint.motions
    if not motions or motions[0].kind is MotionKind.BALL:
        return None
    if body.parent == GROUND:
        if down is None:
            return None
        return _MotionPair(
            body, "gravity", down.axis, down.frame.inverse(), turns=False
        )
    joint = bodies[body.parent].joint
    if not joint.motions or joint.motions[-1].kind is MotionKind.BALL:
        return None
    last = joint.steps[-1]
    trailing = last if isinstance(last, Placement) else Placement()
    motion = joint.motions[-1]
    return _MotionPair(
        body,
        f"joint '{joint.name}'",
        motion.axis,
        trailing,
        motion.kind is not MotionKind.TRANSLATION,
    )


def _floats(placement: Placement) -> Floats:
    return np.array(
        [[float(entry.number or 0) for entry in row] for row in placement.rotation]
    )
