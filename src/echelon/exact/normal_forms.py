"""Normal forms modulo the ideal of some polynomials.

Modulo the polynomials known so far every monomial is a combination of a few *free* ones.  The table of these
combinations grows by degree (a multiple of a monomial that is not free follows from lower degrees) and shrinks the set
of free monomials by elimination (a polynomial of the ideal expresses its leading monomial by smaller ones).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np

from echelon.arrays import Integers
from echelon.exact.field import PrimeField, Residues
from echelon.exact.series import matrix_product

Exponents = tuple[int, ...]


def multiply(left: Residues, right: Residues, field: PrimeField) -> Residues:
    """Product of matrices over GF(p)."""
    return matrix_product(left[..., None], right[..., None], field)[..., 0]


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
    """The monomials up to a degree, numbered in ascending graded order."""

    def __init__(self, variables: int) -> None:
        self.variables = variables
        self.exponents: list[Exponents] = [(0,) * variables]
        self.number: dict[Exponents, int] = {self.exponents[0]: 0}
        self.start = [0, 1]
        self.times: Integers = np.zeros((variables, 0), dtype=np.int64)

    def raise_degree(self) -> None:
        """Append the monomials of the next degree."""
        variables, low = self.variables, len(self.exponents)
        for chosen in reversed(list(combinations_with_replacement(range(variables), len(self.start) - 1))):
            monomial = tuple(chosen.count(i) for i in range(variables))
            self.number[monomial] = len(self.exponents)
            self.exponents.append(monomial)
        self.start.append(len(self.exponents))
        self.times = np.array(
            [[self.number[raised(m, i)] for m in self.exponents[:low]] for i in range(variables)], dtype=np.int64
        ).reshape(variables, low)


def raised(monomial: Exponents, variable: int, by: int = 1) -> Exponents:
    """A monomial times a power of a variable."""
    return (*monomial[:variable], monomial[variable] + by, *monomial[variable + 1 :])


@dataclass(frozen=True)
class Product:
    """Variable times known monomials."""

    variable: int
    factors: list[int]


class NormalForms:
    """Normal forms of all monomials up to a degree, at one sample."""

    def __init__(self, monomials: Monomials, field: PrimeField) -> None:
        self.monomials, self.field = monomials, field
        self.free: Integers = np.zeros(1, dtype=np.int64)
        self.table: Residues = np.ones((1, 1), dtype=np.int64)

    def grow(self, count: int, free: Sequence[int]) -> None:
        """Make room for ``count`` monomials, of which the new ones in ``free`` are free and the others undefined."""
        monomials, columns = self.table.shape
        table = np.zeros((count, columns + len(free)), dtype=np.int64)
        table[:monomials, :columns] = self.table
        table[list(free), range(columns, columns + len(free))] = 1
        self.table, self.free = table, np.concatenate([self.free, np.array(free, dtype=np.int64)])

    def define(self, product: Product) -> None:
        """Set the normal form of a product that has none yet."""
        self.table[self.monomials.times[product.variable, product.factors]] = self._product(product)

    def defect(self, product: Product) -> Residues:
        """Elements of the ideal: the normal forms of products in the table less those computed from the factors."""
        known = self.table[self.monomials.times[product.variable, product.factors]]
        return (known - self._product(product)) % self.field.p

    def _product(self, product: Product) -> Residues:
        coefficients = self.table[product.factors]
        columns = np.flatnonzero(coefficients.any(axis=0))
        rows = self.table[self.monomials.times[product.variable, self.free[columns]]]
        return multiply(coefficients[:, columns], rows, self.field)

    def reduce(self, equation: Equation) -> Residues:
        """Normal form of a polynomial of one sample, of shape (1, free)."""
        terms = [self.monomials.number[exponents] for exponents in equation.exponents]
        return multiply(equation.coefficients, self.table[terms], self.field)

    def multiplications(self) -> Residues:
        """Matrices of the multiplications by the variables, of shape (variables, free, free)."""
        return self.table[self.monomials.times[:, self.free]]

    def eliminate(self, pivots: Sequence[int], replacement: Residues) -> None:
        """Replace some free monomials by combinations of the others."""
        columns = np.searchsorted(self.free, pivots)
        rest = np.delete(np.arange(len(self.free)), columns)
        touched = self.table[:, columns].any(axis=1)
        change = multiply(self.table[touched][:, columns], replacement, self.field)
        self.table = self.table[:, rest]
        self.table[touched] = (self.table[touched] + change) % self.field.p
        self.free = self.free[rest]
