"""Structure and closed forms of a general linear model, in finite fields.

Unlike a robot, a linear model has no chain to follow: all columns are eliminated at once.  Every sample set visits all
known regions of signs.  Samples are added until twice as many, in another field, give the same dependences: had a
region more to show, one more point of it would have shown some of it.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from echelon.base.matrix import BaseMatrix
from echelon.errors import ClosedFormError, DegenerateSampleError, EchelonError
from echelon.exact.ansatz import Geometry
from echelon.exact.elimination import reduced_echelon, solve_batched
from echelon.exact.field import PrimeField, Residues
from echelon.exact.interpolation import interpolate
from echelon.exact.numbers import Surd, parts_of
from echelon.exact.rational import RationalFunction
from echelon.exact.unknown import UnknownFunctions
from echelon.exact.work import Work
from echelon.regressor.linear import LinearForms

_SURPLUS_ROWS, _ATTEMPTS, _MOST_ROWS = 8, 64, 20_000

Supports = Mapping[int, tuple[int, ...]]
"""For every dependent column, the pivots that it depends on."""


class LinearStructure:
    """Elimination of the columns of a model's regressor."""

    def __init__(
        self, forms: LinearForms, parameters: tuple[str, ...], order: tuple[int, ...], rng: np.random.Generator
    ) -> None:
        self.forms, self.parameters, self.order, self.rng = forms, parameters, order, rng
        self.sampler = forms.sampler()

    def dependences(self) -> Supports:
        """Dependent columns, confirmed by more samples in another field."""
        rows, previous = max(self.forms.shape[1] + _SURPLUS_ROWS, self.sampler.regions * self.forms.shape[0]), None
        for _ in range(_ATTEMPTS):
            field = PrimeField.random(self.rng)
            try:
                current = self._supports(field, rows)
            except DegenerateSampleError:
                continue
            if current == previous:
                return current
            previous, rows = current, min(2 * rows, max(_MOST_ROWS, 2 * self.sampler.regions * self.forms.shape[0]))
        raise EchelonError("random points keep contradicting each other; please report this model")

    def matrix(self, supports: Supports, work: Work) -> BaseMatrix:
        """B in closed form."""
        pivots = tuple(c for c in self.order if c not in supports)
        rows: dict[int, dict[int, RationalFunction]] = {p: {p: RationalFunction(1)} for p in pivots}
        pairs = [(s, t) for t in supports for s in supports[t]]
        for (source, target), function in zip(pairs, self._interpolated(pairs, work), strict=True):
            rows[source][target] = function
        return BaseMatrix(self.parameters, pivots, tuple(dict(sorted(rows[p].items())) for p in pivots), self.order)

    # -- samples -------------------------------------------------------------------------------------------------

    def _sample(self, field: PrimeField, geometry: Geometry, states: int) -> Residues:
        """X at random states: array of shape (geometries, states · outputs, parameters)."""
        return self.forms.stacked(self.sampler.evaluate(field, self.rng, states, geometry))

    def _supports(self, field: PrimeField, rows: int) -> Supports:
        states = -(-rows // self.forms.shape[0])
        geometry = {s: field.draw(self.rng, (1,)) for s in self.sampler.symbols}
        reduced, pivots = reduced_echelon(self._sample(field, geometry, states)[0][:, list(self.order)], field)
        free = [k for k in range(len(self.order)) if k not in set(pivots)]
        return {
            self.order[k]: tuple(self.order[p] for row, p in enumerate(pivots) if int(reduced[row, k])) for k in free
        }

    # -- closed forms --------------------------------------------------------------------------------------------

    def _interpolated(self, pairs: list[tuple[int, int]], work: Work) -> list[RationalFunction]:
        if not pairs:
            return []
        sources, targets = sorted({s for s, _ in pairs}), sorted({t for _, t in pairs})
        wanted = np.array([sources.index(s) * len(targets) + targets.index(t) for s, t in pairs])

        def evaluate(field: PrimeField, geometry: Geometry) -> Residues:
            found: Residues = self._coefficients(field, geometry, sources, targets)[wanted]
            return found

        unknown = UnknownFunctions(
            evaluate,
            self.sampler.symbols,
            self.sampler.angles,
            frozenset(),
            [0] * len(pairs),
            _irrational(self.forms),
            self._cost(len(sources), len(targets)),
        )
        advice = "give constants values, or a name of their own to products of them, or a larger budget (--budget)"
        try:
            functions = interpolate(unknown, self.rng, work)
        except ClosedFormError as error:
            raise ClosedFormError(f"{error}; {advice}") from None
        found = [f for f in functions if f is not None]
        if len(found) < len(functions):
            missing = len(functions) - len(found)
            raise ClosedFormError(f"{missing} coefficients have no closed form within the budget; {advice}")
        return found

    def _cost(self, sources: int, targets: int) -> float:
        """Operations of one evaluation."""
        program = len(self.forms.program.needed(list(self.forms.entries.values())))
        return float((sources + 2) * (program + sources * (sources + targets)))

    def _coefficients(self, field: PrimeField, geometry: Geometry, sources: list[int], targets: list[int]) -> Residues:
        """Coefficients at given constants: array of shape (sources · targets, geometries)."""
        rows = len(sources) + 2
        for _ in range(_ATTEMPTS):
            table = self._sample(field, geometry, -(-rows // self.forms.shape[0]))
            try:
                solution = solve_batched(table[:, :, sources], table[:, :, targets], field)
            except DegenerateSampleError:
                rows = 2 * rows  # regions of signs may need more samples
                if rows > _MOST_ROWS:
                    raise
                continue
            return solution.reshape(len(solution), -1).T
        raise DegenerateSampleError("dependent samples")


def _irrational(forms: LinearForms) -> tuple[bool, bool]:
    """Whether √2 and √3 occur in the model."""
    program = forms.program
    needed = program.needed(forms.entries.values())
    parts = [parts_of(c) for n in needed if isinstance(c := program.constants.get(n), Surd)]
    return any(p[1] or p[3] for p in parts), any(p[2] or p[3] for p in parts)
