"""The regressor of a mechanism with loops as a function of what moves: the independent coordinates.

The recorded regressor takes all positions, which follow from the closures, and independent rates; derivatives by all
positions count along the motions of the independent coordinates (:mod:`echelon.excite.loops.motion`).

Next to singular configurations dependent velocities grow beyond all bounds, and with them what a motion seems to show.
So samples there count less and less, and not at all where the loops cannot be closed: a solver is not drawn to where a
constraint (:class:`echelon.excite.loops.limits.LoopLimits`) will not let it stay, and its trial points have values.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.excite.loops.motion import LoopMotion
from echelon.excite.loops.positions import Closed
from echelon.excite.pullback import ADJOINT, StateRegressor
from echelon.mechanism.joint import MotionKind
from echelon.mechanism.mechanism import Mechanism

LOST, SEEN = 0.05, 0.1
"""Openness, as a share of :attr:`LoopMotion.reference`, below which samples do not count and above which they do."""


def state_regressor(
    mechanism: Mechanism,
    pivots: Sequence[int],
    smooth: float | None = None,
    symbols: Mapping[str, float] | None = None,
) -> StateRegressor:
    """The regressor of a mechanism as a function of its independent coordinates.

    Parameters
    ----------
    mechanism : Mechanism
        With loops or without.
    pivots : sequence of int
        Columns of the regressor.
    smooth : float, optional
        See :class:`StateRegressor`.
    symbols : mapping of str to float, optional
        Values of geometry symbols.

    Raises
    ------
    InputError
        If the regressor needs measured inputs, or the loops do not close.
    """
    made = LoopRegressor if mechanism.closures else StateRegressor
    return made(mechanism, pivots, smooth, symbols)


def check_loops(mechanism: Mechanism, move: Sequence[str] | None, hold: Collection[str], source: str) -> None:
    """Refuse what is not possible with loops: to hold coordinates, and to move what has no motor of its own.

    Parameters
    ----------
    mechanism : Mechanism
        With loops.
    move, hold : sequence of str, collection of str
        Coordinates that a set-up wants to move and to hold.
    source : str
        File name for messages.

    Raises
    ------
    InputError
        If a coordinate is to be held, or independent ones are free rotations or those of a floating base.
    """
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

    Parameters
    ----------
    mechanism : Mechanism
        With loops.
    pivots : sequence of int
        Columns of the regressor.
    smooth : float, optional
        See :class:`StateRegressor`.
    symbols : mapping of str to float, optional
        Values of geometry symbols.

    Raises
    ------
    InputError
        If the regressor needs measured inputs, the loops do not close, or the motion does not determine an output.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        pivots: Sequence[int],
        smooth: float | None = None,
        symbols: Mapping[str, float] | None = None,
    ) -> None:
        super().__init__(mechanism, pivots, smooth, symbols)
        self.motion = LoopMotion(mechanism, symbols)
        self.motion.virtual_velocities(self.motion.pose[None])  # refuses outputs that the motion does not determine

    def entries(self, state: Mapping[str, Floats]) -> Floats:
        """Values of all entries, shape (N, size); zero for samples whose loops cannot be closed."""
        closed = self.motion.positioned(state["q"])
        return self._seen(closed, {**state, "q": closed.q}) * self._counted(closed)[0][:, None]

    def pulled(self, state: Mapping[str, Floats], adjoint: Floats) -> tuple[Floats, Floats, Floats]:
        """Derivatives by q, q̇ and q̈, each of shape (N, k), from those by the entries, of shape (N, size)."""
        closed = self.motion.positioned(state["q"])
        whole, (counted, slope) = {**state, "q": closed.q}, self._counted(closed)
        given = {**whole, **self._symbols, ADJOINT: adjoint * counted[:, None]}
        found = closed.counted(self._pullback(given))
        places, count = closed.q.shape[1], state["qd"].shape[1]
        by_q, by_qd, by_qdd = np.split(found, [places, places + count], axis=1)
        if slope.any():
            weights = slope * np.sum(adjoint * self._seen(closed, whole), axis=1)
            by_q = by_q + self.motion.openness_slopes(closed, weights)
        return self.motion.along(closed, by_q), by_qd, by_qdd

    def _seen(self, closed: Closed, whole: Mapping[str, Floats]) -> Floats:
        return closed.counted(super().entries(whole))

    def _counted(self, closed: Closed) -> tuple[Floats, Floats]:
        """Weights of the samples, and their derivatives by openness."""
        scale = 1 / (self.motion.reference * (SEEN - LOST))
        share = np.clip(closed.openness * scale - LOST / (SEEN - LOST), 0.0, 1.0)
        return share**2 * (3 - 2 * share), 6 * share * (1 - share) * scale
