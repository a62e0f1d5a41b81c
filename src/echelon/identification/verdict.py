"""Verdict: scores in words.

Every sentence comes from a number and a threshold of :mod:`echelon.identification.scores`, so that the same scores give
the same words.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np

from echelon.identification.logs.finding import enumerated
from echelon.identification.rows.travels import joined
from echelon.identification.scores import (
    BETTER,
    HALF,
    OVERFIT,
    ROLES,
    UNEXPLAINED,
    Grade,
    Score,
    Validation,
    grade,
)


def pooled(validations: Sequence[Validation]) -> Validation:
    """Scores over all rows of several logs together; the traces stay with their logs."""
    first = validations[0]
    if len(validations) == 1:
        return first

    def summed(name: str) -> tuple[Score, ...]:
        of_outputs: dict[str, list[Score]] = {}
        for validation in validations:
            for score in getattr(validation, name):
                of_outputs.setdefault(score.output, []).append(score)
        return tuple(reduce(Score.__add__, some) for some in of_outputs.values())

    scores, prior, plain = map(summed, ("scores", "prior_scores", "plain_scores"))
    found = Validation(
        f"{len(validations)} logs together", first.role, scores, prior, plain
    )
    travels = joined(some for one in validations for some in one.travels)
    return replace(found, verdict=verdict(found), travels=travels)


def by_role(validations: Sequence[Validation]) -> tuple[Validation, ...]:
    """Scores over all logs that were fitted, and over all that were not, if there are any."""
    roles = ([v for v in validations if v.role == role] for role in ROLES)
    return tuple(pooled(found) for found in roles if found)


def verdict(validation: Validation, identification: Validation | None = None) -> str:
    """Verdict on a model by its scores on one log, and by those on the log that it was fitted to."""
    sentences = [_fit(validation.scores, _data(validation))]
    if all(score.is_at_rest for score in validation.scores):
        return sentences[0]  # of a robot at rest no residual says anything
    if identification is not None and validation.role == "validation":
        sentences += _carries_over(validation.scores, identification.scores)
    sentences += _against_prior(validation)
    sentences += _biased(validation.scores)
    return " ".join(sentences)


_NO_VERDICT = "no verdict"
_BADGES = {
    Grade.GOOD: "good",
    Grade.USABLE: "usable",
    Grade.POOR: "poor",
    Grade.USELESS: "do not use",
}


@dataclass(frozen=True)
class Judgement:
    """Verdict on a model by all logs together: a badge with one sentence, then reasons, then the rest."""

    badge: str  # good, usable, poor, do not use, or no verdict
    sentence: str  # how well the outputs are predicted
    gaps: tuple[str, ...] = ()  # low scores, and what the data leave open
    facts: tuple[str, ...] = ()  # what contradicts the model, however well it predicts
    remarks: tuple[str, ...] = ()  # further sentences, which are no reasons

    @property
    def reasons(self) -> tuple[str, ...]:
        """Reasons not to use the model; empty if nothing speaks against it."""
        silent = self.sentence.removesuffix(".")
        return (*([silent] if self.badge == _NO_VERDICT else []), *self.beside)

    @property
    def beside(self) -> tuple[str, ...]:
        """Reasons beside the sentence."""
        return *self.gaps, *self.facts

    @property
    def is_good(self) -> bool:
        """Whether nothing speaks against the model."""
        return not self.reasons

    @property
    def text(self) -> str:
        """The verdict in words."""
        first = self.sentence
        if self.facts and self.badge != _NO_VERDICT:
            first = f"{first.removesuffix('.')}: {'; '.join(self.facts)}."
        return " ".join([first, *self.remarks])


def overall_verdict(
    judged: Validation, facts: Sequence[str] = (), gaps: Sequence[str] = ()
) -> Judgement:
    """Verdict on a model by its scores on all logs together, by facts that contradict it, and by gaps of the data.

    All outputs are graded alike, by R² over all rows; only those of which nothing can be said are not graded, because
    no model could explain them.
    """
    told = [
        (score, found) for score in judged.scores if (found := grade(score)) is not None
    ]
    silent = _silent(judged.scores)
    if not told:
        text = f"No verdict on {_data(judged)} ({judged.source}): {_listed(silent)}"
        if not any(score.is_at_rest for score in judged.scores):
            noisy = any(score.is_below_noise for score in judged.scores)
            text = (
                "No verdict: no output varied"
                + " by more than its sensor's noise" * noisy
            )
        return Judgement(_NO_VERDICT, f"{text}.", tuple(gaps), tuple(facts))
    worst, lowest = min(told, key=lambda entry: (entry[1], entry[0].r2))
    sentences = [
        f"No verdict on {outputs}: {reason}." for reason, outputs in silent.items()
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
            f"Residuals of {outputs} are up to {most.by_noise:.2g} times the sensor noise: the model lacks an "
            "effect, and parameters may be further off than their intervals."
        )
    if judged.role != "validation":
        sentences.append("Check it on other data, which these logs do not include.")
    if judged.prior_scores and _total(judged.prior_scores, judged.scores) * BETTER < 1:
        sentences.append("The prior model predicts better.")
    low = [
        f"{score.output} has R² {score.r2:.3g}"
        for score, found in told
        if found < Grade.USABLE
    ]
    if low:
        gaps = [f"on {_data(judged)}, {', '.join(low)}", *gaps]
    # what speaks against a model beside its scores also speaks against good ones
    against = lowest >= Grade.USABLE and (gaps or facts)
    return Judgement(
        _BADGES[Grade.USELESS if against else lowest],
        _headline(lowest, worst, judged, facts),
        tuple(gaps),
        tuple(facts),
        tuple(sentences),
    )


_WORDS = {
    Grade.GOOD: "The model predicts every output well",
    Grade.USABLE: "The model is usable",
    Grade.POOR: "The model is poor for some outputs",
    Grade.USELESS: "The model cannot be trusted for some outputs",
}
_CONTRADICTED = "Do not use the model, despite its predictions"


def _headline(
    lowest: Grade, worst: Score, judged: Validation, facts: Sequence[str]
) -> str:
    """The first sentence: how well the worst output is predicted, and what contradicts the model."""
    raw = f", {worst.raw.r2:.4g} without a filter" if np.isfinite(worst.raw.r2) else ""
    words = _CONTRADICTED if facts and lowest >= Grade.USABLE else _WORDS[lowest]
    return (
        f"{words} on {_data(judged)}; the lowest R² is {worst.r2:.4g}, of {worst.output}{raw} "
        f"({judged.source})."
    )


def _data(judged: Validation) -> str:
    return "unseen data" if judged.role == "validation" else "the fitted data"


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
        return f"On {data} there is no verdict on {_listed(silent)}."
    text = f"On {data} the model predicts {'; '.join(parts)}."
    return f"{text} No verdict on {_listed(silent)}." if silent else text


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
    poor = {s.output for s in fitted if grade(s) is not None and _is_poor(s)}
    ratios = {
        s.output: s.rms / known[s.output]
        for s in scores
        if s.output in known and np.isfinite(s.rms)
    }
    worse = {name: ratio for name, ratio in ratios.items() if ratio > OVERFIT}
    if not ratios:
        return []
    if not worse:
        low = [s.output for s in scores if s.output in ratios and _is_poor(s)]
        wrong = [name for name in low if name in poor]
        if wrong:
            return [
                f"R² of {enumerated(wrong)} is low on the fitted data, too: an effect is missing, or columns are wrong."
            ]
        # residuals are no larger than where R² is higher
        why = (
            f"; R² of {enumerated(low)} is low because the output varies little here"
            if low
            else ""
        )
        return [
            f"Residuals are as small as on the fitted data: the model carries over{why}."
        ]
    shown = enumerated([f"{name} ({ratio:.2g} times)" for name, ratio in worse.items()])
    return [
        f"Residuals are larger than on the fitted data for {shown}: the model is overfitted, or these data show "
        "further effects."
    ]


def _is_poor(score: Score) -> bool:
    return (grade(score) or Grade.USELESS) < Grade.USABLE


def _against_prior(validation: Validation) -> list[str]:
    pairs = [
        (s.output, prior.rms / s.rms)
        for s, prior in zip(validation.scores, validation.prior_scores, strict=False)
        if s.rms > 0 and prior.rms > 0
    ]
    if not pairs:
        return []
    worse = [name for name, ratio in pairs if ratio * BETTER < 1]
    better = [name for name, ratio in pairs if ratio > BETTER]
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


def _biased(scores: Sequence[Score]) -> list[str]:
    found = [s for s in scores if s.rms > 0 and abs(s.bias) > HALF * s.rms]
    shown = (
        enumerated([f"{s.output} ({s.bias:.3g} {s.unit})" for s in found])
        if found
        else ""
    )
    if found:
        return [
            f"Residuals are biased for {shown}: an offset is missing or has drifted."
        ]
    return []


def _total(prior: Sequence[Score], scores: Sequence[Score]) -> float:
    """Geometric mean of the ratio of rms, prior to model: outputs of all units count alike."""
    pairs = zip(prior, scores, strict=True)
    ratios = [p.rms / s.rms for p, s in pairs if s.rms > 0 and p.rms > 0]
    return float(np.exp(np.mean(np.log(ratios)))) if ratios else 1.0


def _outputs(scores: Sequence[Score]) -> str:
    return enumerated([f"{s.output} (R² {s.r2:.4g})" for s in scores])
