"""Normal forms modulo an ideal at one sample, computed entry by entry and recorded, to be repeated on many samples."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from echelon.arrays import Flags
from echelon.exact.field import PrimeField, Residues
from echelon.exact.quotient_ring import Exponents, Monomials, Product
from echelon.program.schedule import Array, ModularArithmetic, Schedule
from echelon.program.tape import Op, Program

Row = dict[int, int]
"""Monomials and the numbers, of a recorder, by which they are multiplied."""


class Recorder:
    """Computes with the residues of one sample, and records how on a program; numbers are its nodes.

    What is zero at the recorded sample is left out of all further computation.  Other samples *follow* if the same
    numbers vanish there and none that is inverted does.
    """

    def __init__(self, field: PrimeField, inputs: Iterable[int]) -> None:
        self.program = record = Program()
        self.zero, self.one, self.minus_one = (record.constant(x).node for x in (0, 1, -1))
        self._field, self._zeros, self._required = field, list[int](), list[int]()
        self._values = {self.zero: 0, self.one: 1, self.minus_one: -1}
        self.inputs = [self._number(record.input(f"x{k}").node, value) for k, value in enumerate(inputs)]

    def sum(self, terms: Iterable[tuple[int, int]]) -> int:
        """Sum of products of two numbers; the number zero if it vanishes."""
        record, node, value = self.program, self.zero, 0
        for a, b in terms:
            node = record.add(node, record.multiply(a, b))
            value += self._values[a] * self._values[b]
        return self._number(node, value)

    def minus_inverse(self, number: int) -> int:
        """−1/x."""
        return self._number(self.program.divide(self.minus_one, number), -self._field.invert(self._values[number]))

    def require(self, number: int) -> None:
        """Let only those samples follow at which this number can be computed."""
        self._required.append(number)

    def recording(self, outputs: Sequence[int]) -> Recording:
        """What leads to some numbers."""
        return Recording(self.program, outputs, self._zeros, self._required)

    def _number(self, node: int, value: int) -> int:
        self._values[node] = value % self._field.p
        if self._values[node] or node == self.zero:
            return node
        self._zeros.append(node)
        return self.zero


class Recording:
    """A recorded computation."""

    def __init__(self, program: Program, outputs: Sequence[int], zeros: Sequence[int], required: Sequence[int]) -> None:
        self._schedule = Schedule(program, [*outputs, *zeros, *required])
        self._place = {node: k for k, node in enumerate(program.inputs)}
        self._outputs, self._zeros = len(outputs), slice(len(outputs), len(outputs) + len(zeros))
        self.size = self._schedule.size

    def run(self, inputs: Residues, field: PrimeField) -> tuple[Flags, Residues]:
        """Which samples follow, and the outputs, from inputs of shape (inputs, samples)."""
        arithmetic = _Noting(field, inputs.shape[1])
        leaves = {node: inputs[self._place[node]] for node in self._schedule.leaves}
        found = self._schedule.run(arithmetic, leaves, inputs.shape[1])
        return arithmetic.regular & ~found[self._zeros].any(axis=0), found[: self._outputs]


class _Noting(ModularArithmetic):
    """GF(p); notes the samples at which all that is inverted differs from zero."""

    def __init__(self, field: PrimeField, samples: int) -> None:
        super().__init__(field)
        self.regular = np.ones(samples, dtype=bool)

    def binary(self, op: int, a: Array, b: Array) -> Array:
        """Elementwise operation modulo p."""
        if op == Op.DIV:
            zero = b == 0
            self.regular &= ~zero.any(axis=0)
            b[zero] = 1
        return super().binary(op, a, b)


class RecordedForms:
    """Normal forms of monomials, without entries that vanish.

    It repeats the steps of :class:`~echelon.exact.quotient_ring.NormalForms`.
    """

    def __init__(self, monomials: Monomials, recorder: Recorder) -> None:
        self._monomials, self._recorder = monomials, recorder
        self._rows: dict[int, Row] = {0: {0: recorder.one}}

    def grow(self, free: Iterable[int]) -> None:
        """Add free monomials."""
        self._rows.update({monomial: {monomial: self._recorder.one} for monomial in free})

    def define(self, product: Product) -> None:
        """Add products."""
        for factor in product.factors:
            self._rows[self._times(product.variable, factor)] = self._combined(self._product(product.variable, factor))

    def defects(self, product: Product) -> list[Row]:
        """Normal forms computed from the factors less those known."""
        variable = product.variable
        return [
            self._combined(
                [
                    *self._product(variable, factor),
                    (self._recorder.minus_one, self._rows[self._times(variable, factor)]),
                ]
            )
            for factor in product.factors
        ]

    def reduce(self, polynomial: Mapping[Exponents, int]) -> Row:
        """Normal form of a polynomial."""
        monomials = self._monomials.number
        return self._combined((c, self._rows[monomials[e]]) for e, c in polynomial.items() if c != self._recorder.zero)

    def eliminate(self, polynomials: list[Row], pivots: Sequence[int]) -> None:
        """Solve polynomials of the ideal for as many monomials, which cease to be free."""
        solved = self._solved(polynomials, pivots)
        for monomial, row in self._rows.items():
            self._rows[monomial] = self._substituted(row, solved)

    def multiplications(self, free: Sequence[int]) -> list[int]:
        """Entries of an array of shape (variables, free, free)."""
        rows = [self._rows[self._times(i, m)] for i in range(self._monomials.variables) for m in free]
        return [row.get(m, self._recorder.zero) for row in rows for m in free]

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
        return {monomial: number for monomial, number in sums.items() if number != self._recorder.zero}

    def _substituted(self, row: Row, solved: dict[int, Row]) -> Row:
        """A row with some monomials replaced by what they are equal to."""
        if solved.keys().isdisjoint(row):
            return row
        rest = {m: number for m, number in row.items() if m not in solved}
        return self._combined(
            [(self._recorder.one, rest), *((number, solved[m]) for m, number in row.items() if m in solved)]
        )

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
