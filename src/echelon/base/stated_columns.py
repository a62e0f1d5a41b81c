"""Columns of B in numbers, where the budget for closed forms does not last.

Which coefficients are not zero is known from random points of finite fields, whatever the symbols' values.  Their
numbers are exact fractions where all stated values that matter have exact residues; where angles have no exact sine
they come from ball arithmetic, with a proved bound, rounded to a fixed number of digits.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import flint
import numpy as np
import numpy.typing as npt

from echelon.algebra import (
    BALL_BITS,
    SURPLUS_ROWS,
    Number,
    Polynomial,
    PrimeField,
    RationalFunction,
    Residues,
    UnknownFunctions,
    Work,
    ball,
    by_pivots,
    interpolate,
    persistent,
    residues_at,
    substituted,
)
from echelon.base.ball_rows import ball_rows, stated_generators
from echelon.base.ball_tables import Balls, ball_error, rounded
from echelon.base.closed_form import Dependence, PlacedDependence
from echelon.base.matrix import StatedNumbers
from echelon.robot import Mechanism, all_symbols, symbol_roles, value_texts
from echelon.shared import ClosedFormError

_MOST_BITS = 8 * BALL_BITS
LARGEST_RELATIVE_ERROR = 1e-60
"""Relative error of a coefficient below which it can be rounded."""
MOTIONS_PER_POSE = 2
"""Motions through a closed pose, which takes long to enclose: even one freedom without gravity shows as many."""
MOST_PRIMES = 8
"""Primes for fractions of up to 37 digits; for longer ones, balls take less time."""

Pair = tuple[int, int]
"""(pivot, column) of a coefficient of B."""


class StatedColumns:
    """Numbers of some columns of B."""

    def __init__(
        self,
        mechanism: Mechanism,
        found: Sequence[PlacedDependence],
        zero: Sequence[int],
        order: tuple[int, ...],
        rng: np.random.Generator,
        *,
        exact: bool = True,
    ) -> None:
        """``exact`` says whether fractions may be short enough to be found exactly."""
        self.mechanism, self.found, self.order, self.rng = mechanism, found, order, rng
        self._may_be_exact = exact
        self.zero = list(zero)
        dependent = {*zero, *(t for relation in found for t in relation.targets)}
        self._classical = [c for c in range(len(order)) if c not in dependent]
        self._is_classical = order == tuple(range(len(order)))
        self.pivots, self._supports = self._structure()

    def numbers(
        self, columns: Sequence[int]
    ) -> tuple[dict[int, dict[int, RationalFunction]], StatedNumbers]:
        """Some columns as combinations of pivots, and how exact they are."""
        pairs = [
            (pivot, column)
            for column in columns
            for pivot in self._supports.get(column, ())
        ]
        needed = self._needed(columns)
        names = {s for relation in needed for s in relation.symbols}
        plain = names <= all_symbols(
            self.mechanism
        )  # and not functions of constants, such as exp(k)
        used = self._stated(names if plain else all_symbols(self.mechanism))
        at = value_texts(self.mechanism, all_symbols(self.mechanism))
        meaning = StatedNumbers(tuple(sorted(columns)), at, 0.0, False)
        known = replace(meaning, at=used).exact(symbol_roles(self.mechanism).angles)
        values = (
            self._exact(pairs, needed, known)
            if self._may_be_exact and plain and known is not None
            else None
        )
        if values is None:
            values, radius = self._from_balls(pairs, needed, at)
            meaning = replace(meaning, radius=radius)
        found: dict[int, dict[int, RationalFunction]] = {
            column: {} for column in columns
        }
        for (pivot, column), value in zip(pairs, values, strict=True):
            if value:
                found[column][pivot] = RationalFunction(value)
        return found, meaning

    # -- which coefficients there are ----------------------------------------------------------------------------

    def _structure(self) -> tuple[tuple[int, ...], dict[int, set[int]]]:
        """Pivots, and for every other column those that it depends on, for any values of the symbols.

        A coefficient that vanishes modulo one prime only would be missed, which the certificate would see.
        """
        field = PrimeField.random(self.rng)

        def attempt() -> dict[int, dict[int, int]]:
            symbols = {s for relation in self.found for s in relation.symbols}
            geometry = {s: field.draw(self.rng, (1,)) for s in sorted(symbols)}
            return self._modular(field, geometry, self.found)

        solved = persistent(attempt)
        pivots = tuple(column for column in self.order if column not in solved)
        return pivots, {
            column: set(combination) for column, combination in solved.items()
        }

    def _needed(self, columns: Sequence[int]) -> list[PlacedDependence]:
        """The relations that some columns depend on."""
        if not self._is_classical:
            return list(self.found)
        owner = {
            target: relation for relation in self.found for target in relation.targets
        }
        needed: list[PlacedDependence] = []
        pending = [owner[c] for c in columns if c in owner]
        while pending:
            relation = pending.pop()
            if relation not in needed:
                needed.append(relation)
                pending += [owner[s] for s in relation.sources if s in owner]
        return needed

    def _stated(self, names: set[str]) -> dict[str, str]:
        at = value_texts(self.mechanism, names)
        silent = sorted(names - at.keys())
        if silent:
            raise ClosedFormError(
                f"not all coefficients have closed forms within the budget, and the symbol '{silent[0]}' has no value: "
                "give it a value, or give a larger budget (--budget)"
            )
        return at

    # -- modulo primes -------------------------------------------------------------------------------------------

    def _modular(
        self,
        field: PrimeField,
        geometry: Mapping[str, Residues],
        needed: Sequence[PlacedDependence],
    ) -> dict[int, dict[int, int]]:
        """Dependent columns as combinations of pivots at one geometry."""

        def number(polynomial: Polynomial) -> int:
            return (
                polynomial.evaluate(
                    residues_at(polynomial.generators(), geometry, field), field.embed
                )
                % field.p
            )

        def coefficients(dependence: Dependence) -> npt.NDArray[Any]:
            own = {s: geometry[s] for s in dependence.sampler.symbols}
            found = dependence.coefficients(field, own, self.rng)[:, 0].astype(object)
            return found.reshape(len(dependence.sources), -1)

        def reduced(combination: dict[int, int]) -> dict[int, int]:
            return {
                pivot: v % field.p for pivot, v in combination.items() if v % field.p
            }

        solved = self._solved(needed, coefficients, number, reduced)
        assert solved is not None
        return solved if self._is_classical else self._reordered(solved, field)

    def _solved(
        self,
        needed: Sequence[PlacedDependence],
        coefficients: Callable[[Dependence], npt.NDArray[Any] | None],
        number: Callable[[Polynomial], Any],
        reduced: Callable[[dict[int, Any]], dict[int, Any]],
    ) -> dict[int, dict[int, Any]] | None:
        """Dependent columns as combinations of classical pivots; None where a dependence has no coefficients."""
        raw: dict[int, dict[int, Any]] = {column: {} for column in self.zero}
        known: dict[Dependence, dict[int, dict[int, Any]]] = {}
        for relation in needed:
            dependence = relation.dependence
            if dependence not in known:
                values = coefficients(dependence)
                if values is None:
                    return None
                columns = zip(dependence.targets, values.T, strict=True)
                known[dependence] = {
                    t: dict(zip(dependence.sources, column, strict=True))
                    for t, column in columns
                }
            raw |= relation.placed(known[dependence], number)
        solved: dict[int, dict[int, Any]] = {}
        for column in sorted(raw):
            solved[column] = reduced(substituted(raw[column], solved))
        return solved

    def _reordered(
        self, solved: Mapping[int, Mapping[int, int]], field: PrimeField
    ) -> dict[int, dict[int, int]]:
        dense = np.zeros((len(self._classical), len(self.order)), dtype=np.int64)
        row = {pivot: i for i, pivot in enumerate(self._classical)}
        for pivot, i in row.items():
            dense[i, pivot] = 1
        for column, combination in solved.items():
            for pivot, value in combination.items():
                dense[row[pivot], column] = value
        found = by_pivots(dense[:, list(self.order)], field)
        return {
            self.order[k]: {self.order[p]: x for p, x in pivots.items()}
            for k, pivots in found.items()
        }

    def _exact(
        self,
        pairs: Sequence[Pair],
        needed: Sequence[PlacedDependence],
        values: Mapping[str, Number],
    ) -> list[Number] | None:
        """Exact values, or None where these are no short fractions."""

        def evaluate(field: PrimeField, _: Mapping[str, Residues]) -> Residues:
            geometry = {
                s: np.array([field.embed(v)], dtype=np.int64) for s, v in values.items()
            }
            solved = self._modular(field, geometry, needed)
            return np.array(
                [[solved[column].get(pivot, 0)] for pivot, column in pairs],
                dtype=np.int64,
            )

        roots = symbol_roles(self.mechanism).irrational
        unknown = UnknownFunctions(
            evaluate, (), frozenset(), frozenset(), [0] * len(pairs), roots
        )
        try:
            found = interpolate(unknown, self.rng, Work.of(1), MOST_PRIMES)
        except ClosedFormError:
            return None
        if None in found:
            return None
        return [f.numerator.number or 0 for f in found if f is not None]

    # -- in balls ------------------------------------------------------------------------------------------------

    def _from_balls(
        self,
        pairs: Sequence[Pair],
        needed: Sequence[PlacedDependence],
        at: Mapping[str, str],
    ) -> tuple[list[Number], float]:
        """Values rounded to a fixed number of digits, and the largest error."""
        bits = BALL_BITS
        while bits <= _MOST_BITS:
            with flint.ctx.workprec(bits):
                found = self._balls(pairs, needed, at)
                if found is not None and all(
                    ball_error(x)
                    <= LARGEST_RELATIVE_ERROR * max(1.0, float(abs(x).mid()))
                    for x in found
                ):
                    return rounded(found)
            bits *= 2
        raise ClosedFormError(
            f"{_MOST_BITS} bits of precision do not decide the coefficients; please report this model"
        )

    def _balls(
        self,
        pairs: Sequence[Pair],
        needed: Sequence[PlacedDependence],
        at: Mapping[str, str],
    ) -> list[Any] | None:
        def number(polynomial: Polynomial) -> Any:
            return polynomial.evaluate(
                stated_generators(polynomial.generators(), at), ball
            )

        solved = self._solved(
            needed,
            lambda dependence: _solved(dependence, at, self.rng),
            number,
            lambda found: found,
        )
        if solved is None:
            return None
        if not self._is_classical:
            return self._exchanged(pairs, solved)
        return [solved[column].get(pivot, flint.arb(0)) for pivot, column in pairs]

    def _exchanged(
        self, pairs: Sequence[Pair], solved: Mapping[int, Mapping[int, Any]]
    ) -> list[Any] | None:
        """Values for other pivots than the classical ones."""
        zero, one = flint.arb(0), flint.arb(1)

        def entry(pivot: int, column: int) -> Any:
            if column in solved:
                return solved[column].get(pivot, zero)
            if pivot == column:
                return one
            return zero

        columns = sorted({column for _, column in pairs})
        left = flint.arb_mat(
            [[entry(p, c) for c in self.pivots] for p in self._classical]
        )
        try:
            right = left.solve(
                flint.arb_mat([[entry(p, c) for c in columns] for p in self._classical])
            )
        except ZeroDivisionError:
            return None
        row, place = (
            {c: i for i, c in enumerate(part)} for part in (self.pivots, columns)
        )
        return [right[row[pivot], place[column]] for pivot, column in pairs]


def _solved(
    dependence: Dependence, at: Mapping[str, str], rng: np.random.Generator
) -> Balls | None:
    """Coefficients of a dependence, shape (sources, targets), or None if the precision does not decide them."""
    unknowns, forms = dependence.unknowns, dependence.rows.forms
    states = -(-(unknowns + SURPLUS_ROWS) // max(1, forms.shape[0]))
    for count in (states, 8 * states):  # regions of signs may need more
        rows = ball_rows(forms, at, count, rng, MOTIONS_PER_POSE)
        left = flint.arb_mat(rows[:, :unknowns].tolist())
        right = flint.arb_mat(rows[:, unknowns:].tolist())
        across = left.transpose()
        try:
            solution = (across * left).solve(across * right)
        except ZeroDivisionError:
            continue
        table = np.empty((unknowns, len(dependence.targets)), dtype=object)
        table.ravel()[:] = solution.entries()
        return table[dependence.rows.auxiliary :]
    return None
