"""Physically consistent estimation: the standard parameters of a robot that can exist and explains the data.

How much the prior counts is chosen from the data of the fit alone, in one of two ways:

- **by stretches**: each stretch of the log is predicted from the others, for weights over many decades.  Neighbouring
  samples are alike, so whole stretches are left out, not samples.  Among weights whose error is within one standard
  error of the least one, the largest is taken (Hastie, Tibshirani & Friedman, 7.10): stretches of one trajectory excite
  alike, so their errors say little against a weight that a new trajectory would need.
- **by discrepancy** (Morozov), for data in one piece: the true parameters raise the misfit above its minimum by r σ² on
  average, where r is the number of base parameters; the largest weight that raises it no more is taken.

Least squares on base parameters may leave the set of those that any robot has; a semidefinite programme does not
(Sousa & Cortesão 2014; Wensing, Kim & Slotine 2018).  Data determine base parameters only, and poor data not all of
them.  What they leave open is decided by a divergence from the prior (Lee, Wensing & Park 2020):

    minimise  ‖R B ζ − Qᵀy‖² + w Σ D(J_b ‖ J₀_b)      over  J_b ≻ 0,  friction and rotor inertia ≥ 0,  bounds

D is strictly convex in every J_b, so the answer is unique: among all robots that fit equally well, the one nearest to
the prior.  Bodies of which the prior says nothing are drawn towards a plain shape of the robot's own size and mass, so
that no link of a hundred kilograms comes out where data hardly see its mass: with weight 1, or less where that raises
the misfit by more than the true parameters do.  Rows are weighted by the inverse of their noise, so w is in units of
its variance: a body of twice the prior's mass and inertia has D = 1.2 and costs as much as a misfit that rises by
1.2 w.

Motions show combinations of masses and inertias, not each of them: a link of 245 kg may predict as well as one of 3 kg.
So :func:`departures` names such links, lest anybody loads one into a simulator unwarned.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial, reduce
from typing import Any

import numpy as np
import numpy.typing as npt

from echelon.base import BaseModel, Identifiability
from echelon.compute import Observation, Triangle
from echelon.identification.advantage import Advantage
from echelon.identification.estimators.estimate import CLEAR
from echelon.identification.estimators.least_squares import least_squares
from echelon.identification.logs.finding import Finding, enumerated, warning
from echelon.identification.physics.bounds import Bounds, roles
from echelon.identification.physics.feasibility import (
    active,
    at_rest,
    interior_point,
    put_inside,
)
from echelon.identification.physics.programme import SOLVED, ConeSolution, Programme
from echelon.robot import Mechanism, divergence, pseudo_inertia
from echelon.shared import EchelonError, Floats, InputError


@dataclass(frozen=True, repr=False)
class PhysicalFit:
    """Standard parameters of a robot that can exist, fitted to data."""

    parameters: tuple[str, ...]  # the p standard parameters
    units: tuple[str, ...]
    standard: Floats  # shape (p,); they satisfy every constraint
    base: Floats  # shape (r,); their base parameters B ζ
    misfit: float  # Σ ((W ζ̄ − y)/σ)² of the fit
    # the same of plain (weighted) least squares, which no fit undercuts
    unconstrained_misfit: float
    # body → smallest eigenvalue of its pseudo-inertia relative to that of its prior or its scale
    margins: Mapping[str, float]
    prior: str  # what it was drawn to: name of the prior, or empty
    prior_weight: float
    status: str  # of the solver
    # over least squares; None where data are in one piece
    advantage: Advantage | None = None
    # JSON-able: solver, iterations, active bounds, …
    diagnostics: Mapping[str, Any] = field(default_factory=dict)

    def __repr__(self) -> str:
        least = self.unconstrained_misfit
        drawn = (
            f", drawn to {self.prior} with weight {self.prior_weight:g}"
            if self.prior
            else ""
        )
        return f"PhysicalFit({len(self.margins)} bodies, misfit {self.misfit - least:.4g} above {least:.4g}{drawn})"


# base parameters from R, Qᵀy and a weight
Solve = Callable[[Floats, Floats, float], Floats]

CANDIDATES = tuple(float(10.0**k) for k in range(-2, 7))


@dataclass(frozen=True)
class WeightChoice:
    """A weight and why it was chosen."""

    weight: float
    reason: str
    scores: tuple[tuple[float, float], ...]  # weights that were tried, with their error


def by_stretches(
    solve: Solve, pieces: Sequence[Observation], weights: Floats | None
) -> WeightChoice:
    """The weight with which stretches are best predicted from the others."""
    solves = [partial(_with_weight, solve, weight) for weight in CANDIDATES]
    errors = _stretch_errors(solves, pieces, weights)
    mean = errors.mean(axis=0)
    best = int(np.argmin(mean))
    spread = (errors - errors[:, [best]]).std(axis=0, ddof=1) / np.sqrt(len(pieces))
    chosen = max(k for k in range(len(CANDIDATES)) if mean[k] <= mean[best] + spread[k])
    reason = f"the largest weight with which each of {len(pieces)} stretches is predicted from the others as well as "
    reason += "with any, within one standard error"
    scores = tuple(
        (weight, float(np.exp(m))) for weight, m in zip(CANDIDATES, mean, strict=True)
    )
    return WeightChoice(CANDIDATES[chosen], reason, scores)


def _with_weight(solve: Solve, weight: float, triangle: Triangle) -> Floats:
    return solve(triangle.R, triangle.qty, weight)


def _stretch_errors(
    solves: Sequence[Callable[[Triangle], Floats]],
    pieces: Sequence[Observation],
    weights: Floats | None,
) -> Floats:
    """Logarithms of the errors of stretches predicted from the others in several ways, shape (stretches, ways).

    Each output counts by how well its stretch is predicted, in units of its noise.
    """
    if any(piece.rows == 0 for piece in pieces):
        raise InputError("a piece of the data holds no rows; leave it out")
    factors = np.ones(len(pieces[0].layout.outputs)) if weights is None else weights
    errors = np.zeros((len(pieces), len(solves)))
    for left, piece in enumerate(pieces):
        others = [other for k, other in enumerate(pieces) if k != left]
        triangle = reduce(Observation.__add__, others).combined(factors)
        for column, solve in enumerate(solves):
            rms = (
                factors
                * piece.misfits(solve(triangle))
                / np.sqrt(np.maximum(piece.counts, 1))
            )
            errors[left, column] = float(np.mean(np.log(np.maximum(rms, 1e-12))))
    return errors


def _advantage(
    problem: _Problem,
    weight: float,
    pieces: Sequence[Observation],
    weights: npt.ArrayLike | None,
) -> Advantage | None:
    """Advantage of physical values over least squares, by stretches; None for data in one piece."""
    if len(pieces) < 2:
        return None
    factors = None if weights is None else np.asarray(weights, dtype=float)
    ways = (least_squares, partial(_with_weight, problem.base_values, weight))
    plain, physical = _stretch_errors(ways, pieces, factors).T
    return Advantage.of_blocks(plain - physical)


def by_discrepancy(
    misfit: Callable[[float], float], triangle: Triangle, tried: Sequence[float]
) -> float:
    """The largest of some weights, in ascending order, that raises the misfit no more than the true parameters do."""
    r = len(triangle.parameters)
    variance = triangle.residual**2 / max(triangle.rows - r, 1)
    allowed = misfit(tried[0]) + r * variance
    return next(
        (weight for weight in reversed(tried[1:]) if misfit(weight) <= allowed),
        tried[0],
    )


PLAIN_WEIGHTS = (1e-3, 0.01, 0.1, 1.0)
"""Weights of the drawing towards a plain shape.  The first raises the misfit by less than a hundredth of what noise
does; the last moves a parameter that data tell to a share s of that body's own by s standard deviations at most."""


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
    """Fit the standard parameters of a robot that can exist."""
    if tuple(triangle.parameters) != tuple(base.pivots):
        raise InputError(
            "the triangle's columns are not the base parameters of this model"
        )
    problem = _Problem.of(base, triangle, bounds, prior)
    problem = replace(problem, plain=_plain_weight(problem, triangle))
    choice = _weight(problem, triangle, prior_weight, pieces, weights)
    standard, found = problem.solve(
        problem.matrix(triangle.R), triangle.qty, choice.weight
    )
    standard, step = put_inside(problem.programme, standard)
    unseen = _columns(base, Identifiability.UNIDENTIFIABLE)
    standard = at_rest(problem.programme, standard, unseen)
    values = problem.B @ standard
    programme, reached = problem.programme, problem.programme.margins(standard)
    names = [name for name, _ in programme.role.bodies]
    apart = (
        divergence(programme.role.blocks(standard), programme.reference.bodies)
        if names
        else np.zeros(0)
    )
    return PhysicalFit(
        parameters=base.parameters,
        units=tuple(column.unit for column in base.mechanism.columns),
        standard=standard,
        base=values,
        misfit=_misfit(triangle, values),
        unconstrained_misfit=_misfit(triangle, least_squares(triangle)),
        margins=dict(zip(names, map(float, reached), strict=True)),
        prior="" if prior is None else prior_name,
        prior_weight=choice.weight if prior is not None else 0.0,
        advantage=_advantage(problem, choice.weight, pieces, weights),
        status=found.message,
        diagnostics={
            "iterations": found.iterations,
            "active": active(programme, standard, problem.matrix(triangle.R)),
            "divergence": dict(zip(names, map(float, apart), strict=True)),
            "step_inside": step,
            "plain_weight": problem.plain,
            "prior_weight_reason": choice.reason,
            "prior_weight_scores": [list(score) for score in choice.scores],
            "findings": [str(finding) for finding in programme.reference.findings],
        },
    )


@dataclass(frozen=True)
class _Problem:
    B: Floats
    programme: Programme
    plain: float = PLAIN_WEIGHTS[0]  # weight of the drawing towards a plain shape

    @staticmethod
    def of(
        base: BaseModel,
        triangle: Triangle,
        bounds: Bounds | None,
        prior: npt.ArrayLike | None,
    ) -> _Problem:
        B = base.B_float()
        programme = Programme.of(
            base,
            triangle.R @ B,
            triangle.qty,
            bounds,
            prior,
            _told(base, triangle),
            _columns(base, Identifiability.COMBINATION),
        )
        if bounds is not None:
            interior_point(programme)
        return _Problem(B, programme)

    def matrix(self, R: Floats) -> Floats:
        return R @ self.B

    def solve(
        self, design: Floats, target: Floats, weight: float
    ) -> tuple[Floats, ConeSolution]:
        informed = self.programme.reference.informed
        weights = np.where(informed, max(weight, PLAIN_WEIGHTS[0]), self.plain)
        standard, found = self.programme.fit(design, target, weights, weight)
        # that bounds do not contradict each other was seen before
        if found.status != SOLVED:
            raise EchelonError(
                f"the solver found no physically consistent fit: {found.message}"
            )
        return standard, found

    def base_values(self, R: Floats, qty: Floats, weight: float) -> Floats:
        """Base parameters of the physical fit, shape (r,)."""
        return self.B @ self.solve(self.matrix(R), qty, weight)[0]


def _plain_weight(problem: _Problem, triangle: Triangle) -> float:
    """The largest weight of the plain shape that raises the misfit no more than the true parameters do on average."""
    if problem.programme.reference.informed.all():
        return PLAIN_WEIGHTS[0]
    design = problem.matrix(triangle.R)

    def misfit(plain: float) -> float:
        return _misfit(
            triangle,
            problem.B
            @ replace(problem, plain=plain).solve(design, triangle.qty, 0.0)[0],
        )

    return by_discrepancy(misfit, triangle, PLAIN_WEIGHTS)


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
            raise InputError(
                f"prior_weight is {given!r}; expected a number from 0 on, or 'auto'"
            )
        return WeightChoice(float(given), "given", ())
    if not known:
        return WeightChoice(0.0, "there is no prior", ())
    if len(pieces) > 1:
        return by_stretches(
            problem.base_values,
            pieces,
            None if weights is None else np.asarray(weights, dtype=float),
        )

    def misfit(weight: float) -> float:
        return _misfit(triangle, problem.base_values(triangle.R, triangle.qty, weight))

    reason = f"the largest weight that raises the misfit by no more than {len(triangle.parameters)} σ², as the true "
    return WeightChoice(
        by_discrepancy(misfit, triangle, CANDIDATES),
        f"{reason}parameters do on average",
        (),
    )


def _told(base: BaseModel, triangle: Triangle) -> dict[int, float]:
    """Magnitudes of standard parameters that are seen alone, where they are clear of noise, by column."""
    inverse, scale = np.linalg.pinv(triangle.scaled), triangle.safe_scales
    values = inverse @ triangle.qty / scale
    noise = (
        np.linalg.norm(inverse, axis=1)
        / scale
        * triangle.residual
        / np.sqrt(max(triangle.rows, 1))
    )
    alone = [base.classification[name] is Identifiability.ALONE for name in base.pivots]
    clear = np.flatnonzero(alone & (np.abs(values) > CLEAR * noise))
    return {base.matrix.pivots[k]: float(abs(values[k])) for k in clear}


def _columns(base: BaseModel, kind: Identifiability) -> frozenset[int]:
    """Columns of standard parameters of a kind."""
    seen = (base.classification[name] for name in base.parameters)
    return frozenset(k for k, how in enumerate(seen) if how is kind)


def _misfit(triangle: Triangle, values: Floats) -> float:
    return float(
        np.sum((triangle.R @ values - triangle.qty) ** 2) + triangle.residual**2
    )


KIND = "far from the prior"
FAR = 5.0
"""Ratio of masses or inertias from which on a body is far from its prior: files are rarely wrong by more, and motions
that show little of a body move it further."""


def departures(
    mechanism: Mechanism, standard: Floats, prior: Floats, weight: float
) -> list[Finding]:
    """Bodies whose mass or inertia about the centre of mass is more than five times off; nan is unknown."""
    role = roles(mechanism)
    triples = zip(role.bodies, role.blocks(prior), role.blocks(standard), strict=True)
    found = [
        text
        for (name, _), before, after in triples
        for text in _changes(name, before, after)
    ]
    if not found:
        return []
    body = found[0].split("'")[1]
    text = (
        f"identified bodies are more than {FAR:g} times off their prior: {enumerated(found, '; ')}. Data may "
        "hardly see them alone: state what you know under 'identification', as total_mass: [least, most] or "
        f"bodies: {{{body}: {{mass: [least, most]}}}}, or a prior: {{weight: …}} above {weight:.3g}"
    )
    return [warning(KIND, "", text)]


def _changes(name: str, before: Floats, after: Floats) -> Iterator[str]:
    if not (np.isfinite(before).all() and before[9] > 0 and after[9] > 0):
        return
    if _is_far(before[9], after[9]):
        yield f"'{name}' {after[9]:.3g} kg for {before[9]:.3g} kg"
    first, second = (_spread(values) for values in (before, after))
    if first > 0 and _is_far(first, second):
        yield f"'{name}' {second:.2g} kg·m² about its centre for {first:.2g} kg·m²"


def _is_far(before: float, after: float) -> bool:
    return not 1 / FAR <= after / before <= FAR


def _spread(values: Floats) -> float:
    """Largest moment of inertia about an axis through the centre of mass."""
    pseudo = pseudo_inertia(values)
    second = np.linalg.eigvalsh(
        pseudo[:3, :3] - np.outer(values[6:9], values[6:9]) / values[9]
    )
    return float(second[1] + second[2])
