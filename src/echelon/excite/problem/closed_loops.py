"""The regressor and the limits of mechanisms with loops as functions of the independent coordinates.

Next to singular configurations dependent velocities grow beyond all bounds, and with them the information of a motion.
So samples there count less and less, and not at all where the loops cannot be closed: a solver is not drawn to where
the constraint :class:`LoopLimits` will not let it stay, and its trial points have values.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.excite.problem.effort_limits import EffortLimit, EffortModel, effort_limits
from echelon.excite.problem.information import ADJOINT, StateRegressor
from echelon.excite.problem.loop_motion import Closed, LoopMotion, Triple
from echelon.excite.problem.state_limits import Slopes, StateConstraint
from echelon.mechanism.joint import MotionKind
from echelon.mechanism.mechanism import Mechanism

NO_WEIGHT, FULL_WEIGHT = 0.05, 0.1
"""Openness, as a share of :attr:`LoopMotion.reference`, below which samples do not count and above which they do."""


def state_regressor(mechanism: Mechanism, pivots: Sequence[int], smooth: float | None = None) -> StateRegressor:
    """The regressor of a mechanism as a function of its independent coordinates."""
    made = LoopRegressor if mechanism.closures else StateRegressor
    return made(mechanism, pivots, smooth)


def check_loops(mechanism: Mechanism, move: Sequence[str] | None, hold: Collection[str], source: str) -> None:
    """Refuse what is not possible with loops: to hold coordinates, and to move what has no motor of its own."""
    names = mechanism.independent_velocities
    if hold or (move is not None and set(move) != set(names)):
        problem = f"with loops all independent coordinates move ({', '.join(names)}); leave out move and hold"
        raise InputError(problem, source=source, element="excitation")
    free = {
        n
        for body in mechanism.bodies
        if body.joint.kind == "floating"
        for m in body.joint.motions
        for n in m.velocities
    }
    free |= {n for m in mechanism.motions if m.kind is MotionKind.BALL for n in m.velocities}
    loose = [name for name in names if name in free]
    if loose:
        problem = f"'{loose[0]}' is independent but not driven by a motor of its own, and with loops it cannot be held"
        raise InputError(problem, source=source, element="excitation")


class LoopRegressor(StateRegressor):
    """The entries of a reduced regressor at independent states of a mechanism with loops, and their pullback.

    Its states q, q̇ and q̈ are those of the independent coordinates, each of shape (N, k).
    """

    def __init__(self, mechanism: Mechanism, pivots: Sequence[int], smooth: float | None = None) -> None:
        super().__init__(mechanism, pivots, smooth)
        self.motion = LoopMotion(mechanism)
        self.motion.virtual_velocities(self.motion.pose[None])  # refuses outputs that the motion does not determine

    def entries(self, state: Mapping[str, Floats]) -> Floats:
        """Values of all entries, shape (N, size); zero for samples whose loops cannot be closed."""
        closed = self.motion.positioned(state["q"])
        return self._whole_entries(closed, {**state, "q": closed.q}) * self._sample_weights(closed)[0][:, None]

    def pulled(self, state: Mapping[str, Floats], adjoint: Floats) -> tuple[Floats, Floats, Floats]:
        """Derivatives by q, q̇ and q̈, each of shape (N, k), from those by the entries, of shape (N, size)."""
        closed = self.motion.positioned(state["q"])
        whole, (counted, slope) = {**state, "q": closed.q}, self._sample_weights(closed)
        given = {**whole, **self._geometry, ADJOINT: adjoint * counted[:, None]}
        found = closed.counted(self._pullback(given))
        places, count = closed.q.shape[1], state["qd"].shape[1]
        by_q, by_qd, by_qdd = np.split(found, [places, places + count], axis=1)
        if slope.any():
            weights = slope * np.sum(adjoint * self._whole_entries(closed, whole), axis=1)
            by_q = by_q + self.motion.openness_slopes(closed, weights)
        return self.motion.along(closed, by_q), by_qd, by_qdd

    def _whole_entries(self, closed: Closed, whole: Mapping[str, Floats]) -> Floats:
        return closed.counted(super().entries(whole))

    def _sample_weights(self, closed: Closed) -> tuple[Floats, Floats]:
        """Weights of the samples, and their derivatives by openness."""
        scale = 1 / (self.motion.reference * (FULL_WEIGHT - NO_WEIGHT))
        share = np.clip(closed.openness * scale - NO_WEIGHT / (FULL_WEIGHT - NO_WEIGHT), 0.0, 1.0)
        return share**2 * (3 - 2 * share), 6 * share * (1 - share) * scale


@dataclass(frozen=True, eq=False)
class LoopPart:
    """Some functions of the whole state."""

    constraint: StateConstraint

    def values(self, _motion: LoopMotion, closed: Closed) -> Floats:
        """The functions, shape (N, m)."""
        return self.constraint.values(closed.q, closed.qd, closed.qdd)

    def slopes(self, motion: LoopMotion, closed: Closed) -> list[Triple]:
        """Derivatives of each function by the independent q, q̇ and q̈."""
        parts = self.constraint.slopes(closed.q, closed.qd, closed.qdd)
        rows = range(len(self.constraint.labels))
        return [motion.pulled(closed, *(None if part is None else part[:, row] for part in parts)) for row in rows]


class LoopEfforts:
    """Torques and forces, by a model that was known before."""

    def __init__(
        self,
        mechanism: Mechanism,
        limits: Sequence[EffortLimit],
        model: EffortModel,
        margin: float,
        smooth: float | None,
    ) -> None:
        self.constraint = effort_limits(mechanism, limits, model, margin, smooth)

    def values(self, motion: LoopMotion, closed: Closed) -> Floats:
        """The efforts, shape (N, m)."""
        return self.constraint.values(*motion.independent(closed).values())

    def slopes(self, motion: LoopMotion, closed: Closed) -> list[Triple]:
        """Derivatives of each effort by the independent q, q̇ and q̈."""
        by_q, *by_rates = self.constraint.slopes(*motion.independent(closed).values())
        assert by_q is not None
        found: list[Triple] = []
        for row in range(len(self.constraint.labels)):
            by_qd, by_qdd = (closed.counted(part[:, row]) for part in by_rates if part is not None)
            found.append((motion.along(closed, by_q[:, row]), by_qd, by_qdd))
        return found


OPEN = 0.15
"""Least openness that a solver has to keep, as a share of :attr:`LoopMotion.reference`."""


@dataclass(frozen=True, eq=False)
class LoopLimits(StateConstraint):
    """Limits of a motion of the independent coordinates; made by :func:`loop_limits`.

    The first function is the openness of the loops as a share of the usual one; where they cannot be closed, it is
    negative, by how far it is back to where they can.  All others count as kept there.
    """

    motion: LoopMotion
    parts: tuple[LoopPart | LoopEfforts, ...]

    def values(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """The functions at independent states of shape (N, k), shape (N, m)."""
        closed = self.motion.at(q, qd, qdd)
        away = np.linalg.norm(closed.missing, axis=1)
        share = np.where(closed.done, closed.openness / self.motion.reference, -away)
        found = np.column_stack([share, *(part.values(self.motion, closed) for part in self.parts)])
        kept = np.clip(0.0, self.low, self.high)
        return np.where(closed.done[:, None] | (np.arange(len(kept)) == 0), found, kept)

    def slopes(self, q: Floats, qd: Floats, qdd: Floats) -> Slopes:
        """Derivatives of the functions, each of shape (N, m, k)."""
        closed = self.motion.at(q, qd, qdd)
        opening = self.motion.openness_slopes(closed, np.full(len(q), 1 / self.motion.reference))
        away = np.linalg.norm(closed.missing, axis=1, keepdims=True)
        back = -closed.missing / np.maximum(away, 1e-300) / self.motion.independent_units
        by_q, nothing = self.motion.along(closed, opening), np.zeros_like(qd)
        first = (np.where(closed.done[:, None], by_q, back), nothing, nothing)
        rows = [first, *(row for part in self.parts for row in part.slopes(self.motion, closed))]
        by_q, by_qd, by_qdd = (np.stack([row[order] for row in rows], axis=1) for order in range(3))
        return by_q, by_qd, by_qdd


def loop_limits(motion: LoopMotion, parts: Sequence[LoopPart | LoopEfforts] = (), open_: float = OPEN) -> LoopLimits:
    """Limits of openness and of the whole state."""
    limits = [part.constraint for part in parts]
    labels = ("distance of the loops from singular poses", *(label for limit in limits for label in limit.labels))
    units = ("1", *(unit for limit in limits for unit in limit.units))
    low, high = ([limit.low for limit in limits], [limit.high for limit in limits])
    ends = np.concatenate([[open_], *low]), np.concatenate([[np.inf], *high])
    return LoopLimits(labels, units, *ends, motion, tuple(parts))
