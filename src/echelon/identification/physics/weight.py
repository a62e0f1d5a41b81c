"""How much a prior should count, chosen from the data of the fit alone.

Two ways, neither of which looks at validation data:

- **by stretches**: each stretch of the log is predicted from the others, for weights over many decades.  Neighbouring
  samples are alike, so whole stretches are left out, not samples.  Among weights whose error is within one standard
  error of the least one, the largest is taken (Hastie, Tibshirani & Friedman, 7.10): stretches of one trajectory excite
  alike, so their errors say little against a weight that a new trajectory would need.
- **by discrepancy** (Morozov), for data in one piece: the true parameters raise the misfit above its minimum by r σ² on
  average, where r is the number of base parameters; the largest weight that raises it no more is taken.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.observe.observation import Observation
from echelon.observe.triangle import Triangle

Solve = Callable[[Floats, Floats, float], Floats]
"""Base parameters from R, Qᵀy and a weight."""

CANDIDATES = tuple(float(10.0**k) for k in range(-2, 7))
_BISECTIONS = 6


@dataclass(frozen=True)
class WeightChoice:
    """A weight and why it was chosen.

    Attributes
    ----------
    weight : float
    reason : str
    scores : tuple of (float, float)
        Weights that were tried, with their error.
    """

    weight: float
    reason: str
    scores: tuple[tuple[float, float], ...]


def by_stretches(solve: Solve, pieces: Sequence[Observation], weights: Floats | None) -> WeightChoice:
    """The weight with which stretches are best predicted from the others.

    Parameters
    ----------
    solve : callable
    pieces : sequence of Observation
        At least two.
    weights : array of shape (outputs,), optional
        1/noise of the outputs.

    Raises
    ------
    InputError
        If a piece holds no rows.
    """
    if any(piece.rows == 0 for piece in pieces):
        raise InputError("a piece of the data holds no rows; leave it out")
    factors = np.ones(len(pieces[0].layout.outputs)) if weights is None else weights
    errors = np.zeros((len(pieces), len(CANDIDATES)))
    for left, piece in enumerate(pieces):
        others = [other for k, other in enumerate(pieces) if k != left]
        triangle = reduce(Observation.merged, others).combined(factors)
        for column, weight in enumerate(CANDIDATES):
            values = solve(triangle.R, triangle.qty, weight)
            rms = factors * piece.misfits(values) / np.sqrt(np.maximum(piece.counts, 1))
            # each output counts by how well its stretch is predicted, in units of its noise
            errors[left, column] = float(np.mean(np.log(np.maximum(rms, 1e-12))))
    mean = errors.mean(axis=0)
    best = int(np.argmin(mean))
    spread = (errors - errors[:, [best]]).std(axis=0, ddof=1) / np.sqrt(len(pieces))
    chosen = max(k for k in range(len(CANDIDATES)) if mean[k] <= mean[best] + spread[k])
    reason = f"the largest weight with which each of {len(pieces)} stretches is predicted from the others as well as "
    reason += "with any, within one standard error"
    scores = tuple((weight, float(np.exp(m))) for weight, m in zip(CANDIDATES, mean, strict=True))
    return WeightChoice(CANDIDATES[chosen], reason, scores)


def by_discrepancy(solve: Solve, triangle: Triangle) -> WeightChoice:
    """The largest weight that raises the misfit no more than the true parameters do on average.

    Parameters
    ----------
    solve : callable
    triangle : Triangle
    """
    r = len(triangle.parameters)
    freedom = max(triangle.rows - r, 1)
    variance = triangle.residual**2 / freedom

    def excess(weight: float) -> float:
        return float(np.sum((triangle.R @ solve(triangle.R, triangle.qty, weight) - triangle.qty) ** 2))

    allowed = excess(CANDIDATES[0]) + r * variance
    scores = []
    low = CANDIDATES[0]
    high = CANDIDATES[-1]
    for weight in CANDIDATES:
        scores.append((weight, excess(weight)))
        if scores[-1][1] > allowed:
            high = weight
            break
        low = weight
    for _ in range(_BISECTIONS if high > low else 0):
        middle = float(np.sqrt(low * high))
        scores.append((middle, excess(middle)))
        low, high = (middle, high) if scores[-1][1] <= allowed else (low, middle)
    reason = f"the largest weight that raises the misfit by no more than {r} σ², as the true parameters do on average"
    return WeightChoice(low, reason, tuple(scores))
