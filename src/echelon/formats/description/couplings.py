"""Couplings of a description: coordinates as sums of functions of independent ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction

from echelon.algebra import (
    PER_PI,
    PI,
    Monomial,
    Number,
    Polynomial,
    Rational,
    is_trigonometric,
    symbol_of,
)
from echelon.formats.bodies import placed_before
from echelon.formats.description.document import Expressions
from echelon.formats.literal import StatedCoupling, resolved
from echelon.formats.schema.robot_schema import RobotDescription
from echelon.formats.schema.schema_types import (
    CouplingEntry,
    CouplingSpline,
    CouplingTerms,
    SplineFunction,
    SplineThrough,
)
from echelon.robot import Motion, MotionKind, Placement, Spline, linear, natural_spline
from echelon.shared import step_into


def read_couplings(
    robot: RobotDescription, expressions: Expressions, motions: Mapping[str, Motion]
) -> list[StatedCoupling]:
    """All couplings, with chains of dependent coordinates followed to independent ones."""
    reader = CouplingReader(
        expressions,
        {name: m for name, m in motions.items() if m.kind is not MotionKind.BALL},
    )
    stated: list[StatedCoupling] = []
    for index, entries in enumerate(robot.couplings):
        for coordinate, entry in entries.items():
            path = step_into(f"couplings[{index}]", coordinate)
            expressions.check(coordinate, reader.coordinates, path)
            stated.append(reader.read(coordinate, entry, path))
    found = list(resolved(stated, expressions.error).values())
    for coupling in found:
        if any(
            "pi" in value.generators()
            for function in coupling.terms.values()
            for value in function.expressions
        ):
            problem = (
                "pi can occur in the constant part only, not in a ratio: use a symbol"
            )
            raise expressions.error(coupling.element, problem)
    return found


class CouplingReader:
    """Reads sums of functions of coordinates."""

    def __init__(
        self, expressions: Expressions, coordinates: Mapping[str, Motion]
    ) -> None:
        self.expressions, self.coordinates = expressions, coordinates

    def read(self, coordinate: str, entry: CouplingEntry, path: str) -> StatedCoupling:
        """A coupling as an expression, term by term, or as a spline."""
        if isinstance(entry, str):
            terms, offset = self.polynomials(entry, path)
            return StatedCoupling(path, coordinate, terms, offset)
        if isinstance(entry, CouplingSpline):
            return self._spline(coordinate, entry.spline, f"{path}.spline")
        offset = self.expressions.polynomial(entry.offset, f"{path}.offset")
        return StatedCoupling(path, coordinate, self._terms(entry, path), offset)

    def linear(self, text: str, path: str) -> tuple[dict[str, Polynomial], Polynomial]:
        """A linear expression: ratios, and the constant part."""
        terms, offset = self.polynomials(text, path)
        ratios = {name: function.ratio for name, function in terms.items()}
        known = {name: ratio for name, ratio in ratios.items() if ratio is not None}
        if len(known) < len(ratios):
            raise self.expressions.error(
                path, f"'{text}' is not linear in the coordinates"
            )
        if any(
            not {PI, PER_PI}.isdisjoint(ratio.generators()) for ratio in known.values()
        ):
            problem = f"pi can occur in the constant part only, not in a ratio as in '{text}': use a symbol"
            raise self.expressions.error(path, problem)
        return known, offset

    def ratios(self, entry: Mapping[str, str], path: str) -> dict[str, Polynomial]:
        """Ratios to coordinates, by name."""
        for name in entry:
            self.expressions.check(name, self.coordinates, f"{path}.terms.{name}")
        return {
            name: self.expressions.length(ratio, f"{path}.terms.{name}")
            for name, ratio in entry.items()
        }

    def polynomials(self, text: str, path: str) -> tuple[dict[str, Spline], Polynomial]:
        """A sum of polynomials in one coordinate each, and its constant part."""
        terms: dict[str, dict[int, dict[Monomial, Number]]] = {}
        offset: dict[Monomial, Number] = {}
        for monomial, coefficient in self.expressions.polynomial(
            text, path, self.coordinates
        ).terms.items():
            moving = [(g, e) for g, e in monomial if symbol_of(g) in self.coordinates]
            if not moving:
                offset[monomial] = coefficient
                continue
            name, exponent = moving[0]
            if len(moving) > 1 or is_trigonometric(name):
                problem = f"'{text}' is not a sum of polynomials in one coordinate each, as it must be"
                raise self.expressions.error(path, problem)
            if name in self.expressions.declared:
                raise self.expressions.error(
                    path,
                    f"'{name}' is both a coordinate and a symbol: rename the symbol",
                )
            rest = tuple(factor for factor in monomial if factor[0] != name)
            terms.setdefault(name, {}).setdefault(exponent, {})[rest] = coefficient
        functions = {
            name: Spline(
                tuple(Polynomial(powers.get(k, {})) for k in range(1, max(powers) + 1))
            )
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
            self.expressions.length(c, f"{path}.coefficients[{k}]")
            for k, c in enumerate(entry.coefficients)
        ]
        knots = [
            (
                self._rational(knot, f"{path}.knots[{k}]"),
                self.expressions.length(jump, f"{path}.knots[{k}]"),
            )
            for k, (knot, jump) in enumerate(entry.knots)
        ]
        return Spline(tuple(coefficients), tuple(knots))

    def _spline(
        self, coordinate: str, entry: SplineThrough, path: str
    ) -> StatedCoupling:
        self.expressions.check(entry.of, self.coordinates, f"{path}.of")
        points = [
            self._point(point, f"{path}.points[{k}]")
            for k, point in enumerate(entry.points)
        ]
        try:
            function, offset = natural_spline(points)
        except ValueError as error:
            raise self.expressions.error(f"{path}.points", str(error)) from None
        return StatedCoupling(
            path, coordinate, {entry.of: function}, Polynomial.constant(offset)
        )

    def _point(self, texts: Sequence[str], path: str) -> tuple[Rational, Rational]:
        x, y = (self._rational(text, path) for text in texts)
        return x, y

    def _rational(self, text: str, path: str) -> Rational:
        value = self.expressions.number(text, path)
        if not isinstance(value, int | Fraction):
            raise self.expressions.error(
                path, f"'{text}' must be a rational number here"
            )
        return value


def offset_placement(
    coupling: StatedCoupling, motion: Motion, stem: str, expressions: Expressions
) -> Placement:
    """The constant part of a coupling as a placement before the motion."""
    if motion.kind is MotionKind.SCREW:
        raise expressions.error(
            coupling.element,
            "the constant part of a screw belongs into the origin of its joint",
        )
    if motion.kind is MotionKind.TRANSLATION and "pi" in coupling.offset.generators():
        raise expressions.error(
            coupling.element,
            "the constant part of a sliding coordinate is a length, without pi",
        )
    return placed_before(
        motion,
        coupling.offset,
        lambda value: expressions.exact_angle(value, coupling.element, f"offset{stem}"),
    )
