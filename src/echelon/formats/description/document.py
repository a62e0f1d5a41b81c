"""Descriptions as plain data: parsed scalar by scalar as written, with the line of every element, and checked.

Their symbols and expressions are read with errors that name the place.  Angles may be given as decimals, which round:
1.5708 is read as π/2 by the same rules as in other robot files (see :mod:`echelon.formats.snapping`).  An angle that is
stated exactly, with ``pi`` or symbols, is never moved.
"""

from __future__ import annotations

import keyword
import math
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import numpy as np

from echelon.algebra import (
    CERTIFICATE_BITS,
    DEFAULT_SEED,
    PER_PI,
    PI,
    RESERVED,
    STEPS_PER_HALF_TURN,
    Angle,
    Number,
    Polynomial,
    PrimeField,
    Rational,
    Surd,
    as_angle,
    is_trigonometric,
    parse,
    parse_angle,
    pi_generators,
    random_generator,
    residues_at,
    symbol_of,
)
from echelon.formats.bodies import BASE
from echelon.formats.literal import central_inertial
from echelon.formats.snapping import (
    NOT_FINITE,
    PRINTED_DIGITS,
    ReadingOptions,
    Snapping,
    checked_size,
    gravity_vector,
)
from echelon.robot import (
    IDENTITY,
    ORIGIN,
    Matrix,
    Mechanism,
    Placement,
    Snap,
    Symbol,
    Vector,
    X,
    Y,
    Z,
    symbol_roles,
    turn,
)
from echelon.robot import geometry as geometry_of
from echelon.shared import (
    DESCRIPTION_NODES,
    InputError,
    check_identifier,
    decoded,
    nearest,
    nearest_of,
    parse_json,
    parse_yaml,
    shortened,
)

if TYPE_CHECKING:
    from echelon.formats.schema.robot_schema import Inertial, RobotDescription
    from echelon.formats.schema.schema_types import Frame


@dataclass(frozen=True)
class Document:
    """A description as plain data: mappings, lists, texts, None (and, from JSON, truth values)."""

    data: Any
    source: str  # name of the file, for messages
    # line, counted from 1, of every element by its path; empty for JSON
    lines: Mapping[str, int] = field(default_factory=dict)
    # what the file calls elements, by the beginnings of their paths, where it is of another layout
    names: Mapping[str, str] = field(default_factory=dict)

    def error(self, path: str, problem: str) -> InputError:
        """An error about the element at a path such as ``modified_dh[3].alpha``."""
        begun = max(
            (name for name in self.names if path.startswith(name)), key=len, default=""
        )
        path = known = self.names.get(begun, "") + path.removeprefix(begun)
        while known and known not in self.lines:
            known = known[: max(known.rfind("."), known.rfind("["), 0)]
        line = f" (line {self.lines[known]})" if known else ""
        problem, path = " ".join(problem.split()), " ".join(path.split())
        problem = shortened(problem, 600)
        return InputError(f"{problem}{line}", source=self.source, element=path or None)


def read_text(text: str | bytes, source: str) -> Document:
    """Parse YAML or JSON without interpreting scalars."""
    text = decoded(text, source)
    is_json = source.lower().endswith(".json")
    # YAML may begin with a brace as well, so JSON that fails is tried as YAML unless the file's name says JSON
    if is_json or text.lstrip().startswith("{"):
        try:
            return Document(
                parse_json(text, source, DESCRIPTION_NODES, as_text=True), source
            )
        except InputError:
            if is_json:
                raise
    found = parse_yaml(text, source, DESCRIPTION_NODES, lines=True)
    if len(found) > 1:
        line = found[1].lines.get("", 1)
        problem = f"one document describes one robot, but a second document begins (line {line})"
        raise InputError(f"not well-formed YAML: {problem}", source=source)
    if not found:
        raise InputError(
            "the document is empty; a description begins with 'echelon: 1'",
            source=source,
        )
    return Document(found[0].data, source, found[0].lines)


_START = "a description is a mapping that begins with 'echelon: 1'"


def check_document(document: Document) -> RobotDescription:
    """The description as a model of the published schema."""
    from echelon.formats.schema.robot_schema import RobotDescription
    from echelon.shared import UnfitError

    if not isinstance(document.data, dict):
        found = (
            "a list"
            if isinstance(document.data, list)
            else "nothing"
            if document.data is None
            else "a text"
        )
        raise document.error("", f"{_START}; this is {found}")
    if "echelon" not in document.data:
        raise document.error("", f"the key 'echelon' is missing: {_START}")
    try:
        return RobotDescription.model_validate(document.data)
    except UnfitError as error:
        from echelon.formats.description.explanations import explained

        raise document.error(*explained(document.data, error)) from None


MOST_TERMS = 5000
"""Terms of an expression that is multiplied out: more take minutes and are no geometry of a robot."""
_LEADING_ZERO = re.compile(r"[+-]?0\d+")


class Expressions:
    """Reads the expressions of one description."""

    def __init__(
        self,
        document: Document,
        options: ReadingOptions,
        literal: Collection[str],
        symbols: Mapping[str, Symbol],
    ) -> None:
        self.document = document
        self.declared = frozenset(symbols)
        self.snapping = Snapping(document.source, options, literal, dict(symbols))
        self._turns: set[str] = (
            set()
        )  # symbols of angles within the expression that was read last

    @property
    def named(self) -> dict[str, Symbol]:
        """Symbols that were given to angles without an exact sine."""
        return {
            name: symbol
            for name, symbol in self.snapping.symbols.items()
            if name not in self.declared
        }

    def error(self, path: str, problem: str) -> InputError:
        """An error about the element at a path."""
        return self.document.error(path, problem)

    def check(
        self, name: str, valid: Collection[str], path: str, what: str = "coordinate"
    ) -> None:
        """Refuse a name that nothing has; the error suggests the nearest one."""
        if name not in valid:
            raise self.error(
                path, f"there is no {what} '{name}'{nearest_of(name, valid)}"
            )

    def polynomial(
        self, text: str, path: str, coordinates: Collection[str] = ()
    ) -> Polynomial:
        """Any expression in declared symbols, pi, and coordinates where they may stand."""
        value = self.parsed(text, path)
        for name in value.symbols():
            if name not in {*self.declared, *self._turns, *coordinates, PI, PER_PI}:
                problem = f"the symbol '{name}' in '{text}' is not declared: list it in symbols"
                if coordinates:
                    problem = f"'{name}' in '{text}' is neither a coordinate nor a declared symbol"
                raise self.error(
                    path, problem + nearest(name, [*self.declared, *coordinates])
                )
        return value

    def parsed(self, text: str, path: str) -> Polynomial:
        """An expression in any names, and in those that angles of numbers such as 63/50 get in it."""
        self._check_spelling(text, path)
        self._turns.clear()

        def named(angle: Angle) -> Angle:
            found = self.snapping.named_angle(angle, path, "turn")
            self._turns.update(symbol for symbol, _ in found.parts)
            return found

        try:
            value = parse(text, named=named)
            if len(value.terms) > MOST_TERMS:
                raise ValueError(
                    f"the expression expands to {len(value.terms)} terms (at most {MOST_TERMS})"
                )
            for coefficient in value.terms.values():
                checked_size(coefficient, text)
        except ValueError as error:
            raise self.error(path, str(error)) from None
        return value

    def _check_spelling(self, text: str, path: str) -> None:
        if NOT_FINITE.fullmatch(text) and text not in self.declared:
            raise self.error(path, f"'{text}' is not a finite number")
        if _LEADING_ZERO.fullmatch(text) and int(text):
            raise self.error(
                path,
                f"'{text}' could be decimal or octal: write it without the leading zero",
            )
        if "°" in text or text.endswith("deg"):
            raise self.error(
                path,
                f"'{text}' is in degrees: angles are in radians, such as 30*pi/180",
            )

    def length(self, text: str, path: str) -> Polynomial:
        """An expression that is not an angle, so without pi."""
        value = self.polynomial(text, path)
        if not {PI, PER_PI}.isdisjoint(value.generators()):
            problem = f"pi can occur in angles and in values of symbols, not in '{text}': write a symbol here"
            raise self.error(
                path, f"{problem}, and its value in 'symbols', such as p: 0.01/(2*pi)"
            )
        return value

    def vector(self, texts: Sequence[str], path: str) -> Vector:
        """Three lengths, or three components of gravity."""
        x, y, z = (self.length(text, f"{path}[{i}]") for i, text in enumerate(texts))
        return (x, y, z)

    def number(self, text: str, path: str) -> Number:
        """A number without symbols."""
        value = self.length(text, path).number
        if value is None:
            raise self.error(path, f"'{text}' must be a number here, without symbols")
        return value

    def real(self, text: str, path: str) -> float:
        """A number as a float."""
        return float(self.number(text, path))

    def direction(
        self, axis: str | Sequence[str], path: str
    ) -> tuple[Rational, Rational, Rational]:
        """A direction: a coordinate axis such as ``-x``, or three numbers that are not all zero."""
        if isinstance(axis, str):
            sign = -1 if axis.startswith("-") else 1
            x, y, z = (sign if letter == axis[-1] else 0 for letter in "xyz")
            return (x, y, z)
        numbers = [self.number(text, f"{path}[{i}]") for i, text in enumerate(axis)]
        if not any(numbers):
            raise self.error(
                path, "the axis is zero; it needs a direction such as z or [0, 0, 1]"
            )
        # only directions are taken from these numbers, as floats, so a square root may be rounded like one
        a, b, c = (Fraction(float(n)) if isinstance(n, Surd) else n for n in numbers)
        return (a, b, c)

    def angle(self, text: str, path: str, name: str) -> Angle:
        """An angle in radians."""
        return self.exact_angle(self.polynomial(text, path), path, name)

    def exact_angle(self, value: Polynomial, path: str, name: str) -> Angle:
        """An expression as an angle with exact sine and cosine."""
        try:
            stated = as_angle(value)
        except ValueError as error:
            raise self.error(path, str(error)) from None
        for symbol, count in stated.parts:
            if count.denominator != 1:
                problem = f"'{value}' holds a fraction of the angle {symbol}: make the smaller angle the symbol"
                raise self.error(path, problem)
        has_steps = (stated.half_turns * STEPS_PER_HALF_TURN).denominator == 1
        turns = stated.half_turns if has_steps else Fraction(0)
        if not has_steps:
            # stated exactly as a part of pi, so it must not be mistaken for a rounded multiple of 15°
            read = self.snapping.named_angle(
                Angle(stated.half_turns, radians=stated.radians), path, name
            )
        elif stated.radians:
            read = self.snapping.angle(stated.radians, path, name)
        else:
            read = Angle()
        return Angle(turns + read.half_turns, (*stated.parts, *read.parts))

    def inertial(self, stated: Inertial | None, path: str) -> tuple[float, ...] | None:
        """The ten standard parameters about the body's frame."""
        from echelon.formats.schema.robot_schema import StandardInertial

        if stated is None:
            return None
        if isinstance(stated, StandardInertial):
            return tuple(
                self.real(text, f"{path}.standard[{i}]")
                for i, text in enumerate(stated.standard)
            )
        mass = self.real(stated.mass, f"{path}.mass")
        if mass < 0:
            raise self.error(f"{path}.mass", f"'{stated.mass}' is negative")
        centre = [
            self.real(text, f"{path}.com[{i}]") for i, text in enumerate(stated.com)
        ]
        keys = ("xx", "xy", "xz", "yy", "yz", "zz")
        moments = [
            self.real(getattr(stated.inertia, key), f"{path}.inertia.{key}")
            for key in keys
        ]
        return central_inertial(mass, centre, moments, np.eye(3))

    # -- frames ----------------------------------------------------------------------------------------------------

    def frame(self, frame: Frame, path: str, stem: str) -> Placement:
        """Where a frame sits in another."""
        placed = Placement(IDENTITY, self.vector(frame.xyz, f"{path}.xyz"))
        if frame.rotation is not None:
            return placed @ Placement(
                self._rotation(frame.rotation, f"{path}.rotation")
            )
        if frame.rpy is not None:
            found = [
                self.polynomial(text, f"{path}.rpy[{k}]").number
                for k, text in enumerate(frame.rpy)
            ]
            numbers = [number for number in found if isinstance(number, int | Fraction)]
            if self.snapping.options.looped and len(numbers) == len(found):
                return placed @ self.snapping.rotation(
                    (numbers[0], numbers[1], numbers[2]), f"{path}.rpy", stem
                )
            for axis, word in ((Z, "yaw"), (Y, "pitch"), (X, "roll")):
                placed = placed @ self.turned(
                    axis, frame.rpy[axis], f"{path}.rpy[{axis}]", f"{word}{stem}"
                )
        return placed

    def _rotation(self, rows: tuple[tuple[str, str, str], ...], path: str) -> Matrix:
        a, b, c = (self.vector(row, f"{path}[{i}]") for i, row in enumerate(rows))
        matrix: Matrix = (a, b, c)
        if not _is_rotation(matrix):
            problem = "this is not exactly a rotation matrix: use entries such as sqrt(3)/2, cos(beta), or rpy angles"
            raise self.error(path, problem)
        return matrix

    def turned(self, axis: int, text: str, path: str, name: str) -> Placement:
        """A turn about a coordinate axis."""
        angle = self.angle(text, path, name)
        return turn(axis, angle) if angle != Angle() else Placement()


def _is_rotation(matrix: Matrix) -> bool:
    """Whether rows are orthonormal and right-handed, at a random point modulo a prime: long products take minutes."""
    rng = random_generator(DEFAULT_SEED)
    field = PrimeField.random(rng, CERTIFICATE_BITS)
    entries = [entry for row in matrix for entry in row]
    symbols = {
        s: field.draw(rng, (1,))
        for s in sorted({s for entry in entries for s in entry.symbols()})
    }
    point = residues_at(
        {g for entry in entries for g in entry.generators()}, symbols, field
    )
    a, b, c = (
        [entry.evaluate(point, field.embed) % field.p for entry in row]
        for row in matrix
    )
    third = [(a[i] * b[j] - a[j] * b[i]) % field.p for i, j in ((1, 2), (2, 0), (0, 1))]
    products = [
        sum(x * y for x, y in zip(*pair, strict=True)) % field.p
        for pair in ((a, a), (b, b), (a, b))
    ]
    return products == [1, 1, 0] and c == third


def coordinate_axis(direction: str) -> tuple[int, int]:
    """Axis and sign of a direction such as ``-x``."""
    return "xyz".index(direction[-1]), -1 if direction.startswith("-") else 1


GENERIC = gravity_vector(
    "generic", ORIGIN
)  # gravity of unknown direction; its symbols need no declaration


def cut_off(robot: RobotDescription) -> tuple[str, ...]:
    """Names of the parts that force/torque sensors carry, which are bodies even where they are fixed."""
    return tuple(
        name
        for sensor in robot.outputs or ()
        for name in sensor.carried
        if name != BASE
    )


def declared_symbols(
    robot: RobotDescription, document: Document
) -> tuple[dict[str, Symbol], frozenset[str]]:
    """The declared symbols."""
    expressions = Expressions(document, ReadingOptions(), (), {})
    symbols, bare = {}, set()
    for name, entry in robot.symbols.items():
        path = f"symbols.{name}"
        problem = _unusable(name)
        if problem:
            raise document.error(path, f"'{name}' {problem}")
        stated = entry if entry is None or isinstance(entry, str) else entry.value
        value = None if stated is None else _constant(expressions, stated, path)
        meaning, arc, fit = "", None, None
        if entry is not None and not isinstance(entry, str):
            meaning, fit = entry.meaning, entry.fit
            if entry.approximate is not None:
                value = expressions.real(entry.approximate, f"{path}.approximate")
            if entry.tangent_squared is not None:
                arc = _tangent_squared(
                    expressions, entry.tangent_squared, value, f"{path}.tangent_squared"
                )
            if value is None and not meaning and fit is None:
                bare.add(name)
        symbols[name] = Symbol(
            name, value, stated, meaning, tangent_squared=arc, fit=fit
        )
    return symbols, frozenset(bare)


def _tangent_squared(
    expressions: Expressions, text: str, angle: float | None, path: str
) -> Fraction:
    square = expressions.number(text, path)
    if (
        isinstance(square, Surd)
        or square <= 0
        or angle is None
        or abs(math.atan(math.sqrt(square)) - angle) > 10.0**-PRINTED_DIGITS
    ):
        problem = (
            "it must be that of the angle stated as approximate, between 0 and pi/2"
        )
        raise expressions.document.error(
            path, f"{problem}, and {text} is not that of {angle} rad"
        )
    return Fraction(square)


def _unusable(name: str) -> str:
    """Why a name cannot be a symbol, or nothing."""
    if name in RESERVED:
        return f"has a fixed meaning in expressions and cannot be a symbol ({', '.join(sorted(RESERVED))} have)"
    if keyword.iskeyword(name):
        return f"is a word of the expression language (a Python keyword): use another name, such as {name}_ or {name}1"
    if not name.isidentifier():
        return "is not a possible symbol: letters, digits and _ only, not beginning with a digit, such as l1 or d_4"
    try:
        check_identifier(name, "", composed=True)
    except InputError as error:
        return f"cannot be a symbol: {error.problem}"
    return ""


def _constant(expressions: Expressions, text: str, path: str) -> float:
    value = expressions.parsed(text, path)
    if not set(value.generators()) <= {PI, PER_PI}:
        problem = f"'{text}' is not a number: a relation between symbols belongs where the length or angle is used"
        raise expressions.error(path, problem)
    return float(value.evaluate(pi_generators(math.pi), float))


def with_intended_angles(mechanism: Mechanism, snapping: Snapping) -> Mechanism:
    """Decimal values of angle symbols near a multiple of 15° become that multiple, but not near zero."""
    found = dict(mechanism.symbols)
    for name in sorted(symbol_roles(mechanism).angles & found.keys()):
        symbol, element = found[name], f"symbols.{name}"
        if (
            symbol.exact is None
            or symbol.value is None
            or parse_angle(symbol.exact).half_turns
        ):
            continue
        radians = parse_angle(symbol.exact).radians
        steps = round(
            snapping.angle_value(radians, element) * STEPS_PER_HALF_TURN / math.pi
        )
        exact = steps * math.pi / STEPS_PER_HALF_TURN
        difference = abs(symbol.value - exact)
        if steps and difference <= snapping.angle_tolerance(element):
            snapping.snaps.append(
                Snap(element, symbol.exact, f"{15 * steps}°", difference)
            )
            found[name] = replace(
                symbol, value=exact, exact=f"{steps}*pi/{STEPS_PER_HALF_TURN}"
            )
    return replace(mechanism, symbols=found)


def check_use(
    mechanism: Mechanism, robot: RobotDescription, document: Document
) -> list[str]:
    """Check that every symbol has one role."""
    lengths, others = geometry_of(mechanism)
    geometry = {
        generator for entry in (*lengths, *others) for generator in entry.generators()
    }
    gravity = {
        generator
        for entry in mechanism.gravity or ()
        for generator in entry.generators()
    }
    plain = {g for g in geometry | gravity if not is_trigonometric(g)}
    for generator in geometry | gravity:
        if is_trigonometric(generator) and symbol_of(generator) in plain:
            name = symbol_of(generator)
            raise document.error(
                f"symbols.{name}",
                f"'{name}' is used as an angle and as another quantity",
            )
    if mechanism.gravity is not None and mechanism.gravity == GENERIC:
        for name in sorted(gravity & geometry):
            raise document.error(
                f"symbols.{name}",
                f"'{name}' is a component of the generic gravity: rename the symbol",
            )
    used = {symbol_of(g) for g in geometry | gravity}
    used |= {name for effect in mechanism.effects for name in effect.symbols}
    unused = [name for name in robot.symbols if name not in used]
    put_in = [
        name
        for name in unused
        if name not in mechanism.symbols and robot.symbols[name] is not None
    ]
    return [
        f"the symbol '{name}' is replaced by its value everywhere, since loops need numeric ratios"
        if name in put_in
        else f"the symbol '{name}' is not used"
        for name in unused
    ]
