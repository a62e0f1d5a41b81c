"""Motions of mechanisms with loops: all coordinates from the independent ones, and derivatives by these.

Configurations are followed from the assembly pose in short steps, as :class:`CompiledAssembly` does it, but samples
that cannot be closed are marked and not refused, because a solver tries motions beyond what the loops allow.  A sample
that was closed when it was last asked for is followed from there.  Velocities and accelerations of all coordinates are
recorded functions of all positions and of the independent rates, so their derivatives are pullbacks in machine code;
derivatives by all positions count along the motions of the independent coordinates.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from echelon.arrays import Flags, Floats
from echelon.dynamics.arguments import geometry_values
from echelon.dynamics.closed_states import Builder, CompiledAssembly
from echelon.dynamics.loop_functions import closed_accelerations, closed_velocities, motion_function
from echelon.excite.problem.information import ADJOINT, pullback
from echelon.machine.kernel import Kernel
from echelon.mechanism.mechanism import Mechanism
from echelon.program.function import Function
from echelon.program.tape import Program
from echelon.regressor.loops.assembly import LARGEST_CORRECTION, STRIDE
from echelon.regressor.loops.closed_motion import largest, normalised, position_rates
from echelon.regressor.loops.dependent_motion import DependentMotion
from echelon.seeds import DEFAULT_SEED, random_generator

_SHORTEST = 2e-3  # of a step on the way to a configuration, rad or characteristic lengths
_REMEMBERED = 4  # sets of samples: those of the criterion and of the constraints
_POSES = 64  # that tell what openness is usual
_SINGULAR = 1e-9  # openness; beyond this dependent rates are of no use


@dataclass(frozen=True)
class Closed:
    """States of all coordinates."""

    # of all coordinates, shape (N, ...); where loops are not closed, q is as near as was reached, the others are zero
    q: Floats
    qd: Floats
    qdd: Floats
    done: Flags  # shape (N,); where the loops are closed
    # shape (N, k); what is left of the way to the independent positions, rad or characteristic lengths; 0 where
    # they are reached
    missing: Floats
    openness: Floats  # shape (N,); see :attr:`DependentMotion.openness`; zero where the loops are not closed

    def counted(self, values: Floats) -> Floats:
        """Values of shape (N, ...) where the loops are closed, and zeros."""
        found: Floats = np.where(self.done[:, None], values, 0.0)
        return found


def openness(mechanism: Mechanism, _pivots: object) -> Function:
    """Record :attr:`DependentMotion.openness`."""
    motion = DependentMotion(mechanism, Program())
    return motion_function("openness", motion, [motion.openness], ("openness",), "q", "distance from singular poses")


class LoopPositions(CompiledAssembly):
    """Closed configurations from independent positions."""

    functions: ClassVar[tuple[Builder, ...]] = (*CompiledAssembly.functions, openness)

    def __init__(self, mechanism: Mechanism) -> None:
        super().__init__(mechanism)
        self._last: dict[int, tuple[Floats, Closed]] = {}

    def __getstate__(self) -> dict[str, object]:
        """Copies remember nothing, so that what they find does not depend on when they were made."""
        return {**vars(self), "_last": {}}

    @property
    def speed_units(self) -> Floats:
        """Units of the velocity coordinates' speeds, shape (velocities,)."""
        return self.closures.units[: len(self.mechanism.velocities)]

    @property
    def independent_units(self) -> Floats:
        """Units of the independent positions, shape (k,)."""
        units: Floats = self.speed_units[self._independent]
        return units

    @cached_property
    def reference(self) -> float:
        """The largest openness of some poses about that of the assembly, which may itself be nearly singular."""
        poses, _, _ = self.random_closed_states(random_generator(DEFAULT_SEED), _POSES)
        poses = np.vstack([self.pose, poses])
        return float(np.nanmax(self.run("openness", q=poses)))

    # -- configurations --------------------------------------------------------------------------------------------

    def positioned(self, wanted: Floats) -> Closed:
        """Configurations at rest, or the nearest to them that were reached."""
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


Triple = tuple[Floats, Floats, Floats]


class LoopMotion(LoopPositions):
    """Closed states from independent ones, and derivatives."""

    def at(self, q: Floats, qd: Floats, qdd: Floats) -> Closed:
        """States of all coordinates; at rest where the loops are not closed."""
        closed = self.positioned(q)
        state = {"q": closed.q, "qd": qd, "qdd": qdd}
        rates = [self.run(name, **state) for name in ("closed_velocities", "closed_accelerations")]
        return replace(closed, qd=closed.counted(rates[0]), qdd=closed.counted(rates[1]))

    def independent(self, closed: Closed) -> dict[str, Floats]:
        """The arguments q, q̇ and q̈ of recorded functions: all positions, and independent rates."""
        free = list(self._independent)
        return {"q": closed.q, "qd": closed.qd[:, free], "qdd": closed.qdd[:, free]}

    # -- derivatives -----------------------------------------------------------------------------------------------

    def pulled(
        self, closed: Closed, by_q: Floats | None, by_qd: Floats | None = None, by_qdd: Floats | None = None
    ) -> Triple:
        """Derivatives by the independent q, q̇ and q̈, each of shape (N, k), from those by the whole state.

        Zero for samples whose loops are not closed.
        """
        places, count = closed.q.shape[1], len(self._independent)
        total = np.zeros((len(closed.q), places + 2 * count))
        if by_q is not None:
            total[:, :places] += by_q
        for name, adjoint in (("closed_velocities", by_qd), ("closed_accelerations", by_qdd)):
            if adjoint is not None:
                found = self._pulled(name, closed, adjoint)
                total[:, : found.shape[1]] += found
        first, rest = self.along(closed, total[:, :places]), closed.counted(total[:, places:])
        return first, rest[:, :count], rest[:, count:]

    def along(self, closed: Closed, by_q: Floats) -> Floats:
        """Derivatives along the motions of the independent coordinates, (N, k), from those by all positions."""
        return self._pulled("position_rates", closed, by_q)[:, closed.q.shape[1] :]

    def openness_slopes(self, closed: Closed, weights: Floats) -> Floats:
        """Derivatives of openness by all positions, times weights of shape (N,); shape (N, positions)."""
        return self._pulled("openness", closed, weights[:, None])

    def _pulled(self, name: str, closed: Closed, adjoint: Floats) -> Floats:
        kernel, geometry = self._pullbacks[name]
        names = {argument.name for argument in kernel.function.arguments}
        state = {k: v for k, v in self.independent(closed).items() if k in names}
        return closed.counted(kernel({**state, **geometry, ADJOINT: np.ascontiguousarray(adjoint)}))

    @cached_property
    def _pullbacks(self) -> dict[str, tuple[Kernel, Mapping[str, Floats]]]:
        """Machine code of the pullbacks, with the geometry that it takes."""
        builders = (closed_velocities, closed_accelerations, openness, _position_rates)
        made = {function.name: pullback(function) for function in (build(self.mechanism, ()) for build in builders)}
        return {n: (Kernel(f), geometry_values(self.mechanism, f.arguments)) for n, f in made.items()}


def _position_rates(mechanism: Mechanism, _pivots: object) -> Function:
    """Rates of all positions; linear in the independent velocities."""
    motion = DependentMotion(mechanism, Program())
    found = motion.position_rates({name: motion.given()[f"qd[{name}]"] for name in mechanism.velocities})
    nodes = [motion.program.input(f"q[{name}]").node for name in mechanism.positions]
    values = [found.get(node, motion.program.zero) for node in nodes]
    return motion_function("position_rates", motion, values, mechanism.positions, "q qd", "rates of all positions")
