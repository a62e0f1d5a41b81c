"""Configurations of mechanisms with loops that belong to many positions of the independent coordinates.

They are followed from the assembly pose in short steps, as :class:`Assembly` does it, but samples that cannot be closed
are told and not refused: a solver tries motions beyond what the loops allow.  A sample that was closed when it was last
asked for is followed from there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from echelon.arrays import Flags, Floats
from echelon.dynamics.closed_states import Builder, CompiledAssembly
from echelon.dynamics.loop_functions import motion_function
from echelon.excite.loops.closures import ClosureBounds
from echelon.mechanism.joint import MotionKind
from echelon.mechanism.mechanism import Mechanism
from echelon.program.function import Function
from echelon.program.tape import Program
from echelon.regressor.loops.assembly import LARGEST_CORRECTION, STRIDE
from echelon.regressor.loops.closed_motion import largest
from echelon.regressor.loops.closure_values import normalised, position_rates
from echelon.regressor.loops.dependent_motion import DependentMotion
from echelon.seeds import DEFAULT_SEED, random_generator

_SHORTEST = 2e-3  # of a step on the way to a configuration, rad or characteristic lengths
_REMEMBERED = 4  # sets of samples: those of the criterion and of the constraints
_POSES = 64  # that tell what openness is usual
_SINGULAR = 1e-9  # openness; beyond this dependent rates are of no use


@dataclass(frozen=True)
class Closed:
    """States of all coordinates.

    Attributes
    ----------
    q, qd, qdd : arrays of shape (N, ...)
        Of all coordinates.  Where loops are not closed, q is as near as was reached, and the others are zero.
    done : array of bool, shape (N,)
        Where the loops are closed.
    missing : array of shape (N, k)
        What is left of the way to the independent positions, rad or characteristic lengths; 0 where they are reached.
    openness : array of shape (N,)
        See :attr:`DependentMotion.openness`; zero where the loops are not closed.
    """

    q: Floats
    qd: Floats
    qdd: Floats
    done: Flags
    missing: Floats
    openness: Floats

    def counted(self, values: Floats) -> Floats:
        """Values of shape (N, ...) where the loops are closed, and zeros."""
        found: Floats = np.where(self.done[:, None], values, 0.0)
        return found


def openness(mechanism: Mechanism, _pivots: object) -> Function:
    """Record :attr:`DependentMotion.openness`."""
    motion = DependentMotion(mechanism, Program())
    return motion_function("openness", motion, [motion.openness], ("openness",), "q", "distance from singular poses")


class LoopPositions(CompiledAssembly):
    """Closed configurations from independent positions.

    Parameters
    ----------
    mechanism : Mechanism
        With loops.
    symbols : mapping of str to float, optional
        Values that replace or complete those of the mechanism.
    """

    functions: ClassVar[tuple[Builder, ...]] = (*CompiledAssembly.functions, openness)

    def __init__(self, mechanism: Mechanism, symbols: Mapping[str, float] | None = None) -> None:
        mechanism = replace(mechanism, reading=None)  # how a file was read is of no use to another process
        super().__init__(mechanism, symbols)
        self.bounds = ClosureBounds(mechanism, symbols)
        self._last: dict[int, tuple[Floats, Closed]] = {}

    def __getstate__(self) -> dict[str, object]:
        """Copies remember nothing, so that what they find does not depend on when they were made."""
        return {**vars(self), "_last": {}}

    @property
    def speed_units(self) -> Floats:
        """Units of the velocity coordinates' speeds, shape (velocities,)."""
        return self.bounds.units

    @property
    def independent_units(self) -> Floats:
        """Units of the independent positions, shape (k,)."""
        units: Floats = self.bounds.units[self._independent]
        return units

    @property
    def columns(self) -> tuple[list[int], list[int]]:
        """Places of the independent velocities, and of the dependent ones."""
        return list(self._independent), list(self._dependent)

    @cached_property
    def reference(self) -> float:
        """The largest openness of some poses about that of the assembly, which may itself be nearly singular."""
        poses, _, _ = self.random_closed_states(random_generator(DEFAULT_SEED), _POSES)
        poses = np.vstack([self.pose, poses])
        return float(np.nanmax(self.run("openness", q=poses)))

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
        q[left], gone[left] = self.followed(q[left], wanted[left], _SHORTEST)
        away = (wanted - q[:, self.independent_places]) / self.independent_units
        open_ = self.run("openness", q=q)[:, 0]
        done = (gone >= 1) & (open_ > _SINGULAR)
        still = np.zeros((len(q), len(self.speed_units)))
        missing = np.where(gone[:, None] < 1, away, 0.0)
        closed = Closed(q, still, still, done, missing, np.where(done, open_, 0.0))
        others = [(count, last) for count, last in self._last.items() if count != len(wanted)]
        self._last = dict([*others[1 - _REMEMBERED :], (len(wanted), (wanted.copy(), closed))])
        return closed

    def _stepped(self, last: Closed, wanted: Floats) -> tuple[Floats, Flags]:
        """One step from what was found before."""
        change = wanted - last.q[:, self.independent_places]
        done = last.done & (largest(change / self.independent_units) < STRIDE)
        change[~done] = 0.0
        rates = last.counted(self.run("closed_velocities", q=last.q, qd=change))
        guess = normalised(self.mechanism, last.q + position_rates(self.mechanism, last.q, rates))
        found, closed = self.near(guess)
        return found, done & closed & (largest((found - guess) / self.position_units) < LARGEST_CORRECTION)

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
