"""What a trajectory reaches at any time: margins that hold between samples too.

Limits of the motion: between samples a function exceeds the larger one by at most h²/8 times the bound of its second
derivative, which follows from the coefficients.  Limits of the state: q, q̇ and q̈ stay in intervals around the middle of
a short cell of time, and interval arithmetic over the recorded function bounds what it does there; cells are halved
where that bound says too little.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import numpy.typing as npt

from echelon.errors import EchelonError
from echelon.excite.collisions.certificate import least_clearances
from echelon.excite.collisions.constraint import Clearance
from echelon.excite.constraints.motion import MotionLimit
from echelon.excite.constraints.state import Enclosed
from echelon.excite.loops.limits import LoopLimits
from echelon.excite.margins import Margin
from echelon.excite.task import Task
from echelon.excite.trajectory import Trajectory
from echelon.program.intervals import Interval

Floats = npt.NDArray[np.float64]

_SHARP = 1e-3
"""Share of a limit's range by which bounds may be wider than what is reached."""
_SHARPER = (_SHARP, _SHARP / 100, _SHARP / 10_000)
"""The same of limits of the motion, one after the other where that decides whether a limit is kept."""
_SHARE = 0.25
"""The same as a share of the distance to the limit, where that is more."""
_TOUCH = 0.05
"""Share of the clearance by which a distance may be larger than its bound."""
_COARSE, _MOST = 200, 1_000_000
"""Samples of a limit of the motion, at least and at most."""
_PER_PERIOD = 10  # cells per period of the highest frequency, at first
_HALVINGS = 12


def margins_of(trajectory: Trajectory, task: Task) -> list[Margin]:
    """How far a trajectory stays from all limits, first those of the motion, then those of the state in their order.

    Parameters
    ----------
    trajectory : Trajectory
    task : Task
    """
    found = motion_margins(trajectory, task.limits.motion)
    for constraint in task.constraints:
        if isinstance(constraint, Enclosed):
            found += state_margins(trajectory, constraint)
        elif isinstance(constraint, Clearance):
            found += clearance_margins(trajectory, constraint)
        elif isinstance(constraint, LoopLimits):
            found += constraint.margins(trajectory)
        else:
            raise EchelonError(f"nothing bounds {', '.join(constraint.labels[:3])} between samples")
    return found


def clearance_margins(trajectory: Trajectory, clearance: Clearance) -> list[Margin]:
    """How near bodies come to each other.

    Parameters
    ----------
    trajectory : Trajectory
    clearance : Clearance
    """
    least = least_clearances(clearance, trajectory, _TOUCH * clearance.clearance or _TOUCH)
    return [
        Margin(label, "m", clearance.clearance, np.inf, bound, np.inf)
        for label, bound in zip(least.labels, least.bounds.tolist(), strict=True)
    ]


def motion_margins(trajectory: Trajectory, limits: Iterable[MotionLimit]) -> list[Margin]:
    """How far positions and their derivatives stay from limits.

    Parameters
    ----------
    trajectory : Trajectory
    limits : iterable of MotionLimit
    """
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


def state_margins(trajectory: Trajectory, limits: Enclosed) -> list[Margin]:
    """How far functions of the state stay from limits.

    Parameters
    ----------
    trajectory : Trajectory
    limits : Enclosed
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


def reach(trajectory: Trajectory, limits: Enclosed) -> tuple[Floats, Floats]:
    """Bounds of functions of the state at any time, each of shape (m,).

    Parameters
    ----------
    trajectory : Trajectory
    limits : Enclosed
    """
    count = max(int(np.ceil(_PER_PERIOD * trajectory.basis.frequency * trajectory.duration)), 1)
    edges = np.linspace(0.0, trajectory.duration, count + 1)
    middles, halves = (edges[1:] + edges[:-1]) / 2, np.diff(edges) / 2
    far = [trajectory.basis.bounds(trajectory.coefficients, order) for order in range(2, 5)]
    m = len(limits.labels)
    least, largest = np.full(m, np.inf), np.full(m, -np.inf)  # of cells that need not be halved
    met = np.full(m, np.inf), np.full(m, -np.inf)
    for halving in range(_HALVINGS + 1):
        points = limits.enclosures(_ranges(trajectory, middles, 0 * halves, far))
        met = np.minimum(met[0], points[0].min(axis=0)), np.maximum(met[1], points[1].max(axis=0))
        low, high = limits.enclosures(_ranges(trajectory, middles, halves, far))
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
    """By how much bounds may be wider than what was met: far from a limit by much."""
    span = limits.high - limits.low
    sharp = _SHARP * np.where(np.isfinite(span), span, np.maximum(np.abs(np.nan_to_num(limits.low, neginf=0.0)), 1.0))
    room = np.nan_to_num(low - limits.low, posinf=np.inf), np.nan_to_num(limits.high - high, posinf=np.inf)
    return np.maximum(sharp, _SHARE * room[0]), np.maximum(sharp, _SHARE * room[1])


def _ranges(trajectory: Trajectory, middles: Floats, halves: Floats, far: Sequence[Floats]) -> dict[str, Interval]:
    """Intervals of q, q̇ and q̈ in cells of time, by Taylor's theorem: shapes (cells, n)."""
    h = halves[:, None]
    found: dict[str, Interval] = {}
    for order, name in enumerate(("q", "qd", "qdd")):
        centre = trajectory(middles, order)
        reach = h * np.abs(trajectory(middles, order + 1)) + h**2 / 2 * far[order]
        found[name] = (centre - reach, centre + reach)
    return found
