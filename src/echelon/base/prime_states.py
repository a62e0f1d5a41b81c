"""Rows at random points of prime fields: what samples models whose rows are rational functions of free variables."""

from __future__ import annotations

import numpy as np

from echelon.algebra import Geometry, PrimeField, Residues, solve_batched
from echelon.dynamics import Rows
from echelon.shared import DegenerateSampleError

MOST_VISITS = 32
"""Visits of each region of signs after which relations that still fail are given up."""


class PrimeStates:
    """Rows of a model modulo primes."""

    def __init__(self, rows: Rows) -> None:
        self.rows, self._sampler = rows, rows.forms.sampler()

    @property
    def symbols(self) -> list[str]:
        """Symbols that the rows depend on, sorted."""
        return self._sampler.symbols

    @property
    def angles(self) -> frozenset[str]:
        """Symbols that are angles."""
        return self._sampler.angles

    def cost(self, sources: int) -> float:
        """Operations of solving for the coefficients of all columns behind the auxiliary ones and some sources."""
        forms, unknowns = self.rows.forms, self.rows.auxiliary + sources
        program = len(forms.program.needed(list(forms.entries.values())))
        return (unknowns + 1) * program + (unknowns + 1) * unknowns * forms.shape[1]

    def coefficients(
        self,
        field: PrimeField,
        geometry: Geometry,
        rng: np.random.Generator,
        sources: int,
    ) -> Residues:
        """Coefficients of all columns behind the auxiliary ones and some sources, as combinations of these.

        Parameters
        ----------
        field : PrimeField
        geometry : mapping of str to array of shape (geometries,)
            Residues of the symbols, of angles of the tangent of their half.
        rng : numpy.random.Generator
        sources : int
            Number of columns that are solved for, beside the auxiliary ones.

        Returns
        -------
        array of shape (sources · targets, geometries)

        Raises
        ------
        DegenerateSampleError
            If the sources are not independent at the random states.
        """
        first = self.rows.auxiliary
        unknowns = first + sources
        # one more equation than unknowns: a false relation contradicts itself
        states = max(unknowns + 1, self._sampler.regions)
        most = states if self._sampler.regions == 1 else MOST_VISITS * states
        while True:
            matrix = self.rows.forms.stacked(
                self._sampler.evaluate(field, rng, states, geometry)
            )
            try:
                solution = solve_batched(
                    matrix[:, :, :unknowns], matrix[:, :, unknowns:], field
                )
            except DegenerateSampleError:
                states = 2 * states  # a region of signs may need more points
                if states > most:
                    raise
                continue
            return solution[:, first:].reshape(len(solution), -1).T
