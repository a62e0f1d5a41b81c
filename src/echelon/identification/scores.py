"""Scores of a model's predictions, of one log or of several, and the verdict in words that follows from them.

What counts is how well a model predicts, never how near its parameters are to others: data say nothing of what they
cannot see.  Nothing that was left out of the fit is left out of a score: all rows of the band that was fitted count,
and beside them are the rows that move, and all samples as they were measured, without any filter.

Every sentence of a verdict comes from a number and a threshold below, so that the same scores give the same words.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import reduce

import numpy as np

from echelon.arrays import Floats
from echelon.logs.finding import enumerated

ROLES = ("identification", "validation")  # whether the fit saw the data

_EXPLAINED = (
    1e-3  # what no fit to measured samples leaves: friction alone is less regular
)
_NOISELESS = (
    1e-4  # of an output's deviation: noise of the best sensors is ten times as large
)
_NAN = float("nan")


@dataclass(frozen=True)
class Trace:
    """One output of one log, after the filter of both sides."""

    output: str
    unit: str
    time: Floats  # shape (k,)
    measured: Floats  # shape (k,)
    predicted: Floats  # shape (k,)
    prior: Floats | None = None  # shape (k,); prediction of the model one had before
    speed: Floats | None = (
        None  # shape (k,), rad/s or m/s; of the output's first joint or drive, None for wrenches
    )


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
        return (
            100 * self.rms / (self.high - self.low)
            if self.high > self.low
            else float("nan")
        )

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
    whiteness: float = (
        _NAN  # probability that white noise has autocorrelations this large (Ljung–Box)
    )
    fastest: float = (
        _NAN  # largest speed of its joint or actuator, rad/s or m/s; nan for a wrench
    )

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
        return (
            self.r2
            if self.rms == 0
            else 1 - (1 - self.r2) * (1 - (self.bias / self.rms) ** 2)
        )

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
            return "it varies less than the noise of the sensor"
        if self.is_at_rest and self.r2 < USABLE:
            return "its joint rests, where dry friction holds any force"
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
            0 < self.noise < _NOISELESS * self.raw.deviation
            and 1 - self.raw.r2 < _EXPLAINED
        )

    def __add__(self, other: Score) -> Score:
        """Of the rows of two logs; of times and probabilities the worse."""
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
    # of the model one had before, and of one that was fitted without friction; empty where there is none
    prior_scores: tuple[Score, ...] = ()
    plain_scores: tuple[Score, ...] = ()
    traces: tuple[Trace, ...] = ()
    verdict: str = ""  # in words

    def beside(self, output: str) -> dict[str, Score]:
        """Scores of the models that it is compared with, by their names."""
        both = {"prior": self.prior_scores, "plain": self.plain_scores}
        return {
            name: score
            for name, scores in both.items()
            for score in scores
            if score.output == output
        }


def pooled(validations: Sequence[Validation]) -> Validation:
    """Scores over all rows of several logs together; the traces stay with their logs."""
    first = validations[0]
    if len(validations) == 1:
        return first
    scores, prior, plain = (
        tuple(
            reduce(Score.__add__, scores)
            for scores in zip(*(getattr(v, name) for v in validations), strict=True)
        )
        for name in ("scores", "prior_scores", "plain_scores")
    )
    found = Validation(
        f"{len(validations)} logs together", first.role, scores, prior, plain
    )
    return replace(found, verdict=verdict(found))


def by_role(validations: Sequence[Validation]) -> tuple[Validation, ...]:
    """Scores over all logs that were fitted, and over all that were not, if there are any."""
    roles = ([v for v in validations if v.role == role] for role in ROLES)
    return tuple(pooled(found) for found in roles if found)


# -- verdicts ---------------------------------------------------------------------------------------------------------


GOOD = 0.98  # R² from which on a prediction is good: the residual's rms is below a seventh of the output's own spread
USABLE = 0.90  # R² from which on it is usable: below a third of the spread, less than friction usually is
OVERFIT = 1.5
"""Ratio of rms on unseen to fitted data from which on the model does not carry over: the squares have more than
doubled, beyond what noise and other motions do to a model that holds."""
BIAS = 0.5
"""Share of the rms from which on a bias is named: a quarter of the squares is a constant, which an offset would
remove."""
UNEXPLAINED = 3.0
"""Ratio of the rms to what noise of the sensor leaves from which on something is not modelled: noise of the positions
and filters do less."""
WHITE = 0.01  # probability below which a residual is not taken for white noise
PRIOR = 1.05
"""Ratio of rms from which on one model beats another: 5 % is more than preparation and noise usually change."""


class Grade(IntEnum):
    """How far a prediction can be used."""

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
    return (
        Grade.GOOD
        if score.r2 >= GOOD
        else Grade.USABLE
        if score.r2 >= USABLE
        else Grade.POOR
    )


def verdict(validation: Validation, identification: Validation | None = None) -> str:
    """What the scores of one log say."""
    sentences = [_fit(validation.scores, _data(validation))]
    if all(score.is_at_rest for score in validation.scores):
        return sentences[0]  # of a robot at rest no residual says anything
    if identification is not None and validation.role == "validation":
        sentences += _carries_over(validation.scores, identification.scores)
    sentences += _against_prior(validation)
    sentences += _left(validation.scores)
    return " ".join(sentences)


@dataclass(frozen=True)
class Judgement:
    """What all logs together say of a model."""

    text: str  # the verdict in words
    reasons: tuple[
        str, ...
    ]  # why the model should not be used; empty if nothing speaks against it


def overall_verdict(judged: Validation, facts: Sequence[str] = ()) -> Judgement:
    """What a model's scores on all logs together say, and facts that contradict it.

    All outputs are graded alike, by R² over all rows; only those of which nothing can be said are not graded, because
    no model could explain them.
    """
    told = [
        (score, found) for score in judged.scores if (found := grade(score)) is not None
    ]
    silent = _silent(judged.scores)
    if not told:
        text = f"Nothing can be said on {_data(judged)} ({judged.source}): {_listed(silent)}"
        if not any(score.is_at_rest for score in judged.scores):
            noisy = any(score.is_below_noise for score in judged.scores)
            text = (
                "Nothing can be said: no output varied"
                + " by more than its sensor's noise" * noisy
            )
        return Judgement(f"{text}.", (text, *facts))
    worst, lowest = min(told, key=lambda entry: (entry[1], entry[0].r2))
    sentences = [_headline(lowest, worst, judged, facts)]
    sentences += [
        f"Of {outputs} nothing can be said: {reason}."
        for reason, outputs in silent.items()
    ]
    if all(score.is_computed for score, _ in told):
        sentences.append("The outputs have no noise: they look computed, not measured.")
    unexplained = [score for score, _ in told if score.by_noise > UNEXPLAINED]
    if unexplained and not facts:
        most = max(unexplained, key=lambda score: score.by_noise)
        outputs = (
            "every output"
            if len(unexplained) == len(told) > 1
            else enumerated([s.output for s in unexplained])
        )
        sentences.append(
            f"What is left of {outputs} is up to {most.by_noise:.2g} times the noise of the sensor: something is not "
            "modelled, so parameters may be further off than their intervals say."
        )
    if judged.role != "validation":
        sentences.append("Without other data it stays open whether it carries over.")
    if judged.prior_scores and _total(judged.prior_scores, judged.scores) * PRIOR < 1:
        sentences.append("The prior model predicts better.")
    low = [
        f"{score.output} has R² {score.r2:.3g}"
        for score, found in told
        if found < Grade.USABLE
    ]
    return Judgement(
        " ".join(sentences),
        (*([f"on {_data(judged)}, {', '.join(low)}"] if low else []), *facts),
    )


_WORDS = {
    Grade.GOOD: "The model predicts every output well",
    Grade.USABLE: "The model is usable",
    Grade.POOR: "The model is poor for some outputs",
    Grade.USELESS: "The model cannot be trusted for some outputs",
}


def _headline(
    lowest: Grade, worst: Score, judged: Validation, facts: Sequence[str]
) -> str:
    """The first sentence: how well the worst output is predicted, and what contradicts the model."""
    raw = f", {worst.raw.r2:.4g} without a filter" if np.isfinite(worst.raw.r2) else ""
    text = f"on {_data(judged)}; the least is R² {worst.r2:.4g} of {worst.output}{raw} ({judged.source})"
    if not facts:
        return f"{_WORDS[lowest]} {text}."
    words = (
        "The model should not be used, whatever it predicts"
        if lowest >= Grade.USABLE
        else _WORDS[lowest]
    )
    return f"{words} {text}: {'; '.join(facts)}."


def _data(judged: Validation) -> str:
    return (
        "data that the fit did not see"
        if judged.role == "validation"
        else "the data it was fitted to"
    )


# -- sentences --------------------------------------------------------------------------------------------------------


def _fit(scores: Sequence[Score], data: str) -> str:
    words = {Grade.GOOD: "well", Grade.USABLE: "usably", Grade.POOR: "poorly"}
    graded = [(s, grade(s)) for s in scores]
    parts = []
    for level, word in words.items():
        some = [s for s, found in graded if found is level]
        if some and len(some) == len(scores) and len(scores) > 1:
            parts.append(f"all outputs {word} (R² from {min(s.r2 for s in some):.4g})")
        elif some:
            parts.append(f"{_outputs(some)} {word}")
    useless = [s for s, found in graded if found is Grade.USELESS]
    if useless:
        parts.append(f"{_outputs(useless)} worse than a constant would")
    silent = _silent(scores)
    if not parts:
        return f"On {data} nothing can be said of {_listed(silent)}."
    text = f"On {data} the model predicts {'; '.join(parts)}."
    return f"{text} Nothing can be said of {_listed(silent)}." if silent else text


def _silent(scores: Sequence[Score]) -> dict[str, str]:
    """Outputs of which nothing can be said, in words, by the reason."""
    found: dict[str, list[str]] = {}
    for score in scores:
        if score.silence:
            found.setdefault(score.silence, []).append(score.output)
    return {reason: enumerated(outputs) for reason, outputs in found.items()}


def _listed(silent: Mapping[str, str]) -> str:
    return "; ".join(f"{outputs}: {reason}" for reason, outputs in silent.items())


def _carries_over(scores: Sequence[Score], fitted: Sequence[Score]) -> list[str]:
    known = {s.output: s.rms for s in fitted if s.rms > 0}
    ratios = {
        s.output: s.rms / known[s.output]
        for s in scores
        if s.output in known and np.isfinite(s.rms)
    }
    worse = {name: ratio for name, ratio in ratios.items() if ratio > OVERFIT}
    if not ratios:
        return []
    if not worse:
        quiet = [
            s.output
            for s in scores
            if s.output in ratios and (grade(s) or Grade.USELESS) < Grade.USABLE
        ]
        why = (
            f"; R² of {enumerated(quiet)} is low because the output varies little here"
            if quiet
            else ""
        )
        return [f"Residuals are as on the data it was fitted to: it carries over{why}."]
    shown = enumerated([f"{name} ({ratio:.2g} times)" for name, ratio in worse.items()])
    return [
        f"Residuals are larger than on the data it was fitted to for {shown}: overfitted, or these data hold more."
    ]


def _against_prior(validation: Validation) -> list[str]:
    pairs = [
        (s.output, prior.rms / s.rms)
        for s, prior in zip(validation.scores, validation.prior_scores, strict=False)
        if s.rms > 0 and prior.rms > 0
    ]
    if not pairs:
        return []
    worse = [name for name, ratio in pairs if ratio * PRIOR < 1]
    better = [name for name, ratio in pairs if ratio > PRIOR]
    if not worse and not better:
        return ["It predicts like the prior model."]
    some = (
        "every output"
        if len(better) == len(pairs)
        else enumerated(better)
        if better
        else "no output"
    )
    text = f"It beats the prior model on {some}"
    return [text + (f", which is better on {enumerated(worse)}." if worse else ".")]


def _left(scores: Sequence[Score]) -> list[str]:
    found = []
    biased = [s for s in scores if s.rms > 0 and abs(s.bias) > BIAS * s.rms]
    if biased:
        shown = enumerated([f"{s.output} ({s.bias:.3g} {s.unit})" for s in biased])
        found.append(
            f"Residuals are biased for {shown}: an offset is missing or has drifted."
        )
    coloured = [s for s in scores if s.whiteness < WHITE]
    if coloured:
        longest = max(coloured, key=lambda s: s.correlation_time)
        who = (
            "any output"
            if len(coloured) == len(scores)
            else enumerated([s.output for s in coloured])
        )
        found.append(
            f"Residuals are not white for {who} (correlated over up to {longest.correlation_time:.2g} s): "
            "the model misses something, and intervals that take them for white are too narrow."
        )
    return found


def _total(prior: Sequence[Score], scores: Sequence[Score]) -> float:
    """Geometric mean of the ratio of rms, prior to model: outputs of all units count alike."""
    pairs = zip(prior, scores, strict=True)
    ratios = [p.rms / s.rms for p, s in pairs if s.rms > 0 and p.rms > 0]
    return float(np.exp(np.mean(np.log(ratios)))) if ratios else 1.0


def _outputs(scores: Sequence[Score]) -> str:
    return enumerated([f"{s.output} (R² {s.r2:.4g})" for s in scores])
