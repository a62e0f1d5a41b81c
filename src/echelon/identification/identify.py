"""From logs to a validated model, step by step: the steps of :func:`identify`.

Each step is a function of its own elsewhere in this package; what happens here is only their order, and what is said
about it.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from echelon.arrays import Floats
from echelon.base.derive import base_parameters
from echelon.base.model import BaseModel
from echelon.errors import InputError
from echelon.identification.conditioning import Excitation, excitation, without_rounding
from echelon.identification.estimators.essential import essential
from echelon.identification.estimators.estimate import Estimate, solved
from echelon.identification.estimators.fit import fitted, usable_noise
from echelon.identification.estimators.least_squares import minimum_norm, own_noise
from echelon.identification.passes_over_data import Passes
from echelon.identification.physics.feasibility import Feasibility, feasibility
from echelon.identification.physics.fit import PhysicalFit, physical_fit
from echelon.identification.physics.prior_information import Prior, prior_from
from echelon.identification.result import Identification, dampened, fit_findings
from echelon.identification.rows.ingest import MEMORY
from echelon.identification.rows.plan import Part, Plan
from echelon.identification.settings import Setup
from echelon.identification.setup import stated_bounds
from echelon.identification.survey import Survey, survey
from echelon.identification.validation import Validation
from echelon.identification.verdict import overall_verdict
from echelon.logs.files.open_log import log_paths
from echelon.logs.finding import Finding, Severity
from echelon.machine.threads import one_thread
from echelon.observe.observation import Observation

if TYPE_CHECKING:
    from distributed import Client

Paths = Sequence[str | os.PathLike[str]]
OnStep = Callable[[str], None]

_PIECES = 5
"""Stretches of the data that are predicted from one another to weigh the prior."""


def identify(
    setup: Setup,
    logs: Paths,
    validate_on: Paths = (),
    *,
    client: Client | None = None,
    on_step: OnStep | None = None,
    memory: int = MEMORY,
) -> Identification:
    """Fit a robot's parameters to logs and validate the model.

    Parameters
    ----------
    setup : Setup
        See :func:`load_setup`.
    logs : sequence of path
        What the model is fitted to; a directory stands for all logs in it.
    validate_on : sequence of path
        Logs that the fit does not see.  Without any, the last ones of several logs are held out, or the end of a single
        one (``setup.settings.holdout``).
    client : distributed.Client, optional
        Of a Dask cluster, over which the logs are spread.
    on_step : callable, optional
        Is told what is being done.
    memory : int
        Bytes of rows that are kept in this process, so that logs need not be read again to be predicted; what goes
        beyond is read twice, in constant memory.

    Returns
    -------
    Identification

    Raises
    ------
    InputError
        If a log cannot be read, is not one of this robot, or says too little; names file and column.

    Examples
    --------
    >>> import echelon as ec
    >>> setup = ec.load_setup("examples/logs/emps.yaml")
    >>> result = ec.identify(setup, ["DATA_EMPS.parquet"])                                  # doctest: +SKIP
    """
    with one_thread():
        return _Run(setup, logs, validate_on, client, on_step or (lambda _: None), memory).result()


@dataclass
class _Run:
    setup: Setup
    logs: Paths
    validate_on: Paths
    client: Client | None
    step: OnStep
    memory: int

    def result(self) -> Identification:
        self.step("deriving the base parameters")
        plan = self.plan
        self.step(f"taking in {len(self.fit_paths)} logs")
        observation = self.observation
        self._check_rows(observation)
        self.step("estimating")
        estimate = self.estimate
        noise = usable_noise(observation, estimate)
        essential_ = self._essential(noise)
        self.step("fitting a physical robot")
        physical = self._physical(noise)
        chosen = self._chosen(essential_, physical)
        self.step("validating")
        values = {"essential": essential_, "physical": physical}.get(chosen) or estimate
        validations = self._validations(values.base if isinstance(values, PhysicalFit) else values.values)
        feasible = self._feasibility(noise)
        findings = [Finding(Severity.NOTE, "assumed", self.setup.source, text) for text in self.setup.assumed]
        findings += [*self.survey.findings, *(() if self._prior is None else self._prior.findings)]
        findings += fit_findings(estimate, self.seen, feasible, physical, validations)
        return Identification(
            self.base,
            tuple(map(str, self.fit_paths)),
            plan.preparation,
            estimate,
            essential_,
            self.seen,
            feasible,
            physical,
            validations,
            dampened(findings),
            chosen,
            self._record(),
            overall_verdict(validations),
        )

    # -- what is fitted to what ------------------------------------------------------------------------------------

    @cached_property
    def base(self) -> BaseModel:
        return base_parameters(self.setup.mechanism, seed=self.setup.settings.seed)

    @cached_property
    def _paths(self) -> tuple[tuple[Path, ...], tuple[Path, ...]]:
        """Logs that are fitted, and logs that are not."""
        given = [path for log in self.logs for path in log_paths(log)]
        others = [path for log in self.validate_on for path in log_paths(log)]
        if not given:
            raise InputError("no log is given to fit the model to")
        held = round(self.setup.settings.holdout * len(given)) if not others else 0
        if held and len(given) > 1:
            return tuple(given[:-held]), tuple(given[-held:])
        return tuple(given), tuple(others)

    @property
    def fit_paths(self) -> tuple[Path, ...]:
        return self._paths[0]

    @cached_property
    def survey(self) -> Survey:
        return survey(self.setup, self.base, *self._paths)

    @cached_property
    def plan(self) -> Plan:
        found = self.survey
        holdout = 0.0 if self._paths[1] else self.setup.settings.holdout
        return Plan(self.base, self.setup.columns, found.preparation, holdout)

    @cached_property
    def passes(self) -> Passes:
        return Passes(self.plan, self.fit_paths, self.client, self.memory)

    @cached_property
    def observation(self) -> Observation:
        return without_rounding(self.passes.observation, self.base.units)

    @cached_property
    def pieces(self) -> list[Observation]:
        """The data in stretches of time."""
        return self.passes.pieces(_PIECES)

    def _check_rows(self, observation: Observation) -> None:
        """Refuse logs that nothing is left of, or that measured nothing."""
        if any(count and np.any(R[:, -1]) for count, R in zip(observation.counts, observation.factors, strict=True)):
            return
        problem = (
            "no row is left: 'still' is above all speeds" if not any(observation.counts) else "all outputs are zero"
        )
        raise InputError(problem, source=", ".join(map(str, self.fit_paths[:3])))

    # -- estimates -------------------------------------------------------------------------------------------------

    @cached_property
    def seen(self) -> Excitation:
        """What the data show, with outputs weighted by their own noise."""
        return excitation(self.observation, 1 / own_noise(self.observation), self.base)

    @cached_property
    def estimate(self) -> Estimate:
        settings = self.setup.settings
        if self.seen.rank < self.base.rank and settings.estimator != "ridge" and not settings.known:
            return minimum_norm(self.observation, self.base.units)
        passes = self.passes
        instruments = None
        if settings.estimator == "iv":
            instruments = self.plan.rows(self.fit_paths, "first", reference=True)
        return fitted(
            settings,
            passes.rows(),
            passes.observation,
            prior=self.prior_base,
            instruments=instruments,
            batches=passes.batches,
        )

    def _essential(self, noise: Floats) -> Estimate | None:
        criterion = self.setup.settings.essential
        if criterion == "none" or self.seen.rank < self.base.rank:
            return None
        # residuals that resemble their neighbours say less than their number
        inflation = [value for value in self.estimate.diagnostics.get("inflation", {}).values() if np.isfinite(value)]
        correlation = max(1.0, float(np.mean(inflation))) if inflation else 1.0
        return essential(self.observation, self.base.units, noise, criterion=criterion, correlation=correlation)

    # -- physics ---------------------------------------------------------------------------------------------------

    @cached_property
    def _prior(self) -> Prior | None:
        """Standard parameters that are believed beforehand."""
        setup = self.setup
        if setup.prior is not None:
            return prior_from(self.base, setup.prior)
        stated = np.array([np.nan if value is None else value for value in setup.mechanism.standard_values()])
        return None if np.isnan(stated).all() else Prior(setup.mechanism.name, stated, ())

    @cached_property
    def prior_base(self) -> Floats | None:
        """Base parameters of the prior model; unknown friction counts as none, unknown bodies make it useless."""
        if self._prior is None:
            return None
        inertial = [column.body is not None for column in self.base.mechanism.columns]
        values = self._prior.values
        return None if np.isnan(values[inertial]).any() else self.base.values(np.nan_to_num(values))

    def _physical(self, noise: Floats) -> PhysicalFit | None:
        settings = self.setup.settings
        if not settings.physical:
            return None
        weights = np.where(np.isfinite(noise), 1 / noise, 0.0)
        bounds = stated_bounds(self.setup, self.base)
        return physical_fit(
            self.base,
            self.observation.combined(weights),
            bounds=bounds,
            prior=None if self._prior is None else self._prior.values,
            prior_weight="auto" if settings.prior_weight is None else settings.prior_weight,
            prior_name="" if self._prior is None else self._prior.name,
            pieces=self.pieces if len(self.pieces) > 1 else (),
            weights=weights,
        )

    def _feasibility(self, noise: Floats) -> Feasibility | None:
        """Distances are measured by the classical covariance: that of batches of time has no more rank than batches."""
        if not self.setup.settings.physical or self.seen.rank < self.base.rank:
            return None
        solution = solved(self.observation, self.base.units, np.where(np.isfinite(noise), 1 / noise, 0.0))
        return feasibility(self.base, self.estimate.values, solution.inverse)

    def _chosen(self, essential_: Estimate | None, physical: PhysicalFit | None) -> str:
        wanted = self.setup.settings.predict
        if {"essential": essential_, "physical": physical}.get(wanted, self.estimate) is None:
            raise InputError(f"predictions shall use the {wanted} values, which were not computed: switch them on")
        return wanted

    # -- validation ------------------------------------------------------------------------------------------------

    def _validations(self, values: Floats) -> tuple[Validation, ...]:
        fit, others = self._paths
        seen: list[tuple[Path, Part, str]] = [(path, "first", "identification") for path in fit]
        unseen: list[tuple[Path, Part, str]] = [(path, "all", "validation") for path in others]
        if self.plan.holdout:
            unseen = [(path, "last", "validation") for path in fit]
        first = list(self.passes.validations(values, self.prior_base, seen))
        reference = first[0] if len(first) == 1 else None
        return (*first, *self.passes.validations(values, self.prior_base, unseen, reference))

    def _record(self) -> dict[str, Any]:
        """Everything needed to repeat the run, JSON-able."""
        setup = self.setup
        return {
            **asdict(setup.settings),
            "setup": setup.source,
            "prior": None if setup.prior is None else setup.prior.name,
            "columns": [asdict(columns) for columns in setup.columns or self.survey.columns],
            "held_out": self.plan.holdout,
        }
