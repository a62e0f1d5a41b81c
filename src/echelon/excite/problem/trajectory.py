"""Trajectories: combinations of functions of time, the same functions for every coordinate.

Every family (a :class:`Basis`) is linear in its coefficients.  So limits of positions, velocities, accelerations and
jerks are linear constraints, derivatives are exact, and conditions at the ends are a change of the basis.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from echelon.shared import Floats, InputError, extra, public


class Basis(ABC):
    """Functions of time."""

    duration: float  # motions are defined from 0 to it, s

    @property
    @abstractmethod
    def size(self) -> int:
        """Number of functions."""

    @property
    @abstractmethod
    def frequency(self) -> float:
        """Highest frequency that matters, Hz: what a grid of samples must resolve."""

    @property
    def periodic(self) -> bool:
        """Whether a motion can follow itself without a jump of any derivative."""
        return False

    @abstractmethod
    def values(self, t: Floats, order: int = 0) -> Floats:
        """Derivatives of all functions, shape (N, size)."""

    def motion(self, t: Floats, coefficients: Floats, order: int = 0) -> Floats:
        """Derivatives of combinations, shape (N, n)."""
        return self.values(t, order) @ coefficients

    @abstractmethod
    def bounds(self, coefficients: Floats, order: int) -> Floats:
        """Bounds that no derivative of a combination exceeds at any time, by its coefficients alone, shape (n,)."""


@dataclass(frozen=True, eq=False)
class Combined(Basis):
    """Combinations of the functions of some bases of one duration: all of them side by side without a matrix."""

    parts: tuple[Basis, ...]
    matrix: Floats | None = (
        None  # shape (functions, size); columns are the new functions in terms of the parts'
    )

    @property
    def duration(self) -> float:  # type: ignore[override]
        """Duration of the parts, s."""
        return self.parts[0].duration

    @property
    def size(self) -> int:
        """Number of functions."""
        return (
            sum(part.size for part in self.parts)
            if self.matrix is None
            else int(self.matrix.shape[1])
        )

    @property
    def frequency(self) -> float:
        """The highest of the parts, Hz."""
        return max(part.frequency for part in self.parts)

    @property
    def periodic(self) -> bool:
        """Whether all parts are periodic."""
        return all(part.periodic for part in self.parts)

    def values(self, t: Floats, order: int = 0) -> Floats:
        """Derivatives of all functions, shape (N, size)."""
        found: Floats = np.hstack([part.values(t, order) for part in self.parts])
        return found if self.matrix is None else found @ self.matrix

    def motion(self, t: Floats, coefficients: Floats, order: int = 0) -> Floats:
        """Derivatives of combinations, shape (N, n)."""
        return sum(
            (part.motion(t, own, order) for part, own in self.split(coefficients)),
            np.zeros(()),
        )

    def bounds(self, coefficients: Floats, order: int) -> Floats:
        """Sum of the bounds of the parts, shape (n,)."""
        return sum(
            (part.bounds(own, order) for part, own in self.split(coefficients)),
            np.zeros(()),
        )

    def split(self, coefficients: Floats) -> list[tuple[Basis, Floats]]:
        """The parts with their own coefficients."""
        whole = coefficients if self.matrix is None else self.matrix @ coefficients
        cuts = np.cumsum([part.size for part in self.parts])[:-1]
        return list(zip(self.parts, np.split(whole, cuts), strict=True))


def resting_ends(basis: Basis) -> Combined:
    """The combinations that begin and end at rest, without velocity or acceleration, as a robot must start."""
    # functions are scaled to a velocity of 1 at most on average, so that coefficients of slow and fast ones compare
    ends = np.array([0.0, basis.duration])
    conditions = np.vstack([basis.values(ends, 1), basis.values(ends, 2)])
    free = Combined((basis,), _solutions(conditions))
    speeds = np.sqrt(
        np.mean(
            free.values(np.linspace(0, basis.duration, 8 * basis.size), 1) ** 2, axis=0
        )
    )
    return Combined(
        (basis,),
        free.matrix / np.where(speeds > 1e-9 * speeds.max(initial=1.0), speeds, 1.0),
    )


def _solutions(conditions: Floats) -> Floats:
    """Columns that span {x : conditions · x = 0}, each with one free unknown at 1; the same on every platform."""
    with extra("excite"):
        from scipy.linalg import qr, solve

    scaled = conditions / np.maximum(
        np.abs(conditions).max(axis=1, keepdims=True), 1e-300
    )
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


@dataclass(frozen=True)
class Fourier(Basis):
    """1, sin(ωt), cos(ωt), sin(2ωt), … of a period (J. Swevers et al., IEEE Trans. Robotics and Automation, 1997)."""

    duration: float  # the period 2π/ω, s
    harmonics: int

    @property
    def size(self) -> int:
        """One constant, two functions per harmonic."""
        return 1 + 2 * self.harmonics

    @property
    def frequency(self) -> float:
        """Frequency of the last harmonic, Hz."""
        return self.harmonics / self.duration

    @property
    def periodic(self) -> bool:
        """Fourier series always are."""
        return True

    def values(self, t: Floats, order: int = 0) -> Floats:
        """Derivatives of all functions, shape (N, size)."""
        found = np.zeros((len(t), self.size))
        found[:, 0] = float(order == 0)
        for k, rate in enumerate(self._rates):
            # every derivative turns by a quarter
            angle = rate * t + order * np.pi / 2
            found[:, 1 + 2 * k] = rate**order * np.sin(angle)
            found[:, 2 + 2 * k] = rate**order * np.cos(angle)
        return found

    def bounds(self, coefficients: Floats, order: int) -> Floats:
        """Sum of the amplitudes, shape (n,)."""
        pairs = coefficients[1:].reshape(self.harmonics, 2, -1)
        amplitudes: Floats = np.vstack(
            [np.abs(coefficients[:1]), np.linalg.norm(pairs, axis=1)]
        )
        rates: Floats = np.append(0.0, self._rates)
        return np.asarray(rates**order) @ amplitudes

    @property
    def _rates(self) -> Floats:
        return 2 * np.pi / self.duration * np.arange(1.0, self.harmonics + 1)


DEGREE = 5
"""Of splines, quintic: jerks are continuous."""


@dataclass(frozen=True)
class Splines(Basis):
    """B-splines with given breakpoints, all derivatives of interest continuous inside."""

    breaks: tuple[float, ...]  # from 0 to the duration, s
    degree: int = DEGREE  # at least 5: jerks of lower ones jump, and nothing bounds what they do between samples

    def __post_init__(self) -> None:
        if self.degree < DEGREE:
            raise InputError(
                f"splines have degree {DEGREE} at least, so that jerks are continuous; got {self.degree}"
            )

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
        """Frequency of a motion that turns in every segment, Hz."""
        return 0.5 / float(np.min(np.diff(self.breaks)))

    def values(self, t: Floats, order: int = 0) -> Floats:
        """Derivatives of all functions, shape (N, size)."""
        return self.motion(t, np.eye(self.size), order)

    def motion(self, t: Floats, coefficients: Floats, order: int = 0) -> Floats:
        """Derivatives of combinations; at every time few functions are not zero."""
        if order > self.degree:
            return np.zeros((len(t), coefficients.shape[1]))
        with extra("excite"):
            from scipy.interpolate import BSpline

        spline = BSpline(self._knots, coefficients, self.degree)
        return np.asarray(spline(np.clip(t, 0.0, self.duration), nu=order))

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
        return np.concatenate(
            [[0.0] * self.degree, self.breaks, [self.duration] * self.degree]
        )


def uniform_splines(duration: float, segments: int) -> Splines:
    """B-splines with segments of one length."""
    return Splines(tuple(np.linspace(0.0, duration, segments + 1).tolist()))


DURATIONS = (1e-6, 1e6)
"""Shortest and longest motion of a robot, s: beyond, powers of frequencies leave double precision."""

SHORTEST_STEP = 1e-9
"""Shortest time between samples, s; clocks count no finer."""

LARGEST = 1e12
"""Position, velocity, acceleration or jerk, SI units, that no robot comes near to."""


@public
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
        """Length of the motion, or of its period, s."""
        return self.basis.duration

    def __call__(self, t: npt.ArrayLike, order: int = 0) -> Floats:
        """Positions at times, or derivatives of them.

        Parameters
        ----------
        t : array of shape (N,), or float for one time
            s; of a periodic motion also beyond its duration.
        order : int
            0 for positions (rad, m), 1 for velocities, 2 for accelerations, 3 for jerks.

        Returns
        -------
        array of shape (N, n), or (n,) at one time
        """
        times = np.asarray(t, dtype=float)
        found = self.basis.motion(np.atleast_1d(times), self.coefficients, order)
        return found if times.ndim else found[0]

    def bounds(self, order: int) -> Floats:
        """Upper bounds of the absolute derivatives of an order at any time, shape (n,)."""
        return self.basis.bounds(self.coefficients, order)

    def states(self, t: npt.ArrayLike) -> tuple[Floats, Floats, Floats]:
        """Positions, velocities and accelerations, each of shape (N, n), or (n,) at one time."""
        return self(t), self(t, 1), self(t, 2)
