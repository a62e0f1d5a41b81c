"""Scores of a model's predictions, of one log or of several, and the grades that follow from them.

What counts is how well a model predicts, never how near its parameters are to others: data say nothing of what they
cannot see.  Nothing that was left out of the fit is left out of a score: all rows of the band that was fitted count,
and beside them are the rows that move, and all samples as they were measured, without any filter.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from echelon.identification.rows.travels import Travel
from echelon.shared import Floats

ROLES = ("identification", "validation")  # whether the fit saw the data

EXPLAINED = 1e-3
"""Share of an output's spread that every fit to measured samples leaves: friction alone is less regular."""

NOISELESS = 1e-4
"""Noise, by the deviation of an output, that no sensor has: the best have ten times as much."""

_NAN = float("nan")


@dataclass(frozen=True)
class Trace:
    """One output of one log, after the filter of both sides; or as it was measured, without it."""

    output: str
    unit: str
    time: Floats  # shape (k,)
    measured: Floats  # shape (k,)
    predicted: Floats  # shape (k,)
    prior: Floats | None = None  # shape (k,); prediction of the model before the fit
    # shape (k,), rad/s or m/s; of the output's first joint or drive, None for wrenches
    speed: Floats | None = None
    raw: Trace | None = None  # without the filter, where there is one


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
        if self.high > self.low:
            return 100 * self.rms / (self.high - self.low)
        return float("nan")

    def __add__(self, other: Fit) -> Fit:
        """Fit to both sets of rows; merged without cancellation (Chan, Golub and LeVeque 1983)."""
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
            float(
                np.sqrt(
                    mine * self.deviation**2
                    + its * other.deviation**2
                    + mine * its * apart
                )
            ),
            min(self.low, other.low),
            max(self.high, other.high),
        )


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
    return [
        Fit(count, float(np.sqrt(e @ e / count)), float(e.mean()), *about)
        for e in residuals
    ]


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
    # probability that white noise has autocorrelations this large (Ljung–Box)
    whiteness: float = _NAN
    # largest speed of its joint or actuator, rad/s or m/s; nan for a wrench
    fastest: float = _NAN

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
        """The root mean square in all rows in per cent of the range of the measured values."""
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
        if self.rms == 0:
            return self.r2
        return 1 - (1 - self.r2) * (1 - (self.bias / self.rms) ** 2)

    @property
    def is_below_noise(self) -> bool:
        """Whether the output varies less than its sensor's noise, so that no model can explain it."""
        return self.whole.deviation < self.noise

    @property
    def is_at_rest(self) -> bool:
        """Whether its joint never moves, so that dry friction or a brake holds whatever force there is."""
        return self.rows > 0 and self.moving.rows == 0

    @property
    def silence(self) -> str:
        """Why nothing can be said of the prediction; empty where something can."""
        if not np.isfinite(self.r2):
            return "it did not vary"
        if self.is_below_noise:
            return "it varies less than the sensor noise"
        if self.is_at_rest and self.r2 < USABLE:
            return "its joint rests, where dry friction hides the force"
        return ""

    @property
    def by_noise(self) -> float:
        """The rms by what the sensor's white noise leaves after the filter of both sides; nan where none is known."""
        left = self.noise * np.sqrt(self.rows / max(self.raw.rows, 1))
        return float(self.rms / left) if left > 0 else _NAN

    @property
    def is_computed(self) -> bool:
        """Whether the output is too good to be measured: without noise, and predicted before any filter."""
        # noise of exactly zero is that of steps, which a coarse sensor has
        return (
            0 < self.noise < NOISELESS * self.raw.deviation
            and 1 - self.raw.r2 < EXPLAINED
        )

    def __add__(self, other: Score) -> Score:
        """Score of the rows of two logs; times and probabilities are the worse ones."""
        whole, moving, raw = (
            getattr(self, name) + getattr(other, name)
            for name in ("whole", "moving", "raw")
        )
        weights = (self.raw.rows, other.raw.rows)
        noise = (
            float(np.sqrt(np.average([self.noise**2, other.noise**2], weights=weights)))
            if any(weights)
            else _NAN
        )
        time = float(np.fmax(self.correlation_time, other.correlation_time))
        white = float(np.fmin(self.whiteness, other.whiteness))
        fastest = float(np.fmax(self.fastest, other.fastest))
        return Score(
            self.output, self.unit, whole, moving, raw, noise, time, white, fastest
        )


@dataclass(frozen=True)
class Validation:
    """A model's predictions of one log, or of several."""

    source: str  # the log
    role: str  # ``"identification"`` or ``"validation"``: whether the fit saw it
    scores: tuple[Score, ...]  # of the model, one per output
    # of the model before the fit, and of one that was fitted without friction; empty where there is none
    prior_scores: tuple[Score, ...] = ()
    plain_scores: tuple[Score, ...] = ()
    traces: tuple[Trace, ...] = ()
    verdict: str = ""  # in words
    travels: tuple[Travel, ...] = ()  # how far and how fast coordinates went

    def beside(self, output: str) -> dict[str, Score]:
        """Scores of the models that it is compared with, by their names."""
        both = {"prior": self.prior_scores, "plain": self.plain_scores}
        return {
            name: score
            for name, scores in both.items()
            for score in scores
            if score.output == output
        }


# -- grades -----------------------------------------------------------------------------------------------------------


GOOD = 0.98
"""R² from which on a prediction is good: the residual's rms is below a seventh of the output's own spread."""

USABLE = 0.90
"""R² from which on a prediction is usable: below a third of the spread, less than friction usually is."""

OVERFIT = 1.5
"""Ratio of rms on unseen to fitted data from which on a model does not carry over: the squares have more than doubled,
beyond what noise and other motions do to a model that holds."""

HALF = 0.5
"""Share from which on something is most of what there is: a constant of the residual's rms, a model's R² of the outputs
in some band, or of a whole log."""

UNEXPLAINED = 3.0
"""Ratio of the rms to noise of the sensor in the band, from which on something is not modelled: noise of the positions
and filters do less."""

BETTER = 1.05
"""Ratio of rms from which on one model beats another: 5 % is more than preparation and noise usually change."""


class Grade(IntEnum):
    """Uses that a prediction is good for."""

    USELESS = 0
    POOR = 1
    USABLE = 2
    GOOD = 3


def grade(score: Score) -> Grade | None:
    """Grade of one output; None where nothing can be said of it."""
    if score.silence:
        return None
    if score.r2 <= 0:
        return Grade.USELESS
    if score.r2 >= GOOD:
        return Grade.GOOD
    if score.r2 >= USABLE:
        return Grade.USABLE
    return Grade.POOR
