"""Covariance that stays honest when neighbouring residuals resemble one another.

Residuals of real robots are not white: friction and elasticity that the model lacks make neighbours alike, and
classical standard deviations come out several times too small.  Rows are therefore cut into batches of time, the
residuals' pull g_c = Σ Wᵀ(y − Wζ)/σ² is added up within each, and only batches are taken to be independent (Liang &
Zeger, Biometrika 73, 1986).  Instead of the plain sandwich A⁻¹ (Σ g_c g_cᵀ) A⁻¹, which is too small for few batches,
each batch is left out in turn: ζ₍c₎ − ζ = −(A − A_c)⁻¹ g_c exactly, so that the jackknife costs no refit (MacKinnon &
White, J. Econometrics 29, 1985; CR3 of Bell & McCaffrey, Survey Methodology 28, 2002).  One pass over the rows is
enough; or none at all, where the R-factors of batches are there already.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.identification.estimators.estimate import Estimate, Solution, solved
from echelon.identification.passes_over_data import Batch, total
from echelon.identification.rows.rows import Rows
from echelon.observe.observation import Observation
from echelon.observe.triangle import safe_norms

BATCHED = (
    "ols",
    "wls",
    "irls",
    "huber",
)  # estimators whose covariance can come from batches of time
_BY_FACTORS = ("ols", "wls", "irls")
_ALL = 1e-9


def clustered(
    rows: Rows, estimate: Estimate, *, seconds: float | None = None, clusters: int = 40
) -> Estimate:
    """The same estimate with a covariance from batches of time."""
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
    scores = _Scores.of(rows.observation(), rows.units, estimate)
    return _judged(estimate, scores, _batches(rows, scores, length), length)


def clustered_by(
    batches: Sequence[Batch], units: Sequence[str], estimate: Estimate
) -> Estimate:
    """The same from the R-factors of batches, without another pass over the rows."""
    if estimate.method not in _BY_FACTORS:
        raise InputError(
            f"R-factors do not determine the covariance of '{estimate.method}'; expected ols, wls or irls"
        )
    if len(batches) < 2:
        raise InputError("all rows lie within one batch: use shorter batches")
    scores = _Scores.of(total(batches), units, estimate)
    length = float(np.median([batch.seconds for batch in batches]))
    return _judged(estimate, scores, _from_factors(batches, scores), length)


def _judged(
    estimate: Estimate, scores: _Scores, batches: Iterable[_Batch], length: float
) -> Estimate:
    """The estimate with the covariance that its batches make."""
    changes, sums = [], np.zeros(len(estimate.outputs))
    for batch in batches:
        changes.append(scores.left_out(batch))
        sums += batch.own
    count = len(changes)
    if count < 2:
        raise InputError(
            f"all rows lie within one batch of {length:g} s: use shorter batches"
        )
    spread = np.sqrt((count - 1) / count) * np.array(changes) @ scores.solution.root.T
    inflation = scores.inflation(sums)
    effective = {
        label: float(k / max(v, 1.0))
        for label, k, v in zip(estimate.outputs, estimate.rows, inflation, strict=True)
    }
    found = {
        "covariance": "jackknife by batch",
        "seconds": length,
        "clusters": count,
        "inflation": dict(zip(estimate.outputs, map(float, inflation), strict=True)),
        "effective_rows": effective,
    }
    covariance: Floats = spread.T @ spread
    diagnostics = {**estimate.diagnostics, **found}
    return replace(
        estimate,
        covariance=covariance,
        degrees=float(count - 1),
        diagnostics=diagnostics,
    )


@dataclass
class _Batch:
    """Sums over the rows of one batch, in coordinates where the whole WᵀW is the unit matrix."""

    name: str
    pull: Floats  # Σ R⁻ᵀWᵀψ, shape (n,)
    gram: Floats  # Σ R⁻ᵀWᵀW R⁻¹, shape (n, n)
    output_pulls: list[
        Floats
    ]  # the same for each output's own columns and own unit matrix

    @property
    def own(self) -> Floats:
        """Squared norm of each output's own pull, shape (m,)."""
        return np.array([pull @ pull for pull in self.output_pulls])


@dataclass(frozen=True)
class _Scores:
    """What turns rows into pulls: weights, clips, and the coordinates in which WᵀW is the unit matrix."""

    estimate: Estimate
    solution: Solution
    weights: Floats
    clips: Floats
    slopes: Floats
    own_roots: tuple[Floats, ...]
    squares: Floats  # Σ ψ² of each output, filled while the rows pass

    @staticmethod
    def of(
        observation: Observation, units: Sequence[str], estimate: Estimate
    ) -> _Scores:
        m = len(estimate.outputs)
        weights = np.asarray(estimate.diagnostics["weights"], dtype=float)
        clips = np.asarray(estimate.diagnostics.get("clips", [np.inf] * m), dtype=float)
        slopes = np.asarray(estimate.diagnostics.get("slopes", [1.0] * m), dtype=float)
        solution = solved(observation, units, weights * np.sqrt(slopes))
        roots = tuple(
            _pseudo_root(R[:-1, :-1], k)
            for R, k in zip(observation.factors, observation.counts, strict=True)
        )
        return _Scores(estimate, solution, weights, clips, slopes, roots, np.zeros(m))

    def empty(self, name: str) -> _Batch:
        n = len(self.estimate.values)
        return _Batch(
            name,
            np.zeros(n),
            np.zeros((n, n)),
            [np.zeros(root.shape[1]) for root in self.own_roots],
        )

    def add(self, batch: _Batch, output: int, matrix: Floats, y: Floats) -> None:
        """Take in rows of one output."""
        columns = list(self.solution.observation.layout.columns[output])
        residual = np.clip(
            y - matrix @ self.estimate.values[columns],
            -self.clips[output],
            self.clips[output],
        )
        white = matrix @ self.solution.root[columns]
        weight = self.weights[output] ** 2
        batch.pull += weight * residual @ white
        batch.gram += weight * self.slopes[output] * white.T @ white
        batch.output_pulls[output] += residual @ matrix @ self.own_roots[output]
        self.squares[output] += residual @ residual

    def left_out(self, batch: _Batch) -> Floats:
        """R (ζ − ζ₍c₎), shape (n,)."""
        rest: Floats = np.eye(len(batch.gram)) - batch.gram
        try:
            np.linalg.cholesky(rest - _ALL * np.eye(len(rest)))
        except np.linalg.LinAlgError:
            raise self._needed(batch) from None
        return np.asarray(np.linalg.solve(rest, batch.pull), dtype=np.float64)

    def _needed(self, batch: _Batch) -> InputError:
        """Why a batch cannot be left out: without it something is not determined."""
        shares, directions = np.linalg.eigh(batch.gram)
        if shares[0] > 1 - _ALL:
            return InputError(
                "it holds all that the data say: use shorter batches",
                element=batch.name,
            )
        weight = np.abs(
            self.solution.triangle.R.T
            @ directions[:, -1]
            / self.solution.triangle.scales
        )
        names = ", ".join(self.estimate.parameters[k] for k in np.argsort(-weight)[:3])
        return InputError(
            f"without it the data say nothing of a combination of {names}, so no other batch can confirm it: "
            "use shorter batches, or more data",
            element=batch.name,
        )

    def inflation(self, sums: Floats) -> Floats:
        """Variance of each output's pull relative to white residuals, shape (m,); 1 for outputs without rows."""
        ranks = np.array([root.shape[1] for root in self.own_roots])
        white = (
            ranks
            * self.squares
            / np.maximum(np.array(self.solution.observation.counts), 1)
        )
        return np.where(white > 0, sums / np.where(white > 0, white, 1.0), 1.0)


def _pseudo_root(R: Floats, rows: int) -> Floats:
    """Q with Qᵀ RᵀR Q = 1 on the directions that R determines, shape (n, rank)."""
    if not R.size:
        return np.zeros((len(R), 0))
    scales = safe_norms(R)
    singular, right = np.linalg.svd(R / scales)[1:]
    rank = int(np.sum(singular > np.finfo(float).eps * max(rows, len(R)) * singular[0]))
    root: Floats = (right[:rank] / singular[:rank, None] / scales).T
    return root


def _from_factors(batches: Sequence[Batch], scores: _Scores) -> Iterator[_Batch]:
    """A factor is a set of rows that has the sums of those it was made from."""
    for given in batches:
        batch = scores.empty(given.name)
        for output, R in enumerate(given.observation.factors):
            scores.add(batch, output, R[:, :-1], R[:, -1])
        yield batch


# -- batches of time ---------------------------------------------------------------------------------------------------


def _length(rows: Rows, clusters: int) -> float:
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


def _batches(rows: Rows, scores: _Scores, seconds: float) -> Iterable[_Batch]:
    """Batches of the given length, s, log by log; gaps begin no new one, since residuals correlate across them."""
    starts: dict[str, float] = {}
    found: dict[tuple[str, int], _Batch] = {}
    for block in rows.blocks():
        begins = [float(times[0]) for times in block.times if times.size]
        start = starts.setdefault(block.source, min(begins)) if begins else 0.0
        for output, (times, matrix, y) in enumerate(
            zip(block.times, block.matrices, block.y, strict=True)
        ):
            numbers = ((times - start) // seconds).astype(int)
            for number in np.unique(numbers).tolist():
                if (block.source, number) not in found:
                    low = start + number * seconds
                    name = f"{block.source}, batch from {low:g} to {low + seconds:g} s"
                    found[block.source, number] = scores.empty(name)
                inside = numbers == number
                scores.add(
                    found[block.source, number], output, matrix[inside], y[inside]
                )
    return found.values()
