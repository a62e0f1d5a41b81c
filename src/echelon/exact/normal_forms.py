"""Normal forms modulo the ideal of some polynomials, for many samples at once.

Modulo the polynomials known so far every monomial is a combination of a few *free* ones.  The table of these
combinations grows by degree (a multiple of a monomial that is not free follows from lower degrees) and shrinks the set
of free monomials by elimination (a polynomial of the ideal expresses its leading monomial by smaller ones).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np

from echelon.arrays import Flags, Integers
from echelon.errors import DegenerateSampleError
from echelon.exact.field import PrimeField, Residues

Exponents = tuple[int, ...]

_PRIME, _EXACT = 31, 53  # bits of residues, and of whole numbers that are exact in doubles
_SMALL = 2000  # products in a matrix multiplication, below which integers are faster than products of doubles


def multiply(left: Residues, right: Residues, field: PrimeField) -> Residues:
    """Product of (stacks of) matrices over GF(p), p below 2^31, with at most 2048 terms in a sum."""
    if left.shape[-2] * left.shape[-1] * right.shape[-1] < _SMALL:
        return np.asarray((left[..., None] * right[..., None, :, :] % field.p).sum(axis=-2) % field.p)
    digits = -(-_PRIME // (_EXACT - _PRIME - (left.shape[-1] - 1).bit_length()))  # so that sums are exact
    bits, factor, total = -(-_PRIME // digits), right.astype(np.float64), np.zeros(1, dtype=np.int64)
    for shift in range((digits - 1) * bits, -1, -bits):
        digit = (left >> shift & (1 << bits) - 1).astype(np.float64)
        total = ((total << bits) + (digit @ factor).astype(np.int64)) % field.p
    return total


@dataclass(frozen=True)
class Equation:
    """A polynomial by the exponents of its terms, and coefficients of shape (samples, terms)."""

    exponents: list[Exponents]
    coefficients: Residues

    @staticmethod
    def of(terms: Mapping[Exponents, Residues], field: PrimeField) -> Equation:
        """Without the terms that vanish at all samples."""
        exponents = list(terms)
        coefficients = np.stack([np.asarray(c, dtype=np.int64) % field.p for c in terms.values()], axis=1)
        present = np.flatnonzero(coefficients.any(axis=0))
        return Equation([exponents[term] for term in present], coefficients[:, present])

    def at(self, samples: Integers) -> Equation:
        """The equation of some samples."""
        return Equation(self.exponents, self.coefficients[samples])

    @property
    def degree(self) -> int:
        """Largest total degree of a term."""
        return max((sum(exponents) for exponents in self.exponents), default=0)

    def value(self, points: Residues, field: PrimeField) -> Residues:
        """Values at one point per sample, of shape (samples, variables)."""
        total = np.zeros(len(points), dtype=np.int64)
        for exponents, term in zip(self.exponents, self.coefficients.T, strict=True):
            for variable in [i for i, exponent in enumerate(exponents) for _ in range(exponent)]:
                term = term * points[:, variable] % field.p
            total = (total + term) % field.p
        return total


class Monomials:
    """Monomials, numbered in ascending graded order as far as they are needed."""

    def __init__(self, variables: int) -> None:
        self.variables = variables
        self.exponents: list[Exponents] = [(0,) * variables]
        self.number: dict[Exponents, int] = {self.exponents[0]: 0}
        self.start = [0, 1]  # number of monomials below each degree
        # number of the product of a variable and a monomial below the highest degree, (variables, monomials)
        self.times: Integers = np.zeros((variables, 0), dtype=np.int64)

    def up_to(self, degree: int) -> None:
        """Make the monomials up to a degree known."""
        while len(self.start) < degree + 2:
            self._raise_degree()

    def _raise_degree(self) -> None:
        variables, low = self.variables, len(self.exponents)
        for chosen in reversed(list(combinations_with_replacement(range(variables), len(self.start) - 1))):
            monomial = tuple(chosen.count(i) for i in range(variables))
            self.number[monomial] = len(self.exponents)
            self.exponents.append(monomial)
        self.start.append(len(self.exponents))
        self.times = np.array(
            [[self.number[_raised(m, i)] for m in self.exponents[:low]] for i in range(variables)], dtype=np.int64
        ).reshape(variables, low)


def _raised(monomial: Exponents, variable: int) -> Exponents:
    return (*monomial[:variable], monomial[variable] + 1, *monomial[variable + 1 :])


@dataclass(frozen=True)
class Product:
    """Variable times known monomials."""

    variable: int
    factors: list[int]


class NormalForms:
    """Normal forms of all monomials up to a degree."""

    def __init__(self, monomials: Monomials, samples: int, field: PrimeField) -> None:
        self.monomials, self.field = monomials, field
        self.free: Integers = np.zeros(1, dtype=np.int64)  # the monomials that are their own normal form, ascending
        # coefficients of the normal form of each monomial, which has no larger monomial, (samples, monomials, free)
        self.table: Residues = np.ones((samples, 1, 1), dtype=np.int64)

    def grow(self, count: int, free: Sequence[int]) -> None:
        """Make room for ``count`` monomials, of which the new ones in ``free`` are free and the others undefined."""
        samples, monomials, columns = self.table.shape
        table = np.zeros((samples, count, columns + len(free)), dtype=np.int64)
        table[:, :monomials, :columns] = self.table
        table[:, list(free), range(columns, columns + len(free))] = 1
        self.table, self.free = table, np.concatenate([self.free, np.array(free, dtype=np.int64)])

    def define(self, product: Product) -> None:
        """Set normal forms of products that have none yet."""
        self.table[:, self.monomials.times[product.variable, product.factors]] = self._product(product)

    def defects(self, product: Product) -> Residues:
        """Polynomials of the ideal: normal forms of products in the table less those computed from the factors."""
        known = self.table[:, self.monomials.times[product.variable, product.factors]]
        return (known - self._product(product)) % self.field.p

    def _product(self, product: Product) -> Residues:
        coefficients = self.table[:, product.factors]
        columns = np.flatnonzero(coefficients.any(axis=(0, 1)))
        rows = self.table[:, self.monomials.times[product.variable, self.free[columns]]]
        return multiply(coefficients[:, :, columns], rows, self.field)

    def reduced(self, equation: Equation) -> Residues:
        """Normal form of a polynomial, (samples, 1, free)."""
        terms = [self.monomials.number[exponents] for exponents in equation.exponents]
        return multiply(equation.coefficients[:, None], self.table[:, terms], self.field)

    def multiplications(self) -> Residues:
        """Matrices of the multiplications by the variables, (samples, variables, free, free)."""
        return self.table[:, self.monomials.times[:, self.free]]

    def eliminate(self, polynomials: Residues, pivots: Sequence[int]) -> None:
        """Solve polynomials of the ideal, (samples, pivots, free), for as many monomials, which cease to be free."""
        columns = np.searchsorted(self.free, pivots)
        rest = np.delete(np.arange(len(self.free)), columns)
        solved = _solved(polynomials[:, :, np.concatenate([columns, rest])], len(columns), self.field)
        if solved[:, np.array(pivots)[:, None] < self.free[rest]].any():
            raise DegenerateSampleError("the pivots of a sample are not its leading monomials")
        factors = self.table[:, :, columns]
        touched = np.flatnonzero(factors.any(axis=(0, 2)))
        change = multiply(factors[:, touched], solved, self.field)
        self.table = self.table[:, :, rest]
        self.table[:, touched] = (self.table[:, touched] - change) % self.field.p
        self.free = self.free[rest]


def _solved(polynomials: Residues, pivots: int, field: PrimeField) -> Residues:
    """What the pivots, which are the first columns, are equal to by polynomials, both (samples, rows, columns).

    Short polynomials, and pivots that occur rarely, come first, so that few entries fill.
    """
    table = np.ascontiguousarray(polynomials.transpose(1, 2, 0))
    present: Flags = np.asarray(table.any(axis=2))
    left, solved = list(range(pivots)), np.zeros(pivots, dtype=np.intp)
    for _ in range(pivots):
        row = left.pop(int(present[left].sum(axis=1).argmin()))
        possible = np.flatnonzero(table[row, :pivots].all(axis=1))
        if not possible.size:
            raise DegenerateSampleError("a sample has dependent pivot columns")
        pivot = possible[present[:, possible].sum(axis=0).argmin()]
        solved[pivot] = row
        columns, others = np.flatnonzero(present[row]), np.flatnonzero(present[:, pivot])
        scaled = table[row, columns] * field.invert_array(table[row, pivot]) % field.p
        if len(others) > 1:
            place = np.ix_(others, columns)
            table[place] = (table[place] - table[others, pivot][:, None] * scaled) % field.p
            present[place] = True
            present[others, pivot] = others == row
        table[row, columns] = scaled
    return table[solved, pivots:].transpose(2, 0, 1)
