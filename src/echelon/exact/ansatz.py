"""Ansätze: which monomials a function may have, and fitting their coefficients to samples by linear algebra."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from echelon.errors import DegenerateSampleError
from echelon.exact.elimination import null_vectors
from echelon.exact.field import PrimeField, Residues
from echelon.exact.polynomial import Monomial, cosine, sine

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


def generator_values(field: PrimeField, geometry: Geometry, monomials: Sequence[Monomial]) -> dict[str, Residues]:
    """Values of all generators of some monomials at the points of a geometry."""
    values: dict[str, Residues] = {}
    for generator in {g for monomial in monomials for g, _ in monomial}:
        if generator.endswith(")"):
            c, s = field.circle(geometry[generator[4:-1]])
            values[generator] = c if generator.startswith("cos") else s
        else:
            values[generator] = geometry[generator]
    return values


def design(field: PrimeField, geometry: Geometry, monomials: Sequence[Monomial], count: int) -> Residues:
    """Values of the monomials at the first points: array of shape (count, monomials)."""
    values = generator_values(field, geometry, monomials)
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
