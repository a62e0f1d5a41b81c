"""Closed forms: the exact matrix B, entry by entry, from the structure.

Every dependent column is a combination of columns to its left.  For columns that move across one joint the combination
is interpolated on the two bodies of that joint.  On a whole parent that is done in the frame where the joint begins to
move, so that equal joints share it, and a change of frame leads to the parent's own.  Then, going from the base to the
tips, the parent's own dependent columns are substituted.  Columns that depend for other reasons (restricted motion near
the base, couplings, massless bodies) are interpolated on just the columns that take part.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from echelon.base.modes import in_mode
from echelon.base.rows import Rows, rows_of
from echelon.base.structure import Structure, floating_pair, mount, pair_columns, pair_signature
from echelon.conventions import PER_BODY
from echelon.errors import DegenerateSampleError
from echelon.exact.ansatz import Geometry
from echelon.exact.elimination import solve_batched
from echelon.exact.field import PrimeField, Residues
from echelon.exact.interpolation import UnknownFunctions, interpolate
from echelon.exact.polynomial import Polynomial, as_polynomial
from echelon.exact.rational import RationalFunction
from echelon.inertia.spatial import move
from echelon.mechanism.mechanism import Mechanism
from echelon.mechanism.placement import Placement
from echelon.mechanism.roles import symbol_roles
from echelon.program.sampling import FieldSampler
from echelon.regressor.energy import energy_form

_MOST_TIMES = 32  # so many times as many points where regions of signs need them

Combination = dict[int, RationalFunction]
"""A column as a combination of other columns: coefficient by column."""

_ONE = RationalFunction(1)


def dependent_columns(mechanism: Mechanism, structure: Structure, rng: np.random.Generator) -> dict[int, Combination]:
    """Every dependent column as a combination of pivot columns.

    Parameters
    ----------
    mechanism : Mechanism
    structure : Structure
        As found for the same mechanism.
    rng : numpy Generator

    Returns
    -------
    dict of int to dict of int to RationalFunction
        Column j of X equals Σ_i coefficient_i · column i of X, so that row i of B has this coefficient in column j.

    Raises
    ------
    ClosedFormError
        If a coefficient has no closed form within the degree bounds.
    """
    raw = _across_joints(mechanism, structure, rng) | _across_robot(mechanism, structure, rng)
    solved: dict[int, Combination] = {}
    for column in sorted(raw):
        solved[column] = _substituted(raw[column], solved)
    return solved


def _substituted(combination: Combination, solved: Mapping[int, Combination]) -> Combination:
    total: Combination = {}
    for column, coefficient in combination.items():
        plain = coefficient == _ONE
        for pivot, inner in solved.get(column, {column: _ONE}).items():
            addend = inner if plain else coefficient * inner
            if pivot in total:
                addend = total.pop(pivot) + addend
            if addend:
                total[pivot] = addend
    return dict(sorted(total.items()))


def _across_joints(mechanism: Mechanism, structure: Structure, rng: np.random.Generator) -> dict[int, Combination]:
    found: dict[int, Combination] = {}
    known: dict[object, dict[int, Combination]] = {}  # by what matters of the two bodies, with columns counted there
    for index, targets in structure.by_joint.items():
        columns = pair_columns(mechanism, index)
        places = [k for k, c in enumerate(columns) if c in targets]
        signature = (tuple(places), pair_signature(mechanism, index))
        if signature not in known:
            pair = floating_pair(mechanism, index)
            sources = [k for k in range(len(columns)) if k not in places]
            rows = Rows(energy_form(pair), 1).columns([*sources, *places])
            known[signature] = _Relation(pair, rows, sources, places, _degrees(pair, sources, places)).solve(rng)
        moved = _moved(mount(mechanism, index), {k for c in known[signature].values() for k in c if k < PER_BODY})
        for place, combination in known[signature].items():
            found[columns[place]] = {columns[k]: c for k, c in _substituted(combination, moved).items()}
    return found


def _moved(placement: Placement, kinds: set[int]) -> dict[int, Combination]:
    """Parameters of a whole body about a placed frame, as combinations of those about the frame of reference."""
    if placement.is_identity:
        return {}
    rows = [(*row, t) for row, t in zip(placement.rotation, placement.translation, strict=True)]
    plain = [[entry if entry.number is None else entry.number for entry in row] for row in rows]
    chosen = sorted(kinds)
    units = np.eye(PER_BODY, dtype=int)[chosen].astype(object)
    moved = move(units, np.array([*plain, [0, 0, 0, 1]], dtype=object))
    return {
        kind: {k: RationalFunction(_integral(as_polynomial(entry))) for k, entry in enumerate(row) if entry}
        for kind, row in zip(chosen, moved, strict=True)
    }


def _integral(polynomial: Polynomial) -> Polynomial:
    """The same with whole numbers as integers."""
    terms = polynomial.terms.items()
    return Polynomial({m: int(c) if isinstance(c, Fraction) and c.denominator == 1 else c for m, c in terms})


def _across_robot(mechanism: Mechanism, structure: Structure, rng: np.random.Generator) -> dict[int, Combination]:
    found: dict[int, Combination] = {c: {} for c, support in structure.by_robot.items() if not support}
    groups: dict[int | None, list[int]] = {}
    # where finding a closed pose costs more than eliminating all columns at once, there is one group
    together = bool(mechanism.closures) and not symbol_roles(mechanism).symbols
    for column, support in structure.by_robot.items():
        if support:
            groups.setdefault(None if together else mechanism.columns[column].body, []).append(column)
    rows = rows_of(mechanism) if groups else None
    if rows is not None:
        rows = Rows(in_mode(rows.forms, structure.accepted), rows.auxiliary)
    for targets in groups.values():
        assert rows is not None
        sources = sorted({c for t in targets for c in structure.by_robot[t]})
        chosen = rows.columns([*sources, *targets])
        found |= _Relation(mechanism, chosen, sources, targets, _degrees(mechanism, sources, targets)).solve(rng)
    return found


@dataclass(frozen=True)
class _Relation:
    """Some columns known to be combinations of others, with rows [auxiliary, sources, targets] to find out how."""

    mechanism: Mechanism
    rows: Rows
    sources: Sequence[int]
    targets: Sequence[int]
    degrees: Sequence[int] | None

    def solve(self, rng: np.random.Generator) -> dict[int, Combination]:
        """The combinations in closed form."""
        roles = symbol_roles(self.mechanism)
        sampler = self.rows.forms.sampler()

        def evaluate(field: PrimeField, geometry: Geometry) -> Residues:
            return self._coefficients(sampler, field, geometry, rng)

        lengths = frozenset() if self.degrees is None else roles.lengths
        degrees = self.degrees or [0] * (len(self.sources) * len(self.targets))
        unknown = UnknownFunctions(evaluate, sampler.symbols, roles.angles, lengths, degrees, roles.irrational)
        functions = iter(interpolate(unknown, rng))
        found: dict[int, Combination] = {t: {} for t in self.targets}
        for source in self.sources:
            for target in self.targets:
                function = next(functions)
                if function:
                    found[target][source] = function
        return found

    def _coefficients(
        self, sampler: FieldSampler, field: PrimeField, geometry: Geometry, rng: np.random.Generator
    ) -> Residues:
        """Coefficients at given geometries: array of shape (sources · targets, geometries)."""
        first = self.rows.auxiliary
        unknowns = first + len(self.sources)
        # one more equation than unknowns: a false relation contradicts itself
        states = max(unknowns + 1, sampler.regions)
        most = states if sampler.regions == 1 else _MOST_TIMES * states
        while True:
            matrix = self.rows.forms.stacked(sampler.evaluate(field, rng, states, geometry))
            try:
                solution = solve_batched(matrix[:, :, :unknowns], matrix[:, :, unknowns:], field)
            except DegenerateSampleError:
                states = 2 * states  # a region of signs may need more points
                if states > most:
                    raise
                continue
            return solution[:, first:].reshape(len(solution), -1).T


def _degrees(mechanism: Mechanism, sources: Sequence[int], targets: Sequence[int]) -> list[int] | None:
    """Powers of length of the coefficients; None where parameters of effects make them inhomogeneous."""
    columns = mechanism.columns
    if any(columns[c].kind is None for c in (*sources, *targets)):
        return None
    return [columns[s].length_degree - columns[t].length_degree for s in sources for t in targets]
