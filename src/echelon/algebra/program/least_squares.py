"""Linear systems solved on a program: the elimination is recorded as operations like any others.

The columns of A are made orthogonal one after another, A = V R with R unit upper triangular (modified Gram–Schmidt
without square roots).  A program cannot choose pivots by size when it runs, and need not here: wherever A has full
column rank this is as stable as it gets, redundant rows included, whichever rows depend on one another there.  Columns
without a common row are orthogonal by structure and cost nothing, so those that meet fewest others come first, which
keeps blocks apart: the legs of a platform before the platform.
"""

from __future__ import annotations

from collections.abc import Mapping

from echelon.algebra.exact.polynomial import Number
from echelon.algebra.program.tape import Program, Scalar

Column = Mapping[int, Scalar]  # entries by row; zero where absent


class LeastSquares:
    """A matrix of full column rank, ready to solve A x ≈ b and Aᵀ y = c.

    >>> program = Program()
    >>> x = program.input("x")
    >>> found = LeastSquares(program, {"a": {0: x, 1: x}, "b": {1: program.one}}).solve({0: x * x})
    >>> sorted(found)
    ['a', 'b']
    """

    def __init__(
        self,
        program: Program,
        columns: Mapping[str, Column],
        weights: Mapping[int, Number] | None = None,
    ) -> None:
        self._program, self._weights = program, weights or {}
        self._orthogonal: dict[str, Column] = {}
        self._inverse: dict[str, Scalar] = {}
        self._upper: dict[
            str, dict[str, Scalar]
        ] = {}  # by row of R, right of the diagonal
        self.pivots: dict[str, Scalar] = {}
        left = dict(columns)
        while left:
            name = min(
                left,
                key=lambda n: (
                    len(left[n])
                    * sum(1 for other in left.values() if left[n].keys() & other)
                ),
            )
            column = left.pop(name)
            square = self._dot(column, column)
            self.pivots[name] = square / self._dot(columns[name], columns[name])
            self._orthogonal[name], self._inverse[name] = column, 1 / square
            self._upper[name] = {}
            for other in left:
                share, left[other] = self._reduced(name, left[other])
                if not share.is_zero:
                    self._upper[name][other] = share

    def solve(self, right: Column) -> dict[str, Scalar]:
        """x that makes b − A x smallest; what is left of b where rows are redundant is ignored."""
        shares: dict[str, Scalar] = {}
        for name in self._orthogonal:
            shares[name], right = self._reduced(name, right)
        found: dict[str, Scalar] = {}
        for name in reversed(self._orthogonal):
            known = (share * found[other] for other, share in self._upper[name].items())
            found[name] = shares[name] - sum(known, self._program.zero)
        return found

    def solve_transposed(self, right: Mapping[str, Scalar]) -> Column:
        """The smallest y with Aᵀ y = c, by row; small in the weights' inverse where rows are redundant."""
        left, found = dict(right), dict[int, Scalar]()
        for name, column in self._orthogonal.items():
            for other, share in self._upper[name].items():
                left[other] = left[other] - share * left[name]
            size = left[name] * self._inverse[name]
            for row, entry in column.items():
                term = size * entry * self._weights.get(row, 1)
                found[row] = found[row] + term if row in found else term
        return found

    def share(self, row: Column) -> Scalar:
        """Share of a linear form in y that is constant on {y : Aᵀ y = c}: of its square, the part in the span of A."""
        form = {k: entry / self._weights.get(k, 1) for k, entry in row.items()}
        parts = (self._dot(column, form) for column in self._orthogonal.values())
        inside = sum(
            (p * p * i for p, i in zip(parts, self._inverse.values(), strict=True)),
            self._program.zero,
        )
        return inside / self._dot(form, form) if form else self._program.one

    def inverse_square(self, units: Mapping[str, Number]) -> Scalar:
        """Σ 1/σ² over the singular values of A, whose columns are multiplied by units (1 where absent)."""
        total, before = self._program.zero, list[str]()
        for name, inverse in self._inverse.items():
            column = {name: self._program.one}  # of the inverse of R
            for other in reversed(before):
                terms = [
                    share * column[n]
                    for n, share in self._upper[other].items()
                    if n in column
                ]
                if terms:
                    column[other] = -sum(terms, self._program.zero)
            sizes = ((value / units.get(n, 1)) for n, value in column.items())
            total = total + inverse * sum(
                (size * size for size in sizes), self._program.zero
            )
            before.append(name)
        return total

    def _reduced(self, name: str, column: Column) -> tuple[Scalar, Column]:
        """A column's share of an orthogonal one, and what is left of it."""
        orthogonal = self._orthogonal[name]
        share = self._dot(orthogonal, column) * self._inverse[name]
        if share.is_zero:
            return share, column
        left = dict(column)
        for row, entry in orthogonal.items():
            left[row] = left.get(row, self._program.zero) - share * entry
        return share, left

    def _dot(self, a: Column, b: Column) -> Scalar:
        sums: dict[Number, Scalar] = {}
        for row in (row for row in a if row in b):
            weight, term = self._weights.get(row, 1), a[row] * b[row]
            sums[weight] = sums[weight] + term if weight in sums else term
        return sum(
            (total * weight for weight, total in sums.items()), self._program.zero
        )
