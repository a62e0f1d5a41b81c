"""Normal forms modulo the ideal of some polynomials, for many samples at once.

Modulo the polynomials known so far every monomial is a combination of a few *free* ones.  The table of these
combinations grows by degree (a multiple of a monomial that is not free follows from lower degrees) and shrinks the set
of free monomials by elimination (a polynomial of the ideal expresses its leading monomial by smaller ones).

The samples share one structure: which monomials are free, and which coefficients vanish.  A sample that deviates from
it is marked as irregular, and its entries mean nothing any more.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np
import numpy.typing as npt

from echelon.errors import DegenerateSampleError
from echelon.exact.elimination import rank, solve_batched
from echelon.exact.field import PrimeField, Residues

Exponents = tuple[int, ...]
Indices = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

_DIGIT = 11  # bits: a digit times a residue, summed over 2^11 terms, is exact in a double
_SMALL = 2000  # products in a matrix multiplication, below which integers are faster than three products of doubles


def multiply(left: Residues, right: Residues, field: PrimeField) -> Residues:
    """Product of (stacks of) matrices over GF(p), p below 2^31, with at most 2048 terms in a sum."""
    if left.size * right.shape[-1] < _SMALL:
        return np.asarray((left[..., None] * right[..., None, :, :] % field.p).sum(axis=-2) % field.p)
    factor = right.astype(np.float64)
    total = np.zeros(1, dtype=np.int64)
    for shift in (2 * _DIGIT, _DIGIT, 0):
        digit = (left >> shift & (1 << _DIGIT) - 1).astype(np.float64)
        total = ((total << _DIGIT) + (digit @ factor).astype(np.int64)) % field.p
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

    def at(self, samples: Indices) -> Equation:
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
    """The monomials up to a degree, numbered in ascending graded order.

    Attributes
    ----------
    exponents : list of tuple of int
    number : dict of tuple of int to int
        The inverse of ``exponents``.
    start : list of int
        Number of monomials below each degree.
    times : array of shape (variables, monomials below the highest degree)
        Number of the product of a variable and a monomial.
    """

    def __init__(self, variables: int) -> None:
        self.variables = variables
        self.exponents: list[Exponents] = [(0,) * variables]
        self.number: dict[Exponents, int] = {self.exponents[0]: 0}
        self.start = [0, 1]
        self.times: Indices = np.zeros((variables, 0), dtype=np.int64)

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
    """Variable times known monomials whose normal forms have only the monomials of ``support``."""

    variable: int
    factors: list[int]
    support: list[int]

    def uses(self, times: Indices) -> list[int]:
        """The monomials whose normal forms make up that of the product."""
        return [*self.factors, *times[self.variable, self.support].tolist()]


class NormalForms:
    """Normal forms of all monomials up to a degree.

    Attributes
    ----------
    monomials : Monomials
    field : PrimeField
    free : array of int
        The monomials that are their own normal form, ascending.
    table : array of shape (samples, monomials, free)
        Coefficients of the normal form of each monomial, which contains no larger monomial.
    regular : array of bool, of shape (samples,)
        Whether the sample follows the common structure so far.
    """

    def __init__(self, monomials: Monomials, field: PrimeField, samples: int) -> None:
        self.monomials, self.field = monomials, field
        self.free: Indices = np.zeros(1, dtype=np.int64)
        self.table: Residues = np.ones((samples, 1, 1), dtype=np.int64)
        self.regular = np.ones(samples, dtype=bool)

    def grow(self, count: int, free: Sequence[int]) -> None:
        """Make room for ``count`` monomials, of which the new ones in ``free`` are free and the others undefined."""
        samples, monomials, columns = self.table.shape
        table = np.zeros((samples, count, columns + len(free)), dtype=np.int64)
        table[:, :monomials, :columns] = self.table
        table[:, list(free), range(columns, columns + len(free))] = 1
        self.table, self.free = table, np.concatenate([self.free, np.array(free, dtype=np.int64)])

    def support(self, monomials: Sequence[int]) -> list[int]:
        """The monomials in the normal forms of these monomials."""
        return [int(m) for m in self.free[self.table[:, monomials].any(axis=(0, 1))]]

    def product(self, product: Product) -> Residues:
        """Normal forms of a product, of shape (samples, factors, free)."""
        columns = np.searchsorted(self.free, product.support)
        coefficients = self.table[:, product.factors]
        outside: Mask = np.any(coefficients, axis=1)
        outside[:, columns] = False
        self.regular &= ~outside.any(axis=1)
        rows = self.table[:, self.monomials.times[product.variable, product.support]]
        return multiply(coefficients[:, :, columns], rows, self.field)

    def define(self, product: Product) -> None:
        """Set the normal form of a product that has none yet."""
        self.table[:, self.monomials.times[product.variable, product.factors]] = self.product(product)

    def defect(self, product: Product) -> Residues:
        """Elements of the ideal: the normal forms of products in the table less those computed from the factors."""
        known = self.table[:, self.monomials.times[product.variable, product.factors]]
        return (known - self.product(product)) % self.field.p

    def reduce(self, equation: Equation) -> Residues:
        """Normal form of a polynomial, of shape (samples, 1, free)."""
        terms = [self.monomials.number[exponents] for exponents in equation.exponents]
        return multiply(equation.coefficients[:, None], self.table[:, terms], self.field)

    def multiplications(self) -> Residues:
        """Matrices of the multiplications by the variables, of shape (variables, samples, free, free)."""
        return self.table[:, self.monomials.times[:, self.free]].swapaxes(0, 1)

    def eliminate(self, rows: Residues, pivots: Sequence[int]) -> None:
        """Solve polynomials of the ideal for as many leading monomials, which cease to be free."""
        columns = np.searchsorted(self.free, pivots)
        rest = np.delete(np.arange(len(self.free)), columns)
        replacement = -self._solve(rows[:, :, columns], rows[:, :, rest]) % self.field.p
        self.regular &= ~(replacement * (rest > columns[:, None])).any(axis=(1, 2))
        touched = self.table[:, :, columns].any(axis=(0, 2))
        change = multiply(self.table[:, touched][:, :, columns], replacement, self.field)
        self.table = self.table[:, :, rest]
        self.table[:, touched] = (self.table[:, touched] + change) % self.field.p
        self.free = self.free[rest]

    def _solve(self, left: Residues, right: Residues) -> Residues:
        """Solution of regular systems; samples with singular ones are marked."""
        try:
            return solve_batched(left, right, self.field)
        except DegenerateSampleError:
            singular = np.array([rank(matrix, self.field) < left.shape[1] for matrix in left])
            self.regular &= ~singular
            return solve_batched(
                np.where(singular[:, None, None], np.eye(left.shape[1], dtype=np.int64), left), right, self.field
            )
