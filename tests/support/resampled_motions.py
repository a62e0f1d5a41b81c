"""Trajectories evaluated and sampled again."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.interpolate import BSpline

from echelon.excite.excite import ExcitingTrajectory
from echelon.excite.files.trajectory_file import design_to_json

Floats = npt.NDArray[np.float64]


RESAMPLED = 10_000.0  # Hz


def document(found: ExcitingTrajectory) -> dict[str, Any]:
    """What the file holds, and nothing of the objects that made it."""
    read: dict[str, Any] = json.loads(json.dumps(design_to_json(found)))
    return read


def evaluated(
    motion: Mapping[str, Any], names: list[str], t: Floats, order: int
) -> Floats:
    """Derivatives of a motion, as its 'meaning' in the file says."""
    if motion["family"] == "sum":
        return np.sum(
            [evaluated(part, names, t, order) for part in motion["parts"]], axis=0
        )
    if motion["family"] == "splines":
        points = np.array([motion["control_points"][name] for name in names]).T
        spline = BSpline(np.array(motion["knots"]), points, motion["degree"])
        return np.asarray(spline.derivative(order)(t) if order else spline(t))
    found = np.zeros((len(t), len(names)))
    for k in range(1, motion["harmonics"] + 1):
        w = 2 * np.pi * k / motion["duration"]
        for j, name in enumerate(names):
            series = motion["coefficients"][name]
            # each derivative is ahead by a quarter of a period
            angle = w * t + order * np.pi / 2
            found[:, j] += w**order * (
                series["sin"][k - 1] * np.sin(angle)
                + series["cos"][k - 1] * np.cos(angle)
            )
    if order == 0:
        found += [motion["coefficients"][name]["constant"] for name in names]
    return found


def resampled(found: ExcitingTrajectory, order: int, rate: float = RESAMPLED) -> Floats:
    written = document(found)
    t = np.linspace(
        0, found.trajectory.duration, round(found.trajectory.duration * rate) + 1
    )
    return evaluated(written["motion"], written["coordinates"], t, order)
