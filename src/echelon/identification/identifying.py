"""From logs to a validated model: :func:`identify` is the job, its lines are the steps in their order."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from echelon.base import BaseModel, Identifiability, base_parameters
from echelon.formats import fixed_frames, slides, with_rotors
from echelon.identification.chosen_values import chosen_values
from echelon.identification.constants import Constant, Profile, started
from echelon.identification.current_fit import drive_gain_effects, gain_names
from echelon.identification.estimators.estimate import CLEAR
from echelon.identification.fit_findings import (
    contradictions,
    disagreements,
    fit_findings,
    limited,
)
from echelon.identification.fitting import (
    base_fit,
    physics,
    without_friction,
)
from echelon.identification.judge.findings import contradiction, finding
from echelon.identification.judge.hypothesis import Kind
from echelon.identification.judge.judge import Judged
from echelon.identification.judge.mounting import is_unknown, standing, with_gravity
from echelon.identification.judge.units import common_scale
from echelon.identification.judging import judged_fit, misread_elsewhere
from echelon.identification.logs.columns.column_guess import CURRENTS, are_currents
from echelon.identification.logs.finding import (
    Finding,
    counted,
    enumerated,
    note,
    warning,
)
from echelon.identification.passes_over_data import MEMORY, PassesOverData, Task
from echelon.identification.physics.fit import departures
from echelon.identification.physics.prior_information import known_before
from echelon.identification.plausible_mass import mass_findings
from echelon.identification.result import Identification, fitted_ranges, predicting
from echelon.identification.rows.plan import LogPlan
from echelon.identification.rows.travels import beyond, joined
from echelon.identification.scores import ROLES, Grade, Validation, grade
from echelon.identification.setup.logs import with_logs
from echelon.identification.setup.setup import Setup
from echelon.identification.surveying import survey
from echelon.identification.validation import Models
from echelon.identification.verdict import by_role, overall_verdict
from echelon.shared import InputError, one_thread, public

if TYPE_CHECKING:
    from distributed import Client


Logs = tuple[Path, ...]
OnStep = Callable[[str], None]

COMPLETIONS = 4
"""Completions of a set-up with what a fit says: gravity, delays, rotors, and what a rotor explains."""
_ROTOR = "a rotor inertia was added to the model at {}: unlike link inertia, it has no weight"
_ASSUMED_GRAVITY = (
    "the set-up does not state the direction of gravity: -z of the base was used"
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
    setup : Setup, path, model or sequence of Experiment
        A set-up, what :func:`load_setup` takes, or experiments with robots that state their effects.
    logs : path, dict of arrays, data frame, or several of them
        Logs that the model is fitted to; a directory stands for all logs in it.  Data frames are those of pandas or
        polars.  Positions and outputs may be in separate files: ``["positions.csv", "torques.csv"]``.  The name of a
        file tells its experiment, or a mapping does: ``{"wall": ["a.csv", "b.csv"]}``.
    validate_on : the same
        Logs that the fit does not see.  Without any, the last ones of several logs are held out, or the end of a single
        one (``setup.settings.holdout``); of experiments the ends of all logs.
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
    _check_gains(setup, given)
    step = on_step or (lambda _: None)
    lists = setup.states_effects
    mounted = not is_unknown(setup.mechanism)
    if setup.experiments and not mounted:
        raise InputError(
            "state gravity: of experiments its direction is not found",
            source=setup.source,
        )
    if not mounted:
        setup = replace(setup, mechanism=standing(setup.mechanism))

    def fit(setup: Setup) -> tuple[Identification, list[Judged]]:
        return _fitted(
            setup, given, others, client, step, memory, gravity_is_open=not mounted
        )

    remarks: list[Finding] = []
    result, judged = fit(setup)
    for _ in range(COMPLETIONS):
        completed, said = _completed(setup, result, judged, mounted=mounted and lists)
        if completed is setup:
            break
        step("completing the model from the logs")
        setup = completed
        remarks += said
        result, judged = fit(setup)
    if not mounted and not any(some.kind == "gravity" for some in remarks):
        against = any(some.gravity is not None for some in judged)
        remarks.append(
            note(
                "gravity",
                setup.source,
                _ASSUMED_GRAVITY + ", and the logs agree with it" * (not against),
            )
        )
    remarks += [finding(some, lists_effects=lists) for some in judged]
    return replace(result, findings=limited([*remarks, *result.findings]))


def _check_gains(setup: Setup, logs: Logs) -> None:
    """Refuse currents with unknown gains and nothing that is measured beside them: their equation has no scale."""
    gains = drive_gain_effects(setup.mechanism)
    if not gains or any(columns.outputs for columns in setup.columns):
        return
    log = logs[0].name if logs else "run.csv"
    problem = (
        "drive gains need something that is known, which identify does not take: in Python,  "
        f"ec.gains_from_logs({setup.source!r}, [{log!r}], known={{{gains[0]!r}: 0.12}})  takes a gain, N·m/A, or another "
        "parameter, and runs with a payload; to identify with known gains, name the currents under  output  with  scale"
    )
    raise InputError(problem, source=setup.source)


def _completed(
    setup: Setup, result: Identification, judged: Sequence[Judged], *, mounted: bool
) -> tuple[Setup, list[Finding]]:
    """The set-up with what nobody has stated and the logs say, and what is said of it.

    That is the inertia of rotors, delays of outputs if nothing else is wrong with the readings, and the direction of
    gravity if the robot is not ``mounted``.
    """
    lists = setup.states_effects
    for some in judged:
        if not mounted and some.gravity is not None and any(some.gravity):
            turned = with_gravity(setup.mechanism, np.array(some.gravity))
            return replace(setup, mechanism=turned), [
                finding(some, lists_effects=lists, taken=True)
            ]
    # a delay that is found after rotors that are lacking may be gone with them, so that they are taken in first
    rotors = [some for some in judged if some.kind is Kind.ROTOR]
    leading = [some.kind for some in judged if some.delays or some.kind is Kind.ROTOR]
    rotors_first = setup.usual and leading[:1] == [Kind.ROTOR]
    readings = [some for some in judged if some.kind not in (Kind.EFFECT, Kind.ROTOR)]
    if (
        readings
        and not rotors_first
        and setup.preparation.delays is None
        and not setup.experiments
        and all(some.delays for some in readings)
    ):
        preparation = setup.preparation.model_copy(
            update={"delays": readings[0].delays}
        )
        late = [finding(some, lists_effects=lists, taken=True) for some in readings]
        return replace(setup, preparation=preparation), late
    drives = {place for some in rotors for place in some.places}
    lifted = set() if setup.experiments else _lifted(result) - drives
    if not (drives or lifted) or not setup.usual:
        return setup, []
    said = [finding(some, lists_effects=lists, taken=True) for some in rotors]
    if lifted:
        said.append(note("rotor", "", _ROTOR.format(", ".join(sorted(lifted)))))
    # a robot has geared drives or not; a rotor that cannot be told from zero does no harm
    return setup.with_robot(with_rotors), said


def _lifted(result: Identification) -> set[str]:
    """Slides with a constant force that a rotor would explain: gravity acts along them, and not on its inertia."""
    mechanism, estimate = result.base.mechanism, result.estimate
    actions = [
        (effect.parameter, action)
        for effect in mechanism.effects
        for action in effect.actions
    ]
    rotors = {action.at for _, action in actions if action.kind == "rotor_inertia"}
    clear = dict(
        zip(
            estimate.parameters,
            np.abs(estimate.values) > CLEAR * estimate.std,
            strict=True,
        )
    )
    offsets = {
        a.at: name
        for name, a in actions
        if a.kind == "offset" and clear.get(name) and slides(mechanism, a.at)
        if a.at not in mechanism.springs
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
        base = base_parameters(started(setup.mechanism), seed=setup.seed)
        # of experiments the ends of all logs are held out, as each may have but one
        share = 0.0 if base.mechanism.experiments else settings.holdout
        fitted_logs, unseen_logs = _split_logs(given, others, share)
        surveyed = survey(setup, base, fitted_logs, unseen_logs)
        plan = LogPlan(
            base,
            setup.columns,
            surveyed.preparation,
            0.0 if unseen_logs else settings.holdout,
        )
        step(f"taking in {counted(len(fitted_logs), 'log')}")
        data = PassesOverData(plan, fitted_logs, client, memory)
        laws = Profile.of(data, setup.mechanism)
        if laws is not None:
            step("looking for constants of laws")
            base = base_parameters(laws.fitted(setup.mechanism), seed=setup.seed)
            plan = replace(plan, base=base)
            data = PassesOverData(plan, fitted_logs, client, memory)

        prior = known_before(base, setup.prior_in_experiments)
        prior_base = None if prior is None else prior.base_values(base)

        step("estimating")
        fit = base_fit(setup, data, surveyed.noisy, prior_base)
        constants: tuple[Constant, ...] = ()
        if laws is not None:
            constants, fit = laws.judged(fit, settings.level)
        estimate, conditions = fit.estimate, fit.conditions

        step("fitting a physical robot")
        physical, feasible, unsolved = physics(setup, data, fit, prior)

        step("validating")
        used, choice = chosen_values(
            settings, data, unseen_logs, estimate, fit.noise, physical
        )
        models = {"model": predicting(used, estimate, fit.reduced, physical)}
        models |= {} if prior_base is None else {"prior": prior_base}
        plain = without_friction(base, fit)
        models |= {} if plain is None else {"plain": plain}
        validations = _validations(data, models, unseen_logs)

        step("testing for errors of model and logs")
        is_far = feasible is not None and feasible.is_beyond(CLEAR)
        judgements = judged_fit(
            data,
            estimate.values,
            validations,
            prior,
            seed=setup.seed,
            is_contradicted=bool(unsolved) or is_far,
            gravity_is_open=gravity_is_open,
            frames=fixed_frames(setup.mechanism, setup.robot_file)
            if base.mechanism.cuts
            else {},
        )
        elsewhere = misread_elsewhere(data, models["model"], validations, unseen_logs)

    assumed = [text for text in setup.assumed if text != CURRENTS]
    findings = [note("assumed", setup.source, text) for text in assumed]
    if are_currents(setup.columns):
        findings.append(warning("currents", setup.source, CURRENTS))
    findings += [warning("outputs", setup.source, text) for text in setup.unmeasured]
    findings += [some.finding(settings.level) for some in constants]
    findings += [
        *surveyed.findings,
        *(() if prior is None else prior.findings),
        *unsolved,
        *elsewhere,
        *choice,
        *_beyond(base, validations),
    ]
    if physical is not None and prior is not None:
        findings += departures(
            base.mechanism, physical.standard, prior.values, physical.prior_weight
        )
    if prior_base is not None and not any(
        some.kind is Kind.UNIT for some in judgements.taken
    ):
        findings += common_scale(data.observation, prior_base)
    if conditions.is_complete and not gain_names(base):
        findings += mass_findings(base, estimate.values)
    findings += disagreements(
        base.mechanism.experiments, data.observation, estimate.values
    )
    facts = [
        *filter(None, map(contradiction, judgements.taken)),
        *contradictions(feasible, findings, plan.preparation.measured),
    ]
    findings += fit_findings(estimate, conditions, feasible, physical, validations)
    gaps = [] if conditions.is_complete else [conditions.verdict]
    judgement = overall_verdict(by_role(validations)[-1], facts, gaps)
    ranges = fitted_ranges(plan.preparation, by_role(validations)[0])
    speeds = [found.speeds for found in ranges if found.speeds != found.output]
    told = f": {enumerated(speeds, '; ')}" if speeds else ""
    fitted = f"It was fitted up to {ranges[0].band:.3g} Hz{told}."
    result = Identification(
        base=base,
        logs=tuple(map(str, fitted_logs)),
        preparation=plan.preparation,
        estimate=estimate,
        essential=fit.reduced,
        conditioning=conditions,
        feasibility=feasible,
        physical=physical,
        validations=validations,
        findings=limited(findings),
        predict_with=used,
        settings={**_record(setup, plan), "constants": list(map(asdict, constants))},
        judgement=replace(judgement, remarks=(*judgement.remarks, fitted)),
        hypotheses=tuple(judgements.told),
        untested=tuple(judgements.untested),
        experiments=setup.experiments,
    )
    return result, judgements.taken


def _split_logs(
    given: tuple[Path, ...], others: tuple[Path, ...], holdout: float
) -> tuple[tuple[Path, ...], tuple[Path, ...]]:
    """Logs that are fitted, and logs that are not."""
    if not given:
        raise InputError("no log is given to fit the model to")
    held = 0 if others or len(given) == 1 else round(holdout * len(given))
    return (given[:-held], given[-held:]) if held else (given, others)


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


def _beyond(base: BaseModel, validations: Sequence[Validation]) -> Iterator[Finding]:
    """Unseen logs that go far beyond the fitted ones; where they are predicted well, too, this is worth a note."""
    seen, unseen = (
        [some for some in validations if some.role == role] for role in ROLES
    )
    fitted = joined(travel for some in seen for travel in some.travels)
    for some in unseen:
        grades = [grade(score) for score in some.scores]
        carries_over = all(found is None or found is Grade.GOOD for found in grades)
        for text in beyond(base, fitted, some.travels):
            yield (note if carries_over else warning)("beyond", some.source, text)


def _record(setup: Setup, plan: LogPlan) -> dict[str, Any]:
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
