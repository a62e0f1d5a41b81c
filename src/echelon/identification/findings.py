"""Findings about a fit: what a user must know before trusting it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from echelon.identification.estimators.estimate import Estimate
from echelon.identification.excitation.excitation import Excitation
from echelon.identification.physics.result import Feasibility, PhysicalFit
from echelon.identification.validation.validation import Validation
from echelon.logs.finding import Finding, Severity

_MOST = 12
"""Findings of one kind that are shown; of more the first ones and their number."""
_STRANGER = 0.3
"""R² below which, for every output, the model has nothing to do with the data."""
_FAR = 5.0
"""Standard deviations to the nearest robot that noise alone does not bring about."""
_COSTLY = 1.5
"""Ratio of misfits from which on physical consistency costs more than noise does."""


def fit_findings(
    estimate: Estimate,
    seen: Excitation,
    feasible: Feasibility | None,
    physical: PhysicalFit | None,
    validations: Sequence[Validation],
) -> list[Finding]:
    """What is wrong with a fit, or worth knowing.

    Parameters
    ----------
    estimate : Estimate
    seen : Excitation
    feasible : Feasibility, optional
    physical : PhysicalFit, optional
    validations : sequence of Validation
    """
    return [
        *_strangers(validations),
        *_silent(estimate),
        *_open(estimate, seen),
        *_unconverged(estimate),
        *_unphysical(feasible),
        *_costly(physical, estimate),
    ]


def dampened(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Findings with warnings first, each once, and of one kind not more than can be read."""
    unique = list(dict.fromkeys(findings))
    unique.sort(key=lambda finding: finding.severity is not Severity.WARNING)
    shown: list[Finding] = []
    kinds = list(dict.fromkeys((f.severity, f.kind) for f in unique))
    for severity, kind in kinds:
        same = [finding for finding in unique if (finding.severity, finding.kind) == (severity, kind)]
        shown += same[:_MOST]
        if len(same) > _MOST:
            shown.append(Finding(severity, kind, "", f"{len(same) - _MOST} more findings of this kind ({kind})"))
    return tuple(shown)


def _strangers(validations: Sequence[Validation]) -> Iterable[Finding]:
    for validation in validations:
        scores = [score.r2 for score in validation.scores if np.isfinite(score.r2)]
        if validation.role == "identification" and scores and max(scores) < _STRANGER:
            text = (
                f"the model explains no output (R² at most {max(scores):.2f}): is this log of another robot, or are "
                "columns exchanged, or their signs or units wrong?"
            )
            yield Finding(Severity.WARNING, "stranger", validation.source, text)


def _silent(estimate: Estimate) -> Iterable[Finding]:
    for output, rows in zip(estimate.outputs, estimate.rows, strict=True):
        if not rows:
            text = "no row of it is left: it never moves faster than 'still', so nothing was fitted to it"
            yield Finding(Severity.WARNING, "silent", f"output '{output}'", text)


def _open(estimate: Estimate, seen: Excitation) -> Iterable[Finding]:
    n = len(estimate.values)
    if seen.rank < n:
        text = f"the data determine {seen.rank} of {n} base parameters, though the sensors could see all of them"
        yield Finding(Severity.WARNING, "excitation", "", text)
    for direction in seen.weak:
        yield Finding(Severity.WARNING, "excitation", "", direction.advice)


def _unconverged(estimate: Estimate) -> Iterable[Finding]:
    if estimate.diagnostics.get("converged") is False:
        text = (
            f"the estimator {estimate.method} did not converge in {estimate.diagnostics.get('iterations')} iterations"
        )
        yield Finding(Severity.WARNING, "convergence", "", text)


def _unphysical(feasible: Feasibility | None) -> Iterable[Finding]:
    if feasible is not None and feasible.feasible is False:
        text = (
            "no physical robot has the estimated base parameters; the nearest one is "
            f"{feasible.distance:.2g} standard deviations away"
        )
        if feasible.distance > _FAR:
            text += ": the model lacks something, or columns are exchanged, or their signs or units wrong"
        yield Finding(Severity.WARNING, "feasibility", "", text)


def _costly(physical: PhysicalFit | None, estimate: Estimate) -> Iterable[Finding]:
    if physical is None:
        return
    per_row = (physical.misfit - physical.least_misfit) / max(sum(estimate.rows), 1)
    if physical.misfit > _COSTLY * max(physical.least_misfit, sum(estimate.rows)):
        text = (
            f"physical consistency raises the squares by {per_row:.2g} noise variances per row: is the model complete?"
        )
        yield Finding(Severity.WARNING, "physics", "", text)
