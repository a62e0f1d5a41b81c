"""Normal equations: Gram matrices of [W y], output by output.

Faster than R-factors and good enough where W is well conditioned: errors grow with the square of the condition number.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.observe.layout import Layout
from echelon.observe.observation import checked_weights

_FEWEST_DIGITS = 1e-14  # smaller squares of pivots, with columns of norm 1, are mostly rounding errors


@dataclass(frozen=True, repr=False)
class NormalEquations:
    """Gram matrices of the outputs' rows of [W y].

    Attributes
    ----------
    layout : Layout
    grams : tuple of array of shape (n_i + 1, n_i + 1)
        For each output that of its own columns and y.
    samples : int
    """

    layout: Layout
    grams: tuple[Floats, ...]
    samples: int

    def merged(self, other: NormalEquations) -> NormalEquations:
        """The normal equations of both sets of samples.

        Parameters
        ----------
        other : NormalEquations

        Raises
        ------
        InputError
            If they are not of the same outputs and parameters.
        """
        if self.layout != other.layout:
            raise InputError("normal equations of different outputs or parameters cannot be merged")
        grams = tuple(a + b for a, b in zip(self.grams, other.grams, strict=True))
        return NormalEquations(self.layout, grams, self.samples + other.samples)

    def __add__(self, other: NormalEquations) -> NormalEquations:
        """The normal equations of both sets of samples; see :meth:`merged`."""
        return self.merged(other)

    def combined(self, weights: Sequence[float] | Floats | None = None) -> tuple[Floats, Floats, float]:
        """WᵀW, Wᵀy and yᵀy of all outputs' rows together.

        Parameters
        ----------
        weights : array of shape (m,), optional
            Factor of each output's rows; all 1 if omitted.

        Returns
        -------
        (array of shape (n, n), array of shape (n,), float)
        """
        n = len(self.layout.parameters)
        total = np.zeros((n + 1, n + 1))
        for output, (gram, weight) in enumerate(zip(self.grams, checked_weights(self.layout, weights), strict=True)):
            places = self.layout.places(output)
            total[np.ix_(places, places)] += weight**2 * gram
        return total[:n, :n], total[:n, n], float(total[n, n])

    def solve(self, weights: Sequence[float] | Floats | None = None) -> Floats:
        """The least-squares solution, by Cholesky's method with columns scaled to norm 1.

        Parameters
        ----------
        weights : array of shape (m,), optional
            Factor of each output's rows; all 1 if omitted.

        Returns
        -------
        array of shape (n,)

        Raises
        ------
        InputError
            If the matrix cannot be told from a singular one.
        """
        gram, moment, _ = self.combined(weights)
        scales = np.sqrt(np.diagonal(gram))
        safe = np.where(scales == 0, 1.0, scales)
        try:
            L = np.linalg.cholesky(gram / safe[:, None] / safe)
            singular = np.diagonal(L).min(initial=1.0) ** 2 < _FEWEST_DIGITS * len(L)
        except np.linalg.LinAlgError:
            singular = True
        if singular:
            raise InputError(
                "the normal equations are singular to half the digits of a double; use the R-factors, which keep all"
            )
        solution: Floats = np.linalg.solve(L.T, np.linalg.solve(L, moment / safe)) / safe
        return solution

    def __repr__(self) -> str:
        m, n = len(self.layout.outputs), len(self.layout.parameters)
        return f"NormalEquations({self.samples} samples × {m} outputs × {n} parameters)"
