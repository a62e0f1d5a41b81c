"""Geometry symbols: what they stand for, their numeric values, and their exact values for points of a field.

Lengths, ratios and angles on the grid of 15° are exact numbers.  A decimal angle is an integer multiple of one unit u,
the largest that all decimal angles of a robot are multiples of.  For algebraic u ≠ 0 the number e^{iu} is
transcendental (Lindemann), so its circle point satisfies no algebraic relation: it is a generic point of the circle,
and multiples of it have all true relations between the decimals, such as 0.3 + 0.4 − 0.7 = 0, and no others.  Fractions
of π that are not on the grid are multiples of a second unit; that their multiples come back to the grid is not known
here.  Lengths with π in them, such as the pitch of a screw per radian, are numbers times a generic residue for π, which
is transcendental, too.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from math import gcd, lcm, pi
from typing import Any

import numpy as np
import numpy.typing as npt

from echelon.algebra import (
    CERTIFICATE_BITS,
    DEFAULT_SEED,
    PER_PI,
    PI,
    STEPS_PER_HALF_TURN,
    Angle,
    Number,
    Polynomial,
    PrimeField,
    Residues,
    arc_text,
    as_polynomial,
    cosine,
    cosine_of_turn,
    decimal_text,
    generator_values,
    is_trigonometric,
    parse,
    parse_angle,
    phase_symbols,
    pi_generators,
    random_generator,
    sine,
    sine_of_turn,
    symbol_of,
)
from echelon.robot.joint import MotionKind, Placement, Step, Symbol
from echelon.robot.mechanism import Mechanism, setup_placements, setup_ratios
from echelon.robot.substitute import substituted
from echelon.shared import Floats, InputError


def symbol_values(
    mechanism: Mechanism,
    names: Iterable[str],
    overrides: Mapping[str, float] | None = None,
) -> dict[str, float]:
    """Values of symbols, SI units."""
    given = {} if overrides is None else overrides
    if not isinstance(given, Mapping):
        raise InputError(
            "symbols are not a mapping of names to numbers, such as {'l1': 0.3}"
        )
    if given:
        known = all_symbols(mechanism)
        strange = next((name for name in given if name not in known), None)
        if strange is not None:
            valid = ", ".join(sorted(known)) or "none"
            raise InputError(
                f"'{strange}' is not a symbol of this mechanism (valid: {valid})"
            )
    values: dict[str, float] = {}
    for name in names:
        stated = mechanism.symbols.get(name)
        value = given.get(name, stated.value if stated else None)
        if value is None:
            raise InputError(
                f"symbol '{name}' has no value; give it as symbols={{'{name}': ...}}"
            )
        values[name] = value
    return values


def gravity_value(mechanism: Mechanism) -> Floats:
    """Gravity in the base frame at the stated values, m/s²; zero where there is none."""
    parts = mechanism.gravity or ()
    values = symbol_values(mechanism, sorted({s for p in parts for s in p.symbols()}))
    return np.array([part.at(values) for part in parts] or [0.0] * 3)


def upward(mechanism: Mechanism) -> Floats:
    """Unit vector against gravity, in the base frame; z without gravity."""
    gravity = gravity_value(mechanism)
    size = float(np.linalg.norm(gravity))
    return -gravity / size if size > 0 else np.array([0.0, 0.0, 1.0])


def all_symbols(mechanism: Mechanism) -> set[str]:
    """All symbols that a mechanism lists or uses."""
    lengths, others = geometry(mechanism)
    used = {
        name
        for part in (*lengths, *others, *(mechanism.gravity or ()))
        for name in part.symbols()
    }
    return used | set(mechanism.symbols)


def known_values(mechanism: Mechanism) -> dict[str, float]:
    """Values of the symbols that have one."""
    return {
        name: s.value for name, s in mechanism.symbols.items() if s.value is not None
    }


def inexact_symbols(mechanism: Mechanism) -> list[str]:
    """Symbols whose values are floats only, such as angles of the direction (1, 2, 0): they count as generic."""
    symbols = mechanism.symbols.items()
    return [
        n
        for n, s in symbols
        if s.exact is None and s.stands_for is None and s.value is not None
    ]


def has_values(mechanism: Mechanism) -> bool:
    """Whether all symbols that a mechanism lists or uses have one."""
    return all_symbols(mechanism) <= known_values(mechanism).keys()


def placement_matrix(
    placement: Placement, symbols: Mapping[str, float]
) -> npt.NDArray[np.float64]:
    """A placement as a homogeneous matrix, shape (4, 4)."""
    matrix = np.eye(4)
    matrix[:3, :3] = [
        [entry.at(symbols) for entry in row] for row in placement.rotation
    ]
    matrix[:3, 3] = [entry.at(symbols) for entry in placement.translation]
    return matrix


def characteristic_length(mechanism: Mechanism) -> float:
    """The largest offset of a joint, loops' joints included, whose value is known, m; 1 if there is none."""
    frames = [frame for closure in mechanism.closures for frame in closure.placements]
    largest = largest_offset(
        [*(step for body in mechanism.bodies for step in body.joint.steps), *frames],
        known_values(mechanism),
    )
    return largest if largest > 1e-300 else 1.0


def largest_offset(steps: Iterable[Step], known: Mapping[str, float]) -> float:
    """The largest component of a translation whose value is known, m; 0 if there is none."""
    entries = [
        entry
        for step in steps
        if isinstance(step, Placement)
        for entry in step.translation
    ]
    return max(
        (abs(e.at(known)) for e in entries if known.keys() >= set(e.symbols())),
        default=0.0,
    )


@dataclass(frozen=True)
class SymbolRoles:
    """Roles of a mechanism's symbols."""

    # symbols with the dimension of a length; empty if lengths are not all symbolic, because then coefficients are not
    # homogeneous in them
    lengths: frozenset[str]
    angles: frozenset[str]
    symbols: frozenset[str]  # all symbols
    irrational: tuple[bool, bool]  # whether √2 and √3 occur in the geometry


def symbol_roles(mechanism: Mechanism) -> SymbolRoles:
    """Sort a mechanism's symbols by role."""
    translations, others = geometry(mechanism)
    others += mechanism.gravity or ()
    everything = translations + others
    angles = {
        symbol_of(g) for e in everything for g in e.generators() if is_trigonometric(g)
    }
    terms = [action.term for effect in mechanism.effects for action in effect.actions]
    angles |= {
        name
        for term in terms
        for name in phase_symbols(term)
        if name in mechanism.symbols
    }
    lengths = {s for e in translations for s in e.symbols()} - angles
    foreign = {g for e in others for g in e.generators() if not is_trigonometric(g)}
    homogeneous = all(
        _is_length(e, lengths) for e in translations
    ) and not _mixes_dimensions(mechanism)
    roots = [
        part
        for e in everything
        for c in e.terms.values()
        for part in getattr(c, "parts", ())
    ]
    quadruples = [roots[k : k + 4] for k in range(0, len(roots), 4)]
    irrational = (
        any(q[1] or q[3] for q in quadruples),
        any(q[2] or q[3] for q in quadruples),
    )
    usable = homogeneous and not lengths & foreign
    symbols = frozenset(s for e in everything for s in e.symbols())
    return SymbolRoles(
        frozenset(lengths) if usable else frozenset(),
        frozenset(angles),
        symbols,
        irrational,
    )


def named_symbols(mechanism: Mechanism) -> frozenset[str]:
    """Symbols for whose other values there are states, too: all without loops, or where lengths or ratios have names.

    Where only angles are symbols, these are directions of a file, between which loops close at its own numbers.
    """
    if not mechanism.closures:
        return frozenset(all_symbols(mechanism))
    translations, others = geometry(mechanism)
    used = {
        symbol
        for expression in (*translations, *others)
        for symbol in expression.symbols()
    }
    return frozenset(used) if used - symbol_roles(mechanism).angles else frozenset()


def geometry(mechanism: Mechanism) -> tuple[list[Polynomial], list[Polynomial]]:
    """All expressions beside those of gravity: those that are lengths, and the others."""
    translations: list[Polynomial] = []
    others: list[Polynomial] = []
    for body in mechanism.bodies:
        for step in body.joint.steps:
            if isinstance(step, Placement):
                translations.extend(step.translation)
                others.extend(entry for row in step.rotation for entry in row)
            else:
                translations.append(step.pitch)
    for placement in setup_placements(mechanism):
        translations.extend(placement.translation)
        others.extend(entry for row in placement.rotation for entry in row)
    others.extend(setup_ratios(mechanism))
    return translations, others


def _is_length(expression: Polynomial, lengths: set[str]) -> bool:
    """Whether every term has degree one in the length symbols."""
    return all(
        sum(e for g, e in monomial if g in lengths) == 1
        for monomial in expression.terms
    )


def _mixes_dimensions(mechanism: Mechanism) -> bool:
    """Whether a coupling has plain coefficients with a dimension, as between a translation and a rotation."""
    sliding = {m.name: m.kind is MotionKind.TRANSLATION for m in mechanism.motions}
    return any(
        sliding[c.coordinate] != sliding[name]
        or (sliding[name] and function.ratio is None)
        for c in mechanism.couplings
        for name, function in c.terms
    )


Point = tuple[Residues, Residues]  # cosine and sine

UNITS = _RADIANS, _TURNS = (
    "unit_of_decimals",
    "unit_of_pi",
)  # names of the two units, where they stand for symbols


@dataclass(frozen=True)
class Units:
    """Random residues for what is transcendental: the circle points of both units of angles, and π."""

    circles: tuple[Point, Point]
    pi: int


def _drawn_units(field: PrimeField, rng: np.random.Generator) -> Units:
    first, second = (field.circle(field.draw(rng, (1,))) for _ in range(2))
    return Units((first, second), int(field.draw(rng, (1,))[0]))


@dataclass(frozen=True)
class StatedValues:
    """Exact values of a mechanism's symbols."""

    numbers: Mapping[str, Number]  # lengths, ratios and other constants, SI units
    angles: Mapping[str, Angle]  # without symbolic parts
    sums: Mapping[
        str, Polynomial
    ]  # lengths that stand for sums with sines and cosines of the angles
    # lengths and the like with π or 1/π in their value
    of_pi: Mapping[str, Polynomial] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """Symbols with a value, sorted."""
        return tuple(sorted({*self.numbers, *self.angles, *self.sums, *self.of_pi}))

    @cached_property
    def multiples(self) -> dict[str, tuple[int, int, int]]:
        """Every angle as steps of 15°, a multiple of the unit of decimals, and one of the unit of π."""
        split = {
            name: _off_grid(angle.half_turns) for name, angle in self.angles.items()
        }
        radians = unit_of(angle.radians for angle in self.angles.values())
        turns = unit_of(rest for _, rest in split.values())
        return {
            name: (
                split[name][0],
                int(angle.radians / radians),
                int(split[name][1] / turns),
            )
            for name, angle in self.angles.items()
        }

    @cached_property
    def units(self) -> dict[str, Symbol]:
        """The units as symbols, with their values."""
        radians = unit_of(angle.radians for angle in self.angles.values())
        turns = unit_of(
            _off_grid(angle.half_turns)[1] for angle in self.angles.values()
        )
        texts = {_RADIANS: decimal_text(radians), _TURNS: f"{turns}*pi"}
        sizes = {_RADIANS: float(radians), _TURNS: float(turns) * pi}
        found = {
            name: Symbol(name, sizes[name], texts[name], "unit of angles")
            for name in UNITS
        }
        return found | {
            name: Symbol(name, size, name) for name, size in pi_generators(pi).items()
        }

    def put_in(self, names: Collection[str]) -> dict[str, Polynomial]:
        """Expressions for the generators of some symbols: numbers, and sines and cosines of multiples of units."""
        values = {
            name: Polynomial.constant(self.numbers[name])
            for name in names
            if name in self.numbers
        }
        values |= {name: self.of_pi[name] for name in names if name in self.of_pi}
        for name in names:
            if name in self.angles:
                steps, *counts = self.multiples[name]
                parts = tuple(
                    (u, n) for u, n in zip((_RADIANS, _TURNS), counts, strict=True) if n
                )
                values |= angle_generators(
                    name, Angle(Fraction(steps, STEPS_PER_HALF_TURN), parts)
                )
        for name in names:
            if name in self.sums:
                terms = {
                    g: values.get(g, Polynomial.generator(g))
                    for g in self.sums[name].generators()
                }
                values[name] = self.sums[name].evaluate(terms, as_polynomial)
        return values

    def draw(
        self, names: Iterable[str], field: PrimeField, rng: np.random.Generator
    ) -> dict[str, Residues]:
        """Values of symbols for a sampler, shape (1,): stated ones where there are any, random ones elsewhere."""
        units = _drawn_units(field, rng)
        stated = set(self.names)
        return {
            name: np.array([self._residue(name, field, units)], dtype=field.dtype)
            if name in stated
            else field.draw(rng, (1,))
            for name in names
        }

    def residues(
        self, generators: Iterable[str], field: PrimeField, rng: np.random.Generator
    ) -> dict[str, int]:
        """Values of generators whose symbols all have one: the symbols themselves, and sines and cosines of angles."""
        return self._residues(generators, field, _drawn_units(field, rng))

    def _residues(
        self, generators: Iterable[str], field: PrimeField, units: Units
    ) -> dict[str, int]:
        def symbol(name: str) -> Any:
            if name in (PI, PER_PI):
                return units.pi if name == PI else field.invert(units.pi)
            if name in self.angles:
                return self._point(name, field, units)
            return self._residue(name, field, units)

        def circle(point: Point, count: int) -> tuple[int, int]:
            c, s = field.multiply_angle(point, count)
            return int(c[0]), int(s[0])

        return generator_values(generators, symbol, circle)

    def _residue(self, name: str, field: PrimeField, units: Units) -> int:
        if name in self.numbers:
            return field.embed(self.numbers[name])
        if name in self.angles:
            c, s = (int(x[0]) for x in self._point(name, field, units))
            return field.half_tangent(c, s)
        value = self.sums[name] if name in self.sums else self.of_pi[name]
        return (
            value.evaluate(
                self._residues(value.generators(), field, units), field.embed
            )
            % field.p
        )

    def _point(self, name: str, field: PrimeField, units: Units) -> Point:
        """Cosine and sine of an angle."""
        steps, *counts = self.multiples[name]
        grid = (cosine_of_turn(steps), sine_of_turn(steps))
        c, s = (np.array([field.embed(x)], dtype=field.dtype) for x in grid)
        for unit, n in zip(units.circles, counts, strict=True):
            c, s = field.add_angles((c, s), field.multiply_angle(unit, n))
        return c, s


def in_numbers(mechanism: Mechanism) -> Mechanism:
    """The mechanism with numbers for all symbols that have one; decimal angles, whose sines have none, stay symbols."""
    values = stated_values(mechanism)
    irrational = {
        *values.of_pi,
        *(n for n in values.angles if any(values.multiples[n][1:])),
    }
    plain = [n for n in values.names if n not in irrational]
    return substituted(mechanism, values.put_in(plain))


def stated_values(mechanism: Mechanism) -> StatedValues:
    """Exact values of the symbols that have one."""
    return values_of(mechanism.symbols, symbol_roles(mechanism).angles)


def value_texts(mechanism: Mechanism, names: Iterable[str]) -> dict[str, str]:
    """Stated values of those symbols that have one, as exact text; the decimals of a float are taken as exact."""
    found = {}
    for name in sorted(names):
        symbol = mechanism.symbols.get(name)
        if symbol is not None and (
            symbol.exact is not None or symbol.value is not None
        ):
            arc = symbol.tangent_squared
            found[name] = symbol.exact or (
                repr(symbol.value) if arc is None else arc_text(arc)
            )
    return found


def values_of(symbols: Mapping[str, Symbol], angles: Collection[str]) -> StatedValues:
    """Exact values of symbols, given which of them are angles."""
    numbers: dict[str, Number] = {}
    exact = {
        name: symbol.exact
        for name, symbol in symbols.items()
        if symbol.exact is not None
    }
    known = {name: parse_angle(text) for name, text in exact.items() if name in angles}
    of_pi: dict[str, Polynomial] = {}
    for name, text in exact.items():
        if name in angles:
            continue
        value = parse(text)
        if value.number is not None:
            numbers[name] = value.number
        elif {PI, PER_PI} >= set(value.generators()):
            of_pi[name] = value
    named = {
        name: symbol.stands_for
        for name, symbol in symbols.items()
        if symbol.stands_for is not None
    }
    sums = {
        name: value
        for name, value in named.items()
        if known.keys() >= set(value.symbols())
    }
    return StatedValues(numbers, known, sums, of_pi)


def vanishes(value: Polynomial, symbols: Mapping[str, Symbol]) -> bool:
    """Whether an expression is zero at the exact values of its symbols; False if one has none."""
    # it is evaluated at a random point modulo a random prime of 81 bits
    names = value.symbols()
    inner = [
        s.stands_for
        for s in (symbols.get(n) for n in names)
        if s is not None and s.stands_for is not None
    ]
    generators = [g for expression in (value, *inner) for g in expression.generators()]
    angles = {symbol_of(g) for g in generators if is_trigonometric(g)}
    stated = values_of(
        {n: symbols[n] for n in {*names, *angles} if n in symbols}, angles
    )
    if not set(stated.names) >= set(names):
        return False
    rng = random_generator(DEFAULT_SEED)
    field = PrimeField.random(rng, CERTIFICATE_BITS)
    return (
        value.evaluate(stated.residues(value.generators(), field, rng), field.embed)
        % field.p
        == 0
    )


def angle_generators(name: str, angle: Angle) -> dict[str, Polynomial]:
    """The angle that a symbol stands for, which effects use, and its cosine and sine, by generator."""
    terms = {((PI, 1),): angle.half_turns} | {
        ((symbol, 1),): count for symbol, count in angle.parts
    }
    itself = Polynomial({monomial: count for monomial, count in terms.items() if count})
    return {name: itself, cosine(name): angle.cos(), sine(name): angle.sin()}


def unit_of(values: Iterable[Fraction]) -> Fraction:
    """The largest number that all of some numbers are integer multiples of; 1 if all are zero."""
    present = [v for v in values if v]
    if not present:
        return Fraction(1)
    denominator = lcm(*(v.denominator for v in present))
    return Fraction(gcd(*(int(v * denominator) for v in present)), denominator)


def _off_grid(half_turns: Fraction) -> tuple[int, Fraction]:
    """Steps of 15°, and the rest in half turns: all or nothing, so that the rest has a small unit."""
    steps = half_turns * STEPS_PER_HALF_TURN
    return (int(steps), Fraction(0)) if steps.denominator == 1 else (0, half_turns)
