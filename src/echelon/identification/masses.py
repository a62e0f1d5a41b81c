"""Mass and centre of mass of bodies, where outputs tell them from all other parameters.

The centre c = m/M is the ratio of the first moments to the mass.  Its covariance is that of c linearised about the
estimate (the delta method): dc = (dm − c dM)/M, which holds where the mass is clear of its noise.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from echelon.base import BaseModel, Identifiability
from echelon.identification.estimators.estimate import CLEAR, Estimate
from echelon.shared import PARAMETERS, Floats

_MOMENTS_AND_MASS = tuple(map(PARAMETERS.index, ("MX", "MY", "MZ", "M")))


@dataclass(frozen=True)
class BodyMass:
    """Mass and centre of mass of a body that data tell alone, with confidence intervals."""

    body: str
    mass: float  # kg
    mass_low: float
    mass_high: float
    centre: Floats  # shape (3,); in the frame of the body, m
    centre_low: Floats
    centre_high: Floats

    @property
    def rows(self) -> tuple[tuple[str, float, float, float, str], ...]:
        """Rows of a table: what it is, value, ends of its interval, and unit, mm for the centre."""
        centre = zip(
            "xyz",
            1e3 * self.centre,
            1e3 * self.centre_low,
            1e3 * self.centre_high,
            strict=True,
        )
        return (
            (f"mass of {self.body}", self.mass, self.mass_low, self.mass_high, "kg"),
            *(
                (f"its centre of mass, {axis}", float(c), float(low), float(high), "mm")
                for axis, c, low, high in centre
            ),
        )


def body_masses(
    base: BaseModel, estimate: Estimate, level: float
) -> tuple[BodyMass, ...]:
    """Bodies whose mass and first moments are base parameters alone, with a mass that is clear of noise."""
    return tuple(_body_masses(base, estimate, level))


def _body_masses(
    base: BaseModel, estimate: Estimate, level: float
) -> Iterator[BodyMass]:
    mechanism, kinds = base.mechanism, base.classification
    for body in mechanism.carriers:
        named = {p.kind: p.name for p in mechanism.columns if p.body == body}
        names = [named.get(kind, "") for kind in _MOMENTS_AND_MASS]
        if any(kinds.get(name) is not Identifiability.ALONE for name in names):
            continue
        places = [base.pivots.index(name) for name in names]
        values = estimate.values[places]
        covariance = estimate.covariance[np.ix_(places, places)]
        mass, mass_std = float(values[3]), float(np.sqrt(max(covariance[3, 3], 0.0)))
        if not mass > CLEAR * mass_std:
            continue
        centre = values[:3] / mass
        slopes = np.column_stack([np.eye(3), -centre]) / mass
        variances = np.diagonal(slopes @ covariance @ slopes.T)
        quantile = estimate.quantile(level)
        half = quantile * np.sqrt(np.maximum(variances, 0.0))
        yield BodyMass(
            mechanism.carrier_name(body),
            mass,
            mass - quantile * mass_std,
            mass + quantile * mass_std,
            centre,
            centre - half,
            centre + half,
        )
