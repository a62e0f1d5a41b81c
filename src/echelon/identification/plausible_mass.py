"""Masses that no robot of its size has, by the scale of the parameters that were identified.

Torques in a wrong unit scale all parameters alike, so that predictions stay as good.  A body of mass m and length l has
a first moment of at most about m·l and a moment of inertia of at most about m·l²; parameters divided by the power of
the length that their unit has are masses, the largest of which is compared with that of a very thin and light rod.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from echelon.base import BaseModel
from echelon.identification.logs.finding import Finding, warning
from echelon.robot import Placement, known_values, largest_offset
from echelon.shared import Floats

LIGHTEST = 8e-3  # kg/m³: mass by the cube of the length, of a rod of 100 kg/m³ whose thickness is 1 % of its length
SMALL = 0.05  # m, taken for the length of a robot whose joints have no known distances
_LENGTHS = {"kg": 0, "kg·m": 1, "kg·m²": 2}


def mass_findings(base: BaseModel, values: Floats) -> Iterator[Finding]:
    """A contradiction where identified base parameters, shape (r,), are those of a robot lighter than any."""
    steps = [
        step
        for body in base.mechanism.bodies
        for step in body.joint.steps
        if isinstance(step, Placement)
    ]
    length = largest_offset(steps, known_values(base.mechanism)) or SMALL
    masses = list(_masses(base, values, length))
    least = LIGHTEST * length**3
    if masses and max(masses) < least:
        text = (
            f"the identified inertias are those of {max(masses):.2g} kg at a length of {length:.2g} m, where a thin "
            f"rod has {least:.2g} kg, so that the outputs are not in N·m (N) at the joints' side of the gears"
        )
        yield warning("contradiction", "", text)


def _masses(
    base: BaseModel, values: Sequence[float] | Floats, length: float
) -> Iterator[float]:
    """Masses in kg that would have the inertial base parameters at a length in m."""
    for pivot, unit, value in zip(base.matrix.pivots, base.units, values, strict=True):
        if base.mechanism.columns[pivot].body is not None and np.isfinite(value):
            yield abs(float(value)) / length ** _LENGTHS[unit]
