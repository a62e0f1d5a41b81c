"""Questions to the judge: possible errors of model and logs in a fit, in a log that was not fitted, or with a clock."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from echelon.base import base_parameters
from echelon.formats import FixedFrame
from echelon.identification.judge.evidence import States
from echelon.identification.judge.hypothesis import Kind
from echelon.identification.judge.judge import Judge, Judged
from echelon.identification.judge.mounting import free_gravity
from echelon.identification.judge.readings import Readings
from echelon.identification.judge.reversals import Reversals
from echelon.identification.judge.units import common_unit
from echelon.identification.logs.columns.column_map import ColumnMap
from echelon.identification.logs.columns.magnitudes import fitting_units
from echelon.identification.logs.finding import Finding, warning
from echelon.identification.logs.recording import Samples
from echelon.identification.passes_over_data import PassesOverData
from echelon.identification.physics.prior_information import Prior
from echelon.identification.rows.plan import LogPlan
from echelon.identification.scores import (
    EXPLAINED,
    UNEXPLAINED,
    USABLE,
    Grade,
    Validation,
    grade,
)
from echelon.identification.setup.setup import Setup
from echelon.identification.surveying import surveyed_plan
from echelon.identification.verdict import by_role
from echelon.shared import Floats

SETUP_ERROR = "setup error"
"""Kind of findings that name what a set-up has wrong."""

USUAL_RATES = (1.0, 1.2, 1.25, 1.5, 2.0, 2.4, 2.5, 3.0, 4.0, 5.0, 6.0, 7.5, 8.0, 10.0)
"""Rates at which robots are logged, in powers of ten."""

_SPIKED = 1.25
"""Rms of all samples without a filter, by the noise of the sensor, from which on something short is not modelled, such
as friction at reversals: it adds half of the squares of noise."""

RATE_ERROR = 0.02  # relative error up to which the judge finds a rate


def _judge(
    plan: LogPlan,
    samples: Iterable[Samples],
    values: Floats,
    *,
    seed: int | None = None,
    frames: Mapping[str, FixedFrame] | None = None,
    fastest: Mapping[str, float] | None = None,
) -> Judge:
    """A judge of prepared samples and base parameters; with a seed it may turn gravity.

    Friction near zero speed is judged at outputs whose ``fastest`` speeds are given, rad/s or m/s.
    """
    base, preparation = plan.base, plan.preparation
    free, gravity = (base, None) if seed is None else free_gravity(base, seed)
    still = preparation.still if isinstance(preparation.still, Mapping) else {}
    reversals = Reversals(base.mechanism, fastest, still) if fastest else None
    band = preparation.band or np.inf
    states = States.of(samples, band, base, values, gravity, reversals)
    columns = plan.columns[0] if plan.columns else ColumnMap()
    measured = "qd" in (preparation.measured or ())
    delays = preparation.delays or {}
    readings = Readings(free, states, columns, measured, delays, frames or {})
    return Judge(free, states, readings)


@dataclass(frozen=True)
class Judgements:
    """Hypotheses that a judge tested on a fit, and those that it could not test."""

    taken: list[Judged] = field(default_factory=list)  # what explains residuals
    told: list[Judged] = field(default_factory=list)  # those, and the next best
    untested: list[str] = field(
        default_factory=list
    )  # what could not be tested, and why


def judged_fit(
    data: PassesOverData,
    values: Floats,
    validations: Sequence[Validation],
    prior: Prior | None,
    *,
    seed: int,
    is_contradicted: bool,
    gravity_is_open: bool,
    frames: Mapping[str, FixedFrame],
) -> Judgements:
    """Hypotheses that explain what a fit with some base parameters leaves, and those beside them.

    A fit that leaves nothing is not judged, unless physics contradict it; one that leaves nothing but spikes is judged
    by its friction at reversals.  Axes of force/torque sensors may follow some
    ``frames``.
    """
    is_doubtful = is_contradicted or _is_poor(validations)
    is_asked = is_doubtful or _is_unexplained(by_role(validations))
    if not data.plan.rows([]).is_plain:
        parts = _parts(data, values, prior, seed) if is_asked else ()
        judgements = Judgements()
        for name, judge in parts:
            judge.doubtful = is_doubtful
            found = judge.run() if judge.is_told else []
            judgements.taken.extend(_in(name, some) for some in found)
            judgements.told.extend(_in(name, some) for some in judge.told)
            judgements.untested.extend(_of(name, some) for some in judge.untested)
        if is_asked:
            beside = ["friction at reversals", "axes of force/torque sensors"]
            judgements.untested.extend(beside if frames else beside[:1])
        return judgements
    base = data.plan.base
    guess = None if prior is None else prior.base_values(base)
    unit = None if guess is None else common_unit(base, data.observation, guess)
    if unit is not None and unit.places:
        # what one output in another unit leaves in all of them is judged when the set-up is mended
        return Judgements([unit], [unit])
    taken, told, untested = list[Judged](), list[Judged](), list[str]()
    only_reversals = not is_asked and unit is None
    if not only_reversals or _is_spiked(by_role(validations)):
        fastest = {
            score.output: score.fastest
            for score in by_role(validations)[0].scores
            if np.isfinite(score.fastest)
        }
        samples = data.fitted()
        judge = _judge(
            data.plan, samples, values, seed=seed, frames=frames, fastest=fastest
        )
        judge = replace(
            judge,
            doubtful=is_doubtful,
            only_reversals=only_reversals,
            gravity_is_open=gravity_is_open,
        )
        if prior is not None:
            judge.prior = prior.base_values(judge.base, judge.states.symbols)
        taken = judge.run() if judge.is_told else []
        told, untested = judge.told, judge.untested
    if unit is not None and not any(some.kind is Kind.READING for some in taken):
        taken, told = [unit, *taken], [unit, *told]
    return Judgements(taken, told, untested)


def _parts(
    data: PassesOverData, values: Floats, prior: Prior | None, seed: int
) -> Iterator[tuple[str, Judge]]:
    """Judges of experiments in which nothing touches, each with base parameters of its own."""
    base = data.plan.base
    if base.mechanism.contacts:
        return
    standard = dict(
        zip(base.parameters, np.linalg.pinv(base.B_float()) @ values, strict=True)
    )
    for name in base.mechanism.experiments:
        own = base_parameters(base.experiment(name).mechanism, seed=seed)
        columns = [some for some in data.plan.columns if some.experiment == name]
        plan = LogPlan(own, tuple(columns), data.plan.preparation.of(name))
        theirs = (s for s in data.fitted() if s.experiment == name)
        samples = (replace(s, experiment="") for s in theirs)
        start = own.B_float() @ [standard[p] for p in own.parameters]
        judge = _judge(plan, samples, start, seed=seed)
        if prior is not None:
            known = dict(zip(base.parameters, prior.values, strict=True))
            mine = np.array([known[p] for p in judge.base.parameters])
            judge.prior = replace(prior, values=mine).base_values(
                judge.base, judge.states.symbols
            )
        yield name, judge


def _in(experiment: str, judged: Judged) -> Judged:
    """A hypothesis that says of which experiment's logs it is."""
    return replace(judged, words=_of(experiment, judged.words))


def _of(experiment: str, words: str) -> str:
    return f"{words} (in the logs of '{experiment}')"


def _is_poor(validations: Sequence[Validation]) -> bool:
    """Whether some output of some log is not predicted well."""
    grades = [grade(score) for validation in validations for score in validation.scores]
    return any(found is not None and found < Grade.GOOD for found in grades)


def _is_unexplained(validations: Sequence[Validation]) -> bool:
    """Whether some output has more left than noise of its sensor, or than friction, which no model has exactly."""
    fitted, judged = validations[0], validations[-1]
    above = any(score.by_noise > UNEXPLAINED for score in fitted.scores)
    return above or any(score.r2 < 1 - EXPLAINED for score in judged.scores)


def _is_spiked(validations: Sequence[Validation]) -> bool:
    """Whether samples without a filter have more left than the noise of a sensor."""
    fitted = validations[0].scores
    return any(score.raw.rms > _SPIKED * score.noise for score in fitted)


def misread_elsewhere(
    data: PassesOverData,
    values: Floats,
    validations: Sequence[Validation],
    unseen_logs: Sequence[Path],
) -> list[Finding]:
    """Mistakes in logs that are predicted poorly, where the fitted ones are not."""
    if not data.plan.rows([]).is_plain:
        return []
    fitted = {score.output: grade(score) for score in by_role(validations)[0].scores}
    found = []
    for log, validation in zip(
        unseen_logs, [v for v in validations if v.role == "validation"], strict=False
    ):
        grades = [
            (fitted.get(unseen.output), grade(unseen)) for unseen in validation.scores
        ]
        told = [
            (seen, unseen)
            for seen, unseen in grades
            if seen is not None and unseen is not None
        ]
        if any(seen >= Grade.USABLE > unseen for seen, unseen in told):
            judge = _judge(data.plan, data.samples(log, "all"), values)
            judge.values = values
            mistake = judge.other_reading()
            words = judge.other_load() if mistake is None else mistake[0].words
            if words is not None:
                kind = "changes" if mistake is None else SETUP_ERROR
                text = f"in this log, unlike in the fitted ones, {words}"
                found.append(warning(kind, str(log), text))
    return found


def explained_rate(setup: Setup, logs: Sequence[Path]) -> float | None:
    """The samples per second of a log without a clock with which a robot that can exist explains its outputs.

    The set-up states another rate.  Gravity has no time in it and inertia its square, so that they tell the rate where
    they share parameters; None if nothing does, or if it is none at which robots are logged.
    """
    plan, _ = surveyed_plan(setup, logs)
    judge = _judge(plan, plan.samples(logs[0]), np.zeros(plan.base.rank))
    found = judge.other_reading(only_clock=True)
    columns = setup.columns[0]
    if found is None or columns.rate is None or found[0].after[0] > 1 - USABLE:
        return None
    rate = columns.rate * found[0].size
    ten = 10 ** np.floor(np.log10(rate))
    near = min(
        (ten * nice for nice in USUAL_RATES),
        key=lambda usual: abs(np.log(usual / rate)),
    )
    is_usual = abs(near / rate - 1) < RATE_ERROR and fitting_units(1 / near)[:1] == [
        "s"
    ]
    return float(near) if is_usual else None
