"""Denominators of unknown functions, symbol by symbol.

Along one symbol a denominator is found from values on a line.  If two lines with other values of the other symbols show
the same one, it is a factor in this symbol alone, as the denominators of robots mostly are.  Symbols that are entangled
with one another are fitted together, with all others held: the degrees are known from the lines.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from math import prod

import flint
import numpy as np

from echelon.exact.ansatz import EXTRA_SAMPLES, Geometry, circle_basis, design, fit_quotient
from echelon.exact.field import PrimeField, Residues
from echelon.exact.polynomial import Monomial
from echelon.exact.univariate import Section

Residual = dict[Monomial, int]
"""A polynomial over GF(p)."""


def symbol_basis(name: str, degree: int, *, angle: bool) -> list[Monomial]:
    """Basis of the polynomials of this degree in one symbol."""
    if angle:
        return circle_basis(name, degree)
    return [((name, k),) if k else () for k in range(degree + 1)]


def box(bases: Sequence[Sequence[Monomial]]) -> list[Monomial]:
    """All products of one monomial of each basis."""
    return [tuple(sorted(pair for part in parts for pair in part)) for parts in product(*bases)]


def factor_of(name: str, section: Section, field: PrimeField, rng: np.random.Generator, *, angle: bool) -> Residual:
    """The denominator along one symbol as a polynomial in its generators."""
    if not angle:
        return {((name, k),) if k else (): c for k, c in enumerate(section.denominator) if c}
    p, basis = field.p, circle_basis(name, section.bottom)
    points = field.draw(rng, (len(basis),))
    scale = field.invert_array((1 + points * points) % p)
    values = np.zeros_like(points)
    for c in reversed(section.denominator):
        values = (values * points + c) % p
    for _ in range(section.bottom):
        values = values * scale % p
    table = design(field, {name: points}, basis, len(basis))
    left = flint.nmod_mat(len(basis), len(basis), table.ravel().tolist(), p)
    solution = left.solve(flint.nmod_mat(len(basis), 1, values.tolist(), p))
    return {m: int(solution[k, 0]) for k, m in enumerate(basis) if int(solution[k, 0])}


def multiplied(factors: Sequence[Residual], field: PrimeField) -> Residual:
    """The product of polynomials that share no generator."""
    return {
        tuple(sorted(pair for monomial, _ in terms for pair in monomial)): prod(c for _, c in terms) % field.p
        for terms in product(*(factor.items() for factor in factors))
    }


def evaluated(polynomial: Residual, field: PrimeField, geometry: Geometry, count: int) -> Residues:
    """Values of a polynomial over GF(p) at the first points of a geometry."""
    table = design(field, geometry, list(polynomial), count)
    total = np.zeros(count, dtype=np.int64)
    for column, coefficient in zip(table.T, polynomial.values(), strict=True):
        total = (total + column * coefficient) % field.p
    return total


def entangled_size(parts: Mapping[str, Section], angles: frozenset[str]) -> int:
    """Number of samples that :func:`entangled_factor` needs."""
    tops = prod(2 * s.top + 1 if name in angles else s.top + 1 for name, s in parts.items())
    bottoms = prod(2 * s.bottom + 1 if name in angles else s.bottom + 1 for name, s in parts.items())
    return tops + bottoms + EXTRA_SAMPLES


def entangled_factor(
    parts: Mapping[str, Section], angles: frozenset[str], field: PrimeField, geometry: Geometry, values: Residues
) -> Residual | None:
    """The denominator of a function of some symbols, whose degrees in each of them are known."""
    # shapes: values (points,)
    top = box([symbol_basis(name, s.top, angle=name in angles) for name, s in parts.items()])
    bottom = box([symbol_basis(name, s.bottom, angle=name in angles) for name, s in parts.items()])
    fit = fit_quotient(field, geometry, values, top, bottom)
    if fit is None:
        return None
    ansatz, coefficients = fit
    return dict(zip(ansatz.denominator, coefficients[len(ansatz.numerator) :], strict=True))
