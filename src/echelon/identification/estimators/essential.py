"""Essential parameters: the smaller model that is left when parameters which the data do not need are taken out.

Backward elimination, one parameter at a time, on the R-factor: taking a column out is a small QR, which loses no
digits, unlike updating (WᵀW)⁻¹; and by how much the residual grows is known before, Δ_j = ζ̂_j² / [(WᵀW)⁻¹]_jj.
Weights stay those of the full model all the way, so that criteria of different models compare.  Three criteria decide
when to stop:

``"bic"``
    Bayesian information N ln(ρ²/N) + k ln N falls with every elimination (Schwarz 1978).  The default: it finds the
    true model as data grow, and has no knob.
``"f-test"``
    The F-test of the least significant parameter does not reject that it is zero.
``"relative_std"``
    The largest relative standard deviation exceeds a multiple of the smallest (Pham and Gautier, "Essential parameters
    of robots", CDC 1991).  Customary in robotics.  It also drops parameters that are small but well seen, such as
    offsets near zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, get_args

import numpy as np

from echelon.compute import Observation, Triangle, upper_triangle
from echelon.identification.estimators.estimate import (
    Estimate,
    WeightedSolution,
    augmented,
    check,
    estimate_of,
    inverse_triangle,
)
from echelon.identification.estimators.least_squares import (
    checked_noise,
    noise_estimate,
)
from echelon.shared import Criterion, Floats, InputError, extra


@dataclass(frozen=True)
class Submodel:
    """The parameters that are left, and the triangle of [W y] in their columns."""

    kept: tuple[int, ...]  # numbers of the k parameters among those of the full model
    triangle: Floats  # shape (k + 1, k + 1); R-factor of [W y] in their columns, rows weighted; W has full rank
    rows: float  # rows of W, as many as count as independent

    @property
    def values(self) -> Floats:
        """Least-squares estimates, shape (k,)."""
        return self.root @ self.triangle[:-1, -1]

    @property
    def squares(self) -> float:
        """Sum of squares of the weighted residual."""
        return float(self.triangle[-1, -1] ** 2)

    @property
    def cofactor(self) -> Floats:
        """(WᵀW)⁻¹, shape (k, k)."""
        return self.root @ self.root.T

    @property
    def degrees(self) -> float:
        """Residual degrees of freedom, at least 1."""
        return max(self.rows - len(self.kept), 1.0)

    @property
    def variance(self) -> float:
        """Variance of the weighted residual; tiny where the data are fitted to rounding."""
        return max(self.squares, float(np.finfo(float).tiny)) / self.degrees

    @property
    def growth(self) -> Floats:
        """By how much the sum of squares grows when one parameter is taken out, shape (k,)."""
        return self.values**2 / np.diagonal(self.cofactor)

    @property
    def relative(self) -> Floats:
        """Relative standard deviations, shape (k,)."""
        deviations = np.sqrt(self.variance * np.diagonal(self.cofactor))
        with np.errstate(divide="ignore"):
            found: Floats = deviations / np.abs(self.values)
        return found

    @cached_property
    def root(self) -> Floats:
        """R⁻¹, shape (k, k)."""
        return inverse_triangle(self.triangle[:-1, :-1])

    def without(self, place: int) -> Submodel:
        """The model without one of its parameters."""
        kept = self.kept[:place] + self.kept[place + 1 :]
        return Submodel(
            kept, upper_triangle(np.delete(self.triangle, place, axis=1)), self.rows
        )


def essential(
    observation: Observation,
    units: Sequence[str],
    noise: Sequence[float] | Floats | None = None,
    *,
    criterion: Criterion = "bic",
    correlation: float = 1.0,
    level: float = 0.05,
    ratio: float = 10.0,
) -> Estimate:
    """Least squares with the essential parameters only, found by backward elimination.

    ``level`` is the significance of the F-test, ``ratio`` the multiple of the smallest relative standard deviation from
    which on a parameter is dropped; customary are 10 to 30.
    """
    names = observation.layout.parameters
    if criterion not in get_args(Criterion):
        raise InputError(
            f"criterion is '{criterion}'; expected one of {', '.join(get_args(Criterion))}"
        )
    check(observation, units)
    sigma = (
        noise_estimate(observation)
        if noise is None
        else checked_noise(observation, noise)
    )
    triangle = observation.combined(1 / sigma)
    rows = triangle.rows / correlation
    kept, history = _determined(triangle)
    model = Submodel(
        kept, upper_triangle(augmented(triangle)[:, [*kept, len(names)]]), rows
    )
    while model.kept:
        place = int(
            np.argmax(model.relative if criterion == "relative_std" else -model.growth)
        )
        smaller = model.without(place)
        before = _value(model, criterion)
        if (
            not before
            > {"bic": _value(smaller, "bic"), "f-test": level, "relative_std": ratio}[
                criterion
            ]
        ):
            break
        history.append(
            {
                "parameter": names[model.kept[place]],
                "before": before,
                "after": _value(smaller, criterion),
                "rms": float(np.sqrt(smaller.squares / smaller.rows)),
            }
        )
        model = smaller
    diagnostics = {
        "criterion": criterion,
        "history": history,
        "eliminated": [record["parameter"] for record in history],
        "kept": [names[k] for k in model.kept],
        "correlation": correlation,
    }
    return _estimate(observation, units, sigma, triangle, model, diagnostics)


# -- criteria ---------------------------------------------------------------------------------------------------------


def _value(model: Submodel, criterion: Criterion) -> float:
    """The criterion of a whole model."""
    if criterion == "bic":
        spread = max(model.squares, float(np.finfo(float).tiny)) / model.rows
        return float(model.rows * np.log(spread) + len(model.kept) * np.log(model.rows))
    if not model.kept:
        return 0.0
    if criterion == "f-test":
        return _significance(model, int(np.argmin(model.growth)))
    relative = model.relative
    return float(relative.max() / relative.min()) if relative.min() else float("inf")


def _significance(model: Submodel, place: int) -> float:
    """p-value of the hypothesis that a parameter is zero."""
    with extra("identify"):
        from scipy.special import fdtrc

    return float(fdtrc(1, model.degrees, model.growth[place] / model.variance))


# -- beginning and end ------------------------------------------------------------------------------------------------


def _determined(triangle: Triangle) -> tuple[tuple[int, ...], list[dict[str, Any]]]:
    """Parameters without those that the data leave open in the others' presence: taking them out costs nothing."""
    with extra("identify"):
        from scipy.linalg import qr

    n = len(triangle.parameters)
    if triangle.rank == n:
        return tuple(range(n)), []
    kept = tuple(
        sorted(
            qr(triangle.scaled, mode="r", pivoting=True)[1][: triangle.rank].tolist()
        )
    )
    gone = [triangle.parameters[k] for k in range(n) if k not in kept]
    rms = triangle.residual / np.sqrt(max(triangle.rows, 1))
    return kept, [
        {"parameter": name, "before": None, "after": None, "rms": float(rms)}
        for name in gone
    ]


def _estimate(
    observation: Observation,
    units: Sequence[str],
    noise: Floats,
    triangle: Triangle,
    model: Submodel,
    diagnostics: dict[str, Any],
) -> Estimate:
    n, kept = len(triangle.parameters), list(model.kept)
    values, root = np.zeros(n), np.zeros((n, len(kept)))
    values[kept], root[kept] = model.values, model.root
    solution = WeightedSolution(observation, 1 / noise, triangle, values, root)
    method = f"essential ({diagnostics['criterion']})"
    covariance = model.variance * solution.inverse
    return replace(
        estimate_of(solution, method, units, covariance, diagnostics),
        degrees=model.degrees,
    )
