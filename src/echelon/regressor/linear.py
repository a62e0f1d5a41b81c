"""Linear forms: a sparse matrix of program nodes, y = X ζ with X recorded as a program."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from echelon.exact.field import Residues
from echelon.exact.numbers import Rational
from echelon.mechanism.mechanism import Mechanism
from echelon.program.sampling import FieldSampler
from echelon.program.tape import Program, Scalar
from echelon.regressor.blocks import BlockRows

if TYPE_CHECKING:
    from echelon.regressor.loops.closures import Loops


def column_sums(
    mechanism: Mechanism,
    bodies: Iterable[int],
    unit: Callable[[int, int], Scalar],
    wanted: Collection[int] | None = None,
) -> dict[int, Scalar]:
    """What a unit of each standard parameter gives; bodies that share a parameter are added up."""
    total: dict[int, Scalar] = {}
    for index in bodies:
        for column, kind in enumerate(mechanism.bodies[index].carried, mechanism.first_column.get(index, 0)):
            if wanted is None or column in wanted:
                value = unit(index, kind)
                total[column] = total[column] + value if column in total else value
    return total


@dataclass(frozen=True)
class LinearForms:
    """Rows of coefficients of some parameters, recorded on a program."""

    program: Program
    entries: Mapping[tuple[int, int], int]  # node of every entry that is not structurally zero
    shape: tuple[int, int]  # numbers of rows and columns
    loops: Loops | None = None  # what keeps motions on closed configurations, where there are loops
    blocks: BlockRows | None = None  # combinations of rows, over all columns, that see little at a time
    # stated values of constants, on which the regions of signs depend
    values: Mapping[str, Rational | float] = field(default_factory=dict)
    # the same columns are asked for again and again, and a schedule costs as much as an evaluation
    _restricted: dict[tuple[int, ...], LinearForms] = field(init=False, default_factory=dict, repr=False, compare=False)
    _samplers: dict[int | None, FieldSampler] = field(init=False, default_factory=dict, repr=False, compare=False)

    def columns(self, keep: Collection[int]) -> LinearForms:
        """The forms restricted to some columns, renumbered in the given order."""
        kept = tuple(keep)
        if kept not in self._restricted:
            position = {column: i for i, column in enumerate(kept)}
            entries = {(r, position[c]): node for (r, c), node in self.entries.items() if c in position}
            self._restricted[kept] = replace(self, entries=entries, shape=(self.shape[0], len(position)))
        return self._restricted[kept]

    def sampler(self, order: int | None = None) -> FieldSampler:
        """Evaluates all entries at random states modulo primes."""
        if not self._samplers:
            nodes = list(self.entries.values())
            if self.loops is None:
                self._samplers[None] = FieldSampler(self.program, nodes, self.values)
            else:
                from echelon.regressor.loops.curves import CurveSampler  # robots without loops do without it

                self._samplers[None] = CurveSampler(self.program, nodes, self.loops)
        if order not in self._samplers:
            self._samplers[order] = self._samplers[None].with_order(order)
        return self._samplers[order]

    def stacked(self, values: Residues) -> Residues:
        """Sampled entries as matrices, one for each geometry."""
        # shapes: values (entries, geometries, states); returns (geometries, states · rows, columns)
        _, geometries, states = values.shape
        matrix = np.zeros((geometries, states, *self.shape), dtype=np.int64)
        for (row, column), value in zip(self.entries, values, strict=True):
            matrix[:, :, row, column] = value
        return matrix.reshape(geometries, states * self.shape[0], self.shape[1])

    def operations(self) -> dict[str, int]:
        """Operations needed to evaluate all entries, by kind."""
        return self.program.count(self.entries.values())

    def __repr__(self) -> str:
        return f"LinearForms({self.shape[0]} × {self.shape[1]}, {len(self.entries)} entries, {self.program})"
