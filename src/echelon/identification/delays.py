"""Delays of measured outputs behind positions, found by the model itself.

Torques and positions come from different devices.  A constant delay d between them leaves a residual that no parameters
explain, so d is where the residuals of the outputs' own least-squares fits are smallest: W stays, y is shifted, and one
R-factor of W gives the residuals of all fits.  Outputs that come over one bus are late together, and a single one with
many parameters could explain almost anything by a delay of its own; so one delay is sought for all, by the mean of the
logarithms of their residuals, and taken only where it removes more than noise would.  An output has one of its own only
where that differs by more than half a period and removes twice as much of what is left.  Longer delays are hypotheses
of the judge.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from echelon.base import BaseModel
from echelon.compute import upper_triangle
from echelon.identification.band import REMOVED, slower
from echelon.identification.estimators.estimate import pseudo_root
from echelon.identification.logs.preparation.prepare import (
    Preparation,
    PreparationPlan,
    prepare,
)
from echelon.identification.logs.recording import Samples, Segment
from echelon.identification.rows.plan import LOOKED_AT, SAMPLED
from echelon.identification.rows.rows import ModelRows, rows_taken
from echelon.identification.signals.clock import shift_reach, shifted
from echelon.shared import Floats, extra

LONGEST_DELAY = 0.02
"""Longest delay that is looked for, s: buses and filters of drives take less, and beyond it the log is at fault."""

LONGEST_PERIODS = 2.5
"""Longest delay in periods, where that is longer: slow recorders pair positions with outputs of the sample before."""

LEAST_LEFT = 1e-3
"""Squares that are left between two delays at least, by those at all of them: splines may fall below zero."""

WHOLE = 40_000
"""Samples up to which logs are looked at whole, on their own clock: between samples of a slow one friction turns."""


def with_delays(
    preparation: Preparation, segments: Sequence[Segment], base: BaseModel
) -> Preparation:
    """The preparation with delays estimated, where it leaves them open."""
    if preparation.delays is not None:
        return preparation
    rate = max(segments, key=len).rate
    longest = max(LONGEST_DELAY, LONGEST_PERIODS / rate)
    tried = np.linspace(-longest, longest, 21)
    squares = _residuals(
        preparation.model_copy(update={"delays": {}}), segments, base, tried
    )
    tried, squares = _between(tried, squares)
    delay, gain = _best(tried, squares)
    # it is longer, or something else is wrong
    if abs(delay) == longest and gain >= REMOVED:
        text = f"none: no common delay up to {1e3 * longest:.2g} ms removes most of the residuals"
        return preparation.model_copy(
            update={"delays": {}, "reasons": {**preparation.reasons, "delays": text}}
        )
    delay = delay if gain >= REMOVED else 0.0
    found = {output.name: delay for output in base.mechanism.outputs if delay}
    text = f"outputs lag positions by {1e3 * delay:.2g} ms; correcting it removes {gain:.0%} of the squared residuals"
    if not delay:
        text = (
            f"none: no common delay would remove {REMOVED:.0%} of the squared residuals"
        )
    for k, output in enumerate(base.mechanism.outputs):
        own, share = _best(
            tried, squares[:, [k]], np.interp(delay, tried, squares[:, k])
        )
        is_own = abs(own - delay) > 0.5 / rate and abs(own) < longest
        if share >= 2 * REMOVED and is_own:
            found[output.name] = own
            text += f"; {output.name} {1e3 * own:.2g} ms, which removes {share:.0%} of its remaining residuals"
    return preparation.model_copy(
        update={"delays": found, "reasons": {**preparation.reasons, "delays": text}}
    )


def _residuals(
    preparation: Preparation,
    segments: Sequence[Segment],
    base: BaseModel,
    delays: Floats,
) -> Floats:
    """Squares of each output's residual for each delay, shape (delays, outputs)."""
    count = len(base.mechanism.outputs)
    matrices: list[list[Floats]] = [[] for _ in range(count)]
    values: list[list[Floats]] = [[] for _ in range(count)]
    least = SAMPLED * (preparation.band or np.inf)
    fast = WHOLE / sum(len(segment) for segment in segments)
    left = WHOLE if fast * segments[0].rate > least else LOOKED_AT
    for segment in segments:
        if len(segment) / segment.rate < 10 * LONGEST_DELAY or left <= 0:
            continue
        begun = slower(segment, max(least, fast * segment.rate), left)
        left -= len(begun)
        if len(begun) <= PreparationPlan(
            preparation, base.mechanism, begun.rate
        ).needed + 2 * _margin(begun, delays):
            continue
        samples = _inner(
            prepare(begun, preparation, base.mechanism), _margin(begun, delays)
        )
        blocks = list(ModelRows.of(base, [samples]).blocks())
        assert samples.y is not None
        for output in range(count):
            matrices[output] += [block.matrices[output] for block in blocks]
            values[output].append(_late(samples, samples.y[:, output], output, delays))
    if not values[0]:
        return np.zeros((len(delays), count))
    return np.stack(
        [
            _rest(np.vstack(a), np.vstack(b))
            for a, b in zip(matrices, values, strict=True)
        ],
        axis=1,
    )


def _late(samples: Samples, y: Floats, output: int, delays: Floats) -> Floats:
    """An output's rows with every delay undone, shape (rows, delays)."""
    moved = np.stack([shifted(y, delay * samples.rate) for delay in delays], axis=1)
    _, rows, moving = rows_taken(samples, moved)
    return rows if moving is None else rows[moving[:, output]]


def _margin(segment: Segment, delays: Floats) -> int:
    """Samples near an end that shifts would need values beyond the end for."""
    longest = float(delays[-1]) * segment.rate
    return int(np.ceil(longest)) + shift_reach(longest)


def _inner(samples: Samples, margin: int) -> Samples:
    """The samples without those near the ends."""
    return replace(
        samples,
        first=max(samples.first, margin),
        stop=min(samples.end, len(samples) - margin),
    )


def _rest(matrix: Floats, values: Floats) -> Floats:
    """Squares that no parameters explain, for each column of values."""
    if not len(matrix):
        return np.zeros(values.shape[1])
    basis = matrix @ pseudo_root(upper_triangle(matrix), len(matrix))
    rest = values
    # what rounding leaves of the first projection, the second takes away
    for _ in range(2):
        rest = rest - basis @ (basis.T @ rest)
    squares: Floats = np.sum(rest**2, axis=0)
    return squares


def _between(delays: Floats, squares: Floats, times: int = 80) -> tuple[Floats, Floats]:
    """Many times more delays, and the squares of each output there by cubic splines.

    Squares of residuals are smooth, their logarithms are not.
    """
    with extra("identify"):
        from scipy.interpolate import CubicSpline
    many = np.linspace(delays[0], delays[-1], times * (len(delays) - 1) + 1)
    return many, np.maximum(
        CubicSpline(delays, squares)(many), LEAST_LEFT * squares.min(axis=0)
    )


def _best(
    delays: Floats, squares: Floats, before: float | None = None
) -> tuple[float, float]:
    """The delay with the smallest residuals, and the share it removes of the squares ``before``, or at delay zero."""
    told = squares[:, (squares > 0).all(axis=0)]
    if not told.size:
        return 0.0, 0.0
    errors = np.log(told).mean(axis=1)
    least = int(np.argmin(errors))
    reference = errors[len(delays) // 2] if before is None else np.log(before)
    return float(delays[least]), float(1 - np.exp(errors[least] - reference))
