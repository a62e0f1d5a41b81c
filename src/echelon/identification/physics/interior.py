"""From a solver's answer to parameters that satisfy every constraint.

Interior-point solvers stop within a tolerance of the constraints, on either side.  What is wrong by that much is put
right here: equalities by the least correction, signs by cutting off, and what is left by a small step towards a point
well inside.  Then all constraints are checked with plain linear algebra, not with the solver's word.
"""

from __future__ import annotations

import numpy as np

from echelon.arrays import Floats
from echelon.conventions import PER_BODY
from echelon.errors import EchelonError, InputError
from echelon.identification.physics.bounds import LinearLimits
from echelon.identification.physics.programme import (
    INFEASIBLE,
    SVEC,
    ConeProgram,
    Programme,
    solve_in_units,
    sparse_diagonal,
    svec,
)

_STEPS = (1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3)
_ROUNDING = 1e-12
_INVISIBLE = 1e-3
"""A change by which data change this little of their noise cannot be seen."""


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
    raise EchelonError("the solver's answer violates the constraints by far more than its tolerance")


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
    quadratic = sparse_diagonal(np.append(np.full(p, 1e-9), 0.0))
    found = solve_in_units(program, quadratic, np.append(np.zeros(p), -1.0))
    if found.status == INFEASIBLE or found.x[p] <= 1e-9:
        raise InputError("the bounds contradict each other: no body that can exist satisfies all of them")
    return _equal(programme.limits, programme.unwhiten @ found.x[:p])


def active(programme: Programme, standard: Floats, design: Floats) -> list[str]:
    """Names of limits that hold with equality, up to what data can tell."""
    slack, size = _slack(programme.limits, standard)
    seen = np.maximum(np.linalg.norm(design, axis=0), 1e-300)
    with np.errstate(divide="ignore", over="ignore"):
        changes = np.where(programme.limits.least[:, :-1] != 0, np.abs(programme.limits.least[:, :-1]) / seen, np.inf)
    invisible = _INVISIBLE * changes.min(axis=1, initial=np.inf)
    invisible[~np.isfinite(invisible) | (changes.min(axis=1, initial=np.inf) > 1e200)] = 0.0
    closed = slack <= 1e-6 * size + invisible
    return [name for name, shut in zip(programme.limits.names, closed, strict=True) if shut]


def _slack(limits: LinearLimits, standard: Floats) -> tuple[Floats, Floats]:
    """Slack of the inequalities, and the size of their terms."""
    rows, constant = limits.least[:, :-1], limits.least[:, -1]
    return rows @ standard + constant, np.abs(rows) @ np.abs(standard) + np.abs(constant)


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
    if (slack < -_ROUNDING * size).any():
        return False
    for cone in programme.limits.cones:
        value = cone @ standard
        if np.linalg.norm(value[1:]) > value[0] * (1 + _ROUNDING):
            return False
    margins = programme.margins(standard)
    return bool((margins > 1e-13).all())
