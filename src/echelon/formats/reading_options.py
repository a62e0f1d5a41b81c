"""How a file is to be read, and how large and how small its numbers may be.

The limits of size keep all that is computed from a file within the range of doubles.  No robot comes near to them;
damaged files and other units than SI do.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import TypeVar

from echelon.choices import Measured
from echelon.errors import InputError
from echelon.exact.expressions import parse
from echelon.exact.numbers import Number, parts_of
from echelon.exact.polynomial import Polynomial
from echelon.mechanism.joint import Vector

ANGLE_TOLERANCE = 2e-3
"""Default distance, rad, within which angles are read as multiples of 15° and axes as coordinate directions."""

LENGTH_TOLERANCE = 1e-5
"""Translations below this fraction of the robot's largest one are read as zero, unless snapping is off."""

PRECISION = 1e-9
"""The literal reading: what agrees to nine digits is the exact number, written as well as decimals can."""

Gravity = Sequence[str | float | int] | str | None


@dataclass(frozen=True)
class StatedJoint:
    """What a joint of a robot file really is."""

    name: str  # of the joint in the file
    kind: str
    # coordinate axes and signs of a universal joint, in the frame of the joint's origin
    axes: tuple[tuple[int, int], ...]
    error: Callable[[str], InputError]  # makes an error about what states it


@dataclass(frozen=True)
class ReadingOptions:
    """Choices for reading a robot file."""

    # angles this near (rad) to a multiple of 15°, and axes this near to a coordinate direction, are read as exact. 0
    # switches snapping off
    snap_tolerance: float = ANGLE_TOLERANCE
    # give lengths systematic symbols (``px4`` for the x offset of joint 4); otherwise every symbol that has an exact
    # value, also of a description, becomes that number
    symbolic: bool = True
    floating: bool = False  # whether the root link floats
    keep_fixed_links: bool = False  # keep links that are fixed to others as bodies of their own
    independent_mimics: bool = False  # treat mimic joints as independent (as most programs do), instead of coupled
    massless: Sequence[str] = ()  # links that carry no parameters
    # ``"file"`` for what the file says (9.81 m/s² along −z if it is silent), ``"generic"`` for an unknown direction,
    # None for none, or three numbers or expressions
    gravity: Gravity = "file"
    separate_symbols: bool = False  # give every number a symbol of its own, also where magnitudes are equal
    # fixed links that are kept as bodies of their own, because a sensor cuts between them and their parents
    separate: tuple[str, ...] = ()
    # whether the forces of all drives are measured, or what the sensors of the file measure
    measured: Measured = "drives"
    joints: tuple[StatedJoint, ...] = ()  # joints that are of other types than the file says
    # give drives the usual effects where the file lists none
    usual_effects: bool = False
    # coordinates, or joints, that do not move, and where they stand (rad or m), beside those that the file names
    locked: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not 0 <= self.snap_tolerance <= 0.1:
            raise InputError(f"the snapping tolerance must be between 0 and 0.1 rad, not {self.snap_tolerance}")
        if self.measured not in ("drives", "file"):
            raise InputError(f"measured is 'drives' or 'file', not '{self.measured}'")


def gravity_vector(gravity: Gravity, stated: Vector) -> Vector | None:
    """Gravity in the base frame, m/s²."""
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


LARGEST = 10**100
"""Of lengths, masses and the like: mass times a distance squared is still far within double precision."""

SMALLEST = Fraction(1, LARGEST)
"""Of what is not zero."""

LARGEST_ANGLE = 10**9
"""Of angles, rad: beyond, the digits of a double no longer say which multiple of 15° is the nearest."""

NOT_FINITE = re.compile(r"[+-]?(\.?(nan|inf|infinity)|∞)", re.IGNORECASE)
"""Words for what is no number, which could else be names of symbols."""

AnyNumber = TypeVar("AnyNumber", bound=Number)


def checked_size(value: AnyNumber, shown: str) -> AnyNumber:
    """A number that is neither too large nor, unless it is zero, too small."""
    if not all(-LARGEST <= part <= LARGEST for part in parts_of(value)):
        raise ValueError(f"'{shown}' is too large a number: robots have lengths and masses up to 1e100, in SI units")
    if any(-SMALLEST < part < SMALLEST and part != 0 for part in parts_of(value)):
        raise ValueError(f"'{shown}' is too small a number to compute with: write 0, or use SI units")
    return value
