"""B in closed form: small relations between columns of X, interpolated, that together make it.

For columns that move across one joint the relation is found on the two bodies of that joint.  On a whole parent that is
done in the frame where the joint begins to move, so that equal joints share it, and a change of frame leads to the
parent's own.  Columns that depend for other reasons (restricted motion near the base, couplings, massless bodies) have
relations of just the columns that take part.  A relation's coefficients can be evaluated wherever rows of X can.

The coefficients of every dependence are interpolated, the cheapest first, while the budget lasts, and brought to all
places in the robot where the dependence occurs.  Then, going from the base to the tips, the dependent columns among the
sources are substituted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property, partial
from itertools import product

import numpy as np

from echelon.algebra import (
    MOST_PRIMES,
    ONE,
    Geometry,
    Polynomial,
    PrimeField,
    RationalFunction,
    Residues,
    T,
    UnknownFunctions,
    Work,
    as_polynomial,
    cost_of_products,
    interpolate,
    substituted,
    sum_of_products,
)
from echelon.base.ball_rows import irrational_roots
from echelon.base.matrix import BaseMatrix, StatedNumbers
from echelon.base.prime_states import PrimeStates
from echelon.base.real_states import RealStates
from echelon.base.samplers import states_of
from echelon.base.structure import (
    Structure,
    floating_pair,
    joint_frame,
    pair_columns,
    pair_signature,
)
from echelon.dynamics import LinearForms, Rows, energy_form, rows_of
from echelon.robot import Mechanism, Placement, SymbolRoles, move, symbol_roles
from echelon.shared import PER_BODY, ClosedFormError


@dataclass(frozen=True, eq=False)
class Dependence:
    """Target columns that are combinations of source columns, and rows from which the coefficients follow."""

    roles: SymbolRoles  # what the symbols stand for
    rows: Rows  # with the columns [auxiliary, sources, targets]
    sources: Sequence[int]  # numbers of columns
    targets: Sequence[int]
    zero: frozenset[
        int
    ]  # sources that vanish in X, so that their coefficients do not matter
    # powers of length of the coefficients, by source and target; None where they are inhomogeneous
    degrees: Sequence[int] | None

    @cached_property
    def sampler(self) -> PrimeStates | RealStates:
        """Solves the rows for the coefficients at any values of the symbols."""
        return states_of(self.rows)

    @property
    def symbols(self) -> list[str]:
        """Symbols that the coefficients may depend on."""
        return self.sampler.symbols

    @cached_property
    def pairs(self) -> list[tuple[int, int]]:
        """(source, target) of every coefficient that matters."""
        return [
            (s, t) for s in self.sources if s not in self.zero for t in self.targets
        ]

    @property
    def unknowns(self) -> int:
        """Number of columns that are solved for."""
        return self.rows.auxiliary + len(self.sources)

    @cached_property
    def cost(self) -> float:
        """Operations modulo primes that take as long as one evaluation."""
        return self.sampler.cost(len(self.sources))

    def unknown(self, rng: np.random.Generator) -> UnknownFunctions:
        """The coefficients of :attr:`pairs` as functions of the symbols."""
        roles = self.roles
        lengths = frozenset() if self.degrees is None else roles.lengths
        degrees = self.degrees or [0] * (len(self.sources) * len(self.targets))
        sources = [source for source, _ in product(self.sources, self.targets)]
        chosen = [k for k, source in enumerate(sources) if source not in self.zero]

        def evaluate(field: PrimeField, geometry: Geometry) -> Residues:
            found: Residues = self.coefficients(field, geometry, rng)[chosen]
            return found

        return UnknownFunctions(
            evaluate,
            self.symbols,
            self.sampler.angles,
            lengths,
            [degrees[k] for k in chosen],
            roles.irrational,
            self.cost,
        )

    def coefficients(
        self, field: PrimeField, geometry: Geometry, rng: np.random.Generator
    ) -> Residues:
        """Coefficients at given geometries: array of shape (sources · targets, geometries)."""
        return self.sampler.coefficients(field, geometry, rng, len(self.sources))


@dataclass(frozen=True, eq=False)
class PlacedDependence:
    """A dependence at its place in the robot: which columns of X its columns are."""

    dependence: Dependence
    columns: Sequence[int]  # columns of X, by number in the dependence
    # of the frame that the dependence's first ten columns are about, in that of the same columns of X
    frame: Placement = Placement()  # noqa: RUF009 - immutable

    @property
    def targets(self) -> list[int]:
        """Columns of X that are combinations of :attr:`sources`."""
        return [self.columns[k] for k in self.dependence.targets]

    @property
    def sources(self) -> list[int]:
        """Columns of X that the targets are combinations of."""
        return [self.columns[k] for k in self.dependence.sources]

    @cached_property
    def symbols(self) -> frozenset[str]:
        """Symbols that the coefficients may depend on."""
        return frozenset((*self.dependence.symbols, *self.frame.symbols()))

    def changes(
        self, kinds: Iterable[int], number: Callable[[Polynomial], T]
    ) -> dict[int, dict[int, T]]:
        """Parameters of the whole body about the dependence's frame, as combinations of those about its own."""
        chosen = sorted(set(kinds))
        if self.frame.is_identity or not chosen:
            return {}
        matrix = np.eye(4, dtype=int).astype(object)
        for i, row in enumerate(self.frame.rotation):
            for j, entry in enumerate((*row, self.frame.translation[i])):
                matrix[i, j] = entry if entry.number is None else entry.number
        units = np.eye(PER_BODY, dtype=int)[chosen].astype(object)
        found: dict[int, dict[int, T]] = {kind: {} for kind in chosen}
        for kind, moved in zip(chosen, move(units, matrix), strict=True):
            for k in np.flatnonzero(moved).tolist():
                found[kind][k] = number(_integral(as_polynomial(moved[k])))
        return found

    def placed(
        self,
        combinations: Mapping[int, dict[int, T]],
        number: Callable[[Polynomial], T],
        put: Callable[
            [dict[int, T], dict[int, dict[int, T]]], dict[int, T] | None
        ] = substituted,
    ) -> dict[int, dict[int, T]]:
        """The targets as combinations of columns of X, without those for which nothing can be put in."""
        changes = self.changes(
            (k for c in combinations.values() for k in c if k < PER_BODY), number
        )
        found = (
            (target, put(combination, changes))
            for target, combination in combinations.items()
        )
        return {
            self.columns[t]: {self.columns[k]: v for k, v in c.items()}
            for t, c in found
            if c is not None
        }


def relations(mechanism: Mechanism, structure: Structure) -> list[PlacedDependence]:
    """The relations of all dependent columns that do not vanish."""
    return [*_across_joints(mechanism, structure), *_across_robot(mechanism, structure)]


def _across_joints(
    mechanism: Mechanism, structure: Structure
) -> Iterable[PlacedDependence]:
    zero = frozenset(c for c, support in structure.by_robot.items() if not support)
    shared: dict[tuple[tuple[int, ...], tuple[object, ...]], list[int]] = {}
    places: dict[int, tuple[list[int], Placement]] = {}
    for index, dependent in structure.by_joint.items():
        columns, chosen = pair_columns(mechanism, index), set(dependent)
        places[index] = columns, joint_frame(mechanism, index)
        targets = tuple(k for k, c in enumerate(columns) if c in chosen)
        shared.setdefault((targets, pair_signature(mechanism, index)), []).append(index)
    for (targets, _), indices in shared.items():
        pair = floating_pair(mechanism, indices[0])
        everywhere = frozenset.intersection(
            *(_vanishing(*places[index], zero) for index in indices)
        )
        sources = [k for k in range(len(places[indices[0]][0])) if k not in targets]
        rows = Rows(energy_form(pair), 1).columns([*sources, *targets])
        degrees = _degrees(pair, sources, targets)
        dependence = Dependence(
            symbol_roles(pair), rows, sources, targets, everywhere, degrees
        )
        yield from (PlacedDependence(dependence, *places[index]) for index in indices)


def _vanishing(
    columns: Sequence[int], placement: Placement, zero: frozenset[int]
) -> frozenset[int]:
    """Numbers of a pair's columns that vanish in X; with a change of frame, the ten of the parent do together."""
    found = frozenset(k for k, c in enumerate(columns) if c in zero)
    parent = frozenset(range(PER_BODY))
    return found if placement.is_identity or parent <= found else found - parent


def _across_robot(
    mechanism: Mechanism, structure: Structure
) -> Iterable[PlacedDependence]:
    rows = rows_of(mechanism)
    if structure.functions_are_free and rows.freed is not None:
        rows = rows.freed
    together = (
        rows.forms.loops is not None
    )  # to close them costs more than to solve for more columns
    groups: dict[int | None, list[int]] = {}
    for column, support in structure.by_robot.items():
        if support:
            body = mechanism.columns[column].body
            alone = (
                not (together or rows.forms.rational) and body is None
            )  # some may have no closed form
            groups.setdefault(
                None if together else -1 - column if alone else body, []
            ).append(column)
    for targets in groups.values():
        sources = sorted({c for t in targets for c in structure.by_robot[t]})
        degrees = _degrees(mechanism, sources, targets)
        every = rows.columns([*sources, *targets])
        roles = symbol_roles(mechanism)
        if not every.forms.rational and rows.forms.loops is None:
            first, second = irrational_roots(every.forms)
            roles = replace(
                roles,
                irrational=(
                    roles.irrational[0] or first,
                    roles.irrational[1] or second,
                ),
            )
        dependence = Dependence(roles, every, sources, targets, frozenset(), degrees)
        yield PlacedDependence(dependence, range(structure.parameters))


def linear_relations(
    forms: LinearForms, structure: Structure
) -> list[PlacedDependence]:
    """The relations of the dependent columns of any recorded rows that do not vanish.

    They are found together modulo primes, and each on its own at real states, where some may have no closed form.
    """
    if structure.functions_are_free and forms.freed is not None:
        forms = forms.freed
    targets = [column for column, support in structure.by_robot.items() if support]
    groups = (
        [targets] if targets and forms.rational else [[target] for target in targets]
    )
    found = list[PlacedDependence]()
    roles = SymbolRoles(frozenset(), frozenset(), frozenset(), irrational_roots(forms))
    for group in groups:
        sources = sorted({c for t in group for c in structure.by_robot[t]})
        rows = Rows(forms, 0).columns([*sources, *group])
        found.append(
            PlacedDependence(
                Dependence(roles, rows, sources, group, frozenset(), None),
                range(structure.parameters),
            )
        )
    return found


def _integral(polynomial: Polynomial) -> Polynomial:
    """A polynomial whose whole coefficients are integers."""
    terms = polynomial.terms.items()
    return Polynomial(
        {
            m: int(c) if isinstance(c, Fraction) and c.denominator == 1 else c
            for m, c in terms
        }
    )


def _degrees(
    mechanism: Mechanism, sources: Sequence[int], targets: Sequence[int]
) -> list[int] | None:
    """Powers of length of the coefficients; None where parameters of effects make them inhomogeneous."""
    columns = mechanism.columns
    if any(columns[c].kind is None for c in (*sources, *targets)):
        return None
    return [
        columns[s].length_degree - columns[t].length_degree
        for s in sources
        for t in targets
    ]


# -- interpolation ----------------------------------------------------------------------------------------------------

Combination = dict[int, RationalFunction]
"""A column as a combination of other columns: coefficient by column."""

PRIMES_OF_NUMBERS = 16
"""Primes for coefficients without symbols, whose fractions then have up to 74 digits."""


def closed_columns(
    found: Sequence[PlacedDependence],
    zero: Sequence[int],
    rng: np.random.Generator,
    work: Work,
    report: Callable[[str], None],
    share: float = 0.5,
) -> dict[int, Combination]:
    """The dependent columns with closed forms as combinations of pivot columns; each dependence may take a share."""
    raw: dict[int, Combination] = {column: {} for column in zero}
    dependences: dict[Dependence, list[PlacedDependence]] = {}
    for relation in found:
        dependences.setdefault(relation.dependence, []).append(relation)
    total = sum(len(relation.targets) for relation in found)
    for dependence in sorted(dependences, key=lambda k: k.cost * (1 + len(k.symbols))):
        report(f"closed forms: {len(raw) - len(zero)} of {total} columns")
        combinations = _interpolated(dependence, rng, work, share)
        for relation in dependences[dependence]:
            raw |= relation.placed(
                combinations, RationalFunction, partial(_substituted, work)
            )
    dependent = {column for relation in found for column in relation.targets} | set(
        zero
    )
    solved: dict[int, Combination] = {}
    for column in sorted(raw):
        if all(c in solved for c in raw[column] if c in dependent):
            result = _substituted(work, raw[column], solved)
            if result is not None:
                solved[column] = result
    return solved


def _interpolated(
    dependence: Dependence, rng: np.random.Generator, work: Work, most: float
) -> dict[int, Combination]:
    """The targets whose coefficients all have closed forms within a share of the work."""
    share = work.share(most)
    try:
        most_primes = MOST_PRIMES if dependence.symbols else PRIMES_OF_NUMBERS
        functions = interpolate(dependence.unknown(rng), rng, share, most_primes)
    except ClosedFormError:
        return {}
    finally:
        work.give_back(share)
    columns: dict[int, Combination | None] = {
        target: {} for target in dependence.targets
    }
    for (source, target), function in zip(dependence.pairs, functions, strict=True):
        column = columns[target]
        if function is None:
            columns[target] = None
        elif column is not None and function:
            column[source] = function
    return {target: column for target, column in columns.items() if column is not None}


def _substituted(
    work: Work, combination: Combination, solved: Mapping[int, Combination]
) -> Combination | None:
    """A combination of columns as one of others, or None if it takes too much work."""
    products: dict[int, list[tuple[RationalFunction, RationalFunction]]] = {}
    for column, coefficient in combination.items():
        if column not in solved:
            products.setdefault(column, []).append((ONE, coefficient))
            continue
        first = (
            ONE if coefficient.is_one else coefficient
        )  # so that what moves unchanged remains one object
        for pivot, inner in solved[column].items():
            products.setdefault(pivot, []).append((first, inner))
    true = [
        terms for terms in products.values() if len(terms) > 1 or terms[0][0] is not ONE
    ]
    if not work.take(sum(map(cost_of_products, true))):
        return None
    total = {pivot: sum_of_products(terms) for pivot, terms in sorted(products.items())}
    if any(len(c.numerator.terms) > work.terms for c in total.values()):
        return None
    return {pivot: c for pivot, c in total.items() if c.numerator.terms}


def assembled(
    parameters: tuple[str, ...],
    pivots: tuple[int, ...],
    columns: dict[int, Combination],
    order: tuple[int, ...],
    numbers: StatedNumbers | None = None,
) -> BaseMatrix:
    """B from its dependent columns as combinations of pivots."""
    rows: dict[int, dict[int, RationalFunction]] = {
        p: {p: RationalFunction(1)} for p in pivots
    }
    for column, combination in columns.items():
        for pivot, coefficient in combination.items():
            rows[pivot][column] = coefficient
    ordered = tuple(dict(sorted(rows[p].items())) for p in pivots)
    return BaseMatrix(parameters, pivots, ordered, order, numbers)
