"""How a file is to be read."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

from echelon.errors import InputError
from echelon.exact.expressions import parse
from echelon.exact.polynomial import Polynomial
from echelon.formats.size import NOT_FINITE, checked_size
from echelon.mechanism.placement import Vector

ANGLE_TOLERANCE = 2e-3
"""Default distance, rad, within which angles are read as multiples of 15° and axes as coordinate directions."""

LENGTH_TOLERANCE = 1e-5
"""Translations below this fraction of the robot's largest one are read as zero, unless snapping is off."""

PRECISION = 1e-9
"""The literal reading: what agrees to nine digits is the exact number, written as well as decimals can."""

Gravity = Sequence[str | float | int] | str | None


@dataclass(frozen=True)
class StatedJoint:
    """What a joint of a robot file really is.

    Attributes
    ----------
    name : str
        Of the joint in the file.
    kind : "spherical", "universal" or "fixed"
    axes : tuple of (int, int)
        Coordinate axes and signs of a universal joint, in the frame of the joint's origin.
    error : callable
        Makes an error about what states it.
    """

    name: str
    kind: str
    axes: tuple[tuple[int, int], ...]
    error: Callable[[str], InputError]


@dataclass(frozen=True)
class ReadingOptions:
    """Choices for reading a robot file.

    Attributes
    ----------
    tolerance : float
        Angles this near (rad) to a multiple of 15°, and axes this near to a coordinate direction, are read as exact.
        0 switches snapping off.
    symbolic : bool
        Give lengths systematic symbols (``px4`` for the x offset of joint 4); otherwise every symbol that has an exact
        value, also of a description, becomes that number.
    floating : bool
        Whether the root link floats.
    every_link : bool
        Keep links that are fixed to others as bodies of their own.
    independent_mimics : bool
        Treat mimic joints as independent (as most programs do), instead of coupled.
    massless : sequence of str
        Links that carry no parameters.
    gravity : Gravity
        ``"file"`` for what the file says (9.81 m/s² along −z if it is silent), ``"generic"`` for an unknown direction,
        None for none, or three numbers or expressions.
    separate_symbols : bool
        Give every number a symbol of its own, also where magnitudes are equal.
    separate : tuple of str
        Fixed links that are kept as bodies of their own, because a sensor cuts between them and their parents.
    measured : "drives" or "file"
        Whether the forces of all drives are measured, or what the sensors of the file measure.
    joints : tuple of StatedJoint
        Joints that are of other types than the file says.
    friction : bool
        Give the drive of every joint viscous and Coulomb friction and an offset, for files that cannot state any.
    """

    tolerance: float = ANGLE_TOLERANCE
    symbolic: bool = True
    floating: bool = False
    every_link: bool = False
    independent_mimics: bool = False
    massless: Sequence[str] = ()
    gravity: Gravity = "file"
    separate_symbols: bool = False
    separate: tuple[str, ...] = ()
    measured: Literal["drives", "file"] = "drives"
    joints: tuple[StatedJoint, ...] = ()
    friction: bool = False

    def __post_init__(self) -> None:
        if not 0 <= self.tolerance <= 0.1:
            raise InputError(f"the snapping tolerance must be between 0 and 0.1 rad, not {self.tolerance}")
        if self.measured not in ("drives", "file"):
            raise InputError(f"measured is 'drives' or 'file', not '{self.measured}'")


def gravity_vector(gravity: Gravity, stated: Vector) -> Vector | None:
    """Gravity in the base frame, m/s².

    Parameters
    ----------
    gravity : Gravity
    stated : 3 of Polynomial
        What the file says.

    Raises
    ------
    InputError
        If the choice is none of those that :class:`ReadingOptions` lists.
    """
    if gravity is None or gravity == "none":
        return None
    if gravity == "file":
        return stated if any(stated) else None
    if gravity == "generic":
        return (Polynomial.generator("gx"), Polynomial.generator("gy"), Polynomial.generator("gz"))
    parts = gravity.split(",") if isinstance(gravity, str) else list(gravity)
    if len(parts) != 3:
        raise InputError("gravity is three numbers or expressions, 'generic', 'none' or 'file'")
    try:
        x, y, z = (_component(str(part).strip()) for part in parts)
    except ValueError as error:
        raise InputError(str(error), element="gravity") from None
    return (x, y, z) if x or y or z else None


def _component(text: str) -> Polynomial:
    if NOT_FINITE.fullmatch(text):
        raise ValueError(f"'{text}' is not a finite number")
    value = parse(text)
    for coefficient in value.terms.values():
        checked_size(coefficient, text)
    return value
