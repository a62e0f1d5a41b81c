"""Fits of one run: base parameters by the set-up's estimator, a robot that can exist, and a model without friction."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from echelon.base import BaseModel, Identifiability
from echelon.compute import Observation
from echelon.identification.band import Noisy
from echelon.identification.chosen_values import LEAST_SQUARES
from echelon.identification.conditioning import (
    DataConditioning,
    conditioning,
    without_rounding,
)
from echelon.identification.estimators.essential import essential
from echelon.identification.estimators.estimate import Estimate, solved
from echelon.identification.estimators.fit import fitted, usable_noise
from echelon.identification.estimators.least_squares import (
    least_squares,
    minimum_norm,
    noise_estimate,
)
from echelon.identification.logs.finding import Finding, warning
from echelon.identification.passes_over_data import PassesOverData
from echelon.identification.physics.bounds import Bounds
from echelon.identification.physics.feasibility import Feasibility, feasibility
from echelon.identification.physics.fit import PhysicalFit, physical_fit
from echelon.identification.physics.prior_information import Prior
from echelon.identification.setup.setup import Setup
from echelon.robot import Mechanism, Side
from echelon.shared import EchelonError, Floats, InputError, MissingExtraError

if TYPE_CHECKING:
    from echelon.formats import IdentificationEntry

Solved = TypeVar("Solved")


STRETCHES = 5  # of the data, that are predicted from one another to weigh the prior: each still holds all motions


def _check_rows(observation: Observation, logs: Sequence[Path]) -> None:
    """Refuse logs that nothing is left of, or that measured nothing."""
    if any(
        count and np.any(R[:, -1])
        for count, R in zip(observation.counts, observation.factors, strict=True)
    ):
        return
    problem = (
        "no row is left: 'still' is above all speeds"
        if not any(observation.counts)
        else "all outputs are zero"
    )
    raise InputError(problem, source=", ".join(map(str, logs[:3])))


@dataclass(frozen=True)
class BaseFit:
    """Base parameters by the set-up's estimator, and the R-factors that they explain."""

    observation: Observation
    conditions: DataConditioning
    estimate: Estimate
    noise: Floats  # standard deviations of the outputs' residuals, shape (m,); infinite where unknown
    reduced: Estimate | None  # with the essential parameters only

    @property
    def weights(self) -> Floats:
        """Factors of the outputs' rows, shape (m,)."""
        return np.where(np.isfinite(self.noise), 1 / self.noise, 0.0)


def base_fit(
    setup: Setup, data: PassesOverData, noisy: Noisy | None, prior: Floats | None
) -> BaseFit:
    """The fit of base parameters; noise of the positions is corrected for where it biases."""
    settings, base = setup.settings, data.plan.base
    observation = without_rounding(data.observation, base.units)
    _check_rows(observation, data.paths)
    conditions = conditioning(observation, 1 / noise_estimate(observation), base)
    estimate = _estimate(settings, data, observation, conditions, prior)
    if noisy is not None and estimate.method in LEAST_SQUARES and not settings.known:
        biased, estimate = estimate, noisy.corrected(estimate)
        observation = observation.moved(estimate.values - biased.values)
    noise, reduced = usable_noise(observation, estimate), None
    if settings.essential != "none" and conditions.is_complete:
        alike, criterion = correlation(estimate), settings.essential
        reduced = essential(
            observation, base.units, noise, criterion=criterion, correlation=alike
        )
    return BaseFit(observation, conditions, estimate, noise, reduced)


def _estimate(
    settings: IdentificationEntry,
    data: PassesOverData,
    observation: Observation,
    conditions: DataConditioning,
    prior: Floats | None,
) -> Estimate:
    if (
        not conditions.is_complete
        and settings.estimator != "ridge"
        and not settings.known
    ):
        return minimum_norm(observation, data.plan.base.units)
    along_reference = settings.estimator == "iv"
    return fitted(
        settings,
        data.rows(),
        data.observation,
        prior=prior,
        instruments=data.plan.rows(data.paths, "first", reference=True)
        if along_reference
        else None,
        batches=data.batches,
    )


def correlation(estimate: Estimate) -> float:
    """Rows that say as much as one: residuals that resemble their neighbours say less than their number."""
    inflation = [
        value
        for value in estimate.diagnostics.get("inflation", {}).values()
        if np.isfinite(value)
    ]
    return max(1.0, float(np.mean(inflation))) if inflation else 1.0


def _tried(solve: Callable[[], Solved], unsolved: list[Finding]) -> Solved | None:
    """Result of a solver, or a finding where it gives up, as it may where data and physics contradict."""
    try:
        return solve()
    except (InputError, MissingExtraError):
        raise
    except EchelonError as error:
        unsolved.append(warning("physics", "", f"no physical robot was found: {error}"))
        return None


def physics(
    setup: Setup, data: PassesOverData, fit: BaseFit, prior: Prior | None
) -> tuple[PhysicalFit | None, Feasibility | None, list[Finding]]:
    """A robot that can exist, whether one has the estimated base parameters, and where solvers gave up."""
    unsolved: list[Finding] = []
    if not setup.settings.physical:
        return None, None, unsolved
    physical = _tried(lambda: _physical(setup, data, fit, prior), unsolved)
    feasible = (
        _tried(lambda: _feasibility(data.plan.base, fit), unsolved)
        if fit.conditions.is_complete
        else None
    )
    return physical, feasible, unsolved


def _physical(
    setup: Setup, data: PassesOverData, fit: BaseFit, prior: Prior | None
) -> PhysicalFit:
    base, pieces = data.plan.base, data.pieces(STRETCHES)
    return physical_fit(
        base,
        fit.observation.combined(fit.weights),
        bounds=_bounds(setup, base),
        prior=None if prior is None else prior.values,
        prior_weight=setup.settings.prior.weight or "auto",
        prior_name="" if prior is None else prior.name,
        pieces=pieces if len(pieces) > 1 else (),
        weights=fit.weights,
    )


def _bounds(setup: Setup, base: BaseModel) -> Bounds:
    """Bounds of the physical fit that a set-up states; known parameters that are seen alone are fixed."""
    settings = setup.settings
    alone = {
        name
        for name, seen in base.classification.items()
        if seen is Identifiability.ALONE
    }
    fixed = {
        name: (value, value) for name, value in settings.known.items() if name in alone
    }
    limits = {**fixed, **settings.parameters}
    added = [f"{e.name}.{load}" for e in setup.experiments for load in e.payloads]
    loads = frozenset((*setup.loads, *added))
    bodies = {
        _named(base.mechanism, name): entry for name, entry in settings.bodies.items()
    }
    bounds = Bounds(bodies, limits, settings.total_mass, loads)
    try:
        bounds.check(base.mechanism)
    except InputError as error:
        raise error.located(setup.source) from None
    return bounds


def _named(mechanism: Mechanism, name: str) -> str:
    """Name of a body in the first experiment that has it, by the name that its robot gives it."""
    bodies = {body.name for body in mechanism.bodies}
    places = [f"{experiment}.{name}" for experiment in mechanism.experiments]
    return next((place for place in places if place in bodies), name)


def _feasibility(base: BaseModel, fit: BaseFit) -> Feasibility:
    """Distances are measured by the classical covariance of as many rows as are independent.

    That of batches of time has no more rank than there are batches.
    """
    triangle = solved(fit.observation, base.units, fit.weights).triangle
    root = triangle.R / np.sqrt(correlation(fit.estimate))
    return feasibility(base, fit.estimate.values, root=root)


def without_friction(base: BaseModel, fit: BaseFit) -> Floats | None:
    """Base parameters of a model fitted without friction, offsets and springs, shape (r,); None if there are none.

    Zeros of sensors stay.
    """
    mechanism = base.mechanism
    inertial = {
        e.parameter
        for e in mechanism.effects
        if all(a.read.is_inertial or a.side is Side.OUTPUT for a in e.actions)
    }
    kept = [
        k
        for k, p in enumerate(base.matrix.pivots)
        if mechanism.columns[p].body is not None or mechanism.parameters[p] in inertial
    ]
    if not kept or len(kept) == base.rank:
        return None
    triangle = fit.observation.select(kept).combined(fit.weights)
    found = np.zeros(base.rank)
    found[kept] = least_squares(triangle)
    return found
