"""The same factors by NumPy and LAPACK alone: what the kernels are compared with, and a way without machine code."""

from __future__ import annotations

import numpy as np

from echelon.arrays import Floats
from echelon.machine.batch import Batch
from echelon.observe.layout import layout_of
from echelon.observe.triangle import upper_triangle
from echelon.program.function import Function
from echelon.program.schedule import FloatArithmetic, Schedule


class _Reference:
    """Rows of an observation matrix, evaluated by NumPy."""

    unit = 1

    def __init__(self, function: Function) -> None:
        self.function = function
        self.layout, self._columns = layout_of(function)
        self._schedule = Schedule(function.program, function.outputs)

    def start(self) -> Floats:
        """The factors of no samples."""
        return np.zeros(self.layout.doubles)

    def rows(self, batch: Batch, first: int, count: int) -> list[Floats]:
        """For each output its rows of [W y] without structural zeros, arrays of shape (count, n_i + 1)."""
        values: dict[int, Floats] = {}
        varying = [a for a in self.function.arguments if not a.uniform]
        for argument, array in zip(varying, batch.columns, strict=True):
            values |= {node: array[first : first + count, k] for k, node in enumerate(argument.nodes)}
        uniform = [node for a in self.function.arguments if a.uniform for node in a.nodes]
        values |= {node: np.full(count, value) for node, value in zip(uniform, batch.uniform, strict=True)}
        table = self._schedule.run(FloatArithmetic(), values, count)
        ends = np.cumsum(self.layout.sizes)[:-1]
        return [table[columns].T for columns in np.split(self._columns, ends)]


class ReferenceQr(_Reference):
    """R-factors by LAPACK's Householder reflectors.

    Parameters
    ----------
    function : Function
        A regressor with measured outputs.
    """

    def observe(self, batch: Batch, first: int, count: int) -> Floats:
        """R of each output's rows."""
        return np.concatenate([upper_triangle(rows).ravel() for rows in self.rows(batch, first, count)])

    def merge(self, total: Floats, part: Floats) -> None:
        """R of [total; part], in place of total."""
        for R, other in zip(self.layout.split(total), self.layout.split(part), strict=True):
            R[:] = upper_triangle(np.vstack([R, other]))

    def factors(self, total: Floats) -> tuple[Floats, ...]:
        """Each output's R."""
        return self.layout.split(total)


class ReferenceGram(_Reference):
    """Gram matrices by BLAS.

    Parameters
    ----------
    function : Function
        A regressor with measured outputs.
    """

    def observe(self, batch: Batch, first: int, count: int) -> Floats:
        """The Gram matrix of each output's rows."""
        return np.concatenate([(rows.T @ rows).ravel() for rows in self.rows(batch, first, count)])

    def merge(self, total: Floats, part: Floats) -> None:
        """Sum in place of total."""
        total += part

    def factors(self, total: Floats) -> tuple[Floats, ...]:
        """Each output's Gram matrix."""
        return self.layout.split(total)
