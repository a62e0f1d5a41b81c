"""Joint motion: positions, velocities and accelerations over time, and the limits that they have to keep.

Samples are dense against the fastest component of the family, and are thinned only where a page would become too
large; then the extremes of each stretch remain.
"""

from __future__ import annotations

from math import isfinite
from typing import Any

import numpy as np

from echelon.errors import one_line
from echelon.excite.exciting_trajectory import ExcitingTrajectory
from echelon.excite.problem.motion_limits import ORDERS
from echelon.report.downsampling import envelope
from echelon.report.preview.packed import packed

_PLOTTED = 3  # positions, velocities, accelerations
_SUFFIXES = ("", "/s", "/s²")
_PER_PERIOD = 100  # samples per period of the highest frequency
_FEWEST, _MOST = 600, 20_000
_BYTES = 500_000  # of all signals together
_PER_SAMPLE = 2 * 4 * 4 / 3  # bytes of time and value in base 64


def context(found: ExcitingTrajectory) -> dict[str, Any]:
    """What the section says beside its plots."""
    labels = {margin.label for margin in found.margins}
    free = [
        f"{ORDERS[order]} of {name}"
        for name in found.trajectory.coordinates
        for order in range(_PLOTTED)
        if f"{ORDERS[order]} of {name}" not in labels
    ]
    return {"coordinates": found.trajectory.coordinates, "free": free}


def payload(found: ExcitingTrajectory) -> dict[str, Any]:
    """Signals and limits of every coordinate, JSON-able."""
    trajectory = found.trajectory
    periods = trajectory.basis.frequency * trajectory.duration
    samples = int(np.clip(np.ceil(_PER_PERIOD * periods), _FEWEST, _MOST)) + 1
    time = np.linspace(0.0, trajectory.duration, samples)
    values = [trajectory(time, order) for order in range(_PLOTTED)]
    ends = {margin.label: (margin.low, margin.high) for margin in found.margins}
    signals = _PLOTTED * max(len(trajectory.coordinates), 1)
    buckets = int(np.clip(_BYTES / (2 * _PER_SAMPLE * signals), 50, _MOST))
    coordinates = []
    for k, (name, unit) in enumerate(zip(trajectory.coordinates, trajectory.units, strict=True)):
        rows = []
        for order in range(_PLOTTED):
            kept = envelope(time, values[order][:, k], buckets)
            low, high = (_finite(end) for end in ends.get(f"{ORDERS[order]} of {name}", (-np.inf, np.inf)))
            rows.append(
                {
                    "unit": one_line(unit) + _SUFFIXES[order],
                    "time": packed(kept.time),
                    "values": packed(kept.values),
                    "low": low,
                    "high": high,
                }
            )
        coordinates.append({"name": one_line(name), "orders": rows})
    return {"duration": trajectory.duration, "titles": list(ORDERS[:_PLOTTED]), "coordinates": coordinates}


def _finite(value: float) -> float | None:
    return value if isfinite(value) else None
