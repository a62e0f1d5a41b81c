"""B-splines: motions with local control, from rest to rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.excite.families.basis import Basis

DEGREE = 5
"""Quintic: jerks are continuous."""


@dataclass(frozen=True)
class Splines(Basis):
    """B-splines with given breakpoints, all derivatives of interest continuous inside.

    Attributes
    ----------
    breaks : tuple of float
        From 0 to the duration, s.
    degree : int
        At least 5: jerks of lower ones jump, and nothing bounds what they do between samples.

    Raises
    ------
    InputError
        If the degree is lower.
    """

    breaks: tuple[float, ...]
    degree: int = DEGREE

    def __post_init__(self) -> None:
        if self.degree < DEGREE:
            raise InputError(f"splines have degree {DEGREE} at least, so that jerks are continuous; got {self.degree}")

    @property
    def duration(self) -> float:  # type: ignore[override]
        """The last breakpoint."""
        return self.breaks[-1]

    @property
    def size(self) -> int:
        """Pieces and degree together."""
        return len(self.breaks) - 1 + self.degree

    @property
    def frequency(self) -> float:
        """Of a motion that turns in every piece, Hz."""
        return 0.5 / float(np.min(np.diff(self.breaks)))

    @property
    def periodic(self) -> bool:
        """A spline does not end as it began."""
        return False

    def values(self, t: Floats, order: int = 0) -> Floats:
        """Derivatives of all functions, shape (N, size)."""
        return self.motion(t, np.eye(self.size), order)

    def motion(self, t: Floats, coefficients: Floats, order: int = 0) -> Floats:
        """Derivatives of combinations; at every time few functions are not zero."""
        if order > self.degree:
            return np.zeros((len(t), coefficients.shape[1]))
        spline = BSpline(self._knots, coefficients, self.degree)
        found: Floats = np.asarray(spline(np.clip(t, 0.0, self.duration), nu=order))
        return found

    def bounds(self, coefficients: Floats, order: int) -> Floats:
        """The largest control point of the derivative, in whose convex hull it stays, shape (n,)."""
        if order > self.degree:
            return np.zeros(coefficients.shape[1])
        points: Floats = np.asarray(coefficients)
        knots, degree = self._knots, self.degree
        for _ in range(order):
            spans = knots[degree + 1 : degree + len(points)] - knots[1 : len(points)]
            points = degree * np.diff(points, axis=0) / spans[:, None]
            knots, degree = knots[1:-1], degree - 1
        largest: Floats = np.abs(points).max(axis=0)
        return largest

    @property
    def _knots(self) -> Floats:
        return np.concatenate([[0.0] * self.degree, self.breaks, [self.duration] * self.degree])


def uniform_splines(duration: float, pieces: int) -> Splines:
    """B-splines of pieces of one length.

    Parameters
    ----------
    duration : float
        s.
    pieces : int
    """
    return Splines(tuple(np.linspace(0.0, duration, pieces + 1).tolist()))
