"""The regressor of a mechanism with loops as a function of what moves: the independent coordinates.

With loops the recorded regressor has one row, the power in a virtual motion, which is evaluated for each output with
the virtual velocities of that output.  All dependent quantities follow from the closures, and so do derivatives
(:mod:`echelon.excite.loops.motion`).

Next to singular configurations dependent velocities grow beyond all bounds, and with them what a motion seems to show.
So samples there count less and less, and not at all where the loops cannot be closed: a solver is not drawn to where a
constraint (:class:`echelon.excite.loops.limits.LoopLimits`) will not let it stay, and its trial points have values.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np
import numpy.typing as npt

from echelon.errors import InputError
from echelon.excite.loops.motion import LoopMotion, Slopes
from echelon.excite.loops.positions import Closed
from echelon.excite.pullback import ADJOINT, Rows, StateRegressor
from echelon.mechanism.joint import MotionKind
from echelon.mechanism.mechanism import Mechanism

Floats = npt.NDArray[np.float64]

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
        self._given = self.motion.given_speeds()
        self._outputs = len(mechanism.outputs)

    @property
    def size(self) -> int:
        """Number of entries."""
        return self._outputs * len(self.function.entries)

    @property
    def rows(self) -> list[Rows]:
        """The entries of each output."""
        columns = np.array([column for _, column in self.function.entries], dtype=np.intp)
        count = len(columns)
        return [Rows(slice(k * count, (k + 1) * count), columns) for k in range(self._outputs)]

    def entries(self, state: Mapping[str, Floats]) -> Floats:
        """Values of all entries, shape (N, size); zero for samples whose loops cannot be closed."""
        closed = self.motion.at(state["q"], state["qd"], state["qdd"])
        found = self._powers(closed, self.motion.virtual(closed, self._given))
        return (found * self._counted(closed)[0][:, None, None]).reshape(len(found), -1)

    def pulled(self, state: Mapping[str, Floats], adjoint: Floats) -> tuple[Floats, Floats, Floats]:
        """Derivatives by q, q̇ and q̈, each of shape (N, k), from those by the entries, of shape (N, size)."""
        closed = self.motion.at(state["q"], state["qd"], state["qdd"])
        virtual = self.motion.virtual(closed, self._given)
        counted, slope = self._counted(closed)
        split = adjoint.reshape(len(adjoint), self._outputs, -1)
        by_openness = None
        if slope.any():
            by_openness = slope * np.sum(split * self._powers(closed, virtual), axis=(1, 2))
        n, p = closed.qd.shape[1], closed.q.shape[1]
        total = np.zeros((len(adjoint), p + 2 * n))
        by_v = np.zeros((len(adjoint), n, self._outputs))
        for k, values in enumerate(self._values(closed, virtual)):
            weighted = np.ascontiguousarray(split[:, k] * counted[:, None])
            found = self._pullback({**values, ADJOINT: weighted})
            total += found[:, : p + 2 * n]
            by_v[:, :, k] = found[:, p + 2 * n :]
        by_state = total[:, :p], total[:, p : p + n], total[:, p + n :]
        return self.motion.pulled(closed, Slopes(*by_state, by_v, virtual, by_openness))

    def _powers(self, closed: Closed, virtual: Floats) -> Floats:
        """Entries of every output, shape (N, outputs, entries)."""
        return np.stack([self._entries(values) for values in self._values(closed, virtual)], axis=1)

    def _values(self, closed: Closed, virtual: Floats) -> list[dict[str, Floats]]:
        """Arguments of the recorded regressor, for each output."""
        return outputs_of(self.motion, closed, virtual, self._symbols)

    def _counted(self, closed: Closed) -> tuple[Floats, Floats]:
        """Weights of the samples, and their derivatives by openness."""
        scale = 1 / (self.motion.reference * (SEEN - LOST))
        share = np.clip(closed.openness * scale - LOST / (SEEN - LOST), 0.0, 1.0)
        return share**2 * (3 - 2 * share), 6 * share * (1 - share) * scale


def outputs_of(
    motion: LoopMotion, closed: Closed, virtual: Floats, uniform: Mapping[str, Floats]
) -> list[dict[str, Floats]]:
    """Arguments of a function of a mechanism with loops, for each of some outputs.

    Parameters
    ----------
    motion : LoopMotion
    closed : Closed
    virtual : array of shape (N, freedoms, outputs)
        See :meth:`LoopMotion.virtual`.
    uniform : mapping of str to array
        Values of uniform arguments.
    """
    n, count = closed.qd.shape[1], virtual.shape[2]
    state = {"q": closed.q, "qd": closed.qd, "qdd": closed.qdd, **uniform}
    speeds = virtual[:, :n] * motion.speed_units[:, None]
    found: list[dict[str, Floats]] = []
    for k in range(count):
        chosen = np.ascontiguousarray(np.broadcast_to(np.eye(count)[k], (len(closed.q), count)))
        found.append({**state, "u": chosen, "v": np.ascontiguousarray(speeds[:, :, k])})
    return found
