"""The points of a finite-dimensional quotient ring of polynomials over GF(p), for many samples at once.

They are read from traces (Rouillier's rational univariate representation), which works for multiple points, too.
Matrices have the samples along their last axis.
"""

from __future__ import annotations

import flint
import numpy as np

from echelon.arrays import Flags, Integers
from echelon.exact.field import PrimeField, Residues


def commute(matrices: Residues, field: PrimeField) -> Flags:
    """At which samples matrices of shape (variables, size, size, samples) commute pairwise.

    It is enough, but for a chance of a few in p, that two random combinations of them do on a random vector.
    """
    rng = np.random.default_rng(1)
    first, second = (_combination(matrices, field, rng) for _ in range(2))
    vector = field.draw(rng, (first.shape[1], 1, 1))
    difference = _product(first, _product(second, vector, field), field)
    difference -= _product(second, _product(first, vector, field), field)
    return np.asarray(~difference.any(axis=(0, 1)))


def quotient_points(matrices: Residues, field: PrimeField) -> tuple[Integers, Residues]:
    """Points with coordinates in GF(p).

    Let m be the characteristic polynomial of a combination M of the multiplications that tells the points apart, and q
    what is left of m without one of its roots.  Then q(M) acts on the subspace of that root only, and if the point has
    the coordinate x there, then the multiplication X has the trace tr(X q(M)) = x tr(q(M)).
    """
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
