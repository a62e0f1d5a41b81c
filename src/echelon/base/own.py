"""The robot's own numbers decide: rank and representatives at the stated values of the symbols.

A set for general symbols may be too large for the robot at hand, because some of its numbers are zero, equal or
otherwise related.  At special values the rank can only fall, and while the general representatives stay independent it
does not, and they stay the representatives: one non-zero minor at the stated values proves it.  Otherwise the relations
that matter are looked for (:mod:`echelon.base.value_relations`).  Put into the mechanism, they leave one whose general
answer is the answer for this robot, so closed forms keep all other symbols.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from echelon.base.matrix import BaseMatrix
from echelon.base.minor import find_minor
from echelon.base.rows import rows_of
from echelon.base.structure import Structure, dependent_columns, find_structure
from echelon.base.value_relations import RelationSearch, SpecialValues
from echelon.errors import DegenerateSampleError, EchelonError, InputError, OtherModeError, SingularPoseError
from echelon.exact.field import CERTIFICATE_BITS, PrimeField
from echelon.exact.polynomial import Polynomial
from echelon.mechanism.mechanism import Mechanism
from echelon.mechanism.stated import StatedValues, stated_values
from echelon.mechanism.substitute import substituted
from echelon.mechanism.symbol_values import all_symbols
from echelon.regressor.linear import LinearForms
from echelon.regressor.loops.assembly import Assembly
from echelon.regressor.loops.exact_pose import closed_exactly
from echelon.regressor.virtual_power import virtual_power_form
from echelon.seeds import DEFAULT_SEED, random_generator


@dataclass(frozen=True)
class OwnAnswer:
    """The mechanism with the relations among its values put in, and its structure."""

    mechanism: Mechanism
    structure: Structure  # for general values of the symbols that are left, which is that at the stated values
    special: SpecialValues | None = None  # none where the stated values are like any others
    undecided: str = ""  # why the structure at the stated values could not be found; empty if it was


def own_answer(
    mechanism: Mechanism, rng: np.random.Generator, recorded: LinearForms | None = None, *, generic: bool = False
) -> OwnAnswer:
    """Structure at the stated values, and the relations among them that it depends on."""
    try:
        return _own_answer(mechanism, rng, recorded, generic)
    except OtherModeError as error:
        if mechanism.closed_at:
            raise
        try:
            followed = closed_exactly(mechanism, Assembly(mechanism).pose)
        except ValueError:  # a screw that is turned there
            raise error from None
        return _own_answer(followed, rng, None, generic)


def _own_answer(
    mechanism: Mechanism, rng: np.random.Generator, recorded: LinearForms | None, generic: bool
) -> OwnAnswer:
    values = stated_values(mechanism)
    if values.names and set(values.names) <= _symbols_of_pose(
        mechanism
    ):  # general values of these are nobody's question
        at_values = stated_structure(mechanism, rng)
        if at_values.accepted is None and _shows_no_more(mechanism, at_values, rng):
            return OwnAnswer(mechanism, at_values)
    structure = find_structure(mechanism, rng)
    if not values.names or _is_general(mechanism, structure, values, recorded, rng):
        return OwnAnswer(mechanism, structure)
    try:
        at_values = stated_structure(mechanism, rng)
    except OtherModeError:
        raise
    except EchelonError as error:
        return OwnAnswer(mechanism, structure, undecided=f"for general symbols, since at the stated values {error}")
    if at_values.pivots == structure.pivots:
        return OwnAnswer(mechanism, structure)

    def pivots_of(put_in: Mapping[str, Polynomial]) -> tuple[int, ...]:
        return find_structure(substituted(mechanism, put_in), rng).pivots

    relations = RelationSearch(values, at_values.pivots, pivots_of).find()
    own = substituted(mechanism, relations.put_in(values))
    special = SpecialValues(structure.rank, at_values.rank, relations.texts(values))
    return OwnAnswer(mechanism, structure, special) if generic else OwnAnswer(own, find_structure(own, rng), special)


def _symbols_of_pose(mechanism: Mechanism) -> set[str]:
    """Symbols that stand for angles at which loops were closed."""
    return {symbol for position in mechanism.closed_at.values() for x in position for symbol in x.symbols()}


def _shows_no_more(mechanism: Mechanism, structure: Structure, rng: np.random.Generator) -> bool:
    """Whether general values of the symbols have the same representatives as the stated ones, at a random point."""
    columns = sorted({*structure.pivots, *structure.by_robot})
    rows = rows_of(mechanism).columns(columns)
    field = PrimeField.random(rng)
    try:
        found = dependent_columns(rows, rows.forms.sampler(structure.order), rows.forms.shape[1], field, rng)
    except (DegenerateSampleError, SingularPoseError):
        return False
    return [c for k, c in enumerate(columns) if k not in found] == list(structure.pivots)


def at_stated_values(mechanism: Mechanism) -> Mechanism:
    """The mechanism with exact values for all symbols that have one."""
    values = stated_values(mechanism)
    if not values.names:
        return mechanism
    put_in = substituted(mechanism, values.put_in(values.names))
    units = {name: symbol for name, symbol in values.units.items() if name in all_symbols(put_in)}
    return replace(put_in, symbols={**put_in.symbols, **units})


def stated_structure(mechanism: Mechanism, rng: np.random.Generator) -> Structure:
    """Structure at the stated values of all symbols that have one."""
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
        raise InputError(f"{problem} ({', '.join(sorted(matrix.denominators))})") from None
    rows = tuple({c: f for c, f in row.items() if here[c]} for row, here in zip(matrix.rows, present, strict=True))
    return replace(matrix, rows=rows)


def _is_general(
    mechanism: Mechanism,
    structure: Structure,
    values: StatedValues,
    recorded: LinearForms | None,
    rng: np.random.Generator,
) -> bool:
    """Whether the general representatives are proved independent at the stated values."""
    if mechanism.closures or not values.can_be_drawn or _constrains_effects(mechanism, values):
        return False  # their symbols have no values that could simply be drawn
    forms = virtual_power_form(mechanism) if recorded is None else recorded
    return find_minor(forms, structure.pivots, values, rng).rank == structure.rank


def _constrains_effects(mechanism: Mechanism, values: StatedValues) -> bool:
    """Whether a term of an effect holds a symbol that has a value."""
    terms = " ".join(action.term for effect in mechanism.effects for action in effect.actions)
    return any(name in terms for name in values.numbers)
