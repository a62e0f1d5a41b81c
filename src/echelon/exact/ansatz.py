"""Ansätze: which monomials a function may have, and fitting their coefficients to samples by linear algebra.

Polynomials that share their monomials are fitted together, because one elimination of the design matrix serves any
number of right-hand sides; quotients are found one by one as null vectors.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement, product

import numpy as np

from echelon.errors import DegenerateSampleError
from echelon.exact.elimination import null_vectors, reduced_echelon
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


def monomials_up_to(
    lengths: list[str], degree: int, angles: list[str], turn: int, others: list[str], power: int
) -> list[Monomial]:
    """Monomials homogeneous in lengths, up to degree ``turn`` in each angle and ``power`` in other symbols together."""
    length_part = [_collect(c) for c in combinations_with_replacement(lengths, degree)]
    angle_parts = [_circle_basis(angle, turn) for angle in angles]
    other_part = [_collect(c) for e in range(power + 1) for c in combinations_with_replacement(others, e)]
    return [
        tuple(sorted(pair for factor in factors for pair in factor))
        for factors in product(length_part, *angle_parts, other_part)
    ]


def _collect(names: tuple[str, ...]) -> Monomial:
    return tuple((name, names.count(name)) for name in sorted(set(names)))


def _circle_basis(angle: str, degree: int) -> list[Monomial]:
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


def _design(field: PrimeField, geometry: Geometry, monomials: Sequence[Monomial], count: int) -> Residues:
    """Values of the monomials: array of shape (count, monomials)."""
    values = generator_values(field, geometry, monomials)
    columns = np.ones((count, len(monomials)), dtype=np.int64)
    for k, monomial in enumerate(monomials):
        for generator, exponent in monomial:
            for _ in range(exponent):
                columns[:, k] = columns[:, k] * values[generator][:count] % field.p
    return columns


def _system(
    field: PrimeField,
    geometry: Geometry,
    values: Residues,
    top: Sequence[Monomial],
    bottom: Sequence[Monomial],
    count: int,
) -> Residues:
    """Equations numerator − value · denominator = 0 in the coefficients."""
    numerator = _design(field, geometry, top, count)
    denominator = _design(field, geometry, bottom, count) * values[:count, None] % field.p
    return np.concatenate([numerator, -denominator % field.p], axis=1)


def fit_polynomials(
    field: PrimeField, geometry: Geometry, values: Residues, monomials: Sequence[Monomial]
) -> list[Fit | None]:
    """Fit several functions by polynomials with the same monomials.

    Parameters
    ----------
    field : PrimeField
    geometry : Geometry
        With at least :data:`EXTRA_SAMPLES` more points than monomials.
    values : array of shape (functions, points)
    monomials : sequence of Monomial

    Returns
    -------
    list of Fit or None
        None for a function that is not such a polynomial.

    Raises
    ------
    DegenerateSampleError
        If the points do not tell the monomials apart.
    """
    size, count = len(monomials), len(monomials) + EXTRA_SAMPLES
    table = np.concatenate([_design(field, geometry, monomials, count), values[:, :count].T], axis=1)
    reduced, pivots = reduced_echelon(table, field)
    if pivots[:size] != list(range(size)):
        raise DegenerateSampleError("the points do not tell the monomials apart")
    fits: list[Fit | None] = []
    for column in range(size, table.shape[1]):
        # beyond the first function that does not fit, rows below `size` mix the misfits
        if any(int(reduced[row, column]) for row in range(size, len(pivots))) or column in pivots:
            fits.append(None)
            continue
        terms = [(m, int(reduced[row, column])) for row, m in enumerate(monomials)]
        kept = [(m, c) for m, c in terms if c]
        fits.append((Ansatz(tuple(m for m, _ in kept), ((),)), [*(c for _, c in kept), 1]))
    return fits


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
            return ansatz, _normalised([c for _, c in above + below], field)
    return None


def solve_ansatz(ansatz: Ansatz, field: PrimeField, geometry: Geometry, values: Residues) -> list[int]:
    """Coefficients of a known ansatz in one field.

    Raises
    ------
    DegenerateSampleError
        If they are not determined.
    """
    system = _system(field, geometry, values, ansatz.numerator, ansatz.denominator, ansatz.size + 1)
    solutions = null_vectors(system, field)
    if len(solutions) != 1 or not solutions[0][-1]:
        raise DegenerateSampleError("the ansatz does not have one solution here")
    return _normalised(solutions[0], field)


def _normalised(vector: list[int], field: PrimeField) -> list[int]:
    """Coefficients scaled so that the last one, of the last denominator monomial, is 1."""
    scale = field.invert(vector[-1])
    return [c * scale % field.p for c in vector]
