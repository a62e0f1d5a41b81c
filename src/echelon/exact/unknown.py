"""Functions of geometry symbols that are only known by their values modulo primes.

An ansatz says which monomials a function may have; linear algebra fits their coefficients to samples.  Work is counted
in operations, so that no result depends on the clock.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from echelon.errors import ClosedFormError, DegenerateSampleError
from echelon.exact.elimination import null_vectors
from echelon.exact.field import PrimeField, Residues
from echelon.exact.polynomial import Monomial, cosine, sine
from echelon.exact.rational import residues_of_generators

_OPERATIONS = 5e8  # a few seconds
_TERMS = 500
SOLVING = 0.05
"""What an operation of FLINT's linear algebra costs beside one of an evaluation in NumPy."""


@dataclass
class Work:
    """What is left of a budget."""

    operations: float  # operations on residues that are left
    terms: float  # the most terms that one coefficient may have

    @staticmethod
    def of(budget: float) -> Work:
        """The work of a budget: 1 for a few seconds, 0 for none."""
        return Work(budget * _OPERATIONS, budget * _TERMS)

    def take(self, operations: float) -> bool:
        """Take some operations if as many are left."""
        if operations > self.operations:
            return False
        self.operations -= operations
        return True

    def spend(self, operations: float) -> None:
        """Take some operations."""
        if not self.take(operations):
            raise ClosedFormError("the budget for closed forms is used up")

    def share(self, part: float) -> Work:
        """A part of it, taken out; what is not used is given back by :meth:`give_back`."""
        taken = self.operations * part
        self.operations -= taken
        return Work(taken, self.terms)

    def give_back(self, rest: Work) -> None:
        """Take back what is left of a share."""
        self.operations += rest.operations


_ATTEMPTS = 8
_CHUNK = 512
"""Geometries that are evaluated at once."""

T = TypeVar("T")


@dataclass(frozen=True)
class UnknownFunctions:
    """Functions of geometry symbols that can be evaluated modulo primes."""

    # geometry maps every symbol to an array of values (for an angle: of the tangent of its half); without symbols there
    # is one geometry
    evaluate: Callable[[PrimeField, Geometry], Residues]
    symbols: Sequence[str]  # all symbols that may matter
    angles: frozenset[str]  # those of them that are angles
    lengths: frozenset[str]  # symbols with the dimension of a length
    degrees: Sequence[int]  # homogeneous degree of each function in the symbols that are lengths
    irrational: tuple[bool, bool]  # whether √2 and √3 can occur in coefficients
    cost: float = 1.0  # operations of one evaluation

    def values(self, field: PrimeField, geometry: Geometry, count: int) -> Residues:
        """Values at some geometries: array of shape (functions, count)."""
        if not self.symbols:  # there is one geometry only
            return np.repeat(self.evaluate(field, geometry), count, axis=1)
        parts = [
            self.evaluate(field, {s: value[first : first + _CHUNK] for s, value in geometry.items()})
            for first in range(0, count, _CHUNK)
        ]
        return parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)

    def sample(self, field: PrimeField, rng: np.random.Generator, count: int) -> tuple[Geometry, Residues]:
        """Random geometries and the values there."""

        def attempt() -> tuple[Geometry, Residues]:
            geometry = {s: field.draw(rng, (count,)) for s in self.symbols}
            return geometry, self.values(field, geometry, count)

        return persistent(attempt)


def persistent(attempt: Callable[[], T]) -> T:
    """The result of an attempt that depends on random points, several times if they are singular."""
    for _ in range(_ATTEMPTS):
        try:
            return attempt()
        except DegenerateSampleError:
            continue
    raise ClosedFormError(f"{_ATTEMPTS} random geometries in a row were singular")


EXTRA_SAMPLES = 4
"""Samples beyond the number of unknowns: a wrong ansatz fits them with probability about p^-4."""

Geometry = Mapping[str, Residues]
"""Values of the symbols; for an angle the tangent of its half."""


@dataclass(frozen=True)
class Ansatz:
    """Numerator and denominator monomials of one function; the last denominator coefficient is normalised to 1."""

    numerator: tuple[Monomial, ...]
    denominator: tuple[Monomial, ...]

    @property
    def size(self) -> int:
        """Number of coefficients."""
        return len(self.numerator) + len(self.denominator)


Fit = tuple[Ansatz, list[int]]
"""The occurring monomials and their coefficients in one field."""


def circle_basis(angle: str, degree: int) -> list[Monomial]:
    """Basis of the polynomials of this degree in cos and sin, with sin² eliminated."""
    basis: list[Monomial] = []
    for power in range(degree + 1):
        basis.append(((cosine(angle), power),) if power else ())
        if power < degree:
            basis.append(tuple(sorted((*(((cosine(angle), power),) if power else ()), (sine(angle), 1)))))
    return basis


def design(field: PrimeField, geometry: Geometry, monomials: Sequence[Monomial], count: int) -> Residues:
    """Values of the monomials at the first points: array of shape (count, monomials)."""
    values = residues_of_generators({g for monomial in monomials for g, _ in monomial}, geometry, field)
    table = np.ones((len(monomials), count), dtype=np.int64)
    for row, monomial in zip(table, monomials, strict=True):
        for generator, exponent in monomial:
            for _ in range(exponent):
                row[:] = row * values[generator][:count] % field.p
    return table.T


def _system(
    field: PrimeField,
    geometry: Geometry,
    values: Residues,
    top: Sequence[Monomial],
    bottom: Sequence[Monomial],
    count: int,
) -> Residues:
    """Equations numerator − value · denominator = 0 in the coefficients."""
    numerator = design(field, geometry, top, count)
    denominator = design(field, geometry, bottom, count) * values[:count, None] % field.p
    return np.concatenate([numerator, -denominator % field.p], axis=1)


def fit_quotient(
    field: PrimeField,
    geometry: Geometry,
    values: Residues,
    top: Sequence[Monomial],
    bottom: Sequence[Monomial],
) -> Fit | None:
    """Fit one function by a quotient with these monomials, or None if that cannot represent it."""
    count = len(top) + len(bottom) + EXTRA_SAMPLES
    for vector in null_vectors(_system(field, geometry, values, top, bottom, count), field):
        above = [(m, c) for m, c in zip(top, vector, strict=False) if c]
        below = [(m, c) for m, c in zip(bottom, vector[len(top) :], strict=True) if c]
        if below:
            ansatz = Ansatz(tuple(m for m, _ in above), tuple(m for m, _ in below))
            return ansatz, normalised([c for _, c in above + below], field)
    return None


def solve_ansatz(ansatz: Ansatz, field: PrimeField, geometry: Geometry, values: Residues) -> list[int]:
    """Coefficients of a known ansatz in one field."""
    system = _system(field, geometry, values, ansatz.numerator, ansatz.denominator, ansatz.size + 1)
    solutions = null_vectors(system, field)
    if len(solutions) != 1 or not solutions[0][-1]:
        raise DegenerateSampleError("the ansatz does not have one solution here")
    return normalised(solutions[0], field)


def normalised(vector: list[int], field: PrimeField) -> list[int]:
    """Coefficients scaled so that the last one, of the last denominator monomial, is 1."""
    scale = field.invert(vector[-1])
    return [c * scale % field.p for c in vector]
