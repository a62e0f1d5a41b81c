"""Helpers of the tests of exciting trajectories: families, random motions, differences of fourth order."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from echelon.excite.families.basis import Basis, Recombined, resting_ends
from echelon.excite.families.bsplines import Splines, uniform_splines
from echelon.excite.families.fourier import Fourier
from echelon.excite.families.sums import Sum
from echelon.excite.trajectory import Trajectory

Floats = npt.NDArray[np.float64]

_FOURTH = ((-2.0, 1 / 12), (-1.0, -2 / 3), (1.0, 2 / 3), (2.0, -1 / 12))
"""Offsets and weights of the central difference of fourth order."""


def families(duration: float = 4.0) -> dict[str, Basis]:
    """One basis of every kind."""
    series, splines = Fourier(duration, 3), uniform_splines(duration, 6)
    uneven = Splines((0.0, 0.1 * duration, 0.45 * duration, 0.5 * duration, duration))
    mixed = np.random.default_rng(5).normal(size=(series.size, 4))
    return {
        "fourier": series,
        "bspline": splines,
        "uneven": uneven,
        "sum": Sum((series, splines)),
        "recombined": Recombined(series, mixed),
        "fourier at rest": resting_ends(series),
        "bspline at rest": resting_ends(splines),
        "sum at rest": resting_ends(Sum((series, splines))),
    }


def random_motion(basis: Basis, count: int, seed: int = 0, size: float = 0.5) -> Trajectory:
    """A random motion of some coordinates q1, q2, …"""
    coefficients = np.random.default_rng(seed).normal(scale=size, size=(basis.size, count))
    names = tuple(f"q{k + 1}" for k in range(count))
    return Trajectory(names, ("rad",) * count, basis, coefficients)


def slope_along(function: Callable[[float], Any], step: float) -> Floats:
    """Derivative at 0 by differences of fourth order."""
    return np.asarray(sum(weight * np.asarray(function(k * step)) for k, weight in _FOURTH)) / step


def slopes_by_state(
    function: Callable[..., Floats], state: Mapping[str, Floats], name: str, step: float = 1e-3
) -> Floats:
    """Derivatives of a function of q, q̇ and q̈ by one of them, shape (N, …, n)."""
    columns = []
    for k in range(state[name].shape[1]):
        direction = np.eye(state[name].shape[1])[k]

        def moved(t: float, direction: Floats = direction) -> Floats:
            return function(**{**state, name: state[name] + t * direction})

        columns.append(slope_along(moved, step))
    return np.stack(columns, axis=-1)
