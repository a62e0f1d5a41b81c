"""Physical robots for given base parameters: one that has them, and the nearest one where none does.

If one has them, it is found: the values of the parameters that are no pivots give pivots with which B ζ = ζ̄ holds, and
plain linear algebra confirms that all pseudo-inertias are positive definite.  If none has them, the nearest robot is
the solution of a convex problem, and its distance tells how far they are off.

Interior-point solvers stop within a tolerance of the constraints, on either side.  What is wrong by that much is put
right: equalities by the least correction, signs by cutting off, and what is left by a small step towards a point well
inside.  Then all constraints are checked with plain linear algebra, not with the solver's word.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from echelon.base import BaseModel
from echelon.identification.physics.bounds import LinearLimits, roles
from echelon.identification.physics.programme import (
    INFEASIBLE,
    ROUNDING,
    SOLVED,
    SVEC,
    ConeProgram,
    Programme,
    solve_in_units,
    svec,
)
from echelon.robot import characteristic_length
from echelon.shared import LENGTH_DEGREE, PER_BODY, EchelonError, Floats, InputError


@dataclass(frozen=True, repr=False)
class Feasibility:
    """Whether any physical robot has given base parameters."""

    feasible: bool | None  # None on the boundary of what robots can have
    evidence: str  # what was found, in a sentence
    # shape (p,); if feasible: standard parameters of a physical robot that has them
    standard: Floats | None = None
    # shape (r,); if not: base parameters of the nearest physical robot
    nearest: Floats | None = None
    distance: float = 0.0  # of the nearest ones, in standard deviations of the estimate (Mahalanobis); 0 if feasible

    def is_beyond(self, deviations: float) -> bool:
        """Whether no robot has them, and the nearest is further away than some standard deviations."""
        return self.feasible is False and self.distance > deviations

    def __repr__(self) -> str:
        return f"Feasibility({self.feasible}: {self.evidence})"


UNIQUE = 1e-6  # weight of the divergence that makes the nearest robot unique, in squared standard deviations
# standard deviations that count as one, because solvers fail where thousands are needed
_UNITS = (1.0, 10.0, 100.0)


def physical_lift(base: BaseModel, values: npt.ArrayLike) -> Floats | None:
    """Standard parameters of a robot that can exist and has exactly given base parameters; None where none was found.

    Of all such robots it is the one nearest to bodies of a plain shape that explain the values best, which keeps it
    well inside of what can exist; shape (p,).
    """
    B, target = base.B_float(), checked_values(base, values)
    sizes = sizes_of(base, target)
    programme = Programme.of(base, B / sizes[:, None], target / sizes)
    standard, found = programme.fit(
        B, target, np.ones(len(programme.role.bodies)), 1.0, exact=True
    )
    if found.status != SOLVED:
        return None
    standard, _ = put_inside(programme, on_pivots(base, B, target, standard))
    standard = on_pivots(base, B, target, standard)
    return standard if holds(programme, standard) else None


def nearest_physical(
    base: BaseModel,
    values: npt.ArrayLike,
    covariance: npt.ArrayLike | None = None,
    symbols: Mapping[str, float] | None = None,
    root: Floats | None = None,
) -> tuple[Floats, float]:
    """Standard parameters, shape (p,), of the robot whose base parameters are nearest to given ones, and how near.

    ``symbols`` are values of those that the model's file does not state.  A ``root`` R with RᵀR the inverse of the
    covariance holds in double precision what the covariance of outputs in very different units does not.
    """
    target, B = checked_values(base, values), base.B_float(symbols)
    if root is None:
        root = information_root(base, target, covariance)
    problem = EchelonError("the solver found no nearest physical robot")
    for unit in _UNITS:
        try:
            standard = _nearest(base, B, target, root / unit)
            return standard, float(np.linalg.norm(root @ (B @ standard - target)))
        except EchelonError as error:
            problem = error
    raise problem


def _nearest(base: BaseModel, B: Floats, target: Floats, root: Floats) -> Floats:
    programme = Programme.of(base, root @ B, root @ target)
    weights = np.full(len(programme.role.bodies), UNIQUE)
    standard, found = programme.fit(root @ B, root @ target, weights, UNIQUE)
    if found.status != SOLVED:
        raise EchelonError(
            f"the solver found no nearest physical robot: {found.message}"
        )
    return put_inside(programme, standard)[0]


def checked_values(base: BaseModel, values: npt.ArrayLike) -> Floats:
    """Base parameters as an array of shape (r,)."""
    target = np.asarray(values, dtype=float)
    if target.shape != (base.rank,):
        raise InputError(
            f"expected {base.rank} base parameters, got an array of shape {target.shape}"
        )
    if not np.isfinite(target).all():
        raise InputError("base parameters must be finite numbers")
    return target


def on_pivots(base: BaseModel, B: Floats, target: Floats, standard: Floats) -> Floats:
    """Standard parameters with the pivots that give the base parameters exactly, the others as they are."""
    moved = standard.copy()
    for _ in range(2):  # the second time for what the first one rounded
        moved[list(base.matrix.pivots)] += target - B @ moved
    return moved


def information_root(
    base: BaseModel, target: Floats, covariance: npt.ArrayLike | None
) -> Floats:
    """A matrix R with RᵀR the inverse of the covariance, shape (r, r)."""
    if covariance is None:
        return np.diag(1 / sizes_of(base, target))
    matrix = np.asarray(covariance, dtype=float)
    if matrix.shape != (base.rank, base.rank) or not np.isfinite(matrix).all():
        raise InputError(
            f"expected a finite covariance of shape ({base.rank}, {base.rank})"
        )
    deviations = np.sqrt(np.maximum(np.diagonal(matrix), 0))
    if not (deviations > 0).all():
        raise InputError("the covariance has variances that are not positive")
    correlation = matrix / np.outer(deviations, deviations)
    if not np.allclose(correlation, correlation.T):
        raise InputError("the covariance is not symmetric")
    eigenvalues, vectors = np.linalg.eigh((correlation + correlation.T) / 2)
    if eigenvalues[0] <= 0:
        raise InputError("the covariance is not positive definite")
    whitened: Floats = (vectors / np.sqrt(eigenvalues)).T / deviations
    return whitened


def sizes_of(base: BaseModel, target: Floats) -> Floats:
    """Sizes of the base parameters, shape (r,): inertial ones by a common mass and the mechanism's length."""
    length = characteristic_length(base.mechanism)
    columns = [base.mechanism.columns[p] for p in base.matrix.pivots]
    powers = [
        None if column.kind is None else LENGTH_DEGREE[column.kind]
        for column in columns
    ]
    masses = [
        abs(v) / length**p for v, p in zip(target, powers, strict=True) if p is not None
    ]
    mass = max(masses, default=1.0) or 1.0
    others = (
        max(
            (abs(v) for v, p in zip(target, powers, strict=True) if p is None),
            default=1.0,
        )
        or 1.0
    )
    return np.array([others if p is None else mass * length**p for p in powers])


DISTINCT = 2e-3
"""Distance from which on values are not those of the nearest robot: solvers and margins account for less."""


def feasibility(
    base: BaseModel,
    values: npt.ArrayLike,
    covariance: npt.ArrayLike | None = None,
    root: Floats | None = None,
) -> Feasibility:
    """Whether a robot that can exist has given base parameters.

    Every body that carries all ten parameters needs J ≻ 0; signs of the others are those of
    :mod:`echelon.identification.physics.bounds`.
    """
    target, role = checked_values(base, values), roles(base.mechanism)
    signs = f" and {len(role.positive)} signs" if role.positive else ""
    with suppress(EchelonError):  # where the solver gives up, the distance decides
        lift = physical_lift(base, target)
        if lift is not None:
            text = f"a physical robot has these base parameters: {len(role.bodies)} pseudo-inertias{signs} were verified"
            return Feasibility(True, text, standard=lift)
    standard, distance = nearest_physical(base, target, covariance, root=root)
    is_by_size = covariance is None and root is None
    away = f"{distance:.2g} {'of their size' if is_by_size else 'standard deviations'}"
    nearest = base.B_float() @ standard
    if distance > DISTINCT:
        return Feasibility(
            False,
            f"the nearest physical robot is {away} away",
            nearest=nearest,
            distance=distance,
        )
    text = f"these base parameters are on the boundary of physical robots, to within {away}"
    return Feasibility(None, text, nearest=nearest, distance=distance)


_STEPS = (1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3)
INVISIBLE = (
    1e-3  # a change by which data change this little of their noise cannot be seen
)


def put_inside(programme: Programme, standard: Floats) -> tuple[Floats, float]:
    """Parameters next to given ones that satisfy every constraint; shape (p,)."""
    start = _signed(programme.limits, _equal(programme.limits, standard))
    if holds(programme, start):
        return start, 0.0
    inner = interior_point(programme)
    for step in _STEPS:
        mixed = (1 - step) * start + step * inner
        if holds(programme, mixed):
            return mixed, step
    raise EchelonError(
        "the solver's answer violates the constraints by far more than its tolerance"
    )


def at_rest(programme: Programme, standard: Floats, unseen: frozenset[int]) -> Floats:
    """Parameters with bodies of the prior in the places of those that no output sees; shape (p,).

    Each of them is where the divergence vanishes, which solvers reach up to their tolerance.  Where limits do not let
    a body be the prior's, it stays.
    """
    reference = programme.reference
    found = standard
    for start, body, informed in zip(
        programme.role.starts, reference.bodies, reference.informed, strict=True
    ):
        place = range(start, start + PER_BODY)
        if not informed or not unseen.issuperset(place):
            continue
        moved = found.copy()
        moved[place] = body
        if holds(programme, moved) and _keeps_equalities(programme.limits, moved):
            found = moved
    return found


def interior_point(programme: Programme) -> Floats:
    """A point well inside of all constraints: with the largest least slack, in units of the reference bodies."""
    p, bodies = programme.role.size, len(programme.role.bodies)
    program = ConeProgram(p + 1)
    identity = svec(np.eye(4))
    for body in range(bodies):
        rows = np.zeros((10, p + 1))
        rows[:, PER_BODY * body : PER_BODY * (body + 1)] = SVEC
        rows[:, p] = -identity
        program.add("semidefinite", rows, np.zeros(10))
    programme.add_limits(program, slack=p)
    cap = np.zeros((1, p + 1))
    cap[0, p] = -1.0
    program.add("nonnegative", cap, np.array([0.5]))
    # the middle of the mass of the reference keeps what is not bounded from running away
    diagonal, linear = np.append(np.full(p, 1e-9), 0.0), np.append(np.zeros(p), -1.0)
    found = solve_in_units(program, diagonal, linear)
    if found.status == INFEASIBLE or found.x[p] <= 1e-9:
        raise InputError(
            "the bounds contradict each other: no body that can exist satisfies all of them"
        )
    return _equal(programme.limits, programme.unwhiten @ found.x[:p])


def active(programme: Programme, standard: Floats, design: Floats) -> list[str]:
    """Names of limits that hold with equality, up to what data can tell."""
    slack, size = _slack(programme.limits, standard)
    seen = np.maximum(np.linalg.norm(design, axis=0), 1e-300)
    with np.errstate(divide="ignore", over="ignore"):
        changes = np.where(
            programme.limits.least[:, :-1] != 0,
            np.abs(programme.limits.least[:, :-1]) / seen,
            np.inf,
        )
    invisible = INVISIBLE * changes.min(axis=1, initial=np.inf)
    invisible[
        ~np.isfinite(invisible) | (changes.min(axis=1, initial=np.inf) > 1e200)
    ] = 0.0
    closed = slack <= 1e-6 * size + invisible
    return [
        name for name, shut in zip(programme.limits.names, closed, strict=True) if shut
    ]


def _slack(limits: LinearLimits, standard: Floats) -> tuple[Floats, Floats]:
    """Slack of the inequalities, and the size of their terms."""
    rows, constant = limits.least[:, :-1], limits.least[:, -1]
    return rows @ standard + constant, np.abs(rows) @ np.abs(standard) + np.abs(
        constant
    )


def _equal(limits: LinearLimits, standard: Floats) -> Floats:
    rows, constant = limits.equal[:, :-1], limits.equal[:, -1]
    if not len(rows):
        return standard
    corrected: Floats = standard - np.linalg.pinv(rows) @ (rows @ standard + constant)
    single = np.count_nonzero(rows, axis=1) == 1
    for row, value in zip(rows[single], constant[single], strict=True):
        column = int(np.flatnonzero(row)[0])
        corrected[column] = -value / row[column]
    return corrected


def _keeps_equalities(limits: LinearLimits, standard: Floats) -> bool:
    rows, constant = limits.equal[:, :-1], limits.equal[:, -1]
    size = np.abs(rows) @ np.abs(standard) + np.abs(constant)
    return bool((np.abs(rows @ standard + constant) <= ROUNDING * size).all())


def _signed(limits: LinearLimits, standard: Floats) -> Floats:
    """Values beyond a limit of their own, moved onto it."""
    moved = standard.copy()
    for row in limits.least:
        columns = np.flatnonzero(row[:-1])
        if len(columns) == 1 and row[columns[0]] * moved[columns[0]] + row[-1] < 0:
            moved[columns[0]] = -row[-1] / row[columns[0]]
    return moved


def holds(programme: Programme, standard: Floats) -> bool:
    """Whether parameters satisfy all constraints, up to rounding."""
    slack, size = _slack(programme.limits, standard)
    if (slack < -ROUNDING * size).any():
        return False
    for cone in programme.limits.cones:
        value = cone @ standard
        if np.linalg.norm(value[1:]) > value[0] * (1 + ROUNDING):
            return False
    margins = programme.margins(standard)
    return bool((margins > 1e-13).all())
