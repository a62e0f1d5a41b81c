"""Points of bodies that never move, whatever the mechanism does: mass there changes nothing that is measured.

λᵀB vanishes there for every λ that is not negative on robots, so proofs need these points exactly.  A semidefinite
programme finds them in floats: as the kernels of the largest S_b that a common λ can have (with S_b ⪰ U_b, 1 ⪰ U_b ⪰ 0
and the largest traces, U_b is the projection onto what moves).  Then each point is made precise, and taken for the
simplest fractions with which it is one exactly.
"""

from __future__ import annotations

from fractions import Fraction

import flint
import numpy as np

from echelon.arrays import Floats
from echelon.conventions import PER_BODY
from echelon.identification.physics.cones import ConeProgram, solve_with_fallback
from echelon.identification.physics.dual_problem import DualProblem
from echelon.identification.physics.exact_algebra import times
from echelon.identification.physics.pseudo_inertia import SIZE, dual_matrix, is_zero
from echelon.identification.physics.triangles import sparse_diagonal, svec, unpacked

_DIGITS = 9
_DOUBLE = 1e-3
_STILL, _RIDGE = 1e-4, 1e-9
"""Eigenvalues of U below this are zeros; the second keeps λ finite where any size would do."""
_NEAR = (1e-10, 1e-8, 1e-7, 1e-6, 1e-5)


def motionless(problem: DualProblem) -> tuple[list[list[list[Fraction]]], list[int]]:
    """For every body the points on which all S vanish, and the positive parameters that never count."""
    r, bodies, positive = len(problem.values), len(problem.role.bodies), len(problem.role.positive)
    size = r + 10 * bodies + positive
    columns = np.diag(1 / problem.weights)
    program = ConeProgram(size)
    linear, ridge = np.zeros(size), np.zeros(size)
    ridge[:r] = _RIDGE
    identity = svec(np.eye(SIZE))
    for number, rows in enumerate(problem.matrices(columns)):
        place = slice(r + 10 * number, r + 10 * (number + 1))
        eye = np.zeros((10, size))
        eye[:, place] = np.eye(10)
        larger = -eye
        larger[:, :r] = rows
        program.add("semidefinite", larger, np.zeros(10))
        program.add("semidefinite", eye, np.zeros(10))
        program.add("semidefinite", -eye, identity)
        linear[place] = -identity
    first = r + 10 * bodies
    single = np.zeros((positive, size))
    single[:, first:] = np.eye(positive)
    larger = -single
    larger[:, :r] = problem.B[:, list(problem.role.positive)].T @ columns
    for rows, offset in ((larger, 0.0), (single, 0.0), (-single, 1.0)):
        program.add("nonnegative", rows, np.full(positive, offset))
    linear[first:] = -1.0
    free = np.zeros((len(problem.role.free), size))
    free[:, :r] = problem.B[:, list(problem.role.free)].T @ columns
    program.add("zero", free[np.abs(free).any(axis=1)], np.zeros(int(np.abs(free).any(axis=1).sum())))
    found = solve_with_fallback(program, sparse_diagonal(ridge), linear, problem.solver)
    triangles = found.x[r : r + 10 * bodies].reshape(bodies, 10)
    kernels = [_kernel(problem, body, triangle) for body, triangle in enumerate(triangles)]
    silent = [c for c, u in zip(problem.role.positive, found.x[first:], strict=True) if u < _STILL]
    return kernels, silent


def _kernel(problem: DualProblem, body: int, triangle: Floats) -> list[list[Fraction]]:
    """Basis of the directions in which the largest S has no part, in echelon form from the last entry on."""
    scale, start = problem.scales[body], problem.role.starts[body]
    eigenvalues, vectors = np.linalg.eigh(unpacked(triangle))
    hidden = vectors[:, eigenvalues < _STILL]
    if hidden.shape[1] == 0:
        return []
    matrices = dual_matrix(problem.B[:, start : start + PER_BODY]) * np.outer(scale, scale)
    matrices = matrices[np.abs(matrices).max(axis=(1, 2)) > 0]
    points = _echelon(refined(_echelon(hidden.T), matrices) * scale)
    # a double root is found to half the digits only, so the simplest exact solution next to it is looked for
    for nearness in _NEAR:
        simple = [[recognised(v, nearness * scale[0]) for v in row] for row in points]
        if _vanishes(problem, start, simple):
            break
    return simple


def _vanishes(problem: DualProblem, start: int, vectors: list[list[Fraction]]) -> bool:
    """Whether vᵀ S w is zero for all λ and all pairs of vectors, exactly."""
    for first in vectors:
        images = problem.through(start, first)
        for second in vectors:
            for image in zip(*images, strict=True):
                if not is_zero(sum((times(x, f) for x, f in zip(image, second, strict=True)), flint.fmpq(0))):
                    return False
    return True


def _echelon(rows: Floats) -> Floats:
    """Reduced echelon form of a few rows, pivots from the last column on: a point has 1 there."""
    matrix = rows[:, ::-1].copy()
    pivot_row = 0
    for column in range(matrix.shape[1]):
        if pivot_row == len(matrix):
            break
        best = pivot_row + int(np.argmax(np.abs(matrix[pivot_row:, column])))
        if abs(matrix[best, column]) < 1e-3 * np.abs(matrix[pivot_row:]).max(initial=0.0):
            continue
        matrix[[pivot_row, best]] = matrix[[best, pivot_row]]
        matrix[pivot_row] /= matrix[pivot_row, column]
        for other in range(len(matrix)):
            if other != pivot_row:
                matrix[other] -= matrix[other, column] * matrix[pivot_row]
        pivot_row += 1
    reduced: Floats = matrix[:, ::-1]
    return reduced


def refined(points: Floats, matrices: Floats) -> Floats:
    """Points in echelon form, moved so that vᵀ S w = 0 holds to rounding for all of them and all matrices.

    Parameters
    ----------
    points : array of shape (k, 4)
    matrices : array of shape (n, 4, 4)
    """
    from scipy.optimize import least_squares

    pivots = {(row, int(np.flatnonzero(np.abs(v) > 0)[-1])) for row, v in enumerate(points)}
    columns = {column for _, column in pivots}
    moving = [(i, j) for i in range(len(points)) for j in range(SIZE) if j not in columns]
    if not moving or not len(matrices):
        return points
    unit = matrices / np.abs(matrices).max(axis=(1, 2), keepdims=True)
    where = tuple(np.array(moving).T)

    def residual(x: Floats) -> Floats:
        moved = points.copy()
        moved[where] = x
        values: Floats = np.einsum("ai,nij,bj->nab", moved, unit, moved).ravel()
        return values

    start: Floats = np.asarray(least_squares(residual, points[where], xtol=1e-15, ftol=1e-15, gtol=1e-15).x)
    jacobian = np.array([(residual(start + d) - residual(start - d)) / 2 for d in np.eye(len(moving))]).T
    # along directions in which a root is double the derivative vanishes too, and has a simple root
    _, sizes, directions = np.linalg.svd(jacobian)
    double = directions[np.append(sizes, np.zeros(len(directions) - len(sizes))) < _DOUBLE * max(sizes.max(), _DOUBLE)]

    def with_slopes(x: Floats) -> Floats:
        slopes = [(residual(x + d) - residual(x - d)) / 2 for d in double]
        return np.concatenate([residual(x), *slopes])

    found = least_squares(with_slopes, start, xtol=1e-15, ftol=1e-15, gtol=1e-15)
    better = points.copy()
    better[where] = found.x
    return better


def recognised(value: float, nearness: float) -> Fraction:
    """The simplest fraction next to a float, which is exact where the geometry is decimal."""
    for digits in range(_DIGITS + 1):
        near = Fraction(value).limit_denominator(10**digits)
        if abs(float(near) - value) < nearness:
            return near
    return Fraction(value)
