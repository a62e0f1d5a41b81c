"""Joints of a description: rows of Denavit–Hartenberg tables and joints between bodies, as exact steps.

Couplings make coordinates of joints sums of functions of independent ones.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import TYPE_CHECKING, cast

from echelon.exact.expressions import Angle
from echelon.exact.polynomial import Monomial, Number, Polynomial, Rational, is_trigonometric, symbol_of
from echelon.formats.bodies import placed_before
from echelon.formats.description.document import Expressions
from echelon.formats.literal import LiteralMotion, StatedCoupling, resolved
from echelon.inputs import step_into
from echelon.mechanism.coupling import Spline, linear, natural_spline
from echelon.mechanism.joint import (
    IDENTITY,
    Matrix,
    Motion,
    MotionKind,
    Placement,
    Step,
    X,
    Y,
    Z,
    ball,
    floating_motions,
    merge,
    multiply,
    rotation,
    screw,
    shift,
    translation,
    transpose,
    turn,
)

if TYPE_CHECKING:
    from echelon.formats.schema.robot_schema import BodyEntry, ModifiedRow, RobotDescription, StandardRow
    from echelon.formats.schema.schema_types import (
        AxisJoint,
        CouplingEntry,
        CouplingTerms,
        CustomJoint,
        Frame,
        HelicalJoint,
        Joint,
        SplineFunction,
        SplineThrough,
    )


_LITERAL_KINDS: dict[str, MotionKind | str] = {
    "revolute": MotionKind.ROTATION,
    "continuous": MotionKind.ROTATION,
    "prismatic": MotionKind.TRANSLATION,
    "planar": "planar",
}


class Joints:
    """Reads joints with the expressions of one description.

    Every method takes the element's path, for messages, and a stem: the ending of symbols that stand for angles
    without an exact sine (``roll3`` for the stem 3).
    """

    def __init__(self, expressions: Expressions) -> None:
        self.expressions = expressions

    # -- tables ----------------------------------------------------------------------------------------------------

    def row(self, row: ModifiedRow | StandardRow, name: str, path: str, stem: str) -> tuple[Step, ...]:
        """A row of a table."""
        from echelon.formats.schema.robot_schema import ModifiedRow

        motion: tuple[Motion, ...] = ()
        if row.joint != "fixed":
            motion = (rotation(name) if row.joint == "revolute" else translation(name),)
        modified = isinstance(row, ModifiedRow)
        first = self._along(row, Z, "gamma", "b", path, stem) if modified else Placement()
        along_z, along_x = self._along(row, Z, "theta", "d", path, stem), self._along(row, X, "alpha", "a", path, stem)
        # turns about an axis and shifts along it commute, and so does the motion with those about and along z
        return merge((first @ along_x @ along_z, *motion) if modified else (*motion, along_z @ along_x))

    def _along(
        self, row: ModifiedRow | StandardRow, axis: int, angle: str, length: str, path: str, stem: str
    ) -> Placement:
        """Rot and Trans about and along one axis, by the keys of the angle and the length."""
        turned = self._turn(axis, getattr(row, angle), f"{path}.{angle}", f"{angle}{stem}")
        value = self.expressions.length(getattr(row, length), f"{path}.{length}")
        return turned @ shift(value if axis == X else 0, 0, value if axis == Z else 0)

    def _turn(self, axis: int, text: str, path: str, name: str) -> Placement:
        angle = self.expressions.angle(text, path, name)
        return turn(axis, angle) if angle != Angle() else Placement()

    # -- bodies ----------------------------------------------------------------------------------------------------

    def body(self, body: BodyEntry, path: str, stem: str) -> tuple[Step, ...]:
        """From the parent's frame to the body's."""
        place = self.frame(body.frame, f"{path}.frame", stem)
        if body.joint is None:
            return merge((place,))
        if body.joint.type == "custom":
            steps = self._custom(body.joint, f"{path}.joint", stem)
            # left as stated, so that a saved mechanism is read back as it was
            return steps if place.is_identity else merge((*steps, place))
        origin = self.frame(body.joint.origin, f"{path}.joint.origin", stem)
        name = joint_name(body)
        return merge((origin, *self._motions(body.joint, name, f"{path}.joint", stem), place))

    def _motions(self, joint: Joint, name: str, path: str, stem: str) -> tuple[Step, ...]:
        match joint.type:
            case "fixed":
                return ()
            case "spherical":
                return (ball(name),)
            case "floating":
                return floating_motions(name)
            case "universal":
                pairs = enumerate((joint.axis, joint.axis2), 1)
                return tuple(rotation(f"{name}.{i}", *coordinate_axis(axis)) for i, axis in pairs)
            case "helical" | "cylindrical":
                return self._along_axis(joint, name, path, stem)
        axis_joint = cast("AxisJoint", joint)
        axis = self.expressions.direction(axis_joint.axis, f"{path}.axis")
        return self.expressions.snapping.motion(LiteralMotion(path, name, _LITERAL_KINDS[joint.type], axis), stem)

    def _along_axis(self, joint: HelicalJoint | AxisJoint, name: str, path: str, stem: str) -> tuple[Step, ...]:
        direction = self.expressions.direction(joint.axis, f"{path}.axis")
        mounting, axis, sign = self.expressions.snapping.direction(direction, f"{path} axis", stem)
        motions: tuple[Motion, ...]
        if joint.type == "helical":
            motions = (screw(name, self.expressions.length(joint.pitch, f"{path}.pitch"), axis, sign),)
        else:
            motions = (translation(f"{name}.slide", axis, sign), rotation(f"{name}.turn", axis, sign))
        return (mounting, *motions, mounting.inverse())

    def _custom(self, joint: CustomJoint, path: str, stem: str) -> tuple[Step, ...]:
        from echelon.formats.schema.schema_types import MotionStep

        steps: list[Step] = []
        for index, step in enumerate(joint.steps):
            here = f"{path}.steps[{index}]"
            if isinstance(step, MotionStep):
                (axis, sign), pitch = coordinate_axis(step.axis), self.expressions.length(step.pitch, f"{here}.pitch")
                if pitch and step.motion != "screw":
                    raise self.expressions.error(f"{here}.pitch", f"only a screw has a pitch, not a {step.motion}")
                steps.append(Motion(MotionKind(step.motion), step.name, axis, sign, pitch))
            else:
                steps.append(self.frame(step, here, stem))
        return tuple(steps)

    # -- frames ----------------------------------------------------------------------------------------------------

    def frame(self, frame: Frame, path: str, stem: str) -> Placement:
        """Where a frame sits in another."""
        placed = Placement(IDENTITY, self.expressions.vector(frame.xyz, f"{path}.xyz"))
        if frame.rotation is not None:
            return placed @ Placement(self._rotation(frame.rotation, f"{path}.rotation"))
        if frame.rpy is not None:
            for axis, word in ((Z, "yaw"), (Y, "pitch"), (X, "roll")):
                placed = placed @ self._turn(axis, frame.rpy[axis], f"{path}.rpy[{axis}]", f"{word}{stem}")
        return placed

    def _rotation(self, rows: tuple[tuple[str, str, str], ...], path: str) -> Matrix:
        a, b, c = (self.expressions.vector(row, f"{path}[{i}]") for i, row in enumerate(rows))
        matrix: Matrix = (a, b, c)
        # the third row of a rotation is the cross product of the first two
        third = tuple(a[i] * b[j] - a[j] * b[i] for i, j in ((1, 2), (2, 0), (0, 1)))
        if multiply(matrix, transpose(matrix)) != IDENTITY or c != third:
            problem = "this is not exactly a rotation matrix: use entries such as sqrt(3)/2, cos(beta), or rpy angles"
            raise self.expressions.error(path, problem)
        return matrix


def joint_name(body: BodyEntry) -> str:
    """Name of a body's joint."""
    stated = body.joint.name if body.joint is not None else None
    return body.name if stated is None else stated


def coordinate_axis(direction: str) -> tuple[int, int]:
    """Axis and sign of a direction such as ``-x``."""
    return "xyz".index(direction[-1]), -1 if direction.startswith("-") else 1


def read_couplings(
    robot: RobotDescription, expressions: Expressions, motions: Mapping[str, Motion]
) -> list[StatedCoupling]:
    """All couplings, with chains of dependent coordinates followed to independent ones."""
    reader = CouplingReader(expressions, {name: m for name, m in motions.items() if m.kind is not MotionKind.BALL})
    stated: list[StatedCoupling] = []
    for index, entries in enumerate(robot.couplings):
        for coordinate, entry in entries.items():
            path = step_into(f"couplings[{index}]", coordinate)
            expressions.check(coordinate, reader.coordinates, path)
            stated.append(reader.read(coordinate, entry, path))
    found = list(resolved(stated, expressions.error).values())
    for coupling in found:
        if any("pi" in value.generators() for function in coupling.terms.values() for value in function.expressions):
            problem = "pi can occur in the constant part only, not in a ratio: use a symbol"
            raise expressions.error(coupling.element, problem)
    return found


class CouplingReader:
    """Reads sums of functions of coordinates."""

    def __init__(self, expressions: Expressions, coordinates: Mapping[str, Motion]) -> None:
        self.expressions, self.coordinates = expressions, coordinates

    def read(self, coordinate: str, entry: CouplingEntry, path: str) -> StatedCoupling:
        """A coupling as an expression, term by term, or as a spline."""
        if isinstance(entry, str):
            terms, offset = self.polynomials(entry, path)
            return StatedCoupling(path, coordinate, terms, offset)
        if hasattr(entry, "spline"):
            return self._spline(coordinate, entry.spline, f"{path}.spline")
        offset = self.expressions.polynomial(entry.offset, f"{path}.offset")
        return StatedCoupling(path, coordinate, self._terms(entry, path), offset)

    def linear(self, text: str, path: str) -> tuple[dict[str, Polynomial], Polynomial]:
        """A linear expression: ratios, and the constant part."""
        terms, offset = self.polynomials(text, path)
        ratios = {name: function.ratio for name, function in terms.items()}
        known = {name: ratio for name, ratio in ratios.items() if ratio is not None}
        if len(known) < len(ratios):
            raise self.expressions.error(path, f"'{text}' is not linear in the coordinates")
        if any("pi" in ratio.generators() for ratio in known.values()):
            problem = f"pi can occur in the constant part only, not in a ratio as in '{text}': use a symbol"
            raise self.expressions.error(path, problem)
        return known, offset

    def ratios(self, entry: Mapping[str, str], path: str) -> dict[str, Polynomial]:
        """Ratios to coordinates, by name."""
        for name in entry:
            self.expressions.check(name, self.coordinates, f"{path}.terms.{name}")
        return {name: self.expressions.length(ratio, f"{path}.terms.{name}") for name, ratio in entry.items()}

    def polynomials(self, text: str, path: str) -> tuple[dict[str, Spline], Polynomial]:
        """A sum of polynomials in one coordinate each, and its constant part."""
        terms: dict[str, dict[int, dict[Monomial, Number]]] = {}
        offset: dict[Monomial, Number] = {}
        for monomial, coefficient in self.expressions.polynomial(text, path, self.coordinates).terms.items():
            moving = [(g, e) for g, e in monomial if symbol_of(g) in self.coordinates]
            if not moving:
                offset[monomial] = coefficient
                continue
            name, exponent = moving[0]
            if len(moving) > 1 or is_trigonometric(name):
                problem = f"'{text}' is not a sum of polynomials in one coordinate each, as it must be"
                raise self.expressions.error(path, problem)
            if name in self.expressions.declared:
                raise self.expressions.error(path, f"'{name}' is both a coordinate and a symbol: rename the symbol")
            rest = tuple(factor for factor in monomial if factor[0] != name)
            terms.setdefault(name, {}).setdefault(exponent, {})[rest] = coefficient
        functions = {
            name: Spline(tuple(Polynomial(powers.get(k, {})) for k in range(1, max(powers) + 1)))
            for name, powers in terms.items()
        }
        return functions, Polynomial(offset)

    def _terms(self, entry: CouplingTerms, path: str) -> dict[str, Spline]:
        found: dict[str, Spline] = {}
        for name, term in entry.terms.items():
            where = f"{path}.terms.{name}"
            self.expressions.check(name, self.coordinates, where)
            if isinstance(term, str):
                found[name] = linear(self.expressions.length(term, where))
            else:
                found[name] = self._function(term, where)
        return found

    def _function(self, entry: SplineFunction, path: str) -> Spline:
        coefficients = [
            self.expressions.length(c, f"{path}.coefficients[{k}]") for k, c in enumerate(entry.coefficients)
        ]
        knots = [
            (self._rational(knot, f"{path}.knots[{k}]"), self.expressions.length(jump, f"{path}.knots[{k}]"))
            for k, (knot, jump) in enumerate(entry.knots)
        ]
        return Spline(tuple(coefficients), tuple(knots))

    def _spline(self, coordinate: str, entry: SplineThrough, path: str) -> StatedCoupling:
        self.expressions.check(entry.of, self.coordinates, f"{path}.of")
        points = [self._point(point, f"{path}.points[{k}]") for k, point in enumerate(entry.points)]
        try:
            function, offset = natural_spline(points)
        except ValueError as error:
            raise self.expressions.error(f"{path}.points", str(error)) from None
        return StatedCoupling(path, coordinate, {entry.of: function}, Polynomial.constant(offset))

    def _point(self, texts: Sequence[str], path: str) -> tuple[Rational, Rational]:
        x, y = (self._rational(text, path) for text in texts)
        return x, y

    def _rational(self, text: str, path: str) -> Rational:
        value = self.expressions.number(text, path)
        if not isinstance(value, int | Fraction):
            raise self.expressions.error(path, f"'{text}' must be a rational number here")
        return value


def offset_placement(coupling: StatedCoupling, motion: Motion, stem: str, expressions: Expressions) -> Placement:
    """The constant part of a coupling as a placement before the motion."""
    if motion.kind is MotionKind.SCREW:
        raise expressions.error(coupling.element, "the constant part of a screw belongs into the origin of its joint")
    if motion.kind is MotionKind.TRANSLATION and "pi" in coupling.offset.generators():
        raise expressions.error(coupling.element, "the constant part of a sliding coordinate is a length, without pi")
    return placed_before(
        motion, coupling.offset, lambda value: expressions.exact_angle(value, coupling.element, f"offset{stem}")
    )
