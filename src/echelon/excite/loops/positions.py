"""Configurations of mechanisms with loops that belong to many positions of the independent coordinates.

They are followed from the assembly pose in short steps, as :class:`Assembly` does it, but samples that cannot be closed
are told and not refused: a solver tries motions beyond what the loops allow.  A sample that was closed when it was last
asked for is followed from there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from echelon.excite.loops.closures import ClosureKernels
from echelon.mechanism.joint import MotionKind
from echelon.mechanism.mechanism import Mechanism
from echelon.regressor.loops.assembly import Assembly
from echelon.regressor.loops.closed_motion import largest
from echelon.regressor.loops.closure_values import normalised, position_rates
from echelon.seeds import DEFAULT_SEED, random_generator

Floats = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

_STRIDE, _SHORTEST = 0.1, 2e-3  # of a step on the way to a configuration, rad or characteristic lengths
_FEW = 6  # iterations for one step
_LARGEST_CORRECTION = 0.05  # of what is predicted; more may be a jump to another way of assembly
_REMEMBERED = 4  # sets of samples: those of the criterion and of the constraints
_POSES = 64  # that tell what openness is usual
_SINGULAR = 1e-9  # relative; beyond this there is no left inverse to speak of


@dataclass(frozen=True)
class Closed:
    """States of all coordinates, and how the dependent ones follow.

    Attributes
    ----------
    q, qd, qdd : arrays of shape (N, ...)
        Of all coordinates.  Where loops are not closed, q is as near as was reached, and the others are zero.
    done : array of bool, shape (N,)
        Where the loops are closed.
    missing : array of shape (N, k)
        What is left of the way to the independent positions, rad or characteristic lengths; 0 where they are reached.
    jacobian : array of shape (N, equations, freedoms)
        J, in units of lengths and speeds.
    inverse : array of shape (N, dependent, equations)
        P; zero where the loops are not closed.
    openness : array of shape (N,)
        (Σ 1/σ²)^(−1/2) over the singular values of J_D: how far the configuration is from a singular one, a smooth
        lower bound of the least of them; zero where the loops are not closed.
    """

    q: Floats
    qd: Floats
    qdd: Floats
    done: Bools
    missing: Floats
    jacobian: Floats
    inverse: Floats
    openness: Floats


class LoopPositions(Assembly):
    """Closed configurations from independent positions.

    Parameters
    ----------
    mechanism : Mechanism
        With loops.
    symbols : mapping of str to float, optional
        Values that replace or complete those of the mechanism.
    """

    def __init__(self, mechanism: Mechanism, symbols: Mapping[str, float] | None = None) -> None:
        mechanism = replace(mechanism, reading=None)  # how a file was read is of no use to another process
        super().__init__(mechanism, symbols)
        self.kernels = ClosureKernels(mechanism, symbols)
        self.closures = self.kernels
        names = mechanism.positions
        self._places = [names.index(name) for name in self.independent_positions]
        self._speed_units = self.closures.units[: len(mechanism.velocities)]
        self._last: dict[int, tuple[Floats, Closed]] = {}

    def __getstate__(self) -> dict[str, object]:
        """Copies remember nothing, so that what they find does not depend on when they were made."""
        return {**vars(self), "_last": {}}

    @property
    def speed_units(self) -> Floats:
        """Units of the velocity coordinates' speeds, shape (velocities,)."""
        return self._speed_units

    @property
    def independent_units(self) -> Floats:
        """Units of the independent positions, shape (k,)."""
        found: Floats = self.position_units[self._places]
        return found

    @property
    def columns(self) -> tuple[list[int], list[int]]:
        """Columns of J that belong to the independent velocities, and to the dependent ones."""
        return list(self._independent), list(self._dependent)

    @cached_property
    def reference(self) -> float:
        """The largest openness of some poses about that of the assembly, which may itself be nearly singular."""
        poses, _, _ = self.random_closed_states(random_generator(DEFAULT_SEED), _POSES)
        poses = np.vstack([self.pose, poses])
        found = self._described(poses, np.ones(len(poses), dtype=bool), np.zeros((len(poses), 0)))
        return float(found.openness.max())

    # -- configurations --------------------------------------------------------------------------------------------

    def positioned(self, wanted: Floats) -> Closed:
        """Configurations at rest, or the nearest to them that were reached.

        Parameters
        ----------
        wanted : array of shape (N, k)
            Independent positions.
        """
        known = self._last.get(len(wanted))
        if known is not None and np.array_equal(known[0], wanted):
            return known[1]
        q = np.repeat(self.pose[None], len(wanted), axis=0)
        gone, left = np.zeros(len(wanted)), np.ones(len(wanted), dtype=bool)
        if known is not None:
            near, done = self._stepped(known[1], wanted)
            q[known[1].done], left = known[1].q[known[1].done], ~done
            q[done], gone[done] = near[done], 1.0
        q[left], gone[left] = self._followed(q[left], wanted[left])
        units = self.independent_units
        missing = np.where(gone[:, None] < 1, (wanted - q[:, self._places]) / units, 0.0)
        closed = self._described(q, gone >= 1, missing)
        others = [(count, last) for count, last in self._last.items() if count != len(wanted)]
        self._last = dict([*others[1 - _REMEMBERED :], (len(wanted), (wanted.copy(), closed))])
        return closed

    def _stepped(self, last: Closed, wanted: Floats) -> tuple[Floats, Bools]:
        """One step from what was found before."""
        change = (wanted - last.q[:, self._places]) / self._speed_units[self._independent]
        speeds = self._speeds(last, change)
        done = last.done & (largest(change) < _STRIDE)
        speeds[~done] = 0.0
        guess = self._moved(last.q, speeds)
        found, closed = self.closed(guess, self.mechanism.independent_velocities, _FEW)
        return found, done & closed & self._nearly(guess, found)

    def _speeds(self, closed: Closed, change: Floats) -> Floats:
        """Speeds of all velocity coordinates, from those of the independent ones, both in their units."""
        speeds = np.zeros((len(change), len(self._speed_units)))
        speeds[:, self._independent] = change
        opened = closed.jacobian[:, :, self._independent] @ change[:, :, None]
        speeds[:, self._dependent] = -(closed.inverse @ opened)[:, :, 0]
        return speeds

    def _followed(self, start: Floats, wanted: Floats) -> tuple[Floats, Floats]:
        """Configurations on the straight ways from closed ones, and which shares of them were gone."""
        q = start.copy()
        begin, units = q[:, self._places], self.independent_units
        extent = np.maximum(largest((wanted - begin) / units), _STRIDE)
        gone, stride = np.zeros(len(q)), _STRIDE / extent
        here = self._described(q, np.ones(len(q), dtype=bool), np.zeros((len(q), 0)))
        trend = position_rates(self.mechanism, q, self._speeds(here, (wanted - begin) / units) * self._speed_units)
        on = np.arange(len(q))
        while len(on):
            reached = np.minimum(gone[on] + stride[on], 1.0)[:, None]
            guess = q[on] + trend[on] * (reached - gone[on, None])
            guess[:, self._places] = (1 - reached) * begin[on] + reached * wanted[on]
            guess = normalised(self.mechanism, guess)
            found, done = self.closed(guess, self.mechanism.independent_velocities, _FEW)
            done &= self._nearly(guess, found)
            trend[on[done]] = (found - q[on])[done] / (reached[:, 0] - gone[on])[done, None]
            q[on[done]], gone[on[done]] = found[done], reached[done, 0]
            stride[on] = np.where(done, np.minimum(1.5 * stride[on], _STRIDE / extent[on]), stride[on] / 2)
            on = on[(gone[on] < 1) & (stride[on] * extent[on] >= _SHORTEST)]
        return q, gone

    def _nearly(self, guess: Floats, found: Floats) -> Bools:
        near: Bools = largest((found - guess) / self.position_units) < _LARGEST_CORRECTION
        return near

    def _described(self, q: Floats, done: Bools, missing: Floats) -> Closed:
        """Configurations with how the dependent velocities follow there."""
        jacobian = self.closures.at(q)[1]
        left, upper = np.linalg.qr(jacobian[:, :, self._dependent])
        sizes = np.abs(np.diagonal(upper, axis1=1, axis2=2))
        done = done & (sizes.min(axis=1, initial=1.0) > _SINGULAR * sizes.max(axis=1, initial=1.0))
        upper[~done] = np.eye(upper.shape[1])
        inverse = np.linalg.solve(upper, left.swapaxes(1, 2))
        openness = (inverse**2).sum(axis=(1, 2)) ** -0.5
        inverse[~done], openness[~done] = 0.0, 0.0
        nothing = np.zeros((len(q), len(self._speed_units)))
        return Closed(q, nothing, nothing, done, missing, jacobian, inverse, openness)

    def _moved(self, q: Floats, change: Floats) -> Floats:
        speeds, found = change * self._speed_units, q.copy()
        found[:, self._single[0]] += speeds[:, self._single[1]]
        for place, speed in self._balls:
            (w, vector), turning = quaternion_parts(q, place), speeds[:, speed : speed + 3]
            found[:, place] -= (vector * turning).sum(axis=1) / 2
            found[:, place + 1 : place + 4] += (w * turning + np.cross(vector, turning)) / 2
            found[:, place : place + 4] /= np.linalg.norm(found[:, place : place + 4], axis=1, keepdims=True)
        return found

    def single(self, q: Floats) -> Floats:
        """Positions in the places of their velocities, shape (N, velocities); zero for balls."""
        found = np.zeros((len(q), len(self.mechanism.velocities)))
        found[:, self._single[1]] = q[:, self._single[0]]
        return found

    def position_reach(self, moved: Floats) -> Floats:
        """How far positions can be away when no velocity coordinate's way is longer, shape (N, positions).

        Parameters
        ----------
        moved : array of shape (N, velocities)
            rad or m.
        """
        found = np.zeros((len(moved), len(self.mechanism.positions)))
        found[:, self._single[0]] = moved[:, self._single[1]]
        for place, speed in self._balls:  # a unit quaternion moves by half of the angle
            found[:, place : place + 4] = np.linalg.norm(moved[:, speed : speed + 3], axis=1, keepdims=True) / 2
        return found

    @cached_property
    def _single(self) -> tuple[list[int], list[int]]:
        """Places of coordinates that are no balls, among positions and among velocities."""
        places, speeds = self.mechanism.positions, self.mechanism.velocities
        names = [m.name for m in self.mechanism.motions if m.kind is not MotionKind.BALL and m.name in places]
        return [places.index(name) for name in names], [speeds.index(name) for name in names]

    @cached_property
    def _balls(self) -> list[tuple[int, int]]:
        """First places of balls, among positions and among velocities."""
        places, speeds = self.mechanism.positions, self.mechanism.velocities
        balls = [m for m in self.mechanism.motions if m.kind is MotionKind.BALL]
        return [(places.index(m.positions[0]), speeds.index(m.velocities[0])) for m in balls]


def quaternion_parts(q: Floats, place: int) -> tuple[Floats, Floats]:
    """A quaternion's scalar and vector.

    Parameters
    ----------
    q : array of shape (N, positions)
    place : int
        Of the first of its four numbers.
    """
    return q[:, place, None], q[:, place + 1 : place + 4]
