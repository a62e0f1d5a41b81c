"""The points of a finite-dimensional quotient ring of polynomials over GF(p), for many samples at once.

They are read from traces (Rouillier's rational univariate representation), which works for multiple points, too.
"""

from __future__ import annotations

import flint
import numpy as np

from echelon.exact.field import PrimeField, Residues
from echelon.exact.normal_forms import Indices, Mask, multiply


def commute(matrices: Residues, field: PrimeField) -> Mask:
    """At which samples matrices of shape (variables, samples, size, size) commute pairwise.

    It is enough that they commute with a random combination of them.
    """
    combination = _combination(matrices, field)
    difference = multiply(combination, matrices, field) - multiply(matrices, combination, field)
    return np.asarray(~difference.any(axis=(0, 2, 3)))


def quotient_points(matrices: Residues, field: PrimeField) -> tuple[Indices, Residues]:
    """Points with coordinates in GF(p).

    Let m be the characteristic polynomial of a combination M of the multiplications that tells the points apart, and q
    what is left of m without one of its roots.  Then q(M) acts on the subspace of that root only, and if the point has
    the coordinate x there, then the multiplication X has the trace tr(X q(M)) = x tr(q(M)).

    Parameters
    ----------
    matrices : array of shape (variables, samples, size, size)
        Multiplications by the variables, which commute.
    field : PrimeField

    Returns
    -------
    (array of shape (points,), array of shape (points, variables))
        The sample of each point, ascending, and its coordinates.
    """
    variables, samples, size = matrices.shape[:3]
    combination = _combination(matrices, field)
    power = np.broadcast_to(np.eye(size, dtype=np.int64), combination.shape)
    traces = np.zeros((samples, size, variables + 1), dtype=np.int64)
    for exponent in range(size):
        traces[:, exponent, 0] = np.trace(power, axis1=1, axis2=2) % field.p
        traces[:, exponent, 1:] = (matrices * power.swapaxes(1, 2) % field.p).sum(axis=(2, 3)).T % field.p
        power = multiply(power, combination, field)
    owners, cofactors = _cofactors(combination, field)
    sums = multiply(cofactors[:, None], traces[owners], field)[:, 0]
    return owners, sums[:, 1:] * field.invert_array(sums[:, :1]) % field.p


def _combination(matrices: Residues, field: PrimeField) -> Residues:
    """Random linear combination along the first axis."""
    weights = field.draw(np.random.default_rng(0), (len(matrices), 1, 1, 1))
    return np.asarray((weights * matrices % field.p).sum(axis=0) % field.p)


def _cofactors(matrices: Residues, field: PrimeField) -> tuple[Indices, Residues]:
    """Characteristic polynomials without one root each: the sample and the coefficients, for all roots in GF(p)."""
    size = matrices.shape[1]
    owners, cofactors = [], []
    for sample, entries in enumerate(matrices.reshape(len(matrices), -1).tolist() if size else []):
        polynomial = flint.nmod_mat(size, size, entries, field.p).charpoly()
        for root, multiplicity in polynomial.roots():
            factor = flint.nmod_poly([-int(root), 1], field.p) ** multiplicity
            cofactor = [int(c) for c in (polynomial // factor).coeffs()]
            owners.append(sample)
            cofactors.append(cofactor + [0] * (size - len(cofactor)))
    return np.array(owners, dtype=np.int64), np.array(cofactors, dtype=np.int64).reshape(len(owners), size)
