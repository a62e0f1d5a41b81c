"""Normal forms modulo an ideal at one sample, computed entry by entry and recorded, to be repeated on many samples."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from echelon.exact.normal_forms import Exponents, Monomials, Product
from echelon.exact.straight_line import MINUS_ONE, ONE, ZERO, Recorder

Row = dict[int, int]
"""Monomials and the numbers, of a recorder, by which they are multiplied."""


class RecordedForms:
    """Normal forms of monomials, without entries that vanish.

    It repeats the steps of :class:`~echelon.exact.normal_forms.NormalForms`.
    """

    def __init__(self, monomials: Monomials, recorder: Recorder) -> None:
        self._monomials, self._recorder = monomials, recorder
        self._rows: dict[int, Row] = {0: {0: ONE}}

    def grow(self, free: Iterable[int]) -> None:
        """Add free monomials."""
        self._rows.update({monomial: {monomial: ONE} for monomial in free})

    def define(self, product: Product) -> None:
        """Add products."""
        for factor in product.factors:
            self._rows[self._times(product.variable, factor)] = self._combined(self._product(product.variable, factor))

    def defects(self, product: Product) -> list[Row]:
        """Normal forms computed from the factors less those known."""
        variable = product.variable
        return [
            self._combined([*self._product(variable, factor), (MINUS_ONE, self._rows[self._times(variable, factor)])])
            for factor in product.factors
        ]

    def reduce(self, polynomial: Mapping[Exponents, int]) -> Row:
        """Normal form of a polynomial."""
        monomials = self._monomials.number
        return self._combined((c, self._rows[monomials[e]]) for e, c in polynomial.items() if c != ZERO)

    def eliminate(self, polynomials: list[Row], pivots: Sequence[int]) -> None:
        """Solve polynomials of the ideal for as many monomials, which cease to be free."""
        solved = self._solved(polynomials, pivots)
        for monomial, row in self._rows.items():
            self._rows[monomial] = self._substituted(row, solved)

    def multiplications(self, free: Sequence[int]) -> list[int]:
        """Entries of an array of shape (variables, free, free)."""
        rows = [self._rows[self._times(i, m)] for i in range(self._monomials.variables) for m in free]
        return [row.get(m, ZERO) for row in rows for m in free]

    def _times(self, variable: int, monomial: int) -> int:
        return int(self._monomials.times[variable, monomial])

    def _product(self, variable: int, factor: int) -> list[tuple[int, Row]]:
        return [(number, self._rows[self._times(variable, m)]) for m, number in self._rows[factor].items()]

    def _combined(self, parts: Iterable[tuple[int, Row]]) -> Row:
        """Sum of multiples of rows."""
        terms: dict[int, list[tuple[int, int]]] = {}
        for factor, row in parts:
            for monomial, number in row.items():
                terms.setdefault(monomial, []).append((factor, number))
        sums = {monomial: self._recorder.sum(products) for monomial, products in terms.items()}
        return {monomial: number for monomial, number in sums.items() if number != ZERO}

    def _substituted(self, row: Row, solved: dict[int, Row]) -> Row:
        """A row with some monomials replaced by what they are equal to."""
        if solved.keys().isdisjoint(row):
            return row
        rest = {m: number for m, number in row.items() if m not in solved}
        return self._combined([(ONE, rest), *((number, solved[m]) for m, number in row.items() if m in solved)])

    def _solved(self, polynomials: list[Row], pivots: Sequence[int]) -> dict[int, Row]:
        """What the pivots are equal to; short polynomials, and pivots that occur rarely, come first."""
        left, waiting, solved = list(polynomials), set(pivots), dict[int, Row]()
        inverted = {}
        while left:
            shortest = min(left, key=len)
            left.remove(shortest)
            pivot = min(waiting & shortest.keys(), key=lambda m: sum(m in row for row in left))
            waiting.remove(pivot)
            inverted[pivot] = self._recorder.minus_inverse(shortest[pivot])
            rest = {m: number for m, number in shortest.items() if m != pivot}
            solved[pivot] = self._combined([(inverted[pivot], rest)])
            left = [self._substituted(row, {pivot: solved[pivot]}) for row in left]
        for pivot in reversed(solved):
            solved[pivot] = self._substituted(solved[pivot], solved)
            if not solved[pivot]:
                self._recorder.require(inverted[pivot])
        return solved
