"""Weighted least squares on R-factors, and the estimate that every method returns.

Everything comes from triangles, nothing from normal equations, so that condition numbers are not squared: the inverse
(WᵀW)⁻¹ = R⁻¹R⁻ᵀ is kept as its root R⁻¹, and the leverage of an output's rows, the trace of their block of the hat
matrix W(WᵀW)⁻¹Wᵀ, is the squared Frobenius norm of their R-factor times that root.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from echelon.compute import Layout, Observation, Triangle, safe_norms
from echelon.identification.logs.finding import enumerated
from echelon.shared import Floats, InputError, Integers, extra, public


@public
@dataclass(frozen=True, repr=False)
class Estimate:
    """Estimated parameters.

    Attributes
    ----------
    method : str
        Name of the estimator, such as ``"ols"``.
    parameters, units : tuple of str
        Names and SI units of the n parameters.
    values : array of shape (n,)
    covariance : array of shape (n, n)
    outputs : tuple of str
    noise : array of shape (m,)
        Standard deviation of each output's residual, unit of the output, corrected for the degrees of freedom.
    rows : tuple of int
        Rows of each output.
    degrees : float
        Residual degrees of freedom of the whole problem.
    diagnostics : mapping
        JSON-able numbers and texts that belong to the method: iterations, weights, condition numbers, …
    """

    method: str
    parameters: tuple[str, ...]
    units: tuple[str, ...]
    values: Floats
    covariance: Floats
    outputs: tuple[str, ...]
    noise: Floats
    rows: tuple[int, ...]
    degrees: float
    diagnostics: Mapping[str, Any] = field(default_factory=dict)

    @property
    def std(self) -> Floats:
        """Standard deviations, shape (n,)."""
        return np.sqrt(np.maximum(np.diagonal(self.covariance), 0.0))

    @property
    def relative_std(self) -> Floats:
        """Standard deviations in per cent of the values, shape (n,); infinite where the value is zero."""
        with np.errstate(divide="ignore", invalid="ignore"):
            percent: Floats = np.where(
                self.values == 0, np.inf, 100 * self.std / np.abs(self.values)
            )
        return percent

    def interval(self, level: float = 0.95) -> Floats:
        """Confidence intervals from Student's distribution, shape (n, 2).

        Parameters
        ----------
        level : float
            Probability that an interval covers the true value.
        """
        half = self.quantile(level) * self.std
        return np.stack([self.values - half, self.values + half], axis=1)

    def quantile(self, level: float) -> float:
        """Half the width of an interval in standard deviations, by Student's distribution.

        Parameters
        ----------
        level : float
            Probability that the interval covers the true value.
        """
        with extra("identify"):
            from scipy.stats import t

        return float(t.ppf(0.5 + level / 2, max(self.degrees, 1.0)))

    def __repr__(self) -> str:
        return f"Estimate({self.method}: {len(self.values)} parameters from {sum(self.rows)} rows)"


CLEAR = 5.0
"""Standard deviations from which on something is more than noise: residuals that resemble their neighbours make
standard deviations too small by up to a half, and chance among hundreds of parameters reaches three."""

ROUNDING = float(np.sqrt(np.finfo(float).eps))
"""Share below which a quantity is no more than rounding: half of the digits of a double; no sensor has as many."""

NEGLIGIBLE = 1e-6
"""Share of a direction below which a parameter does not take part in it: rounding of vectors that are orthogonal."""


@dataclass(frozen=True, repr=False)
class WeightedSolution:
    """The minimum of Σ_i w_i² ‖W_i ζ − y_i‖² over outputs i."""

    observation: Observation
    weights: Floats  # shape (m,); factors w_i of the outputs' rows
    triangle: Triangle  # R-factor of the weighted rows of all outputs
    values: Floats  # shape (n,)
    root: Floats  # shape (n, n); R⁻¹; the inverse of the weighted WᵀW is root @ root.T

    @property
    def inverse(self) -> Floats:
        """Inverse of the weighted WᵀW, shape (n, n)."""
        return self.root @ self.root.T

    @property
    def degrees(self) -> float:
        """Rows with a weight, less parameters."""
        return float(self.triangle.rows - len(self.values))

    def whitened(self, output: int) -> Floats:
        """The weighted R_i times R⁻¹, shape (n_i, n): it has the cross product of the rows w_i W_i R⁻¹."""
        columns = list(self.observation.layout.columns[output])
        factor: Floats = (
            self.weights[output]
            * self.observation.factors[output][: len(columns), : len(columns)]
        )
        return factor @ self.root[columns]

    @cached_property
    def leverages(self) -> Floats:
        """Degrees of freedom that each output's rows pay for the parameters, shape (m,); they add up to n."""
        return np.array(
            [np.sum(self.whitened(i) ** 2) for i in range(len(self.weights))]
        )

    @cached_property
    def noise(self) -> Floats:
        """Standard deviation of each output's residual, shape (m,); nan where the rows are all used up."""
        counts = np.array(self.observation.counts, dtype=float)
        free = counts - self.leverages
        known = free > ROUNDING * np.maximum(counts, 1.0)
        misfits = self.observation.misfits(self.values)
        return np.where(known, misfits / np.sqrt(np.where(known, free, 1.0)), np.nan)


def solved(
    observation: Observation,
    units: Sequence[str],
    weights: Sequence[float] | Floats | None = None,
) -> WeightedSolution:
    """Weighted least squares."""
    check(observation, units)
    triangle = observation.combined(weights)
    if triangle.rank < len(triangle.parameters):
        raise InputError(undetermined(triangle))
    given = (
        np.ones(len(observation.layout.outputs))
        if weights is None
        else np.asarray(weights, dtype=float)
    )
    return WeightedSolution(
        observation, given, triangle, triangle.solve(), inverse_triangle(triangle.R)
    )


def check(observation: Observation, units: Sequence[str]) -> None:
    """Refuse what no estimator can work with."""
    layout = observation.layout
    if len(units) != len(layout.parameters):
        raise InputError(
            f"there are {len(units)} units for {len(layout.parameters)} parameters; expected one for each"
        )
    if not layout.parameters or not observation.rows:
        raise InputError(
            "there is nothing to estimate: the observation has no rows or no parameters"
        )
    for label, factor in zip(layout.outputs, observation.factors, strict=True):
        if not np.isfinite(factor).all():
            raise InputError(
                "its rows contain numbers that are not finite",
                element=f"output '{label}'",
            )


def check_rest(degrees: float) -> None:
    """Refuse rows that parameters use up, so that none tells the noise."""
    if degrees <= 0:
        raise InputError(
            "no row is left over to estimate the noise from; give more samples"
        )


def inverse_triangle(R: Floats) -> Floats:
    """R⁻¹ of an upper triangle without zeros on its diagonal; columns of very different sizes do no harm."""
    with extra("identify"):
        from scipy.linalg import solve_triangular

    scales = np.linalg.norm(R, axis=0)
    root: Floats = solve_triangular(R / scales, np.eye(len(R))) / scales[:, None]
    return root


def pseudo_root(R: Floats, rows: int) -> Floats:
    """Q with Qᵀ RᵀR Q = 1 on the directions that the R-factor of some rows determines, shape (n, rank)."""
    if not R.size:
        return np.zeros((len(R), 0))
    scales = safe_norms(R)
    singular, right = np.linalg.svd(R / scales)[1:]
    rank = int(np.sum(singular > np.finfo(float).eps * max(rows, len(R)) * singular[0]))
    root: Floats = (right[:rank] / singular[:rank, None] / scales).T
    return root


def augmented(triangle: Triangle) -> Floats:
    """The R-factor of [W y], shape (n + 1, n + 1)."""
    n = len(triangle.parameters)
    whole = np.zeros((n + 1, n + 1))
    whole[:n, :n] = triangle.R
    whole[:n, n] = triangle.qty
    whole[n, n] = triangle.residual
    return whole


# -- what the data leave open ----------------------------------------------------------------------------------------


def open_directions(triangle: Triangle) -> Floats:
    """Changes of the parameters that the data do not notice, shape (open, n), as sparse as elimination makes them.

    The first parameter of each, in the order of columns that can be told apart best, changes by 1.
    """
    scales = triangle.safe_scales
    found, pivots = sparse_basis(np.linalg.svd(triangle.scaled)[2][triangle.rank :])
    return found / scales * scales[pivots][:, None]


def sparse_basis(vectors: Floats) -> tuple[Floats, Integers]:
    """Rows that span the same space, each with a 1 where all others have 0, and these places."""
    with extra("identify"):
        from scipy.linalg import qr

    pivots = qr(vectors, mode="r", pivoting=True)[1][: len(vectors)].astype(np.intp)
    rows = np.asarray(np.linalg.solve(vectors[:, pivots], vectors), dtype=np.float64)
    rows[np.abs(rows) < NEGLIGIBLE] = 0.0
    return rows, pivots


def direction_text(direction: Floats, parameters: Sequence[str]) -> str:
    """A direction as a sum of parameters, such as ``ZZ2 − 0.5·M3``."""
    text = ""
    for value, label in zip(direction, parameters, strict=True):
        if value:
            sign = (
                ("−" if not text else " − ")
                if value < 0
                else ("" if not text else " + ")
            )
            factor = "" if abs(abs(value) - 1) < NEGLIGIBLE else f"{abs(value):.3g}·"
            text += f"{sign}{factor}{label}"
    return text


def undetermined(triangle: Triangle) -> str:
    """Message for data that do not determine all parameters."""
    n = len(triangle.parameters)
    start = f"the data determine {triangle.rank} of {n} parameters"
    if triangle.rows < n:
        start += f" (there are only {triangle.rows} rows)"
    texts = [
        direction_text(some, triangle.parameters) for some in open_directions(triangle)
    ]
    return (
        f"{start}; nothing changes along {enumerated(texts, '; ')}: excite these "
        "directions, fix parameters with known values, or give a prior: ridge(), online()"
    )


# -- results ---------------------------------------------------------------------------------------------------------


def estimate_of(
    solution: WeightedSolution,
    method: str,
    units: Sequence[str],
    covariance: Floats,
    diagnostics: Mapping[str, Any],
) -> Estimate:
    """A solution as an estimate, its condition numbers and weights among the diagnostics."""
    layout: Layout = solution.observation.layout
    triangle = solution.triangle
    conditions = {
        "condition": triangle.condition,
        "scaled_condition": triangle.scaled_condition,
    }
    shared = {
        "weights": solution.weights.tolist(),
        "iterations": 1,
        "converged": True,
        **conditions,
    }
    return Estimate(
        method,
        layout.parameters,
        tuple(units),
        solution.values,
        (covariance + covariance.T) / 2,
        layout.outputs,
        solution.noise,
        solution.observation.counts,
        solution.degrees,
        {**shared, **diagnostics},
    )
