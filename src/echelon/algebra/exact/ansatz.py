"""Quotients of polynomials with given monomials, fitted to values modulo a prime.

An ansatz says which monomials a function may have; linear algebra fits their coefficients to samples.

On a line along one symbol every function is a quotient of univariate polynomials, found from its values by the extended
Euclidean algorithm (von zur Gathen and Gerhard, *Modern Computer Algebra*, 5.8).  Along an angle these are polynomials
in the tangent t of its half; they become polynomials in cosine and sine by a power of 1 + t², the least that is enough.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import chain, product
from math import prod
from typing import Any

import flint
import numpy as np

from echelon.algebra.exact.field import (
    Geometry,
    PrimeField,
    Residues,
    as_flint,
    null_vectors,
    residues_of_generators,
)
from echelon.algebra.exact.polynomial import Monomial, cosine, sine
from echelon.shared import DegenerateSampleError

EXTRA_SAMPLES = 4
"""Samples beyond the number of unknowns: a wrong ansatz fits them with a probability of about p^-4."""


@dataclass(frozen=True)
class Ansatz:
    """Numerator and denominator monomials of one function; the last denominator coefficient is normalised to 1."""

    numerator: tuple[Monomial, ...]
    denominator: tuple[Monomial, ...]

    @property
    def size(self) -> int:
        """Number of coefficients."""
        return len(self.numerator) + len(self.denominator)


Fit = tuple[
    Ansatz, list[int]
]  # the occurring monomials and their coefficients in one field


def circle_basis(angle: str, degree: int) -> list[Monomial]:
    """Basis of the polynomials of this degree in cos and sin, with sin² eliminated."""
    basis: list[Monomial] = []
    for power in range(degree + 1):
        basis.append(((cosine(angle), power),) if power else ())
        if power < degree:
            basis.append(
                tuple(
                    sorted(
                        (
                            *(((cosine(angle), power),) if power else ()),
                            (sine(angle), 1),
                        )
                    )
                )
            )
    return basis


def design(
    field: PrimeField, geometry: Geometry, monomials: Sequence[Monomial], count: int
) -> Residues:
    """Values of the monomials at the first points: array of shape (count, monomials)."""
    values = residues_of_generators(
        {g for monomial in monomials for g, _ in monomial}, geometry, field
    )
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
    denominator = (
        design(field, geometry, bottom, count) * values[:count, None] % field.p
    )
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
    for vector in null_vectors(
        _system(field, geometry, values, top, bottom, count), field
    ):
        above = [(m, c) for m, c in zip(top, vector, strict=False) if c]
        below = [(m, c) for m, c in zip(bottom, vector[len(top) :], strict=True) if c]
        if below:
            ansatz = Ansatz(tuple(m for m, _ in above), tuple(m for m, _ in below))
            return ansatz, normalised([c for _, c in above + below], field)
    return None


def solve_ansatz(
    ansatz: Ansatz, field: PrimeField, geometry: Geometry, values: Residues
) -> list[int]:
    """Coefficients of a known ansatz in one field."""
    system = _system(
        field, geometry, values, ansatz.numerator, ansatz.denominator, ansatz.size + 1
    )
    solutions = null_vectors(system, field)
    if len(solutions) != 1 or not solutions[0][-1]:
        raise DegenerateSampleError("the ansatz does not have one solution here")
    return normalised(solutions[0], field)


def normalised(vector: list[int], field: PrimeField) -> list[int]:
    """Coefficients scaled so that the last one, of the last denominator monomial, is 1."""
    scale = field.invert(vector[-1])
    return [c * scale % field.p for c in vector]


SURPLUS = 2
"""Values beyond those that a quotient needs: a wrong one fits them with a probability of about p^-2."""


@dataclass(frozen=True)
class Section:
    """A function along one symbol."""

    top: int  # degrees of numerator and denominator, for an angle in its cosine and sine together
    bottom: int  # that of the denominator
    # coefficients of the monic denominator, the constant one first; for an angle in the tangent t of its half, to be
    # divided by (1 + t²) to the power ``bottom``
    denominator: tuple[int, ...]


def sections(
    nodes: Residues, values: Residues, field: PrimeField, *, angle: bool
) -> list[Section | None]:
    """Functions along one symbol.  Shapes: nodes (nodes,); values (functions, nodes)."""
    p, size = field.p, len(nodes)
    powers = np.ones((size, size), dtype=np.int64)
    for k in range(1, size):
        powers[:, k] = powers[:, k - 1] * nodes % p
    solved = (
        as_flint(powers, field).solve(as_flint(values.T, field)).transpose().tolist()
    )
    factors = (flint.nmod_poly([-int(x) % p, 1], p) for x in nodes)
    vanishing = reduce(lambda a, b: a * b, factors)
    quotients = (
        _quotient(flint.nmod_poly([int(c) for c in row], p), vanishing)
        for row in solved
    )
    read = _along_angle if angle else _along_symbol
    return [None if q is None else read(*q) for q in quotients]


def _quotient(values: Any, vanishing: Any) -> tuple[Any, Any] | None:
    """The quotient of the lowest degree that is congruent to a polynomial, with a monic denominator."""
    p, size = values.modulus(), vanishing.degree()
    one, zero = flint.nmod_poly([1], p), flint.nmod_poly([], p)
    before, rest, cofactor_before, cofactor = vanishing, values, zero, one
    best, lowest = (rest, cofactor), max(rest.degree(), 0)
    while rest.degree() > 0:
        quotient, remainder = divmod(before, rest)
        before, rest = rest, remainder
        cofactor_before, cofactor = cofactor, cofactor_before - quotient * cofactor
        degree = max(rest.degree(), 0) + cofactor.degree()
        if rest.degree() >= 0 and degree < lowest:
            best, lowest = (rest, cofactor), degree
    if lowest + 1 + SURPLUS > size:
        return None
    lead = best[1].leading_coefficient()
    return best[0] / lead, best[1] / lead


def _coefficients(polynomial: Any) -> tuple[int, ...]:
    return tuple(int(c) for c in polynomial.coeffs())


def _along_symbol(top: Any, bottom: Any) -> Section:
    return Section(max(top.degree(), 0), bottom.degree(), _coefficients(bottom))


def _along_angle(top: Any, bottom: Any) -> Section:
    """Numerator and denominator as trigonometric polynomials."""
    # let (1 + t²)^v divide the function, v perhaps negative, and let R be the rest of the denominator.  R / (1 + t²)^m
    # is a trigonometric polynomial for 2 m ≥ deg R, and vanishes at t = ∞ to the order 2 m − deg R, which has to be
    # that of the function's pole there
    if not top:
        return Section(0, 0, (1,))
    pole = max(0, top.degree() - bottom.degree())
    circle = flint.nmod_poly([1, 0, 1], top.modulus())
    power = 0
    while not top % circle:
        top, power = top // circle, power + 1
    while not bottom % circle:
        bottom, power = bottom // circle, power - 1
    degree = -(-(bottom.degree() + pole) // 2)
    return Section(degree - power, degree, _coefficients(bottom))


Residual = dict[Monomial, int]  # a polynomial over GF(p), by its coefficients


def symbol_basis(name: str, degree: int, *, angle: bool) -> list[Monomial]:
    """Basis of the polynomials of this degree in one symbol."""
    if angle:
        return circle_basis(name, degree)
    return [((name, k),) if k else () for k in range(degree + 1)]


def box(bases: Sequence[Sequence[Monomial]]) -> list[Monomial]:
    """All products of one monomial of each basis."""
    return [tuple(sorted(chain.from_iterable(parts))) for parts in product(*bases)]


def factor_of(
    name: str,
    section: Section,
    field: PrimeField,
    rng: np.random.Generator,
    *,
    angle: bool,
) -> Residual:
    """The denominator along one symbol as a polynomial in its generators."""
    if not angle:
        return {
            ((name, k),) if k else (): c for k, c in enumerate(section.denominator) if c
        }
    p, basis = field.p, circle_basis(name, section.bottom)
    points = field.draw(rng, (len(basis),))
    scale = field.invert_array((1 + points * points) % p)
    values = np.zeros_like(points)
    for c in reversed(section.denominator):
        values = (values * points + c) % p
    for _ in range(section.bottom):
        values = values * scale % p
    table = design(field, {name: points}, basis, len(basis))
    solution = as_flint(table, field).solve(as_flint(values[:, None], field))
    return {m: int(solution[k, 0]) for k, m in enumerate(basis) if int(solution[k, 0])}


def multiplied(factors: Sequence[Residual], field: PrimeField) -> Residual:
    """The product of polynomials that share no generator."""
    found: Residual = {}
    for terms in product(*(factor.items() for factor in factors)):
        pairs = [pair for monomial, _ in terms for pair in monomial]
        coefficient = prod(c for _, c in terms)
        found[tuple(sorted(pairs))] = coefficient % field.p
    return found


def evaluated(
    polynomial: Residual, field: PrimeField, geometry: Geometry, count: int
) -> Residues:
    """Values of a polynomial over GF(p) at the first points of a geometry."""
    table = design(field, geometry, list(polynomial), count)
    total = np.zeros(count, dtype=np.int64)
    for column, coefficient in zip(table.T, polynomial.values(), strict=True):
        total = (total + column * coefficient) % field.p
    return total


def entangled_size(parts: Mapping[str, Section], angles: frozenset[str]) -> int:
    """Number of samples that :func:`entangled_factor` needs."""
    tops = prod(
        2 * s.top + 1 if name in angles else s.top + 1 for name, s in parts.items()
    )
    bottoms = prod(
        2 * s.bottom + 1 if name in angles else s.bottom + 1
        for name, s in parts.items()
    )
    return tops + bottoms + EXTRA_SAMPLES


def entangled_factor(
    parts: Mapping[str, Section],
    angles: frozenset[str],
    field: PrimeField,
    geometry: Geometry,
    values: Residues,
) -> Residual | None:
    """The denominator of a function of some symbols, whose degrees in each of them are known."""
    # shapes: values (points,)
    top = box(
        [symbol_basis(name, s.top, angle=name in angles) for name, s in parts.items()]
    )
    bottom = box(
        [
            symbol_basis(name, s.bottom, angle=name in angles)
            for name, s in parts.items()
        ]
    )
    fit = fit_quotient(field, geometry, values, top, bottom)
    if fit is None:
        return None
    ansatz, coefficients = fit
    return dict(
        zip(ansatz.denominator, coefficients[len(ansatz.numerator) :], strict=True)
    )
