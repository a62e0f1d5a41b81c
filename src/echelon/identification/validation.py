"""Validation: measured against predicted outputs, on data the fit did not see.

One pass is enough, in memory that does not grow with the log: scores come from sums, which also pool those of several
logs, and of the traces a subset with all peaks is kept.  Neighbouring rows form buckets, of which the rows with the
extremes of what is measured, of what is predicted and of their difference stay: every peak survives, at its time, and
no value is invented.

Autocorrelations of residuals are taken over pairs of rows that are really so far apart in time: rows that were left out
leave holes in the grid of samples, not shifts, and no pair reaches across the end of a segment.  The integrated
autocorrelation time 1 + 2 Σ ρ_k is summed up to the window that Sokal proposes, the first lag M that is at least five
times the time found so far (Sokal, "Monte Carlo methods in statistical mechanics", 1997).
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from echelon.arrays import Flags, Floats
from echelon.errors import InputError
from echelon.extras import extra
from echelon.identification.rows.rows import (
    ModelRows,
    Numbering,
    prefetched,
    rows_filtered,
    rows_measured,
    rows_taken,
)
from echelon.identification.scores import (
    EMPTY,
    ROLES,
    Fit,
    Score,
    Trace,
    Validation,
    fits,
    verdict,
)
from echelon.logs.preparation.prepare import speed_rows, velocity_names
from echelon.logs.recording import Samples
from echelon.mechanism.mechanism import Mechanism
from echelon.signals.spectrum import white_noise

Models = Mapping[str, Floats]
"""Parameters of the models that are compared by name: the identified one first, then those of :data:`BESIDE`."""
BESIDE = ("prior", "plain")
"""What the identified model is compared with: the model one had before, and one without friction, fitted alike."""
LIMIT = 200_000  # rows of an output that are kept; more than any screen shows
_SHOWING_NOISE = 1 << 14  # samples of a stretch that tell the noise of its sensor
_ORDER = 4  # of the differences that leave the noise of a sensor: motion is slow against its samples
_NAN = float("nan")


@dataclass(frozen=True)
class Predicted:
    """Measured and predicted outputs of one stretch of a log; of each output an array, of models a column."""

    source: str
    segment: int  # counts uninterrupted stretches
    times: tuple[Floats, ...]  # shape (k_i,), s
    measured: tuple[Floats, ...]  # shape (k_i,), after the filter of both sides
    predicted: tuple[Floats, ...]  # shape (k_i, models)
    moving: tuple[Flags, ...]  # shape (k_i,)
    samples: tuple[
        tuple[Floats, Floats], ...
    ] = ()  # shapes (N,) and (N, models): without a filter
    fastest: tuple[float, ...] = ()  # largest speeds, rad/s or m/s
    speeds: tuple[
        Floats | None, ...
    ] = ()  # shape (k_i,), filtered like both sides; None for wrenches


def predicted(
    model: ModelRows, samples: Iterable[Samples], values: Sequence[Floats]
) -> Iterator[Predicted]:
    """What models with given base parameters predict, beside what was measured."""
    numbering = Numbering()
    for some in samples:
        if some.y is None:
            raise InputError("the log holds no measured outputs", source=some.source)
        yield _predicted(model, some, some.y, values, numbering.of(some))


def _predicted(
    model: ModelRows,
    samples: Samples,
    y: Floats,
    values: Sequence[Floats],
    segment: int,
) -> Predicted:
    signals = np.stack([y, *(model.predict(samples, some) for some in values)], axis=2)
    times, rows, moving = rows_taken(samples, signals)
    inside, outputs = slice(samples.first, samples.stop), range(y.shape[1])
    speeds = list(_speeds(model.base.mechanism, samples))
    every = np.ones(rows.shape[:2], dtype=bool)
    flags = every if moving is None else moving
    measured = rows_measured(samples)
    told = every if measured is None else measured
    true = np.ones(y.shape, dtype=bool) if samples.pinned is None else ~samples.pinned
    return Predicted(
        samples.source,
        segment,
        tuple(times[told[:, i]] for i in outputs),
        tuple(rows[told[:, i], i, 0] for i in outputs),
        tuple(rows[told[:, i], i, 1:] for i in outputs),
        tuple(flags[told[:, i], i] for i in outputs),
        tuple(
            (y[inside, i][true[inside, i]], signals[inside, i, 1:][true[inside, i]])
            for i in outputs
        ),
        tuple(
            _NAN if some is None else float(np.abs(some).max(initial=0.0))
            for some in speeds
        ),
        tuple(
            None if some is None else rows_filtered(samples, some[:, :1])[told[:, i], 0]
            for i, some in enumerate(speeds)
        ),
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
    outputs = [(output.name, output.unit) for output in model.base.mechanism.outputs]
    # while one stretch is judged, the next is predicted, and the one after that is read
    signals = prefetched(predicted(model, prefetched(samples), values))
    return validate(
        signals,
        outputs,
        tuple(models),
        role=role,
        identification=identification,
        limit=limit,
    )


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
        raise InputError(
            "there are no rows to predict: filters, gaps or slow motion left nothing"
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
        raw, raw_guesses = (
            some.samples[output] if some.samples else (y[:0], guesses[:0])
        )
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
            speed = some.speeds[output] if some.speeds else None
            speeds = np.full(len(y), _NAN) if speed is None else speed
            self._trace.add(np.column_stack([times, y, guesses[:, shown], speeds]))

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
        """What is kept to look at."""
        kept = self._trace.rows(5 if self.prior is not None else 4)
        time, measured, predicted = kept[:, :3].T
        speed = kept[:, -1] if np.isfinite(kept[:, -1]).any() else None
        return Trace(
            output,
            unit,
            time,
            measured,
            predicted,
            None if self.prior is None else kept[:, 3],
            speed,
        )


def _checked(model: ModelRows, values: npt.ArrayLike, name: str) -> Floats:
    found = np.asarray(values, dtype=float)
    n = len(model.layout.parameters)
    if found.shape != (n,) or not np.isfinite(found).all():
        problem = f"values of the {name} model have shape {found.shape}; expected {n} finite numbers, one per parameter"
        raise InputError(problem)
    return found


# -- traces -----------------------------------------------------------------------------------------------------------


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
        places += [
            _BUCKET * full + pick(rest, axis=1) for pick in (np.argmin, np.argmax)
        ]
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
            self._parts, self._count, self._passes = (
                [whole],
                len(whole),
                self._passes + 1,
            )

    def rows(self, columns: int) -> Floats:
        """What is kept, shape (k, columns)."""
        return np.concatenate(self._parts) if self._parts else np.zeros((0, columns))


# -- autocorrelations -------------------------------------------------------------------------------------------------


LAGS = 4096  # largest lag; what correlates longer is reported as at least what is summed up to there
WINDOW = 5.0  # Sokal's window, in autocorrelation times: wide enough for little bias, narrow enough for little noise
PORTMANTEAU = 20  # lags of the test of whiteness; enough for resonances and hysteresis, few enough to keep its power


@dataclass(frozen=True)
class Correlations:
    """Autocorrelations of a residual, its mean removed."""

    step: float  # time between samples, s; nan with fewer than two rows
    rows: int
    variance: float
    values: Floats  # shape (lags + 1,); ρ_0 = 1, ρ_1, …; nan where no two rows are so far apart
    pairs: Floats  # shape (lags + 1,); how many pairs of rows each is the mean over

    @property
    def time(self) -> float:
        """Integrated autocorrelation time, s: the time between samples for white noise."""
        rho = self.values[1:]
        known = rho[: _first(~np.isfinite(rho))]
        if not np.isfinite(self.step):
            return float("nan")
        sums = 1 + 2 * np.cumsum(known)
        lags = np.arange(1, len(known) + 1)
        if not len(sums):
            return self.step
        window = min(_first(lags >= WINDOW * sums), len(sums) - 1)
        return float(max(sums[window], 0.0) * self.step)

    def whiteness(self, lags: int = PORTMANTEAU) -> float:
        """Probability that white noise has autocorrelations this large (Ljung and Box 1978)."""
        with extra("identify"):
            from scipy.stats import chi2

        rho, pairs = self.values[1 : lags + 1], self.pairs[1 : lags + 1]
        usable = (pairs > 0) & np.isfinite(rho)
        if not usable.any():
            return float("nan")
        # without holes pairs is rows − k and rho has been divided by pairs / rows: then this is N (N + 2) Σ r²/(N − k)
        statistic = (
            (self.rows + 2) / self.rows * np.sum(pairs[usable] * rho[usable] ** 2)
        )
        return float(chi2.sf(statistic, int(usable.sum())))


class CorrelationSums:
    """Sums from which autocorrelations follow, taken in block by block in constant memory."""

    def __init__(self, lags: int = LAGS) -> None:
        self._lags = lags
        self._sums = np.zeros(
            (4, lags + 1)
        )  # products, later ones, earlier ones, pairs
        self._total = self._squares = 0.0
        self._rows = 0
        self._step = float("nan")
        self._segment: Hashable = None
        self._last = float("nan")
        self._tail: Floats = np.zeros((2, 0))

    def add(self, times: Floats, values: Floats, segment: Hashable = 0) -> None:
        """Take in residuals that follow those before."""
        if not len(times):
            return
        follows = segment == self._segment and times[0] > self._last
        if not np.isfinite(self._step):
            gaps = np.diff(times) if not follows else np.diff(times, prepend=self._last)
            self._step = usual_step(gaps)
        self._total += float(values.sum())
        self._squares += float(values @ values)
        self._rows += len(values)
        for stretch, begins in self._stretches(times, values, follows):
            self._pair(stretch, begins)
        self._segment, self._last = segment, float(times[-1])

    def _stretches(
        self, times: Floats, values: Floats, follows: bool
    ) -> Iterator[tuple[Floats, bool]]:
        """Values and flags on a grid of samples, shape (2, samples), cut at holes that no lag reaches across."""
        if not np.isfinite(self._step):
            yield np.stack([values, np.ones_like(values)]), True
            return
        gaps = np.diff(times, prepend=self._last if follows else times[0] - self._step)
        # steps are rounded one by one, so that errors of time stamps do not add up
        steps = np.maximum(np.rint(gaps / self._step).astype(np.int64), 1)
        cuts = np.flatnonzero(steps > self._lags)
        for part in np.split(np.arange(len(times)), cuts):
            if not len(part):
                continue
            begins = bool(steps[part[0]] > self._lags) or (part[0] == 0 and not follows)
            places = (
                np.cumsum(
                    np.where(part == part[0], 1 if begins else steps[part], steps[part])
                )
                - 1
            )
            grid = np.zeros((2, int(places[-1]) + 1))
            grid[0, places], grid[1, places] = values[part], 1.0
            yield grid, begins

    def _pair(self, grid: Floats, begins: bool) -> None:
        """Add the pairs whose later member lies in a grid, the earlier one there or in the tail."""
        tail = np.zeros((2, 0)) if begins else self._tail
        whole = np.concatenate([tail, grid], axis=1)
        later = np.concatenate([np.zeros_like(tail), grid], axis=1)
        if whole[1].all():
            self._sums[:1] += _crossed(later[:1], whole[:1], self._lags)
            self._sums[1:] += _running(whole[0], tail.shape[1], self._lags)
        else:
            self._sums += _crossed(later, whole, self._lags)
        self._tail = whole[:, -self._lags :]

    def result(self) -> Correlations:
        """Autocorrelations of all that was taken in."""
        rows = self._rows
        mean = self._total / rows if rows else 0.0
        variance = max(self._squares / rows - mean**2, 0.0) if rows else 0.0
        products, later, earlier, pairs = self._sums
        pairs = np.rint(pairs)
        centred = products - mean * (earlier + later) + mean**2 * pairs
        with np.errstate(divide="ignore", invalid="ignore"):
            values: Floats = np.where(pairs > 0, centred / pairs / variance, np.nan)
        return Correlations(self._step, rows, variance, values, pairs)


def _crossed(later: Floats, earlier: Floats, lags: int) -> Floats:
    """Sums of products of every row of one array with every row of the other, earlier by 0 … lags places."""
    with extra("identify"):
        from scipy.fft import irfft, next_fast_len, rfft

    size = next_fast_len(later.shape[1] + lags + 1, real=True)
    products = rfft(later, size)[:, None] * np.conj(rfft(earlier, size))[None]
    return irfft(products.reshape(-1, products.shape[-1]), size)[:, : lags + 1]


def _running(whole: Floats, tail: int, lags: int) -> Floats:
    """Later values, earlier values and pairs where no row is missing: differences of running sums, shape (3, lags + 1).

    A pair's later member stands behind the tail.
    """
    total = np.append(0.0, np.cumsum(whole))
    lag = np.arange(lags + 1)
    begin, end = np.minimum(np.maximum(tail, lag), len(whole)), len(whole)
    earlier = total[np.maximum(end - lag, 0)] - total[begin - np.minimum(lag, begin)]
    return np.stack(
        [total[end] - total[begin], np.where(lag < end, earlier, 0.0), end - begin]
    )


def usual_step(gaps: Floats) -> float:
    """Time between samples where some are missing; the smallest gap up to rounding of time stamps, or nan."""
    positive = gaps[gaps > 0]
    return (
        float(np.median(positive[positive < 1.5 * positive.min()]))
        if len(positive)
        else float("nan")
    )


def _first(flags: npt.NDArray[np.bool_]) -> int:
    """Place of the first true flag, or their number."""
    found = np.flatnonzero(flags)
    return int(found[0]) if len(found) else len(flags)
