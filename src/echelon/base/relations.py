"""Relations: small sets of columns of X of which some are known to be combinations of the others.

For columns that move across one joint the relation is found on the two bodies of that joint.  Columns that depend for
other reasons (restricted motion near the base, couplings, massless bodies) have relations of just the columns that take
part.  A relation's coefficients can be evaluated wherever rows of X can; all relations together, solved from the base
to the tips, make B.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol, TypeVar

import numpy as np

from echelon.base.modes import in_mode
from echelon.base.rows import Rows, rows_of
from echelon.base.structure import Structure, floating_pair, pair_columns
from echelon.exact.ansatz import Geometry
from echelon.exact.elimination import solve_batched
from echelon.exact.field import PrimeField, Residues
from echelon.exact.unknown import UnknownFunctions
from echelon.mechanism.mechanism import Mechanism
from echelon.mechanism.roles import symbol_roles
from echelon.program.sampling import FieldSampler
from echelon.regressor.energy import energy_form


@dataclass(frozen=True, eq=False)
class Relation:
    """Some columns known to be combinations of others.

    Attributes
    ----------
    mechanism : Mechanism
    rows : Rows
        With the columns [auxiliary, sources, targets], to find out how.
    sources, targets : sequence of int
        Columns of X; those of ``targets`` are combinations of those of ``sources``.
    zero : frozenset of int
        Sources that vanish in X, so that their coefficients do not matter.
    degrees : sequence of int or None
        Powers of length of the coefficients, by source and target; None where they are inhomogeneous.
    """

    mechanism: Mechanism
    rows: Rows
    sources: Sequence[int]
    targets: Sequence[int]
    zero: frozenset[int]
    degrees: Sequence[int] | None

    @cached_property
    def sampler(self) -> FieldSampler:
        """Evaluates the rows modulo primes."""
        return self.rows.forms.sampler()

    @cached_property
    def pairs(self) -> list[tuple[int, int]]:
        """(source, target) of every coefficient that matters."""
        return [(s, t) for s in self.sources if s not in self.zero for t in self.targets]

    @property
    def unknowns(self) -> int:
        """Number of columns that are solved for."""
        return self.rows.auxiliary + len(self.sources)

    @cached_property
    def cost(self) -> float:
        """Operations of one evaluation modulo a prime."""
        forms = self.rows.forms
        program = len(forms.program.needed(list(forms.entries.values())))
        return (self.unknowns + 1) * (program + self.unknowns * (self.unknowns + len(self.targets)))

    def unknown(self, rng: np.random.Generator) -> UnknownFunctions:
        """The coefficients of :attr:`pairs` as functions of the symbols."""
        roles = symbol_roles(self.mechanism)
        lengths = frozenset() if self.degrees is None else roles.lengths
        degrees = self.degrees or [0] * (len(self.sources) * len(self.targets))
        chosen = [k for k, s in enumerate(s for s in self.sources for _ in self.targets) if s not in self.zero]

        def evaluate(field: PrimeField, geometry: Geometry) -> Residues:
            found: Residues = self.coefficients(field, geometry, rng)[chosen]
            return found

        return UnknownFunctions(
            evaluate,
            self.sampler.symbols,
            roles.angles,
            lengths,
            [degrees[k] for k in chosen],
            roles.irrational,
            self.cost,
        )

    def coefficients(self, field: PrimeField, geometry: Geometry, rng: np.random.Generator) -> Residues:
        """Coefficients at given geometries: array of shape (sources · targets, geometries)."""
        first, unknowns = self.rows.auxiliary, self.unknowns
        states = unknowns + 1  # one more equation than unknowns: a false relation contradicts itself
        matrix = self.rows.forms.stacked(self.sampler.evaluate(field, rng, states, geometry))
        solution = solve_batched(matrix[:, :, :unknowns], matrix[:, :, unknowns:], field)
        return solution[:, first:].reshape(len(solution), -1).T


def relations(mechanism: Mechanism, structure: Structure) -> list[Relation]:
    """The relations of all dependent columns that do not vanish.

    Parameters
    ----------
    mechanism : Mechanism
    structure : Structure
        As found for the same mechanism.
    """
    zero = frozenset(c for c, support in structure.by_robot.items() if not support)
    return [*_across_joints(mechanism, structure, zero), *_across_robot(mechanism, structure)]


def _across_joints(mechanism: Mechanism, structure: Structure, zero: frozenset[int]) -> Iterable[Relation]:
    for index, targets in structure.by_joint.items():
        columns = pair_columns(mechanism, index)
        sources = [c for c in columns if c not in targets]
        position = {c: k for k, c in enumerate(columns)}
        pair = floating_pair(mechanism, index)
        rows = Rows(energy_form(pair), 1).columns([position[c] for c in (*sources, *targets)])
        yield Relation(pair, rows, sources, targets, zero, _degrees(mechanism, sources, targets))


def _across_robot(mechanism: Mechanism, structure: Structure) -> Iterable[Relation]:
    groups: dict[int | None, list[int]] = {}
    # where finding a closed pose costs more than eliminating all columns at once, there is one group
    together = bool(mechanism.closures) and not symbol_roles(mechanism).symbols
    for column, support in structure.by_robot.items():
        if support:
            groups.setdefault(None if together else mechanism.columns[column].body, []).append(column)
    if not groups:
        return
    rows = rows_of(mechanism)
    rows = Rows(in_mode(rows.forms, structure.accepted), rows.auxiliary)
    for targets in groups.values():
        sources = sorted({c for t in targets for c in structure.by_robot[t]})
        chosen = rows.columns([*sources, *targets])
        yield Relation(mechanism, chosen, sources, targets, frozenset(), _degrees(mechanism, sources, targets))


def _degrees(mechanism: Mechanism, sources: Sequence[int], targets: Sequence[int]) -> list[int] | None:
    """Powers of length of the coefficients; None where parameters of effects make them inhomogeneous."""
    columns = mechanism.columns
    if any(columns[c].kind is None for c in (*sources, *targets)):
        return None
    return [columns[s].length_degree - columns[t].length_degree for s in sources for t in targets]


class Ring(Protocol):
    """Numbers that can be added and multiplied."""

    def __add__(self, other: Any, /) -> Any: ...

    def __mul__(self, other: Any, /) -> Any: ...


T = TypeVar("T", bound=Ring)


def substituted(
    combination: Mapping[int, T], solved: Mapping[int, Mapping[int, T]], keep: Callable[[T], bool] = bool
) -> dict[int, T]:
    """A combination of columns as one of pivots.

    Parameters
    ----------
    combination : mapping of int to coefficient
    solved : mapping of int to mapping of int to coefficient
        The dependent columns among those of ``combination`` as combinations of pivots.
    keep : callable
        Which coefficients are kept; those that are not zero if omitted.
    """
    total: dict[int, T] = {}
    for column, coefficient in combination.items():
        if column not in solved:
            total[column] = total[column] + coefficient if column in total else coefficient
            continue
        for pivot, inner in solved[column].items():
            addend = coefficient * inner
            total[pivot] = total[pivot] + addend if pivot in total else addend
    return {column: c for column, c in sorted(total.items()) if keep(c)}
