"""Proof that no robot has given base parameters: a linear function that is positive for all robots and negative there.

By Farkas' lemma, either a robot ζ with B ζ = ζ̄ exists (up to the boundary), or λ with λᵀB ζ ≥ 0 for all robots and
λᵀζ̄ < 0.  λᵀB is not negative on robots if its dual matrix S_b is semidefinite for every body, its entries for friction
and the like are not negative, and those for free parameters vanish.

A solver finds λ in floats, on the boundary.  To become a proof it must be moved inside, where rounding does no harm.
But the inside may be empty: a mass on a fixed axis moves nothing, so S_b vanishes on that point for every λ.  Such
points are found first, as the kernels of the largest S_b there are; exact linear algebra removes them, and what is left
has an inside (that of mean kinetic energy, which is positive for every point that moves).
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import flint
import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.conventions import PER_BODY
from echelon.errors import EchelonError
from echelon.identification.physics.cones import SOLVED, ConeProgram, solve_with_fallback
from echelon.identification.physics.dual_problem import DualProblem
from echelon.identification.physics.exact_algebra import as_fraction, exact_dual, null_space
from echelon.identification.physics.exact_base import rational_number
from echelon.identification.physics.motionless import motionless
from echelon.identification.physics.pseudo_inertia import SIZE, is_semidefinite, is_zero
from echelon.identification.physics.triangles import sparse_diagonal, svec, unpacked


@dataclass(frozen=True)
class Separator:
    """λ in rational numbers, verified exactly."""

    exact: tuple[Fraction, ...]

    @property
    def values(self) -> Floats:
        """λ in floats, shape (r,)."""
        return np.array([float(x) for x in self.exact])


_NOTHING = 1e-12


def separator(problem: DualProblem) -> Separator | None:
    """A λ that exact arithmetic confirms to separate the values from all robots, or None if none was found.

    Parameters
    ----------
    problem : DualProblem
    """
    try:
        basis = _basis(problem)
        found = _inner(problem, basis) if basis.shape[1] else None
    except EchelonError:  # the solvers gave up, so there is nothing to verify
        return None
    return None if found is None else _verified(problem, basis, found)


def _basis(problem: DualProblem) -> npt.NDArray[Any]:
    """Exact basis of the λ that vanish where they must: on free parameters and on points that never move."""
    kernels, silent = motionless(problem)
    equations = [problem.column(c) for c in (*problem.role.free, *silent)]
    for start, vectors in zip(problem.role.starts, kernels, strict=True):
        for vector in vectors:
            equations += problem.through(start, vector)
    equations = [row for row in equations if any(not is_zero(entry) for entry in row)]
    return null_space(equations, len(problem.values))


def _inner(problem: DualProblem, basis: npt.NDArray[Any]) -> Floats | None:
    """Coordinates of a λ well inside: the largest t with S_b ≥ t, entries ≥ t and λᵀζ̄ ≤ −t."""
    floats = np.array([[float(as_fraction(v)) for v in row] for row in basis])
    size = np.maximum(np.linalg.norm(problem.weights[:, None] * floats, axis=0), 1e-300)
    columns = floats / size
    k = columns.shape[1]
    program = ConeProgram(k + 1)
    identity = svec(np.eye(SIZE))
    trace = np.zeros(k + 1)
    for rows in problem.matrices(columns):
        if not np.abs(rows).max(initial=0.0) > _NOTHING:
            continue
        matrices = [unpacked(column) for column in rows.T]
        image = _range(matrices)
        inner = np.array([svec(image.T @ m @ image) for m in matrices]).T
        least = np.column_stack([inner, -svec(np.eye(image.shape[1]))])
        program.add("semidefinite", least, np.zeros(len(least)))
        trace[:k] += identity @ rows
    positive = problem.B[:, list(problem.role.positive)].T @ columns
    positive = positive[np.abs(positive).max(axis=1, initial=0.0) > _NOTHING]
    program.add("nonnegative", np.column_stack([positive, -np.ones(len(positive))]), np.zeros(len(positive)))
    trace[:k] += positive.sum(axis=0)
    against = np.append(-(problem.values @ columns), -1.0)
    program.add("nonnegative", np.array([against, -trace]), np.array([0.0, 1.0]))
    objective = np.append(np.zeros(k), -1.0)
    found = solve_with_fallback(program, sparse_diagonal(np.zeros(k + 1)), objective, problem.solver)
    if found.status != SOLVED or found.x[k] <= _NOTHING:
        return None
    coordinates: Floats = found.x[:k] / size
    return coordinates


def _verified(problem: DualProblem, basis: npt.NDArray[Any], coordinates: Floats) -> Separator | None:
    """The separator if exact arithmetic confirms it."""
    factors = [rational_number(x) for x in coordinates]
    lam = [sum((v * f for v, f in zip(row, factors, strict=True)), flint.fmpq(0)) for row in basis]
    total = sum((a * rational_number(v) for a, v in zip(lam, problem.values, strict=True)), flint.fmpq(0))
    if not total < 0:
        return None
    coefficients = problem.exact.combination(lam)
    if not all(is_zero(coefficients[c]) for c in problem.role.free):
        return None
    if not all(coefficients[c] >= 0 for c in problem.role.positive):
        return None
    for start in problem.role.starts:
        matrix = exact_dual([flint.fmpq(0) + c for c in coefficients[start : start + PER_BODY]])
        if not is_semidefinite(matrix):
            return None
    return Separator(tuple(as_fraction(x) for x in lam))


def _range(matrices: list[Floats]) -> Floats:
    """Orthonormal basis of the span of symmetric matrices' columns, shape (4, k)."""
    total = sum((m @ m for m in matrices), np.zeros((SIZE, SIZE)))
    eigenvalues, vectors = np.linalg.eigh(total)
    image: Floats = vectors[:, eigenvalues > 1e-16 * eigenvalues[-1]]
    return image
