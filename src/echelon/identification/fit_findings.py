"""Findings about a fit: its scores, its conditioning, and physics; and facts that contradict it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from echelon.compute import Observation
from echelon.identification.conditioning import DataConditioning
from echelon.identification.estimators.estimate import CLEAR, Estimate
from echelon.identification.estimators.least_squares import (
    least_squares,
    noise_estimate,
)
from echelon.identification.logs.finding import Finding, Severity, note, warning
from echelon.identification.physics.feasibility import Feasibility
from echelon.identification.physics.fit import PhysicalFit
from echelon.identification.scores import (
    HALF,
    NOISELESS,
    OVERFIT,
    UNEXPLAINED,
    Grade,
    Validation,
    grade,
)
from echelon.shared import Floats

IMPOSSIBLE = 30.0
"""Standard deviations to the nearest robot from which on the model contradicts physics: filters and unmodelled effects
do less."""


def contradictions(
    feasible: Feasibility | None,
    findings: Sequence[Finding],
    measured: Sequence[str] | None = (),
) -> list[str]:
    """Facts that contradict a model however well it predicts; rates do where they are taken as ``measured``."""
    facts = []
    if feasible is not None and feasible.is_beyond(IMPOSSIBLE):
        away = f"{feasible.distance:.2g} standard deviations away"
        facts.append(
            f"its parameters are unphysical: the nearest physical robot is {away}"
        )
    told = ("contradiction", "currents", *(("rates",) if measured else ()))
    facts += [str(finding) for finding in findings if finding.kind in told]
    return facts


def disagreements(
    experiments: Sequence[str], observation: Observation, values: Floats
) -> Iterable[Finding]:
    """Experiments whose logs base parameters of their own explain far better than the values of all experiments."""
    layout, noise = observation.layout, noise_estimate(observation)
    together = observation.misfits(values)
    sizes = [np.linalg.norm(factor[:, -1]) for factor in observation.factors]
    for name in experiments:
        own = np.array([output.startswith(f"{name}.") for output in layout.outputs])
        triangle = observation.combined(np.where(own, 1 / noise, 0.0))
        rows = sum(np.array(observation.counts)[own].tolist())
        if rows <= 2 * triangle.rank:
            continue
        alone = observation.misfits(least_squares(triangle))
        alone *= np.sqrt(rows / (rows - triangle.rank))
        for k in np.flatnonzero(own & (together > OVERFIT * alone)).tolist():
            if sizes[k] > 0 and together[k] > NOISELESS * sizes[k]:
                ratio = together[k] / max(alone[k], NOISELESS * sizes[k])
                kind = "contradiction" if ratio > UNEXPLAINED else "disagreement"
                text = (
                    f"the logs of '{name}' contradict those of other experiments: alone they leave {ratio:.2g} times "
                    f"smaller residuals of {layout.outputs[k]}; check gravity, payloads and locked joints of the "
                    "experiments, gains of their sensors, which log is of which experiment, and whether friction changed"
                )
                yield warning(kind, "", text)


def fit_findings(
    estimate: Estimate,
    seen: DataConditioning,
    feasible: Feasibility | None,
    physical: PhysicalFit | None,
    validations: Sequence[Validation],
) -> list[Finding]:
    """Findings about a fit: its scores, its conditioning, and physics."""
    return [
        *_of_scores(validations),
        *_of_estimate(estimate, seen),
        *_of_physics(feasible, physical, estimate, fits_well=all_usable(validations)),
    ]


def all_usable(validations: Iterable[Validation]) -> bool:
    """Whether all scores are usable, so that what is left of physics may be noise."""
    grades = [grade(score) for some in validations for score in some.scores]
    return all(some is None or some >= Grade.USABLE for some in grades)


def limited(findings: Iterable[Finding], most: int = 12) -> tuple[Finding, ...]:
    """Findings with warnings first, each once, and of one kind the first ones and how many more there are."""
    unique = list(dict.fromkeys(findings))
    unique.sort(key=lambda finding: finding.severity is not Severity.WARNING)
    shown: list[Finding] = []
    kinds = list(dict.fromkeys((f.severity, f.kind) for f in unique))
    for severity, kind in kinds:
        same = [
            finding
            for finding in unique
            if (finding.severity, finding.kind) == (severity, kind)
        ]
        shown += same[:most]
        if len(same) > most:
            shown.append(
                Finding(
                    severity,
                    kind,
                    "",
                    f"{len(same) - most} more findings of this kind ({kind})",
                )
            )
    return tuple(shown)


def _of_scores(validations: Sequence[Validation]) -> Iterable[Finding]:
    for validation in validations:
        scores = [score.r2 for score in validation.scores if np.isfinite(score.r2)]
        if validation.role == "identification" and scores and max(scores) < HALF:
            text = (
                f"the model explains less than half of every output (R² at most {max(scores):.2f}): check for a "
                "log of another robot, exchanged columns, wrong signs and wrong units"
            )
            yield warning("stranger", validation.source, text)
    told = [
        score
        for validation in validations
        for score in validation.scores
        if score.raw.deviation > 0
    ]
    if told and all(score.is_computed for score in told):
        noise = max(score.noise / score.raw.deviation for score in told)
        text = (
            f"the noise of all outputs is only {noise:.1g} of their standard deviation: they look computed or "
            "commanded, not measured, and the fit repeats their model"
        )
        yield warning("computed", "", text)


def _of_estimate(estimate: Estimate, seen: DataConditioning) -> Iterable[Finding]:
    for output, rows in zip(estimate.outputs, estimate.rows, strict=True):
        if not rows:
            text = "nothing was fitted to it: it never moves faster than 'still', so all its rows were left out"
            yield warning("silent", f"output '{output}'", text)
    n, course = len(estimate.values), estimate.diagnostics
    if seen.rank < n:
        text = f"the data determine {seen.rank} of {n} base parameters, though the sensors could see all of them"
        yield warning("conditioning", "", text)
    for direction in seen.weak:
        yield warning("conditioning", "", direction.advice)
    if course.get("converged") is False:
        text = f"the estimator {estimate.method} did not converge in {course.get('iterations')} iterations"
        yield warning("convergence", "", text)


def _of_physics(
    feasible: Feasibility | None,
    physical: PhysicalFit | None,
    estimate: Estimate,
    *,
    fits_well: bool,
) -> Iterable[Finding]:
    if feasible is not None and feasible.feasible is False:
        away = f"{feasible.distance:.2g} standard deviations"
        if feasible.is_beyond(CLEAR):
            wrong = "check columns, signs and units; " * feasible.is_beyond(IMPOSSIBLE)
            text = (
                f"the estimate is unphysical: the nearest physical robot is {away} away; {wrong}a model term may be "
                "missing"
            )
            yield warning("feasibility", "", text)
        else:
            why = ", as expected from noise" if fits_well else ""
            text = f"the estimate is slightly unphysical ({away}){why}"
            yield note("feasibility", "", text)
    rows = max(sum(estimate.rows), 1)
    if physical is not None and physical.misfit > OVERFIT * max(
        physical.unconstrained_misfit, rows
    ):
        more = (physical.misfit - physical.unconstrained_misfit) / rows
        text = (
            f"the physical fit is noticeably worse than least squares (by {more:.2g} noise variances per row); a model "
            "term may be missing"
        )
        yield warning("physics", "", text)
