"""Nonlinear least squares in currents, from R-factors alone.

A drive's row of 0 = x̄ᵀ ζ̄ + known − i K, over K, is the current that the model expects less the one that was measured.
So the sum of squares over all rows of an output is ‖R (ζ̄, K, −1)‖²/K²: a step of Levenberg's and Marquardt's method
costs as much as least squares on the triangles, however many rows there were.  Each drive's noise is estimated from its
own residual, and the fit is repeated with it until it stands.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from echelon.base import BaseModel
from echelon.compute import Observation, upper_triangle
from echelon.identification.estimators.estimate import (
    ROUNDING,
    Estimate,
    check_rest,
    inverse_triangle,
    solved,
)
from echelon.identification.estimators.least_squares import fixed_noise
from echelon.robot import Mechanism
from echelon.shared import Floats, InputError, extra


def gain_names(base: BaseModel) -> tuple[str, ...]:
    """Base parameters that are drive gains."""
    gains = drive_gain_effects(base.mechanism)
    return tuple(name for name in base.pivots if name in gains)


def drive_gain_effects(mechanism: Mechanism) -> tuple[str, ...]:
    """Parameters that are drive gains: effects that multiply a measured current."""
    return tuple(
        e.parameter
        for e in mechanism.effects
        if e.actions and all(a.kind == "drive_gain" for a in e.actions)
    )


@dataclass(frozen=True)
class _Output:
    """One output's triangle, and where the gain of its current is."""

    label: str
    columns: list[int]
    R: Floats
    rows: int
    place: int | None  # of the unknown gain among the columns

    def scale(self, values: Floats) -> float:
        return 1.0 if self.place is None else float(values[self.columns[self.place]])

    def residual(self, values: Floats) -> Floats:
        """Vector with the norm of the residual of all rows, in currents."""
        moved: Floats = (
            self.R @ np.append(values[self.columns], -1.0) / self.scale(values)
        )
        return moved

    def follows(self, values: Floats) -> bool:
        """Whether its currents follow the model by more than one sample's noise; else any larger gain does as well."""
        if self.place is None:
            return True
        # the derivative by the logarithm of the gain is the predicted current
        slopes = self.jacobian(values)[:, self.columns[self.place]]
        predicted = np.linalg.norm(slopes) * abs(self.scale(values))
        noise = np.linalg.norm(self.residual(values)) / np.sqrt(max(self.rows, 1))
        return bool(predicted > noise)

    @property
    def size(self) -> float:
        """Norm of all its currents, or of its measured values."""
        return float(
            np.linalg.norm(self.R[:, -1 if self.place is None else self.place])
        )

    def jacobian(self, values: Floats) -> Floats:
        """Derivative of the residual, shape (n_i + 1, n)."""
        found = np.zeros((len(self.R), len(values)))
        found[:, self.columns] = self.R[:, :-1] / self.scale(values)
        if self.place is not None:
            found[:, self.columns[self.place]] -= self.residual(values) / self.scale(
                values
            )
        return found


def fit_currents(
    observation: Observation,
    units: Sequence[str],
    gains: Sequence[Sequence[str]],
    *,
    tolerance: float = 1e-6,
    limit: int = 200,
) -> Estimate:
    """Maximum likelihood of an equation that is homogeneous but for known parts, noise being in the currents.

    Noise counts as found when its logarithm changes by less than a tolerance, which it does within a limit of fits.
    """
    start = solved(observation, units)
    check_rest(start.degrees)
    parts = _outputs(observation, gains)
    values, root = start.values, np.zeros((len(units), 0))

    def updated(noise: Floats) -> Floats:
        nonlocal values, root
        values, root = _fitted(parts, values, noise)
        return _noise(parts, values, root, noise)

    rough = _noise(parts, values, root, np.ones(len(parts)))
    noise, iterations, converged = fixed_noise(updated, rough, tolerance, limit)
    if not converged:
        raise InputError(_NOTHING_FOUND)
    scale = np.array([abs(part.scale(values)) for part in parts])
    diagnostics = {
        "iterations": iterations,
        "converged": True,
        "current_noise": noise.tolist(),
    }
    outputs, counts = observation.layout.outputs, observation.counts
    return Estimate(
        "drive gains",
        observation.layout.parameters,
        tuple(units),
        values,
        root @ root.T,
        outputs,
        noise * scale,
        counts,
        float(sum(counts) - len(values)),
        diagnostics,
    )


_NOTHING_FOUND = (
    "no drive gains were found that explain the currents best: they hardly follow the model; look for a wrong sign or "
    "order of currents, or give runs with a heavier load"
)
_NOT_FOLLOWED = (
    "it hardly follows the model, so that its gain grows without limit; look for a wrong sign or order of columns, or "
    "state its gain"
)


def _fitted(
    parts: Sequence[_Output], values: Floats, noise: Floats
) -> tuple[Floats, Floats]:
    """Values with the least squares, found from others, and the root of their covariance."""
    with extra("identify"):
        from scipy.optimize import least_squares

    def residuals(tried: Floats) -> Floats:
        return np.concatenate(
            [
                part.residual(tried) / sigma
                for part, sigma in zip(parts, noise, strict=True)
            ]
        )

    def slopes(tried: Floats) -> Floats:
        return np.concatenate(
            [
                part.jacobian(tried) / sigma
                for part, sigma in zip(parts, noise, strict=True)
            ]
        )

    triangle = upper_triangle(slopes(values))
    shares = np.abs(np.diagonal(triangle)) / np.maximum(
        np.linalg.norm(triangle, axis=0), np.finfo(float).tiny
    )
    if shares.min() < len(triangle) * np.finfo(float).eps:
        raise InputError(
            "the data do not determine the drive gains together with the other parameters"
        )
    found = least_squares(residuals, values, slopes, method="lm", x_scale="jac")
    is_same_sign = all(part.scale(found.x) * part.scale(values) > 0 for part in parts)
    if not (found.success and is_same_sign):
        raise InputError(_NOTHING_FOUND)
    for part in parts:
        if not part.follows(found.x):
            raise InputError(_NOT_FOLLOWED, element=f"output '{part.label}'")
    return found.x, inverse_triangle(upper_triangle(slopes(found.x)))


def _outputs(observation: Observation, gains: Sequence[Sequence[str]]) -> list[_Output]:
    layout, found = observation.layout, []
    for k, (label, columns, some) in enumerate(
        zip(layout.outputs, layout.columns, gains, strict=True)
    ):
        if len(some) > 1:
            raise InputError(
                f"it depends on several unknown gains ({', '.join(some)}), so its noise is not that of one current; "
                "measure in the drives",
                element=f"output '{label}'",
            )
        place = columns.index(layout.parameters.index(some[0])) if some else None
        found.append(
            _Output(
                label,
                list(columns),
                observation.factors[k],
                observation.counts[k],
                place,
            )
        )
    return found


def _noise(
    parts: Sequence[_Output], values: Floats, root: Floats, before: Floats
) -> Floats:
    """Standard deviation of each current, corrected for the degrees of freedom; rounding at least, shape (m,)."""
    found = []
    for part, sigma in zip(parts, before, strict=True):
        leverage = float(np.sum((part.jacobian(values) @ root / sigma) ** 2))
        spare = max(part.rows - leverage, 1.0)
        noise = np.linalg.norm(part.residual(values)) / np.sqrt(spare)
        rounding = ROUNDING * part.size / np.sqrt(max(part.rows, 1))
        found.append(max(noise, rounding, np.finfo(float).tiny))
    return np.array(found)
