"""From logs to a validated model: :func:`identify` is the job, its lines are the steps in their order."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from echelon.arrays import Floats, one_thread
from echelon.base.derive import base_parameters
from echelon.base.matrix import Identifiability
from echelon.base.model import BaseModel
from echelon.doors import public
from echelon.errors import EchelonError, InputError, MissingExtraError
from echelon.formats.usual_effects import slides, with_rotors
from echelon.identification.chosen_values import LEAST_SQUARES, chosen_values
from echelon.identification.conditioning import (
    Conditioning,
    conditioning,
    without_rounding,
)
from echelon.identification.current_fit import gain_names
from echelon.identification.estimators.essential import essential
from echelon.identification.estimators.estimate import Estimate, solved
from echelon.identification.estimators.fit import fitted, usable_noise
from echelon.identification.estimators.least_squares import minimum_norm, noise_estimate
from echelon.identification.judge.evidence import States
from echelon.identification.judge.findings import contradiction, finding
from echelon.identification.judge.hypothesis import Kind
from echelon.identification.judge.judge import Judge, Judged
from echelon.identification.judge.mounting import (
    free_gravity,
    is_unknown,
    standing,
    with_gravity,
)
from echelon.identification.judge.readings import Readings
from echelon.identification.judge.units import common_unit
from echelon.identification.passes_over_data import MEMORY, PassesOverData, Task
from echelon.identification.physics.bounds import Bounds
from echelon.identification.physics.feasibility import Feasibility, feasibility
from echelon.identification.physics.fit import PhysicalFit, departures, physical_fit
from echelon.identification.physics.prior_information import Prior, known_before
from echelon.identification.plausible_mass import mass_findings
from echelon.identification.result import (
    FAR,
    Identification,
    contradictions,
    fit_findings,
    fitted_ranges,
    limited,
    predicting,
)
from echelon.identification.rows.plan import Plan
from echelon.identification.scores import (
    UNEXPLAINED,
    Grade,
    Validation,
    by_role,
    grade,
    overall_verdict,
)
from echelon.identification.survey import survey
from echelon.identification.validation import Models
from echelon.logs.columns.column_map import ColumnMap
from echelon.logs.finding import Finding, counted, enumerated, note, warning
from echelon.logs.recording import Samples
from echelon.observe.observation import Observation
from echelon.setup.logs import with_logs
from echelon.setup.setup import Setup

if TYPE_CHECKING:
    from distributed import Client

    from echelon.formats.schema.schema_log import IdentificationEntry

Logs = tuple[Path, ...]
OnStep = Callable[[str], None]

Solved = TypeVar("Solved")

_PIECES = (
    5  # stretches of the data that are predicted from one another to weigh the prior
)
_CLEARLY = 5.0  # times a sensor's noise in the band, or an estimate's standard deviation, that is more than noise
_ROTOR = "a rotor inertia was taken in at {}: it weighs nothing, which else a constant force would have to explain"
_COMPLETIONS = (
    3  # of a set-up with what a fit says: gravity, rotors, and what a rotor explains
)
_ASSUMED_GRAVITY = "the direction of gravity was left open: -z of the base was taken"
_EXPLAINED = (
    1e-3  # share of an output's spread that is left at most where nothing is lacking
)


@public
def identify(
    setup: Any,
    logs: Any,
    validate_on: Any = (),
    *,
    client: Client | None = None,
    on_step: OnStep | None = None,
    memory: int = MEMORY,
) -> Identification:
    """Fit a robot's parameters to logs and validate the model.

    Parameters
    ----------
    setup : Setup, path or model
        A set-up, or what :func:`load_setup` takes.
    logs : path, dict of arrays, data frame, or several of them
        What the model is fitted to; a directory stands for all logs in it.  Data frames are those of pandas or polars.
        Files that hold positions only and outputs only are taken together: ``["positions.csv", "torques.csv"]``.
    validate_on : the same
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
    >>> result = ec.identify("arm.urdf", "log.csv")                                         # doctest: +SKIP
    """
    setup, given, others = with_logs(setup, logs, validate_on)
    step = on_step or (lambda _: None)
    lists = setup.states_effects
    mounted = not is_unknown(setup.mechanism)
    if not mounted:
        setup = replace(setup, mechanism=standing(setup.mechanism))

    def fit(setup: Setup) -> tuple[Identification, list[Judged]]:
        return _fitted(
            setup, given, others, client, step, memory, gravity_is_open=not mounted
        )

    remarks: list[Finding] = []
    result, judged = fit(setup)
    for _ in range(_COMPLETIONS):
        completed, said = _completed(setup, result, judged, mounted=mounted and lists)
        if completed is setup:
            break
        step("taking in what the logs say")
        setup = completed
        remarks += said
        result, judged = fit(setup)
    if not mounted and not any(some.kind == "gravity" for some in remarks):
        against = any(some.gravity is not None for some in judged)
        remarks.append(
            note(
                "gravity",
                setup.source,
                _ASSUMED_GRAVITY + ", and nothing speaks against it" * (not against),
            )
        )
    remarks += [finding(some, lists_effects=lists) for some in judged]
    return replace(result, findings=limited([*remarks, *result.findings]))


def _completed(
    setup: Setup, result: Identification, judged: Sequence[Judged], *, mounted: bool
) -> tuple[Setup, list[Finding]]:
    """The set-up with what nobody has stated and the logs say, and what is said of it.

    That is the inertia of rotors, and the direction of gravity if the robot is not ``mounted``.
    """
    lists, mechanism = setup.states_effects, setup.mechanism
    for some in judged:
        if not mounted and some.gravity is not None and any(some.gravity):
            turned = with_gravity(mechanism, np.array(some.gravity))
            return replace(setup, mechanism=turned), [
                finding(some, lists_effects=lists, taken=True)
            ]
    rotors = [some for some in judged if some.kind is Kind.ROTOR]
    drives = {place for some in rotors for place in some.places}
    lifted = _lifted(result) - drives
    if not (drives or lifted) or not setup.usual:
        return setup, []
    said = [finding(some, lists_effects=lists, taken=True) for some in rotors]
    said += (
        [note("rotor", "", _ROTOR.format(", ".join(sorted(lifted))))] if lifted else []
    )
    # a robot has geared drives or not; a rotor that cannot be told from zero does no harm
    return replace(setup, mechanism=with_rotors(mechanism)), said


def _lifted(result: Identification) -> set[str]:
    """Slides with a constant force that a rotor would explain: gravity acts along them, and not on its inertia."""
    mechanism, estimate = result.base.mechanism, result.estimate
    actions = [
        (effect.parameter, action)
        for effect in mechanism.effects
        for action in effect.actions
    ]
    rotors = {action.at for _, action in actions if action.term == "qdd"}
    clear = dict(
        zip(
            estimate.parameters,
            np.abs(estimate.values) > _CLEARLY * estimate.std,
            strict=True,
        )
    )
    offsets = {
        a.at: name
        for name, a in actions
        if a.term == "1" and clear.get(name) and slides(mechanism, a.at)
    }
    offsets = {at: name for at, name in offsets.items() if at not in rotors}
    if not offsets:
        return set()
    seen = base_parameters(with_rotors(mechanism, offsets)).classification
    return {
        at for at, name in offsets.items() if seen[name] is Identifiability.COMBINATION
    }


def _fitted(
    setup: Setup,
    given: Logs,
    others: Logs,
    client: Client | None,
    step: OnStep,
    memory: int,
    *,
    gravity_is_open: bool = False,
) -> tuple[Identification, list[Judged]]:
    """The model with the effects of a set-up, and hypotheses that explain what it leaves."""
    settings = setup.settings
    with one_thread():
        step("deriving the base parameters")
        base = base_parameters(setup.mechanism, seed=setup.seed)
        fitted_logs, unseen_logs = _split_logs(given, others, settings.holdout)
        surveyed = survey(setup, base, fitted_logs, unseen_logs)
        plan = Plan(
            base,
            setup.columns,
            surveyed.preparation,
            0.0 if unseen_logs else settings.holdout,
        )
        prior = known_before(base, setup.prior)
        prior_base = None if prior is None else prior.base_values(base)

        step(f"taking in {counted(len(fitted_logs), 'log')}")
        data = PassesOverData(plan, fitted_logs, client, memory)
        observation = without_rounding(data.observation, base.units)
        _check_rows(observation, fitted_logs)

        step("estimating")
        conditions = conditioning(observation, 1 / noise_estimate(observation), base)
        estimate = _estimate(settings, data, observation, conditions, prior_base)
        if (
            surveyed.noisy is not None
            and estimate.method in LEAST_SQUARES
            and not settings.known
        ):
            biased, estimate = estimate, surveyed.noisy.corrected(estimate)
            observation = observation.moved(estimate.values - biased.values)
        noise = usable_noise(observation, estimate)
        reduced = None
        if settings.essential != "none" and conditions.is_complete:
            alike, criterion = _correlation(estimate), settings.essential
            reduced = essential(
                observation, base.units, noise, criterion=criterion, correlation=alike
            )

        step("fitting a physical robot")
        unsolved: list[Finding] = []
        physical = feasible = None
        if settings.physical:
            physical = _tried(
                lambda: _physical(setup, data, observation, noise, prior), unsolved
            )
        if settings.physical and conditions.is_complete:
            feasible = _tried(
                lambda: _feasibility(base, observation, estimate, noise), unsolved
            )

        step("validating")
        used, choice = chosen_values(
            settings, data, unseen_logs, estimate, noise, physical
        )
        models = {"model": predicting(used, estimate, reduced, physical)}
        models |= {} if prior_base is None else {"prior": prior_base}
        plain = _without_friction(base, observation, noise)
        models |= {} if plain is None else {"plain": plain}
        validations = _validations(data, models, unseen_logs)
        step("judging what may be wrong or lacking")
        judged: list[Judged] = []
        told: list[Judged] = []
        doubtful = bool(unsolved) or _is_doubtful(validations, feasible)
        unit = (
            None if prior_base is None else common_unit(base, observation, prior_base)
        )
        if unit is not None or doubtful or _is_unexplained(by_role(validations)):
            judge = _judge(plan, data.fitted(), estimate.values, setup, prior)
            judge = replace(judge, doubtful=doubtful, gravity_is_open=gravity_is_open)
            judged = judge.run() if judge.is_told else []
            told = judge.told
        if unit is not None and not any(some.kind is Kind.READING for some in judged):
            judged, told = [unit, *judged], [unit, *told]
        elsewhere = _misread_elsewhere(
            setup, data, models["model"], validations, unseen_logs
        )

    findings = [note("assumed", setup.source, text) for text in setup.assumed]
    findings += [
        *surveyed.findings,
        *(() if prior is None else prior.findings),
        *unsolved,
    ]
    comparable = conditions.is_complete and not gain_names(base)
    findings += [*elsewhere, *choice]
    if physical is not None and prior is not None:
        findings += departures(
            base.mechanism, physical.standard, prior.values, physical.prior_weight
        )
    findings += mass_findings(base, estimate.values) if comparable else []
    facts = [
        *filter(None, map(contradiction, judged)),
        *contradictions(feasible, findings, plan.preparation.measured),
    ]
    findings += fit_findings(estimate, conditions, feasible, physical, validations)
    judgement = overall_verdict(by_role(validations)[-1], facts)
    ranges = fitted_ranges(plan.preparation, by_role(validations)[0])
    speeds = enumerated([found.speeds for found in ranges], "; ")
    result = Identification(
        base,
        tuple(map(str, fitted_logs)),
        plan.preparation,
        estimate,
        reduced,
        conditions,
        feasible,
        physical,
        validations,
        limited(findings),
        used,
        _record(setup, plan),
        f"{judgement.text} It was fitted up to {ranges[0].band:.3g} Hz: {speeds}.",
        (*judgement.reasons, *([] if conditions.is_complete else [conditions.verdict])),
        tuple(told),
    )
    return result, judged


def _split_logs(
    given: tuple[Path, ...], others: tuple[Path, ...], holdout: float
) -> tuple[tuple[Path, ...], tuple[Path, ...]]:
    """Logs that are fitted, and logs that are not."""
    if not given:
        raise InputError("no log is given to fit the model to")
    held = 0 if others or len(given) == 1 else round(holdout * len(given))
    return (given[:-held], given[-held:]) if held else (given, others)


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


def _estimate(
    settings: IdentificationEntry,
    data: PassesOverData,
    observation: Observation,
    conditions: Conditioning,
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


def _correlation(estimate: Estimate) -> float:
    """Rows that say as much as one: residuals that resemble their neighbours say less than their number."""
    inflation = [
        value
        for value in estimate.diagnostics.get("inflation", {}).values()
        if np.isfinite(value)
    ]
    return max(1.0, float(np.mean(inflation))) if inflation else 1.0


def _tried(solve: Callable[[], Solved], unsolved: list[Finding]) -> Solved | None:
    """What a solver finds; nothing but a finding where it gives up, as it may where data and physics contradict."""
    try:
        return solve()
    except (InputError, MissingExtraError):
        raise
    except EchelonError as error:
        unsolved.append(warning("physics", "", f"no physical robot was found: {error}"))
        return None


def _physical(
    setup: Setup,
    data: PassesOverData,
    observation: Observation,
    noise: Floats,
    prior: Prior | None,
) -> PhysicalFit:
    base, settings = data.plan.base, setup.settings
    weights, pieces = _weights(noise), data.pieces(_PIECES)
    return physical_fit(
        base,
        observation.combined(weights),
        bounds=_bounds(setup, base),
        prior=None if prior is None else prior.values,
        prior_weight=settings.prior.weight or "auto",
        prior_name="" if prior is None else prior.name,
        pieces=pieces if len(pieces) > 1 else (),
        weights=weights,
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
    bounds = Bounds(settings.bodies, limits, settings.total_mass)
    try:
        bounds.check(base.mechanism)
    except InputError as error:
        raise error.located(setup.source) from None
    return bounds


def _feasibility(
    base: BaseModel, observation: Observation, estimate: Estimate, noise: Floats
) -> Feasibility:
    """Distances are measured by the classical covariance of as many rows as are independent.

    That of batches of time has no more rank than there are batches.
    """
    covariance = (
        _correlation(estimate)
        * solved(observation, base.units, _weights(noise)).inverse
    )
    return feasibility(base, estimate.values, covariance)


def _weights(noise: Floats) -> Floats:
    return np.where(np.isfinite(noise), 1 / noise, 0.0)


def _without_friction(
    base: BaseModel, observation: Observation, noise: Floats
) -> Floats | None:
    """Base parameters of a model fitted without friction, offsets and springs, shape (r,); None if there are none."""
    mechanism = base.mechanism
    inertial = {
        e.parameter
        for e in mechanism.effects
        if all("qdd" in action.term for action in e.actions)
    }
    kept = [
        k
        for k, p in enumerate(base.matrix.pivots)
        if mechanism.columns[p].body is not None or mechanism.parameters[p] in inertial
    ]
    if not kept or len(kept) == base.rank:
        return None
    triangle = observation.select(kept).combined(_weights(noise))
    found = np.zeros(base.rank)
    found[kept] = (
        np.linalg.lstsq(triangle.scaled, triangle.qty, rcond=None)[0]
        / triangle.safe_scales
    )
    return found


def _is_doubtful(
    validations: Sequence[Validation], feasible: Feasibility | None
) -> bool:
    """Whether physics or predictions contradict the set-up, so that a mistake in it is looked for."""
    grades = [grade(score) for v in validations for score in v.scores]
    poor = any(found is not None and found < Grade.GOOD for found in grades)
    return poor or (
        feasible is not None and feasible.feasible is False and feasible.distance > FAR
    )


def _is_unexplained(validations: Sequence[Validation]) -> bool:
    """Whether more is left of some output than its sensor's noise, or than no model could explain."""
    fitted, judged = validations[0], validations[-1]
    above = any(score.by_noise > UNEXPLAINED for score in fitted.scores)
    return above or any(score.r2 < 1 - _EXPLAINED for score in judged.scores)


def _judge(
    plan: Plan,
    samples: Iterable[Samples],
    values: Floats,
    setup: Setup,
    prior: Prior | None,
) -> Judge:
    """A judge of what may be wrong with some logs, or lacking in a model with some base parameters."""
    base, preparation = plan.base, plan.preparation
    free, gravity = free_gravity(base, setup.seed)
    states = States.of(samples, preparation.band or np.inf, base, values, gravity)
    columns = setup.columns[0] if setup.columns else ColumnMap()
    readings = Readings(free, states, columns, "qd" in (preparation.measured or ()))
    return Judge(
        free,
        states,
        readings,
        prior=None if prior is None else prior.base_values(free, states.symbols),
    )


def _validations(
    data: PassesOverData, models: Models, unseen_logs: Sequence[Path]
) -> tuple[Validation, ...]:
    seen: list[Task] = [(path, "first", "identification") for path in data.paths]
    unseen: list[Task] = [(path, "all", "validation") for path in unseen_logs]
    if data.plan.holdout:
        unseen = [(path, "last", "validation") for path in data.paths]
    first = list(data.validations(models, seen))
    reference = first[0] if len(first) == 1 else None
    return (*first, *data.validations(models, unseen, reference))


def _misread_elsewhere(
    setup: Setup,
    data: PassesOverData,
    values: Floats,
    validations: Sequence[Validation],
    unseen_logs: Sequence[Path],
) -> list[Finding]:
    """Mistakes in logs that are predicted poorly, where the fitted ones are not."""
    fitted = by_role(validations)[0].scores
    found = []
    for log, validation in zip(
        unseen_logs, [v for v in validations if v.role == "validation"], strict=False
    ):
        grades = [
            (grade(seen), grade(unseen))
            for seen, unseen in zip(fitted, validation.scores, strict=True)
        ]
        told = [
            (seen, unseen)
            for seen, unseen in grades
            if seen is not None and unseen is not None
        ]
        if any(seen >= Grade.USABLE > unseen for seen, unseen in told):
            base, preparation = data.plan.base, data.plan.preparation
            states = States.of(
                data.samples(log, "all"), preparation.band or np.inf, base, values
            )
            columns = setup.columns[0] if setup.columns else ColumnMap()
            readings = Readings(
                base, states, columns, "qd" in (preparation.measured or ())
            )
            judge = Judge(base, states, readings, values=values)
            mistake = judge.other_reading()
            words = judge.other_load() if mistake is None else mistake[0].words
            if words is not None:
                kind = "changes" if mistake is None else "culprit"
                text = f"in this log, other than in those that were fitted, {words}"
                found.append(warning(kind, str(log), text))
    return found


def _record(setup: Setup, plan: Plan) -> dict[str, Any]:
    """Everything needed to repeat the run, JSON-able."""
    return {
        **setup.settings.model_dump(),
        "seed": setup.seed,
        "prior_weight": setup.settings.prior.weight,
        "setup": setup.source,
        "prior": None if setup.prior is None else setup.prior.name,
        "columns": [asdict(some) for some in setup.columns],
        "held_out": plan.holdout,
    }
