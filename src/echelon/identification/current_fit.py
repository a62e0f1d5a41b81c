"""Nonlinear least squares in currents, from R-factors alone.

A drive's row of 0 = x̄ᵀ ζ̄ + known − i K, over K, is the current that the model expects less the one that was measured.
So the sum of squares over all rows of an output is ‖R (ζ̄, K, −1)‖²/K²: a Gauss–Newton step costs as much as least
squares on the triangles, however many rows there were.  Each drive's noise is estimated from its own residual.

The same fit tells whether outputs are in units that contradict each other: each output's unit, but for one, is taken
for an unknown gain.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from echelon.arrays import Floats
from echelon.base.model import BaseModel
from echelon.errors import InputError
from echelon.identification.estimators.estimate import Estimate, inverse_triangle, solved
from echelon.observe.observation import Layout, Observation
from echelon.observe.triangle import safe_norms, upper_triangle

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
        moved: Floats = self.R @ np.append(values[self.columns], -1.0) / self.scale(values)
        return moved

    @property
    def size(self) -> float:
        """Norm of all its currents, or of its measured values."""
        return float(np.linalg.norm(self.R[:, -1 if self.place is None else self.place]))

    def jacobian(self, values: Floats) -> Floats:
        """Derivative of the residual, shape (n_i + 1, n)."""
        found = np.zeros((len(self.R), len(values)))
        found[:, self.columns] = self.R[:, :-1] / self.scale(values)
        if self.place is not None:
            found[:, self.columns[self.place]] -= self.residual(values) / self.scale(values)
        return found


def fit_currents(observation: Observation, units: Sequence[str], gains: Sequence[Sequence[str]]) -> Estimate:
    """Maximum likelihood of an equation that is homogeneous but for known parts, noise being in the currents."""
    start = solved(observation, units)
    if start.degrees <= 0:
        raise InputError("no row is left over to estimate the noise from; give more samples")
    parts = _outputs(observation, gains)
    values = start.values
    noise = _first_noise(parts, values)
    iterations = 0
    settled = False
    while not settled and iterations < _STEPS:
        iterations += 1
        root, change = _step(parts, values, noise)
        settled = _settled(parts, np.asarray(np.linalg.solve(root, change), dtype=np.float64), noise)
        values = _walked(parts, values, change, noise)
        noise = _noise(parts, values, root, noise)
    if not settled:
        raise InputError(
            "no drive gains were found that explain the currents best: they hardly follow the model; look for a wrong "
            "sign or order of currents, or give runs with a heavier load"
        )
    root, _ = _step(parts, values, noise)
    scale = np.array([abs(part.scale(values)) for part in parts])
    diagnostics = {"iterations": iterations, "converged": True, "current_noise": noise.tolist()}
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
    for k, (label, columns, some) in enumerate(zip(layout.outputs, layout.columns, gains, strict=True)):
        if len(some) > 1:
            raise InputError(
                f"it depends on several unknown gains ({', '.join(some)}), so its noise is not that of one current; "
                "measure in the drives",
                element=f"output '{label}'",
            )
        place = columns.index(layout.parameters.index(some[0])) if some else None
        found.append(_Output(label, list(columns), observation.factors[k], observation.counts[k], place))
    return found


def _first_noise(parts: Sequence[_Output], values: Floats) -> Floats:
    """Rough noise of each current: all of it that least squares leaves."""
    sizes = np.array([np.linalg.norm(part.residual(values)) / np.sqrt(max(part.rows, 1)) for part in parts])
    noise: Floats = np.maximum(sizes, _floor(parts))
    return noise


def _noise(parts: Sequence[_Output], values: Floats, root: Floats, before: Floats) -> Floats:
    """Standard deviation of each current, corrected for the degrees of freedom."""
    found = []
    for part, sigma in zip(parts, before, strict=True):
        leverage = float(np.sum((part.jacobian(values) @ root / sigma) ** 2))
        found.append(np.linalg.norm(part.residual(values)) / np.sqrt(max(part.rows - leverage, 1.0)))
    return np.maximum(found, _floor(parts))


def _floor(parts: Sequence[_Output]) -> Floats:
    """What is noise by rounding only: a part of the current, or of the measured value."""
    return np.array([max(1e-10 * part.size / np.sqrt(max(part.rows, 1)), 1e-300) for part in parts])


def _settled(parts: Sequence[_Output], step: Floats, noise: Floats) -> bool:
    """Whether a step, in standard deviations, is none."""
    size = np.linalg.norm([part.size / sigma for part, sigma in zip(parts, noise, strict=True)])
    return bool(np.linalg.norm(step) < max(_SETTLED * np.sqrt(len(step)), _ROUNDING * size))


def _step(parts: Sequence[_Output], values: Floats, noise: Floats) -> tuple[Floats, Floats]:
    """Root of the covariance, and the Gauss–Newton step."""
    stacked = np.vstack(
        [
            np.column_stack([part.jacobian(values), part.residual(values)]) / sigma
            for part, sigma in zip(parts, noise, strict=True)
        ]
    )
    triangle = upper_triangle(stacked)[:-1]
    diagonal = np.abs(np.diagonal(triangle)) / np.linalg.norm(triangle[:, :-1], axis=0).clip(min=1e-300)
    if diagonal.min() < 1e-13:
        raise InputError("the data do not determine the drive gains together with the other parameters")
    root = inverse_triangle(triangle[:, :-1])
    change: Floats = -root @ triangle[:, -1]
    return root, change


def _walked(parts: Sequence[_Output], values: Floats, change: Floats, noise: Floats) -> Floats:
    """Values after a step that is as long as it may be while the sum of squares falls and no gain changes its sign."""
    before = _squares(parts, values, noise)
    for halving in range(_HALVINGS):
        tried: Floats = values + change / 2**halving
        kept = all(part.scale(tried) * part.scale(values) > 0 for part in parts)
        if kept and _squares(parts, tried, noise) <= before * (1 + 1e-12):
            return tried
    return values


def _squares(parts: Sequence[_Output], values: Floats, noise: Floats) -> float:
    return float(sum(np.sum((part.residual(values) / s) ** 2) for part, s in zip(parts, noise, strict=True)))


# -- outputs that are in other units ----------------------------------------------------------------------------------


_APART, _REMOVED = 1.4, 0.3
"""Ratio of gains, and share of an output's squares that gains of their own remove, from which on outputs contradict."""
_TOLD = 0.1  # relative standard deviation up to which the data tell a gain
_MEETING = 1e-9  # singular value, relative to the largest, below which directions of rows are the same


def contradicting_gains(
    observation: Observation, units: Sequence[str], noise: Floats
) -> tuple[dict[str, float], float]:
    """Outputs that contradict others through what they share, with factors that reconcile them.

    With them the logarithm by which these factors reduce residuals, the mean of all outputs.
    """
    used = [k for k, count in enumerate(observation.counts) if count and np.isfinite(noise[k])]
    found: dict[str, float] = {}
    reduction = 0.0
    for group in _one_scale(observation, used):
        factors, gain = _contradicting(observation, units, noise, group)
        found |= factors
        reduction += gain / len(observation.counts)
    return found, reduction


def _one_scale(observation: Observation, outputs: Sequence[int]) -> list[list[int]]:
    """Outputs whose gains the data relate: the spaces of their rows meet."""
    layout = observation.layout
    rows = {}
    for k in outputs:
        rows[k] = np.zeros((len(observation.factors[k]), len(layout.parameters)))
        rows[k][:, layout.columns[k]] = observation.factors[k][:, :-1]
    scales = safe_norms(np.concatenate(list(rows.values()))) if rows else np.ones(0)

    def rank(group: Sequence[int]) -> int:
        parts = [rows[k] / scales for k in group]
        stacked = np.concatenate([part / (np.linalg.norm(part) or 1.0) for part in parts])
        singular = np.linalg.svd(stacked, compute_uv=False)
        return int(np.sum(singular > _MEETING * singular[0]))

    groups = [[k] for k in outputs]
    while True:
        pairs = combinations(groups, 2)
        meeting = next(((a, b) for a, b in pairs if rank(a + b) < rank(a) + rank(b)), None)
        if meeting is None:
            return [sorted(group) for group in groups if len(group) > 1]
        groups = [g for g in groups if g not in meeting] + [meeting[0] + meeting[1]]


def _contradicting(
    observation: Observation, units: Sequence[str], noise: Floats, group: Sequence[int]
) -> tuple[dict[str, float], float]:
    """Of outputs with one scale: each unit is an unknown gain, but for one; gains are compared with the usual one."""
    layout, scaled = observation.layout, group[1:]
    names = tuple(f"gain of {layout.outputs[k]}" for k in scaled)
    try:
        found = fit_currents(
            _with_gains(observation, scaled, names),
            [*units, *("" for _ in names)],
            [(names[scaled.index(k)],) if k in scaled else () for k in range(len(layout.outputs))],
        )
    except InputError:  # the data do not tell
        return {}, 0.0
    gains = np.array([1.0, *found.values[len(layout.parameters) :]])
    deviations = np.array([0.0, *found.std[len(layout.parameters) :]])
    told = (gains > 0) & (deviations < _TOLD * np.abs(gains))
    left = np.abs(found.noise[group] / gains / noise[group])
    if not (1 - left[told] ** 2 > _REMOVED).any():
        return {}, 0.0
    factors = gains / _usual_gain(np.sort(gains[told]))
    some = zip(group, factors, told, strict=True)
    apart = {layout.outputs[k]: float(f) for k, f, clear in some if clear and not 1 / _APART < f < _APART}
    return apart, -float(np.log(left).sum())


def _usual_gain(gains: Floats) -> float:
    """Of gains in their order the one that half of them or more are like, else the median."""
    alike = np.sum(np.abs(np.log(np.divide.outer(gains, gains))) < 0.5 * np.log(_APART), axis=1)
    return float(gains[np.argmax(alike) if 2 * alike.max() >= len(gains) else (len(gains) - 1) // 2])


def _with_gains(observation: Observation, scaled: Sequence[int], names: tuple[str, ...]) -> Observation:
    """The equations 0 = X ζ − y K for some outputs, as they are for the others."""
    layout, count = observation.layout, len(observation.layout.parameters)
    columns, factors = list(layout.columns), list(observation.factors)
    for place, k in enumerate(scaled):
        columns[k] = (*columns[k], count + place)
        R = factors[k]
        factors[k] = upper_triangle(np.column_stack([R[:, :-1], -R[:, -1], np.zeros(len(R))]))
    whole = Layout(layout.outputs, (*layout.parameters, *names), tuple(columns))
    return Observation(whole, tuple(factors), observation.counts)
