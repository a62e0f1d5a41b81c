"""Chance in measured signals: the usual size of deviations, and where they are more than chance.

Signals have outliers, so that sizes are told by quantiles, which the few largest values do not sway.
"""

from __future__ import annotations

from statistics import NormalDist

import numpy as np
import numpy.typing as npt

from echelon.shared import Floats

CLEAR = 4.0
"""Times its standard error, or its usual size, from which on a deviation is no chance: of normal deviations one in
16,000 is as large."""

SHARE = 0.95
"""Share of the samples of a signal that faults leave alone."""

LITTLE = 5e-3
"""Share of a range, of a length or of a slope that is next to nothing: sensors are calibrated no better."""


def usual(deviations: npt.ArrayLike) -> float:
    """The size that 95 % of some deviations do not exceed; 0 if there are none."""
    sizes = np.abs(deviations)
    return float(np.quantile(sizes, SHARE)) if sizes.size else 0.0


def normal_deviation(values: Floats, share: float) -> Floats:
    """Standard deviations of columns (N, …) that are normal around zero, by the size of a ``share`` of their values."""
    return np.asarray(
        np.quantile(np.abs(values), share, axis=0)
    ) / NormalDist().inv_cdf(0.5 + share / 2)
