"""Bodies, and their joints: sequences of constant placements, with exact entries, and elementary motions.

Every joint, whatever its number of degrees of freedom, is one joint without bodies inside: a universal joint is two
rotations, a planar joint two translations and a rotation, a floating joint three translations and a ball.  An axis
that is not a coordinate axis is a placement that turns it into one.  So the dynamics needs to know four motions only.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from fractions import Fraction
from functools import cached_property
from typing import Any, TypeVar

from echelon.algebra import Angle, Number, Polynomial, as_polynomial, parse
from echelon.shared import PER_BODY, InputError

T = TypeVar("T")
Square = tuple[tuple[T, T, T], tuple[T, T, T], tuple[T, T, T]]
Vector = tuple[Polynomial, Polynomial, Polynomial]
Matrix = Square[Polynomial]

_ZERO, _ONE = Polynomial({}), Polynomial.constant(1)
ORIGIN: Vector = (_ZERO, _ZERO, _ZERO)
IDENTITY: Matrix = ((_ONE, _ZERO, _ZERO), (_ZERO, _ONE, _ZERO), (_ZERO, _ZERO, _ONE))


@dataclass(frozen=True)
class Placement:
    """A frame placed in a reference frame: x_reference = rotation · x + translation."""

    rotation: Matrix = (
        IDENTITY  # columns are the placed frame's axes in the reference frame
    )
    translation: Vector = ORIGIN  # origin of the placed frame in the reference frame, m

    @property
    def is_identity(self) -> bool:
        """Whether both frames coincide."""
        return self.rotation == IDENTITY and self.translation == ORIGIN

    def __matmul__(self, other: Placement) -> Placement:
        """Composition: a placement that is given in this frame, in the frame that this placement is given in."""
        if self.is_identity or other.is_identity:
            return other if self.is_identity else self
        moved = rotate(self.rotation, other.translation)
        x, y, z = (a + b for a, b in zip(self.translation, moved, strict=True))
        return Placement(multiply(self.rotation, other.rotation), (x, y, z))

    def inverse(self) -> Placement:
        """The reference frame placed in this one."""
        back = transpose(self.rotation)
        x, y, z = rotate(back, self.translation)
        return Placement(back, (-x, -y, -z))

    def entries(self) -> list[Polynomial]:
        """All entries, those of the translation last."""
        return [*(entry for row in self.rotation for entry in row), *self.translation]

    def symbols(self) -> list[str]:
        """Geometry symbols that occur."""
        return sorted({s for e in self.entries() for s in e.symbols()})


def shift(x: Polynomial | int, y: Polynomial | int, z: Polynomial | int) -> Placement:
    """A pure translation."""
    return Placement(IDENTITY, (as_polynomial(x), as_polynomial(y), as_polynomial(z)))


def turn(axis: int, angle: Angle) -> Placement:
    """A rotation about coordinate axis 0, 1 or 2 (x, y, z) by an exact angle."""
    return turn_by(axis, angle.cos(), angle.sin())


def turn_by(axis: int, c: Polynomial, s: Polynomial) -> Placement:
    """A rotation about a coordinate axis by the cosine and sine of an angle."""
    return Placement(turned(IDENTITY, axis, c, s))


def turned(identity: Square[T], axis: int, c: T, s: T) -> Square[T]:
    """The unit matrix turned about a coordinate axis, with entries of any numbers."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    entries: list[list[Any]] = [list(row) for row in identity]
    entries[i][i], entries[i][j], entries[j][i], entries[j][j] = c, -s, s, c  # type: ignore[operator]
    return as_matrix(entries)


def moved_by(
    motion: Motion, cosine: Polynomial, sine: Polynomial, travel: Polynomial
) -> Placement:
    """The placement of a motion with the cosine and sine of an angle, and a travel (of a screw: the angle)."""
    along = [_ZERO] * 3
    if motion.kind is not MotionKind.ROTATION:
        along[motion.axis] = (
            travel
            * motion.sign
            * (motion.pitch if motion.kind is MotionKind.SCREW else 1)
        )
    return shift(*along) @ turn_by(motion.axis, cosine, sine * motion.sign)


def as_matrix(entries: list[list[T]]) -> Square[T]:
    """Nested lists as the tuple form."""
    (a, b, c), (d, e, f), (g, h, i) = entries
    return ((a, b, c), (d, e, f), (g, h, i))


def rotate(matrix: Matrix, vector: Vector) -> Vector:
    """Matrix times vector."""
    x, y, z = (
        Polynomial.sum(a * b for a, b in zip(row, vector, strict=True) if a and b)
        for row in matrix
    )
    return (x, y, z)


def multiply(left: Matrix, right: Matrix) -> Matrix:
    """Matrix product."""
    columns = transpose(right)
    return transpose(
        (rotate(left, columns[0]), rotate(left, columns[1]), rotate(left, columns[2]))
    )


def transpose(matrix: Square[T]) -> Square[T]:
    """Transpose, which for a rotation is the inverse."""
    (a, b, c), (d, e, f), (g, h, i) = matrix
    return ((a, d, g), (b, e, h), (c, f, i))


X, Y, Z = range(3)


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
        if self.kind is MotionKind.BALL:
            return tuple(f"{self.name}.{c}" for c in "wxyz")
        return (self.name,)

    @cached_property
    def velocities(self) -> tuple[str, ...]:
        """Names of the velocity coordinates; a ball has the angular velocity in the moved frame, rad/s."""
        if self.kind is MotionKind.BALL:
            return tuple(f"{self.name}.{c}" for c in "xyz")
        return (self.name,)


Step = Placement | Motion


FLOATING = "floating"
"""Kind of the joint of a floating base, whatever a file's format calls it."""


@dataclass(frozen=True)
class Joint:
    """The connection of a body to its parent."""

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

    @property
    def is_floating(self) -> bool:
        """Whether the file says that the body moves freely, without drives: three translations, then a ball."""
        return self.kind == FLOATING

    def symbols(self) -> list[str]:
        """Geometry symbols of this joint."""
        found: set[str] = set()
        for step in self.steps:
            found.update(
                step.symbols() if isinstance(step, Placement) else step.pitch.symbols()
            )
        return sorted(found)


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
    return (
        *(translation(f"{name}.t{'xyz'[axis]}", axis) for axis in (X, Y, Z)),
        ball(f"{name}.r"),
    )


GROUND = -1  # parent index of a body that hangs on the fixed world

ALL = tuple(range(PER_BODY))  # all ten standard parameters of a body


@dataclass(frozen=True)
class Body:
    """One rigid body."""

    name: str  # name in the file
    # short label that names its parameters: ``"3"`` gives XX3 … M3.  Bodies with one label, such as those of identical
    # legs, share one set of parameters, each about its own frame
    label: str
    parent: int  # index of the parent body, or :data:`GROUND`
    joint: Joint  # connects the parent's frame to this body's frame
    # which of XX … M it carries; none for a massless body, ZZ for a rotor whose other inertia counts to its carrier
    carried: tuple[int, ...] = ALL
    # standard parameters stated by the file, about the body's frame; None where the file is silent
    inertial: tuple[float, ...] | None = None
    # links that it is made of and whose stated inertias no body can have, with the reasons in words
    impossible: tuple[str, ...] = field(default=(), compare=False)

    @property
    def massless(self) -> bool:
        """Whether it carries no parameters."""
        return not self.carried


@dataclass(frozen=True)
class Symbol:
    """A geometry symbol."""

    name: str
    value: float | None = None  # numeric value in SI units, if known
    exact: str | None = (
        None  # the value as exact text, where it has one (``"0.333"``, ``"sqrt(2)/10"``)
    )
    meaning: str = ""  # where the symbol comes from, for people
    # what it is in terms of angle symbols, where a reader named a sum such as 0.1 + 0.3·cos(roll2)
    stands_for: Polynomial | None = None
    # tan² of an angle below a right one that has no exact value, such as 4 in the direction (1, 2, 0)
    tangent_squared: Fraction | None = None
    # range in which logs have to tell the value, which belongs to laws of effects only
    fit: tuple[float, float] | None = None

    @property
    def number(self) -> Number | None:
        """The exact value, where it is a number of the field of exact numbers."""
        return None if (value := self.expression) is None else value.number

    @property
    def expression(self) -> Polynomial | None:
        """The exact value, perhaps with π as a generator."""
        if self.exact is None:
            return None
        try:
            return parse(self.exact)
        except ValueError as error:
            raise InputError(str(error), element=f"symbol '{self.name}'") from None
