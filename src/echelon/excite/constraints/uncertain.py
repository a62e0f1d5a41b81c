"""Limits of efforts that an identified model predicts: plus and minus the deviations that its covariance gives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from echelon.arrays import Floats
from echelon.dynamics.arguments import STATE, geometry_values
from echelon.excite.constraints.effort_bounds import EffortBounds
from echelon.excite.constraints.effort_model import EffortModel
from echelon.excite.constraints.state import Slopes, enclosures_of
from echelon.excite.pullback import StateRegressor
from echelon.mechanism.mechanism import Mechanism
from echelon.program.function import Argument, Function
from echelon.program.intervals import Interval


class UncertainEfforts:
    """Two functions for each effort; a :class:`echelon.excite.constraints.state.StateConstraint`.

    Parameters
    ----------
    mechanism : Mechanism
        Whose outputs are the efforts.
    model : EffortModel
        With a covariance.
    bounds : EffortBounds
    smooth : float, optional
        See :class:`echelon.excite.constraints.state.StateLimits`.
    symbols : mapping of str to float, optional
    """

    def __init__(
        self,
        mechanism: Mechanism,
        model: EffortModel,
        bounds: EffortBounds,
        smooth: float | None,
        symbols: Mapping[str, float] | None,
    ) -> None:
        self.labels, self.units, self.low, self.high = bounds.labels, bounds.units, bounds.low, bounds.high
        self._regressor = StateRegressor(mechanism, model.places(mechanism), smooth, symbols)
        self._rows = [(row.entries, model.part(row.columns)) for row in self._regressor.rows]
        self._uniform = geometry_values(mechanism, self._regressor.recorded.arguments, symbols)

    def values(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """The functions at states of shape (N, n), shape (N, 2m)."""
        entries = self._regressor.entries(dict(zip(STATE, (q, qd, qdd), strict=True)))
        return np.hstack([model.extremes(entries[:, mine]) for mine, model in self._rows])

    def slopes(self, q: Floats, qd: Floats, qdd: Floats) -> Slopes:
        """Their derivatives by q, q̇ and q̈, each of shape (N, 2m, n)."""
        state = dict(zip(STATE, (q, qd, qdd), strict=True))
        entries, found = self._regressor.entries(state), []
        for mine, model in self._rows:
            for part in model.adjoints(entries[:, mine]):
                adjoint = np.zeros_like(entries)
                adjoint[:, mine] = part
                found.append(self._regressor.pulled(state, adjoint))
        by_q, by_qd, by_qdd = (np.stack(parts, axis=1) for parts in zip(*found, strict=True))
        return by_q, by_qd, by_qdd

    @property
    def recorded(self) -> Function:
        """The regressor, without smoothing."""
        return self._regressor.recorded

    def enclosures(self, ranges: Mapping[str, Interval], known: Sequence[Argument] = ()) -> Interval:
        """Bounds of the functions while states stay in intervals, without smoothing.

        Parameters
        ----------
        ranges : mapping of str to (array, array)
            Least and largest ``q``, ``qd``, ``qdd``, of shape (cells, n).
        known : sequence of Argument
            See :func:`echelon.excite.constraints.state.enclosures_of`.

        Returns
        -------
        low, high : arrays of shape (cells, 2m)
        """
        low, high = enclosures_of(self.recorded, self._uniform, ranges, known)
        parts = [model.enclosed((low[:, mine], high[:, mine])) for mine, model in self._rows]
        return np.hstack([part for part, _ in parts]), np.hstack([part for _, part in parts])
