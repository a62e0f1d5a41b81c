"""Polynomials over GF(p), and the points of their ideals.

Where the quotient ring has finite dimension, the points are read from traces of the multiplications by the variables,
for many samples at once (Rouillier's rational univariate representation), which works for multiple points, too.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations_with_replacement

import flint
import numpy as np

from echelon.arrays import Flags, Integers
from echelon.exact.field import PrimeField, Residues

Exponents = tuple[int, ...]


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


def raised(monomial: Exponents, variable: int) -> Exponents:
    """A monomial times a variable."""
    return (*monomial[:variable], monomial[variable] + 1, *monomial[variable + 1 :])


# -- points; matrices have the samples along their last axis ---------------------------------------------------------


def commute(matrices: Residues, field: PrimeField) -> Flags:
    """At which samples matrices of shape (variables, size, size, samples) commute pairwise."""
    # it is enough, but for a chance of a few in p, that two random combinations of them do on a random vector
    rng = np.random.default_rng(1)
    first, second = (_combination(matrices, field, rng) for _ in range(2))
    vector = field.draw(rng, (first.shape[1], 1, 1))
    difference = _product(first, _product(second, vector, field), field)
    difference -= _product(second, _product(first, vector, field), field)
    return np.asarray(~difference.any(axis=(0, 1)))


def quotient_points(matrices: Residues, field: PrimeField) -> tuple[Integers, Residues]:
    """Points with coordinates in GF(p)."""
    # let m be the characteristic polynomial of a combination M of the multiplications that tells the points apart, and
    # q what is left of m without one of its roots.  Then q(M) acts on the subspace of that root only, and if the point
    # has the coordinate x there, then the multiplication X has the trace tr(X q(M)) = x tr(q(M))
    # shapes: matrices (variables, size, size, samples)
    variables, size, _, samples = matrices.shape
    if not size or not samples:
        return np.zeros(0, dtype=np.int64), np.zeros((0, variables), dtype=np.int64)
    combination = _combination(matrices, field, np.random.default_rng(0))
    powers = [np.broadcast_to(np.eye(size, dtype=np.int64)[:, :, None], combination.shape)]
    for _ in range(size):
        powers.append(_product(powers[-1], combination, field))
    traces = np.stack([np.trace(power) % field.p for power in powers])
    polynomials = _characteristic(traces, field)
    owners, roots = _roots(polynomials, field)
    cofactors = _cofactors(polynomials[:, owners], roots, field)
    sums = np.zeros((variables, len(owners)), dtype=np.int64)
    below = (cofactors * traces[:-1, owners] % field.p).sum(axis=0) % field.p
    for power, coefficient in zip(powers, cofactors, strict=False):
        moments = (matrices[..., owners] * power.swapaxes(0, 1)[..., owners] % field.p).sum(axis=(1, 2)) % field.p
        sums = (sums + coefficient * moments) % field.p
    return owners, (sums * field.invert_array(below) % field.p).T


def _product(left: Residues, right: Residues, field: PrimeField) -> Residues:
    """Products of matrices."""
    total = left[:, :1] * right[:1] % field.p
    for k in range(1, left.shape[1]):
        total += left[:, k : k + 1] * right[k : k + 1] % field.p
    return np.asarray(total % field.p)


def _combination(matrices: Residues, field: PrimeField, rng: np.random.Generator) -> Residues:
    """Random linear combination along the first axis."""
    weights = field.draw(rng, (len(matrices), 1, 1, 1))
    return np.asarray((weights * matrices % field.p).sum(axis=0) % field.p)


def _characteristic(traces: Residues, field: PrimeField) -> Residues:
    """Coefficients, the constant one first, of characteristic polynomials from traces of powers (Newton)."""
    size = len(traces) - 1
    result = np.zeros_like(traces)
    result[size] = 1
    for k in range(1, size + 1):
        total = (result[size - k + 1 :] * traces[1 : k + 1] % field.p).sum(axis=0) % field.p
        result[size - k] = total * (-field.invert(k) % field.p) % field.p
    return result


def _roots(polynomials: Residues, field: PrimeField) -> tuple[Integers, Residues]:
    """Distinct roots in GF(p) of monic polynomials of shape (degree + 1, samples), and whose they are."""
    owners, roots, x = [], [], flint.nmod_poly([0, 1], field.p)
    for sample, coefficients in enumerate(polynomials.T.tolist()):
        polynomial = flint.nmod_poly(coefficients, field.p)
        found = polynomial.gcd(pow(x, field.p, polynomial) - x).roots()  # of what splits into linear factors
        owners += [sample] * len(found)
        roots += [int(root) for root, _ in found]
    return np.array(owners, dtype=np.int64), np.array(roots, dtype=np.int64)


def _cofactors(polynomials: Residues, roots: Residues, field: PrimeField) -> Residues:
    """Monic polynomials of shape (degree + 1, roots) divided by all powers of one root each."""
    while True:
        quotient, remainder = _divided(polynomials, roots, field)
        exact = remainder == 0
        if not exact.any():
            return polynomials[:-1]
        polynomials = np.where(exact, quotient, polynomials)


def _divided(polynomials: Residues, roots: Residues, field: PrimeField) -> tuple[Residues, Residues]:
    """Quotients and remainders of the division by x − root."""
    quotient = np.zeros_like(polynomials)
    carry = np.zeros_like(roots)
    for k in reversed(range(len(polynomials))):
        quotient[k] = carry
        carry = (carry * roots + polynomials[k]) % field.p
    return quotient, carry
