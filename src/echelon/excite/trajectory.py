"""A trajectory: positions, velocities, accelerations and jerks of a robot's coordinates at any time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.excite.families.basis import Basis

DURATIONS = (1e-6, 1e6)
"""Shortest and longest motion of a robot, s: beyond, powers of frequencies leave double precision."""

SHORTEST_STEP = 1e-9
"""Between samples, s; clocks count no finer."""

LARGEST = 1e12
"""Position, velocity, acceleration or jerk, SI, that no robot comes near to."""


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A motion of some coordinates.

    Attributes
    ----------
    coordinates : tuple of str
        Names, in the order of the columns.
    units : tuple of str
        ``"rad"`` or ``"m"``.
    basis : Basis
    coefficients : array of shape (basis.size, n)
    """

    coordinates: tuple[str, ...]
    units: tuple[str, ...]
    basis: Basis
    coefficients: Floats

    @property
    def duration(self) -> float:
        """S."""
        return self.basis.duration

    def __call__(self, t: npt.ArrayLike, order: int = 0) -> Floats:
        """Positions at times, or derivatives of them.

        Parameters
        ----------
        t : array of shape (N,)
            s; of a periodic motion also beyond its duration.
        order : int
            0 for positions (rad, m), 1 for velocities, 2 for accelerations, 3 for jerks.

        Returns
        -------
        array of shape (N, n)
        """
        return self.basis.motion(np.atleast_1d(np.asarray(t, dtype=float)), self.coefficients, order)

    def bounds(self, order: int) -> Floats:
        """What the derivatives of an order never exceed, shape (n,)."""
        return self.basis.bounds(self.coefficients, order)

    def times(self, rate: float, repeats: int = 1) -> Floats:
        """Sampling times from 0 to the end, both included.

        Parameters
        ----------
        rate : float
            Hz.
        repeats : int
            How often a periodic motion is run.
        """
        count = round(self.duration * repeats * rate)
        return np.arange(count + 1) / rate

    def states(self, t: npt.ArrayLike) -> tuple[Floats, Floats, Floats]:
        """Positions, velocities and accelerations, each of shape (N, n)."""
        return self(t), self(t, 1), self(t, 2)
