"""Mechanisms with loops: motion, regressor and limits as functions of the independent coordinates, with derivatives.

Configurations are followed from the assembly pose in short steps, as :class:`CompiledAssembly` does it, but samples
that cannot be closed are marked and not refused, because a solver tries motions beyond what the loops allow.  A sample
that was closed when it was last asked for is followed from there.  Velocities and accelerations of all coordinates are
recorded functions of all positions and of the independent rates, so their derivatives are pullbacks in machine code;
derivatives by all positions count along the motions of the independent coordinates.

Next to singular configurations dependent velocities grow beyond all bounds, and with them the information of a motion.
So samples there count less and less, and not at all where the loops cannot be closed: a solver is not drawn to where
the constraint :class:`LoopLimits` will not let it stay, and its trial points have values.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from echelon.algebra import DEFAULT_SEED, Function, Program, random_generator
from echelon.compute import Kernel
from echelon.dynamics import Builder, CompiledAssembly, geometry_values, motion_function
from echelon.excite.problem.information import ADJOINT, StateRegressor, pullback
from echelon.excite.problem.state_limits import SECONDS, Slopes, StateConstraint
from echelon.loops import (
    LARGEST_CORRECTION,
    STRIDE,
    DependentMotion,
    largest,
    normalised,
    position_rates,
)
from echelon.robot import Mechanism, Motion, MotionKind
from echelon.shared import Flags, Floats, InputError

SHORTEST_STEP = 2e-3
"""Shortest step on the way to a configuration, rad or characteristic lengths: a solver also tries what cannot close."""
REMEMBERED = 4
"""Sets of samples whose configurations are kept: those of the criterion and of the constraints."""
POSES = 64
"""Random poses that tell what openness is usual."""
SINGULAR = 1e-9
"""Openness up to which dependent rates are of no use."""


@dataclass(frozen=True)
class Closed:
    """Configurations."""

    q: Floats  # shape (N, positions); where loops are not closed, as near as was reached
    done: Flags  # shape (N,); where the loops are closed
    # shape (N, k); what is left of the way to the independent positions, rad or characteristic lengths; 0 where
    # they are reached
    missing: Floats
    openness: Floats  # shape (N,); see :attr:`DependentMotion.openness`; zero where the loops are not closed

    def counted(self, values: Floats) -> Floats:
        """Values of shape (N, ...) where the loops are closed, and zeros."""
        return np.where(self.done[:, None], values, 0.0)


def openness(mechanism: Mechanism, _pivots: object) -> Function:
    """Record :attr:`DependentMotion.openness`."""
    motion = DependentMotion(mechanism, Program())
    return motion_function(
        "openness",
        motion,
        [motion.openness],
        ("openness",),
        "q",
        "distance from singular poses",
    )


class LoopMotion(CompiledAssembly):
    """Closed configurations from independent positions, closed states from independent ones, and derivatives."""

    functions: ClassVar[tuple[Builder, ...]] = (*CompiledAssembly.functions, openness)

    def __init__(self, mechanism: Mechanism) -> None:
        super().__init__(mechanism)
        self._last: dict[int, tuple[Floats, Closed]] = {}

    def __getstate__(self) -> dict[str, object]:
        """Copies remember nothing, so that what they find does not depend on when they were made."""
        return {**vars(self), "_last": {}}

    @property
    def independent_units(self) -> Floats:
        """Units of the independent positions, shape (k,)."""
        return self.speed_units[self._independent]

    @cached_property
    def reference(self) -> float:
        """The largest openness of some poses about that of the assembly, which may itself be nearly singular."""
        poses, _, _ = self.random_closed_states(random_generator(DEFAULT_SEED), POSES)
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
        q[left], gone[left] = self.followed(q[left], wanted[left], SHORTEST_STEP)
        away = (wanted - q[:, self.independent_places]) / self.independent_units
        open_ = self.run("openness", q=q)[:, 0]
        done = (gone >= 1) & (open_ > SINGULAR)
        missing = np.where(gone[:, None] < 1, away, 0.0)
        closed = Closed(q, done, missing, np.where(done, open_, 0.0))
        others = [
            (count, last) for count, last in self._last.items() if count != len(wanted)
        ]
        self._last = dict(
            [*others[1 - REMEMBERED :], (len(wanted), (wanted.copy(), closed))]
        )
        return closed

    def _stepped(self, last: Closed, wanted: Floats) -> tuple[Floats, Flags]:
        """One step from what was found before."""
        change = wanted - last.q[:, self.independent_places]
        done = last.done & (largest(change / self.independent_units) < STRIDE)
        change[~done] = 0.0
        rates = self.velocities(last, change)
        guess = normalised(
            self.mechanism, last.q + position_rates(self.mechanism, last.q, rates)
        )
        found, closed = self.near(guess)
        return found, done & closed & (
            largest((found - guess) / self.position_units) < LARGEST_CORRECTION
        )

    def velocities(self, closed: Closed, qd: Floats) -> Floats:
        """Velocities of all coordinates from independent ones; zero where the loops are not closed."""
        return closed.counted(self.run("closed_velocities", q=closed.q, qd=qd))

    # -- derivatives -----------------------------------------------------------------------------------------------

    def along(self, closed: Closed, by_q: Floats) -> Floats:
        """Derivatives along the motions of the independent coordinates, (N, k), from those by all positions."""
        rates = np.zeros((len(by_q), len(self._independent)))
        return self._pulled("position_rates", closed, by_q, qd=rates)[
            :, closed.q.shape[1] :
        ]

    def openness_slopes(self, closed: Closed, weights: Floats) -> Floats:
        """Derivatives of openness by all positions, times weights of shape (N,); shape (N, positions)."""
        return self._pulled("openness", closed, weights[:, None])

    def _pulled(
        self, name: str, closed: Closed, adjoint: Floats, **state: Floats
    ) -> Floats:
        kernel, geometry = self._pullbacks[name]
        given = {
            "q": closed.q,
            **state,
            **geometry,
            ADJOINT: np.ascontiguousarray(adjoint),
        }
        return closed.counted(kernel(given))

    @cached_property
    def _pullbacks(self) -> dict[str, tuple[Kernel, Mapping[str, Floats]]]:
        """Machine code of the pullbacks, with the geometry that it takes."""
        made = {
            f.name: pullback(f)
            for f in (openness(self.mechanism, ()), _position_rates(self.mechanism))
        }
        return {
            n: (Kernel(f), geometry_values(self.mechanism, f.arguments))
            for n, f in made.items()
        }


def _position_rates(mechanism: Mechanism) -> Function:
    """Rates of all positions; linear in the independent velocities."""
    motion = DependentMotion(mechanism, Program())
    found = motion.position_rates(
        {name: motion.given()[f"qd[{name}]"] for name in mechanism.velocities}
    )
    nodes = [motion.program.input(f"q[{name}]").node for name in mechanism.positions]
    values = [found.get(node, motion.program.zero) for node in nodes]
    return motion_function(
        "position_rates",
        motion,
        values,
        mechanism.positions,
        "q qd",
        "rates of all positions",
    )


FULL_WEIGHT = 0.1
"""Openness, as a share of :attr:`LoopMotion.reference`, from which samples count in full; up to half of it, not."""
NO_WEIGHT = FULL_WEIGHT / 2


def state_regressor(
    mechanism: Mechanism, pivots: Sequence[int], smooth: float | None = None
) -> StateRegressor:
    """The regressor of a mechanism as a function of its independent coordinates."""
    made = LoopRegressor if mechanism.dependent_velocities else StateRegressor
    return made(mechanism, pivots, smooth)


def loop_motion(mechanism: Mechanism) -> LoopMotion | None:
    """Closed motions of a mechanism with loops; None for a tree."""
    return LoopMotion(mechanism) if mechanism.dependent_velocities else None


def passive_motions(mechanism: Mechanism) -> list[Motion]:
    """Motions without a motor of their own: those of floating bases and of balls."""
    floating = (m for joint in mechanism.floating_joints for m in joint.motions)
    return [*floating, *(m for m in mechanism.motions if m.kind is MotionKind.BALL)]


def check_loops(
    mechanism: Mechanism, move: Sequence[str] | None, hold: Collection[str], source: str
) -> None:
    """Refuse what is not possible with loops: to hold coordinates, and to move what has no motor of its own."""
    names = mechanism.independent_velocities
    if hold or (move is not None and set(move) != set(names)):
        problem = f"with loops all independent coordinates move ({', '.join(names)}); leave out move and hold"
        raise InputError(problem, source=source, element="excitation")
    free = {name for motion in passive_motions(mechanism) for name in motion.velocities}
    loose = [name for name in names if name in free]
    if loose:
        problem = f"'{loose[0]}' is independent but not driven by a motor of its own, and with loops it cannot be held"
        raise InputError(problem, source=source, element="excitation")


class LoopRegressor(StateRegressor):
    """The entries of a reduced regressor at independent states of a mechanism with loops, and their pullback.

    Its states q, q̇ and q̈ are those of the independent coordinates, each of shape (N, k).
    """

    def __init__(
        self, mechanism: Mechanism, pivots: Sequence[int], smooth: float | None = None
    ) -> None:
        super().__init__(mechanism, pivots, smooth)
        self.motion = LoopMotion(mechanism)
        self.motion.virtual_velocities(
            self.motion.pose[None]
        )  # refuses outputs that the motion does not determine

    def entries(self, state: Mapping[str, Floats]) -> Floats:
        """Values of all entries, shape (N, size); zero for samples whose loops cannot be closed."""
        closed = self.motion.positioned(state["q"])
        return (
            self._whole_entries(closed, {**state, "q": closed.q})
            * self._sample_weights(closed)[0][:, None]
        )

    def pulled(
        self, state: Mapping[str, Floats], adjoint: Floats
    ) -> tuple[Floats, Floats, Floats]:
        """Derivatives by q, q̇ and q̈, each of shape (N, k), from those by the entries, of shape (N, size)."""
        closed = self.motion.positioned(state["q"])
        whole, (counted, slope) = {**state, "q": closed.q}, self._sample_weights(closed)
        given = {**whole, **self._geometry, ADJOINT: adjoint * counted[:, None]}
        found = closed.counted(self._pullback(given))
        places, count = closed.q.shape[1], state["qd"].shape[1]
        by_q, by_qd, by_qdd = np.split(found, [places, places + count], axis=1)
        if slope.any():
            weights = slope * np.sum(
                adjoint * self._whole_entries(closed, whole), axis=1
            )
            by_q = by_q + self.motion.openness_slopes(closed, weights)
        return self.motion.along(closed, by_q), by_qd, by_qdd

    def _whole_entries(self, closed: Closed, whole: Mapping[str, Floats]) -> Floats:
        return closed.counted(super().entries(whole))

    def _sample_weights(self, closed: Closed) -> tuple[Floats, Floats]:
        """Weights of the samples, and their derivatives by openness."""
        scale = 1 / (self.motion.reference * (FULL_WEIGHT - NO_WEIGHT))
        share = np.clip(
            closed.openness * scale - NO_WEIGHT / (FULL_WEIGHT - NO_WEIGHT), 0.0, 1.0
        )
        return share**2 * (3 - 2 * share), 6 * share * (1 - share) * scale


OPEN = 1.5 * FULL_WEIGHT
"""Least openness that a solver has to keep: some is lost between its samples."""


@dataclass(frozen=True, eq=False)
class LoopLimits(StateConstraint):
    """Limits of a motion of the independent coordinates; made by :func:`loop_limits`.

    The first function is the openness of the loops as a share of the usual one; where they cannot be closed, it is
    negative, by how far it is back to where they can.  All others count as kept there.
    """

    motion: LoopMotion
    parts: tuple[
        StateConstraint, ...
    ]  # of all positions, and the independent velocities and accelerations

    @property
    def seconds(self) -> float:
        """Work of the parts, and of closing the loops."""
        return SECONDS.closing + sum(part.seconds for part in self.parts)

    def values(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """The functions at independent states of shape (N, k), shape (N, m)."""
        closed = self.motion.positioned(q)
        away = np.linalg.norm(closed.missing, axis=1)
        share = np.where(closed.done, closed.openness / self.motion.reference, -away)
        found = np.column_stack(
            [share, *(part.values(closed.q, qd, qdd) for part in self.parts)]
        )
        kept = np.clip(0.0, self.low, self.high)
        return np.where(closed.done[:, None] | (np.arange(len(kept)) == 0), found, kept)

    def slopes(self, q: Floats, qd: Floats, qdd: Floats) -> Slopes:
        """Derivatives of the functions, each of shape (N, m, k)."""
        closed = self.motion.positioned(q)
        opening = self.motion.openness_slopes(
            closed, np.full(len(q), 1 / self.motion.reference)
        )
        away = np.linalg.norm(closed.missing, axis=1, keepdims=True)
        back = (
            -closed.missing / np.maximum(away, 1e-300) / self.motion.independent_units
        )
        first, nothing = self.motion.along(closed, opening), np.zeros_like(qd)
        rows = [(np.where(closed.done[:, None], first, back), nothing, nothing)]
        for part in self.parts:
            by_q, *by_rates = part.slopes(closed.q, qd, qdd)
            assert by_q is not None
            for row in range(len(part.labels)):
                by_qd, by_qdd = (
                    nothing if s is None else closed.counted(s[:, row])
                    for s in by_rates
                )
                rows.append((self.motion.along(closed, by_q[:, row]), by_qd, by_qdd))
        by_q, by_qd, by_qdd = (
            np.stack([row[order] for row in rows], axis=1) for order in range(3)
        )
        return by_q, by_qd, by_qdd


def loop_limits(
    motion: LoopMotion, parts: Sequence[StateConstraint] = ()
) -> LoopLimits:
    """Limits of openness and of the whole state."""
    labels = (
        "distance of the loops from singular poses",
        *(label for part in parts for label in part.labels),
    )
    units = ("1", *(unit for part in parts for unit in part.units))
    low, high = ([part.low for part in parts], [part.high for part in parts])
    ends = np.concatenate([[OPEN], *low]), np.concatenate([[np.inf], *high])
    return LoopLimits(labels, units, *ends, motion, tuple(parts))
