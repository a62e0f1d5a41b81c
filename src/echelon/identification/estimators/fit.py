"""One call for every estimator: which one runs, on what, with which intervals, and with what is known before the fit.

A payload that was weighed or a rotor inertia from the data sheet leave fewer unknowns.  What is known times its columns
moves to the other side, in the R-factors just as in the rows, so that any estimator runs on the rest;
:meth:`Known.restored` gives the estimate of all parameters back.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from echelon.compute import Layout, Observation, restricted
from echelon.identification.batches import TimeBatch
from echelon.identification.estimators.covariance import (
    BATCHED,
    clustered,
    clustered_by,
)
from echelon.identification.estimators.errors_in_variables import instrumental, tls
from echelon.identification.estimators.estimate import Estimate
from echelon.identification.estimators.least_squares import (
    huber,
    irls,
    noise_estimate,
    noise_floor,
    ols,
    wls,
)
from echelon.identification.estimators.ridge import ridge
from echelon.identification.rows.rows import RowBlock, RowStream
from echelon.shared import Floats, InputError, nearest_of

if TYPE_CHECKING:
    from echelon.formats import IdentificationEntry


@dataclass(frozen=True, repr=False)
class KnownParameters:
    """Parameters of which some have known values; the others are the unknowns."""

    parameters: tuple[str, ...]
    units: tuple[str, ...]
    values: Floats  # shape (n,); nan where unknown

    @cached_property
    def unknowns(self) -> list[int]:
        """Numbers of the parameters that are not known."""
        return np.flatnonzero(np.isnan(self.values)).tolist()

    @property
    def unknown_units(self) -> tuple[str, ...]:
        """SI units of the unknowns."""
        return tuple(self.units[k] for k in self.unknowns)

    def layout(self, layout: Layout) -> Layout:
        """The layout of the unknowns."""
        if layout.parameters != self.parameters:
            raise InputError(
                "the data are of other parameters than those of which some are known"
            )
        return restricted(layout, self.unknowns)[0]

    def observation(self, observation: Observation) -> Observation:
        """The observation of the unknowns; the known part has moved to the outputs."""
        self.layout(observation.layout)
        return observation.moved(-np.nan_to_num(self.values)).select(self.unknowns)

    def moved(
        self, matrix: Floats, y: Floats, columns: Sequence[int]
    ) -> tuple[Floats, Floats]:
        """Columns of the unknowns, and outputs without the known part."""
        values = self.values[list(columns)]
        unknown = np.isnan(values)
        return matrix[:, unknown], y - matrix[:, ~unknown] @ values[~unknown]

    def restored(self, estimate: Estimate) -> Estimate:
        """The estimate of all parameters; known ones have variance zero."""
        if estimate.parameters != tuple(self.parameters[k] for k in self.unknowns):
            raise InputError("the estimate is not one of the unknowns")
        values = self.values.copy()
        covariance = np.zeros((len(self.values), len(self.values)))
        values[self.unknowns] = estimate.values
        covariance[np.ix_(self.unknowns, self.unknowns)] = estimate.covariance
        known = [
            label for k, label in enumerate(self.parameters) if k not in self.unknowns
        ]
        diagnostics = {**estimate.diagnostics, "known": known}
        return replace(
            estimate,
            parameters=self.parameters,
            units=self.units,
            values=values,
            covariance=covariance,
            diagnostics=diagnostics,
        )


class RowsOfUnknowns(RowStream):
    """Rows of the unknowns, made from rows of all parameters as they pass."""

    def __init__(self, original: RowStream, known: KnownParameters) -> None:
        self._original, self._known = original, known

    @property
    def layout(self) -> Layout:
        """Outputs, unknowns, and which of them each output can depend on."""
        return self._known.layout(self._original.layout)

    @property
    def units(self) -> tuple[str, ...]:
        """SI units of the unknowns."""
        return self._known.unknown_units

    def blocks(self) -> Iterator[RowBlock]:
        """All rows, in the order of time, log after log."""
        for block in self._original.blocks():
            parts = zip(
                block.matrices, block.y, self._original.layout.columns, strict=True
            )
            matrices, y = zip(
                *(self._known.moved(*part) for part in parts), strict=True
            )
            yield replace(block, matrices=matrices, y=y)

    def observation(self) -> Observation:
        """The R-factors of all rows."""
        return self._known.observation(self._original.observation())


def known_values(
    parameters: Sequence[str], units: Sequence[str], values: Mapping[str, float]
) -> KnownParameters:
    """Parameters with those that are known, SI units."""
    if len(units) != len(parameters):
        raise InputError(
            f"there are {len(units)} units for {len(parameters)} parameters; expected one for each"
        )
    found = np.full(len(parameters), np.nan)
    for label, value in values.items():
        if not np.isfinite(value):
            raise InputError(
                f"the known value {value} is not a finite number",
                element=f"parameter '{label}'",
            )
        if label not in parameters:
            problem = f"there is no such parameter{nearest_of(label, parameters)}"
            raise InputError(problem, element=f"parameter '{label}'")
        found[parameters.index(label)] = value
    if not np.isnan(found).any():
        raise InputError("all parameters are known; nothing is left to estimate")
    return KnownParameters(tuple(parameters), tuple(units), found)


def fitted(
    settings: IdentificationEntry,
    rows: RowStream,
    observation: Observation,
    *,
    prior: Floats | None = None,
    instruments: RowStream | None = None,
    batches: Sequence[TimeBatch] = (),
) -> Estimate:
    """Estimate the base parameters as the settings say."""
    rest = (
        known_values(rows.layout.parameters, rows.units, settings.known)
        if settings.known
        else None
    )
    if rest is not None:
        rows, observation = RowsOfUnknowns(rows, rest), rest.observation(observation)
        batches = [
            replace(batch, observation=rest.observation(batch.observation))
            for batch in batches
        ]
        prior = None if prior is None else prior[rest.unknowns]
        instruments = None if instruments is None else RowsOfUnknowns(instruments, rest)
    estimate = _estimated(settings, rows, observation, prior, instruments)
    if settings.intervals == "clustered" and estimate.method in BATCHED:
        by_factors = len(batches) > 1 and estimate.method != "huber"
        estimate = (
            clustered_by(batches, rows.units, estimate)
            if by_factors
            else clustered(rows, estimate)
        )
    return estimate if rest is None else rest.restored(estimate)


def usable_noise(observation: Observation, estimate: Estimate) -> Floats:
    """Standard deviations of the outputs' noise that make good weights: never zero, infinite where unknown."""
    noise = np.where(np.isfinite(estimate.noise), estimate.noise, np.inf)
    return np.maximum(noise, noise_floor(observation))


def _estimated(
    settings: IdentificationEntry,
    rows: RowStream,
    observation: Observation,
    prior: Floats | None,
    instruments: RowStream | None,
) -> Estimate:
    units = rows.units
    match settings.estimator:
        case "ols":
            return ols(observation, units)
        case "wls":
            return wls(observation, units, noise_estimate(observation))
        case "irls":
            return irls(observation, units, tolerance=1e-6, limit=500)
        case "huber":
            return huber(rows)
        case "tls":
            return tls(observation, units)
        case "ridge":
            if prior is None:
                raise InputError(
                    "ridge draws towards prior values, and there are none: give a prior, such as a URDF file"
                )
            return ridge(
                observation, units, prior, weight=settings.prior.weight or "evidence"
            )
        case "iv":
            if instruments is None:
                problem = "instruments are made from reference positions, which the logs lack: give 'reference' columns"
                raise InputError(problem)
            return instrumental(rows, instruments)
