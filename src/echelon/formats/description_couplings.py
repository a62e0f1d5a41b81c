"""The couplings of a description: dependent coordinates as linear combinations of independent ones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from echelon.exact.numbers import Number
from echelon.exact.polynomial import Monomial, Polynomial, is_trigonometric, symbol_of
from echelon.formats.description_expressions import Expressions
from echelon.formats.description_text import step_into
from echelon.hints import nearest_of
from echelon.mechanism.joint import Motion, MotionKind
from echelon.mechanism.mechanism import Coupling
from echelon.mechanism.placement import Placement, shift, turn

if TYPE_CHECKING:
    from echelon.formats.schema import CouplingEntry, RobotDescription


@dataclass(frozen=True)
class StatedCoupling:
    """q_coordinate = Σ ratio · q_k + offset."""

    path: str
    coordinate: str
    terms: Mapping[str, Polynomial]
    offset: Polynomial

    @property
    def coupling(self) -> Coupling:
        """The coupling without its offset, which belongs into the geometry."""
        return Coupling(self.coordinate, tuple(self.terms.items()))


def read_couplings(
    robot: RobotDescription, expressions: Expressions, motions: Mapping[str, Motion]
) -> list[StatedCoupling]:
    """All couplings, with chains of dependent coordinates followed to independent ones.

    Parameters
    ----------
    robot : RobotDescription
    expressions : Expressions
    motions : mapping of str to Motion
        All motions, by the name of the coordinate.

    Raises
    ------
    InputError
        If a coupling is not linear, refers to unknown coordinates, or goes in a circle.
    """
    reader = LinearReader(expressions, {name: m for name, m in motions.items() if m.kind is not MotionKind.BALL})
    stated: dict[str, StatedCoupling] = {}
    for index, entries in enumerate(robot.couplings):
        for coordinate, entry in entries.items():
            path = step_into(f"couplings[{index}]", coordinate)
            reader.check(coordinate, path)
            if coordinate in stated:
                problem = f"'{coordinate}' is already coupled in {stated[coordinate].path}"
                raise expressions.error(path, problem)
            stated[coordinate] = reader.read(coordinate, entry, path)
    return [_resolved(coupling, stated, (), expressions) for coupling in stated.values()]


class LinearReader:
    """Reads linear combinations of coordinates."""

    def __init__(self, expressions: Expressions, coordinates: Mapping[str, Motion]) -> None:
        self.expressions, self.coordinates = expressions, coordinates

    def check(self, coordinate: str, path: str) -> None:
        """Refuse what is not a coordinate."""
        if coordinate not in self.coordinates:
            problem = f"there is no coordinate '{coordinate}'{nearest_of(coordinate, self.coordinates)}"
            raise self.expressions.error(path, problem)

    def read(self, coordinate: str, entry: CouplingEntry, path: str) -> StatedCoupling:
        """A coupling as an expression or term by term."""
        if isinstance(entry, str):
            return self.linear(coordinate, entry, path)
        offset = self.expressions.polynomial(entry.offset, f"{path}.offset")
        return StatedCoupling(path, coordinate, self.terms(entry.terms, path), offset)

    def terms(self, entry: Mapping[str, str], path: str) -> dict[str, Polynomial]:
        """Ratios to coordinates, by name."""
        for name in entry:
            self.check(name, f"{path}.terms.{name}")
        return {name: self.expressions.length(ratio, f"{path}.terms.{name}") for name, ratio in entry.items()}

    def linear(self, coordinate: str, text: str, path: str) -> StatedCoupling:
        """A linear expression."""
        terms: dict[str, dict[Monomial, Number]] = {}
        offset: dict[Monomial, Number] = {}
        for monomial, coefficient in self.expressions.polynomial(text, path, self.coordinates).terms.items():
            moving = [(g, e) for g, e in monomial if symbol_of(g) in self.coordinates]
            if not moving:
                offset[monomial] = coefficient
                continue
            name, exponent = moving[0]
            if len(moving) > 1 or exponent > 1 or is_trigonometric(name):
                raise self.expressions.error(path, f"'{text}' is not linear in the coordinates")
            if name in self.expressions.declared:
                raise self.expressions.error(path, f"'{name}' is both a coordinate and a symbol: rename the symbol")
            rest = tuple(factor for factor in monomial if factor[0] != name)
            terms.setdefault(name, {})[rest] = coefficient
        ratios = {name: Polynomial(ratio) for name, ratio in terms.items()}
        if any("pi" in ratio.generators() for ratio in ratios.values()):
            problem = f"pi can occur in the constant part only, not in a ratio as in '{text}': use a symbol"
            raise self.expressions.error(path, problem)
        return StatedCoupling(path, coordinate, ratios, Polynomial(offset))


def _resolved(
    coupling: StatedCoupling,
    stated: Mapping[str, StatedCoupling],
    above: tuple[str, ...],
    expressions: Expressions,
) -> StatedCoupling:
    if coupling.coordinate in above:
        circle = " -> ".join([*above[above.index(coupling.coordinate) :], coupling.coordinate])
        raise expressions.error(coupling.path, f"the couplings form a circle: {circle}")
    terms: dict[str, Polynomial] = {}
    offset = coupling.offset
    for name, ratio in coupling.terms.items():
        upper = {name: Polynomial.constant(1)}
        if name in stated:
            leader = _resolved(stated[name], stated, (*above, coupling.coordinate), expressions)
            upper, offset = dict(leader.terms), offset + ratio * leader.offset
        for independent, factor in upper.items():
            terms[independent] = terms.get(independent, Polynomial({})) + ratio * factor
    return StatedCoupling(coupling.path, coupling.coordinate, terms, offset)


def offset_placement(coupling: StatedCoupling, motion: Motion, stem: str, expressions: Expressions) -> Placement:
    """The constant part of a coupling as a placement before the motion.

    Raises
    ------
    InputError
        If the offset does not suit the motion.
    """
    offset = coupling.offset * motion.sign
    if motion.kind is MotionKind.ROTATION:
        return turn(motion.axis, expressions.exact_angle(offset, coupling.path, f"offset{stem}"))
    if motion.kind is MotionKind.SCREW:
        raise expressions.error(coupling.path, "the constant part of a screw belongs into the origin of its joint")
    if "pi" in offset.generators():
        raise expressions.error(coupling.path, "the constant part of a sliding coordinate is a length, without pi")
    x, y, z = (offset if k == motion.axis else 0 for k in range(3))
    return shift(x, y, z)
