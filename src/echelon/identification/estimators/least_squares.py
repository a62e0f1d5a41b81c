"""Ordinary least squares: every row counts alike.

The estimate that tables are published for, and the start of the others.  Its classical covariance σ²(WᵀW)⁻¹ takes all
outputs to have the same noise; where they do not, the covariance with each output's own noise is the honest one:

    (WᵀW)⁻¹ (Σ_i σ_i² W_iᵀW_i) (WᵀW)⁻¹
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.identification.estimators.estimate import Estimate
from echelon.identification.estimators.solution import Solution, estimate_of, solved
from echelon.observe.observation import Observation


def ols(
    observation: Observation, units: Sequence[str], *, noise: Literal["common", "by output"] = "common"
) -> Estimate:
    """Ordinary least squares.

    Parameters
    ----------
    observation : Observation
        Of m outputs and n parameters.
    units : sequence of str
        SI units of the n parameters.
    noise : "common" or "by output"
        What the covariance takes for granted: one σ² = ‖Wζ − y‖²/(rows − n) for all rows, as textbooks do, or a σ_i for
        each output.  The values do not depend on it.

    Returns
    -------
    Estimate

    Raises
    ------
    InputError
        If the data do not determine all parameters, or leave no row over to estimate the noise from.

    Examples
    --------
    >>> from echelon.observe.layout import Layout
    >>> from echelon.observe.triangle import upper_triangle
    >>> line = np.array([[1.0, 0.0, 1.1], [1.0, 1.0, 2.9], [1.0, 2.0, 5.1], [1.0, 3.0, 6.9]])
    >>> layout = Layout(("force",), ("offset", "slope"), ((0, 1),))
    >>> estimate = ols(Observation(layout, (upper_triangle(line),), (4,)), ("N", "N/m"))
    >>> estimate.values.round(6)
    array([1.06, 1.96])
    >>> estimate.noise.round(4)
    array([0.1265])
    """
    if noise not in ("common", "by output"):
        raise InputError(f"noise is '{noise}'; expected 'common' or 'by output'")
    solution = solved(observation, units)
    if solution.degrees <= 0:
        raise InputError(
            f"{solution.triangle.rows} rows for {len(units)} parameters leave nothing over to estimate the noise from; "
            "give more samples"
        )
    variance = solution.triangle.residual**2 / solution.degrees
    covariance = variance * solution.inverse if noise == "common" else by_output(solution)
    return estimate_of(
        solution,
        "ols",
        units,
        covariance,
        {"iterations": 1, "converged": True, "deviation": float(np.sqrt(variance)), "covariance": noise},
    )


def by_output(solution: Solution) -> Floats:
    """Covariance of a weighted least-squares solution when each output has a noise of its own, shape (n, n).

    Raises
    ------
    InputError
        If an output has no row to spare for an estimate of its noise.
    """
    parts = [np.zeros((0, len(solution.values)))]
    for i, label in enumerate(solution.observation.layout.outputs):
        if solution.observation.counts[i] and solution.weights[i]:
            if not np.isfinite(solution.noise[i]):
                raise InputError(used_up(solution.observation.counts[i]), element=f"output '{label}'")
            parts.append(solution.weights[i] * solution.noise[i] * solution.whitened(i))
    spread = np.vstack(parts) @ solution.root.T
    covariance: Floats = spread.T @ spread
    return covariance


def used_up(rows: int) -> str:
    """What to say of an output whose noise cannot be estimated."""
    return (
        f"its {rows} rows are all used up by parameters that only it shows, so its noise cannot be estimated: "
        "give more samples, leave it out, or give the noise to wls()"
    )
