"""Which values predict: the estimate, or those of a physical robot where unseen motions ask for more than data told.

A trajectory shows little of some combinations.  Least squares leaves these to noise, and another trajectory that needs
them is predicted poorly, however well the first one is.  How poorly is known without its outputs: the covariance of
the estimate says how uncertain predictions along its states are.  Where that exceeds what the model leaves of the
fitted data, a prior, or the mere existence of the robot, knows more than the data.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from itertools import chain
from pathlib import Path

import numpy as np

from echelon.formats import IdentificationEntry
from echelon.identification.estimators.estimate import Estimate
from echelon.identification.logs.finding import Finding, note
from echelon.identification.logs.recording import Samples
from echelon.identification.passes_over_data import PassesOverData
from echelon.identification.physics.fit import PhysicalFit
from echelon.identification.rows.plan import Part
from echelon.identification.rows.rows import ModelRows
from echelon.shared import Floats, Values

# estimators that give what data alone tell
LEAST_SQUARES = ("ols", "wls", "irls", "huber")


def chosen_values(
    settings: IdentificationEntry,
    data: PassesOverData,
    unseen_logs: Sequence[Path],
    estimate: Estimate,
    noise: Floats,
    physical: PhysicalFit | None,
) -> tuple[Values, list[Finding]]:
    """Values that predictions use, by the settings or else by the data, and what is said of the choice.

    ``noise`` are standard deviations of the residuals of fitted rows, shape (outputs,).
    """
    if settings.predict != "auto":
        return settings.predict, []
    is_plain = settings.estimator in LEAST_SQUARES and not settings.known
    # data that leave something open are said elsewhere
    is_told = bool(np.isfinite(estimate.covariance).all())
    if physical is None or not is_plain or not is_told:
        return "estimate", []
    gain = physical.advantage
    if gain is not None and gain.mean < -gain.error:
        return "estimate", []
    ratio = _uncertainty(data, unseen_logs, estimate, noise)
    if ratio <= 1:
        return "estimate", []
    text = (
        f"predictions use the physical fit: on unseen motions the estimate would be uncertain by up to {ratio:.2g} "
        "times the residuals, because the fitted motions hardly excite some combinations.  Fit a more exciting "
        "trajectory, or write  predict: estimate"
    )
    return "physical", [note("predictions", "", text)]


def _uncertainty(
    data: PassesOverData, unseen_logs: Sequence[Path], estimate: Estimate, noise: Floats
) -> float:
    """Standard deviation of predictions of unseen rows by that of residuals, the largest of all outputs."""
    part: Part = "last" if data.plan.holdout else "all"
    paths = data.paths if data.plan.holdout else unseen_logs
    rows = ModelRows(data.plan.base, partial(_samples, data, paths, part))
    observation, largest = rows.observation(), 0.0
    for columns, R, count, sigma in zip(
        observation.layout.columns,
        observation.factors,
        observation.counts,
        noise,
        strict=True,
    ):
        if count and np.isfinite(sigma) and sigma > 0:
            places = list(columns)
            W = R[:, :-1]
            predicted = (
                float(np.sum((W @ estimate.covariance[np.ix_(places, places)]) * W))
                / count
            )
            largest = max(largest, predicted / float(sigma) ** 2)
    return float(np.sqrt(largest))


def _samples(
    data: PassesOverData, paths: Sequence[Path], part: Part
) -> Iterator[Samples]:
    return chain.from_iterable(data.samples(path, part) for path in paths)
