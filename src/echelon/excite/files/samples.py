"""Samples of a trajectory: what tables and messages hold."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.excite.trajectory import Trajectory

FEWEST = 6
"""Samples that a quintic spline goes through."""

PREFIXES = ("q", "qd", "qdd")
"""Of names of columns, by the order of the derivative."""

_MOST = 5_000_000
_AT_ONCE = 4_000_000
_ON_GRID = 1e-6


@dataclass(frozen=True)
class Samples:
    """A motion at some times.

    Attributes
    ----------
    coordinates : tuple of str
    t : array of shape (N,)
        s.
    states : tuple of 3 arrays of shape (N, n), or None
        Positions (rad, m), velocities and accelerations; the last two NaN in columns that are not known, or None.
    resolution : float
        Steps of the time stamps, s; 0 if they are those of floats.
    names : tuple of str
        What the columns of positions are called in the file, if not ``q_<name>``.
    """

    coordinates: tuple[str, ...]
    t: Floats
    states: tuple[Floats, Floats | None, Floats | None]
    resolution: float = 0.0
    names: tuple[str, ...] = ()

    def column(self, order: int, coordinate: int) -> str:
        """The name of a column, ``"qd_j3"``.

        Parameters
        ----------
        order : int
            Of the derivative.
        coordinate : int
            Its place.
        """
        if order == 0 and self.names:
            return self.names[coordinate]
        return f"{PREFIXES[order]}_{self.coordinates[coordinate]}"

    def columns(self) -> Iterator[tuple[int, int, Floats]]:
        """All columns that are known: order of the derivative, place of the coordinate, and values."""
        for order, values in enumerate(self.states):
            if values is not None:
                for j in range(len(self.coordinates)):
                    if order == 0 or not np.all(np.isnan(values[:, j])):
                        yield order, j, values[:, j]


def sampled(trajectory: Trajectory, rate: float, repeats: int = 1) -> Samples:
    """A trajectory at equal steps from its beginning to its end, both included.

    Where the end is no multiple of the step, the last step is shorter.

    Parameters
    ----------
    trajectory : Trajectory
    rate : float
        Hz.
    repeats : int
        How often a periodic motion is run.

    Raises
    ------
    InputError
        If the rate is not positive, gives less than six samples or too many, or a motion that is not periodic is to be
        repeated.
    """
    check_repeats(trajectory, repeats)
    if not (math.isfinite(rate) and rate > 0):
        raise InputError(f"{rate!r} Hz is no sampling rate; it is a positive number", element="rate")
    end = trajectory.duration * repeats
    steps = end * rate
    if steps > _MOST:
        raise InputError(f"{rate:g} Hz gives {steps:.3g} samples; at most {_MOST} are written", element="rate")
    whole = round(steps) if abs(steps - round(steps)) < _ON_GRID else math.floor(steps)
    t = np.arange(whole + 1) / rate
    t = np.append(t, end) if steps - whole >= _ON_GRID else np.append(t[:-1], end)
    if len(t) < FEWEST:
        problem = f"{rate:g} Hz gives {len(t)} samples in {end:g} s; at least {FEWEST} make a trajectory"
        raise InputError(problem, element="rate")
    q, qd, qdd = (_evaluated(trajectory, t, order) for order in range(3))
    return Samples(trajectory.coordinates, t, (q, qd, qdd))


def _evaluated(trajectory: Trajectory, t: Floats, order: int) -> Floats:
    """In pieces, because all functions of a basis are evaluated at once."""
    rows = max(1, _AT_ONCE // trajectory.basis.size)
    return np.concatenate([trajectory(t[k : k + rows], order) for k in range(0, len(t), rows)])


def check_repeats(trajectory: Trajectory, repeats: int) -> None:
    """Only what ends as it began can follow itself.

    Parameters
    ----------
    trajectory : Trajectory
    repeats : int

    Raises
    ------
    InputError
        If the motion cannot be run so often.
    """
    if repeats < 1:
        raise InputError(f"{repeats} is no number of runs; it is 1 or more", element="repeats")
    if repeats > 1 and not trajectory.basis.periodic:
        problem = f"a motion that is not periodic cannot be run {repeats} times without a jump; valid is 1"
        raise InputError(problem, element="repeats")
