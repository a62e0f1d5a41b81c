"""The least-squares solution of smallest norm, for data that leave directions open.

Not an estimate of the parameters but the shortest of all that fit equally well, with columns scaled to norm 1 so that
units do not matter.  Predictions of the same motions need no more.  Variances of parameters that take part in an open
direction are infinite: the data say nothing, and a pseudo-inverse would claim certainty.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.identification.estimators.estimate import Estimate
from echelon.identification.estimators.solution import Solution, check, direction_text, estimate_of, open_directions
from echelon.identification.estimators.weighted import checked_noise
from echelon.observe.observation import Observation


def minimum_norm(
    observation: Observation, units: Sequence[str], *, noise: Sequence[float] | Floats | None = None
) -> Estimate:
    """Least squares with the smallest norm of ζ in scaled columns.

    Parameters
    ----------
    observation : Observation
        Of m outputs and n parameters.
    units : sequence of str
        SI units of the n parameters.
    noise : array of shape (m,), optional
        Relative standard deviation of each output's noise; 1 if omitted.

    Returns
    -------
    Estimate
        Diagnostics: ``rank``, and ``open``, the directions along which nothing changes, as texts.

    Raises
    ------
    InputError
        If there are no more rows than directions that the data determine.
    """
    check(observation, units)
    weights = np.ones(len(observation.counts)) if noise is None else 1.0 / checked_noise(observation, noise)
    triangle = observation.combined(weights)
    degrees = float(triangle.rows - triangle.rank)
    if degrees <= 0:
        raise InputError("no row is left over to estimate the noise from; give more samples")
    scales = np.where(triangle.scales == 0, 1.0, triangle.scales)
    left, singular, right = np.linalg.svd(triangle.R / scales)
    rank = triangle.rank
    root = right[:rank].T / singular[:rank] / scales[:, None]
    beta = left.T @ triangle.qty
    values = root @ beta[:rank]
    rest = float(np.sum(beta[rank:] ** 2)) + triangle.residual**2
    directions = open_directions(triangle)
    covariance = rest / degrees * root @ root.T
    involved = np.flatnonzero(directions.any(axis=0))
    covariance[involved, involved] = np.inf
    solution = Solution(observation, weights, triangle, values, root)
    texts = [direction_text(some, triangle.parameters) for some in directions]
    diagnostics = {
        "iterations": 1,
        "converged": True,
        "rank": rank,
        "open": texts,
        "condition": None if texts else triangle.condition,
        "scaled_condition": float(singular[0] / singular[rank - 1]) if rank else 1.0,
    }
    return replace(estimate_of(solution, "minimum norm", units, covariance, diagnostics), degrees=degrees)
