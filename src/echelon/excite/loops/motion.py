"""Motions of mechanisms with loops, and what derivatives by the whole state are as derivatives by the independent one.

Velocities and accelerations of all coordinates are recorded functions of all positions and of the independent rates,
and so their derivatives are pullbacks in machine code.  What is left are derivatives by all positions: they count along
the motions of the independent coordinates.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property

import numpy as np

from echelon.arrays import Floats
from echelon.dynamics.arguments import geometry_values
from echelon.dynamics.loop_functions import closed_accelerations, closed_velocities, motion_function
from echelon.excite.loops.positions import Closed, LoopPositions, openness
from echelon.excite.pullback import ADJOINT, pullback
from echelon.machine.kernel import Kernel
from echelon.mechanism.mechanism import Mechanism
from echelon.program.function import Function
from echelon.program.tape import Program
from echelon.regressor.loops.dependent_motion import DependentMotion

Triple = tuple[Floats, Floats, Floats]


class LoopMotion(LoopPositions):
    """Closed states from independent ones, and derivatives.

    Parameters
    ----------
    mechanism : Mechanism
        With loops.
    symbols : mapping of str to float, optional
        Values that replace or complete those of the mechanism.
    """

    def at(self, q: Floats, qd: Floats, qdd: Floats) -> Closed:
        """States of all coordinates; at rest where the loops are not closed.

        Parameters
        ----------
        q, qd, qdd : arrays of shape (N, k)
            Of the independent coordinates.
        """
        closed = self.positioned(q)
        state = {"q": closed.q, "qd": qd, "qdd": qdd}
        rates = [self.run(name, **state) for name in ("closed_velocities", "closed_accelerations")]
        return replace(closed, qd=closed.counted(rates[0]), qdd=closed.counted(rates[1]))

    def independent(self, closed: Closed) -> dict[str, Floats]:
        """The arguments q, q̇ and q̈ of recorded functions: all positions, and independent rates."""
        free = self.columns[0]
        return {"q": closed.q, "qd": closed.qd[:, free], "qdd": closed.qdd[:, free]}

    # -- derivatives -----------------------------------------------------------------------------------------------

    def pulled(
        self, closed: Closed, by_q: Floats | None, by_qd: Floats | None = None, by_qdd: Floats | None = None
    ) -> Triple:
        """Derivatives by the independent q, q̇ and q̈, each of shape (N, k), from those by the whole state.

        Zero for samples whose loops are not closed.

        Parameters
        ----------
        closed : Closed
            As :meth:`at` found it.
        by_q : array of shape (N, positions), optional
        by_qd, by_qdd : array of shape (N, velocities), optional
        """
        places, count = closed.q.shape[1], len(self.columns[0])
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
        return {n: (Kernel(f), geometry_values(self.mechanism, f.arguments, self.symbols)) for n, f in made.items()}


def _position_rates(mechanism: Mechanism, _pivots: object) -> Function:
    """Rates of all positions; linear in the independent velocities."""
    motion = DependentMotion(mechanism, Program())
    found = motion.position_rates({name: motion.given()[f"qd[{name}]"] for name in mechanism.velocities})
    nodes = [motion.program.input(f"q[{name}]").node for name in mechanism.positions]
    values = [found.get(node, motion.program.zero) for node in nodes]
    return motion_function("position_rates", motion, values, mechanism.positions, "q qd", "rates of all positions")
