"""Physically consistent estimation: the standard parameters of a robot that can exist and explains the data.

Least squares on base parameters may leave the set of those that any robot has; a semidefinite programme does not
(Sousa & Cortesão 2014; Wensing, Kim & Slotine 2018).  Data determine base parameters only, and poor data not all of
them.  What they leave open is decided by a divergence from the prior (Lee, Wensing & Park 2020):

    minimise  ‖R B ζ − Qᵀy‖² + w Σ D(J_b ‖ J₀_b)      over  J_b ≻ 0,  friction and rotor inertia ≥ 0,  bounds

D is strictly convex in every J_b, so the answer is unique: among all robots that fit equally well, the one nearest to
the prior.  Bodies of which the prior says nothing are drawn towards a plain shape with a weight that is negligible
beside the noise.  Rows are weighted by the inverse of their noise, so w is in units of its variance: a body of twice
the prior's mass and inertia has D = 1.2 and costs as much as a misfit that rises by 1.2 w.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.base.model import BaseModel
from echelon.errors import EchelonError, InputError
from echelon.identification.physics.bounds import Bounds
from echelon.identification.physics.cones import INFEASIBLE, SOLVED, ConeSolution
from echelon.identification.physics.constraints import linear_limits, roles
from echelon.identification.physics.inside import active, interior_point, put_inside
from echelon.identification.physics.programme import Programme
from echelon.identification.physics.pseudo_inertia import divergence
from echelon.identification.physics.reference import common_mass, reference
from echelon.identification.physics.result import PhysicalFit
from echelon.identification.physics.weight import Solve, WeightChoice, by_discrepancy, by_stretches
from echelon.observe.observation import Observation
from echelon.observe.triangle import Triangle

PLAIN_WEIGHT = 1e-3
"""Weight of the drawing towards a plain shape; it raises the misfit by less than a hundredth of what noise does."""


def physical_fit(
    base: BaseModel,
    triangle: Triangle,
    *,
    bounds: Bounds | None = None,
    prior: npt.ArrayLike | None = None,
    prior_weight: float | str = 1.0,
    prior_name: str = "prior",
    pieces: Sequence[Observation] = (),
    weights: npt.ArrayLike | None = None,
) -> PhysicalFit:
    """Fit the standard parameters of a robot that can exist.

    Parameters
    ----------
    base : BaseModel
    triangle : Triangle
        Of the data, ``observation.combined(1/noise)``; its columns are the base parameters.
    bounds : Bounds, optional
        What is known of bodies and parameters.
    prior : array of shape (p,), optional
        Standard parameters to stay near to, nan where unknown; see
        :func:`echelon.identification.physics.prior.prior_from`.
    prior_weight : float or "auto"
        Weight of the divergence from the prior, at least that of a plain shape.  ``"auto"`` chooses it from the data
        of the fit alone: by predicting each of the ``pieces`` from the others, or without pieces by the discrepancy
        principle (:mod:`echelon.identification.physics.weight`).
    prior_name : str
        Name of the prior for the result.
    pieces : sequence of Observation, optional
        The data in stretches of time, for ``"auto"``.
    weights : array of shape (outputs,), optional
        Those with which ``triangle`` was combined, for ``"auto"`` with pieces; all 1 if omitted.

    Returns
    -------
    PhysicalFit

    Raises
    ------
    InputError
        If the data are of other parameters, the prior or the weight is wrong, or bounds contradict each other.
    EchelonError
        If no solver finds an answer.
    """
    if tuple(triangle.parameters) != tuple(base.pivots):
        raise InputError("the triangle's columns are not the base parameters of this model")
    problem = _Problem.of(base, triangle, bounds, prior)
    choice = _weight(problem, triangle, prior_weight, pieces, weights)
    standard, found = problem.solve(problem.matrix(triangle.R), triangle.qty, choice.weight)
    standard, step = put_inside(problem.programme, standard)
    values = problem.B @ standard
    programme, reached = problem.programme, problem.programme.margins(standard)
    names = [name for name, _ in programme.role.bodies]
    apart = divergence(programme.role.blocks(standard), programme.reference.bodies) if names else np.zeros(0)
    return PhysicalFit(
        parameters=base.parameters,
        units=tuple(column.unit for column in base.mechanism.columns),
        standard=standard,
        base=values,
        misfit=_misfit(triangle, values),
        least_misfit=_least_misfit(triangle),
        margins=dict(zip(names, map(float, reached), strict=True)),
        prior="" if prior is None else prior_name,
        prior_weight=choice.weight if prior is not None else 0.0,
        status=found.message,
        diagnostics={
            "iterations": found.iterations,
            "active": active(programme, standard, problem.matrix(triangle.R)),
            "divergence": dict(zip(names, map(float, apart), strict=True)),
            "step_inside": step,
            "prior_weight_reason": choice.reason,
            "prior_weight_scores": [list(score) for score in choice.scores],
            "findings": [str(finding) for finding in programme.reference.findings],
        },
    )


@dataclass(frozen=True)
class _Problem:
    B: Floats
    programme: Programme

    @staticmethod
    def of(base: BaseModel, triangle: Triangle, bounds: Bounds | None, prior: npt.ArrayLike | None) -> _Problem:
        role, limits = roles(base.mechanism), bounds or Bounds()
        B = base.B_float()
        mass = common_mass(role, triangle.R @ B, triangle.qty)
        programme = Programme(role, linear_limits(role, limits), reference(role, prior, mass), limits.margin)
        if bounds is not None:
            interior_point(programme)
        return _Problem(B, programme)

    def matrix(self, R: Floats) -> Floats:
        design: Floats = R @ self.B
        return design

    def solve(self, design: Floats, target: Floats, weight: float) -> tuple[Floats, ConeSolution]:
        informed = self.programme.reference.informed
        weights = np.where(informed, max(weight, PLAIN_WEIGHT), PLAIN_WEIGHT)
        standard, found = self.programme.fit(design, target, weights, weight)
        if found.status == INFEASIBLE:
            raise InputError("the bounds contradict each other: no body that can exist satisfies all of them")
        if found.status != SOLVED:
            raise EchelonError(f"the solver found no physically consistent fit: {found.message}")
        return standard, found


def _weight(
    problem: _Problem,
    triangle: Triangle,
    given: float | str,
    pieces: Sequence[Observation],
    weights: npt.ArrayLike | None,
) -> WeightChoice:
    known = bool(problem.programme.reference.informed.any())
    if given != "auto":
        if isinstance(given, str) or not 0 <= given < np.inf:
            raise InputError(f"prior_weight is {given!r}; expected a number from 0 on, or 'auto'")
        return WeightChoice(float(given), "given", ())
    if not known:
        return WeightChoice(0.0, "there is no prior", ())
    solve: Solve = lambda R, qty, weight: problem.B @ problem.solve(R @ problem.B, qty, weight)[0]  # noqa: E731
    if len(pieces) > 1:
        return by_stretches(solve, pieces, None if weights is None else np.asarray(weights, dtype=float))
    return by_discrepancy(solve, triangle)


def _misfit(triangle: Triangle, values: Floats) -> float:
    return float(np.sum((triangle.R @ values - triangle.qty) ** 2) + triangle.residual**2)


def _least_misfit(triangle: Triangle) -> float:
    scale = np.where(triangle.scales == 0, 1.0, triangle.scales)
    best = np.linalg.lstsq(triangle.R / scale, triangle.qty, rcond=None)[0]
    return float(np.sum((triangle.R / scale @ best - triangle.qty) ** 2) + triangle.residual**2)
