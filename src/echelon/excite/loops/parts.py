"""Functions of the whole state of a mechanism with loops, as functions of the independent one."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from echelon.dynamics.arguments import geometry_values
from echelon.dynamics.functions import robot_function
from echelon.excite.constraints.effort import check_model, effort_output
from echelon.excite.constraints.effort_bounds import EffortBounds, EffortLimit
from echelon.excite.constraints.effort_model import EffortModel
from echelon.excite.constraints.state import Enclosed, StateConstraint, enclosures_of
from echelon.excite.loops.enclosures import Located, LoopEnclosures
from echelon.excite.loops.motion import LoopMotion, Slopes
from echelon.excite.loops.positions import Closed
from echelon.excite.loops.regressor import outputs_of
from echelon.excite.pullback import ADJOINT, pullback
from echelon.machine.kernel import Kernel
from echelon.mechanism.mechanism import Mechanism
from echelon.program.intervals import Interval
from echelon.program.rewriting import smooth_function

Floats = npt.NDArray[np.float64]
Triple = tuple[Floats, Floats, Floats]


class LoopPart:
    """Some functions of the whole state.

    Parameters
    ----------
    constraint : StateConstraint
        Of the whole state.
    """

    def __init__(self, constraint: StateConstraint) -> None:
        self.constraint = constraint
        self.labels, self.units = constraint.labels, constraint.units
        self.low, self.high = constraint.low, constraint.high

    def values(self, _motion: LoopMotion, closed: Closed) -> Floats:
        """The functions, shape (N, m)."""
        return self.constraint.values(closed.q, closed.qd, closed.qdd)

    def enclosures(self, _enclosures: LoopEnclosures, _located: Located, states: Mapping[str, Interval]) -> Interval:
        """Bounds of the functions while the whole state stays in intervals, each of shape (cells, m)."""
        assert isinstance(self.constraint, Enclosed)
        return self.constraint.enclosures(states)

    def slopes(self, motion: LoopMotion, closed: Closed) -> list[Triple]:
        """Of each function, the derivatives by the independent q, q̇ and q̈."""
        parts = self.constraint.slopes(closed.q, closed.qd, closed.qdd)
        found = []
        for row in range(len(self.labels)):
            by_state = [None if part is None else np.ascontiguousarray(part[:, row]) for part in parts]
            found.append(motion.pulled(closed, Slopes(*by_state)))
        return found


class LoopEfforts:
    """Torques and forces, by a model that was known before.

    Parameters
    ----------
    mechanism : Mechanism
        With loops.
    limits : sequence of EffortLimit
        At least one.
    model, margin, smooth, symbols
        See :func:`echelon.excite.constraints.effort.effort_limits`.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        limits: Sequence[EffortLimit],
        model: EffortModel,
        margin: float,
        smooth: float | None,
        symbols: Mapping[str, float] | None = None,
    ) -> None:
        check_model(mechanism, model)
        bounds = EffortBounds.of(limits, model, margin)
        self.labels, self.units, self.low, self.high = bounds.labels, bounds.units, bounds.low, bounds.high
        outputs = tuple(effort_output(mechanism, limit) for limit in limits)
        measured, self._model = replace(mechanism, measured=outputs, reading=None), model
        kind, parameters = ("inverse_dynamics", {"parameters": model.values}) if model.certain else ("regressor", {})
        self._recorded = robot_function(kind, measured, model.places(mechanism))
        function = self._recorded if smooth is None else smooth_function(self._recorded, smooth)
        self._uniform = {**parameters, **geometry_values(mechanism, function.arguments, symbols)}
        self._columns = np.array([index[-1] for index in function.entries], dtype=np.intp)
        self._kernel, self._pullback = Kernel(function), Kernel(pullback(function))
        self._given = LoopMotion(measured, symbols).given_speeds()

    def values(self, motion: LoopMotion, closed: Closed) -> Floats:
        """The efforts, shape (N, m)."""
        given = outputs_of(motion, closed, self._virtual(motion, closed), self._uniform)
        found = [self._kernel(values) for values in given]
        return np.hstack(found if self._model.certain else [self._model.extremes(x[:, 0]) for x in found])

    def slopes(self, motion: LoopMotion, closed: Closed) -> list[Triple]:
        """Of each effort, the derivatives by the independent q, q̇ and q̈."""
        virtual, found = self._virtual(motion, closed), []
        p, n = closed.q.shape[1], closed.qd.shape[1]
        for k, values in enumerate(outputs_of(motion, closed, virtual, self._uniform)):
            for adjoint in self._adjoints(values):
                pulled = self._pullback({**values, ADJOINT: adjoint})
                by_state = pulled[:, :p], pulled[:, p : p + n], pulled[:, p + n : p + 2 * n]
                by_v = pulled[:, p + 2 * n :, None]
                found.append(motion.pulled(closed, Slopes(*by_state, by_v, virtual[:, :, k : k + 1])))
        return found

    def enclosures(self, enclosures: LoopEnclosures, located: Located, states: Mapping[str, Interval]) -> Interval:
        """Bounds of the efforts while the whole state stays in intervals, without smoothing, (cells, m)."""
        low, high = enclosures.virtual(located, self._all_given(located.closed))
        count, found = low.shape[2], []
        for k, chosen in enumerate(np.eye(count)):
            weights = np.tile(chosen, (len(low), 1))
            ranges = {**states, "u": (weights, weights), "v": (low[:, :, k], high[:, :, k])}
            ends = enclosures_of(self._recorded, self._uniform, ranges)
            found.append(ends if self._model.certain else self._model.part(self._columns).enclosed(ends))
        return np.hstack([least for least, _ in found]), np.hstack([most for _, most in found])

    def _adjoints(self, values: dict[str, Floats]) -> Iterable[Floats]:
        """Derivatives of an effort, or of both that stand for it, by the entries of what is recorded."""
        if self._model.certain:
            return [np.ones((len(values["q"]), 1))]
        return self._model.adjoints(self._kernel(values)[:, 0])[:, :, self._columns]

    def _virtual(self, motion: LoopMotion, closed: Closed) -> Floats:
        return motion.virtual(closed, self._all_given(closed))

    def _all_given(self, closed: Closed) -> Floats:
        given = np.zeros((closed.jacobian.shape[2], self._given.shape[1]))
        given[: len(self._given)] = self._given  # sensors stay at rest
        return given
