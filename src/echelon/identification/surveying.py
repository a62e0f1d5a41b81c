"""Survey: a first look at the logs, from which everything is chosen that the set-up leaves open.

``first_look`` says what logs can show of a robot, and what is missing, before anything is fitted.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from math import isfinite
from pathlib import Path

from echelon.base import BaseModel, base_parameters
from echelon.identification.band import Noisy, with_band
from echelon.identification.conditioning import (
    DataConditioning,
    conditioning,
    without_rounding,
)
from echelon.identification.delays import with_delays
from echelon.identification.estimators.least_squares import noise_estimate
from echelon.identification.logs.columns.column_map import ColumnMap
from echelon.identification.logs.finding import Finding, counted, note, warning
from echelon.identification.logs.preparation.choices import Signals, chosen
from echelon.identification.logs.preparation.prepare import (
    Preparation,
    PreparationPlan,
    restricted,
)
from echelon.identification.logs.read_log import LogPiece, read_log
from echelon.identification.logs.recording import Samples, Segment
from echelon.identification.rows.plan import LogPlan
from echelon.identification.rows.rows import ModelRows
from echelon.identification.rows.travels import Travel, joined, travels_of
from echelon.identification.setup.setup import Setup
from echelon.robot import Mechanism
from echelon.shared import InputError

MOST_LOGS = 64  # logs that are looked at; of a long log, its first piece
# samples that choices are made from; faults are looked for in the first piece of every log
MOST_SAMPLES = 1 << 18


@dataclass(frozen=True)
class Survey:
    """Choices that a first look at the logs makes, and faults that it finds."""

    preparation: Preparation  # with every choice made
    findings: tuple[Finding, ...]
    noisy: Noisy | None = None  # bias of an estimate by noise of the positions


def survey(
    setup: Setup, base: BaseModel, paths: Sequence[Path], unseen: Sequence[Path] = ()
) -> Survey:
    """Look at the logs and choose what the set-up leaves open."""
    findings: list[Finding] = []
    looked: dict[str, tuple[Mechanism, list[Segment]]] = {}
    for path in paths[:MOST_LOGS]:
        piece = _first_piece(setup, path)
        findings += piece.findings
        _, segments = looked.setdefault(piece.experiment, (piece.mechanism, []))
        if sum(map(len, segments)) < MOST_SAMPLES:
            segments += piece.segments
    for path in unseen[:MOST_LOGS]:
        findings += _first_piece(setup, path).findings
    if max(len(paths), len(unseen)) > MOST_LOGS:
        text = f"only the first {MOST_LOGS} of {len(paths)} fitted logs and of {len(unseen)} others were examined"
        findings.append(note("survey", "", text))
    made: dict[str, Survey] = {}
    for name, (mechanism, segments) in looked.items():
        own = base.experiment(name) if name else base
        made[name] = _choices(setup, own, mechanism, segments)
        findings += made[name].findings
    if len(made) == 1 and "" in made:
        return replace(made[""], findings=tuple(findings))
    return Survey(
        _of_all({n: some.preparation for n, some in made.items()}), tuple(findings)
    )


def surveyed_plan(setup: Setup, paths: Sequence[Path]) -> tuple[LogPlan, Survey]:
    """How the logs of a set-up become rows of its base parameters, by a first look, and the look."""
    base = base_parameters(setup.mechanism, seed=setup.seed)
    found = survey(setup, base, paths)
    return LogPlan(base, setup.columns, found.preparation), found


def _of_all(made: Mapping[str, Preparation]) -> Preparation:
    """The preparation of several experiments, which shows the widest band."""
    widest = max(made.values(), key=lambda some: some.band or 0.0)
    reasons = {
        f"{setting} of {name}": text
        for name, some in made.items()
        for setting, text in some.reasons.items()
    }
    return widest.model_copy(update={"experiments": dict(made), "reasons": reasons})


def _choices(
    setup: Setup, base: BaseModel, mechanism: Mechanism, segments: Sequence[Segment]
) -> Survey:
    """Choices for the logs of one experiment; what needs a model of the outputs is left out where contacts touch."""
    stated, log = setup.preparation, Signals.of(segments, mechanism)
    if setup.experiments:
        stated = restricted(stated, mechanism)
    preparation, noisy = chosen(stated, log), None
    if mechanism.contacts:
        delays = stated.delays or {}
        preparation = preparation.model_copy(update={"delays": delays})
        return Survey(preparation, tuple(_short(preparation, segments, mechanism)))
    if stated.band is None:
        preparation, noisy = with_band(preparation, log, base)
    if noisy is not None and setup.experiments:
        noisy = replace(noisy, corrects=False)
    preparation = preparation.model_copy(update={"delays": stated.delays})
    preparation = with_delays(preparation, segments, base)
    findings = [] if noisy is None else [noisy.finding]
    findings += _short(preparation, segments, mechanism)
    return Survey(preparation, tuple(findings), noisy)


def _short(
    preparation: Preparation, segments: Sequence[Segment], mechanism: Mechanism
) -> list[Finding]:
    """Findings about stretches that filters leave nothing of."""
    short = [
        s
        for s in segments
        if PreparationPlan(preparation, mechanism, s.rate).is_short(s)
    ]
    if not short:
        return []
    needed = (
        PreparationPlan(preparation, mechanism, short[0].rate).needed / short[0].rate
    )
    lost = sum(len(segment) / segment.rate for segment in short)
    stretches = counted(len(short), "stretch is", "stretches are")
    text = f"{stretches} shorter than the {needed:.3g} s that filters need; left out ({lost:.3g} s in all)"
    return [warning("short", f"{short[0].source}, from {short[0].start:g} s", text)]


def _first_piece(setup: Setup, path: Path) -> LogPiece:
    piece = next(
        read_log(path, setup.mechanism, setup.columns, rate=setup.preparation.rate),
        None,
    )
    if piece is None:
        raise InputError("the log is empty", source=str(path))
    return piece


BEGINNING = 20_000  # samples of logs, on their own clocks, that show which parameters a motion excites


@dataclass(frozen=True)
class FirstLook:
    """A robot's logs before anything is fitted: how they are read, and which parameters they show."""

    base: BaseModel
    seconds: float  # of what was looked at
    # what the columns of each kind of log were taken for
    columns: tuple[ColumnMap, ...]
    survey: Survey
    travels: tuple[Travel, ...]
    conditioning: DataConditioning

    @property
    def missing(self) -> tuple[str, ...]:
        """Motions that would show what these logs do not, in sentences."""
        return tuple(direction.advice for direction in self.conditioning.weak)


def first_look(setup: Setup, paths: Sequence[Path]) -> FirstLook:
    """Look at the beginnings of logs."""
    plan, surveyed = surveyed_plan(setup, paths)
    base = plan.base
    samples = list(_beginnings(plan, paths))
    if not samples:
        raise InputError(
            "nothing of these logs is left after their preparation",
            source=", ".join(map(str, paths[:3])),
        )
    observation = without_rounding(
        ModelRows.of(base, samples).observation(), base.units
    )
    seen = conditioning(observation, 1 / noise_estimate(observation), base)
    seconds = sum(len(s) / s.rate for s in samples)
    travels = joined(_travels(base, samples))
    return FirstLook(base, seconds, setup.columns, surveyed, travels, seen)


def _beginnings(plan: LogPlan, paths: Sequence[Path]) -> Iterator[Samples]:
    left = BEGINNING
    for path in paths:
        for samples in islice(plan.samples(path), 1 + left // 100):
            if left > 0:
                yield samples
            left -= len(samples)
        if left <= 0:
            return


def _travels(base: BaseModel, samples: Sequence[Samples]) -> Iterator[Travel]:
    """Travels of coordinates that have a position, those of each experiment by its name."""
    rows = ModelRows.of(base, samples)
    for some in samples:
        prefix = f"{some.experiment}." if some.experiment else ""
        for travel in travels_of(rows.own(some).base.mechanism, some):
            if isfinite(travel.low):
                yield replace(travel, coordinate=prefix + travel.coordinate)
