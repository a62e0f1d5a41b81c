"""Validation: measured against predicted outputs, on data the fit did not see.

What counts is how well a model predicts, never how near its parameters are to others: data say nothing of what they
cannot see.  Nothing that was left out of the fit is left out of a score: all rows of the band that was fitted count,
and beside them are the rows that move, and all samples as they were measured, without any filter.

One pass is enough, in memory that does not grow with the log: scores come from sums, which also pool those of several
logs, and of the traces a subset with all peaks is kept.  Neighbouring rows form buckets, of which the rows with the
extremes of what is measured, of what is predicted and of their difference stay: every peak survives, at its time, and
no value is invented.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce

import numpy as np
import numpy.typing as npt

from echelon.arrays import Flags, Floats
from echelon.errors import InputError
from echelon.identification.correlation import CorrelationSums
from echelon.identification.rows.rows import ModelRows, Numbering, prefetched, rows_taken
from echelon.identification.verdict import verdict
from echelon.logs.preparation.prepare import speed_rows
from echelon.logs.preparation.states import velocity_names
from echelon.logs.recording import Samples
from echelon.mechanism.mechanism import Mechanism
from echelon.signals.spectrum import white_noise

LIMIT = 200_000
"""Rows of an output that are kept; more than any screen shows."""
_BUCKET = 12  # twice the six extremes that stay at most, so that a pass halves the rows at least


def thinned(rows: Floats) -> Floats:
    """Half of the rows or fewer, with all extremes; shape (at most k/2 + 6, columns)."""
    full = len(rows) // _BUCKET
    starts = _BUCKET * np.arange(full)
    signals = np.stack([rows[:, 1], rows[:, 2], rows[:, 1] - rows[:, 2]])
    buckets = signals[:, : _BUCKET * full].reshape(3, full, _BUCKET)
    places = [starts + pick(buckets, axis=2) for pick in (np.argmin, np.argmax)]
    rest = signals[:, _BUCKET * full :]
    if rest.shape[1]:
        places += [_BUCKET * full + pick(rest, axis=1) for pick in (np.argmin, np.argmax)]
    kept: Floats = rows[np.unique(np.concatenate([some.ravel() for some in places]))]
    return kept


class TraceKeeper:
    """Rows of one output, thinned evenly whenever they become too many."""

    def __init__(self, limit: int = LIMIT) -> None:
        self._limit = limit
        self._parts: list[Floats] = []
        self._count = self._passes = 0

    def add(self, rows: Floats) -> None:
        """Take in rows of shape (k, columns), thinned as often as those that are kept already."""
        for _ in range(self._passes):
            rows = thinned(rows)
        self._parts.append(rows)
        self._count += len(rows)
        while self._count > self._limit:
            whole = thinned(np.concatenate(self._parts))
            if len(whole) == self._count:  # nothing but extremes
                break
            self._parts, self._count, self._passes = [whole], len(whole), self._passes + 1

    def rows(self, columns: int) -> Floats:
        """What is kept, shape (k, columns)."""
        return np.concatenate(self._parts) if self._parts else np.zeros((0, columns))


ROLES = ("identification", "validation")
"""Whether the fit saw the data."""

Models = Mapping[str, Floats]
"""Parameters of the models that are compared by name: the identified one first, then those of :data:`BESIDE`."""
BESIDE = ("prior", "plain")
"""What the identified model is compared with: the model one had before, and one without friction, fitted alike."""


@dataclass(frozen=True)
class Trace:
    """One output of one log, after the filter of both sides."""

    output: str
    unit: str
    time: Floats  # shape (k,)
    measured: Floats  # shape (k,)
    predicted: Floats  # shape (k,)
    prior: Floats | None = None  # shape (k,); prediction of the model one had before


@dataclass(frozen=True)
class Fit:
    """How well a prediction fits some rows of an output."""

    rows: int
    rms: float  # root mean square of measured − predicted, unit of the output
    bias: float  # mean of measured − predicted
    mean: float  # of the measured values, as are the others
    deviation: float
    low: float
    high: float

    @property
    def r2(self) -> float:
        """Coefficient of determination 1 − Σ(y − ŷ)² / Σ(y − ȳ)²; nan where y is constant."""
        # a spread within rounding of a constant is none
        varies = self.deviation > 1e-12 * abs(self.mean)
        return 1 - (self.rms / self.deviation) ** 2 if varies else float("nan")

    @property
    def percent(self) -> float:
        """The root mean square in per cent of the range of the measured values."""
        return 100 * self.rms / (self.high - self.low) if self.high > self.low else float("nan")

    def __add__(self, other: Fit) -> Fit:
        """Of both sets of rows; merged without cancellation (Chan, Golub and LeVeque 1983)."""
        if not self.rows or not other.rows:
            return self if self.rows else other
        rows = self.rows + other.rows
        mine, its = self.rows / rows, other.rows / rows
        apart = (other.mean - self.mean) ** 2
        return Fit(
            rows,
            float(np.sqrt(mine * self.rms**2 + its * other.rms**2)),
            mine * self.bias + its * other.bias,
            mine * self.mean + its * other.mean,
            float(np.sqrt(mine * self.deviation**2 + its * other.deviation**2 + mine * its * apart)),
            min(self.low, other.low),
            max(self.high, other.high),
        )


_EXPLAINED = 1e-3  # what no fit to measured samples leaves: friction alone is less regular
_NOISELESS = 1e-4  # of an output's deviation: noise of the best sensors is ten times as large
_SHOWING_NOISE = 1 << 14  # samples of a stretch that tell the noise of its sensor
_ORDER = 4  # of the differences that leave the noise of a sensor: motion is slow against its samples
_NAN = float("nan")
EMPTY = Fit(0, *(_NAN,) * 6)


def fit(measured: Floats, predicted: Floats) -> Fit:
    """How well a prediction fits measured values, both of shape (k,)."""
    return fits(measured, predicted[:, None])[0]


def fits(measured: Floats, predicted: Floats) -> list[Fit]:
    """How well predictions of several models, shape (k, models), fit measured values of shape (k,)."""
    count, models = predicted.shape
    if not count:
        return [EMPTY] * models
    y = np.ascontiguousarray(measured)
    about = (float(y.mean()), float(y.std()), float(y.min()), float(y.max()))
    residuals = (y - predicted[:, k] for k in range(models))
    return [Fit(count, float(np.sqrt(e @ e / count)), float(e.mean()), *about) for e in residuals]


@dataclass(frozen=True)
class Score:
    """How well a prediction fits one output."""

    output: str
    unit: str
    whole: Fit  # all rows, after the filter of both sides
    moving: Fit  # those of them that move: what is fitted where dry friction makes rows near rest meaningless
    raw: Fit  # all samples as they were measured, without a filter
    noise: float = _NAN  # standard deviation of what is white in the measured samples: the noise of the sensor
    correlation_time: float = _NAN  # integrated autocorrelation time of the residual, s: how far it is from white
    whiteness: float = _NAN  # probability that white noise has autocorrelations this large (Ljung–Box)
    fastest: float = _NAN  # largest speed of its joint or actuator, rad/s or m/s; nan for a wrench

    @property
    def rows(self) -> int:
        """Rows after the filter of both sides."""
        return self.whole.rows

    @property
    def rms(self) -> float:
        """Root mean square of measured − predicted in all rows, unit of the output."""
        return self.whole.rms

    @property
    def percent(self) -> float:
        """The same in per cent of the range of the measured values."""
        return self.whole.percent

    @property
    def r2(self) -> float:
        """Coefficient of determination over all rows; nan where y is constant."""
        return self.whole.r2

    @property
    def bias(self) -> float:
        """Mean of measured − predicted in all rows."""
        return self.whole.bias

    @property
    def r2_without_bias(self) -> float:
        """R² of what is left when the mean of the residual is taken off, as an offset of the sensor would be."""
        return self.r2 if self.rms == 0 else 1 - (1 - self.r2) * (1 - (self.bias / self.rms) ** 2)

    @property
    def is_below_noise(self) -> bool:
        """Whether the output varies less than its sensor's noise, so that no model can explain it."""
        return self.whole.deviation < self.noise

    @property
    def is_computed(self) -> bool:
        """Whether the output is too good to be measured: without noise, and predicted before any filter."""
        # noise of exactly zero is that of steps, which a coarse sensor has
        return 0 < self.noise < _NOISELESS * self.raw.deviation and 1 - self.raw.r2 < _EXPLAINED

    def __add__(self, other: Score) -> Score:
        """Of the rows of two logs; of times and probabilities the worse."""
        whole, moving, raw = (getattr(self, name) + getattr(other, name) for name in ("whole", "moving", "raw"))
        weights = (self.raw.rows, other.raw.rows)
        noise = float(np.sqrt(np.average([self.noise**2, other.noise**2], weights=weights))) if any(weights) else _NAN
        time = float(np.fmax(self.correlation_time, other.correlation_time))
        white = float(np.fmin(self.whiteness, other.whiteness))
        fastest = float(np.fmax(self.fastest, other.fastest))
        return Score(self.output, self.unit, whole, moving, raw, noise, time, white, fastest)


@dataclass(frozen=True)
class Validation:
    """A model's predictions of one log, or of several."""

    source: str  # the log
    role: str  # ``"identification"`` or ``"validation"``: whether the fit saw it
    scores: tuple[Score, ...]  # of the model, one per output
    # of the model one had before, and of one that was fitted without friction; empty where there is none
    prior_scores: tuple[Score, ...] = ()
    plain_scores: tuple[Score, ...] = ()
    traces: tuple[Trace, ...] = ()
    verdict: str = ""  # in words

    def beside(self, output: str) -> dict[str, Score]:
        """Scores of the models that it is compared with, by their names."""
        both = {"prior": self.prior_scores, "plain": self.plain_scores}
        return {name: score for name, scores in both.items() for score in scores if score.output == output}


def pooled(validations: Sequence[Validation]) -> Validation:
    """Scores over all rows of several logs together; the traces stay with their logs."""
    first = validations[0]
    if len(validations) == 1:
        return first
    scores, prior, plain = (
        tuple(reduce(Score.__add__, scores) for scores in zip(*(getattr(v, name) for v in validations), strict=True))
        for name in ("scores", "prior_scores", "plain_scores")
    )
    found = Validation(f"{len(validations)} logs together", first.role, scores, prior, plain)
    return replace(found, verdict=verdict(found))


def by_role(validations: Sequence[Validation]) -> tuple[Validation, ...]:
    """Scores over all logs that were fitted, and over all that were not, if there are any."""
    roles = ([v for v in validations if v.role == role] for role in ROLES)
    return tuple(pooled(found) for found in roles if found)


@dataclass(frozen=True)
class Predicted:
    """Measured and predicted outputs of one stretch of a log; of each output an array, of models a column."""

    source: str
    segment: int  # counts uninterrupted stretches
    times: tuple[Floats, ...]  # shape (k_i,), s
    measured: tuple[Floats, ...]  # shape (k_i,), after the filter of both sides
    predicted: tuple[Floats, ...]  # shape (k_i, models)
    moving: tuple[Flags, ...]  # shape (k_i,)
    samples: tuple[tuple[Floats, Floats], ...] = ()  # shapes (N,) and (N, models): without a filter
    fastest: tuple[float, ...] = ()  # largest speeds, rad/s or m/s


def predicted(model: ModelRows, samples: Iterable[Samples], values: Sequence[Floats]) -> Iterator[Predicted]:
    """What models with given base parameters predict, beside what was measured."""
    numbering = Numbering()
    for some in samples:
        if some.y is None:
            raise InputError("the log holds no measured outputs", source=some.source)
        yield _predicted(model, some, some.y, values, numbering.of(some))


def _predicted(model: ModelRows, samples: Samples, y: Floats, values: Sequence[Floats], segment: int) -> Predicted:
    guesses = np.stack([model.predict(samples, some) for some in values], axis=2)
    times, measured, moving = rows_taken(samples, y)
    rows = np.stack([rows_taken(samples, guesses[:, :, k])[1] for k in range(len(values))], axis=2)
    inside, outputs = slice(samples.first, samples.stop), range(y.shape[1])
    flags = np.ones(measured.shape, dtype=bool) if moving is None else moving
    return Predicted(
        samples.source,
        segment,
        (times,) * len(outputs),
        tuple(measured.T),
        tuple(rows[:, i] for i in outputs),
        tuple(flags.T),
        tuple((y[inside, i], guesses[inside, i]) for i in outputs),
        tuple(_fastest(model.base.mechanism, samples)),
    )


def _fastest(mechanism: Mechanism, samples: Samples) -> Iterator[float]:
    """The largest speed that each output's joint or actuator has; nan for a wrench."""
    names = velocity_names(mechanism, samples.q.shape[1])
    for output in mechanism.outputs:
        rows = speed_rows(mechanism, output, names)
        yield _NAN if rows is None else float(np.abs(samples.qd @ rows.T).max(initial=0.0))


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
    outputs = tuple(zip(model.layout.outputs, model.output_units, strict=True))
    # while one stretch is judged, the next is predicted, and the one after that is read
    signals = prefetched(predicted(model, prefetched(samples), values))
    return validate(signals, outputs, tuple(models), role=role, identification=identification, limit=limit)


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
            tally.add(some, output)
    if not any(tally.whole[0].rows for tally in tallies):
        raise InputError("there are no rows to predict: filters, gaps or slow motion left nothing")
    named = list(zip(tallies, outputs, strict=True))
    scores = {name: tuple(t.score(k, *output) for t, output in named) for k, name in enumerate(models)}
    prior_scores, plain_scores = (scores.get(name, ()) for name in BESIDE)
    traces = tuple(tally.trace(*output) for tally, output in named)
    found = Validation(", ".join(sources), role, scores[models[0]], prior_scores, plain_scores, traces)
    return replace(found, verdict=verdict(found, identification))


@dataclass
class _Tally:
    """What is kept of one output's rows: sums for the scores of every model, and a trace."""

    models: int
    prior: int | None
    limit: int
    whole: list[Fit] = field(init=False)
    moving: list[Fit] = field(init=False)
    raw: list[Fit] = field(init=False)

    def __post_init__(self) -> None:
        self.whole, self.moving, self.raw = ([EMPTY] * self.models for _ in range(3))
        self._noise, self._count, self._fastest = 0.0, 0, _NAN
        self._correlations, self._trace = CorrelationSums(), TraceKeeper(self.limit)

    def add(self, some: Predicted, output: int) -> None:
        """Take in an output's rows of a stretch."""
        times, y, guesses, moving = (
            some.times[output],
            some.measured[output],
            some.predicted[output],
            some.moving[output],
        )
        raw, raw_guesses = some.samples[output] if some.samples else (y[:0], guesses[:0])
        for sums, found in (
            (self.whole, fits(y, guesses)),
            (self.moving, fits(y[moving], guesses[moving])),
            (self.raw, fits(raw, raw_guesses)),
        ):
            sums[:] = map(Fit.__add__, sums, found)
        if some.fastest:
            self._fastest = float(np.fmax(self._fastest, some.fastest[output]))
        if len(raw) > _ORDER:
            self._noise += len(raw) * white_noise(raw[:_SHOWING_NOISE], _ORDER) ** 2
            self._count += len(raw)
        if len(y):
            where: Hashable = (some.source, some.segment)
            self._correlations.add(times, y - guesses[:, 0], where)
            shown = [0] if self.prior is None else [0, self.prior]
            self._trace.add(np.column_stack([times, y, guesses[:, shown]]))

    def score(self, model: int, output: str, unit: str) -> Score:
        """Score of a model; how white its residual is, is known of the first one."""
        noise = float(np.sqrt(self._noise / self._count)) if self._count else _NAN
        fits = (self.whole[model], self.moving[model], self.raw[model])
        found = Score(output, unit, *fits, noise, fastest=self._fastest)
        if model or not found.rows:
            return found
        correlations = self._correlations.result()
        return replace(found, correlation_time=correlations.time, whiteness=correlations.whiteness())

    def trace(self, output: str, unit: str) -> Trace:
        """What is kept to look at."""
        kept = self._trace.rows(4 if self.prior is not None else 3)
        time, measured, predicted = kept[:, :3].T
        return Trace(output, unit, time, measured, predicted, None if self.prior is None else kept[:, 3])


def _checked(model: ModelRows, values: npt.ArrayLike, name: str) -> Floats:
    found = np.asarray(values, dtype=float)
    n = len(model.layout.parameters)
    if found.shape != (n,) or not np.isfinite(found).all():
        problem = f"values of the {name} model have shape {found.shape}; expected {n} finite numbers, one per parameter"
        raise InputError(problem)
    return found
