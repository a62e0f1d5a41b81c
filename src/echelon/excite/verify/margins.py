"""Margins: how far a trajectory stays from each limit, at every time and not only at samples.

Limits of the motion: between samples a function exceeds the larger one by at most h²/8 times the bound of its second
derivative, which follows from the coefficients.  Limits of the state: q, q̇ and q̈ stay in intervals around the middle
of a short cell of time, and interval arithmetic over the recorded function bounds what it does there; cells are halved
where that bound says too little.

With closed loops interval arithmetic says nothing useful of dependent coordinates: quotients of intervals grow.  There
a motion is looked at so often that a parabola through three samples gives its extremes, and margins say so.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import inf, isnan

import numpy as np

from echelon.arrays import Floats
from echelon.excite.problem.closed_loops import FULL_WEIGHT, Closed, LoopLimits, LoopMotion
from echelon.excite.problem.state_limits import Enclosed, MotionLimit
from echelon.excite.problem.trajectory import Trajectory
from echelon.program.intervals import Interval
from echelon.regressor.loops.assembly import LARGEST_CORRECTION
from echelon.regressor.loops.closed_motion import largest, position_rates

ACTIVE = 0.02
"""Share of a limit's range within which it counts as active."""


@dataclass(frozen=True)
class Margin:
    """One limit and how far a trajectory stays from it."""

    label: str  # ``"velocity of j3"``
    unit: str
    low: float  # the limit, SI units; infinite for none
    high: float
    least: float  # bounds of what the trajectory reaches at any time: it goes neither below nor above
    largest: float
    sampled: bool = False  # whether they are those of samples only, as with closed loops

    @property
    def margin(self) -> float:
        """Distance to the nearer end, negative if the limit is broken."""
        if isnan(self.least) or isnan(self.largest):
            return -inf  # what nobody knows is not kept
        below = inf if self.low == -inf else self.least - self.low
        return min(below, inf if self.high == inf else self.high - self.largest)

    @property
    def relative(self) -> float:
        """The margin as a share of the limit's range, or of its size where it has one end only."""
        span = self.high - self.low
        size = span if abs(span) < inf else abs(self.low if abs(self.low) < inf else self.high)
        return self.margin / size if size else self.margin

    @property
    def kept(self) -> bool:
        """Whether the limit holds, at every time unless margins are :attr:`sampled`."""
        return self.margin >= 0

    @property
    def active(self) -> bool:
        """Whether the trajectory comes near the limit."""
        return self.kept and self.relative < ACTIVE


def when_kept(margins: Iterable[Margin]) -> str:
    """Where limits are known to hold, in words."""
    if any(margin.sampled for margin in margins):
        return "at samples: with closed loops nothing bounds what happens between them"
    return "at every time"


SHARP = 1e-3
"""Share of a limit's range by which bounds may be wider than what is reached."""
_SHARE = 0.25
"""Share of the distance to a limit by which bounds may be wider than what is reached, where that is more."""
PER_PERIOD = 10
"""Cells per period of the highest frequency, at first."""
_HALVINGS = 12


def state_margins(trajectory: Trajectory, limits: Enclosed) -> list[Margin]:
    """How far functions of the state stay from limits."""
    least, largest = reach(trajectory, limits)
    return [
        Margin(*fields)
        for fields in zip(
            *(limits.labels, limits.units, limits.low.tolist(), limits.high.tolist()),
            *(least.tolist(), largest.tolist()),
            strict=True,
        )
    ]


def reach(trajectory: Trajectory, limits: Enclosed) -> tuple[Floats, Floats]:
    """Bounds of functions of the state at any time, each of shape (m,)."""
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


def _tolerances(limits: Enclosed, low: Floats, high: Floats) -> tuple[Floats, Floats]:
    """By how much bounds may be wider than what was met: far from a limit, kept or broken, by much."""
    span = limits.high - limits.low
    sharp = SHARP * np.where(np.isfinite(span), span, np.maximum(np.abs(np.nan_to_num(limits.low, neginf=0.0)), 1.0))
    room = np.nan_to_num(low - limits.low, posinf=np.inf), np.nan_to_num(limits.high - high, posinf=np.inf)
    return np.maximum(sharp, _SHARE * np.abs(room[0])), np.maximum(sharp, _SHARE * np.abs(room[1]))


def ranges(trajectory: Trajectory, middles: Floats, halves: Floats) -> dict[str, Interval]:
    """Intervals of q, q̇ and q̈ in cells of time, by Taylor's theorem."""
    h = halves[:, None]
    found: dict[str, Interval] = {}
    for order, name in enumerate(("q", "qd", "qdd")):
        centre = trajectory(middles, order)
        reach = h * np.abs(trajectory(middles, order + 1)) + h**2 / 2 * trajectory.bounds(order + 2)
        found[name] = (centre - reach, centre + reach)
    return found


_SHARPER = (SHARP, SHARP / 100, SHARP / 10_000)
"""Share of a limit's range by which bounds may be wider than what is reached: one after the other where that decides
whether a limit is kept."""
_COARSE, _MOST = 200, 1_000_000
"""Samples of a limit of the motion, at least and at most."""


def motion_margins(trajectory: Trajectory, limits: Iterable[MotionLimit]) -> list[Margin]:
    """How far positions and their derivatives stay from limits."""
    return [_motion_margin(trajectory, limit) for limit in limits]


def _motion_margin(trajectory: Trajectory, limit: MotionLimit) -> Margin:
    combined = trajectory.coefficients @ limit.weights[:, None]
    curvature = float(trajectory.basis.bounds(combined, limit.order + 2)[0])
    span = limit.high - limit.low
    size = span if np.isfinite(span) else max(abs(x) for x in (limit.low, limit.high) if np.isfinite(x))
    for sharp in _SHARPER:
        step = np.sqrt(8 * sharp * size / curvature) if curvature > 0 and size > 0 else np.inf
        count = int(np.clip(trajectory.duration / step, _COARSE, _MOST))
        times = np.linspace(0.0, trajectory.duration, count + 1)
        values = trajectory.basis.motion(times, combined, limit.order)
        more = curvature * (trajectory.duration / count) ** 2 / 8
        least, largest = float(values.min()), float(values.max())
        # where the bound breaks a limit that the samples keep, more samples decide
        if least < limit.low or largest > limit.high or (least - more >= limit.low and largest + more <= limit.high):
            break
    return Margin(limit.label, limit.unit, limit.low, limit.high, least - more, largest + more)


SAMPLES_PER_PERIOD = 200
"""Samples per period of the highest frequency: between them a sine rises by 0.01 % of its amplitude."""


def loop_margins(trajectory: Trajectory, limits: LoopLimits) -> list[Margin]:
    """How far a trajectory stays from the limits at samples, in their order.

    Where the loops cannot be closed, or another way of assembly turns up, no margin is left to singular poses, and all
    others count as broken.
    """
    count = max(int(np.ceil(SAMPLES_PER_PERIOD * trajectory.basis.frequency * trajectory.duration)), 2)
    times = np.linspace(0.0, trajectory.duration, count + 1)
    states = trajectory.states(times)
    low = np.array([FULL_WEIGHT, *limits.low[1:]])
    fields = zip(limits.labels, limits.units, low.tolist(), limits.high.tolist(), strict=True)
    if not connected(limits.motion, limits.motion.at(*states), times[1]):
        return [Margin(*field, -np.inf if k else 0.0, np.inf, sampled=True) for k, field in enumerate(fields)]
    values = limits.values(*states)
    reached = zip(fields, (-_peaks(-values)).tolist(), _peaks(values).tolist(), strict=True)
    return [Margin(*field, least, most, sampled=True) for field, least, most in reached]


def connected(motion: LoopMotion, closed: Closed, step: float) -> bool:
    """Whether loops stay closed in one way of assembly: each sample is where the velocities about it lead."""
    if not closed.done.all():
        return False
    middle, rates = (closed.q[1:] + closed.q[:-1]) / 2, (closed.qd[1:] + closed.qd[:-1]) / 2
    moved = position_rates(motion.mechanism, middle, step * rates)
    away = largest((np.diff(closed.q, axis=0) - moved) / motion.position_units)
    return bool(np.all(away < LARGEST_CORRECTION))


def _peaks(values: Floats) -> Floats:
    """Largest value of each column: of the samples, and of parabolas through samples and their neighbours."""
    before, here, after = values[:-2], values[1:-1], values[2:]
    bend = 2 * here - before - after
    top = (here >= before) & (here >= after) & (bend > 0)
    rise = np.where(top, (after - before) ** 2 / (8 * np.where(top, bend, 1.0)), 0.0)
    found: Floats = np.maximum(values.max(axis=0), (here + rise).max(axis=0))
    return found
