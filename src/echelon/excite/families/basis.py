"""A basis: functions of time whose combinations are the motions of a family.

Every family is linear in its coefficients.  So limits of positions, velocities, accelerations and jerks are linear
constraints, derivatives are exact, and conditions at the ends are a change of the basis.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr, solve

from echelon.arrays import Floats


class Basis(ABC):
    """Functions of time.

    Attributes
    ----------
    duration : float
        Motions are defined from 0 to it, s.
    """

    duration: float

    @property
    @abstractmethod
    def size(self) -> int:
        """Number of functions."""

    @property
    @abstractmethod
    def frequency(self) -> float:
        """Highest frequency that matters, Hz: what a grid of samples must resolve."""

    @property
    @abstractmethod
    def periodic(self) -> bool:
        """Whether a motion can follow itself without a jump of any derivative."""

    @abstractmethod
    def values(self, t: Floats, order: int = 0) -> Floats:
        """Derivatives of all functions.

        Parameters
        ----------
        t : array of shape (N,)
            Times, s.
        order : int
            0 for the functions themselves.

        Returns
        -------
        array of shape (N, size)
        """

    def motion(self, t: Floats, coefficients: Floats, order: int = 0) -> Floats:
        """Derivatives of combinations, shape (N, n).

        Parameters
        ----------
        t : array of shape (N,)
        coefficients : array of shape (size, n)
        order : int
        """
        found: Floats = self.values(t, order) @ coefficients
        return found

    @abstractmethod
    def bounds(self, coefficients: Floats, order: int) -> Floats:
        """Bounds that no derivative of a combination exceeds at any time, by its coefficients alone.

        Parameters
        ----------
        coefficients : array of shape (size, n)
        order : int

        Returns
        -------
        array of shape (n,)
        """


@dataclass(frozen=True, eq=False)
class Recombined(Basis):
    """Combinations of the functions of another basis.

    Attributes
    ----------
    inner : Basis
    matrix : array of shape (inner.size, size)
        Columns are the new functions in terms of the inner ones.
    """

    inner: Basis
    matrix: Floats

    @property
    def duration(self) -> float:  # type: ignore[override]
        """That of the inner basis."""
        return self.inner.duration

    @property
    def size(self) -> int:
        """Number of functions."""
        return int(self.matrix.shape[1])

    @property
    def frequency(self) -> float:
        """That of the inner basis."""
        return self.inner.frequency

    @property
    def periodic(self) -> bool:
        """That of the inner basis."""
        return self.inner.periodic

    def values(self, t: Floats, order: int = 0) -> Floats:
        """Derivatives of all functions."""
        found: Floats = self.inner.values(t, order) @ self.matrix
        return found

    def motion(self, t: Floats, coefficients: Floats, order: int = 0) -> Floats:
        """Derivatives of combinations."""
        return self.inner.motion(t, self.matrix @ coefficients, order)

    def bounds(self, coefficients: Floats, order: int) -> Floats:
        """Bounds of a derivative."""
        return self.inner.bounds(self.matrix @ coefficients, order)


def resting_ends(basis: Basis) -> Recombined:
    """The combinations that begin and end at rest: no velocity, no acceleration, so that a robot can start from them.

    Functions are scaled to a velocity of 1 at most on average, so that coefficients of slow and fast ones compare.

    Parameters
    ----------
    basis : Basis

    Returns
    -------
    Recombined
    """
    ends = np.array([0.0, basis.duration])
    conditions = np.vstack([basis.values(ends, 1), basis.values(ends, 2)])
    free = Recombined(basis, _solutions(conditions))
    speeds = np.sqrt(np.mean(free.values(np.linspace(0, basis.duration, 8 * basis.size), 1) ** 2, axis=0))
    return Recombined(basis, free.matrix / np.where(speeds > 1e-9 * speeds.max(initial=1.0), speeds, 1.0))


def _solutions(conditions: Floats) -> Floats:
    """Columns that span {x : conditions · x = 0}, each with one free unknown at 1; the same on every platform."""
    scaled = conditions / np.maximum(np.abs(conditions).max(axis=1, keepdims=True), 1e-300)
    _, triangle, order = qr(scaled, pivoting=True, mode="economic")
    diagonal = np.abs(np.diag(triangle))
    rank = int(np.sum(diagonal > 1e-10 * diagonal.max(initial=0.0)))
    size = conditions.shape[1]
    free = np.sort(order[rank:])
    bound = order[:rank]
    columns = np.zeros((size, size - rank))
    columns[free, np.arange(size - rank)] = 1.0
    if rank:
        inside = triangle[:rank]
        place = {column: k for k, column in enumerate(order.tolist())}
        right = inside[:, [place[column] for column in free.tolist()]]
        columns[bound] = -solve(inside[:, :rank], right)
    return columns
