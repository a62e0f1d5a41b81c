"""One call for every estimator: which one runs, on what, with which intervals, and with what is known before the fit.

A payload that was weighed or a rotor inertia from the data sheet leave fewer unknowns θ, with ζ = T θ + ζ₀.  Then
W ζ − y = (W T) θ − (y − W ζ₀), so the known part moves to the right-hand side, in the R-factors just as in the rows.
Any estimator runs on the result, and :meth:`Substitution.restored` gives the estimate of ζ back, covariance included.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from typing import TYPE_CHECKING

import numpy as np

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.identification.estimators.covariance import BATCHED, clustered, clustered_by
from echelon.identification.estimators.errors_in_variables import instrumental, tls
from echelon.identification.estimators.estimate import Estimate
from echelon.identification.estimators.least_squares import huber, irls, noise_estimate, noise_floor, ols, wls
from echelon.identification.estimators.ridge import ridge
from echelon.identification.rows.ingest import Batch
from echelon.identification.rows.rows import RowBlock, Rows
from echelon.observe.observation import Layout, Observation
from echelon.observe.triangle import upper_triangle

if TYPE_CHECKING:
    from echelon.formats.schema.schema_log import IdentificationEntry


@dataclass(frozen=True, repr=False)
class Substitution:
    """Parameters ζ = T θ + ζ₀ with fewer unknowns θ."""

    parameters: tuple[str, ...]  # of the n parameters ζ
    units: tuple[str, ...]  # of the n parameters ζ
    unknowns: tuple[str, ...]  # of the k unknowns θ
    unknown_units: tuple[str, ...]  # of the k unknowns θ
    matrix: Floats  # shape (n, k); T
    offset: Floats  # shape (n,); ζ₀

    def observation(self, observation: Observation) -> Observation:
        """The observation of the unknowns; the known part has moved to the outputs."""
        layout = self._layout(observation.layout)
        factors = []
        for R, old, new in zip(observation.factors, observation.layout.columns, layout.columns, strict=True):
            factors.append(upper_triangle(np.column_stack(self._moved(R[:, :-1], R[:, -1], old, new))))
        return Observation(layout, tuple(factors), observation.counts)

    def rows(self, rows: Rows) -> Rows:
        """Rows of the unknowns."""
        return _SubstitutedRows(rows, self, self._layout(rows.layout), self.unknown_units)

    def restored(self, estimate: Estimate) -> Estimate:
        """The estimate of all parameters; known ones have variance zero."""
        if estimate.parameters != self.unknowns:
            raise InputError("the estimate is not one of the unknowns of this substitution")
        T = self.matrix
        # an infinite variance times a zero of T is nothing, not nan
        finite = np.where(np.isfinite(estimate.covariance), estimate.covariance, 0.0)
        covariance = T @ finite @ T.T
        unknown = (T[:, ~np.isfinite(np.diagonal(estimate.covariance))] != 0).any(axis=1)
        covariance[unknown, unknown] = np.inf
        known = [label for label, row in zip(self.parameters, T, strict=True) if not row.any()]
        return replace(
            estimate,
            parameters=self.parameters,
            units=self.units,
            values=T @ estimate.values + self.offset,
            covariance=covariance,
            diagnostics={**estimate.diagnostics, "known": known},
        )

    def _layout(self, layout: Layout) -> Layout:
        if layout.parameters != self.parameters:
            raise InputError("the data are of other parameters than this substitution")
        columns = tuple(
            tuple(np.flatnonzero(self.matrix[list(some)].any(axis=0)).tolist()) if some else ()
            for some in layout.columns
        )
        return Layout(layout.outputs, self.unknowns, columns)

    def _moved(self, matrix: Floats, y: Floats, old: tuple[int, ...], new: tuple[int, ...]) -> tuple[Floats, Floats]:
        part = self.matrix[np.ix_(old, new)]
        return matrix @ part, y - matrix @ self.offset[list(old)]

    def __repr__(self) -> str:
        return f"Substitution({len(self.parameters)} parameters by {len(self.unknowns)} unknowns)"


@dataclass
class _SubstitutedRows:
    """Rows of the unknowns, made from rows of all parameters as they pass."""

    original: Rows
    substitution: Substitution
    layout: Layout
    units: tuple[str, ...]

    def blocks(self) -> Iterator[RowBlock]:
        pairs = list(zip(self.original.layout.columns, self.layout.columns, strict=True))
        for block in self.original.blocks():
            moved = [
                self.substitution._moved(matrix, y, old, new)
                for matrix, y, (old, new) in zip(block.matrices, block.y, pairs, strict=True)
            ]
            matrices, y = (tuple(some) for some in zip(*moved, strict=True))
            yield replace(block, matrices=matrices, y=y)

    def observation(self) -> Observation:
        return self.substitution.observation(self.original.observation())


def fixed(parameters: Sequence[str], units: Sequence[str], values: Mapping[str, float]) -> Substitution:
    """The substitution that fixes parameters at known values, SI units."""
    if len(units) != len(parameters):
        raise InputError(f"there are {len(units)} units for {len(parameters)} parameters; expected one for each")
    offset = np.zeros(len(parameters))
    for label, value in values.items():
        if not np.isfinite(value):
            raise InputError(f"the known value {value} is not a finite number", element=f"parameter '{label}'")
        offset[_place(parameters, label)] = value
    kept = [k for k, label in enumerate(parameters) if label not in values]
    if not kept:
        raise InputError("all parameters are known; nothing is left to estimate")
    names, kinds = (tuple(some[k] for k in kept) for some in (parameters, units))
    return Substitution(tuple(parameters), tuple(units), names, kinds, np.eye(len(parameters))[:, kept], offset)


def _place(parameters: Sequence[str], label: str) -> int:
    if label in parameters:
        return list(parameters).index(label)
    near = get_close_matches(label, parameters, 3, 0.5)
    hint = f"did you mean {', '.join(near)}?" if near else f"expected one of {', '.join(parameters)}"
    raise InputError(f"there is no such parameter; {hint}", element=f"parameter '{label}'")


def fitted(
    settings: IdentificationEntry,
    rows: Rows,
    observation: Observation,
    *,
    prior: Floats | None = None,
    instruments: Rows | None = None,
    batches: Sequence[Batch] = (),
) -> Estimate:
    """Estimate the base parameters as the settings say."""
    rest = fixed(rows.layout.parameters, rows.units, settings.known) if settings.known else None
    if rest is not None:
        rows, observation = rest.rows(rows), rest.observation(observation)
        batches = [replace(batch, observation=rest.observation(batch.observation)) for batch in batches]
        prior = None if prior is None else prior[rest.matrix.any(axis=1)]
        instruments = None if instruments is None else rest.rows(instruments)
    estimate = _estimated(settings, rows, observation, prior, instruments)
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
    settings: IdentificationEntry, rows: Rows, observation: Observation, prior: Floats | None, instruments: Rows | None
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
        case "ridge":
            if prior is None:
                raise InputError(
                    "ridge draws towards prior values, and there are none: give a prior, such as a URDF file"
                )
            return ridge(observation, units, prior, weight=settings.prior.weight or "evidence")
        case "iv":
            if instruments is None:
                problem = "instruments are made from reference positions, which the logs lack: give 'reference' columns"
                raise InputError(problem)
            return instrumental(rows, instruments)
