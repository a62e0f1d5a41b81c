"""Validation: measured against predicted outputs, on data the fit did not see.

To be looked at, measured and predicted outputs are thinned.  Neighbouring rows form buckets, of which the rows with the
extremes of what is measured, of what is predicted and of their difference stay: every peak survives, at its time, and
no value is invented.

What counts is how well a model predicts, never how near its parameters are to others: data say nothing of what they
cannot see.  One pass over the rows is enough, in memory that does not grow with the log: scores come from sums, and of
the traces a subset with all peaks is kept.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.identification.correlation import LAGS, CorrelationSums
from echelon.identification.rows.rows import RowBlock, Rows, ScoredRows
from echelon.identification.verdict import verdict

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


@dataclass(frozen=True)
class Trace:
    """One output of one log, after the filter of both sides.

    Attributes
    ----------
    output, unit : str
    time, measured, predicted : arrays of shape (k,)
    prior : array of shape (k,), optional
        Prediction of the model one had before.
    """

    output: str
    unit: str
    time: Floats
    measured: Floats
    predicted: Floats
    prior: Floats | None = None


@dataclass(frozen=True)
class Score:
    """How well a prediction fits one output.

    Attributes
    ----------
    output, unit : str
    rows : int
    rms : float
        Root mean square of measured − predicted, unit of the output.
    percent : float
        The same in per cent of the range of the measured values.
    r2 : float
        Coefficient of determination 1 − Σ(y − ŷ)² / Σ(y − ȳ)²; nan where y is constant.
    bias : float
        Mean of measured − predicted.
    correlation_time : float
        Integrated autocorrelation time of the residual, s: how far it is from white.
    whiteness : float
        Probability that white noise has autocorrelations this large (Ljung–Box).
    """

    output: str
    unit: str
    rows: int
    rms: float
    percent: float
    r2: float
    bias: float
    correlation_time: float
    whiteness: float

    @property
    def r2_without_bias(self) -> float:
        """R² of what is left when the mean of the residual is taken off, as an offset of the sensor would be."""
        return self.r2 if self.rms == 0 else 1 - (1 - self.r2) * (1 - (self.bias / self.rms) ** 2)


@dataclass(frozen=True)
class Validation:
    """A model's predictions of one log.

    Attributes
    ----------
    source : str
        The log.
    role : str
        ``"identification"`` or ``"validation"``: whether the fit saw it.
    scores : tuple of Score
        Of the model, one per output.
    prior_scores : tuple of Score
        Of the prior model on the same data; empty without one.
    traces : tuple of Trace
    verdict : str
        In words.
    moving : tuple of Score
        Of the model on the rows a fit takes, which are all but those near standstill, where friction has no direction.
    """

    source: str
    role: str
    scores: tuple[Score, ...]
    prior_scores: tuple[Score, ...]
    traces: tuple[Trace, ...]
    verdict: str
    moving: tuple[Score, ...]


def validate(
    rows: ScoredRows,
    values: npt.ArrayLike,
    *,
    role: str,
    prior_values: npt.ArrayLike | None = None,
    identification: Validation | None = None,
    limit: int = LIMIT,
    lags: int = LAGS,
) -> Validation:
    """Compare measured and predicted outputs."""
    if role not in ROLES:
        raise InputError(f"role is '{role}'; expected 'identification' or 'validation'")
    zeta = _checked(rows, values, "values")
    prior = None if prior_values is None else _checked(rows, prior_values, "prior_values")
    tallies = [_Tally(prior is not None, limit, lags) for _ in rows.layout.outputs]
    moving = [_Tally(False, 0, lags) for _ in rows.layout.outputs]
    sources: dict[str, None] = {}
    for block in rows.scored():
        sources.setdefault(block.source)
        fitted = block.fitted
        for output, columns in enumerate(rows.layout.columns):
            tallies[output].add(block, output, columns, zeta, prior)
            moving[output].add(fitted, output, columns, zeta, None)
    if not any(tally.count for tally in tallies):
        raise InputError("there are no rows to predict: filters, gaps or slow motion left nothing")
    outputs = list(zip(rows.layout.outputs, rows.output_units, strict=True))
    found = Validation(
        ", ".join(sources),
        role,
        tuple(tally.score(0, *output) for tally, output in zip(tallies, outputs, strict=True)),
        () if prior is None else tuple(tally.score(1, *output) for tally, output in zip(tallies, outputs, strict=True)),
        tuple(tally.trace(*output) for tally, output in zip(tallies, outputs, strict=True)),
        "",
        tuple(tally.score(0, *output) for tally, output in zip(moving, outputs, strict=True)),
    )
    return replace(found, verdict=verdict(found, identification))


class _Tally:
    """What is kept of one output's rows: sums for the scores of model and prior, and a trace."""

    def __init__(self, prior: bool, limit: int, lags: int) -> None:
        self.count = 0
        self._mean = self._spread = 0.0
        self._range = (np.inf, -np.inf)
        models = 2 if prior else 1
        self._squares, self._bias = np.zeros(models), np.zeros(models)
        self._correlations = [CorrelationSums(lags) for _ in range(models)]
        self._limit, self._trace = limit, TraceKeeper(limit)

    def add(self, block: RowBlock, output: int, columns: tuple[int, ...], values: Floats, prior: Floats | None) -> None:
        """Take in an output's rows of a block."""
        y, matrix, times = block.y[output], block.matrices[output], block.times[output]
        if not len(y):
            return
        chosen = list(columns)
        predicted = [matrix @ some[chosen] for some in (values, prior) if some is not None]
        self._measure(y)
        where: Hashable = (block.source, block.segment)
        for k, some in enumerate(predicted):
            residual = y - some
            self._squares[k] += residual @ residual
            self._bias[k] += residual.sum()
            self._correlations[k].add(times, residual, where)
        if self._limit:
            self._trace.add(np.stack([times, y, *predicted], axis=1))

    def _measure(self, y: Floats) -> None:
        """Mean and spread of what is measured, merged without cancellation (Chan, Golub and LeVeque 1983)."""
        k, mean = len(y), float(y.mean())
        total, apart = self.count + k, mean - self._mean
        self._spread += float(np.sum((y - mean) ** 2)) + apart**2 * self.count * k / total
        self._mean += apart * k / total
        self._range = (min(self._range[0], float(y.min())), max(self._range[1], float(y.max())))
        self.count = total

    def score(self, model: int, output: str, unit: str) -> Score:
        """Score of the model (0) or the prior (1)."""
        nan = float("nan")
        if not self.count:
            return Score(output, unit, 0, nan, nan, nan, nan, nan, nan)
        squares, found = float(self._squares[model]), self._correlations[model].result()
        rms = float(np.sqrt(squares / self.count))
        reach = self._range[1] - self._range[0]
        # a spread within rounding of a constant is none
        varies = self._spread > (1e-12 * self._mean) ** 2 * self.count
        return Score(
            output,
            unit,
            self.count,
            rms,
            100 * rms / reach if reach > 0 else nan,
            1 - squares / self._spread if varies else nan,
            float(self._bias[model]) / self.count,
            found.time,
            found.whiteness(),
        )

    def trace(self, output: str, unit: str) -> Trace:
        """What is kept to look at."""
        kept = self._trace.rows(2 + len(self._squares))
        return Trace(output, unit, kept[:, 0], kept[:, 1], kept[:, 2], kept[:, 3] if len(self._squares) > 1 else None)


def _checked(rows: Rows, values: npt.ArrayLike, name: str) -> Floats:
    found = np.asarray(values, dtype=float)
    n = len(rows.layout.parameters)
    if found.shape != (n,) or not np.isfinite(found).all():
        raise InputError(f"{name} have shape {found.shape}; expected {n} finite numbers, one for each parameter")
    return found
