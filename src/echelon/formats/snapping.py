"""How a file is to be read, and its intended geometry: from the numbers of a file to exact placements.

Files round: π/2 stands as 1.5708, an axis as (0, −1, 4e-8), a zero as 1e-17.  Taken literally such numbers destroy the
dependences between parameters and the count comes out wrong.  So angles near multiples of 15° and axes near coordinate
directions become exact, tiny translations become zero, and every such decision is recorded as a :class:`Snap`.  Other
numbers become symbols named by joint, with equal magnitudes sharing one symbol, and keep their values.

Limits of size keep all that is computed from a file within the range of doubles.  No robot comes near to them; damaged
files and other units than SI do.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import reduce
from math import atan2, ceil, hypot, log10, pi
from operator import matmul
from typing import TypeVar

from echelon.algebra import (
    PI,
    STEPS_PER_HALF_TURN,
    Angle,
    Number,
    Polynomial,
    Rational,
    as_polynomial,
    decimal_text,
    format_polynomial,
    inverse,
    parse,
    parts_of,
    pi_generators,
    square_root,
)
from echelon.formats.literal import (
    DOUBLE_DIGITS,
    DOUBLE_ROUNDING,
    LiteralMotion,
    LiteralPlacement,
    StatedJoint,
    Triple,
    numeric_placements,
)
from echelon.robot import (
    Motion,
    MotionKind,
    Placement,
    Snap,
    Step,
    Symbol,
    Vector,
    as_matrix,
    floating_motions,
    planar_motions,
    shift,
    turn,
)
from echelon.shared import InputError, Measured, listed

ANGLE_TOLERANCE = 2e-3
"""Default distance, rad, within which angles are read as multiples of 15° and axes as coordinate directions."""

LENGTH_TOLERANCE = 1e-5
"""Translations below this fraction of the robot's largest one are read as zero, unless snapping is off."""

PRECISION = 1e-9
"""Difference, rad or share of a length, up to which the literal reading takes a number for the exact one."""

Gravity = Sequence[str | float | int] | str | None


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
    keep_fixed_links: bool = (
        False  # keep links that are fixed to others as bodies of their own
    )
    independent_mimics: bool = False  # treat mimic joints as independent (as most programs do), instead of coupled
    massless: Sequence[str] = ()  # links that carry no parameters
    # ``"file"`` for what the file says (9.81 m/s² along −z if it is silent), ``"generic"`` for an unknown direction,
    # None for none, or three numbers or expressions
    gravity: Gravity = "file"
    separate_symbols: bool = (
        False  # give every number a symbol of its own, also where magnitudes are equal
    )
    # fixed links that are kept as bodies of their own, because a sensor cuts between them and their parents
    separate: tuple[str, ...] = ()
    # whether the forces of all drives are measured, or what the sensors of the file measure
    measured: Measured = "drives"
    joints: tuple[
        StatedJoint, ...
    ] = ()  # joints that are of other types than the file says
    looped: bool = False  # whether there are loops
    # give drives the usual effects where the file lists none
    usual_effects: bool = False
    # coordinates, or joints, that do not move, and where they stand (rad or m), beside those that the file names
    locked: Mapping[str, float] = field(default_factory=dict)
    # elements and attributes of a robot file that are ignored, though they may change how it moves
    ignore: tuple[str, ...] = ()
    experiment: str = ""  # the one of several that is read alone

    def __post_init__(self) -> None:
        if not 0 <= self.snap_tolerance <= 0.1:
            raise InputError(
                f"the snapping tolerance must be between 0 and 0.1 rad, not {self.snap_tolerance}"
            )
        if self.measured not in ("drives", "file"):
            raise InputError(f"measured is 'drives' or 'file', not '{self.measured}'")


def gravity_vector(gravity: Gravity, stated: Vector | None = None) -> Vector | None:
    """Gravity in the base frame, m/s²."""
    if gravity is None or gravity == "none":
        return None
    if gravity == "file":
        return stated if any(stated or ()) else None
    if gravity == "generic":
        return (
            Polynomial.generator("gx"),
            Polynomial.generator("gy"),
            Polynomial.generator("gz"),
        )
    parts = gravity.split(",") if isinstance(gravity, str) else list(gravity)
    if len(parts) != 3:
        raise InputError(
            "gravity is three numbers or expressions, 'generic', 'none' or 'file'"
        )
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
"""Largest length, mass or the like, SI: mass times a squared distance is still far within double precision."""

SMALLEST = Fraction(1, LARGEST)  # of what is not zero

LARGEST_ANGLE = 10**9
"""Of angles, rad: beyond, the digits of a double no longer say which multiple of 15° is the nearest."""

NOT_FINITE = re.compile(r"[+-]?(\.?(nan|inf|infinity)|∞)", re.IGNORECASE)
"""Words for what is no number, which could else be names of symbols."""

AnyNumber = TypeVar("AnyNumber", bound=Number)


def is_tiny(value: Rational) -> bool:
    """Whether a number is so small, and not zero, that nobody means it."""
    return -SMALLEST < value < SMALLEST and value != 0


def tiny_notes(places: Sequence[str]) -> list[str]:
    """That tiny numbers at some places of a file are read as zero."""
    if not places:
        return []
    return [
        f"taken as zero, since no robot has numbers below 1e-100: {listed(places, 3)}"
    ]


def checked_size(value: AnyNumber, shown: str) -> AnyNumber:
    """A number that is neither too large nor, unless it is zero, too small."""
    if not all(-LARGEST <= part <= LARGEST for part in parts_of(value)):
        raise ValueError(
            f"'{shown}' is too large a number: robots have lengths and masses up to 1e100, in SI units"
        )
    if any(is_tiny(part) for part in parts_of(value)):
        raise ValueError(
            f"'{shown}' is too small a number to compute with: write 0, or use SI units"
        )
    return value


_QUARTER = Fraction(1, 2)
TO_AXIS = (turn(1, Angle(_QUARTER)), turn(0, Angle(-_QUARTER)), Placement())
"""Rotations that bring z to the x, y and z axis."""

_STEP = pi / STEPS_PER_HALF_TURN
COMPUTED_ROUNDING = 10 * DOUBLE_ROUNDING
"""Residue of a zero, or of a multiple of 15°, after a few roundings of doubles."""
LENGTH_DIGITS = DOUBLE_DIGITS - 3
"""Digits of a length that a few roundings of a double leave."""
PRINTED_DIGITS = 6
"""Digits that C prints by default: many files have quaternions and angles with so many."""


@dataclass
class Snapping:
    """Reads literal numbers as exact ones while keeping account."""

    source: str  # name of the file, for messages
    options: ReadingOptions
    literal: Collection[str] = ()  # elements to take literally
    symbols: dict[str, Symbol] = field(default_factory=dict)
    scale: float = 0.0  # the largest translation of the file, m
    snaps: list[Snap] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._angles: list[tuple[float, str]] = []
        self._lengths: dict[Polynomial, str] = {}
        self.radians: dict[str, Rational] = {}
        """Numbers that were read as angles, by element, rad."""
        self.exact: set[str] = set()
        """Symbols of angles that are stated exactly."""

    # -- placements ------------------------------------------------------------------------------------------------

    def placement(self, literal: LiteralPlacement, label: str) -> Placement:
        """A literal placement with exact rotation; translations stay numbers until :meth:`name_lengths`."""
        x, y, z = (
            as_polynomial(self._without_digits(v, literal.element)) for v in literal.xyz
        )
        placed = shift(x, y, z) @ self.rotation(literal.rpy, literal.element, label)
        return placed.inverse() if literal.inverse else placed

    def rotation(self, angles: Triple, element: str, label: str) -> Placement:
        """A rotation by roll, pitch and yaw."""
        placed = Placement()
        general = self.options.looped and self._is_general(angles, element)
        for axis, word in ((2, "yaw"), (1, "pitch"), (0, "roll")):
            value = angles[axis]
            if value:  # in a loop a frame of a general orientation is near a multiple of 15° by chance
                chance = general and abs(value - nearest_step(float(value))) > _written(
                    value
                )
                read = self.named_angle if chance else self.angle
                placed = placed @ turn(
                    axis, read(value, f"{element} {word}", f"{word}{label}")
                )
        return placed

    def _is_general(self, angles: Iterable[Rational | float], element: str) -> bool:
        """Whether an angle is no multiple of 15°."""
        return any(
            abs(float(a) - nearest_step(float(a))) > self.angle_tolerance(element)
            for a in angles
        )

    def placements(self, literal: Iterable[LiteralPlacement], label: str) -> Placement:
        """Several of them, one after the other."""
        return reduce(
            matmul, (self.placement(step, label) for step in literal), Placement()
        )

    def _without_digits(self, value: Rational, element: str) -> Rational:
        """A length without the last digits of a double: 0.175 for 0.1749…933.

        If it is no short decimal without them, it keeps fourteen digits of more than fifteen: those of sums of lengths
        agree so far.
        """
        if not self.scale or not self.options.snap_tolerance or element in self.literal:
            return value
        digits = LENGTH_DIGITS - ceil(log10(self.scale))
        short = round(Fraction(value), digits)
        if abs(float(short - value)) <= DOUBLE_ROUNDING * self.scale:
            return short
        if Fraction(value).denominator > 10**DOUBLE_DIGITS:
            return round(Fraction(value), digits + 2)
        return value

    def name_lengths(
        self, steps: tuple[Step, ...], label: str, element: str
    ) -> tuple[Step, ...]:
        """The steps with tiny translations dropped and the others, if so wished, given symbols."""

        def named(value: Polynomial, axis: str) -> Polynomial:
            return self._length(value, f"p{axis}{label}", f"{element} {axis}")

        return tuple(
            _translated(step, named) if isinstance(step, Placement) else step
            for step in steps
        )

    def without_noise(self, placement: Placement, element: str) -> Placement:
        """A placement with tiny translations dropped and the others left as numbers."""
        return _translated(
            placement, lambda value, axis: self._rounded(value, f"{element} {axis}")
        )

    def _rounded(self, value: Polynomial, element: str) -> Polynomial:
        size = abs(self.numeric(value)) if value else 0.0
        if value and size <= self.length_tolerance(element):
            self.snaps.append(Snap(element, f"{self.numeric(value):.3g}", "0", size))
            return Polynomial({})
        return value

    def _length(self, value: Polynomial, name: str, element: str) -> Polynomial:
        value = self._rounded(value, element)
        if not value or not self.options.symbolic:
            return value
        size = abs(self.numeric(value))
        sign = 1 if self.numeric(value) > 0 else -1
        known = (
            None
            if self.options.separate_symbols
            else self._same_length(sign * value, size, element)
        )
        if known is None:
            number = (sign * value).number
            exact, stands_for = (
                (decimal_text(number), None)
                if number is not None
                else (None, sign * value)
            )
            known = self._new_symbol(
                name, Symbol(name, size, exact, element, stands_for)
            )
            self._lengths[sign * value] = known
        return sign * Polynomial.generator(known)

    def _same_length(self, value: Polynomial, size: float, element: str) -> str | None:
        """The symbol of a length that this one is meant to be equal to."""
        if value in self._lengths:
            return self._lengths[value]
        tolerance = 0.0 if element in self.literal else self.length_tolerance(element)
        for symbol in self._lengths.values():
            known = self.symbols[symbol].value or 0.0
            if abs(known - size) <= tolerance:
                self.snaps.append(
                    Snap(
                        element,
                        f"{size:.9g}",
                        f"{symbol} = {known:.9g}",
                        abs(known - size),
                    )
                )
                return symbol
        return None

    def _pitch(self, value: Polynomial, name: str, element: str) -> Polynomial:
        """The pitch of a screw: a symbol where lengths have names, or where it has π in it."""
        if value.number is not None and (
            not value or not self.options.symbolic or self.options.looped
        ):
            return value
        size = value.evaluate(pi_generators(pi), float)
        sign = 1 if size > 0 else -1
        if (sign * value) not in self._lengths or self.options.separate_symbols:
            symbol = Symbol(name, abs(size), format_polynomial(sign * value), element)
            self._lengths[sign * value] = self._new_symbol(name, symbol)
        return sign * Polynomial.generator(self._lengths[sign * value])

    def length(self, value: float, name: str, element: str) -> Polynomial:
        """A measured length: a symbol, or the decimal that it is to twelve digits."""
        return self._length(as_polynomial(Fraction(f"{value:.12g}")), name, element)

    def length_tolerance(self, element: str) -> float:
        """Largest difference, m, at which a length is read as zero or as equal to another one."""
        if not self.options.snap_tolerance:
            return 0.0
        return (PRECISION if element in self.literal else LENGTH_TOLERANCE) * self.scale

    # -- angles ----------------------------------------------------------------------------------------------------

    def angle(
        self,
        value: Rational | float,
        element: str,
        name: str,
        square: Fraction | None = None,
    ) -> Angle:
        """A number of radians as an exact angle: a multiple of 15°, or a multiple of 90° and a symbol."""
        number = self.angle_value(value, element)
        steps = round(number / _STEP)
        difference = abs(number - steps * _STEP)
        if difference <= max(
            self.angle_tolerance(element), DOUBLE_ROUNDING * max(1.0, abs(number))
        ):
            if difference > DOUBLE_ROUNDING * max(1.0, abs(number)):
                self.snaps.append(
                    Snap(element, _decimal(value), f"{steps * 15}°", difference)
                )
            return Angle(Fraction(steps, STEPS_PER_HALF_TURN))
        return self.named_angle(value, element, name, square)

    def computed_angle(
        self, value: float, element: str, name: str, square: Fraction | None = None
    ) -> Angle:
        """An angle that was computed; in loops it is near a multiple of 15° by chance unless it is very near."""
        chance = (
            self.options.looped
            and abs(value - nearest_step(value)) > 10.0**-PRINTED_DIGITS
        )
        read = self.named_angle if chance else self.angle
        return read(value, element, name, square)

    def named_angle(
        self,
        value: Rational | float | Angle,
        element: str,
        name: str,
        square: Fraction | None = None,
    ) -> Angle:
        """A number of radians as a multiple of 90° and a symbol, however near to a multiple of 15° it is.

        ``square`` is that of its tangent, if that is known.
        """
        exact = value if isinstance(value, Angle) else None
        if isinstance(value, int | Fraction):
            exact = Angle(radians=Fraction(value))
        number = self.angle_value(value if exact is None else exact.value, element)  # type: ignore[arg-type]
        quarters = round(number / (pi / 2))
        rest = number - quarters * (pi / 2)
        sign = 1 if rest > 0 else -1
        text = None if exact is None else _rest_text(exact, quarters, sign)
        arc = square if square is None or not quarters % 2 else 1 / square
        symbol = self._angle_symbol(
            Symbol(name, abs(rest), text, element, tangent_squared=arc)
        )
        if isinstance(value, Angle):
            self.exact.add(symbol)
        return Angle(Fraction(quarters, 2), ((symbol, sign),))

    def angle_value(self, value: Rational | float, element: str) -> float:
        """An angle in floats, if these still tell angles apart."""
        number = float(value)
        if not isinstance(value, float):
            self.radians[element] = value
        if abs(number) > LARGEST_ANGLE:
            problem = f"{number:.3g} rad is too large for an angle: robots have angles up to {LARGEST_ANGLE:.0e}"
            raise InputError(problem, source=self.source, element=element)
        return number

    def angle_tolerance(self, element: str) -> float:
        """Largest difference, rad, at which an angle is read as a multiple of 15°."""
        if element in self.literal:
            return min(PRECISION, self.options.snap_tolerance)
        return self.options.snap_tolerance

    def _angle_symbol(self, wanted: Symbol) -> str:
        size = wanted.value or 0.0
        for known, symbol in self._angles:
            # a number that is read once more is the same number
            apart = (
                self.options.separate_symbols
                and self.symbols[symbol].meaning != wanted.meaning
            )
            if abs(known - size) <= 10.0**-LENGTH_DIGITS and not apart:
                return symbol
        symbol = self._new_symbol(wanted.name, wanted)
        self._angles.append((size, symbol))
        return symbol

    # -- motions ---------------------------------------------------------------------------------------------------

    def motion(self, literal: LiteralMotion, label: str) -> tuple[Step, ...]:
        """A literal motion as elementary motions, between placements if its axis is not a coordinate axis."""
        if literal.kind == MotionKind.BALL:
            return (Motion(MotionKind.BALL, literal.name),)
        if literal.kind == "floating":
            return floating_motions(literal.name)
        mounting, axis, sign = self._axis(literal, label)
        if literal.kind == "planar":
            flip = turn((axis + 1) % 3, Angle(Fraction(1))) if sign < 0 else Placement()
            mounting, motions = mounting @ flip, planar_motions(literal.name, axis)
        else:
            assert isinstance(literal.kind, MotionKind)
            pitch = self._pitch(
                literal.pitch, f"pitch{label}", f"{literal.element} pitch"
            )
            motions = (Motion(literal.kind, literal.name, axis, sign, pitch),)
        return (mounting, *motions, mounting.inverse())

    def aim(self, literal: LiteralMotion, label: str) -> Placement:
        """A frame whose z axis lies along the axis of a motion."""
        return _aimed(*self._axis(literal, label))

    def aim_at(self, direction: Triple, element: str, label: str) -> Placement:
        """A frame whose z axis lies along a direction of any length."""
        return _aimed(*self.direction(direction, element, label))

    def _axis(self, literal: LiteralMotion, label: str) -> tuple[Placement, int, int]:
        """A placement, a coordinate axis of it, and a sign, that together give the axis of a motion."""
        element = f"{literal.element} axis"
        turns, direction = self._axis_frame(literal, element)
        mounting, axis, sign = self.direction(direction, element, label)
        return self.placements(turns, label) @ mounting, axis, sign

    def _axis_frame(
        self, literal: LiteralMotion, element: str
    ) -> tuple[tuple[LiteralPlacement, ...], Triple]:
        """Turns to the frame in which an axis is simplest, and the axis there.

        What is along a coordinate axis of the joint's frame is not seen to be so in another frame, where all of its
        components are rounded.
        """
        turns, axis = literal.turns, literal.axis
        frames = [(turns, axis)]
        for count in range(len(turns)):
            x, y, z = numeric_placements(turns[count:])[:3, :3] @ [
                float(v) for v in axis
            ]
            frames.append(
                (turns[:count], (_shortened(x), _shortened(y), _shortened(z)))
            )
        rounding = 2 * max(map(_written, axis)) / hypot(*axis)  # two rounded components
        return max(
            frames, key=lambda frame: self._simplicity(frame[1], element, rounding)
        )  # the first of equals

    def _simplicity(self, direction: Triple, element: str, rounding: float) -> int:
        """3 for a coordinate axis, 2 for azimuth and inclination at multiples of 15°, 1 for one of them, 0 for none.

        One of them may be there by chance, so it has to be within the rounding error of the axis, rad.
        """
        x, y, z = (float(v) for v in direction)
        tolerance = max(self.angle_tolerance(element), DOUBLE_ROUNDING)
        if min(hypot(y, z), hypot(x, z), hypot(x, y)) <= tolerance * hypot(x, y, z):
            return 3
        off = [
            abs(angle - nearest_step(angle))
            for angle in (atan2(y, x), atan2(hypot(x, y), z))
        ]
        if max(off) <= tolerance:
            return 2
        return 1 if min(off) <= min(tolerance, rounding) else 0

    def direction(
        self, direction: Triple, element: str, label: str
    ) -> tuple[Placement, int, int]:
        """A placement, a coordinate axis of it, and a sign, that together give a direction of any length."""
        x, y, z = (float(v) for v in direction)
        for axis, component in enumerate((x, y, z)):
            rest = [v for k, v in enumerate((x, y, z)) if k != axis]
            off = atan2(hypot(*rest), abs(component))
            if off <= max(self.angle_tolerance(element), DOUBLE_ROUNDING):
                if off:
                    text = " ".join(_decimal(v) for v in direction)
                    self.snaps.append(Snap(element, f"({text})", "xyz"[axis], off))
                return Placement(), axis, 1 if component > 0 else -1
        angles = atan2(y, x), atan2(hypot(x, y), z)
        general = self._is_general(angles, element)
        if general:
            with suppress(ValueError):
                return _turned_to(direction)
        read = self.computed_angle if general else self.angle
        squares = [Fraction(v) ** 2 for v in direction]
        arcs = (
            _ratio(squares[1], squares[0]),
            _ratio(squares[0] + squares[1], squares[2]),
        )
        azimuth = read(angles[0], f"{element} azimuth", f"azimuth{label}", arcs[0])
        elevation = read(
            angles[1], f"{element} inclination", f"inclination{label}", arcs[1]
        )
        return turn(2, azimuth) @ turn(1, elevation), 2, 1

    # -- symbols -------------------------------------------------------------------------------------------------------

    @property
    def known(self) -> dict[str, float]:
        """Values of the symbols that have one."""
        return {
            name: symbol.value
            for name, symbol in self.symbols.items()
            if symbol.value is not None
        }

    def numeric(self, value: Polynomial) -> float:
        """Numeric value of an expression in angle symbols."""
        return value.at(self.known)

    def forget(self, names: Collection[str]) -> None:
        """Take back symbols that nothing uses."""
        for name in names:
            del self.symbols[name]
        self._angles = [
            (size, name) for size, name in self._angles if name in self.symbols
        ]

    def _new_symbol(self, name: str, symbol: Symbol) -> str:
        unique, suffix = name, "b"
        while unique in self.symbols:
            unique, suffix = name + suffix, chr(ord(suffix) + 1)
        self.symbols[unique] = replace(symbol, name=unique)
        return unique


def _aimed(mounting: Placement, axis: int, sign: int) -> Placement:
    """A frame whose z axis lies along a coordinate axis of a placement, or against it."""
    return (
        mounting
        @ TO_AXIS[axis]
        @ (turn(0, Angle(Fraction(1))) if sign < 0 else Placement())
    )


def _translated(
    placement: Placement, read: Callable[[Polynomial, str], Polynomial]
) -> Placement:
    """A placement with other components of its translation."""
    x, y, z = (
        read(value, axis)
        for axis, value in zip("xyz", placement.translation, strict=True)
    )
    return Placement(placement.rotation, (x, y, z))


def _ratio(top: Fraction, bottom: Fraction) -> Fraction | None:
    return top / bottom if top and bottom else None


def nearest_step(angle: float) -> float:
    """The multiple of 15° next to an angle."""
    return round(angle / _STEP) * _STEP


def _shortened(component: float) -> Fraction:
    """A component of a computed direction without the noise of computing it."""
    return round(Fraction(component), DOUBLE_DIGITS)


def _written(value: Rational | float) -> float:
    """The rounding error of an angle, rad, from the number of its digits."""
    number = Fraction(value)
    digits = next(
        (d for d in range(PRINTED_DIGITS) if (number * 10**d).denominator == 1),
        PRINTED_DIGITS,
    )
    return 10.0**-digits


def _turned_to(direction: Triple) -> tuple[Placement, int, int]:
    """A direction by exact numbers, so that points along it lie on the axis; ValueError if its length is none."""
    # the shortest turn takes z there
    size = square_root(sum(Fraction(v) ** 2 for v in direction))
    x, y, z = (v * inverse(size) for v in direction)
    back = inverse(1 + z)
    rows = [
        [1 - x * x * back, -x * y * back, x],
        [-x * y * back, 1 - y * y * back, y],
        [-x, -y, z],
    ]
    return (
        Placement(as_matrix([[as_polynomial(entry) for entry in row] for row in rows])),
        2,
        1,
    )


def _rest_text(angle: Angle, quarters: int, sign: int) -> str:
    """The exact text of what an angle is more, or less, than a number of right angles."""
    turns = Polynomial({((PI, 1),): sign * (angle.half_turns - Fraction(quarters, 2))})
    radians = sign * angle.radians
    if not turns or not radians:
        return format_polynomial(turns) if turns else decimal_text(radians)
    return f"{format_polynomial(turns)} {'+' if radians > 0 else '-'} {decimal_text(abs(radians))}"


def _decimal(value: Rational | float) -> str:
    return repr(float(value)) if not isinstance(value, int) else str(value)
