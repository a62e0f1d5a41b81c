"""Functions along one symbol: from values on a line to the degrees of numerator and denominator, and the denominator.

On a line along one symbol every function is a quotient of univariate polynomials, found from its values by the extended
Euclidean algorithm (von zur Gathen and Gerhard, *Modern Computer Algebra*, 5.8).  Along an angle these are polynomials
in the tangent t of its half; they become polynomials in cosine and sine by a power of 1 + t², the least that is enough.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from typing import Any

import flint
import numpy as np

from echelon.exact.field import PrimeField, Residues

_SURPLUS = 2
"""Values beyond those that a quotient needs: a wrong one fits them with probability about p^-2."""


@dataclass(frozen=True)
class Section:
    """A function along one symbol."""

    top: int  # degrees of numerator and denominator, for an angle in its cosine and sine together
    bottom: int  # degrees of numerator and denominator, for an angle in its cosine and sine together
    # coefficients of the monic denominator, the constant one first; for an angle in the tangent t of its half, to be
    # divided by (1 + t²) to the power ``bottom``
    denominator: tuple[int, ...]


def sections(nodes: Residues, values: Residues, field: PrimeField, *, angle: bool) -> list[Section | None]:
    """Functions along one symbol.  Shapes: nodes (nodes,); values (functions, nodes)."""
    p, size = field.p, len(nodes)
    powers = np.ones((size, size), dtype=np.int64)
    for k in range(1, size):
        powers[:, k] = powers[:, k - 1] * nodes % p
    known = flint.nmod_mat(size, values.shape[0], values.T.ravel().tolist(), p)
    solved = flint.nmod_mat(size, size, powers.ravel().tolist(), p).solve(known).transpose().tolist()
    factors = (flint.nmod_poly([-int(x) % p, 1], p) for x in nodes)
    vanishing = reduce(lambda a, b: a * b, factors)
    quotients = (_quotient(flint.nmod_poly([int(c) for c in row], p), vanishing) for row in solved)
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
    if lowest + 1 + _SURPLUS > size:
        return None
    lead = best[1].leading_coefficient()
    return best[0] / lead, best[1] / lead


def _coefficients(polynomial: Any) -> tuple[int, ...]:
    return tuple(int(c) for c in polynomial.coeffs())


def _along_symbol(top: Any, bottom: Any) -> Section:
    return Section(max(top.degree(), 0), bottom.degree(), _coefficients(bottom))


def _along_angle(top: Any, bottom: Any) -> Section:
    """Numerator and denominator as trigonometric polynomials.

    Let (1 + t²)^v divide the function, v perhaps negative, and let R be the rest of the denominator.  R / (1 + t²)^m
    is a trigonometric polynomial for 2 m ≥ deg R, and vanishes at t = ∞ to the order 2 m − deg R, which has to be that
    of the function's pole there.
    """
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
