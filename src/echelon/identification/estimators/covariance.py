"""Covariance that stays honest when neighbouring residuals resemble one another.

Residuals of real robots are not white: friction and elasticity that the model lacks make neighbours alike, and
classical standard deviations come out several times too small.  Rows are therefore cut into batches of time, the
residuals' pull g_c = Σ Wᵀ(y − Wζ)/σ² is added up within each, and only batches are taken to be independent (Liang &
Zeger, Biometrika 73, 1986).  Instead of the plain sandwich A⁻¹ (Σ g_c g_cᵀ) A⁻¹, which is too small for few batches,
each batch is left out in turn: ζ₍c₎ − ζ = −(A − A_c)⁻¹ g_c exactly, so that the jackknife costs no refit (MacKinnon &
White, J. Econometrics 29, 1985; CR3 of Bell & McCaffrey, Survey Methodology 28, 2002).

All that this needs of a batch is its R-factor.  A robust estimate pulls with clipped residuals ψ: its batches are those
of rows [W, W ζ + ψ], of which ψ is what is left.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from echelon.identification.batches import Batcher, TimeBatch, total
from echelon.identification.estimators.estimate import (
    ROUNDING,
    Estimate,
    WeightedSolution,
    pseudo_root,
    solved,
)
from echelon.identification.rows.rows import RowBlock, RowStream
from echelon.shared import Floats, InputError

# estimators whose covariance can come from batches of time
BATCHED = ("ols", "wls", "irls", "huber")
_BY_FACTORS = ("ols", "wls", "irls")


def clustered(
    rows: RowStream,
    estimate: Estimate,
    *,
    seconds: float | None = None,
    clusters: int = 40,
) -> Estimate:
    """An estimate with a covariance from batches of time, which are cut from its rows."""
    if estimate.method not in BATCHED:
        raise InputError(
            f"the covariance of '{estimate.method}' has no batches; expected one of {', '.join(BATCHED)}"
        )
    if (estimate.parameters, estimate.outputs) != (
        rows.layout.parameters,
        rows.layout.outputs,
    ):
        raise InputError("the rows have other parameters or outputs than the estimate")
    length = _length(rows, clusters) if seconds is None else float(seconds)
    if not (np.isfinite(length) and length > 0):
        raise InputError(
            f"batches of {length} s; expected a positive number of seconds"
        )
    batchers: dict[str, Batcher] = {}
    for block in rows.blocks():
        batcher = batchers.setdefault(block.source, Batcher(width=length))
        batcher.take(_clipped(block, rows, estimate), rows.layout)
    return _jackknifed(
        [batch for some in batchers.values() for batch in some.batches()],
        rows.units,
        estimate,
    )


def clustered_by(
    batches: Sequence[TimeBatch], units: Sequence[str], estimate: Estimate
) -> Estimate:
    """An estimate with a covariance from batches whose R-factors are there already."""
    if estimate.method not in _BY_FACTORS:
        raise InputError(
            f"R-factors do not determine the covariance of '{estimate.method}'; expected ols, wls or irls"
        )
    return _jackknifed(batches, units, estimate)


def _clipped(block: RowBlock, rows: RowStream, estimate: Estimate) -> RowBlock:
    """Rows whose residuals are those that a robust estimate pulls with."""
    clips = estimate.diagnostics.get("clips")
    if clips is None:
        return block
    predicted = [
        matrix @ estimate.values[list(columns)]
        for matrix, columns in zip(block.matrices, rows.layout.columns, strict=True)
    ]
    outputs = zip(block.y, predicted, clips, strict=True)
    return replace(
        block,
        y=tuple(guess + np.clip(y - guess, -clip, clip) for y, guess, clip in outputs),
    )


def _jackknifed(
    batches: Sequence[TimeBatch], units: Sequence[str], estimate: Estimate
) -> Estimate:
    """An estimate with the covariance of leaving out one batch after another."""
    count = len(batches)
    if count < 2:
        raise InputError("all rows lie within one batch: use shorter batches")
    jackknife = _Jackknife.of(batches, units, estimate)
    changes = np.array([jackknife.left_out(batch) for batch in batches])
    spread = np.sqrt((count - 1) / count) * changes @ jackknife.solution.root.T
    inflation = jackknife.inflation(batches)
    pairs = zip(estimate.outputs, estimate.rows, inflation, strict=True)
    found = {
        "covariance": "jackknife by batch",
        "seconds": float(np.median([batch.seconds for batch in batches])),
        "clusters": count,
        "inflation": dict(zip(estimate.outputs, map(float, inflation), strict=True)),
        "effective_rows": {
            label: float(rows / max(value, 1.0)) for label, rows, value in pairs
        },
    }
    covariance: Floats = spread.T @ spread
    diagnostics = {**estimate.diagnostics, **found}
    return replace(
        estimate,
        covariance=covariance,
        degrees=float(count - 1),
        diagnostics=diagnostics,
    )


@dataclass(frozen=True)
class _Jackknife:
    """Coordinates in which the whole WᵀW is the unit matrix, and how much residuals of each output pull in them."""

    estimate: Estimate
    solution: WeightedSolution
    weights: Floats  # shape (m,)
    slopes: Floats  # shape (m,); of the pull by the residual: below 1 where residuals are clipped

    @staticmethod
    def of(
        batches: Sequence[TimeBatch], units: Sequence[str], estimate: Estimate
    ) -> _Jackknife:
        weights = np.asarray(estimate.diagnostics["weights"], dtype=float)
        slopes = np.asarray(
            estimate.diagnostics.get("slopes", np.ones_like(weights)), dtype=float
        )
        solution = solved(total(batches), units, weights * np.sqrt(slopes))
        return _Jackknife(estimate, solution, weights, slopes)

    def left_out(self, batch: TimeBatch) -> Floats:
        """R (ζ − ζ₍c₎), shape (n,), where ζ₍c₎ are the values without a batch."""
        n = len(self.estimate.values)
        pull, gram = np.zeros(n), np.zeros((n, n))
        for output, R in enumerate(batch.observation.factors):
            columns = list(self.solution.observation.layout.columns[output])
            white = R[:, :-1] @ self.solution.root[columns]
            weight = self.weights[output] ** 2
            pull += weight * self._residual(output, R) @ white
            gram += weight * self.slopes[output] * white.T @ white
        rest: Floats = np.eye(n) - gram
        try:
            np.linalg.cholesky(rest - ROUNDING * np.eye(n))
        except np.linalg.LinAlgError:
            raise self._needed(batch, gram) from None
        return np.asarray(np.linalg.solve(rest, pull), dtype=np.float64)

    def _residual(self, output: int, R: Floats) -> Floats:
        columns = list(self.solution.observation.layout.columns[output])
        found: Floats = R[:, -1] - R[:, :-1] @ self.estimate.values[columns]
        return found

    def _needed(self, batch: TimeBatch, gram: Floats) -> InputError:
        """Why a batch cannot be left out: without it something is not determined."""
        directions = np.linalg.eigh(gram)[1]
        weight = np.abs(
            self.solution.triangle.R.T
            @ directions[:, -1]
            / self.solution.triangle.scales
        )
        names = ", ".join(self.estimate.parameters[k] for k in np.argsort(-weight)[:3])
        return InputError(
            f"only this batch determines a combination of {names}, and no other batch confirms it: use shorter "
            "batches, or more data",
            element=f"batch {batch.name}",
        )

    def inflation(self, batches: Sequence[TimeBatch]) -> Floats:
        """Variance of each output's pull relative to white residuals, shape (m,); 1 for outputs without rows."""
        observation, found = self.solution.observation, np.ones(len(self.weights))
        for output, (whole, rows) in enumerate(
            zip(observation.factors, observation.counts, strict=True)
        ):
            root = pseudo_root(whole[:-1, :-1], rows)
            factors = [batch.observation.factors[output] for batch in batches]
            residuals = [self._residual(output, R) for R in factors]
            pulls = [
                rest @ R[:, :-1] @ root
                for rest, R in zip(residuals, factors, strict=True)
            ]
            white = root.shape[1] * np.sum(np.square(residuals)) / max(rows, 1)
            if white > 0:
                found[output] = np.sum(np.square(pulls)) / white
        return found


def _length(rows: RowStream, clusters: int) -> float:
    """Length of a batch, s, that gives about ``clusters`` batches."""
    if clusters < 2:
        raise InputError(f"{clusters} clusters; expected at least two")
    spans: dict[str, tuple[float, float]] = {}
    for block in rows.blocks():
        times = [some for some in block.times if some.size]
        if times:
            first, last = spans.get(block.source, (np.inf, -np.inf))
            spans[block.source] = (
                min(first, *(s[0] for s in times)),
                max(last, *(s[-1] for s in times)),
            )
    total = sum(last - first for first, last in spans.values())
    if not total > 0:
        raise InputError("the rows span no time, so they cannot be cut into batches")
    return total * (1 + 1e-9) / clusters
