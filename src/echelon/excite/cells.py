"""Bounds of functions of the state over cells of time: what a trajectory reaches, also between samples.

q, q̇ and q̈ stay in intervals around the middle of a short cell of time, and interval arithmetic over the recorded
function bounds what it does there; cells are halved where that bound says too little.
"""

from __future__ import annotations

import numpy as np

from echelon.arrays import Floats
from echelon.excite.constraints.state import Bounded
from echelon.excite.margins import Margin
from echelon.excite.trajectory import Trajectory
from echelon.program.intervals import Interval

SHARP = 1e-3
"""Share of a limit's range by which bounds may be wider than what is reached."""
_SHARE = 0.25
"""The same as a share of the distance to the limit, where that is more."""
PER_PERIOD = 10
"""Cells per period of the highest frequency, at first."""
_HALVINGS = 12


def state_margins(trajectory: Trajectory, limits: Bounded) -> list[Margin]:
    """How far functions of the state stay from limits.

    Parameters
    ----------
    trajectory : Trajectory
    limits : Bounded
    """
    least, largest = reach(trajectory, limits)
    return [
        Margin(*fields)
        for fields in zip(
            *(limits.labels, limits.units, limits.low.tolist(), limits.high.tolist()),
            *(least.tolist(), largest.tolist()),
            strict=True,
        )
    ]


def reach(trajectory: Trajectory, limits: Bounded) -> tuple[Floats, Floats]:
    """Bounds of functions of the state at any time, each of shape (m,).

    Parameters
    ----------
    trajectory : Trajectory
    limits : Bounded
    """
    count = max(int(np.ceil(PER_PERIOD * trajectory.basis.frequency * trajectory.duration)), 1)
    edges = np.linspace(0.0, trajectory.duration, count + 1)
    middles, halves = (edges[1:] + edges[:-1]) / 2, np.diff(edges) / 2
    m = len(limits.labels)
    least, largest = np.full(m, np.inf), np.full(m, -np.inf)  # of cells that need not be halved
    met = np.full(m, np.inf), np.full(m, -np.inf)
    for halving in range(_HALVINGS + 1):
        points = limits.enclosures(ranges(trajectory, middles, 0 * halves))
        met = np.minimum(met[0], points[0].min(axis=0)), np.maximum(met[1], points[1].max(axis=0))
        low, high = limits.enclosures(ranges(trajectory, middles, halves))
        below, above = _tolerances(limits, *met)
        vague = np.any((high > met[1] + above) | (low < met[0] - below), axis=1)
        vague &= halving < _HALVINGS
        least = np.minimum(least, low[~vague].min(axis=0, initial=np.inf))
        largest = np.maximum(largest, high[~vague].max(axis=0, initial=-np.inf))
        if not vague.any():
            break
        halves = np.repeat(halves[vague] / 2, 2)
        middles = np.repeat(middles[vague], 2) + halves * np.tile([-1.0, 1.0], len(halves) // 2)
    return least, largest


def _tolerances(limits: Bounded, low: Floats, high: Floats) -> tuple[Floats, Floats]:
    """By how much bounds may be wider than what was met: far from a limit, kept or broken, by much."""
    span = limits.high - limits.low
    sharp = SHARP * np.where(np.isfinite(span), span, np.maximum(np.abs(np.nan_to_num(limits.low, neginf=0.0)), 1.0))
    room = np.nan_to_num(low - limits.low, posinf=np.inf), np.nan_to_num(limits.high - high, posinf=np.inf)
    return np.maximum(sharp, _SHARE * np.abs(room[0])), np.maximum(sharp, _SHARE * np.abs(room[1]))


def ranges(trajectory: Trajectory, middles: Floats, halves: Floats) -> dict[str, Interval]:
    """Intervals of t, q, q̇ and q̈ in cells of time, by Taylor's theorem.

    Parameters
    ----------
    trajectory : Trajectory
    middles, halves : array of shape (cells,)
        Middles of the cells and halves of their lengths, s.

    Returns
    -------
    dict of str to (array, array)
        Least and largest values of ``q``, ``qd`` and ``qdd``, of shape (cells, n), and of ``t``, of shape (cells, 1).
    """
    h = halves[:, None]
    found: dict[str, Interval] = {"t": (middles[:, None] - h, middles[:, None] + h)}
    for order, name in enumerate(("q", "qd", "qdd")):
        centre = trajectory(middles, order)
        reach = h * np.abs(trajectory(middles, order + 1)) + h**2 / 2 * trajectory.bounds(order + 2)
        found[name] = (centre - reach, centre + reach)
    return found
