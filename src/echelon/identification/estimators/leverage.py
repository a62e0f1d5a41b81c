"""How the residual's degrees of freedom divide among outputs.

A fit with k parameters takes k degrees of freedom from all rows together.  An output's share is the trace of its
rows of the hat matrix, its leverage, so that an output with few rows or many parameters of its own gets its due.
"""

from __future__ import annotations

import numpy as np

from echelon.arrays import Floats
from echelon.observe.observation import Observation


def leverages(observation: Observation, weights: Floats, cofactor: Floats) -> Floats:
    """Degrees of freedom that a weighted fit takes from each output.

    Parameters
    ----------
    observation : Observation
    weights : array of shape (m,)
        Factor of each output's rows.
    cofactor : array of shape (n, n)
        (Wᵀ Σ⁻¹ W)⁻¹ of the fit; rows and columns of parameters that were not fitted are zero.

    Returns
    -------
    array of shape (m,)
        They add up to the number of fitted parameters.
    """
    found = []
    for output, (R, weight) in enumerate(zip(observation.factors, weights, strict=True)):
        columns = list(observation.layout.columns[output])
        own = weight * R[:-1, :-1]
        found.append(float(np.sum((own @ cofactor[np.ix_(columns, columns)]) * own)))
    return np.array(found)


def residual_deviations(observation: Observation, values: Floats, weights: Floats, cofactor: Floats) -> Floats:
    """Standard deviation of each output's residual, corrected for the degrees of freedom; shape (m,).

    Parameters
    ----------
    observation : Observation
    values : array of shape (n,)
    weights, cofactor
        As for :func:`leverages`.
    """
    counts = np.array(observation.counts, dtype=float)
    degrees = np.maximum(counts - leverages(observation, weights, cofactor), 1.0)
    deviations: Floats = observation.misfits(values) / np.sqrt(degrees)
    return deviations
