"""Nonlinear least squares in currents, from R-factors alone.

A drive's row of 0 = x̄ᵀ ζ̄ + known − i K, over K, is the current that the model expects less the one that was measured.
So the sum of squares over all rows of an output is ‖R (ζ̄, K, −1)‖²/K²: a Gauss–Newton step costs as much as least
squares on the triangles, however many rows there were.  Each drive's noise is estimated from its own residual.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from echelon.arrays import Floats
from echelon.base.model import BaseModel
from echelon.errors import InputError
from echelon.identification.estimators.estimate import (
    Estimate,
    inverse_triangle,
    solved,
)
from echelon.observe.observation import Observation
from echelon.observe.triangle import upper_triangle

_STEPS = 200
_SETTLED = 1e-6  # step in standard deviations that changes nothing
_ROUNDING = 1e-11  # step in parts of the currents that is rounding
_HALVINGS = 30


_GAIN = re.compile(r"-\s*i(\[.*\])?")


def gain_names(base: BaseModel) -> tuple[str, ...]:
    """Base parameters that are drive gains: effects that multiply a measured current."""
    gains = {
        e.parameter
        for e in base.mechanism.effects
        if e.actions and all(_GAIN.fullmatch(a.term.strip()) for a in e.actions)
    }
    return tuple(name for name in base.pivots if name in gains)


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
    observation: Observation, units: Sequence[str], gains: Sequence[Sequence[str]]
) -> Estimate:
    """Maximum likelihood of an equation that is homogeneous but for known parts, noise being in the currents."""
    start = solved(observation, units)
    if start.degrees <= 0:
        raise InputError(
            "no row is left over to estimate the noise from; give more samples"
        )
    parts = _outputs(observation, gains)
    values = start.values
    noise = _first_noise(parts, values)
    iterations = 0
    settled = False
    while not settled and iterations < _STEPS:
        iterations += 1
        root, change = _step(parts, values, noise)
        settled = _settled(
            parts, np.asarray(np.linalg.solve(root, change), dtype=np.float64), noise
        )
        values = _walked(parts, values, change, noise)
        noise = _noise(parts, values, root, noise)
    if not settled:
        raise InputError(
            "no drive gains were found that explain the currents best: they hardly follow the model; look for a wrong "
            "sign or order of currents, or give runs with a heavier load"
        )
    root, _ = _step(parts, values, noise)
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


def _first_noise(parts: Sequence[_Output], values: Floats) -> Floats:
    """Rough noise of each current: all of it that least squares leaves."""
    sizes = np.array(
        [
            np.linalg.norm(part.residual(values)) / np.sqrt(max(part.rows, 1))
            for part in parts
        ]
    )
    noise: Floats = np.maximum(sizes, _floor(parts))
    return noise


def _noise(
    parts: Sequence[_Output], values: Floats, root: Floats, before: Floats
) -> Floats:
    """Standard deviation of each current, corrected for the degrees of freedom."""
    found = []
    for part, sigma in zip(parts, before, strict=True):
        leverage = float(np.sum((part.jacobian(values) @ root / sigma) ** 2))
        found.append(
            np.linalg.norm(part.residual(values))
            / np.sqrt(max(part.rows - leverage, 1.0))
        )
    return np.maximum(found, _floor(parts))


def _floor(parts: Sequence[_Output]) -> Floats:
    """What is noise by rounding only: a part of the current, or of the measured value."""
    return np.array(
        [max(1e-10 * part.size / np.sqrt(max(part.rows, 1)), 1e-300) for part in parts]
    )


def _settled(parts: Sequence[_Output], step: Floats, noise: Floats) -> bool:
    """Whether a step, in standard deviations, is none."""
    size = np.linalg.norm(
        [part.size / sigma for part, sigma in zip(parts, noise, strict=True)]
    )
    return bool(
        np.linalg.norm(step) < max(_SETTLED * np.sqrt(len(step)), _ROUNDING * size)
    )


def _step(
    parts: Sequence[_Output], values: Floats, noise: Floats
) -> tuple[Floats, Floats]:
    """Root of the covariance, and the Gauss–Newton step."""
    stacked = np.vstack(
        [
            np.column_stack([part.jacobian(values), part.residual(values)]) / sigma
            for part, sigma in zip(parts, noise, strict=True)
        ]
    )
    triangle = upper_triangle(stacked)[:-1]
    diagonal = np.abs(np.diagonal(triangle)) / np.linalg.norm(
        triangle[:, :-1], axis=0
    ).clip(min=1e-300)
    if diagonal.min() < 1e-13:
        raise InputError(
            "the data do not determine the drive gains together with the other parameters"
        )
    root = inverse_triangle(triangle[:, :-1])
    change: Floats = -root @ triangle[:, -1]
    return root, change


def _walked(
    parts: Sequence[_Output], values: Floats, change: Floats, noise: Floats
) -> Floats:
    """Values after a step that is as long as it may be while the sum of squares falls and no gain changes its sign."""
    before = _squares(parts, values, noise)
    for halving in range(_HALVINGS):
        tried: Floats = values + change / 2**halving
        kept = all(part.scale(tried) * part.scale(values) > 0 for part in parts)
        if kept and _squares(parts, tried, noise) <= before * (1 + 1e-12):
            return tried
    return values


def _squares(parts: Sequence[_Output], values: Floats, noise: Floats) -> float:
    return float(
        sum(
            np.sum((part.residual(values) / s) ** 2)
            for part, s in zip(parts, noise, strict=True)
        )
    )
