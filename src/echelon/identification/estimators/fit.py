"""One call for every estimator: which one runs, on what, and with which intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.identification.estimators.covariance import BATCHED, clustered, clustered_by
from echelon.identification.estimators.errors_in_variables import instrumental, tls
from echelon.identification.estimators.estimate import Estimate
from echelon.identification.estimators.fixed_parameters import fixed
from echelon.identification.estimators.huber import huber
from echelon.identification.estimators.least_squares import irls, noise_estimate, noise_floor, ols, wls
from echelon.identification.rows.batches import Batch
from echelon.identification.rows.rows import Rows
from echelon.observe.observation import Observation

if TYPE_CHECKING:
    from echelon.formats.schema.schema_log import IdentificationEntry


def fitted(
    settings: IdentificationEntry,
    rows: Rows,
    observation: Observation,
    *,
    instruments: Rows | None = None,
    batches: Sequence[Batch] = (),
) -> Estimate:
    """Estimate the base parameters as the settings say."""
    rest = fixed(rows.layout.parameters, rows.units, settings.known) if settings.known else None
    if rest is not None:
        rows, observation = rest.rows(rows), rest.observation(observation)
        batches = [replace(batch, observation=rest.observation(batch.observation)) for batch in batches]
        instruments = None if instruments is None else rest.rows(instruments)
    estimate = _estimated(settings, rows, observation, instruments)
    if settings.intervals == "clustered" and estimate.method in BATCHED:
        by_factors = len(batches) > 1 and estimate.method != "huber"
        estimate = clustered_by(batches, rows.units, estimate) if by_factors else clustered(rows, estimate)
    return estimate if rest is None else rest.restored(estimate)


def usable_noise(observation: Observation, estimate: Estimate) -> Floats:
    """Standard deviations of the outputs' noise that make good weights: never zero, infinite where unknown."""
    noise = np.where(np.isfinite(estimate.noise), estimate.noise, np.inf)
    floor: Floats = np.maximum(noise, noise_floor(observation))
    return floor


def _estimated(
    settings: IdentificationEntry, rows: Rows, observation: Observation, instruments: Rows | None
) -> Estimate:
    units = rows.units
    match settings.estimator:
        case "ols":
            return ols(observation, units)
        case "wls":
            return wls(observation, units, noise_estimate(observation), relative=True)
        case "irls":
            return irls(observation, units, tolerance=1e-6, limit=500)
        case "huber":
            return huber(rows)
        case "tls":
            return tls(observation, units)
        case "iv":
            if instruments is None:
                problem = "instruments are made from reference positions, which the logs lack: give 'reference' columns"
                raise InputError(problem)
            return instrumental(rows, instruments)
