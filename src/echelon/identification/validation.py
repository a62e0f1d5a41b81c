"""Validation: measured against predicted outputs, on data the fit did not see.

One pass is enough, in memory that does not grow with the log: scores come from sums, which also pool those of several
logs, and of the traces a subset with all peaks is kept.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain, islice

import numpy as np
import numpy.typing as npt

from echelon.identification.autocorrelation import CorrelationSums
from echelon.identification.logs.preparation.prepare import speed_rows, velocity_names
from echelon.identification.logs.recording import Samples
from echelon.identification.rows.rows import (
    ModelRows,
    Numbering,
    prefetched,
    rows_filtered,
    rows_measured,
    rows_taken,
)
from echelon.identification.rows.travels import Travel, joined, travels_of
from echelon.identification.scores import (
    EMPTY,
    ROLES,
    Fit,
    Score,
    Trace,
    Validation,
    fits,
)
from echelon.identification.signals.spectrum import SHOWING, white_noise
from echelon.identification.traces import LIMIT, TraceKeeper
from echelon.identification.verdict import verdict
from echelon.robot import Mechanism
from echelon.shared import Flags, Floats, InputError

Models = Mapping[str, Floats]
"""Parameters of the models that are compared by name: the identified one first, then those of :data:`BESIDE`."""
BESIDE = ("prior", "plain")
"""What the identified model is compared with: the model before the fit, and one without friction, fitted alike."""
# samples of a stretch that tell the noise of its sensor, to a hundredth
NOISE_ORDER = 4  # of the differences that leave the noise of a sensor: motion is slow against its samples
_NAN = float("nan")


@dataclass(frozen=True)
class PredictedOutput:
    """Measured and predicted values of one output in a stretch of a log; models are columns."""

    times: Floats  # shape (k,), s
    measured: Floats  # shape (k,), after the filter of both sides
    predicted: Floats  # shape (k, models)
    moving: Flags  # shape (k,)
    # shapes (N,), (N,) and (N, models): times, measured and predicted without a filter
    raw: tuple[Floats, Floats, Floats] | None = None
    fastest: float = _NAN  # largest speed of its joint or drive, rad/s or m/s
    # shape (k,), filtered like both sides; None for a wrench
    speed: Floats | None = None


@dataclass(frozen=True)
class Predicted:
    """Measured and predicted outputs of one stretch of a log."""

    source: str
    segment: int  # counts uninterrupted stretches
    outputs: tuple[PredictedOutput, ...]


def predicted(
    model: ModelRows, samples: Iterable[Samples], values: Sequence[Floats]
) -> Iterator[Predicted]:
    """Outputs that models with given base parameters predict, beside those that were measured."""
    numbering = Numbering()
    for some in samples:
        if some.y is None:
            raise InputError("the log holds no measured outputs", source=some.source)
        outputs = tuple(_predicted(model, some, some.y, values))
        yield Predicted(some.source, numbering.of(some), outputs)


def _predicted(
    model: ModelRows, samples: Samples, y: Floats, values: Sequence[Floats]
) -> Iterator[PredictedOutput]:
    signals = np.stack([y, *(model.predict(samples, some) for some in values)], axis=2)
    samples, signals = model.free(samples, signals)
    times, rows, moving = rows_taken(samples, signals)
    inside, measured = slice(samples.first, samples.stop), rows_measured(samples)
    clock = samples.start + np.arange(len(samples))[inside] / samples.rate
    for i, speed in enumerate(_speeds(model.own(samples).base.mechanism, samples)):
        told = slice(None) if measured is None else measured[:, i]
        true = slice(None) if samples.pinned is None else ~samples.pinned[inside, i]
        mine = rows[told, i]
        yield PredictedOutput(
            times[told],
            mine[:, 0],
            mine[:, 1:],
            np.ones(len(mine), dtype=bool) if moving is None else moving[told, i],
            (clock[true], signals[inside, i, 0][true], signals[inside, i, 1:][true]),
            _NAN if speed is None else float(np.abs(speed).max(initial=0.0)),
            None if speed is None else rows_filtered(samples, speed[:, :1])[told, 0],
        )


def _speeds(mechanism: Mechanism, samples: Samples) -> Iterator[Floats | None]:
    """Speeds (N, joints or drives) of every output; None for a wrench."""
    names = velocity_names(mechanism, samples.q.shape[1])
    for output in mechanism.outputs:
        rows = speed_rows(mechanism, output, names)
        yield None if rows is None else samples.qd @ rows.T


def validated(
    model: ModelRows,
    samples: Iterable[Samples],
    models: Models,
    *,
    role: str,
    identification: Validation | None = None,
    limit: int = LIMIT,
) -> Validation:
    """Scores of models with given base parameters on prepared samples."""
    values = [_checked(model, some, name) for name, some in models.items()]
    travels: list[Travel] = []
    following = _watched(model, samples, travels)
    first = list(islice(following, 1))
    mechanism = model.base.mechanism
    outputs = [(output.name, output.unit) for output in mechanism.outputs]
    outputs = model.named(first[0]) if first else outputs
    samples = chain(first, following)
    # while one stretch is judged, the next is predicted, and the one after that is read
    signals = prefetched(predicted(model, prefetched(samples), values))
    found = validate(
        signals,
        outputs,
        tuple(models),
        role=role,
        identification=identification,
        limit=limit,
    )
    return replace(found, travels=tuple(travels))


def _watched(
    model: ModelRows, samples: Iterable[Samples], travels: list[Travel]
) -> Iterator[Samples]:
    """The samples, whose travels are noted as they pass."""
    for some in samples:
        mechanism = model.own(some).base.mechanism
        travels[:] = joined([*travels, *travels_of(mechanism, some)])
        yield some


def validate(
    signals: Iterable[Predicted],
    outputs: Sequence[tuple[str, str]],
    models: Sequence[str] = ("model",),
    *,
    role: str,
    identification: Validation | None = None,
    limit: int = LIMIT,
) -> Validation:
    """Compare measured and predicted outputs, which are given with their units."""
    if role not in ROLES:
        raise InputError(f"role is '{role}'; expected 'identification' or 'validation'")
    prior = models.index("prior") if "prior" in models else None
    tallies = [_Tally(len(models), prior, limit) for _ in outputs]
    sources: dict[str, None] = {}
    for some in signals:
        sources.setdefault(some.source)
        for output, tally in enumerate(tallies):
            tally.add(some.outputs[output], (some.source, some.segment))
    if not any(tally.whole[0].rows for tally in tallies):
        raise InputError(
            "no rows left to predict: filters, gaps or slow motion removed all"
        )
    named = list(zip(tallies, outputs, strict=True))
    scores = {
        name: tuple(t.score(k, *output) for t, output in named)
        for k, name in enumerate(models)
    }
    prior_scores, plain_scores = (scores.get(name, ()) for name in BESIDE)
    traces = tuple(tally.trace(*output) for tally, output in named)
    found = Validation(
        ", ".join(sources), role, scores[models[0]], prior_scores, plain_scores, traces
    )
    return replace(found, verdict=verdict(found, identification))


@dataclass
class _Tally:
    """Sums over one output's rows for the scores of every model, and a trace."""

    models: int
    prior: int | None
    limit: int
    whole: list[Fit] = field(init=False)
    moving: list[Fit] = field(init=False)
    raw: list[Fit] = field(init=False)

    def __post_init__(self) -> None:
        self.whole, self.moving, self.raw = ([EMPTY] * self.models for _ in range(3))
        self._noise, self._count, self._fastest = 0.0, 0, _NAN
        self._correlations = CorrelationSums()
        self._trace, self._raw_trace = TraceKeeper(self.limit), TraceKeeper(self.limit)

    def add(self, some: PredictedOutput, where: Hashable) -> None:
        """Take in an output's rows of a stretch, which has a name."""
        y = some.measured
        clock, raw, raw_predicted = some.raw or (y[:0], y[:0], some.predicted[:0])
        for sums, found in (
            (self.whole, fits(y, some.predicted)),
            (self.moving, fits(y[some.moving], some.predicted[some.moving])),
            (self.raw, fits(raw, raw_predicted)),
        ):
            sums[:] = map(Fit.__add__, sums, found)
        shown = [0] if self.prior is None else [0, self.prior]
        if np.isfinite(some.fastest):
            self._fastest = float(np.fmax(self._fastest, some.fastest))
        if len(raw) > NOISE_ORDER:
            self._noise += len(raw) * white_noise(raw[:SHOWING], NOISE_ORDER) ** 2
            self._count += len(raw)
        if len(y):
            self._correlations.add(some.times, y - some.predicted[:, 0], where)
            speed = np.full(len(y), _NAN) if some.speed is None else some.speed
            self._trace.add(
                np.column_stack([some.times, y, some.predicted[:, shown], speed])
            )
        self._raw_trace.add(np.column_stack([clock, raw, raw_predicted[:, shown]]))

    def score(self, model: int, output: str, unit: str) -> Score:
        """Score of a model; how white its residual is, is known of the first one."""
        noise = float(np.sqrt(self._noise / self._count)) if self._count else _NAN
        fits = (self.whole[model], self.moving[model], self.raw[model])
        found = Score(output, unit, *fits, noise, fastest=self._fastest)
        if model or not found.rows:
            return found
        correlations = self._correlations.result()
        return replace(
            found,
            correlation_time=correlations.time,
            whiteness=correlations.whiteness(),
        )

    def trace(self, output: str, unit: str) -> Trace:
        """Rows that are kept to look at."""
        columns = 3 if self.prior is None else 4
        kept, raw = self._trace.rows(columns + 1), self._raw_trace.rows(columns)
        found = _trace(output, unit, kept[:, :columns])
        speed = kept[:, columns]
        is_filtered = self.whole[0].rows != self.raw[0].rows
        return replace(
            found,
            speed=speed if np.isfinite(speed).any() else None,
            raw=_trace(output, unit, raw) if is_filtered and len(raw) else None,
        )


def _trace(output: str, unit: str, rows: Floats) -> Trace:
    """Times, measured and predicted values, and those of the prior model if there are any, as columns of rows."""
    return Trace(output, unit, *rows.T)


def _checked(model: ModelRows, values: npt.ArrayLike, name: str) -> Floats:
    found = np.asarray(values, dtype=float)
    n = len(model.layout.parameters)
    if found.shape != (n,) or not np.isfinite(found).all():
        problem = f"values of the {name} model have shape {found.shape}; expected {n} finite numbers, one per parameter"
        raise InputError(problem)
    return found
