"""Effect of the symbols' stated values: relations among them that a rank depends on, and the structures they give.

Relations are zeros, equal values, ratios and sums.  Put into a mechanism, they leave one whose general answer is the
answer for this robot, so closed forms keep all other symbols.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import combinations, product

import numpy as np

from echelon.algebra import (
    CERTIFICATE_BITS,
    DEFAULT_SEED,
    STEPS_PER_HALF_TURN,
    Angle,
    Polynomial,
    PrimeField,
    Surd,
    decimal_text,
    format_polynomial,
    random_generator,
)
from echelon.base.matrix import BaseMatrix
from echelon.base.structure import Structure, find_structure
from echelon.robot import (
    UNITS,
    Mechanism,
    StatedValues,
    angle_generators,
    stated_values,
    substituted,
    symbol_roles,
)
from echelon.shared import DegenerateSampleError, EchelonError, InputError

MOST_STRUCTURES = 400
"""Structures of one search, as for relations of values: a minute for a robot of six joints."""
LARGEST_RATIO = 12
"""Numerator and denominator of ratios of symbols that count as meant."""

PivotsOf = Callable[[Mapping[str, Polynomial]], tuple[int, ...]]
"""Pivots of a model with something put in for generators of its symbols."""


@dataclass(frozen=True)
class SpecialValues:
    """The effect of the stated values on the rank, against general symbols."""

    generic_rank: int  # for general values of the symbols
    rank: int  # for the robot's own values
    relations: tuple[
        str, ...
    ]  # relations among the values that make the difference, such as ``a2 = 0``

    @property
    def definitions(self) -> dict[str, str]:
        """Expressions that were put in for symbols, in the symbols that are left."""
        pairs = (relation.split(" = ") for relation in self.relations)
        plain = (
            (name, right.replace("−", "-").replace("·", "*").removesuffix(" rad"))
            for name, right in pairs
        )
        return {name: re.sub(r"(\d+)°", r"\1*pi/180", right) for name, right in plain}

    def text(self, what: str) -> str:
        """Both ranks with the reason."""
        reason = " and ".join(self.relations)
        if self.rank == self.generic_rank:
            return f"{self.rank} as in general, but with other representatives for this {what}, because {reason}"
        return f"{self.generic_rank} in general; {self.rank} for this {what}, because {reason}"


Terms = tuple[tuple[str, Fraction], ...]


@dataclass(frozen=True)
class SymbolRelations:
    """Symbols that have their values, and symbols that are combinations of others."""

    fixed: frozenset[str]
    combined: tuple[
        tuple[str, Terms], ...
    ] = ()  # x = Σ factor · symbol, for angles apart from multiples of 15°

    def put_in(self, values: StatedValues) -> dict[str, Polynomial]:
        """Expressions for the generators of these symbols."""
        found = values.put_in(sorted(self.fixed))
        for name, terms in self.combined:
            if name in values.numbers or name in values.of_pi:
                found[name] = Polynomial(
                    {((symbol, 1),): factor for symbol, factor in terms}
                )
            else:
                found |= angle_generators(
                    name, Angle(_grid_part(name, terms, values), terms)
                )
        return found

    def texts(self, values: StatedValues) -> tuple[str, ...]:
        """The relations as equations."""
        equations = [
            f"{name} = {_value_text(name, values)}" for name in sorted(self.fixed)
        ]
        for name, terms in sorted(self.combined):
            right = format_polynomial(
                Polynomial({((symbol, 1),): factor for symbol, factor in terms})
            )
            steps = (
                0
                if name not in values.angles
                else int(_grid_part(name, terms, values) * STEPS_PER_HALF_TURN)
            )
            grid = f" {'+' if steps > 0 else '-'} {abs(steps) * 15}°" if steps else ""
            equations.append(
                f"{name} = {right}{grid}".replace("-", "−").replace("*", "·")
            )
        return tuple(equations)


def _value_text(name: str, values: StatedValues) -> str:
    if name in values.sums or name in values.of_pi:
        return format_polynomial(values.sums.get(name) or values.of_pi[name])
    if name in values.numbers:
        number = values.numbers[name]
        return str(number) if isinstance(number, int) else decimal_text(number)
    angle = values.angles[name]
    steps = angle.half_turns * STEPS_PER_HALF_TURN
    if not angle.radians and steps.denominator == 1:
        return f"{int(steps) * 15}°"
    return f"{angle} rad"


def _grid_part(name: str, terms: Terms, values: StatedValues) -> Fraction:
    """The difference between an angle and a combination of others, in half turns."""
    return values.angles[name].half_turns - sum(
        (f * values.angles[s].half_turns for s, f in terms), Fraction(0)
    )


class RelationSearch:
    """The search for relations among stated values that give the pivots at these values.

    A smallest set of symbols that must have their values comes first (QuickXplain, Junker 2004), then the simplest
    relations among these that are enough.
    """

    def __init__(
        self, values: StatedValues, wanted: tuple[int, ...], pivots_of: PivotsOf
    ) -> None:
        self.values, self.wanted, self.pivots_of = values, wanted, pivots_of
        self._known: dict[SymbolRelations, bool] = {}

    def find(self) -> SymbolRelations:
        """Relations that are enough, and none that is not needed."""
        names = sorted(self.values.names, key=self._plainness)
        found = SymbolRelations(frozenset(self._needed([], names)))
        while (simpler := self._simpler(found)) is not None:
            found = simpler
        return found

    def _plainness(self, name: str) -> bool:
        """Zeros and angles on the grid last: they explain most, so the others are freed first."""
        if name in self.values.angles:
            return not any(self.values.multiples[name][1:])
        return not self.values.numbers.get(name, 1)

    def _enough(self, relations: SymbolRelations) -> bool:
        if relations not in self._known:
            if len(self._known) >= MOST_STRUCTURES:
                return False
            try:
                self._known[relations] = (
                    self.pivots_of(relations.put_in(self.values)) == self.wanted
                )
            except (
                EchelonError
            ):  # some lengths of loops cannot be free while others have their values
                self._known[relations] = False
        return self._known[relations]

    def _needed(self, fixed: Sequence[str], names: Sequence[str]) -> list[str]:
        """A smallest part of some symbols that must have their values beside the fixed ones."""
        if self._enough(SymbolRelations(frozenset(fixed))):
            return []
        if len(names) <= 1:
            return list(names)
        first, second = names[: len(names) // 2], names[len(names) // 2 :]
        kept = self._needed([*fixed, *first], second)
        return [*self._needed([*fixed, *kept], first), *kept]

    def _simpler(self, found: SymbolRelations) -> SymbolRelations | None:
        """One more symbol as a combination of others instead of with its value, and these others free."""
        for name in sorted(found.fixed, key=lambda n: (len(n), n), reverse=True):
            for terms in _combinations(name, sorted(found.fixed - {name}), self.values):
                involved = {symbol for symbol, _ in terms}
                trial = SymbolRelations(
                    found.fixed - {name} - involved, (*found.combined, (name, terms))
                )
                if self._enough(trial):
                    return trial
        return None


def _combinations(
    name: str, others: Sequence[str], values: StatedValues
) -> Iterator[Terms]:
    """Combinations of others that have the value of a symbol: equal, a ratio, sums; the simplest first."""
    kinds = (values.numbers, values.of_pi, values.angles)
    same: Mapping[str, object] = next(
        (kind for kind in kinds if name in kind), values.angles
    )
    others = [o for o in others if o in same and name in same]
    for other in others:
        ratio = _ratio(name, other, values)
        if ratio is not None:
            yield ((other, ratio),)
    for size in range(2, 5):
        for chosen in combinations(others, size):
            for signs in product((1, -1), repeat=size):
                terms = tuple(
                    (o, Fraction(s)) for o, s in zip(chosen, signs, strict=True)
                )
                if _holds(name, terms, values):
                    yield terms


def _ratio(name: str, other: str, values: StatedValues) -> Fraction | None:
    """A small factor, whole for angles, that makes one of the other."""
    factors = [Fraction(1), Fraction(-1)]
    if name in values.numbers:
        a, b = values.numbers[name], values.numbers[other]
        if not isinstance(a, Surd) and not isinstance(b, Surd) and b:
            factors.append(Fraction(a) / b)
    elif name in values.of_pi:
        (a, *_), (b, *_) = (values.of_pi[n].terms.values() for n in (name, other))
        if not isinstance(a, Surd) and not isinstance(b, Surd):
            factors.append(Fraction(a) / b)
    elif values.angles[other].radians:
        factors.append(values.angles[name].radians / values.angles[other].radians)
        factors = [f for f in factors if f.denominator == 1]
    small = (
        f
        for f in factors
        if f and max(abs(f.numerator), f.denominator) <= LARGEST_RATIO
    )
    return next((f for f in small if _holds(name, ((other, f),), values)), None)


def _holds(name: str, terms: Terms, values: StatedValues) -> bool:
    if name in values.numbers:
        total: object = sum((values.numbers[s] * f for s, f in terms), Fraction(0))
        return bool(values.numbers[name] == total) and any(
            values.numbers[s] for s, _ in terms
        )
    if name in values.of_pi:
        return (
            Polynomial.sum(values.of_pi[s] * f for s, f in terms) == values.of_pi[name]
        )
    radians = sum((f * values.angles[s].radians for s, f in terms), Fraction(0))
    grid = _grid_part(name, terms, values) * STEPS_PER_HALF_TURN
    return values.angles[name].radians == radians and grid.denominator == 1


def at_stated_values(mechanism: Mechanism) -> Mechanism:
    """The mechanism with exact values for all symbols that have one."""
    values = stated_values(mechanism)
    if not values.names:
        return mechanism
    put_in = with_values(mechanism, values.put_in(values.names))
    in_effects = {name for effect in put_in.effects for name in effect.symbols}
    in_geometry = symbol_roles(put_in).symbols
    used = {
        name
        for name in values.units
        if name in in_geometry or (name in UNITS and name in in_effects)
    }
    left = {
        name: symbol
        for name, symbol in put_in.symbols.items()
        if name not in values.units
    }
    return replace(
        put_in, symbols={**left, **{name: values.units[name] for name in used}}
    )


def with_values(mechanism: Mechanism, put_in: Mapping[str, Polynomial]) -> Mechanism:
    """The mechanism with expressions in place of symbols, which may be in terms of units of angles."""
    units = stated_values(mechanism).units
    return substituted(
        replace(
            mechanism, symbols={**mechanism.symbols, **{n: units[n] for n in UNITS}}
        ),
        put_in,
    )


def stated_structure(mechanism: Mechanism, rng: np.random.Generator) -> Structure:
    """Structure at the stated values of all symbols that have one."""
    if mechanism.closures:  # real states are those of the stated values
        return find_structure(mechanism, rng, generic=False)
    return find_structure(at_stated_values(mechanism), rng)


def at_values(matrix: BaseMatrix, values: StatedValues) -> BaseMatrix:
    """B without the entries that are zero at the stated values."""
    if not set(matrix.symbols) & set(values.names):
        return matrix
    rng = random_generator(DEFAULT_SEED)
    field = PrimeField.random(rng, CERTIFICATE_BITS)
    try:
        present = matrix.modulo(values.draw(matrix.symbols, field, rng), field)
    except DegenerateSampleError:
        problem = "a denominator of B is zero at the stated values of the symbols: other representatives are needed"
        raise InputError(
            f"{problem} ({', '.join(sorted(matrix.denominators))})"
        ) from None
    rows = tuple(
        {c: f for c, f in row.items() if here[c]}
        for row, here in zip(matrix.rows, present, strict=True)
    )
    return replace(matrix, rows=rows)
